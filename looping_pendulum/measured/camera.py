"""The camera: where and when the picture shows a point of the plane of motion.

A point at (x, y) from the rod's centre, at the true time t, is measured at the time t_m, t = clock_offset + clock_ratio t_m.
Its image by a pinhole camera that looks at the plane from an angle is, in true lengths,

    u = (foreshortening x, y + shear x) / (1 + perspective_x x + perspective_y y),

and the lens moves it along the line from the picture's centre c, at the distance r = |u - c|, to

    v = c + (u - c) (1 + distortion r^2) + distortion |c|^2 c,

where the last term keeps the rod's centre where it was. It is measured at scale Rot(tilt) v + (origin_x, origin_y). The page on
the derivation of the equations shows how these follow from the camera's place and direction.

A rolling shutter reads lower rows later: a point that is measured at the height y is pictured readout y earlier than its
frame's time says, or later below the rod. What is marked on the heavy mass may lie beside the string by heavy_offset_x.

An angular velocity is measured per second of the file's clock, plus rate_offset.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from types import MappingProxyType
from typing import Any

import numpy as np

from looping_pendulum.measured.observations import DataError
from looping_pendulum.reference_ode.effects import Coefficient
from looping_pendulum.reference_ode.geometry import Array, xy_pairs


@dataclass(frozen=True, kw_only=True)
class CameraCoefficient(Coefficient):
    """A coefficient of the camera model."""

    error: float
    """Standard error in a careful set-up [SI], used as its prior."""
    candidate_reach: float | None
    """Largest distance from the null value as a candidate of a search [SI]; None: it is no candidate.

    One camera films all trials. A camera with larger errors than these needs a study that says so.
    """
    changes: tuple[str, ...]
    """What it changes of what is measured, of `MEASURED`."""
    if_stated: bool
    """Whether only a trial that states it has it, since a table's own program may have corrected it."""


MEASURED = ("positions", "angle", "angle_rate", "height", "events")
"""What may be measured; "angle_rate" is an angular velocity by itself."""


def _coefficient(
    unit: str, null: float, bounds: tuple[float, float], meaning: str, *,
    error: float, title: str = "", reach: float | None = None, changes: tuple[str, ...] = ("positions",),
    if_stated: bool = False,
) -> Any:  # fmt: skip
    """Return the field of `Camera` of a coefficient, of which all is said here but its name."""
    known = {"unit": unit, "default": null, "null": null, "bounds": bounds, "meaning": meaning, "error": error, "title": title}
    return field(default=null, metadata={**known, "candidate_reach": reach, "changes": changes, "if_stated": if_stated})


_ANGLE = math.radians(0.5)
NEWTON_STEPS = 8
"""Newton steps by which `Camera.true_position` takes the lens's distortion out; they reach rounding in four or five."""


