"""Blind cases: what is hidden in each, and how its files are made. Only the files and `Known` may reach what is tested."""

from __future__ import annotations

import dataclasses
import json
import math
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.blind import Apparatus, Effects
from tests.blind.camera import Camera, film, tracker_csv
from tests.blind.rigid import RigidMotion, simulate_rigid
from tests.blind.simulator import DEFAULT, Motion, Numerics, simulate
from tests.blind.stored import archive_name, stored_or_written

Array = NDArray[np.float64]
Numbers = tuple[tuple[str, float], ...]
Known = dict[str, Any]

FILMED = 1.0
"""[s]"""
MASS_UNCERTAINTY = 0.005
RADIUS_UNCERTAINTY = 0.01
LENGTH_UNCERTAINTY = 1e-3
"""Of the free and the hanging length [m]; also of the origin, whose actual scatter is half of it."""
ANGLE_UNCERTAINTY = math.radians(0.5)


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One release of the apparatus."""

    name: str
    heavy_mass: float
    release_angle: float
    held_out: bool = False


TRIALS = (
    Trial(name="ten_a", heavy_mass=0.100, release_angle=math.radians(112)),
    Trial(name="ten_b", heavy_mass=0.100, release_angle=math.radians(95)),
    Trial(name="six", heavy_mass=0.060, release_angle=math.radians(112)),
    Trial(name="eight", heavy_mass=0.080, release_angle=math.radians(104), held_out=True),
)
"""The light mass is 10 g in all of them."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """What is hidden. `scaled` changes the hidden numbers, not the fixed ones."""

    name: str
    effects: Numbers = ()
    """Hidden effects, by their name in `Effects`."""
    fixed: Numbers = ()
    """Further numbers of `Effects` that the hidden ones need."""
    apparatus_errors: Numbers = ()
    """Relative errors of what the experimenter believes: the truth is that much larger."""
    camera_errors: Numbers = ()
    """Departures of `Camera` from its null values."""
    apparatus: Numbers = ()
    """Changes to the apparatus that both the truth and the experimenter's knowledge have."""
    varied: bool = False
    """Whether friction, drag and release angles of the truth depend on the seed."""
    listed: bool = True
    """Whether the library that is tested is asked to have it."""
    numerics: Numerics = DEFAULT
    """Of the simulator: finer where the motion hangs on the instant at which the string breaks away."""
    rigid: bool = False
    """Whether the limit of a rigid string is needed, for a heavy mass that turns at once; takes its own numerics."""

    def scaled(self, factor: float) -> Case:
        """Return this case with everything hidden multiplied by ``factor``."""
        hidden = {
            field: tuple((name, value * factor) for name, value in getattr(self, field))
            for field in ("effects", "apparatus_errors", "camera_errors")
        }
        return dataclasses.replace(self, **hidden)  # type: ignore[arg-type]

    def declared(self, trial: Trial) -> Apparatus:
        """Apparatus as the experimenter would believe it, were every measurement exact."""
        release = {"heavy_mass": trial.heavy_mass, "release_angle": trial.release_angle}
        return Apparatus(**release, **dict(self.apparatus))  # type: ignore[arg-type]

    def true(self, trial: Trial, seed: int) -> Apparatus:
        """Apparatus as it is."""
        a = self.declared(trial)
        changes = {name: getattr(a, name) * (1 + error) for name, error in self.apparatus_errors}
        if self.varied:
            shared, own = np.random.default_rng([seed, 1]), np.random.default_rng([seed, zlib.crc32(trial.name.encode())])
            changes["friction"] = a.friction * shared.uniform(0.9, 1.1)
            changes["light_drag"] = a.light_drag * shared.uniform(0.7, 1.3)
            changes["release_angle"] = a.release_angle + math.radians(own.uniform(-4, 4))
        return dataclasses.replace(a, **changes)

    def hidden(self) -> Effects:
        """Physics that nobody declared."""
        return Effects(**dict(self.effects), **dict(self.fixed))  # type: ignore[arg-type]

    def camera(self) -> Camera:
        """Camera as it is."""
        null = Camera()
        return dataclasses.replace(null, **{name: getattr(null, name) + error for name, error in self.camera_errors})


def _single(name: str, value: float, fixed: Numbers = (), **fields: Any) -> Case:
    return Case(name=name, effects=((name, value),), fixed=fixed, **fields)


CLEAN = Case(name="clean")
CLEAN_VARIED = Case(name="clean_varied", varied=True)

