"""The rig of the MuJoCo tendon variants: it selects the tendon, and sets forces and the friction bound at every step.

MuJoCo's step (new velocity from the present forces, new position from the new velocity) is a leapfrog step if its velocities
are understood as those half a step earlier. So the rig starts the velocities half a step early, and advances them by half a
step wherever a velocity is used (drag, the string's turning, samples): this is second order in the time step at no cost.
"""

from __future__ import annotations

import math
from typing import Any

from looping_pendulum.capstan import NO_FRICTION, StringResponse
from looping_pendulum.engines.mujoco.model import compile_model
from looping_pendulum.engines.mujoco.tendon_model import TendonSettings, model_xml
from looping_pendulum.engines.mujoco.winding import TAUT_MARGIN, AlternatingTendons
from looping_pendulum.engines.protocol import steps_per_sample
from looping_pendulum.reference_ode import effects
from looping_pendulum.reference_ode.cartesian import cartesian_force, release_velocity
from looping_pendulum.reference_ode.effects import Kinematics
from looping_pendulum.reference_ode.geometry import next_string_coordinates
from looping_pendulum.reference_ode.parameters import Parameters, Release

HEAVY_DOF = 2
"""Degree of freedom of the heavy mass, after the light mass's two; a held heavy mass has none."""
FRICTION_ROW, STRING_ROW = 0, 1
"""MuJoCo's constraint rows: friction losses come first, then the limits that are reached; a slack string has no row."""
SLACK_LENGTH = 1e-6
"""A string shorter than its rest length by more than this [m] counts as slack; a taut one's length varies by far less."""