@dataclass(frozen=True, kw_only=True)
class Camera:
    """Camera of one trial; the default is a perfect one. `CAMERA` has the meaning and the unit of each value.

    A value may have an imaginary part, by which what is pictured is differentiated.
    """

    # The origin is no candidate, because a fit of the declared model has that of each camera already
    origin_x: float = _coefficient("m", 0.0, (-2e3, 2e3), "x at which the rod's centre is measured", error=5e-3)
    origin_y: float = _coefficient(
        "m", 0.0, (-2e3, 2e3), "y at which the rod's centre is measured", error=5e-3, changes=("positions", "height")
    )
    # Heights and angles are measured along the vertical and near the rod, where scale and tilt are all that matters
    scale: float = _coefficient(
        "", 1.0, (0.2, 5.0), "measured length per true length",
        error=0.005, title="the picture's scale", reach=0.3, changes=("positions", "height", "events"),
    )  # fmt: skip
    tilt: float = _coefficient(
        "rad", 0.0, (-math.pi, math.pi), "angle by which the picture is turned, counterclockwise",
        error=_ANGLE, title="a tilted camera", reach=math.radians(20), changes=("positions", "angle", "events"),
    )  # fmt: skip
    foreshortening: float = _coefficient(
        "", 1.0, (0.2, 5.0), "horizontal length in the picture per equally long vertical one",
        error=0.005, title="a camera that looks from one side", reach=0.3,
    )  # fmt: skip
    shear: float = _coefficient(
        "", 0.0, (-1.0, 1.0), "rise in the picture per length to the right, while upright lines stay upright",
        error=0.005, title="a sheared picture", reach=0.3,
    )  # fmt: skip
    perspective_x: float = _coefficient(
        "1/m", 0.0, (-1.0, 1.0), "relative growth of the distance from the camera, per length to the right",
        error=0.005, title="a perspective from left to right", reach=0.3,
    )  # fmt: skip
    perspective_y: float = _coefficient(
        "1/m", 0.0, (-1.0, 1.0), "relative growth of the distance from the camera, per length upwards",
        error=0.005, title="a perspective from top to bottom", reach=0.3,
    )  # fmt: skip
    distortion: float = _coefficient(
        "1/m^2", 0.0, (-1.0, 1.0),
        "relative growth of distances from the picture's centre by the lens, per square of the distance",
        error=0.01, title="the lens's distortion", reach=0.3,
    )  # fmt: skip
    # Without a distortion the picture's centre does not matter, and with one it is seldom determined by the motion
    centre_x: float = _coefficient("m", 0.0, (-10.0, 10.0), "x of the picture's centre, from the rod's", error=0.1)
    centre_y: float = _coefficient("m", 0.0, (-10.0, 10.0), "y of the picture's centre, from the rod's", error=0.1)
    clock_offset: float = _coefficient(
        "s", 0.0, (-60.0, 60.0), "true time since release at which the file's clock is 0",
        error=4e-3, title="a clock that starts early or late", reach=0.1, changes=MEASURED,
    )  # fmt: skip
    clock_ratio: float = _coefficient(
        "", 1.0, (0.01, 100.0), "true time per measured time",
        error=0.002, title="a wrong frame rate", reach=0.3, changes=MEASURED,
    )  # fmt: skip
    readout: float = _coefficient(
        "s/m", 0.0, (-0.1, 0.1), "delay of the picture's rows, per length downwards (rolling shutter)",
        error=2e-4, title="a rolling shutter", reach=0.04, if_stated=True,
    )  # fmt: skip
    # No candidate: it moves no point of the light mass
    heavy_offset_x: float = _coefficient(
        "m", 0.0, (-0.1, 0.1), "how far right of the heavy mass its points are", error=5e-4, if_stated=True
    )
    # No candidate either: every fit of angular velocities has it
    rate_offset: float = _coefficient(
        "rad/s", 0.0, (-1.0, 1.0), "angular velocity that is measured at rest", error=0.02, changes=("angle_rate",)
    )

    def __post_init__(self) -> None:
        """Refuse values out of their bounds."""
        for name, (low, high) in _BOUNDS:
            value = getattr(self, name)
            if not low <= value.real <= high:
                raise DataError(f"camera {name}: found {value.real:g}, needed between {low:g} and {high:g}")

    def true_time(self, t: Array) -> Array:
        """Return the times since release [s] of the file's times ``t`` [s]."""
        return self.clock_offset + self.clock_ratio * t

    def project(self, position: Array) -> Array:
        """Return measured positions [m] of true ones [m], shape (..., 2).

        Raises
        ------
        DataError
            If a position lies behind the camera.
        """
        turned = self._scaled_and_turned(self._image(position))
        return xy_pairs(turned[..., 0] + self.origin_x, turned[..., 1] + self.origin_y)

    def true_position(self, measured: Array) -> Array:
        """Return the true positions [m] that `project` maps to measured ones [m], shape (..., 2)."""
        cosine, sine = math.cos(self.tilt), math.sin(self.tilt)
        position: Array = (measured - [self.origin_x, self.origin_y]) / self.scale @ np.array([[cosine, -sine], [sine, cosine]])
        if self._looks_straight:
            return position
        # The lens moves points along lines from the picture's centre, at the distances r to r (1 + distortion r^2)
        centre, k = np.array([self.centre_x, self.centre_y]), self.distortion
        d = position - (1 + k * _square(centre)) * centre
        moved = np.sqrt(_square(d))
        r = moved
        for _ in range(NEWTON_STEPS if k else 0):
            r = r - (r * (1 + k * r * r) - moved) / (1 + 3 * k * r * r)
        u, v = np.moveaxis(centre + d / (1 + k * r * r), -1, 0)
        # (u, v) (1 + p x + q y) = (f x, y + s x), solved for x and y
        a, b = self.foreshortening - self.perspective_x * u, -self.perspective_y * u
        c, e = self.shear - self.perspective_x * v, 1 - self.perspective_y * v
        return xy_pairs((e * u - b * v) / (a * e - b * c), (a * v - c * u) / (a * e - b * c))

    def project_displacement(self, position: Array, displacement: Array) -> Array:
        """Return the displacement [m] in the picture of small true ones [m] at true positions [m].

        It is the derivative of `project` in the direction of the displacement.

        Parameters
        ----------
        position
            Shape (..., 2).
        displacement
            Shape (..., 2), or any that the position can be broadcast to.
        """
        return self._scaled_and_turned(self._image_of_displacement(position, displacement))

    def _scaled_and_turned(self, v: Array) -> Array:
        cosine, sine = np.cos(self.tilt), np.sin(self.tilt)
        x, y = v[..., 0], v[..., 1]
        return xy_pairs(self.scale * (cosine * x - sine * y), self.scale * (sine * x + cosine * y))

    @property
    def _looks_straight(self) -> bool:
        """Return whether lengths are in proportion all over the picture, as mostly in a fit."""
        return all(getattr(self, name) == CAMERA[name].null for name in BENDING)

    def _stretched(self, v: Array) -> Array:
        """Return what a camera far away makes of positions or displacements, shape (..., 2)."""
        return xy_pairs(self.foreshortening * v[..., 0], self.shear * v[..., 0] + v[..., 1])

    def _image(self, position: Array) -> Array:
        """Return the image v of true positions [m], shape (n, 2), before scale and tilt."""
        if self._looks_straight:
            return position
        u = self._stretched(position) / self._relative_depth(position)
        centre = np.array([self.centre_x, self.centre_y])
        d = u - centre
        return np.asarray(u + self.distortion * (_square(d) * d + _square(centre) * centre))

    def _image_of_displacement(self, position: Array, displacement: Array) -> Array:
        """Return the derivative of `_image` in the direction of ``displacement``."""
        if self._looks_straight:
            return displacement
        depth = self._relative_depth(position)
        u = self._stretched(position) / depth
        du = (self._stretched(displacement) - u * self._depth(displacement)) / depth
        d = u - np.array([self.centre_x, self.centre_y])
        along = np.sum(d * du, axis=-1, keepdims=True)
        return np.asarray(du + self.distortion * (_square(d) * du + 2 * along * d))

    def _relative_depth(self, position: Array) -> Array:
        """Return the distance of true positions [m] from the camera, along its axis, over that of the rod, shape (..., 1)."""
        depth = 1 + self._depth(position)
        if np.any(depth.real <= 0):  # where a run went astray, there is no position, and so no depth
            raise DataError(
                f"camera perspective: found {self.perspective_x:g} 1/m and {self.perspective_y:g} 1/m, with which a mass is "
                "behind the camera; needed smaller ones"
            )
        return depth

    def _depth(self, v: Array) -> Array:
        """Return how much farther than the rod positions or displacements are, relatively, shape (..., 1)."""
        return np.asarray(self.perspective_x * v[..., 0] + self.perspective_y * v[..., 1])[..., np.newaxis]


CAMERA = MappingProxyType({f.name: CameraCoefficient(name=f.name, **f.metadata) for f in fields(Camera)})
"""Coefficients of the camera model, by name; the null values are those of a perfect camera."""
BENDING = ("foreshortening", "shear", "perspective_x", "perspective_y", "distortion")
"""Values by which lengths are not in proportion all over the picture."""
_BOUNDS = tuple((c.name, c.bounds) for c in CAMERA.values())


def _square(v: Array) -> Array:
    """Return the squared length of vectors, shape (..., 2), as shape (..., 1)."""
    return np.asarray(np.sum(v * v, axis=-1, keepdims=True))
