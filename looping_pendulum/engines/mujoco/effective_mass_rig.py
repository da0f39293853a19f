"""Rigs in which friction is no force but a factor on the heavy mass, exact while the string slides.

The capstan law makes the heavy mass's equation M2 a = T1 E - M2 g + F, with E = exp(-sign(v2) x) and x the sum of the effects'
exponents. Divided by E it is that of a mass M2 / E that hangs on the light side's tension T1 and is pulled by (F - M2 g) / E,
without friction. So no friction constraint is needed, nor its softness. A stop ends the sliding; the rig finds it within the
step, and there the rod holds the string if it can.
"""

from __future__ import annotations

import abc
import math
from enum import Enum
from typing import Any

from looping_pendulum.engines.mujoco.tendon_model import EffectiveMassSettings
from looping_pendulum.engines.mujoco.winding import TAUT
from looping_pendulum.engines.protocol import steps_per_sample
from looping_pendulum.reference_ode import effects
from looping_pendulum.reference_ode.cartesian import cartesian_force, release_velocity
from looping_pendulum.reference_ode.effects import Kinematics
from looping_pendulum.reference_ode.parameters import Parameters, Release

HEAVY = 2
"""Degree of freedom of the heavy mass, after the light mass's two; a held heavy mass has none."""
LOCK = 0
"""The one equality constraint, which holds the heavy mass. Active it is the first constraint row; the string is the last."""
SLACK = 1e-6
"""A string with this much length to spare [m] counts as slack."""
MOST_TURN = 0.25
"""Angle that the string may turn by in one step [rad]: as it winds up it turns ever faster, and beyond 1 rad a Runge-Kutta step
of a string that may only bend along its circle is no step of it."""
MAX_PARTS = 8
"""Changes of motion within one step; more means that the string rattles, and the rest of the step is taken as it comes."""


class EffectiveMassMotion(Enum):
    """What the string does on the rod."""

    FREE = 0
    """Nothing that friction acts on: no string, or a clamped heavy mass."""
    UP = 1
    """The heavy mass rises."""
    DOWN = -1
    STICKING = 2


