"""Shared by the modules of this folder: paths, the apparatus of each case, and reading and writing of summaries."""

import json
import math
from typing import Any

import numpy as np

import research
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.scenarios.loader import load

DATA = research.DATA / "answers"
PAGE = research.FOLDER / "answers.md"

LIGHT_MASS, HEAVY_MASS = 0.0152, 0.038
"""The paper's masses of its example with M2/M1 = 2.5 [kg]."""
PAPER_ANGLES = (75.0, 75.1, 75.2, 75.3)
"""Release angles of the paper's example [deg]."""
DURATION = 10.0
"""Limit on the simulated time of a run [s]."""
CASES = {
    "scenario": ("two_and_a_half_to_one", "the scenario `two_and_a_half_to_one` (friction 0.3, drag 1e-3 kg/m)"),
    "as_2_to_1": ("two_to_one", "friction, drag and string as inferred for the paper's 2:1 trial"),
    "as_10_to_1": ("ten_to_one", "friction, drag and string as inferred for the paper's 10:1 trial"),
}
"""Case -> (scenario whose friction, drag and lengths it uses, description); the masses are the paper's for M2/M1 = 2.5."""
MODE_LETTERS = "SDULCcFER"
"""Letters of the values of `Mode`, in their order: S sticks, D slides down, U slides up, L slack, E end, ..."""


def case(name: str) -> Parameters:
    """Return the apparatus of a case, with the masses of the paper's example."""
    return load(CASES[name][0]).parameters.replace(light_mass=LIGHT_MASS, heavy_mass=HEAVY_MASS)


def at_angle(parameters: Parameters, degrees: float) -> Parameters:
    """Return the same apparatus with another release angle [deg]."""
    return parameters.replace(release_angle=math.radians(degrees))


def letters(modes: tuple[int, ...]) -> str:
    """Return a sequence of modes as one letter per mode."""
    return "".join(MODE_LETTERS[mode] for mode in modes)


def write(name: str, summary: dict[str, Any]) -> None:
    """Write a summary to `DATA`; equal numbers give equal bytes."""
    DATA.mkdir(parents=True, exist_ok=True)
    (DATA / f"{name}.json").write_text(json.dumps(_plain(summary), indent=1, sort_keys=True, allow_nan=False) + "\n")


def read(name: str) -> dict[str, Any]:
    """Read a summary from `DATA`."""
    summary: dict[str, Any] = json.loads((DATA / f"{name}.json").read_text())
    return summary


def _plain(x: Any) -> Any:
    """Convert NumPy numbers to Python's, and NaN or infinity to None."""
    if isinstance(x, dict):
        return {str(k): _plain(v) for k, v in x.items()}
    if isinstance(x, list | tuple | np.ndarray):
        return [_plain(v) for v in x]
    if isinstance(x, np.bool_ | bool):
        return bool(x)
    if isinstance(x, np.integer):
        return int(x)
    if isinstance(x, float | np.floating):
        return float(x) if math.isfinite(x) else None
    return x


def rounded(x: Any, digits: int = 6) -> Any:
    """Round to this many significant digits, which keeps the summaries small; None stands for a number that is not finite."""
    return [None if v is None or not math.isfinite(v) else float(f"{v:.{digits}g}") for v in np.asarray(x, dtype=float).ravel()]


NO_TIME = np.uint16(65535)
"""Value in a stored map of a run without halting time."""
TIME_UNIT = 1e-4
"""Unit of a stored map's halting times [s]."""


def write_map(name: str, **arrays: np.ndarray) -> None:
    """Write a map's arrays, compressed; `halting_time` [s] is stored in whole units of `TIME_UNIT`."""
    times = arrays["halting_time"]
    whole = np.where(np.isfinite(times), np.round(np.nan_to_num(times) / TIME_UNIT), NO_TIME).astype(np.uint16)
    DATA.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(DATA / f"{name}.npz", **(arrays | {"halting_time": whole}))


def read_map(name: str) -> dict[str, np.ndarray]:
    """Read a map's arrays; halting times are in seconds, NaN for a run that does not halt."""
    with np.load(DATA / f"{name}.npz") as stored:
        arrays = dict(stored)
    whole = arrays["halting_time"]
    arrays["halting_time"] = np.where(whole == NO_TIME, np.nan, whole * TIME_UNIT)
    return arrays
