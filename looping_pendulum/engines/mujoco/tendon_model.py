"""The apparatus as a MuJoCo model: two masses on slides, and two tendons that represent the string in turn."""

from __future__ import annotations

import math
from dataclasses import dataclass

from looping_pendulum.engines.mujoco.winding import SWITCH_DOWN, SWITCH_UP
from looping_pendulum.reference_ode.geometry import light_position
from looping_pendulum.reference_ode.parameters import Parameters, Release


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


@dataclass(frozen=True, kw_only=True)
class TendonSettings(StringSettings):
    """Numerical settings of the tendon variants that use MuJoCo's step as a leapfrog step (see `tendon_rig`)."""

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


def model_xml(
    parameters: Parameters,
    settings: StringSettings,
    *,
    friction_time_constant: float = 0.02,
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
