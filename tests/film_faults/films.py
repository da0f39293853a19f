"""Clean blind studies of the separate simulator: apparatus, camera, noise and number of trials follow from a seed.

A film is kept as the points that a table of it has, with the true time of the picture that each was taken from. So a fault may
change what is written, and what should be read stays known. Nothing here comes from the reference.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.blind.camera import Camera, film
from tests.blind.cases import (
    ANGLE_UNCERTAINTY,
    FILMED,
    LENGTH_UNCERTAINTY,
    MASS_UNCERTAINTY,
    RADIUS_UNCERTAINTY,
    Case,
    Trial,
    moved,
)

Array = NDArray[np.float64]
Tree = dict[str, Any]

CHANNELS = ("light_x", "light_y", "heavy_x", "heavy_y")
RATES = (25.0, 29.97, 30.0, 50.0, 59.94, 60.0, 100.0, 120.0, 200.0, 239.76, 240.0, 240.0, 300.0, 480.0)
"""Frame rates of cameras [Hz]; the commonest of slow motion counts twice."""
NOISE = (0.3e-3, 1.5e-3)
"""Range of the standard deviation of a tracked point of a mass at rest, each axis [m]."""
APPARATUS = 20
"""Number of apparatus that seeds choose from: a motion takes the simulator a second, a film of it milliseconds."""
MASS_RATIOS = (6, 7, 8, 9, 10)


@dataclass(frozen=True, kw_only=True, eq=False)
class Film:
    """One trial: the points as they were tracked, and as a table has them."""

    trial: Trial
    rate: float
    """True frames per second."""
    motion: Callable[[Array], Array]
    """True places that a perfect tracker would state at given times, shape (n, 4)."""
    noise: float
    """Standard deviation of a tracked point of a mass at rest, each axis [m]."""
    blur: float
    """Growth of that with speed [s]."""
    taken: Array
    """True time of the picture that each point was taken from [s], shape (n, 4)."""
    points: Array
    """What should be read [m], shape (n, 4); not a number: missing."""
    t: Array
    """Times that the table has [s], shape (n,)."""
    written: Array
    """Points that the table has [m], shape (n, 4)."""
    entry: Tree = field(default_factory=dict)
    """What the study says of the trial beside its file and tracks."""

    def rows(self, index: NDArray[np.intp]) -> Film:
        """Return the film with these rows, in this order; their times stay those of the pictures."""
        return dataclasses.replace(
            self, taken=self.taken[index], points=self.points[index], t=self.t[index], written=self.written[index]
        )

    def speed(self, t: Array) -> Array:
        """Return the true velocity components at the times of single channels [m/s], shape (n, 4)."""
        instant = 1e-4
        ahead, behind = (self.places(t + sign * instant) for sign in (1, -1))
        return np.asarray((ahead - behind) / (2 * instant))

    def sigma(self, t: Array) -> Array:
        """Return the standard deviation of points taken at times of shape (n, 4) [m]."""
        v = self.speed(t)
        fast = np.stack([np.hypot(v[:, 0], v[:, 1])] * 2 + [np.hypot(v[:, 2], v[:, 3])] * 2, axis=1)
        return np.asarray(self.noise + self.blur * fast)

    def places(self, t: Array) -> Array:
        """Return the true places of single channels at their own times, shape (n, 4)."""
        return np.stack([self.motion(t[:, i])[:, i] for i in range(4)], axis=1)

    def displaced(self, t: Array, values: Array) -> Array:
        """Return how far points are from where the masses were at the times that are said of them, in standard deviations.

        The noise of the points themselves is left out. Infinite: the time is far outside the film.

        Parameters
        ----------
        t, values
            Times [s] and places [m] that are said of each point, shape (n, 4).
        """
        inside = (t > -0.5) & (t < FILMED + 0.5)
        moved_by = self.places(np.where(inside, t, 0.0)) - self.places(self.taken) + values - self.points
        # Before the release a mass rests; a motion that ended says nothing more
        return np.asarray(np.where(inside, np.abs(moved_by), np.inf) / self.sigma(self.taken))


@dataclass(frozen=True, kw_only=True, eq=False)
class CleanStudy:
    """A study without a fault, in memory."""

    films: tuple[Film, ...]
    tree: Tree
    """The study file, without its trials."""


def clean_study(seed: int) -> CleanStudy:
    """Return the study of a seed."""
    rng = np.random.default_rng([seed, 1])
    apparatus = seed % APPARATUS
    case, trials = _apparatus(apparatus)
    count = int(rng.choice([1, 2, 3], p=[0.5, 0.4, 0.1]))
    rate = float(rng.choice(RATES))
    camera = Camera(
        frame_rate=rate,
        noise=float(rng.uniform(*NOISE)),
        missing=float(rng.choice([0.0, 0.02, 0.05])),
        bursts=int(rng.integers(0, 3)) if rate > 60 else 0,
    )
    films: list[Film] = []
    for trial in (trials[0], trials[2], trials[1])[:count]:
        # Of two or three trials, the second one is held out
        trial = dataclasses.replace(trial, held_out=len(films) == 1)
        films.append(_film(case, trial, camera, apparatus, rng))
    a = case.true(trials[0], apparatus)
    tree = {
        "title": "A blind study",
        "apparatus": {
            "light": {"mass": _stated(rng, a.light_mass, MASS_UNCERTAINTY * a.light_mass, "kg")},
            "rod": {"radius": _stated(rng, a.rod_radius, RADIUS_UNCERTAINTY * a.rod_radius, "m")},
        },
        "effects": {"gravity": f"{a.gravity} m/s^2"}
        | {name: "free" for name in ("capstan", "light_drag", "heavy_drag", "string_drag")},
    }
    return CleanStudy(films=tuple(films), tree=tree)


def _apparatus(number: int) -> tuple[Case, tuple[Trial, Trial, Trial]]:
    """Return an apparatus and three trials of it: masses, lengths and angles in the range of the paper's."""
    rng = np.random.default_rng([number, 2])
    light = round(float(rng.uniform(0.010, 0.020)), 4)  # a lighter one would need shorter steps of the simulator
    changes = (
        ("light_mass", light),
        ("rod_radius", round(float(rng.uniform(0.005, 0.008)), 5)),
        ("free_length", round(float(rng.uniform(0.45, 0.65)), 3)),
    )
    ratios = rng.permutation(MASS_RATIOS)
    trials = tuple(
        Trial(
            name=name,
            heavy_mass=float(ratio * light),
            release_angle=math.radians(float(rng.uniform(84, 121))),
        )
        for name, ratio in zip(("first", "second", "third"), ratios[:3], strict=True)
    )
    return Case(name=f"apparatus_{number}", varied=True, apparatus=changes), (trials[0], trials[1], trials[2])


