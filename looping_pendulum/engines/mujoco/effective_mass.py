"""MuJoCo variants with the capstan law as an effective heavy mass, on a spatial tendon or in the string's own coordinates.

The capstan law makes the heavy mass's equation M2 a = T1 E - M2 g + F, with E = exp(-sign(v2) x) and x the sum of the effects'
exponents. Divided by E it is that of a mass M2 / E that hangs on the light side's tension T1 and is pulled by (F - M2 g) / E,
without friction. So it needs no friction constraint, which would be soft. A stop ends the sliding; the rig locates it within
the step, and from there the rod holds the string if it can.
"""

from __future__ import annotations

import abc
import math
from dataclasses import dataclass
from enum import Enum
from typing import Any

from looping_pendulum.engines.chain import NO_STOP
from looping_pendulum.engines.mujoco.model import (
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
)
from looping_pendulum.engines.protocol import (
    FORCES_AND_RELEASE,
    Abilities,
    Profile,
    TunedEngine,
)
from looping_pendulum.engines.shipped import shipped_abilities
from looping_pendulum.engines.studies import Studies, default_row, studies_from_rows
from looping_pendulum.reference_ode import effects
from looping_pendulum.reference_ode.effects import EffectKind, Kinematics
from looping_pendulum.reference_ode.geometry import light_position, next_string_coordinates
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.runs.trajectory import Supplier, Supply
from looping_pendulum.scenarios.scenario import Scenario

LOCK_ROW = 0
"""Index of the only equality constraint, which locks the heavy mass, and of its constraint row while it is active.

The string is the last constraint row.
"""
MAX_TURN_PER_STEP = 0.25
"""Largest angle by which the string may turn in one step [rad].

As it winds up it turns ever faster, and a Runge-Kutta step beyond 1 rad is meaningless for a string that turns about the rod.
"""
MAX_MOTION_CHANGES = 8
"""Largest number of changes of motion that are located within one step.

More changes mean that the string rattles; the rest of the step is then taken without splitting.
"""


@dataclass(frozen=True, kw_only=True)
class EffectiveMassSettings(StringSettings):
    """Numerical settings of the variants with friction as a factor on the heavy mass."""

    integrator: str = "RK4"
    simple: str = "false"
    """MuJoCo's attribute `simple` of the heavy body; with "auto" MuJoCo silently keeps the mass with which it was compiled."""
    catch_time: float = 2e-3
    """Time constant with which the stretch of a string that has become taut is taken back [s]."""
    split_steps: bool = True
    """Whether a step in which the string stops, yields or becomes taut is split there; otherwise the change is at its end."""
    corrections: bool = True
    """Whether the adapter compensates for the string's turning, which MuJoCo leaves out of a spatial tendon's acceleration."""


class EffectiveMassMotion(Enum):
    """Motion of the string on the rod; the value of `UP` and `DOWN` is the sign of the heavy mass's velocity."""

    FREE = 0
    """No friction acts: there is no string, or the heavy mass is clamped."""
    UP = 1
    """The heavy mass rises."""
    DOWN = -1
    """The heavy mass falls."""
    STICKING = 2
    """The rod holds the string, and the heavy mass is locked."""


