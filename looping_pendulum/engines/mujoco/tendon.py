"""MuJoCo variants with the string as a spatial tendon over a cylinder; they differ in the friction between string and rod.

MuJoCo's step (new velocity from the present forces, new position from the new velocity) is a leapfrog step if its velocities
are understood as those half a step earlier. So the rig starts the velocities half a step early, and advances them by half a
step wherever a velocity is used (drag, the string's turning, samples): this is second order in the time step at no cost.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from looping_pendulum.capstan import NO_FRICTION, StringResponse
from looping_pendulum.engines.chain import NO_STOP
from looping_pendulum.engines.mujoco.model import (
    AUTORESET,
    DEFAULT_TIME_CONSTANT,
    breakdown_warnings,
    compile_model,
    softness_rungs,
    solver_defaults,
    time_constant_default,
)
from looping_pendulum.engines.protocol import FORCES_AND_RELEASE, Abilities, Profile, SteppedEngine, steps_per_sample
from looping_pendulum.engines.shipped import shipped_abilities
from looping_pendulum.engines.studies import Ladder, Studies, Variation
from looping_pendulum.pages.numbers import quantity
from looping_pendulum.reference_ode import effects
from looping_pendulum.reference_ode.cartesian import cartesian_force, kinematics, masses_at_release
from looping_pendulum.reference_ode.effects import EffectKind, Kinematics
from looping_pendulum.reference_ode.geometry import light_position, next_string_coordinates
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.reference_ode.solve import DURATION, solve
from looping_pendulum.runs.trajectory import SAMPLE_INTERVAL, Supplier, Supply
from looping_pendulum.scenarios.scenario import Scenario

HEAVY_DOF = 2
"""Degree of freedom of the heavy mass, after the light mass's two; a held heavy mass has none."""
SLACK_LENGTH = 1e-6
"""A string shorter than its rest length by more than this [m] counts as slack; a taut one's length varies by far less."""
TAUT_MARGIN = 1e-9
"""Length by which the string's limit is reduced [m], so that a string exactly at its rest length counts as taut."""


class FrictionSize(StrEnum):
    """Which friction of the reference's run the constant is set to."""

    EQUAL_WORK = "mean over the way that the string slides"
    AT_HALT = "last value before the halt"
    AT_RELEASE = "first value"


@dataclass(frozen=True, kw_only=True)
class TendonSettings:
    """Numerical settings of the tendon variants, which use MuJoCo's step as a leapfrog step."""

    time_step: float
    """Time step [s]; it divides `runs.trajectory.SAMPLE_INTERVAL`."""
    string_time_constant: float
    """Time constant with which the string returns to its length [s]; MuJoCo's `solref`, at least two time steps."""
    friction_time_constant: float
    """Time constant with which a held string comes to rest [s]; MuJoCo's `solreffriction`.

    With two time steps, the string stops within one.
    """
    impedance: float = 0.9999
    """Impedance: the fraction of a constraint that is enforced at once; MuJoCo's `solimp`, at the largest value it accepts."""
    least_impedance: float = 0.9999
    """Impedance where the constraint is satisfied exactly; it rises to ``impedance`` within a millimetre of violation."""
    integrator: str = "implicitfast"
    jacobian: str = "dense"
    """Dense, because MuJoCo 4.0.0 has a wrong Hessian with a sparse Jacobian."""
    solver_tolerance: float = 1e-12
    solver_iterations: int = 50
    rest_speed: float = 1e-5
    """Below this speed [m/s] the heavy mass counts as at rest; a held string creeps at 1e-6 m/s or less."""
    catch_time: float = 2e-3
    """Time constant with which the excess length of a late catch is taken back [s].

    A slack string becomes taut within a step, but the engine notices at its end, when the string is already too long.
    """
    switch_up: float = math.radians(210)
    """Wrap angle above k pi at which tendon k is replaced by tendon k + 1 [rad]; its path is right up to 240 deg."""
    switch_down: float = math.radians(15)
    """Wrap angle above k pi below which tendon k is replaced by tendon k - 1 [rad].

    It differs from ``switch_up`` - pi, so that a light mass that swings to and fro there does not switch at every step.
    """
    corrections: bool = True
    """Whether the adapter corrects what MuJoCo leaves out: the string's turning, half a step of velocity, a late catch."""
    friction_size: FrictionSize = FrictionSize.AT_RELEASE
    """Size of the constant friction loss of the variant "frictionloss"."""


