"""What each engine's rope over a rod reaches at three budgets of processor time, for docs/ropes-and-releases.md.

`python -m research.rope_budgets` adds to research/data/rope_over_a_cylinder.json what it lacks, one run after the other: the
ten-to-one trial with settings coarser than the engine study's ladders (`COARSE`), and the static capstan test with the settings
that are best at each budget. `--again` measures everything anew, `--figure` only draws the page's figure and prints the best.
"""

import argparse
import dataclasses
import json
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from looping_pendulum.compare.convergence.result import PATH_END_TIMES
from looping_pendulum.engines import registry
from looping_pendulum.engines.protocol import Engine, Profile
from looping_pendulum.engines.registry import all_engines, missing_packages, select, styles
from looping_pendulum.engines.static_capstan import measure_capstan_exponent
from looping_pendulum.errors import EngineError
from looping_pendulum.files import write_atomically
from looping_pendulum.pages.drawing import legend_below, make_figure, png
from looping_pendulum.pages.palette import GREY
from looping_pendulum.runs.events import run_landmarks
from looping_pendulum.runs.trajectory import RunStatus
from looping_pendulum.scenarios import load
from research import DATA, IMAGES, rounded, stored_study
from research.engine_study import SCENARIO
from research.stored_study import MARK, EngineStudy

STORED = DATA / "rope_over_a_cylinder.json"
BUDGETS = {"real time": 1.0, "10 times slower": 10.0, "accurate": float("inf")}
"""Budget -> CPU seconds that a simulated second may take."""
COARSE: Mapping[str, tuple[Mapping[str, Any], ...]] = {
    "mujoco:beads": (
        {
            "time_step": 5e-5,
            "bend": 0.4,
            "bead_mass_ratio": 8e-4,
            "steps_per_group": 4,
            "contact_time_constant": 2e-4,
            "string_time_constant": 2e-4,
        },
        {"time_step": 5e-5, "bead_mass_ratio": 4e-4, "steps_per_group": 4},
        {
            "time_step": 1e-4,
            "bend": 0.5,
            "bead_mass_ratio": 2e-3,
            "steps_per_group": 2,
            "contact_time_constant": 4e-4,
            "string_time_constant": 4e-4,
        },
    ),
    "pymunk:chain": (
        {"time_step": 2e-5},
        {"time_step": 4e-5, "steps_per_group": 25, "bead_mass_ratio": 8e-4},
        {"time_step": 4e-5, "steps_per_group": 25, "bend": 0.4, "bead_mass_ratio": 2e-3},
        {"time_step": 2e-5, "bend": 0.4, "bead_mass_ratio": 8e-4},
    ),
    "box2d:chain": (
        {},
        {"time_step": 5e-5, "bead_mass_ratio": 8e-4},
        {"time_step": 5e-5, "sub_steps": 2, "bead_mass_ratio": 8e-4, "bend": 0.4},
        {"time_step": 2e-5},
        {"time_step": 1e-4, "bend": 0.5, "bead_mass_ratio": 2e-3, "steps_per_group": 2},
        {"time_step": 4e-6, "bend": 0.2, "bead_mass_ratio": 1e-4},
    ),
    "drake:chain": (
        {"time_step": 1e-4, "bend": 0.5, "bead_mass_ratio": 2e-3},
        {"time_step": 5e-5, "bend": 0.5, "bead_mass_ratio": 1e-3},
    ),
    "rapier:chain": (
        {},
        {"time_step": 2e-5},
        {"time_step": 5e-5, "bead_mass_ratio": 8e-4},
        {"time_step": 5e-5, "iterations": 16, "bead_mass_ratio": 8e-4, "bend": 0.4},
        {"time_step": 1e-4, "iterations": 16, "bead_mass_ratio": 2e-3, "bend": 0.5, "steps_per_group": 2},
    ),
    "exudyn:cable": ({},),
    "pybullet:chain": ({"time_step": 1e-4, "link_length": 6e-3, "outer_link_length": 1e-2, "solver_iterations": 20},),
}
"""Variant -> changes of its quick settings, coarser than the ladders of the study or without a place there."""