class TendonRig:
    """The apparatus in MuJoCo.

    Parameters
    ----------
    parameters, settings
        Physics and numerics.
    end_length
        Free length [m] below which the rig stops, because the light mass would run into the rod.
    capstan
        Whether the effects' string laws act between string and rod.
    friction_loss
        Constant friction of the sliding string [N], applied by MuJoCo whatever the load; 0: none.
    """

    def __init__(
        self,
        parameters: Parameters,
        settings: TendonSettings,
        *,
        end_length: float,
        capstan: bool = False,
        friction_loss: float = 0.0,
    ) -> None:
        import mujoco

        p = parameters
        time_constant = settings.friction_time_constant
        xml = model_xml(p, settings, friction_time_constant=time_constant, friction_loss=friction_loss)
        self._model: Any = compile_model(mujoco, xml)
        self._data: Any = mujoco.MjData(self._model)
        self._mj_step, self._mj_forward, self._mj_position = mujoco.mj_step, mujoco.mj_forward, mujoco.mj_fwdPosition
        self._qpos, self._qvel, self._qacc = self._data.qpos, self._data.qvel, self._data.qacc
        self._applied = self._data.qfrc_applied
        warnings = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
        self._breakdowns = tuple(self._data.warning[kind] for kind in warnings)
        self._dt, self._steps = settings.time_step, steps_per_sample(settings.time_step)
        self._half_step = 0.5 * settings.time_step if settings.corrections else 0.0
        self._rest_speed = settings.rest_speed
        self._radius, self._hanging, self._string_length = p.rod_radius, p.hanging_length, p.string_length
        self._has_string, self._held = p.release is not Release.DROP, p.release is Release.HELD
        self._free_length, self._wrap_angle = p.free_length, p.release_angle
        self._end_length = end_length if self._has_string else -math.inf
        # MuJoCo leaves the string's turning (l omega^2) out of a tendon's acceleration. The string's length limit is shifted by
        # the amount that pulls equally strongly. The constraint's damping uses velocities half a step old, which already pulls
        # a part of it.
        softness = settings.impedance * settings.string_time_constant
        self._corrections = settings.corrections
        self._turning_shift = softness * softness * (1 - self._dt / softness)
        self._force = cartesian_force(p)
        self._release_velocity = release_velocity(p)
        gripping = capstan and self._has_string and not self._held
        self._capstan_friction = (
            CapstanFriction(p, self._model, self._data, settings, self._release_velocity[HEAVY_DOF]) if gripping else None
        )
        self._has_friction = gripping or friction_loss > 0
        turns = AlternatingTendons(p, self._model, settings.switch_up, settings.switch_down) if self._has_string else None
        self._tendons = turns
        self._was_slack, self._catch_stretch, self._catch_decay = (
            False,
            0.0,
            math.exp(-settings.time_step / settings.catch_time),
        )
        self._initialise()

    def advance(self) -> None:
        """Step through one sample interval, or less if the light mass reaches the rod."""
        for _ in range(self._steps):
            if self._free_length <= self._end_length:
                return
            self._prepare()
            self._mj_step(self._model, self._data)
            self._update_string_coordinates()

    def read(self) -> tuple[float, ...]:
        """Return positions [m], velocities [m/s] and string stretch [m]: `COLUMNS` without the time."""
        if any(warning.number for warning in self._breakdowns):
            return (math.nan,) * 9  # MuJoCo only warns of a breakdown, and the numbers that follow look like motion
        x, y = self._qpos[:2].tolist()
        vx, vy, heavy_v = self._velocities()
        heavy_y = -self._hanging if self._held else float(self._qpos[HEAVY_DOF])
        return (x, y, vx, vy, self._radius, heavy_y, 0.0, heavy_v, self._stretch())

    def _initialise(self) -> None:
        """Compute the accelerations at release, and set the velocities to half a step before it."""
        self._qvel[:] = self._release_velocity[: len(self._qvel)]
        self._prepare()
        self._mj_forward(self._model, self._data)
        self._qvel -= self._half_step * self._qacc

    def _update_string_coordinates(self) -> None:
        """Update free length and wrap angle of the taut string, with full turns counted."""
        x, y = self._qpos[:2].tolist()
        self._free_length, self._wrap_angle = next_string_coordinates(x, y, self._radius, self._wrap_angle)

    def _velocities(self) -> tuple[float, float, float]:
        """Return the present velocities of light x and y and heavy y [m/s]; the engine's are half a step old."""
        half = self._half_step
        velocity, acceleration = self._qvel.tolist(), self._qacc.tolist()
        heavy = 0.0
        if not self._held:
            heavy = velocity[HEAVY_DOF]
            if not self._has_friction or abs(heavy) > self._rest_speed:  # a string that friction has stopped stays at rest
                heavy += half * acceleration[HEAVY_DOF]
        return velocity[0] + half * acceleration[0], velocity[1] + half * acceleration[1], heavy

    def _prepare(self) -> None:
        """Set the string's length limit, the applied forces and the friction bound for the coming step."""
        vx, vy, heavy_v = self._velocities()
        cosine, sine = math.cos(self._wrap_angle), math.sin(self._wrap_angle)
        radial_speed, transverse_speed = vy * cosine - vx * sine, -(vx * cosine + vy * sine)
        if self._tendons is not None:
            self._tendons.select(self._wrap_angle)
            self._tendons.allow_extra_length(self._correction(transverse_speed) - TAUT_MARGIN)
        force_on_heavy_mass = 0.0
        if self._force is not None:
            x, y = self._qpos[:2].tolist()
            self._applied[0], self._applied[1], force_on_heavy_mass = self._force(self._data.time, x, y, vx, vy, heavy_v)
            if not self._held:
                self._applied[HEAVY_DOF] = force_on_heavy_mass
        if self._capstan_friction is not None:
            time, length, angle, speed = self._data.time, self._free_length, self._wrap_angle, math.hypot(vx, vy)
            k = Kinematics(
                time, length, angle, radial_speed, transverse_speed, abs(transverse_speed), speed, heavy_v, abs(heavy_v)
            )
            self._applied[HEAVY_DOF] = force_on_heavy_mass + self._capstan_friction.prepare(k)

    def _correction(self, transverse_speed: float) -> float:
        """Return the shift of the string's length limit [m] that compensates for the string's turning and for a late catch."""
        if not self._corrections:
            return 0.0
        return self._decayed_catch_stretch() - self._turning_shift * transverse_speed * transverse_speed / self._free_length

    def _decayed_catch_stretch(self) -> float:
        """Return the excess length that the string may still have because it became taut within a step [m]; it decays.

        Pulling it back at once would throw the light mass off the string again.
        """
        hanging = self._hanging if self._held else -float(self._qpos[HEAVY_DOF])
        excess = self._free_length + self._radius * self._wrap_angle + hanging - self._string_length
        if self._was_slack and excess > 0:
            self._catch_stretch = excess
        self._was_slack = excess < -SLACK_LENGTH
        self._catch_stretch *= self._catch_decay
        return self._catch_stretch

    def _stretch(self) -> float:
        """Return how much longer than its rest length the string is [m]."""
        if self._tendons is None:
            return math.nan
        # mj_step leaves the tendon lengths of the step's start in its data
        self._mj_position(self._model, self._data)
        return float(self._data.ten_length[self._tendons.tendon]) - self._tendons.rest_length


