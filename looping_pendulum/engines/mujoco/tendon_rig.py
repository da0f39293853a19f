"""The rig of the MuJoCo tendon variants: winds, pushes and grips the string at every step.

MuJoCo's step (new velocity from the forces now, new position from the new velocity) is a leapfrog step if its velocities are
read as those half a step earlier. So the rig starts them half a step early and takes them half a step on wherever a velocity
enters (drag, the string's turning, samples): second order in the time step at no cost.
"""

from __future__ import annotations

import math
from typing import Any

from looping_pendulum.engines.mujoco.tendon_model import TendonSettings, model_xml
from looping_pendulum.engines.mujoco.winding import TAUT, TurnTaking
from looping_pendulum.engines.protocol import steps_per_sample
from looping_pendulum.reference_ode import effects
from looping_pendulum.reference_ode.cartesian import cartesian_force, release_velocity
from looping_pendulum.reference_ode.effects import Kinematics
from looping_pendulum.reference_ode.geometry import string_followed
from looping_pendulum.reference_ode.parameters import Parameters, Release

HEAVY = 2
"""Degree of freedom of the heavy mass, after the light mass's two; a held heavy mass has none."""
FRICTION_ROW, STRING_ROW = 0, 1
"""MuJoCo's constraint rows: friction losses come first, then the limits that are reached; a slack string has no row."""
NO_FRICTION = 1e-12
"""A friction loss [N] that keeps the friction row in being: at 0 MuJoCo leaves it out."""
SLACK = 1e-6
"""A string with this much length to spare [m] counts as slack; a taut one's length varies by far less."""


