"""The static capstan test of every variant, kept in research/data/static_capstan.json: *static ratio* in docs/accuracy.md.

`python -m research.static_capstan NAME ...` makes it: half a turn with the variant's own settings.
"""

import argparse
import datetime
import json
import math
from typing import Any

from looping_pendulum.engines.protocol import Engine, Profile
from looping_pendulum.engines.registry import engine_facts, label, missing_packages, select
from looping_pendulum.engines.static_capstan import measure_capstan_exponent
from looping_pendulum.errors import EngineError
from looping_pendulum.files import write_atomically
from looping_pendulum.versions import installed_version
from research import DATA

STORED = DATA / "static_capstan.json"
FRICTION, WRAP_ANGLE = 0.34, math.pi
"""Friction coefficient and wrap angle at release [rad] of the static test."""


def stored() -> list[dict[str, Any]]:
    """Return the stored measurements, one per variant."""
    rows: list[dict[str, Any]] = json.loads(STORED.read_text(encoding="utf-8")) if STORED.exists() else []
    return rows


def measure(names: list[str]) -> None:
    """Measure variants and add them to the stored measurements, each as soon as it is done; those that are there stay."""
    for engine in select(names, Profile.QUICK):
        if missing_packages(engine):
            continue
        rows = {row["variant"]: row for row in stored()} | {label(engine): _static_row(engine)}
        lines = ",\n".join(json.dumps(row) for row in sorted(rows.values(), key=lambda row: row["variant"]))
        write_atomically(STORED, f"[\n{lines}\n]\n")
        print(rows[label(engine)], flush=True)


def _static_row(engine: Engine) -> dict[str, Any]:
    """Return the measurement of a variant: exponents, or the reason why it has none, with the day and the versions."""
    packages = [package.pip for package in engine_facts(engine.name).packages.values()]
    row: dict[str, Any] = {
        "variant": label(engine),
        "day": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "versions": {package: installed_version(package) for package in packages},
        "friction": FRICTION,
    }
    try:
        point = measure_capstan_exponent(engine, friction=FRICTION, wrap_angle=WRAP_ANGLE)
    except EngineError as error:
        return row | {"wrap_angle": None, "exponent": None, "why": str(error)}
    return row | {"wrap_angle": point.wrap_angle, "exponent": point.exponent, "why": ""}


def main() -> None:
    """Make the tests that were asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="+", help="engines or variants")
    measure(parser.parse_args().names)


if __name__ == "__main__":
    main()