def model_xml(parameters: Parameters, settings: TendonSettings, *, friction_loss: float = 0.0) -> str:
    """Return the MuJoCo model (MJCF) of ``parameters``, whose joint coordinates are x and y from the rod's centre.

    MuJoCo's x is the plane's x and its z is the plane's y. A spatial tendon does not count turns: it takes the shortest path
    round the rod on the side of its side site. Tendon 0 goes from the heavy mass to the rod's right edge and on round the rod
    to the light mass; tendon 1 goes half a turn further before that. Each is right over about half a turn, so using them in
    turn, with the length limit reduced by one turn of string at every second switch, they wind without end. The string is the
    upper limit of a tendon's length, so it pulls and never pushes.

    Friction loss of a tendon brakes the change of its own length, and the string's does not change; so ``friction_loss`` [N]
    belongs to tendon 2, the hanging part alone, which lengthens as the string slides.
    """
    p, s = parameters, settings
    x, y = light_position(math, p.free_length, p.release_angle, p.rod_radius)
    solimp = f"{s.least_impedance!r} {s.impedance!r} 0.001"
    # The rig enables the limit of the tendon in use
    string = f'range="0 {p.string_length!r}" solreflimit="{s.string_time_constant!r} 1" solimplimit="{solimp}"'
    friction = f'solreffriction="{s.friction_time_constant!r} 1" solimpfriction="{solimp}"'
    heavy_joint = f'<joint name="heavy_y" type="slide" axis="0 0 1" ref="{-p.hanging_length!r}" {friction}/>'
    held = p.release is Release.HELD
    return f"""
<mujoco model="looping pendulum">
  <compiler angle="degree"/>
  <option timestep="{s.time_step!r}" integrator="{s.integrator}" jacobian="{s.jacobian}"
          tolerance="{s.solver_tolerance!r}" iterations="{s.solver_iterations}" gravity="0 0 {-p.coefficients["gravity"]!r}">
    <flag contact="disable"{AUTORESET}/>
  </option>
  <worldbody>
    <geom name="rod" type="cylinder" size="{p.rod_radius!r} 0.05" euler="90 0 0" contype="0" conaffinity="0"/>
    <site name="right" pos="{p.rod_radius!r} 0 0"/>
    <site name="left" pos="{-p.rod_radius!r} 0 0"/>
    <site name="above" pos="{_beside_rod(p, 90)}"/>
    <site name="ahead_of_right" pos="{_beside_rod(p, 150)}"/>
    <site name="ahead_of_left" pos="{_beside_rod(p, 330)}"/>
    <body name="light" pos="{x!r} 0 {y!r}">
      <joint name="light_x" type="slide" axis="1 0 0" ref="{x!r}"/>
      <joint name="light_y" type="slide" axis="0 0 1" ref="{y!r}"/>
      <inertial pos="0 0 0" mass="{p.light_mass!r}" diaginertia="1e-6 1e-6 1e-6"/>
      <site name="light"/>
    </body>
    <body name="heavy" pos="{p.rod_radius!r} 0 {-p.hanging_length!r}">
      {"" if held else heavy_joint}
      <inertial pos="0 0 0" mass="{p.heavy_mass!r}" diaginertia="1e-6 1e-6 1e-6"/>
      <site name="heavy"/>
    </body>
  </worldbody>
  <tendon>
    <spatial name="even" limited="false" {string}>
      <site site="heavy"/><site site="right"/><geom geom="rod" sidesite="ahead_of_right"/><site site="light"/></spatial>
    <spatial name="odd" limited="false" {string}>
      <site site="heavy"/><site site="right"/><geom geom="rod" sidesite="above"/><site site="left"/>
      <geom geom="rod" sidesite="ahead_of_left"/><site site="light"/></spatial>
    <spatial name="hanging" frictionloss="{0.0 if held else friction_loss!r}" {friction}>
      <site site="heavy"/><site site="right"/></spatial>
  </tendon>
</mujoco>"""