class EffectiveMassRig(StringRig, abc.ABC):
    """The apparatus in MuJoCo, with a heavy mass that changes at every step; a subclass defines the light mass's coordinates.

    An equality constraint of its model locks the heavy mass.
    """

    def __init__(self, parameters: Parameters, settings: EffectiveMassSettings, xml: str, end_length: float) -> None:
        p = parameters
        super().__init__(p, settings, xml, end_length)
        self._passive_force = self._data.qfrc_passive
        self._split = settings.split_steps
        self._values, self._effects = p.values(), p.effects
        self._weight = p.heavy_mass * p.coefficients["gravity"]
        self._heavy_body = self._mujoco.mj_name2id(self._model, self._mujoco.mjtObj.mjOBJ_BODY, "heavy")
        self._mass_ratio = 1.0
        self._motion = EffectiveMassMotion.FREE
        self._catch_time = settings.catch_time
        self._catch_stretch, self._last_stretch = 0.0, 0.0
        self._substeps, self._time_constants = 1, self._model.tendon_solref_lim[:, 0].copy()

    @abc.abstractmethod
    def _light_mass_state(self, ahead: float = 0.0) -> tuple[float, float, float, float]:
        """Return x, y [m], vx, vy [m/s] of the light mass, extrapolated by ``ahead`` [s] to first order."""

    @abc.abstractmethod
    def _string_coordinates(self, ahead: float = 0.0) -> tuple[float, float]:
        """Return free length [m] and wrap angle [rad] of the taut string, extrapolated by ``ahead`` [s] to first order."""

    @abc.abstractmethod
    def _generalized_force(self, fx: float, fy: float) -> tuple[float, float]:
        """Return a force on the light mass [N] as the generalized force of its two degrees of freedom."""

    @abc.abstractmethod
    def _prepare(self, kinematics: Kinematics) -> None:
        """Set the string's length limit for a step, given ``kinematics`` at its middle."""

    def advance(self) -> None:
        """Step through one sample interval, or less if the light mass reaches the rod."""
        self._mujoco.set_mjcb_passive(self._passive)  # a callback of the whole process, so it is set only during the steps
        try:
            for _ in range(self._steps):
                parts = self._substep_count()
                if parts != self._substeps:
                    # As many substeps as before: a softer string would be stretched as it turns
                    self._substeps = parts
                    self._model.tendon_solref_lim[:, 0] = self._time_constants / parts
                for _ in range(parts):
                    if self._string_coordinates()[0] <= self._end_length:
                        return
                    self._advance_step(self._dt / parts)
        finally:
            self._mujoco.set_mjcb_passive(None)

    def _read_motion(self) -> tuple[float, ...]:
        return (*self._light_mass_state(), self._heavy_speed())

    def _initialise(self) -> None:
        """Determine the motion of the string at release; a subclass calls it after setting its coordinates."""
        if not self._held:
            self._qvel[HEAVY_DOF] = self._at_release.heavy_velocity[1]
        if self._has_string and not self._held:
            # `_update_motion` asks MuJoCo for forces, to which those of the effects belong
            self._mujoco.set_mjcb_passive(self._passive)
            try:
                self._update_motion()
            finally:
                self._mujoco.set_mjcb_passive(None)

    def _substep_count(self) -> int:
        """Return the number of substeps of the coming step, in each of which the string turns by `MAX_TURN_PER_STEP` at most.

        On a rod thicker than the free length, a turn winds up more string than is left; there the limit applies to the wound
        length as a fraction of the free length.
        """
        length = self._string_coordinates()[0]
        if not self._has_string or length <= self._end_length:
            return 1
        _, _, vx, vy = self._light_mass_state()
        turn = self._dt * math.hypot(vx, vy) / length * max(self._parameters.rod_radius / length, 1.0)
        # A run that breaks down is left to `read`
        return max(math.ceil(turn / MAX_TURN_PER_STEP), 1) if math.isfinite(turn) else 1

    def _advance_step(self, length: float) -> None:
        """Take one step of ``length`` [s], split where the motion changes within it.

        A change is a stop, a slip onset, or a slack string that becomes taut.
        """
        spare, margins = self._slack_length(), self._margins()
        for _ in range(MAX_MOTION_CHANGES):
            saved = (self._data.time, self._qpos.copy(), self._qvel.copy())
            self._engine_step(length)
            spare_after, margins_after = self._slack_length(), self._margins()
            caught = _zero_crossing_fraction(spare, spare_after) if spare > SLACK_LENGTH else 1.0
            changed = min(map(_zero_crossing_fraction, margins, margins_after))
            share = min(caught, changed)
            if share >= 1:
                return
            if self._split:
                self._data.time, self._qpos[:], self._qvel[:] = saved
                if share > 0:
                    self._engine_step(share * length)
            if changed <= caught:
                self._update_motion()
            else:
                # From here on the string stops the masses by its stretch.
                self._catch_stretch = self._last_stretch = SLACK_LENGTH
            if not self._split:
                return
            length *= 1 - share
            # A string that was just caught is exactly at its rest length
            spare, margins = self._slack_length() if changed <= caught else 0.0, self._margins()
        self._engine_step(length)

    def _engine_step(self, length: float) -> None:
        """Let MuJoCo take a step of ``length`` [s], with the heavy mass of its middle."""
        self._decay_catch_stretch(length)
        middle = self._kinematics(0.5 * length)
        self._mass_ratio = 1.0
        if self._motion in (EffectiveMassMotion.UP, EffectiveMassMotion.DOWN):
            exponent = max(effects.sliding_exponent(math, middle, self._values, self._effects), 0.0)
            self._mass_ratio = math.exp(self._motion.value * exponent)
        self._set_mass()
        self._prepare(middle)
        self._model.opt.timestep = length
        self._mujoco.mj_step(self._model, self._data)

    def _decay_catch_stretch(self, length: float) -> None:
        """Allow the stretch of a string that has just become taut: as it is while it grows, then decaying exponentially.

        Pulling it back at once would throw the light mass off the string again.
        """
        if self._catch_stretch > 0.0:
            excess = self._stretch()
            decayed = self._catch_stretch * math.exp(-length / self._catch_time)
            self._catch_stretch = excess if excess > self._last_stretch else decayed if decayed > TAUT_MARGIN else 0.0
            self._last_stretch = excess

    def _set_mass(self) -> None:
        """Give MuJoCo's model the effective heavy mass."""
        if not self._held:
            self._model.body_mass[self._heavy_body] = self._parameters.heavy_mass * self._mass_ratio

    def _kinematics(self, ahead: float) -> Kinematics:
        """Return the kinematics on which the effects depend, extrapolated by ``ahead`` [s] to first order."""
        _, _, vx, vy = self._light_mass_state(ahead)
        length, angle = self._string_coordinates(ahead)
        heavy = self._heavy_speed() + (0.0 if self._held else ahead * float(self._qacc[HEAVY_DOF]))
        return kinematics(self._data.time + ahead, length, angle, vx, vy, heavy)

    def _passive(self, model: Any, data: Any) -> None:
        """Apply the effects' forces; MuJoCo calls this at every stage of its integrator."""
        # The callback is called for any model that this process steps
        if self._force is None or model is not self._model:
            return
        x, y, vx, vy = self._light_mass_state()
        fx, fy, heavy = self._force(data.time, x, y, vx, vy, self._heavy_speed())
        first, second = self._generalized_force(fx, fy)
        passive = self._passive_force  # element by element, because NumPy's slices take longer than the sums
        passive[0] += first
        passive[1] += second
        if not self._held:
            passive[HEAVY_DOF] += heavy * self._mass_ratio

    def _slack_length(self) -> float:
        """Return how much shorter than its rest length the string is [m]; negative if it is stretched."""
        return -self._stretch() if self._has_string else 0.0

    def _margins(self) -> tuple[float, float]:
        """Return two event functions that fall below 0 where sliding or sticking ends."""
        if self._motion is EffectiveMassMotion.FREE:
            return math.inf, math.inf
        if self._motion is EffectiveMassMotion.STICKING:
            return self._holding_margins()
        return self._motion.value * self._heavy_speed(), math.inf

    def _holding_margins(self) -> tuple[float, float]:
        """Return the reserve with which the rod holds the locked heavy mass against falling and against rising [N]."""
        k = self._kinematics(0.0)
        self._prepare(k)
        self._mujoco.mj_forward(self._model, self._data)
        rows = self._data.efc_force
        light_tension = max(float(rows[-1]), 0.0) if len(rows) > LOCK_ROW + 1 else 0.0
        held = self._weight
        if self._force is not None:
            x, y, vx, vy = self._light_mass_state()
            held -= self._force(self._data.time, x, y, vx, vy, 0.0)[2]
        bound = math.exp(max(effects.holding_exponent(math, k, self._values, self._effects), 0.0))
        return light_tension * bound - held, held - light_tension / bound

    def _update_motion(self) -> None:
        """Determine the motion of the string from here on: it slides as the heavy mass moves or is pulled, or it sticks."""
        # Before the first call the velocity is exactly that of the release: 0 unless there is a push.
        if self._motion is EffectiveMassMotion.FREE and self._heavy_speed() != 0.0:
            self._motion = EffectiveMassMotion.UP if self._heavy_speed() > 0 else EffectiveMassMotion.DOWN
            return
        if self._held:
            return
        # Stopped and locked first, as only the tensions at rest tell whether the rod can hold the string
        self._qvel[HEAVY_DOF] = 0.0
        self._motion, self._mass_ratio = EffectiveMassMotion.STICKING, 1.0
        self._set_mass()
        # MuJoCo counts the locked coordinate from the joint's position in the model
        self._model.eq_data[LOCK_ROW, 0] = float(self._qpos[HEAVY_DOF] - self._model.qpos0[HEAVY_DOF])
        self._data.eq_active[LOCK_ROW] = 1
        falls, rises = self._holding_margins()
        if falls < 0 or rises < 0:
            self._motion = EffectiveMassMotion.DOWN if falls < 0 else EffectiveMassMotion.UP
            self._data.eq_active[LOCK_ROW] = 0

    def _heavy_speed(self) -> float:
        """Return the upward velocity of the heavy mass [m/s]."""
        return 0.0 if self._held else float(self._qvel[HEAVY_DOF])

    def _stretch(self) -> float:
        """Return how much longer than its rest length the string is [m]; negative if it is slack."""
        length, angle = self._string_coordinates()
        p = self._parameters
        return length + p.rod_radius * angle - self._heavy_height() - p.string_length


