"""What the MuJoCo variants share: the string settings, the model with two tendons used in turn, compiling it, and studies."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from looping_pendulum.engines.protocol import steps_per_sample
from looping_pendulum.engines.studies import DefaultRow, LadderRow, default_row
from looping_pendulum.pages.numbers import quantity
from looping_pendulum.reference_ode.cartesian import cartesian_force, masses_at_release
from looping_pendulum.reference_ode.effects import Kinematics
from looping_pendulum.reference_ode.geometry import light_position
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.runs.trajectory import SAMPLE_INTERVAL

DEFAULT_TIME_CONSTANT = 0.02
"""Default time constant of MuJoCo's constraints [s]: the first number of `solref` and `solreffriction`."""
HEAVY_DOF = 2
"""Degree of freedom of the heavy mass, after the light mass's two; a held heavy mass has none."""
SLACK_LENGTH = 1e-6
"""A string shorter than its rest length by more than this [m] counts as slack; a taut one's length varies by far less."""
SWITCH_UP = math.radians(210)
"""Tendon k is replaced by tendon k + 1 when the wrap angle is this far above k pi [rad]; its path is right up to 240 deg."""
SWITCH_DOWN = math.radians(15)
"""Tendon k is replaced by tendon k - 1 when the wrap angle is less than this above k pi [rad].

It differs from `SWITCH_UP` - pi, so that a light mass that swings to and fro there does not switch at every step.
"""
TAUT_MARGIN = 1e-9
"""Length by which the string's limit is reduced [m], so that a string exactly at its rest length counts as taut."""
WRAPPED_TENDON = "spatial tendon wrapped over a cylinder; the adapter counts turns, using two in turn"
"""How MuJoCo supplies the winding with `AlternatingTendons`."""