def _beside_rod(parameters: Parameters, degrees: float) -> str:
    """Return the position of a side site, one radius off the rod's surface at this polar angle, as MJCF writes it."""
    distance, angle = 2 * parameters.rod_radius, math.radians(degrees)
    return f"{distance * math.cos(angle)!r} 0 {distance * math.sin(angle)!r}"


SAMPLES = 2000
"""Number of samples of the reference's run."""
ZERO_FRICTION_RATIO = 1e-12
"""Ratio of friction to the light mass's tension that counts as zero.

Without friction the two tensions are equal, and their difference is only rounding.
"""


def friction_loss(parameters: Parameters, size: FrictionSize) -> float:
    """Return the friction |T2 - T1| of the sliding string [N] as one number, from the reference's run of ``parameters``.

    Where the reference never halts, `FrictionSize.AT_HALT` is the last value while the string slides. Where it never slides,
    the constant is the largest that holds it. It has no static friction of its own, so the reference takes the kinetic one.
    """
    if parameters.release in (Release.HELD, Release.DROP):
        return 0.0
    run = solve(parameters.replace(static_friction=parameters.coefficients["kinetic_friction"]), duration=DURATION)
    until = run.end_time if run.halting_time is None else run.halting_time
    samples = run.sample(np.linspace(0.0, until, SAMPLES))
    light, heavy = samples.tensions
    speed = np.abs(samples.state.heavy_speed)
    sliding = (speed > 0) & (light > 0)  # in the reference, speed or tension is exactly 0 while the string sticks or is slack
    if not sliding.any():
        return float(np.abs(heavy - light).max())
    friction, speed = np.abs(heavy - light)[sliding], speed[sliding]
    if np.all(friction <= ZERO_FRICTION_RATIO * light[sliding]):
        return 0.0
    if size is FrictionSize.EQUAL_WORK:
        return float(friction @ speed / speed.sum())
    return float(friction[-1] if size is FrictionSize.AT_HALT else friction[0])


FRICTION_ROW, STRING_ROW = 0, 1
"""MuJoCo's constraint rows: friction losses come first, then the limits that are reached; a slack string has no row."""