def _film(case: Case, trial: Trial, camera: Camera, seed: int, rng: np.random.Generator) -> Film:
    motion = moved(case, trial, seed)
    origin = rng.normal(0, LENGTH_UNCERTAINTY / 2, 2)
    own = dataclasses.replace(camera, origin=(float(origin[0]), float(origin[1])))
    clip = film(motion, own, rng, duration=FILMED)
    points = np.hstack([clip.light, clip.heavy])
    # A row in which nothing was seen is not in a table, and films begin at the release
    seen = np.isfinite(points).any(axis=1)
    t, points = clip.t[seen], points[seen]

    def places(at: Array) -> Array:
        light, heavy = motion.at(np.clip(at, 0.0, motion.t[-1]))
        return np.asarray(np.hstack([light, heavy]) - np.tile(origin, 2))

    a = case.true(trial, seed)
    entry = {
        "name": trial.name,
        "held_out": trial.held_out,
        "heavy": {"mass": _stated(rng, a.heavy_mass, MASS_UNCERTAINTY * a.heavy_mass, "kg")},
        "release": {
            "kind": "looping",
            "angle": _stated(rng, math.degrees(a.release_angle), math.degrees(ANGLE_UNCERTAINTY), "deg"),
            "free_length": _stated(rng, a.free_length, LENGTH_UNCERTAINTY, "m"),
            "hanging_length": _stated(rng, a.hanging_length, LENGTH_UNCERTAINTY, "m"),
        },
        "camera": {axis: f"0 m +/- {LENGTH_UNCERTAINTY} m" for axis in ("origin_x", "origin_y")},
    }
    return Film(
        trial=trial,
        rate=camera.frame_rate,
        motion=places,
        noise=camera.noise,
        blur=camera.blur,
        taken=np.tile(t[:, None], (1, 4)),
        points=points,
        t=t.copy(),
        written=points.copy(),
        entry=entry,
    )


def _stated(rng: np.random.Generator, true: float, uncertainty: float, unit: str) -> str:
    """Return a measured value as a study has it."""
    return f"{float(true + uncertainty * rng.standard_normal())!r} {unit} +/- {float(uncertainty)!r} {unit}"
