"""Repeat the measurements behind the numbers of README and docs: `python -m scripts.measure NAME ...`.

Each measurement is a function of `scripts.measurements` that returns plain numbers in SI. It is stored as
`docs/data/measured/NAME.json` with the command, the day and the versions; `python -m scripts.docs_numbers` then writes the
pages' numbers from there. Without a name, the script lists the measurements; `--all` makes all except the timings, which need
an otherwise idle machine (`--timings`).
"""

from __future__ import annotations

import argparse
import datetime
import importlib
import json
import math
import platform
import time
from pathlib import Path
from typing import Any

from looping_pendulum.versions import MISSING, installed_version

FOLDER = Path(__file__).parents[1] / "docs" / "data" / "measured"
QUICK = {
    "friction_by_one_percent": "reference",
    "paper_columns": "reference",
    "constant_friction": "engines",
    "beads_creep": "engines",
    "pymunk_public_calls": "engines",
    "pymunk_defaults": "engines",
    "pybullet_cylinder": "engines",
    "spring": "engines",
    "newton_tendon": "newton",
    "falling_balls": "identification",
    "example_study": "identification",
}
"""Name of a measurement that takes a few minutes at most, on any machine -> the module of the function of that name."""
TIMINGS = {"reference_speed": "timings"}
"""Measurements of run times, to be made on an otherwise idle machine."""
MEASUREMENTS = QUICK | TIMINGS

PACKAGES = (
    "looping-pendulum",
    "numpy",
    "scipy",
    "heyoka",
    "mujoco",
    "pymunk",
    "pybullet",
    "drake",
    "pyb2d3",
    "rapier3d",
    "exudyn",
    "newton",
    "warp-lang",
)


def main() -> None:
    """Make the requested measurements."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(MEASUREMENTS))
    for group in ("all", "timings"):
        parser.add_argument(f"--{group}", action="store_true")
    options = parser.parse_args()
    names = list(options.names)
    for wanted, group in ((options.all, QUICK), (options.timings, TIMINGS)):
        names += group if wanted else []
    for name in names:
        if name not in MEASUREMENTS:
            parser.error(f"NAME: found {name!r}, needed one of {', '.join(MEASUREMENTS)}")
    if not names:
        print("\n".join(MEASUREMENTS))
    for name in dict.fromkeys(names):
        print(f"{name} ...", flush=True)
        print(f"  {measure_and_store(name)}", flush=True)


def measure_and_store(name: str) -> Path:
    """Make one measurement and store it; return the file."""
    measurement = getattr(importlib.import_module(f"scripts.measurements.{MEASUREMENTS[name]}"), name)
    started = time.process_time()
    values = measurement()
    record = {
        "command": f"python -m scripts.measure {name}",
        "measured_on": datetime.date.today().isoformat(),
        "cpu_seconds": round(time.process_time() - started),
        "machine": platform.machine(),
        "versions": {"python": platform.python_version()} | _versions(),
        "values": _rounded(values),
    }
    FOLDER.mkdir(parents=True, exist_ok=True)
    file = FOLDER / f"{name}.json"
    file.write_text(json.dumps(record, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    return file


def _versions() -> dict[str, str]:
    versions = {package: installed_version(package) for package in PACKAGES}
    return {package: version for package, version in versions.items() if version != MISSING}


def _rounded(record: Any) -> Any:
    """Round numbers to six digits, which is more than any page prints; replace one that is not finite by None."""
    if isinstance(record, dict):
        return {str(key): _rounded(value) for key, value in record.items()}
    if isinstance(record, list | tuple):
        return [_rounded(value) for value in record]
    if isinstance(record, float):
        return float(f"{record:.6g}") if math.isfinite(record) else None
    return record


if __name__ == "__main__":
    main()