class TendonRig:
    """The apparatus in MuJoCo, with a string that is one constraint.

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
        end_length: float,
        *,
        capstan: bool = False,
        friction_loss: float = 0.0,
    ) -> None:
        import mujoco

        p = parameters
        self._mujoco: Any = mujoco
        self._model: Any = compile_model(mujoco, model_xml(p, settings, friction_loss=friction_loss))
        self._data: Any = mujoco.MjData(self._model)
        self._qpos, self._qvel, self._qacc = self._data.qpos, self._data.qvel, self._data.qacc
        self._applied = self._data.qfrc_applied
        self._breakdowns = breakdown_warnings(mujoco, self._data)
        self._dt, self._steps = settings.time_step, steps_per_sample(settings.time_step)
        self._parameters = p
        self._has_string, self._held = p.release is not Release.DROP, p.release is Release.HELD
        self._end_length = end_length if self._has_string else -math.inf
        self._force = cartesian_force(p)
        self._at_release = masses_at_release(p)
        self._half_step = 0.5 * settings.time_step if settings.corrections else 0.0
        self._rest_speed, self._values = settings.rest_speed, p.values()
        self._free_length, self._wrap_angle = p.free_length, p.release_angle
        # MuJoCo leaves the string's turning (l omega^2) out of a tendon's acceleration. The string's length limit is shifted by
        # the amount that pulls equally strongly. The constraint's damping uses velocities half a step old, which already pulls
        # a part of it.
        softness = settings.impedance * settings.string_time_constant
        self._corrections = settings.corrections
        self._turning_shift = softness * softness * (1 - self._dt / softness)
        self._friction_bound, self._length_ranges = self._model.dof_frictionloss, self._model.tendon_range
        self._has_capstan = capstan and self._has_string and not self._held
        if self._has_capstan:
            self._friction_bound[HEAVY_DOF] = NO_FRICTION
        self._has_friction = self._has_capstan or friction_loss > 0
        self._switch_up, self._switch_down, self._half_turns = settings.switch_up, settings.switch_down, 0
        if self._has_string:
            self._use_tendon()
        self._was_slack, self._catch_stretch = False, 0.0
        self._catch_decay = math.exp(-settings.time_step / settings.catch_time)
        # The accelerations at release, and the velocities half a step before it
        speeds = (*self._at_release.light_velocity, self._at_release.heavy_velocity[1])
        self._qvel[:] = speeds[: len(self._qvel)]
        self._prepare()
        self._mujoco.mj_forward(self._model, self._data)
        self._qvel -= self._half_step * self._qacc

    def advance(self) -> None:
        """Step through one sample interval, or less if the light mass reaches the rod."""
        for _ in range(self._steps):
            if self._free_length <= self._end_length:
                return
            self._prepare()
            self._mujoco.mj_step(self._model, self._data)
            x, y = self._qpos[:2].tolist()
            self._free_length, self._wrap_angle = next_string_coordinates(x, y, self._parameters.rod_radius, self._wrap_angle)

    def read(self) -> tuple[float, ...]:
        """Return positions [m], velocities [m/s] and string stretch [m], of `COLUMNS`; the slip is not known."""
        if any(warning.number for warning in self._breakdowns):
            return (math.nan,) * 10
        x, y = self._qpos[:2].tolist()
        vx, vy, heavy_v = self._velocities()
        stretch = self._stretch() if self._has_string else math.nan
        return (x, y, vx, vy, self._parameters.rod_radius, self._heavy_height(), 0.0, heavy_v, stretch, math.nan)

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
        k = kinematics(self._data.time, self._free_length, self._wrap_angle, vx, vy, heavy_v)
        if self._has_string:
            self._select_tendon()
            correction = 0.0
            if self._corrections:
                turning = self._turning_shift * k.across_speed * k.across_speed / self._free_length
                correction = self._decayed_catch_stretch() - turning
            self._length_ranges[self._tendon, 1] = self._rest_length + (correction - TAUT_MARGIN)
        force_on_heavy_mass = 0.0
        if self._force is not None:
            x, y = self._qpos[:2].tolist()
            self._applied[0], self._applied[1], force_on_heavy_mass = self._force(self._data.time, x, y, vx, vy, heavy_v)
            if not self._held:
                self._applied[HEAVY_DOF] = force_on_heavy_mass
        if self._has_capstan:
            self._applied[HEAVY_DOF] = force_on_heavy_mass + self._bound_friction(k)

    def _select_tendon(self) -> None:
        """Switch to the tendon that is right for the wrap angle, if it is the other one."""
        above = self._wrap_angle - self._half_turns * math.pi
        if above > self._switch_up:
            self._half_turns += 1
        elif above < self._switch_down and self._half_turns > 0:
            self._half_turns -= 1
        else:
            return
        self._use_tendon()

    def _use_tendon(self) -> None:
        """Enable the length limit of the tendon for the present half turns, less the turns that are wound, and only that."""
        p, self._tendon = self._parameters, self._half_turns % 2
        self._rest_length = p.string_length - (self._half_turns // 2) * (2 * math.pi * p.rod_radius)
        self._model.tendon_limited[self._tendon] = 1
        self._model.tendon_limited[1 - self._tendon] = 0

    def _decayed_catch_stretch(self) -> float:
        """Return the excess length that the string may still have because it became taut within a step [m]; it decays.

        Pulling it back at once would throw the light mass off the string again.
        """
        p = self._parameters
        excess = self._free_length + p.rod_radius * self._wrap_angle - self._heavy_height() - p.string_length
        if self._was_slack and excess > 0:
            self._catch_stretch = excess
        self._was_slack = excess < -SLACK_LENGTH
        self._catch_stretch *= self._catch_decay
        return self._catch_stretch

    def _heavy_height(self) -> float:
        """Return the height of the heavy mass [m]."""
        return -self._parameters.hanging_length if self._held else float(self._qpos[HEAVY_DOF])

    def _stretch(self) -> float:
        """Return how much longer than its rest length the string is [m]."""
        # mj_step leaves the tendon lengths of the step's start in its data
        self._mujoco.mj_fwdPosition(self._model, self._data)
        return float(self._data.ten_length[self._tendon]) - self._rest_length

    def _bound_friction(self, k: Kinematics) -> float:
        """Set the friction loss of the heavy mass's slide to the friction bound of the string laws, for the coming step.

        The string's friction on the rod is T2 - T1. The tendon's tension is T1, so the friction acts on the heavy mass alone,
        and the friction loss of its slide is the bound. How tension and acceleration depend on the friction is known from the
        masses (`capstan.StringResponse`), so one solve with the friction of the step before gives the bound that is consistent
        with its own effect.

        Return an additional force [N], 0 unless the string reverses its motion.
        """
        p = self._parameters
        total_mass = p.light_mass + p.heavy_mass
        light_share = p.light_mass / total_mass
        friction, tension = self._solve_friction()
        # At release the mass has the release's speed; the engine's velocity is that half a step earlier.
        velocity = float(self._qvel[HEAVY_DOF]) if k.time > 0 else self._at_release.heavy_velocity[1]
        sliding, holding = (
            max(exponent(math, k, self._values, p.effects), 0.0)
            for exponent in (effects.sliding_exponent, effects.holding_exponent)
        )
        # What there would be without friction
        response = StringResponse(
            tension=max(tension + light_share * friction, 0.0),
            acceleration=float(self._qacc[HEAVY_DOF]) - friction / total_mass,
            mass=total_mass,
            tension_share=light_share,
        )
        bound, missing_force = response.bound(velocity, sliding, holding, self._dt, self._rest_speed)
        self._friction_bound[HEAVY_DOF] = bound
        return missing_force

    def _solve_friction(self) -> tuple[float, float]:
        """Return the friction and the tendon's tension [N] that MuJoCo finds for the present state."""
        self._mujoco.mj_forward(self._model, self._data)
        rows = self._data.efc_force
        tension = float(rows[STRING_ROW]) if len(rows) > STRING_ROW else 0.0
        if tension <= 0.0 and self._friction_bound[HEAVY_DOF] > NO_FRICTION:
            # The friction made the string slack, so the linear relation does not hold
            self._friction_bound[HEAVY_DOF] = NO_FRICTION
            return self._solve_friction()
        return float(rows[FRICTION_ROW]), tension