class EffectiveMassRig(abc.ABC):
    """The apparatus in MuJoCo, its heavy mass changed at every step. A subclass knows the light mass's coordinates.

    Parameters
    ----------
    parameters, settings
        Physics and numerics.
    xml
        The model: the light mass's two degrees of freedom, the heavy one's, and a lock for that.
    end_length
        Free length [m] below which the rig stands still.
    """

    def __init__(self, parameters: Parameters, settings: EffectiveMassSettings, xml: str, end_length: float) -> None:
        import mujoco

        p = parameters
        self._mujoco: Any = mujoco
        self._model: Any = mujoco.MjModel.from_xml_string(xml)
        self._data: Any = mujoco.MjData(self._model)
        self._qpos, self._qvel, self._qacc = self._data.qpos, self._data.qvel, self._data.qacc
        self._qfrc = self._data.qfrc_passive
        warnings = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
        self._breakdowns = tuple(self._data.warning[kind] for kind in warnings)
        self._dt, self._steps = settings.time_step, steps_per_sample(settings.time_step)
        self._split = settings.split_steps
        self._parameters, self._values, self._effects = p, p.values(), p.effects
        self._weight = p.heavy_mass * p.coefficients["gravity"]
        self._has_string, self._held = p.release is not Release.DROP, p.release is Release.HELD
        self._heavy_body = mujoco.mj_name2id(self._model, mujoco.mjtObj.mjOBJ_BODY, "heavy")
        self._end_length = end_length if self._has_string else -math.inf
        self._force = cartesian_force(p)
        self._factor = 1.0
        self._motion = EffectiveMassMotion.FREE
        self._catch_time = settings.catch_time
        self._caught, self._last_excess = 0.0, 0.0
        self._divided, self._time_constants = 1, self._model.tendon_solref_lim[:, 0].copy()
        self._release_velocity = release_velocity(p)

    @abc.abstractmethod
    def _light(self, ahead: float = 0.0) -> tuple[float, float, float, float]:
        """Position [m] and velocity [m/s] of the light mass, x, y, vx, vy, ``ahead`` [s] of now to first order."""

    @abc.abstractmethod
    def _string(self, ahead: float = 0.0) -> tuple[float, float]:
        """Free length [m] and wrap angle [rad] of the taut string, ``ahead`` [s] of now to first order."""

    @abc.abstractmethod
    def _generalized(self, fx: float, fy: float) -> tuple[float, float]:
        """Force on the light mass [N] in the light mass's two degrees of freedom."""

    @abc.abstractmethod
    def _prepare(self, kinematics: Kinematics) -> None:
        """Make the string ready for a step, given ``kinematics`` at its middle."""

    def advance(self) -> None:
        """Step through one sample interval, or less if the light mass reaches the rod."""
        self._mujoco.set_mjcb_passive(self._passive)  # one for the whole process, so it is ours only while we step
        try:
            for _ in range(self._steps):
                parts = self._parts()
                self._stiffen(parts)
                for _ in range(parts):
                    if self._string()[0] <= self._end_length:
                        return
                    self._advance_step(self._dt / parts)
        finally:
            self._mujoco.set_mjcb_passive(None)

    def read(self) -> tuple[float, ...]:
        """Positions [m], velocities [m/s] and string stretch [m]: `COLUMNS` without the time."""
        if any(warning.number for warning in self._breakdowns):
            return (math.nan,) * 9  # MuJoCo only warns, and what follows looks like motion
        x, y, vx, vy = self._light()
        stretch = self._excess() if self._has_string else math.nan
        return (x, y, vx, vy, self._parameters.rod_radius, self._heavy_height(), 0.0, self._heavy_speed(), stretch)

    def _start(self) -> None:
        """Decide what the string does at release; a subclass calls it once its coordinates are set."""
        if not self._held:
            self._qvel[HEAVY] = self._release_velocity[2]
        if self._has_string and not self._held:
            self._mujoco.set_mjcb_passive(self._passive)
            try:
                self._change()
            finally:
                self._mujoco.set_mjcb_passive(None)

    def _parts(self) -> int:
        """In how many parts the coming step is taken: the string turns by `MOST_TURN` at most in each.

        On a thick rod a turn of so much takes more than the free string that is left: there it is that share of the string.
        """
        length = self._string()[0]
        if not self._has_string or length <= self._end_length:
            return 1
        _, _, vx, vy = self._light()
        turn = self._dt * math.hypot(vx, vy) / length * max(self._parameters.rod_radius / length, 1.0)
        return max(math.ceil(turn / MOST_TURN), 1) if math.isfinite(turn) else 1

    def _stiffen(self, parts: int) -> None:
        """Let the string return to its length as fast, in steps, when steps are divided: a soft one flies wide as it turns."""
        if parts != self._divided:
            self._divided = parts
            self._model.tendon_solref_lim[:, 0] = self._time_constants / parts

    def _advance_step(self, length: float) -> None:
        """Take one step of ``length`` [s], in parts where the motion changes within it."""
        spare, margins = self._spare(), self._margins()
        for _ in range(MAX_PARTS):
            saved = (self._data.time, self._qpos.copy(), self._qvel.copy())
            self._take(length)
            spare_after, margins_after = self._spare(), self._margins()
            caught = _share(spare, spare_after) if spare > SLACK else 1.0
            changed = min(map(_share, margins, margins_after))
            share = min(caught, changed)
            if share >= 1:
                return
            if self._split:
                self._data.time, self._qpos[:], self._qvel[:] = saved
                if share > 0:
                    self._take(share * length)
            if changed <= caught:
                self._change()
            else:
                self._caught = self._last_excess = SLACK  # from here on the string is being caught
            if not self._split:
                return
            length *= 1 - share
            spare, margins = self._spare() if changed <= caught else 0.0, self._margins()
        self._take(length)

    def _take(self, length: float) -> None:
        """Let the engine take a step of ``length`` [s]."""
        self._take_back(length)
        middle = self._kinematics(0.5 * length)
        self._factor = self._mass_factor(middle)
        self._set_mass()
        self._prepare(middle)
        self._model.opt.timestep = length
        self._mujoco.mj_step(self._model, self._data)

    def _take_back(self, length: float) -> None:
        """Allow the stretch of a catch, while it grows as it is, then less and less.

        Pulling it back at once would throw the light mass off the string again.
        """
        if self._caught > 0.0:
            excess = self._excess()
            decayed = self._caught * math.exp(-length / self._catch_time)
            self._caught = excess if excess > self._last_excess else decayed if decayed > TAUT else 0.0
            self._last_excess = excess

    def _set_mass(self) -> None:
        if not self._held:
            self._model.body_mass[self._heavy_body] = self._parameters.heavy_mass * self._factor

    def _mass_factor(self, k: Kinematics) -> float:
        """1 / E: what the heavy mass is multiplied by."""
        if self._motion not in (EffectiveMassMotion.UP, EffectiveMassMotion.DOWN):
            return 1.0
        exponent = max(effects.sliding_exponent(math, k, self._values, self._effects), 0.0)
        return math.exp(self._motion.value * exponent)

    def _kinematics(self, ahead: float) -> Kinematics:
        """What the effects depend on, ``ahead`` [s] of now to first order."""
        _, _, vx, vy = self._light(ahead)
        length, angle = self._string(ahead)
        cosine, sine = math.cos(angle), math.sin(angle)
        retreat, across = vy * cosine - vx * sine, -(vx * cosine + vy * sine)
        heavy = self._heavy_speed() + (0.0 if self._held else ahead * float(self._qacc[HEAVY]))
        speed = math.hypot(vx, vy)
        return Kinematics(self._data.time + ahead, length, angle, retreat, across, abs(across), speed, heavy, abs(heavy))

    def _passive(self, model: Any, data: Any) -> None:
        """Apply the effects' forces; MuJoCo calls it at every stage of its integrator."""
        if self._force is None or model is not self._model:
            return
        x, y, vx, vy = self._light()
        fx, fy, heavy = self._force(data.time, x, y, vx, vy, self._heavy_speed())
        first, second = self._generalized(fx, fy)
        passive = self._qfrc  # element by element: NumPy's ways with slices take longer than the sums
        passive[0] += first
        passive[1] += second
        if not self._held:
            passive[HEAVY] += heavy * self._factor

    def _spare(self) -> float:
        """By how much the string is slack [m]; negative where it is stretched."""
        return -self._excess() if self._has_string else 0.0

    def _margins(self) -> tuple[float, float]:
        """Two numbers that fall below 0 where sliding or sticking ends."""
        if self._motion is EffectiveMassMotion.FREE:
            return math.inf, math.inf
        if self._motion is EffectiveMassMotion.STICKING:
            return self._holding_margins()
        return self._motion.value * self._heavy_speed(), math.inf

    def _holding_margins(self) -> tuple[float, float]:
        """By how much the rod can hold the locked heavy mass against falling and against rising [N]."""
        k = self._kinematics(0.0)
        self._prepare(k)
        self._mujoco.mj_forward(self._model, self._data)
        rows = self._data.efc_force
        light_tension = max(float(rows[-1]), 0.0) if len(rows) > LOCK + 1 else 0.0
        held = self._weight
        if self._force is not None:
            x, y, vx, vy = self._light()
            held -= self._force(self._data.time, x, y, vx, vy, 0.0)[2]
        bound = math.exp(max(effects.holding_exponent(math, k, self._values, self._effects), 0.0))
        return light_tension * bound - held, held - light_tension / bound

    def _change(self) -> None:
        """Find what the string does from here on: slides as the heavy mass moves, or as it is pulled, or sticks."""
        if (
            self._motion is EffectiveMassMotion.FREE and self._heavy_speed() != 0.0
        ):  # the release's own, as written: 0 but for a push
            self._motion = EffectiveMassMotion.UP if self._heavy_speed() > 0 else EffectiveMassMotion.DOWN
            return
        if self._held:
            return
        self._qvel[HEAVY] = 0.0
        self._motion, self._factor = EffectiveMassMotion.STICKING, 1.0
        self._set_mass()
        self._model.eq_data[LOCK, 0] = float(self._qpos[HEAVY] - self._model.qpos0[HEAVY])
        self._data.eq_active[LOCK] = 1
        falls, rises = self._holding_margins()
        if falls < 0 or rises < 0:
            self._motion = EffectiveMassMotion.DOWN if falls < 0 else EffectiveMassMotion.UP
            self._data.eq_active[LOCK] = 0

    def _heavy_height(self) -> float:
        return -self._parameters.hanging_length if self._held else float(self._qpos[HEAVY])

    def _heavy_speed(self) -> float:
        return 0.0 if self._held else float(self._qvel[HEAVY])

    def _excess(self) -> float:
        """How much longer than its rest length the string is [m]; negative where it hangs slack."""
        length, angle = self._string()
        p = self._parameters
        return length + p.rod_radius * angle - self._heavy_height() - p.string_length


def _share(before: float, after: float) -> float:
    """Share of a step after which what is ``before`` and ``after`` it falls below 0; 1 where it does not."""
    if not after < 0:
        return 1.0
    return before / (before - after) if before > 0 else 0.0