def _zero_crossing_fraction(before: float, after: float) -> float:
    """Return the fraction of a step at which a value, ``before`` and ``after`` the step, falls below 0; 1 if it does not."""
    if not after < 0:
        return 1.0
    return before / (before - after) if before > 0 else 0.0


class TendonMassRig(EffectiveMassRig):
    """The rig with two slides for the light mass and two tendons, used in turn, for the string."""

    def __init__(self, parameters: Parameters, settings: EffectiveMassSettings, end_length: float) -> None:
        super().__init__(parameters, settings, model_xml(parameters, settings, simple=settings.simple), end_length)
        self._wrap_angle = parameters.release_angle
        # MuJoCo leaves the string's turning (l omega^2) out of a tendon's acceleration. The string's length limit is shifted by
        # the amount that pulls equally strongly.
        softness = settings.impedance * settings.string_time_constant
        self._turning_shift = softness * softness if settings.corrections else 0.0
        self._tendons = AlternatingTendons(parameters, self._model, SWITCH_UP, SWITCH_DOWN) if self._has_string else None
        self._qvel[:HEAVY_DOF] = self._at_release.light_velocity
        self._initialise()

    def _light_mass_state(self, ahead: float = 0.0) -> tuple[float, float, float, float]:
        x, y, *_ = self._qpos.tolist()
        vx, vy, *_ = self._qvel.tolist()
        ax, ay, *_ = self._qacc.tolist()
        return x + ahead * vx, y + ahead * vy, vx + ahead * ax, vy + ahead * ay

    def _string_coordinates(self, ahead: float = 0.0) -> tuple[float, float]:
        x, y, _, _ = self._light_mass_state(ahead)
        free_length, self._wrap_angle = next_string_coordinates(x, y, self._parameters.rod_radius, self._wrap_angle)
        return free_length, self._wrap_angle

    def _generalized_force(self, fx: float, fy: float) -> tuple[float, float]:
        return fx, fy

    def _prepare(self, kinematics: Kinematics) -> None:
        if self._tendons is not None:
            self._tendons.select(kinematics.wrap_angle)
            transverse_speed = kinematics.across_speed
            # Substeps divide the time constant, of which the shift is the square
            shift = self._turning_shift / (self._substeps * self._substeps)
            self._tendons.allow_extra_length(
                self._catch_stretch - TAUT_MARGIN - shift * transverse_speed * transverse_speed / kinematics.free_length
            )