SINGLE = (
    _single("linear_drag", 1.2e-3),
    _single("wind", 0.6),
    _single("attitude_drag", 2.0),
    _single("static_excess", 0.7, numerics=Numerics(step=1.25e-5)),
    _single("friction_per_speed", 0.015),
    _single("friction_per_wrap", 0.006),
    # only a slippery rod lets the string slide after a turn
    _single("string_on_string", 0.02, apparatus=(("friction", 0.1),), rigid=True),
    _single("string_density", 6e-4),
    _single("compliance", 1 / 1500, fixed=(("string_loss_time", 5e-4),)),
    _single("string_thickness", 4.5e-4),
    _single("rod_mobility", 20.0, fixed=(("bearing_friction", 2.0),)),
    _single("heavy_swing", 0.25),
    _single("sideways_push", 0.4),
    _single("side_force", 5e-3),
    _single("side_stiffness", 0.015),
    _single("push", 0.03),
    Case(name="wrong_mass", apparatus_errors=(("light_mass", 0.06),)),  # weighing and data together know it to 0.8 %
    Case(name="wrong_length", apparatus_errors=(("free_length", 0.03),)),
    Case(name="wrong_gravity", apparatus_errors=(("gravity", -0.02),)),
)
"""One undeclared piece of physics each."""

SMALL = (_single("light_radius", 0.03),)
"""Effects that cannot reach 10 mm with these trials: the spin of a ball of 3 cm moves it by about 2 mm."""

PAIRS = (
    Case(name="drag_and_thickness", effects=(("linear_drag", 1.2e-3), ("string_thickness", 4.5e-4))),
    Case(name="speed_and_side_force", effects=(("friction_per_speed", 0.015), ("side_force", 5e-3))),
)

MEASUREMENT = (
    Case(name="scale", camera_errors=(("scale", 0.04),)),
    Case(name="tilt", camera_errors=(("tilt", math.radians(2)),)),
    Case(name="clock_offset", camera_errors=(("clock_offset", 0.006),)),
    Case(name="frame_rate", camera_errors=(("frame_rate_ratio", 0.015),)),
)

VIEWS = (
    Case(name="pixel_aspect", camera_errors=(("pixel_aspect", 0.03),)),
    Case(name="from_the_side", camera_errors=(("sideways", math.radians(14)),)),
    Case(name="from_afar", camera_errors=(("sideways", math.radians(14)), ("distance", 27.0))),
    Case(
        name="from_a_corner",
        camera_errors=(("sideways", math.radians(14)), ("above", math.radians(10)), ("distance", 297.0)),
    ),
    Case(name="from_below", camera_errors=(("above", math.radians(-3)),)),
    Case(name="near_scale", camera_errors=(("rule_behind", 0.1),)),
    Case(name="wide_lens", camera_errors=(("lens", -0.3), ("distance", -1.5))),
)
"""Real ways to look at the motion, by a camera in space; their signatures are what they are, 2 to 17 mm."""

UNLISTED = (
    _single("magnet", 0.015, listed=False),
    _single("thrust", 0.02, listed=False),
    _single("brake", 0.06, listed=False),
    _single("rough_patch", 0.06, listed=False),
    Case(
        name="late_patch",
        effects=(("rough_patch", 0.1),),
        fixed=(("patch_from", 3.6), ("patch_to", 4.4)),
        listed=False,
    ),
    _single("friction_per_turn", 0.15, listed=False),
    _single("pull", 5e-5, listed=False),
)

CASES = {c.name: c for c in (CLEAN, CLEAN_VARIED, *SINGLE, *SMALL, *PAIRS, *MEASUREMENT, *VIEWS, *UNLISTED)}


@lru_cache(maxsize=24)
def _moved(apparatus: Apparatus, effects: Effects, numerics: Numerics = DEFAULT, rigid: bool = False) -> Motion | RigidMotion:
    if rigid:
        return simulate_rigid(apparatus, effects, duration=FILMED)
    return simulate(apparatus, effects, duration=FILMED, numerics=numerics)


def moved(case: Case, trial: Trial, seed: int) -> Motion | RigidMotion:
    """Motion of a trial as it is, for `FILMED`."""
    return _moved(case.true(trial, seed), case.hidden(), case.numerics, case.rigid)


def signature(case: Case) -> float:
    """How far the hidden part moves the light mass before any refit [m]: RMS over a trial, the largest of the training trials.

    Between what a perfect tracker would state and where the declared model has the mass at the stated times.
    """
    return max(float(np.sqrt(np.mean(np.square(d)))) for d in displacements(case).values())