class AlternatingTendons:
    """Activates the two tendons of `model_xml` in turn, so that a string without memory of its turns can wind without end.

    Parameters
    ----------
    parameters
        Physics.
    model
        MuJoCo's model; tendon 0 is for even numbers of half turns, tendon 1 for odd ones.
    switch_up, switch_down
        Wrap angle above k pi at which tendon k is replaced by the next and by the previous one [rad].
    """

    def __init__(self, parameters: Parameters, model: Any, switch_up: float, switch_down: float) -> None:
        self._limit_enabled, self._length_range = model.tendon_limited, model.tendon_range
        self._string_per_turn = 2 * math.pi * parameters.rod_radius
        self._string_length = parameters.string_length
        self._switch_up, self._switch_down = switch_up, switch_down
        self._half_turns = 0
        self._activate()

    def select(self, wrap_angle: float) -> None:
        """Activate the tendon that is right for ``wrap_angle`` [rad], with the wound turns subtracted from its length limit."""
        above = wrap_angle - self._half_turns * math.pi
        if above > self._switch_up:
            self._half_turns += 1
        elif above < self._switch_down and self._half_turns > 0:
            self._half_turns -= 1
        else:
            return
        self._activate()

    def allow_extra_length(self, extra: float) -> None:
        """Set the string's length limit to ``extra`` [m] more than its rest length."""
        self._length_range[self.tendon, 1] = self.rest_length + extra

    def _activate(self) -> None:
        """Enable the length limit of the current tendon, and disable that of the other."""
        self.tendon = self._half_turns % 2
        self.rest_length = self._string_length - (self._half_turns // 2) * self._string_per_turn
        self._limit_enabled[self.tendon] = 1
        self._limit_enabled[1 - self.tendon] = 0


class StringRig:
    """The apparatus in MuJoCo with a string that is one constraint; a subclass steps it.

    Parameters
    ----------
    parameters, settings
        Physics and numerics.
    xml
        MuJoCo model: two degrees of freedom of the light mass, then that of the heavy mass.
    end_length
        Free length [m] below which the rig stops, because the light mass would run into the rod.
    """

    def __init__(self, parameters: Parameters, settings: StringSettings, xml: str, end_length: float) -> None:
        import mujoco

        p = parameters
        self._mujoco: Any = mujoco
        self._model: Any = compile_model(mujoco, xml)
        self._data: Any = mujoco.MjData(self._model)
        self._qpos, self._qvel, self._qacc = self._data.qpos, self._data.qvel, self._data.qacc
        self._breakdowns = breakdown_warnings(mujoco, self._data)
        self._dt, self._steps = settings.time_step, steps_per_sample(settings.time_step)
        self._parameters = p
        self._has_string, self._held = p.release is not Release.DROP, p.release is Release.HELD
        self._end_length = end_length if self._has_string else -math.inf
        self._force = cartesian_force(p)
        self._at_release = masses_at_release(p)

    def read(self) -> tuple[float, ...]:
        """Return positions [m], velocities [m/s] and string stretch [m]: `COLUMNS` without the time."""
        if any(warning.number for warning in self._breakdowns):
            return (math.nan,) * 9
        x, y, vx, vy, heavy_v = self._read_motion()
        stretch = self._stretch() if self._has_string else math.nan
        return (x, y, vx, vy, self._parameters.rod_radius, self._heavy_height(), 0.0, heavy_v, stretch)

    def _read_motion(self) -> tuple[float, ...]:
        """Return x, y [m], vx, vy [m/s] of the light mass, and the upward velocity of the heavy mass [m/s]."""
        raise NotImplementedError

    def _stretch(self) -> float:
        """Return how much longer than its rest length the string is [m]."""
        raise NotImplementedError

    def _heavy_height(self) -> float:
        """Return the height of the heavy mass [m]."""
        return -self._parameters.hanging_length if self._held else float(self._qpos[HEAVY_DOF])


def kinematics(time: float, free_length: float, wrap_angle: float, vx: float, vy: float, heavy_vy: float) -> Kinematics:
    """Return the kinematics on which the effects depend, from those of the string and the masses' velocities [m/s]."""
    cosine, sine = math.cos(wrap_angle), math.sin(wrap_angle)
    retreat, across = vy * cosine - vx * sine, -(vx * cosine + vy * sine)
    speed = math.hypot(vx, vy)
    return Kinematics(time, free_length, wrap_angle, retreat, across, abs(across), speed, heavy_vy, abs(heavy_vy))


@dataclass(frozen=True, kw_only=True)
class StringSettings:
    """Numerical settings of every variant whose string is one constraint."""

    time_step: float
    """Time step [s]; it divides `protocol.SAMPLE_INTERVAL`."""
    string_time_constant: float
    """Time constant with which the string returns to its length [s]; MuJoCo's `solref`, at least two time steps."""
    impedance: float = 0.9999
    """Impedance: the fraction of a constraint that is enforced at once; MuJoCo's `solimp`, at the largest value it accepts."""
    least_impedance: float = 0.9999
    """Impedance where the constraint is satisfied exactly; it rises to ``impedance`` within a millimetre of violation."""
    integrator: str = "implicitfast"
    jacobian: str = "dense"
    """Dense, because MuJoCo 4.0.0 has a wrong Hessian with a sparse Jacobian."""
    solver_tolerance: float = 1e-12
    solver_iterations: int = 50

    @property
    def solimp(self) -> str:
        """Return MuJoCo's `solimp` of every constraint."""
        return f"{self.least_impedance!r} {self.impedance!r} 0.001"

    def option(self, gravity: float) -> str:
        """Return MuJoCo's `option` element, with contacts disabled; ``gravity`` is in m/s^2."""
        # autoreset is off: after a breakdown MuJoCo would go on from the first state, with a mere warning
        return f"""<option timestep="{self.time_step!r}" integrator="{self.integrator}" jacobian="{self.jacobian}"
          tolerance="{self.solver_tolerance!r}" iterations="{self.solver_iterations}" gravity="0 0 {-gravity!r}">
    <flag contact="disable" autoreset="disable"/>
  </option>"""


def model_xml(
    parameters: Parameters,
    settings: StringSettings,
    *,
    friction_time_constant: float = DEFAULT_TIME_CONSTANT,
    friction_loss: float = 0.0,
    simple: str = "auto",
) -> str:
    """Return the MuJoCo model (MJCF) of ``parameters``, whose joint coordinates are x and y from the rod's centre.

    MuJoCo's x is the plane's x and its z is the plane's y. A spatial tendon does not count turns: it takes the shortest path
    round the rod on the side of its side site. Tendon 0 goes from the heavy mass to the rod's right edge and on round the rod
    to the light mass; tendon 1 goes half a turn further before that. Each is right over about half a turn, so using them in
    turn, with the length limit reduced by one turn of string at every second switch, they wind without end. The string is the
    upper limit of a tendon's length, so it pulls and never pushes.

    Friction loss of a tendon brakes the change of its own length, and the string's does not change; so ``friction_loss`` [N]
    belongs to tendon 2, the hanging part alone, which lengthens as the string slides. The lock holds the heavy mass while the
    rig activates it.
    """
    p, s = parameters, settings
    x, y = light_position(math, p.free_length, p.release_angle, p.rod_radius)
    stiffness = f'solreflimit="{s.string_time_constant!r} 1" solimplimit="{s.solimp}"'
    string = f'range="0 {p.string_length!r}" {stiffness}'  # the rig enables the limit of the tendon in use
    friction = f'solreffriction="{friction_time_constant!r} 1" solimpfriction="{s.solimp}"'
    heavy_joint = f'<joint name="heavy_y" type="slide" axis="0 0 1" ref="{-p.hanging_length!r}" {friction}/>'
    lock = f'<joint name="lock" joint1="heavy_y" active="false" solref="{s.string_time_constant!r} 1" solimp="{s.solimp}"/>'
    held = p.release is Release.HELD
    return f"""
<mujoco model="looping pendulum">
  <compiler angle="degree"/>
  {s.option(p.coefficients["gravity"])}
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
    <body name="heavy" pos="{p.rod_radius!r} 0 {-p.hanging_length!r}" simple="{simple}">
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
  <equality>{"" if held else lock}</equality>
</mujoco>"""


def _beside_rod(parameters: Parameters, degrees: float) -> str:
    """Return the position of a side site, one radius off the rod's surface at this polar angle, as MJCF writes it."""
    distance, angle = 2 * parameters.rod_radius, math.radians(degrees)
    return f"{distance * math.cos(angle)!r} 0 {distance * math.sin(angle)!r}"


NEWER_ATTRIBUTES = {"autoreset": ' autoreset="disable"', "simple": ' simple="auto"'}
"""Attribute that older releases refuse -> what stands in our models and is left out for them.

Without autoreset, MuJoCo goes on from the first state after a breakdown; the rigs read its warning of that. The other says what
those releases do anyway.
"""


def compile_model(mujoco: Any, xml: str) -> Any:
    """Return the compiled model of ``xml``; for older releases (`research.releases`) without the `NEWER_ATTRIBUTES`.

    Raises
    ------
    ValueError
        What MuJoCo finds wrong with it.
    """
    while True:
        try:
            return mujoco.MjModel.from_xml_string(xml)
        except ValueError as error:
            refused = [text for name, text in NEWER_ATTRIBUTES.items() if f"attribute: '{name}'" in str(error) and text in xml]
            if not refused:
                raise
            xml = xml.replace(refused[0], "")


def breakdown_warnings(mujoco: Any, data: Any) -> list[Any]:
    """Return MuJoCo's warnings of a breakdown: it only counts them, and the numbers that follow look like motion."""
    kinds = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
    return [data.warning[int(kind)] for kind in kinds]


def step_rungs(time_constants: Sequence[str], steps_stiff: int = 2) -> LadderRow:
    """Return a ladder of time steps, along which the settings ``time_constants`` stay ``steps_stiff`` steps."""
    rungs = [{"time_step": dt} | dict.fromkeys(time_constants, steps_stiff * dt) for dt in (1e-3, 5e-4, 2e-4, 1e-4, 5e-5, 2e-5)]
    return "time_step", "s", rungs, f"the constraints' time constants stay {steps_stiff} steps" if time_constants else ""


def softness_rungs(setting: str, time_step: float) -> LadderRow:
    """Return a ladder of a constraint's time constant at one time step, down to the 2 steps to which MuJoCo raises it."""
    return setting, "s", [n * time_step for n in (20.0, 10.0, 5.0, 2.0)]


def time_constant_default(settings: Any, setting: str, name: str, effect: str) -> DefaultRow:
    """Return MuJoCo's default time constant for one kind of constraint as a hidden default."""
    return default_row(settings, setting, DEFAULT_TIME_CONSTANT, name, effect, unit="s")


def string_defaults(settings: StringSettings) -> tuple[DefaultRow, ...]:
    """Return MuJoCo's defaults that matter in every variant whose string is one constraint."""
    s = settings
    return (
        time_constant_default(s, "string_time_constant", "solref", "how fast a stretched string returns to its length"),
        (
            "solimp",
            "0.9 to 0.95 within 1 mm",
            f"{s.least_impedance:g} to {s.impedance:g}",
            "share of a constraint that is enforced; the rest gives way",
            {"least_impedance": 0.9, "impedance": 0.95},
        ),
        *solver_defaults(s),
    )


def solver_defaults(settings: Any, **with_long_step: Any) -> tuple[DefaultRow, ...]:
    """Return MuJoCo's defaults of step, integrator and solver.

    ``with_long_step`` are settings that must change together with the longer default step.
    """
    s = settings
    return (
        (
            "timestep",
            "2 ms (run at 1 ms, where samples fall)",
            quantity(s.time_step, "s", 3),
            "length of a step",
            {"time_step": SAMPLE_INTERVAL} | with_long_step,
        ),
        default_row(s, "integrator", "Euler", "integrator", "how a step is taken"),
        default_row(s, "jacobian", "auto", "jacobian", "sparse or dense algebra: dense below 60 degrees of freedom"),
        default_row(s, "solver_iterations", 100, "iterations", "of the solver, at most"),
        ("tolerance", "1e-8", f"{s.solver_tolerance:g}", "where the solver stops early", {"solver_tolerance": 1e-8}),
    )