class CapstanFriction:
    """Sets the friction loss of the heavy mass's slide to the friction bound of the string laws.

    The string's friction on the rod is T2 - T1. The tendon's tension is T1, so the friction acts on the heavy mass alone, and
    the friction loss of the heavy mass's slide is its bound. How tension and acceleration depend on the friction is known from
    the masses (`capstan.StringResponse`), so one solve with the friction of the step before gives the bound that is consistent
    with its own effect.
    """

    def __init__(self, parameters: Parameters, model: Any, data: Any, settings: TendonSettings, release_speed: float) -> None:
        import mujoco

        self._model, self._data, self._mj_forward = model, data, mujoco.mj_forward
        self._bound, self._velocity, self._acceleration = model.dof_frictionloss, data.qvel, data.qacc
        self._bound[HEAVY_DOF] = NO_FRICTION
        self._release_speed = release_speed
        self._dt, self._rest_speed = settings.time_step, settings.rest_speed
        self._values = parameters.values()
        self._effects = parameters.effects
        self._total_mass = parameters.light_mass + parameters.heavy_mass
        self._light_share = parameters.light_mass / self._total_mass

    def prepare(self, k: Kinematics) -> float:
        """Set the bound for the coming step; return an additional force [N], 0 unless the string reverses its motion."""
        tension, acceleration = self._without_friction()
        # At release the mass has the release's speed; the engine's velocity is that half a step earlier.
        velocity = float(self._velocity[HEAVY_DOF]) if k.time > 0 else self._release_speed
        sliding = max(effects.sliding_exponent(math, k, self._values, self._effects), 0.0)
        holding = max(effects.holding_exponent(math, k, self._values, self._effects), 0.0)
        response = StringResponse(
            tension=tension, acceleration=acceleration, mass=self._total_mass, tension_share=self._light_share
        )
        self._bound[HEAVY_DOF], missing_force = response.bound(velocity, sliding, holding, self._dt, self._rest_speed)
        return missing_force

    def _without_friction(self) -> tuple[float, float]:
        """Return the tension [N] and the heavy mass's upward acceleration [m/s^2] that there would be without friction."""
        self._mj_forward(self._model, self._data)
        rows = self._data.efc_force
        tension = float(rows[STRING_ROW]) if len(rows) > STRING_ROW else 0.0
        if (
            tension <= 0.0 and self._bound[HEAVY_DOF] > NO_FRICTION
        ):  # the friction made the string slack, so the linear relation does not hold
            self._bound[HEAVY_DOF] = NO_FRICTION
            return self._without_friction()
        friction = float(rows[FRICTION_ROW])
        tension_without = max(tension + self._light_share * friction, 0.0)
        return tension_without, float(self._acceleration[HEAVY_DOF]) - friction / self._total_mass