ANGLE_DOF, LENGTH_DOF = 0, 1
"""Degrees of freedom of the light mass: the hinge's wrap angle and the slide's free length."""
NEGLIGIBLE_INERTIA = 'mass="1e-9" diaginertia="1e-13 1e-13 1e-13"'
"""Inertia of the arm that turns with the string. MuJoCo requires one; the light mass at 4 mm has 10^6 times as much."""


def drum_xml(parameters: Parameters, settings: EffectiveMassSettings) -> str:
    """Return the MuJoCo model (MJCF); at wrap angle 0 the string leaves the rod's right edge straight upwards."""
    p, s = parameters, settings
    held, string = p.release is Release.HELD, p.release is not Release.DROP
    heavy_joint = f'<joint name="heavy_y" type="slide" axis="0 0 1" ref="{-p.hanging_length!r}"/>'
    heavy_coordinate = '<joint joint="heavy_y" coef="-1"/>'
    # The limit's lower end, -1 m, is out of reach: a range needs one, while a string only pulls
    max_sum = p.string_length - (p.hanging_length if held else 0.0)
    lock = f'<joint name="lock" joint1="heavy_y" active="false" solref="{s.string_time_constant!r} 1" solimp="{s.solimp}"/>'
    return f"""
<mujoco model="looping pendulum, drum">
  <compiler angle="radian"/>
  {s.option(p.coefficients["gravity"])}
  <worldbody>
    <body name="arm">
      <joint name="wrap_angle" type="hinge" axis="0 -1 0"/>
      <inertial pos="0 0 0" {NEGLIGIBLE_INERTIA}/>
      <body name="light" pos="{p.rod_radius!r} 0 0">
        <joint name="free_length" type="slide" axis="0 0 1"/>
        <inertial pos="0 0 0" mass="{p.light_mass!r}" diaginertia="1e-13 1e-13 1e-13"/>
      </body>
    </body>
    <body name="heavy" pos="{p.rod_radius!r} 0 {-p.hanging_length!r}" simple="{s.simple}">
      {"" if held else heavy_joint}
      <inertial pos="0 0 0" mass="{p.heavy_mass!r}" diaginertia="1e-6 1e-6 1e-6"/>
    </body>
  </worldbody>
  <tendon>
    <fixed name="string" limited="{"true" if string else "false"}" range="-1 {max_sum!r}"
           solreflimit="{s.string_time_constant!r} 1" solimplimit="{s.solimp}">
      <joint joint="free_length" coef="1"/><joint joint="wrap_angle" coef="{p.rod_radius!r}"/>
      {"" if held else heavy_coordinate}
    </fixed>
  </tendon>
  <equality>{"" if held else lock}</equality>
</mujoco>"""