class TendonRig:
    """The apparatus in MuJoCo.

    Parameters
    ----------
    parameters, settings
        Physics and numerics.
    end_length
        Free length [m] below which the rig stands still: beyond it the light mass would run into the rod.
    capstan
        Whether the effects' string laws act between string and rod.
    friction_loss
        MuJoCo's own constant friction [N] of the sliding string, whatever its load; 0: none.
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
        self._model: Any = mujoco.MjModel.from_xml_string(xml)
        self._data: Any = mujoco.MjData(self._model)
        self._step, self._solve, self._place = mujoco.mj_step, mujoco.mj_forward, mujoco.mj_fwdPosition
        self._qpos, self._qvel, self._qacc = self._data.qpos, self._data.qvel, self._data.qacc
        self._applied = self._data.qfrc_applied
        warnings = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
        self._breakdowns = tuple(self._data.warning[kind] for kind in warnings)
        self._dt, self._steps = settings.time_step, steps_per_sample(settings.time_step)
        self._half_step = 0.5 * settings.time_step if settings.corrections else 0.0
        self._rest_speed = settings.rest_speed
        self._radius, self._hanging, self._whole_length = p.rod_radius, p.hanging_length, p.string_length
        self._has_string, self._held = p.release is not Release.DROP, p.release is Release.HELD
        self._free_length, self._wrap_angle = p.free_length, p.release_angle
        self._end_length = end_length if self._has_string else -math.inf
        # MuJoCo leaves the string's turning (l omega^2) out of a tendon's acceleration, so the length allowed is shifted by
        # what pulls just as much. The row's own damping sees velocities half a step old and so already pulls a part of it.
        softness = settings.impedance * settings.string_time_constant
        self._corrections = settings.corrections
        self._turning_shift = softness * softness * (1 - self._dt / softness)
        self._force = cartesian_force(p)
        self._release_velocity = release_velocity(p)
        gripping = capstan and self._has_string and not self._held
        self._grip = CapstanGrip(p, self._model, self._data, settings, self._release_velocity[HEAVY]) if gripping else None
        self._gripped = gripping or friction_loss > 0
        turns = TurnTaking(p, self._model, settings.switch_up, settings.switch_down) if self._has_string else None
        self._turns = turns
        self._was_slack, self._caught, self._catch_factor = False, 0.0, math.exp(-settings.time_step / settings.catch_time)
        self._start()

    def advance(self) -> None:
        """Step through one sample interval, or less if the light mass reaches the rod."""
        for _ in range(self._steps):
            if self._free_length <= self._end_length:
                return
            self._prepare()
            self._step(self._model, self._data)
            self._follow_light_mass()

    def read(self) -> tuple[float, ...]:
        """Positions [m], velocities [m/s] and string stretch [m]: `COLUMNS` without the time."""
        if any(warning.number for warning in self._breakdowns):
            return (math.nan,) * 9  # MuJoCo only warns, and what follows looks like motion
        x, y = self._qpos[:2].tolist()
        vx, vy, heavy_v = self._velocities()
        heavy_y = -self._hanging if self._held else float(self._qpos[HEAVY])
        return (x, y, vx, vy, self._radius, heavy_y, 0.0, heavy_v, self._stretch())

    def _start(self) -> None:
        """Find the accelerations at release, and start the velocities half a step early."""
        self._qvel[:] = self._release_velocity[: len(self._qvel)]
        self._prepare()
        self._solve(self._model, self._data)
        self._qvel -= self._half_step * self._qacc

    def _follow_light_mass(self) -> None:
        """Free length and wrap angle of the taut string, turns counted."""
        x, y = self._qpos[:2].tolist()
        self._free_length, self._wrap_angle = string_followed(x, y, self._radius, self._wrap_angle)

    def _velocities(self) -> tuple[float, float, float]:
        """Velocities now: light x and y, heavy y [m/s]; the engine's are half a step old."""
        half = self._half_step
        velocity, acceleration = self._qvel.tolist(), self._qacc.tolist()
        heavy = 0.0
        if not self._held:
            heavy = velocity[HEAVY]
            if not self._gripped or abs(heavy) > self._rest_speed:  # gripped string stops for good within the step
                heavy += half * acceleration[HEAVY]
        return velocity[0] + half * acceleration[0], velocity[1] + half * acceleration[1], heavy

    def _prepare(self) -> None:
        """Set the length allowed to the string, the applied forces and the friction bound for the coming step."""
        vx, vy, heavy_v = self._velocities()
        cosine, sine = math.cos(self._wrap_angle), math.sin(self._wrap_angle)
        retreat, across = vy * cosine - vx * sine, -(vx * cosine + vy * sine)
        if self._turns is not None:
            self._turns.follow(self._wrap_angle)
            self._turns.allow(self._correction(across) - TAUT)
        force_on_heavy_mass = 0.0
        if self._force is not None:
            x, y = self._qpos[:2].tolist()
            self._applied[0], self._applied[1], force_on_heavy_mass = self._force(self._data.time, x, y, vx, vy, heavy_v)
            if not self._held:
                self._applied[HEAVY] = force_on_heavy_mass
        if self._grip is not None:
            time, length, angle, speed = self._data.time, self._free_length, self._wrap_angle, math.hypot(vx, vy)
            k = Kinematics(time, length, angle, retreat, across, abs(across), speed, heavy_v, abs(heavy_v))
            self._applied[HEAVY] = force_on_heavy_mass + self._grip.prepare(k)

    def _correction(self, across: float) -> float:
        """What the length allowed is shifted by [m] to make up for the string's turning and for a late catch."""
        if not self._corrections:
            return 0.0
        return self._overshoot() - self._turning_shift * across * across / self._free_length

    def _overshoot(self) -> float:
        """How much too long the string still may be because it became taut within a step, a little less each time [m].

        Pulling that back at once would throw the light mass off the string again.
        """
        hanging = self._hanging if self._held else -float(self._qpos[HEAVY])
        excess = self._free_length + self._radius * self._wrap_angle + hanging - self._whole_length
        if self._was_slack and excess > 0:
            self._caught = excess
        self._was_slack = excess < -SLACK
        self._caught *= self._catch_factor
        return self._caught

    def _stretch(self) -> float:
        """How much longer than its rest length the string is now [m]."""
        if self._turns is None:
            return math.nan
        self._place(self._model, self._data)
        return float(self._data.ten_length[self._turns.tendon]) - self._turns.rest_length


