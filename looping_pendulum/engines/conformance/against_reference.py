"""Checks against the reference: whole runs, what refining an engine changes, and every effect that it says it takes."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from looping_pendulum.engines.conformance.apparatus import (
    NEEDS,
    ROUGH,
    SMOOTH,
    SMOOTH_DURATION,
    Check,
    Needs,
    needs,
    rough_run,
    scenario,
    smooth_run,
    undisturbed_run,
)
from looping_pendulum.engines.protocol import Engine
from looping_pendulum.engines.studies import Ladder
from looping_pendulum.engines.trajectory import Trajectory
from looping_pendulum.reference_ode.effects import EFFECTS
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solve import solve_at

TOLERANCE = 1e-10
"""Of the reference's step."""
MARGIN = 0.1
"""Time by which the reference runs on after the last sample [s], so that it has that sample."""

SHARE_OF_THE_WAY = 0.01
"""By which either mass may be off, of the way that it has gone. The reference itself moves by that much if a mass or the
friction changes by 1 to 3 %."""
RIPPLE = 5e-4
"""In addition [m]: a chain's nodes reach and leave the rod one by one."""

SAFETY = 3.0
"""Roache's factor on an error that two rungs of a ladder tell."""
RESOLVED = 1e-5
"""Errors up to this are not looked at, however little refining changes [m]: a tenth of what a camera resolves."""

EFFECT_TOLERANCE = 0.1
"""Share of an effect's displacement by which an engine may miss it: a wrong sign, axis, mass or factor of 2 misses by half.

The engine's own error, which is there with and without the effect, drops out of the difference.
"""
LEAST_DISPLACEMENT = 5e-4
"""[m] By which an effect moves a mass in its check, so that there is something to miss."""


_known: deque[tuple[Parameters, Array, Array]] = deque(maxlen=64)
"""Apparatus, times and positions of the reference's last runs: every engine is held against the same few."""


def reference_positions(p: Parameters, t: Array) -> Array:
    """Light x, light y and heavy y of the reference at times ``t`` [s], shape (n, 3) [m]; fewer if its run ends sooner."""
    for known, times, places in _known:
        if np.array_equal(times, t) and known == p:
            return places
    run = solve_at(p, t, duration=float(t[-1]) + MARGIN, tolerance=TOLERANCE, integrator="scipy")
    places = np.column_stack([run.light_position, run.heavy_position[:, 1]])
    places.flags.writeable = False  # whoever asks next gets the same array
    _known.append((p, t.copy(), places))
    return places


def positions(run: Trajectory) -> Array:
    """Light x, light y and heavy y, shape (n, 3) [m]."""
    return np.column_stack([run.light_position, run.heavy_position[:, 1]])


@needs(SMOOTH)
def follows_the_reference_without_losses(engine: Engine) -> None:
    """Both masses are where the reference has them, within `SHARE_OF_THE_WAY` and `RIPPLE`."""
    _follows(smooth_run(engine), SMOOTH)


@needs(ROUGH)
def follows_the_reference_past_the_halt_and_a_full_turn(engine: Engine) -> None:
    """The same with friction and drag, to where the heavy mass has long halted and the string lies on itself."""
    _follows(rough_run(engine), ROUGH)


def _follows(run: Trajectory, p: Parameters) -> None:
    exact = reference_positions(p, run.t)
    found = positions(run)[: len(exact)]
    for mass, part in (("light", slice(0, 2)), ("heavy", slice(2, 3))):
        off = np.linalg.norm(found[:, part] - exact[:, part], axis=1)
        steps = np.linalg.norm(np.diff(exact[:, part], axis=0), axis=1)
        bound = RIPPLE + SHARE_OF_THE_WAY * np.concatenate([[0.0], np.cumsum(steps)])
        i = int(np.argmax(off - bound))
        assert off[i] <= bound[i], f"{mass} mass {1e3 * off[i]:.2f} mm off at {run.t[i]:.3f} s, needed {1e3 * bound[i]:.2f} mm"


def errs_no_more_than_refining_it_changes(engine: Engine) -> None:
    """What an engine's ladders (`studies()`) say of its error covers its distance from the reference.

    The change from the variant's own value to the next finer one tells the error of a first-order method (of a higher order it
    is less); ladders are taken to act independently, so their errors add up.
    """
    run = smooth_run(engine)
    own = positions(run)
    error = np.zeros(len(own))
    for ladder in usable_ladders(engine):
        ratio, beside = _neighbour(engine, ladder)
        other = positions(beside.simulate(scenario(SMOOTH, SMOOTH_DURATION)))
        assert len(other) == len(own), f"{ladder.setting}: a rung's run ends at {1e-3 * len(other):.3f} s"
        change = np.linalg.norm(other - own, axis=1)
        error += change / abs(1 - ratio)
    off = np.linalg.norm(own - reference_positions(SMOOTH, run.t), axis=1)
    bound = RESOLVED + SAFETY * np.maximum.accumulate(error)
    i = int(np.argmax(off / bound))
    assert off[i] <= bound[i], f"{1e3 * off[i]:.4f} mm off at {run.t[i]:.3f} s, where refining says {1e3 * bound[i]:.4f} mm"


NEEDS[errs_no_more_than_refining_it_changes] = Needs(parameters=(SMOOTH,), ladders=True)


def usable_ladders(engine: Engine) -> list[Ladder]:
    """Ladders of two rungs or more whose setting the engine has a positive number for."""
    return [ladder for ladder in engine.studies().ladders if len(ladder.values) > 1 and _own_value(engine, ladder) > 0]


