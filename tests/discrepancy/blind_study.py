"""Write the study file of a blind case, as an experimenter would: with what is known, and nothing of what is hidden."""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from looping_pendulum.discrepancy import inputs
from looping_pendulum.discrepancy.fit.calibration import Fit, calibrate
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.discrepancy.inputs import Inputs
from looping_pendulum.measured.study_io import load
from tests.blind.cases import Case, write_case

TWO_RATIOS = ("ten_a", "six", "eight")
"""Two training trials of different mass ratio, and the one that is held out: half the work of all four."""


WHOLE_LIBRARY = None
"""In place of the names of some candidates: all of them."""


@contextmanager
def only_candidates(names: Sequence[str] | None) -> Iterator[None]:
    """Let an identification search these candidates alone: every other one costs a model of its own and some ten runs.

    The search goes through the same steps with few candidates as with all. Which of all candidates wins is for accurate tests.
    """
    if names is WHOLE_LIBRARY:
        yield
        return
    whole = inputs.candidates

    def some(*arguments: Any) -> tuple[Any, ...]:
        chosen = tuple(c for c in whole(*arguments) if c.name in names)
        assert {c.name for c in chosen} == set(names)
        return chosen

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(inputs, "candidates", some)
        yield


def write_study(
    folder: Path, case: Case, seed: int, *, trials: Sequence[str] | None = None, undeclared: Sequence[str] = (),
    anywhere: bool = False, **limits: Any,
) -> Path:  # fmt: skip
    """Write a case's files and a study of them.

    Parameters
    ----------
    trials
        Only these.
    undeclared
        Effects that are left out of it.
    anywhere
        Whether the trials may have been made on any planet, so that gravity is not known.
    """
    known = write_case(folder, case, seed)
    all_limits = {"release_angle": ["60 deg", "130 deg"], "mass_ratio": [2, 10], "releases": ["looping", "vertical", "held"]}
    study = {
        "title": "A blind study",
        "apparatus": {
            "light": {"mass": _measured(known["light_mass"], "kg")},
            "rod": {"radius": _measured(known["rod_radius"], "m")},
        },
        "effects": {"gravity": f"{known['gravity']} m/s^2"}
        | {name: "free" for name in ("capstan", "light_drag", "heavy_drag", "string_drag") if name not in undeclared},
        "trials": [_trial(known, trial) for trial in known["trials"] if trials is None or trial["name"] in trials],
        "limits": all_limits | limits,
    }
    if anywhere or case.name == "wrong_gravity":
        study["gravity_range"] = ["5 m/s^2", "15 m/s^2"]
    path = folder / "study.yaml"
    path.write_text(yaml.safe_dump(study, sort_keys=False), encoding="utf-8")
    return path


def _trial(known: dict[str, Any], trial: dict[str, Any]) -> dict[str, Any]:
    origin = _measured(trial["origin"], "m")
    return {
        "name": trial["name"],
        "file": trial["file"],
        "tracks": {mass: track for track, mass in known["tracks"].items()},
        "held_out": trial["held_out"],
        "heavy": {"mass": _measured(trial["heavy_mass"], "kg")},
        "release": {
            "kind": trial["release"],
            "angle": _measured(trial["release_angle"], "rad", math.degrees, "deg"),
            "free_length": _measured(trial["free_length"], "m"),
            "hanging_length": _measured(trial["hanging_length"], "m"),
        },
        "camera": {"origin_x": origin, "origin_y": origin},
    }


def _measured(known: dict[str, float], unit: str, convert: Any = float, shown: str = "") -> str:
    return f"{convert(known['value'])!r} {shown or unit} +/- {convert(known['uncertainty'])!r} {shown or unit}"


def fit_declared(path: Path) -> tuple[Inputs, Fit]:
    """Read a study, and fit its declared model to the training trials."""
    read = inputs.read_inputs(load(path))
    return read, calibrate(Problem(read.study, read.training, read.free_parameters))


def put_on_another_object(
    file: Path, *, share: float = 0.0, block: int = 0, distance: float = 0.03, seed: int = 0
) -> list[float]:
    """Move some of a table's points of the light mass to another object, as an autotracker does; return their times [s].

    Parameters
    ----------
    share
        Share of single points, each off in a direction of its own.
    block
        Number of frames in a row for which the tracker follows something that keeps its distance from the mass.
    distance
        Distance of the other object from the mass [m].
    """
    rng = np.random.default_rng(seed)
    lines = file.read_text(encoding="utf-8").splitlines()
    rows = [i for i, line in enumerate(lines) if line[:1].isdigit() and all(line.split(",")[1:3])]
    moved = rng.random(len(rows)) < share
    direction = rng.uniform(0, 2 * np.pi, len(rows))
    if block:
        start = int(rng.integers(20, len(rows) - block - 20))
        moved[start : start + block], direction[start : start + block] = True, 0.7
    for i, angle in zip(np.array(rows)[moved], direction[moved], strict=True):
        cells = lines[i].split(",")
        cells[1:3] = (
            f"{float(cells[1]) + distance * math.cos(angle):.6f}",
            f"{float(cells[2]) + distance * math.sin(angle):.6f}",
        )
        lines[i] = ",".join(cells)
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return [float(lines[i].split(",")[0]) for i in np.array(rows)[moved]]


def let_the_tracker_wander(file: Path, *, amplitude: float, frames: float, seed: int) -> None:
    """Add an error to every track of a table that changes in some ``frames`` frames: an Ornstein-Uhlenbeck process.

    Parameters
    ----------
    amplitude
        Standard deviation of each coordinate's error [m].
    """
    rng = np.random.default_rng(seed)
    lines = file.read_text(encoding="utf-8").splitlines()
    memory = math.exp(-1 / frames)
    error = amplitude * rng.standard_normal(4)
    for i, line in enumerate(lines):
        if not line[:1].isdigit():
            continue
        cells = line.split(",")
        for j in range(4):
            if cells[1 + j].strip():
                cells[1 + j] = f"{float(cells[1 + j]) + error[j]:.6f}"
        lines[i] = ",".join(cells)
        error = memory * error + amplitude * math.sqrt(1 - memory**2) * rng.standard_normal(4)
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