MUJOCO_DEFAULTS = TendonSettings(
    time_step=SAMPLE_INTERVAL,
    string_time_constant=DEFAULT_TIME_CONSTANT,
    friction_time_constant=DEFAULT_TIME_CONSTANT,
    impedance=0.95,
    least_impedance=0.9,
    integrator="Euler",
    jacobian="auto",
    solver_tolerance=1e-8,
    solver_iterations=100,
    corrections=False,
)
"""MuJoCo's default settings, except its step of 2 ms, which is longer than the sample interval."""
SETTINGS = {
    Profile.QUICK: TendonSettings(time_step=5e-4, string_time_constant=1e-3, friction_time_constant=1e-3),
    Profile.ACCURATE: TendonSettings(time_step=5e-5, string_time_constant=1e-4, friction_time_constant=1e-4),
}
"""Profile -> settings of all variants but "defaults", which has `MUJOCO_DEFAULTS` in both."""

_LATE_CATCH = "the length by which a slack string is caught late, which is let go of again within some milliseconds"
_NO_FRICTION = Supply(by=Supplier.NOBODY, how="spatial tendons have no friction on what they wrap")
_NO_STICKING = Supply(by=Supplier.NOBODY, how="nothing to stick to")
_STICK_SLIP = (
    "the adapter predicts where in a step the string stops and decides by the laws whether the rod holds it; MuJoCo's "
    "friction-loss constraint then stops and holds it"
)


