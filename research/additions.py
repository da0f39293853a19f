"""Measure how much each of the adapters' additions changes: the 10:1 trial with and without it.

`python -m research.additions` writes "additions" in the engine.json of each engine (some ten minutes of one core, most of
them for PyBullet); `--only VARIANT` measures that one again and keeps the others.
"""

import argparse
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from looping_pendulum.compare.align import align
from looping_pendulum.compare.metrics import RMS_END_TIMES, rms_until
from looping_pendulum.engines.protocol import Engine, Profile
from looping_pendulum.engines.reference import Reference
from looping_pendulum.engines.registry import select
from looping_pendulum.scenarios import load
from research import rounded
from research.engine_facts import write_measured

SCENARIO, DURATION = "ten_to_one", 0.7
RMS_METRICS = ("rms_0.35s", "rms_0.7s")

Without = Callable[[Any], Engine]
"""Function of an engine variant that returns the variant without the addition."""


def changed(**changes: object) -> Without:
    """Return a function that changes a variant's settings."""

    def without(engine: Any) -> Engine:
        made: Engine = engine.with_settings(**changes)
        return made

    return without


TURNING = "what MuJoCo leaves out of a wrapped tendon (l omega^2 in its acceleration) and half a step of velocity"
POLYGON = (
    "contact coefficient and radius solved from the capstan law for the chain's corners, which feeds a little of that law in"
)
COEFFICIENT = "contact coefficient solved from the capstan law for the chain's corners, which feeds a little of that law in"

ADDITIONS: dict[str, tuple[tuple[str, Without], ...]] = {
    "mujoco:documented": ((TURNING, changed(corrections=False)),),
    "mujoco:capstan": ((TURNING, changed(corrections=False)),),
    "mujoco:frictionloss": ((TURNING, changed(corrections=False)),),
    "mujoco:beads": ((POLYGON, changed(polygon_friction=False, polygon_radius=False)),),
    "pymunk:chain": (
        (COEFFICIENT, changed(polygon_friction=False)),
        ("radius of the circle corrected for the polygon", changed(polygon_radius=False)),
    ),
    "pybullet:chain": (
        (POLYGON, changed(polygon=False)),
        ("0.4 % taken off the light mass, for a string that weighs 1 % of it", changed(mass_compensation=0.0)),
    ),
}


def measure(name: str, report: Callable[[str], None]) -> list[dict[str, Any]]:
    """Return the rows of one variant: errors with and without each of its additions."""
    scenario = replace(load(SCENARIO), duration=DURATION, tolerances=())
    reference = Reference(scenario)

    def rms_errors(engine: Engine) -> list[float] | None:
        run = engine.simulate(scenario)
        aligned = align(run, reference)
        errors = [rms_until(aligned, RMS_END_TIMES[metric]) for metric in RMS_METRICS]
        return None if not run.status.ok or None in errors else [float(x) for x in errors if x is not None]

    (engine,) = select([name], Profile.QUICK)
    ours = rms_errors(engine)
    report(f"{name}: {ours}")
    rows = []
    for what, without in ADDITIONS[name]:
        rows.append({"what": what, "errors": ours, "errors_without": rms_errors(without(engine))})
        report(f"{name}: {rows[-1]}")
    return rows


def main() -> None:
    """Measure, and write the engines' files."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", action="append", choices=list(ADDITIONS), help="variant; default: all")
    for name in parser.parse_args().only or ADDITIONS:
        write_measured(name, "additions", rounded(measure(name, print)))


if __name__ == "__main__":
    main()
