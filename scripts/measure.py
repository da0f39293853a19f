"""Measure again what README and docs say in numbers: `python -m scripts.measure NAME ...`.

Each measurement is a function of `scripts.measurements` that returns plain numbers in SI. It is stored as
`docs/data/measured/NAME.json` with the command that made it, the day, and the versions; `python -m scripts.docs_numbers` then
writes the pages' numbers from there. Without a name the measurements are listed; `--all` makes all but the timings, which want
a quiet machine (`--timings`).
"""

from __future__ import annotations

import argparse
import datetime
import importlib
import importlib.metadata
import json
import math
import platform
import time
from pathlib import Path
from typing import Any

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
    "falling_balls": "identification",
}
"""Measurement that takes some minutes at most, on any machine -> its module; its function has its name."""
TIMINGS = {"reference_speed": "timings"}
"""Those whose numbers are times, to be taken on a machine that does nothing else."""
EVERY = QUICK | TIMINGS
PACKAGES = ("looping-pendulum", "numpy", "scipy", "heyoka", "mujoco", "pymunk", "pybullet", "drake")


def main() -> None:
    """Make the measurements that were asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(EVERY))
    for group in ("all", "timings"):
        parser.add_argument(f"--{group}", action="store_true")
    options = parser.parse_args()
    names = list(options.names)
    for wanted, group in ((options.all, QUICK), (options.timings, TIMINGS)):
        names += group if wanted else []
    for name in names:
        if name not in EVERY:
            parser.error(f"NAME: found {name!r}, needed one of {', '.join(EVERY)}")
    if not names:
        print("\n".join(EVERY))
    for name in dict.fromkeys(names):
        print(f"{name} ...", flush=True)
        print(f"  {store(name)}", flush=True)


def store(name: str) -> Path:
    """Make one measurement and write it down."""
    measurement = getattr(importlib.import_module(f"scripts.measurements.{EVERY[name]}"), name)
    started = time.process_time()
    values = measurement()
    tree = {
        "command": f"python -m scripts.measure {name}",
        "measured_on": datetime.date.today().isoformat(),
        "cpu_seconds": round(time.process_time() - started),
        "machine": platform.machine(),
        "versions": {"python": platform.python_version()} | _versions(),
        "values": _rounded(values),
    }
    FOLDER.mkdir(parents=True, exist_ok=True)
    file = FOLDER / f"{name}.json"
    file.write_text(json.dumps(tree, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    return file


def _versions() -> dict[str, str]:
    found = {}
    for package in PACKAGES:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def _rounded(tree: Any) -> Any:
    """Numbers to six digits, which is more than any page prints; None for one that is not finite."""
    if isinstance(tree, dict):
        return {str(key): _rounded(value) for key, value in tree.items()}
    if isinstance(tree, list | tuple):
        return [_rounded(value) for value in tree]
    if isinstance(tree, float):
        return float(f"{tree:.6g}") if math.isfinite(tree) else None
    return tree


if __name__ == "__main__":
    main()
