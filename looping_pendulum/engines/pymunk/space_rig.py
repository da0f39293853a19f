"""Advance and read an apparatus in a Chipmunk space: steps are taken in groups, and forces are applied at a group's start."""

from __future__ import annotations

import math
from typing import Any

from looping_pendulum.engines.pymunk.calls import Calls
from looping_pendulum.engines.pymunk.release_state import Vector
from looping_pendulum.reference_ode.cartesian import cartesian_force
from looping_pendulum.reference_ode.parameters import Parameters, Release


class SpaceRig:
    """Two masses in a Chipmunk space; a subclass creates the masses and the string between them."""

    _light: Any
    _heavy: Any
    _calls: Calls

    def __init__(self, parameters: Parameters, settings: Any) -> None:
        self._settings = settings
        self._force = cartesian_force(parameters)
        self._clamped = parameters.release is Release.HELD
        self._groups = 0

    def advance(self) -> None:
        """Advance the simulation by one `SAMPLE_INTERVAL`."""
        group = self._settings.force_interval
        for _ in range(self._settings.steps_per_sample // group):
            self._update_beads()
            self._apply_effect_forces(group)
            self._calls.step(group)
            self._groups += 1

    def read(self) -> tuple[float, ...]:
        """Return positions [m], velocities [m/s], string stretch and slip [m]: `COLUMNS` without the time."""
        lx, ly, lvx, lvy = self._calls.position_and_velocity(self._light)
        hx, hy, hvx, hvy = self._calls.position_and_velocity(self._heavy)
        return lx, ly, lvx, lvy, hx, hy, hvx, hvy, *self._read_string((lx, ly), (hx, hy))

    def _apply_effect_forces(self, group: int) -> None:
        """Apply the effects' forces for a whole group of steps in its first step, as Chipmunk clears forces after each step.

        The first group gets half of its impulse, so that on average over a group the speeds are neither early nor late.
        """
        if self._force is None:
            return
        share = group if self._groups else 0.5 * group
        time = self._groups * group * self._settings.time_step
        heavy_vy = self._calls.position_and_velocity(self._heavy)[3]
        fx, fy, heavy_fy = self._force(time, *self._calls.position_and_velocity(self._light), heavy_vy)
        self._calls.apply_force(self._light, share * fx, share * fy)
        if not self._clamped:
            self._calls.apply_force(self._heavy, 0.0, share * heavy_fy)

    def _update_beads(self) -> None:
        """Add or remove beads before a group of steps; a rig whose links stay as they are does nothing."""

    def _read_string(self, light: Vector, heavy: Vector) -> tuple[float, float]:
        """Return the string's stretch beyond its rest length and its slip over the rod [m]; NaN without a string.

        Parameters
        ----------
        light, heavy
            Positions of the masses [m].
        """
        return math.nan, math.nan