class DrumRig(EffectiveMassRig):
    """The rig in the string's own coordinates: the wrap angle is a hinge, the free length a slide, the string a fixed tendon.

    A fixed tendon's length is a linear combination of joint coordinates, here free length + R wrap angle - heavy mass's height.
    Its Jacobian is constant, so MuJoCo leaves nothing out of its acceleration, and full turns need not be counted.
    """

    def __init__(self, parameters: Parameters, settings: EffectiveMassSettings, end_length: float) -> None:
        super().__init__(parameters, settings, drum_xml(parameters, settings), end_length)
        self._radius = parameters.rod_radius
        self._length_range = self._model.tendon_range
        self._max_sum = float(self._length_range[0, 1])
        self._qpos[ANGLE_DOF], self._qpos[LENGTH_DOF] = parameters.release_angle, parameters.free_length
        cosine, sine = math.cos(parameters.release_angle), math.sin(parameters.release_angle)
        vx, vy = self._at_release.light_velocity
        angle_rate = -(vx * cosine + vy * sine) / parameters.free_length
        self._qvel[ANGLE_DOF], self._qvel[LENGTH_DOF] = angle_rate, vy * cosine - vx * sine - self._radius * angle_rate
        self._initialise()

    def _light_mass_state(self, ahead: float = 0.0) -> tuple[float, float, float, float]:
        length, angle = self._string_coordinates(ahead)
        angle_rate, length_rate, *_ = self._qvel.tolist()
        angle_acceleration, length_acceleration, *_ = self._qacc.tolist()
        angle_rate, length_rate = angle_rate + ahead * angle_acceleration, length_rate + ahead * length_acceleration
        x, y = light_position(math, max(length, 0.0), angle, self._radius)  # below 0 the step ended inside the rod
        cosine, sine = math.cos(angle), math.sin(angle)
        return x, y, -angle_rate * y - length_rate * sine, angle_rate * x + length_rate * cosine

    def _string_coordinates(self, ahead: float = 0.0) -> tuple[float, float]:
        angle, length, *_ = self._qpos.tolist()
        angle_rate, length_rate, *_ = self._qvel.tolist()
        return length + ahead * length_rate, angle + ahead * angle_rate

    def _generalized_force(self, fx: float, fy: float) -> tuple[float, float]:
        length, angle = self._string_coordinates()
        x, y = light_position(math, length, angle, self._radius)
        return fy * x - fx * y, fy * math.cos(angle) - fx * math.sin(angle)

    def _prepare(self, kinematics: Kinematics) -> None:
        self._length_range[0, 1] = self._max_sum + self._catch_stretch - TAUT_MARGIN


