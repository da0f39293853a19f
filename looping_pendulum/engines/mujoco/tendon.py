"""MuJoCo variants with the string as a spatial tendon over a cylinder; they differ in the friction between string and rod.

MuJoCo's step (new velocity from the present forces, new position from the new velocity) is a leapfrog step if its velocities
are understood as those half a step earlier. So the rig starts the velocities half a step early, and advances them by half a
step wherever a velocity is used (drag, the string's turning, samples): this is second order in the time step at no cost.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from looping_pendulum.capstan import NO_FRICTION, StringResponse
from looping_pendulum.engines.chain import NO_STOP
from looping_pendulum.engines.mujoco.model import (
    DEFAULT_TIME_CONSTANT,
    HEAVY_DOF,
    SLACK_LENGTH,
    SWITCH_DOWN,
    SWITCH_UP,
    TAUT_MARGIN,
    WRAPPED_TENDON,
    AlternatingTendons,
    StringRig,
    StringSettings,
    kinematics,
    model_xml,
    softness_rungs,
    step_rungs,
    string_defaults,
    time_constant_default,
)
from looping_pendulum.engines.protocol import FORCES_AND_RELEASE, Abilities, Profile, TunedEngine
from looping_pendulum.engines.shipped import shipped_abilities
from looping_pendulum.engines.studies import AdapterChoice, Studies, studies_from_rows
from looping_pendulum.pages.numbers import quantity
from looping_pendulum.reference_ode import effects
from looping_pendulum.reference_ode.effects import EffectKind, Kinematics
from looping_pendulum.reference_ode.geometry import next_string_coordinates
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.reference_ode.solve import DURATION, solve
from looping_pendulum.runs.trajectory import SAMPLE_INTERVAL, Supplier, Supply
from looping_pendulum.scenarios.scenario import Scenario

SAMPLES = 2000
"""Number of samples of the reference's run."""
ZERO_FRICTION_RATIO = 1e-12
"""Ratio of friction to the light mass's tension that counts as zero.

Without friction the two tensions are equal, and their difference is only rounding.
"""


class FrictionSize(StrEnum):
    """Which friction of the reference's run the constant is set to."""

    EQUAL_WORK = "mean over the way that the string slides"
    AT_HALT = "last value before the halt"
    AT_RELEASE = "first value"


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


class TendonRig(StringRig):
    """The apparatus in MuJoCo.

    Parameters
    ----------
    parameters, settings, end_length
        As for `StringRig`.
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
        p = parameters
        time_constant = settings.friction_time_constant
        xml = model_xml(p, settings, friction_time_constant=time_constant, friction_loss=friction_loss)
        super().__init__(p, settings, xml, end_length)
        self._applied = self._data.qfrc_applied
        self._half_step = 0.5 * settings.time_step if settings.corrections else 0.0
        self._rest_speed, self._values = settings.rest_speed, p.values()
        self._free_length, self._wrap_angle = p.free_length, p.release_angle
        # MuJoCo leaves the string's turning (l omega^2) out of a tendon's acceleration. The string's length limit is shifted by
        # the amount that pulls equally strongly. The constraint's damping uses velocities half a step old, which already pulls
        # a part of it.
        softness = settings.impedance * settings.string_time_constant
        self._corrections = settings.corrections
        self._turning_shift = softness * softness * (1 - self._dt / softness)
        self._friction_bound = self._model.dof_frictionloss
        self._has_capstan = capstan and self._has_string and not self._held
        if self._has_capstan:
            self._friction_bound[HEAVY_DOF] = NO_FRICTION
        self._has_friction = self._has_capstan or friction_loss > 0
        turns = AlternatingTendons(p, self._model, settings.switch_up, settings.switch_down) if self._has_string else None
        self._tendons = turns
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

    def _read_motion(self) -> tuple[float, ...]:
        return (*self._qpos[:2].tolist(), *self._velocities())

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
        if self._tendons is not None:
            self._tendons.select(self._wrap_angle)
            correction = 0.0
            if self._corrections:
                turning = self._turning_shift * k.across_speed * k.across_speed / self._free_length
                correction = self._decayed_catch_stretch() - turning
            self._tendons.allow_extra_length(correction - TAUT_MARGIN)
        force_on_heavy_mass = 0.0
        if self._force is not None:
            x, y = self._qpos[:2].tolist()
            self._applied[0], self._applied[1], force_on_heavy_mass = self._force(self._data.time, x, y, vx, vy, heavy_v)
            if not self._held:
                self._applied[HEAVY_DOF] = force_on_heavy_mass
        if self._has_capstan:
            self._applied[HEAVY_DOF] = force_on_heavy_mass + self._bound_friction(k)

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

    def _stretch(self) -> float:
        assert self._tendons is not None
        # mj_step leaves the tendon lengths of the step's start in its data
        self._mujoco.mj_fwdPosition(self._model, self._data)
        return float(self._data.ten_length[self._tendons.tendon]) - self._tendons.rest_length

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


@dataclass(frozen=True, kw_only=True)
class TendonSettings(StringSettings):
    """Numerical settings of the tendon variants that use MuJoCo's step as a leapfrog step ."""

    friction_time_constant: float
    """Time constant with which a held string comes to rest [s]; MuJoCo's `solreffriction`.

    With two time steps, the string stops within one.
    """
    rest_speed: float = 1e-5
    """Below this speed [m/s] the heavy mass counts as at rest; a held string creeps at 1e-6 m/s or less."""
    catch_time: float = 2e-3
    """Time constant with which the excess length of a late catch is taken back [s].

    A slack string becomes taut within a step, but the engine notices at its end, when the string is already too long.
    """
    switch_up: float = SWITCH_UP
    """Wrap angle above k pi at which tendon k is replaced by the next [rad]."""
    switch_down: float = SWITCH_DOWN
    """Wrap angle above k pi at which tendon k is replaced by the previous one [rad]."""
    corrections: bool = True
    """Whether the adapter corrects what MuJoCo leaves out: the string's turning, half a step of velocity, a late catch."""


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
        winding=WRAPPED_TENDON,
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
        known_failures={
            "follows_the_reference_past_the_halt_and_a_full_turn": "measured 121 mm off at 0.39 s: it does not halt it",
        },
        main=False,
    ),
    "defaults": _abilities(
        "defaults",
        "no friction on the rod, every solver setting left as it comes",
        limits=(
            "without friction the heavy mass never halts",
            "MuJoCo's step of 2 ms is halved, so that samples fall on steps",
        ),
        known_failures={
            "held_pendulum_swings_to_the_other_side": "measured 6 % of the fall's energy off: the string stretches",
            "string_keeps_its_length": "measured 1.8 mm in 0.15 s, where 1 mm is allowed: a string with a time constant of "
            "20 ms",
            "runs_to_its_end": "the string stretches by more than its budget before the light mass is at the rod",
            "release_has_the_exact_acceleration": "measured a start 0.58 ms early: half of Euler's step of 1 ms, and a soft "
            "string",
        },
        main=False,
    ),
}
"""Variant -> what it can do."""


