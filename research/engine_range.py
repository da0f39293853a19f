"""Measure every variant's accuracy over random scenarios, so that each can say where its shipped accuracy holds.

`python -m research.engine_range --work DIR` runs the main variants on `SCENARIOS` seeded random scenarios (half an hour of a
quiet core with the quick profile; ended runs are kept in DIR, so it goes on where it was), stores the result as
research/data/engine_range.json and, from that, what each engine says of itself: "measured" in its engine.json.
`--only ENGINE` and `--sample N` measure a part again, `--profile accurate` the other profile, `--summary` only writes the
engines' files again.
"""

import argparse
import dataclasses
import json
import math
import threading
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from looping_pendulum.cli.terminal import ProgressBars
from looping_pendulum.compare.align import align
from looping_pendulum.compare.comparison import compare
from looping_pendulum.compare.json_text import plain
from looping_pendulum.compare.metrics import END_TIME_TOLERANCE, RMS_END_TIMES
from looping_pendulum.compare.run_cache import RunTask, make_runs, run_key
from looping_pendulum.engines.facts import (
    QUANTITIES,
    VALIDATED_METRICS,
    ErrorDistribution,
    ValidatedRange,
)
from looping_pendulum.engines.protocol import STATIC_FRICTION, Engine, Profile
from looping_pendulum.engines.reference import Reference
from looping_pendulum.engines.registry import label, select
from looping_pendulum.files import write_atomically
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.runs.trajectory import Trajectory
from looping_pendulum.scenarios.scenario import Scenario
from research import DATA, rounded
from research.engine_facts import write_measured

MEASURED = DATA / "engine_range.json"
COMMAND = "python -m research.engine_range"
SEED = 20261122
SCENARIOS = 48
"""Enough that nine tenths of them are 43; every eighth is a vertical release, every sixth has static above kinetic friction."""
DURATION = 0.7
"""Simulated time of each run [s]; a vertical release is cut earlier, before the light mass meets the rod."""
MAIN = ("mujoco:documented", "mujoco:capstan", "mujoco:beads", "pymunk:chain", "pybullet:chain")


def scenarios(count: int = SCENARIOS) -> list[Scenario]:
    """Return the first ``count`` random scenarios; a longer list begins with the shorter one."""
    generator = np.random.default_rng(SEED)
    return [_scenario(i, generator) for i in range(count)]


def _scenario(i: int, generator: np.random.Generator) -> Scenario:
    def even(low: float, high: float) -> float:
        return float(generator.uniform(low, high))

    def even_ratio(low: float, high: float) -> float:
        return math.exp(even(math.log(low), math.log(high)))

    light_mass, ratio = even_ratio(5e-3, 5e-2), even_ratio(1.5, 20.0)
    free_length, rod_radius = even(0.3, 0.8), even_ratio(3e-3, 15e-3)
    angle, friction, excess = math.radians(even(60, 130)), even(0.1, 0.6), even(1.1, 1.6)
    # From no drag (a quarter of them) to forces that take a tenth of the speed on one free length.
    drag = 0.0 if generator.random() < 0.25 else even_ratio(1e-3, 0.1)
    heavy_drag, string_drag = drag * even(0.1, 1.0), drag * even(0.1, 1.0)
    static = friction * (excess if i % 6 == 5 else 1.0)
    vertical = i % 8 == 7
    parameters = Parameters(
        light_mass=light_mass,
        heavy_mass=ratio * light_mass,
        rod_radius=rod_radius,
        free_length=free_length,
        release_angle=angle,
        hanging_length=0.03,
        release=Release.VERTICAL if vertical else Release.LOOPING,
        coefficients={
            "kinetic_friction": friction,
            "static_friction": static,
            "light_drag": drag * light_mass / free_length,
            "heavy_drag": heavy_drag * ratio * light_mass / free_length,
            "string_drag": string_drag * light_mass / free_length**2,
        },
    )
    # A light mass that is pulled up meets the rod before long: watch it over half of its way.
    duration = DURATION if not vertical else min(DURATION, _time_to_rise(parameters, 0.5 * free_length))
    return Scenario(name=f"random_{i}", title="", description="", parameters=parameters, duration=duration)