STATIC_ONLY = ("newton:tendon",)
"""Variants whose run ends before the heavy mass halts, so that only the static test is measured: this at half a turn."""


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """One setting of a variant, with what the ten-to-one trial gives and costs."""

    variant: str
    settings: str
    """What differs from the variant's quick settings; empty: nothing."""
    path: float
    """Root mean square distance of the light mass from the reference until 0.7 s [m]."""
    halting_time: float | None
    """Halting time [s]; None: the heavy mass comes to no rest."""
    cpu: float
    """CPU seconds per simulated second; of a run that was not timed apart, wall seconds beside others."""


@dataclass(frozen=True, kw_only=True)
class Budgets:
    """The stored data of this benchmark."""

    runs: tuple[Candidate, ...]
    failed: tuple[tuple[str, str, str], ...]
    """Variant, settings and status of runs that did not come to 0.7 s."""
    static: Mapping[str, float | None]
    """Variant and settings -> ln(T2/T1) over mu theta, less 1; None: the test failed."""

    def to_json(self) -> str:
        """Return the text of the stored data."""
        tree = {
            "schema": {"id": "looping-pendulum/rope-over-a-cylinder", "version": 1},
            "runs": [dataclasses.asdict(run) for run in self.runs],
            "failed": self.failed,
            "static": dict(sorted(self.static.items())),
        }
        return json.dumps(rounded(tree, 6), indent=1) + "\n"


def read(text: str) -> Budgets:
    """Read `Budgets.to_json`'s text back."""
    tree = json.loads(text)
    runs = tuple(Candidate(**run) for run in tree["runs"])
    return Budgets(runs=runs, failed=tuple(map(tuple, tree["failed"])), static=tree["static"])


def label(variant: str, settings: str) -> str:
    """Return the key of `Budgets.static`."""
    return f"{variant} {settings}".rstrip()


def describe(changes: Mapping[str, Any]) -> str:
    """Return changed settings as text."""
    return ", ".join(f"{name} {value:g}" for name, value in changes.items())


def candidates(study: EngineStudy, budgets: Budgets) -> dict[str, list[Candidate]]:
    """Return variant -> all its settings whose path is known, of the study and of this benchmark.

    Without the reference, and without the variants that show an engine's defaults.
    """
    result = study.convergence
    timed = {point.key: point.cpu for point in study.pareto}
    rows: dict[str, list[Candidate]] = {}
    for v in result.variants:
        every = [("", v.own), *((f"{ladder.setting} {r.value:g}", r.run) for ladder in v.ladders for r in ladder.rungs)]
        if v.engine == "reference" or v.variant == "defaults":
            continue
        for settings, run in every:
            path, took = run.errors[MARK], result.clock.run_times.get(run.key)
            cost = timed.get(run.key, took / PATH_END_TIMES[MARK] if took else None)
            if run.ok and path is not None and cost is not None:
                rows.setdefault(v.label, []).append(
                    Candidate(variant=v.label, settings=settings, path=path, halting_time=run.halting_time, cpu=cost)
                )
    for run in budgets.runs:
        rows.setdefault(run.variant, []).append(run)
    return rows


def best(rows: list[Candidate], budget: float) -> Candidate | None:
    """Return the setting with the smallest error of those that halt within the budget, or None."""
    affordable = [row for row in rows if row.cpu <= budget and row.halting_time is not None]
    return min(affordable, key=lambda row: row.path, default=None)


def figure(rows: Mapping[str, list[Candidate]]) -> Figure:
    """Draw the error of every setting against its cost."""
    picture, (axes,) = make_figure(8.4, 6.2)
    look = styles(rows)
    for variant in sorted(rows):
        mine = [row for row in rows[variant] if row.halting_time is not None]
        if not mine:
            continue
        style = look[variant]
        axes.plot(
            [row.cpu for row in mine], [1e3 * row.path for row in mine], style.marker, ms=4, color=style.colour, alpha=0.35
        )
        chosen = sorted({row for budget in BUDGETS.values() if (row := best(rows[variant], budget))}, key=lambda row: row.cpu)
        xy = [row.cpu for row in chosen], [1e3 * row.path for row in chosen]
        axes.plot(*xy, "-", marker=style.marker, ms=8, lw=1.2, color=style.colour, label=variant)
    for name, budget in list(BUDGETS.items())[:2]:
        axes.axvline(budget, color=GREY, lw=0.9, dashes=(1, 2))
        beside = {"ha": "right", "va": "top", "rotation": 90, "color": GREY, "fontsize": 8}
        axes.annotate(name, (budget, 1), (-3, -3), xycoords=("data", "axes fraction"), textcoords="offset points", **beside)
    axes.set(xscale="log", yscale="log", xlabel="CPU seconds per simulated second", ylabel="RMS of the path to 0.7 s [mm]")
    axes.set_title("Error against cost: large marks are the best settings at each budget")
    legend_below(picture)
    return picture