class MujocoTendon(TunedEngine):
    """MuJoCo with the string as a spatial tendon over a cylinder.

    Parameters
    ----------
    variant
        "documented": no friction between string and rod, because MuJoCo documents none for a tendon.
        "capstan": the friction bound of the effects' string laws acts on the heavy mass's slide.
        "frictionloss": a constant friction loss, the only friction that MuJoCo has for tendons.
        "defaults": as documented, with the solver's default settings.
    friction_size
        Size of the constant friction loss of "frictionloss".
    """

    name = "mujoco"
    distribution = "mujoco"
    variant = "capstan"
    variants = _ABILITIES
    settings_by_profile = SETTINGS | {("defaults", profile): MUJOCO_DEFAULTS for profile in Profile}
    settings: TendonSettings

    def __init__(self, *, friction_size: FrictionSize = FrictionSize.AT_RELEASE, **chosen: Any) -> None:
        super().__init__(**chosen)
        self.friction_size = friction_size

    def build(self, scenario: Scenario) -> TendonRig:
        """Rebuild the scenario's apparatus at the moment of release."""
        constant = self.variant == "frictionloss"
        return TendonRig(
            scenario.parameters,
            self.settings,
            self.end_length(scenario),
            capstan=self.variant == "capstan",
            friction_loss=friction_loss(scenario.parameters, self.friction_size) if constant else 0.0,
        )

    def studies(self) -> Studies:
        """Return the studies: step and softness; MuJoCo's defaults; the choices of winding, catching and constant friction."""
        s, with_friction = self.settings, self.variant in ("capstan", "frictionloss")
        constants = ("string_time_constant", "friction_time_constant")[: 2 if with_friction else 1]
        softness = [softness_rungs(name, s.time_step) for name in constants]
        if self.variant == "defaults":  # it has nothing but defaults
            return studies_from_rows(self, ladders=(step_rungs(()), *softness))
        friction = time_constant_default(
            s, "friction_time_constant", "solreffriction", "how fast string that is held comes to rest"
        )
        studies = studies_from_rows(
            self,
            ladders=(step_rungs(constants), *softness),
            defaults=(*string_defaults(s), *((friction,) if with_friction else ())),
            choices=(
                (
                    "wrap angle at which the next tendon takes over",
                    f"{math.degrees(s.switch_up):.0f} deg above k pi",
                    "225 deg above k pi",
                    {"switch_up": math.radians(225)},
                ),
                (
                    "wrap angle at which the last tendon takes over",
                    f"{math.degrees(s.switch_down):.0f} deg above k pi",
                    "5 deg above k pi",
                    {"switch_down": math.radians(5)},
                ),
                (
                    "time in which a late catch is taken back",
                    quantity(s.catch_time, "s", 3),
                    quantity(5 * s.catch_time, "s", 3),
                    {"catch_time": 5 * s.catch_time},
                ),
                (
                    "what MuJoCo leaves out (l omega^2 in the string's acceleration, half a step of velocity)",
                    "made up for",
                    "left out",
                    {"corrections": False},
                ),
            ),
        )
        if self.variant != "frictionloss":
            return studies
        ours = self.friction_size
        other = FrictionSize.AT_RELEASE if ours is FrictionSize.EQUAL_WORK else FrictionSize.EQUAL_WORK
        engine = MujocoTendon(variant=self.variant, profile=self.profile, settings=s, friction_size=other)
        choice = AdapterChoice(what="size of the constant friction", ours=ours.value, instead=other.value, engine=engine)
        return dataclasses.replace(studies, choices=(*studies.choices, choice))