def displacements(case: Case) -> dict[str, Array]:
    """Training trial -> how far the hidden part moves the light mass at each frame [m], shape (frames,)."""
    found = {}
    camera = dataclasses.replace(case.camera(), noise=0.0, blur=0.0, missing=0.0, bursts=0)
    for trial in TRIALS:
        if trial.held_out:
            continue
        plain = _moved(case.declared(trial), Effects(), DEFAULT, case.rigid)
        clip = film(moved(case, trial, 0), camera, np.random.default_rng(0), duration=FILMED)
        inside = (clip.t >= 0) & (clip.t <= plain.t[-1])
        found[trial.name] = np.linalg.norm(clip.light[inside] - plain.at(clip.t[inside])[0], axis=1)
    return found


def with_signature(case: Case, target: float, *, tolerance: float = 0.05) -> Case:
    """Scale what is hidden until the signature is ``target`` [m], within the relative ``tolerance``.

    Raises
    ------
    ValueError
        If it does not come that close in a few trials.
    """
    power, step, last = 1.0, 1.0, math.nan
    for _ in range(10):
        found = signature(case)
        if abs(found / target - 1) <= tolerance:
            return case
        if not math.isnan(last) and found != last:  # some grow with the square, some only beyond a threshold
            power = float(np.clip(math.log(found / last) / math.log(step), 0.5, 4.0))
        step, last = float(np.clip((target / found) ** (1 / power), 0.2, 5.0)), found
        case = case.scaled(step)
    raise ValueError(f"{case.name}: no scale found that moves the light mass by {target:g} m")


def write_case(folder: Path, case: Case, seed: int) -> Known:
    """Write a Tracker export per trial, and return what the experimenter knows (also written, as ``known.json``)."""
    write_files("tracks", folder, case, seed, (), lambda to: simulate_case(to, case, seed))
    known: Known = json.loads((folder / "known.json").read_text(encoding="utf-8"))
    return known


def write_files(
    kind: str, folder: Path, case: Case, seed: int, trials: Sequence[str], simulate: Callable[[Path], None]
) -> None:
    """Fill ``folder`` from what is stored of the ``kind``; a case that only bears a stored one's name is simulated."""
    if case == CASES.get(case.name):
        stored_or_written(archive_name(kind, case.name, seed, trials), folder, simulate)
    else:
        simulate(folder)


def simulate_case(folder: Path, case: Case, seed: int) -> None:
    """Write a case as the simulator makes it now."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng([seed, zlib.crc32(case.name.encode())])
    known: Known = {"trials": []}
    for trial in TRIALS:
        motion = moved(case, trial, seed)
        ox, oy = rng.normal(0, LENGTH_UNCERTAINTY / 2, 2)
        camera = dataclasses.replace(case.camera(), origin=(float(ox), float(oy)))
        text = tracker_csv(film(motion, camera, rng, duration=FILMED))
        (folder / f"{trial.name}.csv").write_text(text, encoding="utf-8")
        a = dataclasses.replace(case.true(trial, seed), **_believed(case, trial))
        known["trials"].append(
            {
                "name": trial.name,
                "file": f"{trial.name}.csv",
                "held_out": trial.held_out,
                "release": "looping",
                "frame_rate": Camera().frame_rate,
                "heavy_mass": _measured(rng, a.heavy_mass, MASS_UNCERTAINTY * a.heavy_mass),
                "free_length": _measured(rng, a.free_length, LENGTH_UNCERTAINTY),
                "hanging_length": _measured(rng, a.hanging_length, LENGTH_UNCERTAINTY),
                "release_angle": _measured(rng, a.release_angle, ANGLE_UNCERTAINTY),
                "origin": {"value": 0.0, "uncertainty": LENGTH_UNCERTAINTY},
            }
        )
    known["tracks"] = {"mass A": "light", "mass B": "heavy"}
    known["gravity"] = a.gravity
    known["light_mass"] = _measured(rng, a.light_mass, MASS_UNCERTAINTY * a.light_mass)
    known["rod_radius"] = _measured(rng, a.rod_radius, RADIUS_UNCERTAINTY * a.rod_radius)
    (folder / "known.json").write_text(json.dumps(known, indent=2) + "\n", encoding="utf-8")


def _believed(case: Case, trial: Trial) -> dict[str, float]:
    """Undo the apparatus errors: the experimenter does not know of them."""
    return {name: getattr(case.declared(trial), name) for name, _ in case.apparatus_errors}


def _measured(rng: np.random.Generator, true: float, uncertainty: float) -> dict[str, float]:
    return {"value": float(true + uncertainty * rng.standard_normal()), "uncertainty": float(uncertainty)}