def _abilities(
    variant: str,
    friction: str,
    *,
    friction_law: str | Supply = _NO_FRICTION,
    stick_slip: str | Supply = _NO_STICKING,
    limits: tuple[str, ...],
    **declared: Any,
) -> Abilities:
    """Return the abilities of a variant; by default it has no friction."""
    return shipped_abilities(
        f"mujoco:{variant}",
        winding="spatial tendon wrapped over a cylinder; the adapter counts turns, using two in turn",
        friction_law=friction_law,
        stick_slip=stick_slip,
        summary=f"Two spatial tendons used in turn over a cylinder, {friction}.",
        limits=(
            "a slack string is caught within one time step, so up to a step's way too late",
            NO_STOP,
            *limits,
        ),
        **declared,
    )


_ABILITIES = {
    "documented": _abilities(
        "documented",
        "no friction on the rod",
        limits=("without friction the heavy mass never halts",),
        additions=(_LATE_CATCH,),
    ),
    "capstan": _abilities(
        "capstan",
        "the capstan law fed in as friction loss",
        effect_kinds=FORCES_AND_RELEASE | {EffectKind.STRING_LAW},
        friction_law=Supply(by=Supplier.ADAPTER, how="capstan bound from the tendon's tension, fed to dof_frictionloss"),
        stick_slip=Supply(by=Supplier.ADAPTER, how=_STICK_SLIP),
        limits=(
            "where the catch turns the heavy mass round, friction turns with it; the reference gives the whole pull one "
            "direction",
        ),
        additions=(
            "the tension without friction, found by a solve of its own at every step, from which law and bound follow",
            "the force of the friction that turns round within a step",
            _LATE_CATCH,
        ),
    ),
    "frictionloss": _abilities(
        "frictionloss",
        "MuJoCo's constant friction loss for friction",
        friction_law="constant frictionloss of the hanging part's tendon, whatever its load; its size is the adapter's",
        stick_slip="the same friction-loss constraint",
        limits=(
            "friction does not grow with the tension or with the turns on the rod, so the grip that ends the fall is missing",
            "MuJoCo's frictionloss of the string's own tendon would brake nothing, as its length stays; the hanging part has "
            "it",
            "no size halts in time: of 0.1 to 1.2 N, 0.2 N is nearest to the reference up to 0.35 s, and its heavy mass turns "
            "back",
        ),
        from_reference=("the size of the friction",),
        additions=(
            "the size of the constant: the friction at the release in the reference's own run, which the adapter solves "
            "beforehand",
            _LATE_CATCH,
        ),
        main=False,
    ),
    "defaults": _abilities(
        "defaults",
        "no friction on the rod, every solver setting left as it comes",
        limits=(
            "without friction the heavy mass never halts",
            "MuJoCo's step of 2 ms is halved, so that samples fall on steps",
        ),
        main=False,
    ),
}
"""Variant -> what it can do."""


