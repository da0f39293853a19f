"""The rig of Newton's tendon: it applies the effects' forces, and ends a run where the friction law would go wrong."""

from __future__ import annotations

import math

from looping_pendulum.engines.chain import point_on_string
from looping_pendulum.engines.newton.settings import NewtonTendonSettings
from looping_pendulum.engines.newton.world import NewtonWorld, Vector
from looping_pendulum.engines.protocol import SAMPLE_INTERVAL
from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.cartesian import cartesian_force, release_velocity
from looping_pendulum.reference_ode.geometry import string_coordinates
from looping_pendulum.reference_ode.parameters import Parameters, Release

MAX_WRAP_ANGLE = math.pi + math.radians(1)
"""Wrap angle beyond which a string that slides with friction ends the run [rad].

Newton takes half a turn as the largest angle and measures a larger one from the other side: 1 degree more counts as 1 degree
less, so that a string that hangs down on both sides, within rounding errors of half a turn, is right.
"""


class NewtonTendonRig:
    """The apparatus in one world of Newton."""

    def __init__(self, parameters: Parameters, settings: NewtonTendonSettings) -> None:
        p = self._parameters = parameters
        self._settings = settings
        friction = p.coefficients["kinetic_friction"]
        self._world = NewtonWorld(p.coefficients["gravity"], settings)
        self._force = cartesian_force(p)
        self._groups = 0
        self._held_at: Vector | None = None
        vx, vy, heavy_vy = release_velocity(p)
        light = self._world.add_mass(point_on_string(p, 0.0, p.rod_radius), (vx, vy), p.light_mass)
        heavy_position = point_on_string(p, p.string_length, p.rod_radius)
        heavy: int | Vector
        if p.release is Release.HELD:
            heavy = self._held_at = heavy_position
        else:
            heavy = self._world.add_mass(heavy_position, (0.0, heavy_vy), p.heavy_mass)
        self._has_string = p.release is not Release.DROP
        if self._has_string:
            self._world.add_string(light, heavy, p.rod_radius, friction)
        # String that is held cannot slide, and one without friction does not ask for the angle
        self._wrap_is_limited = self._has_string and self._held_at is None and friction > 0
        self._wrap_angle = p.release_angle
        self._world.start()

    def advance(self) -> None:
        """Advance by one sample interval.

        Raises
        ------
        EngineError
            If the string slides with friction and is wound by more than half a turn.
        """
        for _ in range(self._settings.groups_per_sample):
            self._world.advance(self._effect_forces())
            self._groups += 1
        if self._wrap_is_limited:
            self._check_wrap()

    def read(self) -> tuple[float, ...]:
        """Return positions [m], velocities [m/s], string stretch and slip [m]: `COLUMNS` without the time."""
        positions, velocities = self._world.positions().tolist(), self._world.velocities().tolist()
        if self._held_at is not None:
            positions.append(list(self._held_at))
            velocities.append([0.0, 0.0])
        string = self._world.stretch_and_slip() if self._has_string else (math.nan, math.nan)
        return (*positions[0], *velocities[0], *positions[1], *velocities[1], *string)

    def _effect_forces(self) -> list[Vector]:
        """Return the effects' forces [N] on the masses that can move; none without effects."""
        if self._force is None:
            return []
        (x, y), (vx, vy), heavy_vy = self._world.positions()[0], self._world.velocities()[0], 0.0
        if self._held_at is None:
            heavy_vy = float(self._world.velocities()[1, 1])
        time = self._groups * self._settings.group_time
        fx, fy, heavy_fy = self._force(time, float(x), float(y), float(vx), float(vy), heavy_vy)
        return [(fx, fy)] if self._held_at is not None else [(fx, fy), (0.0, heavy_fy)]

    def _check_wrap(self) -> None:
        _, angles = string_coordinates(self._world.positions()[:1], self._parameters.rod_radius, self._wrap_angle)
        self._wrap_angle = float(angles[0])
        if self._wrap_angle > MAX_WRAP_ANGLE:
            time = round(self._groups * self._settings.group_time / SAMPLE_INTERVAL) * SAMPLE_INTERVAL
            raise EngineError(
                f"newton:tendon: found a wrap of {math.degrees(self._wrap_angle):.1f} deg at {time:.3f} s, needed at most 180: "
                "beyond half a turn Newton's roller has the friction of the angle that is left to a full turn"
            )