def _own_value(engine: Engine, ladder: Ladder) -> float:
    value = getattr(engine.settings, ladder.setting, None)
    return float(value) if isinstance(value, (int, float)) else math.nan


def _neighbour(engine: Engine, ladder: Ladder) -> tuple[float, Engine]:
    """Size of a rung beside the variant's own, over the own size, and its engine: the next finer, or the next coarser."""
    grows = ladder.values[-1] > ladder.values[0]
    own = _own_value(engine, ladder)
    ratios = [own / value if grows else value / own for value in ladder.values]
    finer = [i for i, ratio in enumerate(ratios) if ratio < 1 - 1e-9]
    coarser = [i for i, ratio in enumerate(ratios) if ratio > 1 + 1e-9]
    i = finer[0] if finer else coarser[-1]
    return ratios[i], ladder.engines[i]


@dataclass(frozen=True, kw_only=True)
class EffectCase:
    """How one effect is made to show: two runs that differ in its coefficients alone."""

    coefficients: Mapping[str, float]
    beside: Mapping[str, float] = field(default_factory=dict)
    """Coefficients that both runs have."""
    base: Parameters = SMOOTH
    duration: float = 0.06
    """[s]"""

    @property
    def without(self) -> Parameters:
        """Apparatus without the effect."""
        return self.base.replace(**self.beside)

    @property
    def acting(self) -> Parameters:
        """Apparatus with the effect."""
        return self.base.replace(**self.beside, **self.coefficients)


RUBBING: Mapping[str, float] = {"kinetic_friction": 0.2}
SECOND_TURN = SMOOTH.replace(heavy_mass=0.04, release_angle=math.radians(60), kinetic_friction=0.05)
"""The string lies on itself from 0.334 s on, and slides there."""

EFFECT_CASES: dict[str, EffectCase] = {
    "light_drag": EffectCase(coefficients={"light_drag": 0.5}),
    "heavy_drag": EffectCase(coefficients={"heavy_drag": 1.0}),
    "string_drag": EffectCase(coefficients={"string_drag": 1.0}),
    "light_linear_drag": EffectCase(coefficients={"light_linear_drag": 0.2}),
    "heavy_linear_drag": EffectCase(coefficients={"heavy_linear_drag": 1.0}),
    "attitude_drag": EffectCase(coefficients={"attitude_drag": 20.0}, beside={"light_drag": 0.1}),
    "wind": EffectCase(coefficients={"wind_speed": -4.0}, beside={"light_drag": 0.02}),
    "side_force": EffectCase(coefficients={"side_force": 0.05}),
    "side_stiffness": EffectCase(coefficients={"side_stiffness": 0.2}),
    "push_across": EffectCase(coefficients={"push_across": 0.5}),
    "push_along": EffectCase(coefficients={"push_along": 0.5}),
    "friction_per_speed": EffectCase(coefficients={"friction_per_speed": 1.0}, beside=RUBBING, duration=0.1),
    "friction_per_wrap": EffectCase(coefficients={"friction_per_wrap": 0.3}, beside=RUBBING, duration=0.1),
    "string_on_string": EffectCase(coefficients={"string_on_string": 0.3}, base=SECOND_TURN, duration=0.45),
    "string_mass": EffectCase(coefficients={"string_density": 0.01}, duration=0.1),
    "string_thickness": EffectCase(coefficients={"string_thickness": 0.004}, base=SECOND_TURN, duration=0.45),
    "heavy_swing": EffectCase(coefficients={"heavy_swing": 0.5}, duration=0.1),
    "out_of_plane": EffectCase(coefficients={"push_sideways": 2.0}, duration=0.1),
    "turning_rod": EffectCase(coefficients={"rod_mobility": 1e3}, beside=RUBBING, duration=0.1),
    "string_stretch": EffectCase(coefficients={"string_compliance": 0.01, "string_loss_time": 0.005}, duration=0.1),
}
"""Effect -> how it shows. Gravity and the capstan law are in every other check; a closure is found from data, never typed."""


def _effect_check(name: str, case: EffectCase) -> Check:
    def check(engine: Engine) -> None:
        expected, found = displacement(engine, case)
        size = float(np.linalg.norm(expected))
        off = float(np.linalg.norm(found - expected))
        moved, needed = (", ".join(f"{1e3 * value:.2f}" for value in each) for each in (found, expected))
        assert off <= EFFECT_TOLERANCE * size, f"it moves light x, light y and heavy y by {moved} mm, needed {needed} mm"

    check.__name__ = check.__qualname__ = f"{name}_acts_as_in_the_reference"
    check.__doc__ = f"{EFFECTS[name].formula}: it moves the masses as in the reference."
    NEEDS[check] = Needs(parameters=(case.acting, case.without))
    return check


def displacement(engine: Engine, case: EffectCase) -> tuple[Array, Array]:
    """How far an effect moves light x, light y and heavy y by the end of its case: in the reference and in ``engine`` [m]."""
    runs = [engine.simulate(scenario(case.acting, case.duration)), undisturbed_run(engine, case.without, case.duration)]
    for run in runs:
        assert len(run.t) > 1, f"a run of {len(run.t)} samples"
    end = min(float(run.t[-1]) for run in runs)
    found = [positions(run)[int(np.searchsorted(run.t, end - 1e-9))] for run in runs]
    exact = [reference_positions(p, np.array([end]))[-1] for p in (case.acting, case.without)]
    return exact[0] - exact[1], found[0] - found[1]


EFFECT_CHECKS: dict[str, Check] = {name: _effect_check(name, case) for name, case in EFFECT_CASES.items()}
"""Effect -> its check."""
