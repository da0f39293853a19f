"""The static capstan test as a table: `python -m benchmarks.static_capstan pymunk mujoco:beads`.

Tension ratio against wrap angle with every engine's own settings, and over half a turn along each of its ladders. With
`--store`, only half a turn with each variant's own settings, kept in docs/data/static_capstan.json for the leaderboard.
"""

from __future__ import annotations

import argparse
import datetime
import json
import math
import time
from pathlib import Path
from typing import Any

from looping_pendulum.engines.protocol import Engine, Profile
from looping_pendulum.engines.registry import DISTRIBUTIONS, label, missing_packages, select
from looping_pendulum.engines.tension import measure_capstan_exponent
from looping_pendulum.errors import EngineError
from looping_pendulum.files import write_atomically
from looping_pendulum.versions import installed_version

ANGLES = (90, 135, 180, 225, 270)
"""[deg], at release."""
FRICTION = 0.34
HALF_TURN = 180
"""[deg], at release; the wrap angle of the ladders and of the stored measurements."""
STORED = Path(__file__).parents[1] / "docs" / "data" / "static_capstan.json"


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
                row(rung, f"{ladder.setting} {value:g} {ladder.unit}".strip(), HALF_TURN)
        for choice in engine.studies().choices:
            row(choice.engine, f"{choice.what}: {choice.instead}", HALF_TURN)


def store(names: list[str]) -> None:
    """Measure variants and add them to the stored measurements, each as soon as it is done; those that are there stay."""
    for engine in select(names, Profile.QUICK):
        if missing_packages(engine):
            continue
        rows = {row["variant"]: row for row in stored()} | {label(engine): measured(engine)}
        lines = ",\n".join(json.dumps(row) for row in sorted(rows.values(), key=lambda row: row["variant"]))
        write_atomically(STORED, f"[\n{lines}\n]\n")
        print(rows[label(engine)], flush=True)


def stored() -> list[dict[str, Any]]:
    """Return the stored measurements, one per variant."""
    rows: list[dict[str, Any]] = json.loads(STORED.read_text(encoding="utf-8")) if STORED.exists() else []
    return rows


def measured(engine: Engine) -> dict[str, Any]:
    """Return the measurement of a variant: exponents, or the reason why it has none, with the day and the versions."""
    packages = [DISTRIBUTIONS.get(package, package) for package in engine.abilities.packages]
    row: dict[str, Any] = {
        "variant": label(engine),
        "day": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "versions": {package: installed_version(package) for package in packages},
        "friction": FRICTION,
    }
    try:
        point = measure_capstan_exponent(engine, friction=FRICTION, wrap_angle=math.radians(HALF_TURN))
    except EngineError as error:
        return row | {"wrap_angle": None, "exponent": None, "why": str(error)}
    return row | {"wrap_angle": point.wrap_angle, "exponent": point.exponent, "why": ""}


def main() -> None:
    """Run for the engines that were asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("engines", nargs="+")
    parser.add_argument("--profile", choices=[p.value for p in Profile], default=Profile.QUICK.value)
    parser.add_argument("--store", action="store_true", help="measure half a turn and keep it in docs/data")
    options = parser.parse_args()
    if options.store:
        store(options.engines)
        return
    benchmark(options.engines, Profile(options.profile))


if __name__ == "__main__":
    main()
