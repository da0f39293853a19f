"""What all backends must find: `python -m tests.backends.write_expected` writes `data/`.

Events are from arithmetic of 80 bits, whose rounding is 2000 times smaller. The small study has places of the reference's
masses with noise, as text, so that every backend reads the same bytes.
"""

import dataclasses
import json
from pathlib import Path
from typing import NamedTuple

import numpy as np

from looping_pendulum.discrepancy.evidence.explanation import WIDE, Explanation, Parts, explained
from looping_pendulum.discrepancy.evidence.marginal import NoiseGrid
from looping_pendulum.discrepancy.fit.calibration import Fit, minimise
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.discrepancy.fit.residual_noise import refit_with_estimated_noise
from looping_pendulum.discrepancy.inputs import read_inputs
from looping_pendulum.measured.study_io import load
from looping_pendulum.reference_ode.solve import solve_at
from research import heyoka_runs
from tests.apparatus import SENSITIVE, TEN_TO_ONE, TWO_TO_ONE

DATA = Path(__file__).with_name("data")
APPARATUS = {"ten_to_one": TEN_TO_ONE, "two_to_one": TWO_TO_ONE, "sensitive": SENSITIVE}
FRAME_RATE, FRAMES = 120, 44
"""Frames per second, and how many: up to 0.36 s, a little before the halt."""
NOISE = 5e-4
"""Standard deviation of the tracked points [m]."""
PUSH = 0.06
"""Undeclared speed of the light mass across the string at release [m/s]: what the data loop has to name."""


def events(name: str) -> list[list[object]]:
    """Every event of an apparatus: name, time [s], mode after it, wrap angle [rad] and free length [m]."""
    run = heyoka_runs.solve(APPARATUS[name], precision="80-bit", duration=2.0)
    return [
        [e.event and e.event.value, float(e.time), e.mode_after.name, float(e.state.wrap_angle), float(e.state.free_length)]
        for e in run.events
    ]


def tracked() -> str:
    """The small study's CSV."""
    t = np.arange(FRAMES) / FRAME_RATE
    samples = solve_at(TEN_TO_ONE.replace(push_across=PUSH), t, duration=0.4)
    places = np.column_stack([samples.light_position, samples.heavy_position[:, 1]])
    places += np.random.default_rng(12).normal(0.0, NOISE, places.shape)
    rows = [",".join([f"{time:.6f}", *(f"{1e3 * place:.2f}" for place in row)]) for time, row in zip(t, places, strict=True)]
    return "\n".join(["t [s],light_x [mm],light_y [mm],heavy_y [mm]", *rows]) + "\n"


CANDIDATES = {"push_across": 0.1, "wind_speed": 1.0, "clock_offset": 0.01, "scale": 0.05}
"""Candidate of the small study that needs little compiling -> about the size that it may have [SI]."""


class Loop(NamedTuple):
    """A turn of the data loop on the small study."""

    declared: Fit
    """Of the model without the push."""
    explanations: list[Explanation]
    """The declared model, and it with each of the candidates; the most probable first."""
    added: Fit
    """With the best of them."""

    @property
    def log_bayes_factors(self) -> dict[str, float]:
        """Return candidate -> natural logarithm of the factor by which it makes the data more probable."""
        (nothing,) = (e for e in self.explanations if not e.key)
        return {name: e.log_z - nothing.log_z for e in self.explanations for name in e.key}


def data_loop() -> Loop:
    """Read the small study, fit what it declares and each candidate beside it, and fit the most probable again."""
    inputs = read_inputs(load(DATA / "study.yaml"))
    problem = Problem(inputs.study, inputs.training, inputs.free_parameters)
    declared = refit_with_estimated_noise(minimise(problem, problem.prior_mean))
    fits = [(declared, Parts())]
    for c in inputs.library:
        if c.name in CANDIDATES:
            added = dataclasses.replace(c.free_parameter(CANDIDATES[c.name]), prior=WIDE)
            fit = minimise(declared.problem.with_parameters(added), np.append(declared.x, 0.0))
            fits.append((fit, Parts(effects=(c,))))
    grid = NoiseGrid(declared.problem.data)
    explanations = [explained(grid, fit, parts, len(CANDIDATES)) for fit, parts in fits]
    explanations.sort(key=lambda e: -e.log_posterior)
    return Loop(declared, explanations, refit_with_estimated_noise(explanations[0].fit))


def said(loop: Loop) -> dict[str, object]:
    """Results of `data_loop` as plain data."""
    fits = {name: dict(fit.values) for name, fit in (("declared", loop.declared), ("added", loop.added))}
    return fits | {"log_bayes_factors": loop.log_bayes_factors}


if __name__ == "__main__":
    events_by_name = {name: events(name) for name in APPARATUS}
    (DATA / "events.json").write_text(json.dumps(events_by_name, indent=1) + "\n", encoding="utf-8")
    (DATA / "ten_to_one.csv").write_text(tracked(), encoding="utf-8")
    (DATA / "data_loop.json").write_text(json.dumps(said(data_loop()), indent=1) + "\n", encoding="utf-8")
