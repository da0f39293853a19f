"""The apparatus as a MuJoCo model: two masses on slides and a string of two tendons that take turns."""

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
    """[s]; divides `protocol.SAMPLE_INTERVAL`."""
    string_time_constant: float
    """Time constant with which the string returns to its length [s]; MuJoCo's `solref`, at least two time steps."""
    impedance: float = 0.9999
    """Share of a constraint that is enforced at once, the largest that MuJoCo takes; its `solimp`."""
    least_impedance: float = 0.9999
    """The same where the constraint is kept exactly, from where it grows within a millimetre."""
    integrator: str = "implicitfast"
    jacobian: str = "dense"
    """MuJoCo 4.0.0 has a wrong Hessian with a sparse one."""
    solver_tolerance: float = 1e-12
    solver_iterations: int = 50

    @property
    def solimp(self) -> str:
        """MuJoCo's `solimp` of every constraint."""
        return f"{self.least_impedance!r} {self.impedance!r} 0.001"

    def option(self, gravity: float) -> str:
        """MuJoCo's `option` element, without contacts; ``gravity`` [m/s^2]."""
        return f"""<option timestep="{self.time_step!r}" integrator="{self.integrator}" jacobian="{self.jacobian}"
          tolerance="{self.solver_tolerance!r}" iterations="{self.solver_iterations}" gravity="0 0 {-gravity!r}">
    <flag contact="disable" autoreset="disable"/>
  </option>"""


@dataclass(frozen=True, kw_only=True)
class TendonSettings(StringSettings):
    """Numerical settings of the tendon variants that step like a leapfrog."""

    friction_time_constant: float
    """Time constant with which held string comes to rest [s]; two time steps stop it within one. MuJoCo's `solreffriction`."""
    rest_speed: float = 1e-5
    """Below this speed [m/s] the heavy mass counts as at rest; held string creeps at 1e-6 m/s or less."""
    catch_time: float = 2e-3
    """A slack string becomes taut within a step and so up to a step's way too late; time constant of taking that back [s]."""
    switch_up: float = SWITCH_UP
    """Wrap angle above k pi at which tendon k hands over to the next [rad]."""
    switch_down: float = SWITCH_DOWN
    """Wrap angle above k pi at which tendon k hands back [rad]."""
    corrections: bool = True
    """Whether the adapter makes up for what MuJoCo leaves out: the string's turning, half a step of velocity, a late catch."""


@dataclass(frozen=True, kw_only=True)
class EffectiveMassSettings(StringSettings):
    """Numerical settings of the variants whose heavy mass carries the friction."""

    integrator: str = "RK4"
    simple: str = "false"
    """MuJoCo's `simple` of the heavy body; "auto" lets it keep, without a word, the mass that it was compiled with."""
    catch_time: float = 2e-3
    """A string that becomes taut stretches while it stops the masses; time constant of taking that back [s]."""
    split_steps: bool = True
    """Whether a step in which the string stops, yields or becomes taut is taken in two; else the change comes at its end."""
    corrections: bool = True
    """Whether the adapter makes up for the string's turning, which MuJoCo leaves out of a spatial tendon's acceleration."""


def model_xml(
    parameters: Parameters,
    settings: StringSettings,
    *,
    friction_time_constant: float = 0.02,
    friction_loss: float = 0.0,
    simple: str = "auto",
) -> str:
    """Write the MuJoCo model (MJCF) of ``parameters``, its joint coordinates being x and y from the rod's centre.

    MuJoCo's x is the plane's x and its z is the plane's y. A spatial tendon knows no turns: it takes the shortest way round the
    rod on the side that its side site names. Tendon 0 goes from the heavy mass to the rod's right edge and on round the rod to
    the light mass; tendon 1 goes half a turn further before that. Both are right for any wrap angle half a turn up, so that in
    turn, the length allowed shortened by a turn's worth of string at every second switch, they wind without end. The string
    is the upper limit of a tendon's length, so it pulls and never pushes.

    Friction loss of a tendon brakes the change of its own length, and the string's does not change; so ``friction_loss`` [N]
    belongs to tendon 2, the hanging part alone, which lengthens as the string slides. The lock holds the heavy mass where the
    rig switches it on.
    """
    p, s = parameters, settings
    x, y = light_position(math, p.free_length, p.release_angle, p.rod_radius)
    stiffness = f'solreflimit="{s.string_time_constant!r} 1" solimplimit="{s.solimp}"'
    string = f'range="0 {p.string_length!r}" {stiffness}'  # the rig switches the limit of the tendon in use on
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
    """A position one radius off the rod's surface at this polar angle, where a tendon's side site stands."""
    distance, angle = 2 * parameters.rod_radius, math.radians(degrees)
    return f"{distance * math.cos(angle)!r} 0 {distance * math.sin(angle)!r}"