def _time_to_rise(p: Parameters, way: float) -> float:
    """Return the time [s], in whole samples, in which a vertical release without drag rises by ``way``; at most `DURATION`."""
    exponent = p.coefficients["kinetic_friction"] * math.pi
    pull = p.heavy_mass - p.light_mass * math.exp(exponent)
    if pull <= 0:
        return DURATION
    acceleration = p.coefficients["gravity"] * pull / (p.heavy_mass + p.light_mass * math.exp(exponent))
    return max(round(1e3 * math.sqrt(2 * way / acceleration)), 50) * 1e-3


def row(run: Trajectory, scenario: Scenario, reference: Reference) -> dict[str, Any]:
    """Return the stored row of one run."""
    aligned = align(run, reference)
    known = np.isfinite(aligned.distance)
    result = compare(scenario, reference, [run]).engines[0]
    heavy = np.abs(aligned.heavy_deviation[np.isfinite(aligned.heavy_deviation)])
    return {
        "scenario": scenario.name,
        "status": run.status.name,
        "end_time": float(run.t[-1]) if len(run.t) else None,
        **{
            name: _rms(aligned.distance, known & (aligned.t <= RMS_END_TIMES[name] + END_TIME_TOLERANCE))
            for name in VALIDATED_METRICS
            if name in RMS_END_TIMES
        },
        "heavy_position": float(heavy.max()) if len(heavy) else None,
        "halting_time_error": result.metrics["halting_time_error"],
        "acceleration_error": result.metrics["acceleration_error"],
        "wall_per_s": run.wall_time / run.t[-1] if len(run.t) > 1 and math.isfinite(run.wall_time) else None,
    }


def _rms(distance: Any, chosen: Any) -> float | None:
    return float(np.sqrt(np.mean(distance[chosen] ** 2))) if chosen.any() else None


def measure(chosen: Sequence[Engine], sample: Sequence[Scenario], work: Path, jobs: int, time_limit: float) -> dict[str, Any]:
    """Make the runs that are not cached in ``work``; return the rows of each variant's profile."""
    tasks = [
        RunTask(key=run_key(engine, scenario), engine=engine, scenario=scenario, what=f"{label(engine)} {scenario.name}")
        for engine in chosen
        for scenario in sample
        if not engine.abilities.unsupported(scenario.parameters)
        and STATIC_FRICTION not in engine.abilities.lacks(scenario.parameters)  # declared missing: no accuracy to measure
    ]
    with ProgressBars(time_left=True) as bars:
        done = make_runs(tasks, work, jobs=jobs, time_limit=time_limit, progress=bars.update, cancelled=threading.Event())
    references = {scenario.name: Reference(scenario) for scenario in sample}
    measured: dict[str, Any] = {}
    for task in tasks:
        run = done.get(task.key)
        if run is None:
            continue
        rows = measured.setdefault(label(task.engine), {}).setdefault(task.engine.profile.value, {})
        rows[task.scenario.name] = row(run, task.scenario, references[task.scenario.name])
    return measured


def merged(stored: dict[str, Any], measured: dict[str, Any]) -> dict[str, Any]:
    """Return the ``stored`` rows, replaced by ``measured`` ones where there are any."""
    runs = dict(stored)
    for name, profiles in measured.items():
        runs[name] = dict(runs.get(name, {}))
        for profile, rows in profiles.items():
            runs[name][profile] = runs[name].get(profile, {}) | rows
    return runs


def summary(runs: dict[str, Any], sample: dict[str, Parameters]) -> dict[str, list[dict[str, Any]]]:
    """Return the range and the accuracy of each variant's profiles, as the package publishes them."""
    return {
        name: [
            dataclasses.asdict(validated(profile, list(rows.values()), sample)) for profile, rows in sorted(profiles.items())
        ]
        for name, profiles in sorted(runs.items())
    }


