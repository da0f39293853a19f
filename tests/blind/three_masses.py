"""Studies of three light masses and one heavy one, in which friction, a side force or a pull towards a point is hidden.

They are of the kinds that `identify` once judged wrongly, made anew with seeds of their own.
"""

from __future__ import annotations

import dataclasses
import math
import zlib
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from tests.blind import Apparatus, Effects
from tests.blind.camera import Camera, film
from tests.blind.cases import ANGLE_UNCERTAINTY, CASES, LENGTH_UNCERTAINTY, MASS_UNCERTAINTY, RADIUS_UNCERTAINTY
from tests.blind.simulator import Motion, simulate
from tests.blind.stored import archive_name, stored_or_written

Array = NDArray[np.float64]

TRIALS = MappingProxyType({"trial_a": (0.010, 105.0), "trial_b": (0.025, 95.0), "held_out": (0.016, 112.0)})
"""Trial -> light mass [kg] and release angle [deg]; the last one is held out."""
APPARATUS = Apparatus(heavy_mass=0.100, hanging_length=0.30)
PERFECT = Camera(noise=0.0, blur=0.0, missing=0.0, bursts=0)
NOISE = (2e-3, 1e-3)
"""Standard deviation of a tracked point of the light mass, and of the heavy one, each axis [m]."""
MISSING = 0.03
"""Probability that a point of the light mass is missing."""
FILMED = 2.5
"""[s]; a trial ends earlier where the light mass is wound up, or the string leaves the rod."""
NEAR_ROD, LEAST_WRAP = 0.02, 0.1
"""Distance of the light mass from the rod's centre [m], and wrap angle [rad], below which a film ends."""
HIDDEN: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "friction_per_turn": {"friction_per_turn": 0.35},
        "friction_speed": {"friction_per_speed": 0.12},
        "magnet": {"pull": 1.5e-4},
        "rough_patch": {"late_patch": 0.4},
        "side_pull_and_patch": {"side_force": 0.012, "late_patch": 0.4},
    }
)
"""Kind of study, as the names of the handed-out ones have it -> case of `cases.CASES` and its hidden number."""


def hidden(kind: str) -> Effects:
    """Return what acts in a kind of study."""
    numbers: dict[str, Any] = {}
    for name, value in HIDDEN[kind].items():
        case = CASES[name]
        ((effect, _),) = case.effects
        numbers |= {effect: value, **dict(case.fixed)}
    return Effects(**numbers)


def write_three_masses(folder: Path, kind: str, seed: int) -> Path:
    """Write a study's files, from the archive of its kind and seed if there is one; return the study file."""
    stored_or_written(archive_name("three_masses", kind, seed), folder, lambda to: simulate_three_masses(to, kind, seed))
    return folder / "study.yaml"


def simulate_three_masses(folder: Path, kind: str, seed: int) -> None:
    """Write a study's files as the simulator makes them now."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng([seed, zlib.crc32(kind.encode())])
    common = dataclasses.replace(APPARATUS, friction=0.34 * rng.uniform(0.9, 1.1), light_drag=1e-3 * rng.uniform(0.7, 1.3))
    trials = []
    for name, (light_mass, angle) in TRIALS.items():
        true = dataclasses.replace(common, light_mass=light_mass, release_angle=math.radians(angle))
        motion = simulate(true, hidden(kind), duration=FILMED)
        clip = film(motion, PERFECT, rng, duration=_duration(motion))
        light, heavy = (place + NOISE[i] * rng.standard_normal(place.shape) for i, place in enumerate((clip.light, clip.heavy)))
        light[rng.random(len(light)) < MISSING] = np.nan
        (folder / f"{name}.csv").write_text(_table(clip.t, light, heavy), encoding="utf-8")
        trials.append(_trial(name, true, rng))
    study = {
        "title": "A blind study",
        "apparatus": {"rod": {"radius": f"{common.rod_radius!r} m +/- {100 * RADIUS_UNCERTAINTY:g} %"}},
        "effects": {"gravity": f"{common.gravity} m/s^2"}
        | dict.fromkeys(("capstan", "light_drag", "heavy_drag", "string_drag"), "free"),
        "trials": trials,
        "limits": {
            "release_angle": ["60 deg", "130 deg"],
            "mass_ratio": [2, 12],
            "releases": ["looping", "held", "vertical"],
        },
    }
    (folder / "study.yaml").write_text(yaml.safe_dump(study, sort_keys=False), encoding="utf-8")


def _duration(motion: Motion) -> float:
    """Return when a film of a motion ends [s]."""
    over = (np.linalg.norm(motion.light, axis=1) < NEAR_ROD) | (motion.wrap_angle < LEAST_WRAP)
    return float(motion.t[np.argmax(over)]) if over.any() else FILMED


def _trial(name: str, true: Apparatus, rng: np.random.Generator) -> dict[str, Any]:
    """Return a trial of the study file, with what the experimenter measured."""

    def mass(value: float) -> str:
        return f"{float(value * (1 + MASS_UNCERTAINTY * rng.standard_normal()))!r} kg +/- {100 * MASS_UNCERTAINTY:g} %"

    angle = math.degrees(true.release_angle + ANGLE_UNCERTAINTY * rng.standard_normal())
    free, hanging = (float(v + LENGTH_UNCERTAINTY * rng.standard_normal()) for v in (true.free_length, true.hanging_length))
    return {
        "name": name,
        "file": f"{name}.csv",
        "tracks": {"light": "light", "heavy": "heavy"},
        "held_out": name == "held_out",
        "light": {"mass": mass(true.light_mass)},
        "heavy": {"mass": mass(true.heavy_mass)},
        "release": {
            "kind": "looping",
            "angle": f"{angle!r} deg +/- {math.degrees(ANGLE_UNCERTAINTY):g} deg",
            "free_length": f"{free!r} m +/- {LENGTH_UNCERTAINTY!r} m",
            "hanging_length": f"{hanging!r} m +/- {LENGTH_UNCERTAINTY!r} m",
        },
    }


def _table(t: Array, light: Array, heavy: Array) -> str:
    rows = [
        ",".join([f"{time:.6f}", *("" if np.isnan(v) else f"{v:.6f}" for v in places)])
        for time, places in zip(t, np.column_stack([light, heavy]), strict=True)
    ]
    return "\n".join(["t,light_x,light_y,heavy_x,heavy_y", *rows]) + "\n"