class CapstanGrip:
    """Feeds the string laws' friction bound to the heavy mass's slide.

    The string's friction on the rod is T2 - T1. It acts on the heavy mass alone, the tendon's tension being T1, so the friction
    loss of the heavy mass's slide is its bound. While the string is taut, tension and acceleration fall and rise in proportion
    to friction, so one solve with the friction of the step before gives the bound that is consistent with its own effect.
    """

    def __init__(self, parameters: Parameters, model: Any, data: Any, settings: TendonSettings, release_speed: float) -> None:
        import mujoco

        self._model, self._data, self._solve = model, data, mujoco.mj_forward
        self._bound, self._velocity, self._acceleration = model.dof_frictionloss, data.qvel, data.qacc
        self._bound[HEAVY] = NO_FRICTION
        self._release_speed = release_speed
        self._dt, self._rest_speed = settings.time_step, settings.rest_speed
        self._values = parameters.values()
        self._effects = parameters.effects
        self._total_mass = parameters.light_mass + parameters.heavy_mass
        self._light_share = parameters.light_mass / self._total_mass

    def prepare(self, k: Kinematics) -> float:
        """Set the bound for the coming step; return a force to apply besides [N], not 0 only where the string turns back."""
        tension_without, acceleration_without = self._without_friction()
        # At release the mass has its release's speed, and the engine's velocity is half a step older.
        velocity = float(self._velocity[HEAVY]) if k.time > 0 else self._release_speed
        sliding = max(effects.sliding_exponent(math, k, self._values, self._effects), 0.0)
        before, left = 0.0, 0.0
        if abs(velocity) > self._rest_speed:
            before = self._friction(math.copysign(sliding, velocity), tension_without)
            acceleration = acceleration_without + before / self._total_mass
            if velocity * (velocity + acceleration * self._dt) > 0:
                self._bound[HEAVY] = max(abs(before), NO_FRICTION)
                return 0.0
            left = -velocity / acceleration / self._dt  # share of the step until the heavy mass stops
        holding = max(effects.holding_exponent(math, k, self._values, self._effects), 0.0)
        needed = -self._total_mass * acceleration_without  # to keep the heavy mass at rest
        bound = self._friction(math.copysign(holding, -needed), tension_without)
        if abs(needed) <= abs(bound):
            self._bound[HEAVY] = max(abs(before), abs(bound), NO_FRICTION)  # the engine's constraint stops and holds it
            return 0.0
        after = self._friction(math.copysign(sliding, -needed), tension_without)
        self._bound[HEAVY] = max(abs(after), NO_FRICTION)
        return (before - after) * left

    def _without_friction(self) -> tuple[float, float]:
        """Tension [N] and the heavy mass's upward acceleration [m/s^2] that there would be without friction."""
        self._solve(self._model, self._data)
        rows = self._data.efc_force
        tension = float(rows[STRING_ROW]) if len(rows) > STRING_ROW else 0.0
        if tension <= 0.0 and self._bound[HEAVY] > NO_FRICTION:  # too much friction for a taut string: not in proportion
            self._bound[HEAVY] = NO_FRICTION
            return self._without_friction()
        friction = float(rows[FRICTION_ROW])
        tension_without = max(tension + self._light_share * friction, 0.0)
        return tension_without, float(self._acceleration[HEAVY]) - friction / self._total_mass

    def _friction(self, exponent: float, tension_without: float) -> float:
        """Friction T2 - T1 on the heavy mass, upward [N], where ln(T2/T1) = -exponent, positive for sliding upward.

        With T1 = T - share * F, T being the tension without friction, F = T1 (e^-exponent - 1) is solved for F.
        """
        ratio = math.expm1(-exponent)
        return ratio * tension_without / (1 + self._light_share * ratio)