def validated(profile: str, rows: list[dict[str, Any]], sample: dict[str, Parameters]) -> ValidatedRange:
    """Return range and accuracy of one profile from its stored rows."""
    ended = [r for r in rows if r["status"] in ("FINISHED", "LIGHT_REACHED_ROD")]
    inside = [sample[r["scenario"]] for r in ended]
    bounds = {}
    for quantity in QUANTITIES:
        values = [value for p in inside if (value := quantity.of(p)) is not None]
        if values:
            bounds[quantity.name] = (min(values), max(values))
    errors = {name: spread([r[name] for r in ended]) for name in VALIDATED_METRICS}
    return ValidatedRange(
        profile=profile,
        scenarios=len(rows),
        failed=len(rows) - len(ended),
        releases=tuple(sorted({p.release for p in inside})),
        bounds=bounds,
        errors={name: each for name, each in errors.items() if each is not None},
    )


def spread(values: Iterable[float | None]) -> ErrorDistribution | None:
    """Return median, 90 % quantile and maximum of the magnitudes that are known."""
    known = sorted(abs(value) for value in values if value is not None)
    if not known:
        return None
    median, ninety = np.quantile(known, (0.5, 0.9), method="higher")
    return ErrorDistribution(count=len(known), median=float(median), ninety=float(ninety), worst=known[-1])


def stored() -> dict[str, Any]:
    """Return the rows measured before: variant -> profile -> scenario -> row."""
    if not MEASURED.exists():
        return {}
    runs: dict[str, Any] = json.loads(MEASURED.read_text(encoding="utf-8"))["runs"]
    return runs


def write(runs: dict[str, Any]) -> None:
    """Write the stored rows and what each engine says of itself."""
    sample = scenarios()
    tree = {
        "schema": {"id": "looping-pendulum/engine-range", "version": 1},
        "seed": SEED,
        "scenarios": {s.name: {**plain(_short(s.parameters)), "duration": s.duration} for s in sample},
        "runs": runs,
    }
    text = json.dumps(rounded(tree), separators=(",", ":")).replace('"random_', '\n"random_') + "\n"
    write_atomically(MEASURED, text)
    write_summary()


def write_summary() -> None:
    """Write what the stored runs say of each variant into its engine's facts."""
    for name, ranges in rounded(summary(stored(), {s.name: s.parameters for s in scenarios()})).items():
        write_measured(name, "measured", ranges)


def _short(p: Parameters) -> dict[str, Any]:
    """Return the parameters with only those coefficients that the scenarios vary."""
    tree = p.as_dict()
    named = ("kinetic_friction", "static_friction", "light_drag", "heavy_drag", "string_drag")
    return tree | {"coefficients": {name: p.coefficients[name] for name in named}}


def main() -> None:
    """Make the runs and write what they found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, help="folder where runs are kept")
    parser.add_argument("--only", action="append", help="engine or variant; default: the main variants")
    parser.add_argument("--sample", type=int, default=SCENARIOS, help=f"how many of the {SCENARIOS} scenarios, from the first")
    parser.add_argument("--profile", type=Profile, default=Profile.QUICK, choices=list(Profile))
    parser.add_argument("--jobs", type=int, default=1, help="number of runs at the same time")
    parser.add_argument("--time-limit", type=float, default=1200.0, help="limit on the wall time of one run [s]")
    parser.add_argument("--summary", action="store_true", help="only write the engines' files again from the stored rows")
    options = parser.parse_args()
    if options.summary:
        write_summary()
        return
    if options.work is None:
        parser.error("--work: needed a folder, or --summary")
    chosen = select(options.only or MAIN, options.profile)
    ranges = measure(chosen, scenarios()[: options.sample], options.work, options.jobs, options.time_limit)
    write(merged(stored(), ranges))
    for name, profiles in ranges.items():
        for profile, rows in profiles.items():
            parameters = {s.name: s.parameters for s in scenarios()}
            print(name, profile, dataclasses.asdict(validated(profile, list(rows.values()), parameters))["errors"])


if __name__ == "__main__":
    main()
