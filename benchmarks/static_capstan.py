"""The static capstan test as a table: `python -m benchmarks.static_capstan pymunk mujoco:beads`.

Tension ratio against wrap angle with every engine's own settings, and over half a turn along each of its ladders.
"""

from __future__ import annotations

import argparse
import math
import time

from looping_pendulum.engines.protocol import Engine, Profile
from looping_pendulum.engines.registry import label, missing_packages, select
from looping_pendulum.engines.static_capstan import measure_capstan_exponent
from looping_pendulum.errors import EngineError

ANGLES = (90, 135, 180, 225, 270)
"""[deg], at release."""
FRICTION = 0.34


def row(engine: Engine, what: str, degrees: float) -> None:
    """Print one measurement as a row of the table."""
    started = time.process_time()
    try:
        point = measure_capstan_exponent(engine, friction=FRICTION, wrap_angle=math.radians(degrees))
    except EngineError as error:
        print(f"| {label(engine)} | {what} | {degrees:g} | {error} | | | |", flush=True)
        return
    seconds = time.process_time() - started
    angle = math.degrees(point.wrap_angle)
    exponents = f"{point.exponent:.4f} | {point.ideal:.4f} | {100 * point.error:+.2f}"
    print(f"| {label(engine)} | {what} | {angle:.1f} | {exponents} | {seconds:.1f} |", flush=True)


def benchmark(names: list[str], profile: Profile) -> None:
    """Print the table of every engine named that is installed."""
    print(f"\n## Static capstan test, mu {FRICTION:g}, {profile.value} profile\n")
    print(
        "| variant | setting | wrap angle [deg] | ln(T2/T1) | mu theta | error [%] | CPU [s] |\n|---|---|---|---|---|---|---|"
    )
    for engine in select(names, profile):
        if missing_packages(engine):
            continue
        for degrees in ANGLES:
            row(engine, "its own", degrees)
        for ladder in engine.studies().ladders:
            for value, rung in zip(ladder.values, ladder.engines, strict=True):
                row(rung, f"{ladder.setting} {value:g} {ladder.unit}".strip(), 180)
        for choice in engine.studies().choices:
            row(choice.engine, f"{choice.what}: {choice.instead}", 180)


def main() -> None:
    """Run for the engines that were asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("engines", nargs="+")
    parser.add_argument("--profile", choices=[p.value for p in Profile], default=Profile.QUICK.value)
    options = parser.parse_args()
    benchmark(options.engines, Profile(options.profile))


if __name__ == "__main__":
    main()