def main() -> None:
    """Measure what the stored data lack, and store it after every run; then draw the figure and print the best settings."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--again", action="store_true", help="measure everything anew")
    parser.add_argument("--figure", action="store_true", help="measure nothing")
    options = parser.parse_args()
    stored = STORED.exists() and not options.again
    known = read(STORED.read_text(encoding="utf-8")) if stored else Budgets(runs=(), failed=(), static={})
    study = stored_study.read(stored_study.SUMMARY.read_text(encoding="utf-8"))
    budgets = known
    for budgets in () if options.figure else measured(study, known):
        write_atomically(STORED, budgets.to_json())
    rows = candidates(study, budgets)
    write_atomically(IMAGES / "rope-over-a-cylinder.png", png(figure(rows)))
    for variant in sorted(rows):
        for name, budget in BUDGETS.items():
            print(variant, name, best(rows[variant], budget), sep="; ")


def measured(study: EngineStudy, budgets: Budgets) -> Iterator[Budgets]:
    """Yield the data after each measurement."""
    scenario = dataclasses.replace(load(SCENARIO), duration=PATH_END_TIMES[MARK])
    exact = select(["reference"], Profile.QUICK)[0].simulate(scenario)
    # Newton has an environment of its own, in which others may be missing
    installed = {registry.label(one) for one in all_engines(Profile.QUICK) if not missing_packages(one)}
    done = {(row.variant, row.settings) for row in budgets.runs} | {row[:2] for row in budgets.failed}
    for variant, changes in ((variant, changes) for variant, rows in COARSE.items() for changes in rows):
        settings = describe(changes)
        if (variant, settings) in done or variant not in installed:
            continue
        engine: Any = select([variant], Profile.QUICK)[0]
        began = time.process_time()
        run = engine.with_settings(**changes).simulate(scenario)
        cpu = (time.process_time() - began) / float(run.t[-1])
        if run.status is not RunStatus.FINISHED:
            budgets = dataclasses.replace(budgets, failed=(*budgets.failed, (variant, settings, run.status.name)))
        else:
            path = float(np.sqrt(np.mean(np.sum((run.light_position - exact.light_position) ** 2, axis=1))))
            halt = run_landmarks(run, scenario.parameters).halting_time
            row = Candidate(variant=variant, settings=settings, path=path, halting_time=halt, cpu=cpu)
            budgets = dataclasses.replace(budgets, runs=(*budgets.runs, row))
        yield budgets
    for variant in STATIC_ONLY:
        if variant in installed and variant not in budgets.static:
            error = measure_capstan_exponent(select([variant], Profile.QUICK)[0]).error
            budgets = dataclasses.replace(budgets, static={**budgets.static, variant: error})
            yield budgets
    for variant, rows in candidates(study, budgets).items():
        if variant not in installed:
            continue
        for row in {best(rows, budget) for budget in BUDGETS.values()} - {None}:
            assert row is not None
            name = label(row.variant, row.settings)
            if name not in budgets.static:
                budgets = dataclasses.replace(budgets, static={**budgets.static, name: static_error(row)})
                yield budgets


def static_error(row: Candidate) -> float | None:
    """Return the error of the static capstan test with the settings of ``row``; None if the test failed."""
    try:
        return measure_capstan_exponent(_engine(row)).error
    except EngineError as error:
        print(error, file=sys.stderr)
        return None


def _engine(row: Candidate) -> Engine:
    """Return the variant with the settings of ``row``: its own, a rung of its ladders, or one of `COARSE`."""
    engine: Any = select([row.variant], Profile.QUICK)[0]
    rungs = {
        f"{ladder.setting} {value:g}": engine.with_settings(**changes)
        for ladder in engine.studies().ladders
        for value, changes in zip(ladder.values, ladder.changes, strict=True)
    }
    coarse = {describe(changes): engine.with_settings(**changes) for changes in COARSE.get(row.variant, ())}
    found: Engine = {"": engine, **rungs, **coarse}[row.settings]
    return found


if __name__ == "__main__":
    main()
