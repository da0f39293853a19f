"""What every apparatus in a Chipmunk space has: steps in groups, forces at their start, and how it is read back."""

from __future__ import annotations

import math
from typing import Any

from looping_pendulum.engines.pymunk.calls import Calls
from looping_pendulum.engines.pymunk.laid_string import Vector
from looping_pendulum.reference_ode.cartesian import cartesian_force
from looping_pendulum.reference_ode.parameters import Parameters, Release


class SpaceRig:
    """Two masses in a space; a subclass makes them, and what is between them."""

    _light: Any
    _heavy: Any
    _calls: Calls

    def __init__(self, parameters: Parameters, settings: Any) -> None:
        self._settings = settings
        self._force = cartesian_force(parameters)
        self._clamped = parameters.release is Release.HELD
        self._groups = 0

    def advance(self) -> None:
        """Step through one `SAMPLE_INTERVAL`."""
        group = self._settings.force_interval
        for _ in range(self._settings.steps_per_sample // group):
            self._tend()
            self._push(group)
            self._calls.step(group)
            self._groups += 1

    def read(self) -> tuple[float, ...]:
        """Positions [m], velocities [m/s], string stretch and slip [m]: `COLUMNS` without the time."""
        lx, ly, lvx, lvy = self._calls.motion(self._light)
        hx, hy, hvx, hvy = self._calls.motion(self._heavy)
        return lx, ly, lvx, lvy, hx, hy, hvx, hvy, *self._read_string((lx, ly), (hx, hy))

    def _push(self, group: int) -> None:
        """Apply the forces of a group of steps in its first one: Chipmunk forgets forces after each step.

        The first group gets half of its own, so that on average over a group the speeds are neither early nor late.
        """
        if self._force is None:
            return
        share = group if self._groups else 0.5 * group
        time = self._groups * group * self._settings.time_step
        heavy_vy = self._calls.motion(self._heavy)[3]
        fx, fy, heavy_fy = self._force(time, *self._calls.motion(self._light), heavy_vy)
        self._calls.push(self._light, share * fx, share * fy)
        if not self._clamped:
            self._calls.push(self._heavy, 0.0, share * heavy_fy)

    def _tend(self) -> None:
        """See to the string before a group of steps."""

    def _read_string(self, light: Vector, heavy: Vector) -> tuple[float, float]:
        """How much longer than its rest length the string between the masses' places is, and how far it has slid [m].

        NaN without a string.
        """
        return math.nan, math.nan