def _step_rungs(time_constants: Sequence[str]) -> Ladder:
    """Return a ladder of time steps, along which the settings ``time_constants`` stay two steps."""
    rungs = [{"time_step": dt} | dict.fromkeys(time_constants, 2 * dt) for dt in (1e-3, 5e-4, 2e-4, 1e-4, 5e-5, 2e-5)]
    return Ladder("time_step", "s", rungs, "the constraints' time constants stay 2 steps" if time_constants else "")


class MujocoTendon(SteppedEngine):
    """MuJoCo with the string as a spatial tendon over a cylinder.

    Parameters
    ----------
    variant
        "documented": no friction between string and rod, because MuJoCo documents none for a tendon.
        "capstan": the friction bound of the effects' string laws acts on the heavy mass's slide.
        "frictionloss": a constant friction loss, the only friction that MuJoCo has for tendons.
        "defaults": as documented, with the solver's default settings.
    """

    name = "mujoco"
    distribution = "mujoco"
    variant = "capstan"
    variants = _ABILITIES
    settings_by_profile = SETTINGS | {("defaults", profile): MUJOCO_DEFAULTS for profile in Profile}
    settings: TendonSettings

    def build(self, scenario: Scenario) -> TendonRig:
        """Rebuild the scenario's apparatus at the moment of release."""
        constant = self.variant == "frictionloss"
        return TendonRig(
            scenario.parameters,
            self.settings,
            self.end_length(scenario),
            capstan=self.variant == "capstan",
            friction_loss=friction_loss(scenario.parameters, self.settings.friction_size) if constant else 0.0,
        )

    def studies(self) -> Studies:
        """Return the studies: step and softness; MuJoCo's defaults; the choices of winding, catching and constant friction."""
        s, with_friction = self.settings, self.variant in ("capstan", "frictionloss")
        constants = ("string_time_constant", "friction_time_constant")[: 2 if with_friction else 1]
        softness = [softness_rungs(name, s.time_step) for name in constants]
        if self.variant == "defaults":  # it has nothing but defaults
            return Studies(ladders=(_step_rungs(()), *softness))
        mean = FrictionSize.EQUAL_WORK
        size = Variation("size of the constant friction", s.friction_size, mean, {"friction_size": mean})
        friction = time_constant_default(s, "friction_time_constant", "solreffriction", "how fast held string comes to rest")
        return Studies(
            ladders=(_step_rungs(constants), *softness),
            defaults=(
                time_constant_default(s, "string_time_constant", "solref", "how fast a stretched string returns to its length"),
                Variation(
                    "solimp",
                    f"{s.least_impedance:g} to {s.impedance:g}",
                    "0.9 to 0.95 within 1 mm",
                    {"least_impedance": 0.9, "impedance": 0.95},
                    "share of a constraint that is enforced; the rest gives way",
                ),
                *solver_defaults(s),
                *((friction,) if with_friction else ()),
            ),
            choices=(
                Variation(
                    "wrap angle at which the next tendon takes over",
                    f"{math.degrees(s.switch_up):.0f} deg above k pi",
                    "225 deg above k pi",
                    {"switch_up": math.radians(225)},
                ),
                Variation(
                    "wrap angle at which the last tendon takes over",
                    f"{math.degrees(s.switch_down):.0f} deg above k pi",
                    "5 deg above k pi",
                    {"switch_down": math.radians(5)},
                ),
                Variation(
                    "time in which a late catch is taken back",
                    quantity(s.catch_time, "s", 3),
                    quantity(5 * s.catch_time, "s", 3),
                    {"catch_time": 5 * s.catch_time},
                ),
                Variation(
                    "what MuJoCo leaves out (l omega^2 in the string's acceleration, half a step of velocity)",
                    "made up for",
                    "left out",
                    {"corrections": False},
                ),
                *((size,) if self.variant == "frictionloss" else ()),
            ),
        )