SETTINGS = {
    # With a time constant of two steps, the smallest that MuJoCo accepts, a turning string is too stiff for Runge-Kutta: its
    # error is 50 times that with five steps.
    ("effective_mass", Profile.QUICK): EffectiveMassSettings(time_step=5e-4, string_time_constant=2.5e-3),
    ("effective_mass", Profile.ACCURATE): EffectiveMassSettings(time_step=1e-4, string_time_constant=5e-4),
    ("drum", Profile.QUICK): EffectiveMassSettings(time_step=1e-3, string_time_constant=2e-3),
    ("drum", Profile.ACCURATE): EffectiveMassSettings(time_step=1e-4, string_time_constant=2e-4),
}
"""Variant and profile -> settings."""


def _abilities(variant: str, winding: str | Supply, string: str, *limits: str) -> Abilities:
    """Return the abilities of a variant with this ``string``."""
    friction = "heavy mass times exp(sign(v2) mu theta), which is the capstan law while it slides"
    stick_slip = "finds the stop within the step and locks the heavy mass while the rod can hold it"
    return shipped_abilities(
        f"mujoco:{variant}",
        effect_kinds=FORCES_AND_RELEASE | {EffectKind.STRING_LAW},
        winding=winding,
        friction_law=Supply(by=Supplier.ADAPTER, how=friction),
        stick_slip=Supply(by=Supplier.ADAPTER, how=stick_slip),
        summary=f"{string}, friction as a factor on the heavy mass.",
        limits=(
            "the pull of a string that becomes taut has friction the way the heavy mass moved before; the reference: the way "
            "after",
            NO_STOP,
            *limits,
        ),
        main=False,
    )


_ABILITIES = {
    "effective_mass": _abilities(
        "effective_mass",
        WRAPPED_TENDON,
        "Two spatial tendons used in turn over a cylinder",
    ),
    "drum": _abilities(
        "drum",
        Supply(
            by=Supplier.ADAPTER,
            how="wrap angle and free length are the joints, and the fixed tendon adds them up: l + R theta + h",
        ),
        "Hinge, slide and fixed tendon for the string's own coordinates",
        "the winding is put in by hand, so it tests MuJoCo's mechanics and nothing of its strings",
    ),
}
"""Variant -> what it can do."""


class MujocoEffectiveMass(TunedEngine):
    """MuJoCo with the capstan law as a factor on the heavy mass.

    The variants are called after the coordinates of the light mass: "effective_mass" for x and y, where the string is a spatial
    tendon, or "drum" for wrap angle and free length, where it is a fixed tendon.
    """

    name = "mujoco"
    distribution = "mujoco"
    variant = "effective_mass"
    variants = _ABILITIES
    settings_by_profile = SETTINGS
    settings: EffectiveMassSettings

    def build(self, scenario: Scenario) -> EffectiveMassRig:
        """Rebuild the scenario's apparatus at the moment of release."""
        rig = DrumRig if self.variant == "drum" else TendonMassRig
        return rig(scenario.parameters, self.settings, self.end_length(scenario))

    def studies(self) -> Studies:
        """Return the studies: step and softness; MuJoCo's defaults; splitting of steps, and the adapter's corrections."""
        s = self.settings
        turning = (
            "what MuJoCo leaves out (l omega^2 in the string's acceleration)",
            "made up for",
            "left out",
            {"corrections": False},
        )
        return studies_from_rows(
            self,
            ladders=(
                step_rungs(("string_time_constant",), round(s.string_time_constant / s.time_step)),
                softness_rungs("string_time_constant", s.time_step),
            ),
            defaults=(
                *string_defaults(s),
                default_row(
                    s,
                    "simple",
                    "auto",
                    "body simple",
                    "whether a body that only slides keeps the mass that it was compiled with",
                ),
            ),
            choices=(
                (
                    "a step in which the motion changes",
                    "taken in two",
                    "taken as one, the change at its end",
                    {"split_steps": False},
                ),
                *(() if self.variant == "drum" else (turning,)),
            ),
        )
