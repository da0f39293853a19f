"""Write a study of blind held pendulums, as a class would: lengths and masses measured, the start of each film not."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from tests.blind.pendulum import Pendulum, write_record

TURNING_POINTS = 100


def write_held_study(
    folder: Path,
    *pendulums: Pendulum,
    turning_points: float = TURNING_POINTS,
    held_out: int | None = None,
    declared: tuple[str, ...] = ("light_drag",),
    stated_angle: bool = False,
    write: Callable[..., None] = write_record,
    **film: float,
) -> Path:
    """Write records of ``pendulums`` and a study of them.

    Parameters
    ----------
    turning_points
        Length of each record, in half periods of a small swing.
    held_out
        Index of the record that no fit uses; None: blocks of time are held out.
    declared
        Effects that the study declares, their coefficients free.
    stated_angle
        Whether the study states the angle of each record's start, as of a release.
    write
        Function that writes a record to a file.
    film
        Arguments of ``write``.
    """
    trials: list[dict[str, Any]] = []
    for i, p in enumerate(pendulums):
        name = f"swing_{i}"
        duration = turning_points * math.pi * math.sqrt(p.length / p.gravity)
        write(folder / f"{name}.csv", p, **({"duration": duration, "seed": i} | film))
        release = {"kind": "held", "free_length": f"{p.length} m +/- 1 mm"}
        if stated_angle:
            release["angle"] = f"{180 - math.degrees(p.angle)} deg +/- 0.5 deg"
        trials.append({"name": name, "file": f"{name}.csv", "held_out": i == held_out, "release": release})
    study = {
        "title": "A blind pendulum",
        "apparatus": {"light": {"mass": f"{pendulums[0].mass} kg +/- 0.5 %"}},
        "effects": {"gravity": "9.81 m/s^2"} | dict.fromkeys(declared, "free"),
        "trials": trials,
    }
    path = folder / "study.yaml"
    path.write_text(yaml.safe_dump(study, sort_keys=False), encoding="utf-8")
    return path
