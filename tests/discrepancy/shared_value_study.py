"""Write a study of three exact trials in which a value of the apparatus that all of them share is stated wrongly."""

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tests.blind import Apparatus, Effects
from tests.blind.camera import Camera, film, tracker_csv
from tests.blind.simulator import simulate

TRIALS = {"t1": (0.100, 112.0), "t2": (0.060, 104.0), "t3": (0.040, 97.0)}
"""Name -> heavy mass [kg] and angle [deg]; the last one is held out."""
STATED = {"light_mass": "10 g +/- 0.5 %", "rod_radius": "6.25 mm +/- 0.5 %", "free_length": "58 cm +/- 1 mm"}
"""What is right of what is stated."""


def write_shared(
    folder: Path, seed: int, *, stated: dict[str, str] | None = None, noise: float = 0.25e-3, scale: float = 1.0,
    heavy_factor: float = 1.0, effects: dict[str, float] | None = None,
) -> Path:  # fmt: skip
    """Write tables and study.

    Parameters
    ----------
    stated
        What is stated in place of `STATED`.
    noise
        Standard deviation of a point, each axis [m].
    scale, heavy_factor
        Stated over true lengths of the picture; true over stated heavy masses.
    effects
        Physics that is not declared.
    """
    rng = np.random.default_rng(seed)
    known = STATED | (stated or {})
    camera = Camera(noise=noise, blur=2e-5, scale=scale)
    trials: list[dict[str, Any]] = []
    for name, (heavy_mass, angle) in TRIALS.items():
        apparatus = Apparatus(heavy_mass=heavy_mass * heavy_factor, release_angle=float(np.radians(angle)), friction=0.3)
        table = tracker_csv(film(simulate(apparatus, Effects(**(effects or {})), duration=1.0), camera, rng))
        (folder / f"{name}.csv").write_text(table, encoding="utf-8")
        trials.append(
            {
                "name": name,
                "file": f"{name}.csv",
                "tracks": {"light": "mass A", "heavy": "mass B"},
                "held_out": name == "t3",
                "heavy": {"mass": f"{1e3 * heavy_mass:g} g +/- 0.5 %"},
                "release": {
                    "kind": "looping",
                    "angle": f"{angle + 0.25 * rng.standard_normal():.2f} deg +/- 0.3 deg",
                    "free_length": known["free_length"],
                    "hanging_length": f"{50 + 0.5 * rng.standard_normal():.2f} mm +/- 1 mm",
                },
                "camera": {"origin_x": "0 m +/- 0.5 mm", "origin_y": "0 m +/- 0.5 mm"},
            }
        )
    study = {
        "title": "A value that all trials share",
        "apparatus": {"light": {"mass": known["light_mass"]}, "rod": {"radius": known["rod_radius"]}},
        "effects": {"gravity": "9.81 m/s^2"} | dict.fromkeys(("capstan", "light_drag", "heavy_drag", "string_drag"), "free"),
        "trials": trials,
    }
    path = folder / "study.yaml"
    path.write_text(yaml.safe_dump(study, sort_keys=False), encoding="utf-8")
    return path
