"""The apparatus as a MuJoCo model: two masses on slides and a string of two tendons that take turns."""

from __future__ import annotations

import math
from dataclasses import dataclass

from looping_pendulum.reference_ode.geometry import light_position
from looping_pendulum.reference_ode.parameters import Parameters, Release

SWITCH_UP = math.radians(210)
"""Tendon k hands over to k + 1 when the wrap angle is this far above k pi [rad]; its path is right up to 240 degrees."""
SWITCH_DOWN = math.radians(15)
"""Tendon k hands back to k - 1 when the wrap angle is less than this above k pi [rad]; apart from `SWITCH_UP` - pi, so that a
light mass that swings to and fro there does not switch at every step."""


@dataclass(frozen=True, kw_only=True)
class TendonSettings:
    """Numerical settings of the tendon variants."""

    time_step: float
    """[s]; divides `protocol.SAMPLE_INTERVAL`."""
    string_time_constant: float
    """Time constant with which the string returns to its length [s]; MuJoCo's `solref`, at least two time steps."""
    friction_time_constant: float
    """Time constant with which held string comes to rest [s]; two time steps stop it within one. MuJoCo's `solreffriction`."""
    impedance: float = 0.9999
    """Share of a constraint that is enforced at once, the largest that MuJoCo takes; its `solimp`."""
    rest_speed: float = 1e-5
    """Below this speed [m/s] the heavy mass counts as at rest; held string creeps at 1e-6 m/s or less."""
    catch_time: float = 2e-3
    """A slack string becomes taut within a step and so up to a step's way too late; time constant of taking that back [s]."""
    integrator: str = "implicitfast"
    jacobian: str = "dense"
    """MuJoCo 4.0.0 has a wrong Hessian with a sparse one."""
    solver_tolerance: float = 1e-12
    solver_iterations: int = 50


def model_xml(parameters: Parameters, settings: TendonSettings) -> str:
    """Write the MuJoCo model (MJCF) of ``parameters``, its joint coordinates being x and y from the rod's centre.

    MuJoCo's x is the plane's x and its z is the plane's y. A spatial tendon knows no turns: it takes the shortest way round the
    rod on the side that its side site names. Tendon 0 goes from the heavy mass to the rod's right edge and on round the rod to
    the light mass; tendon 1 goes half a turn further before that. Both are right for any wrap angle half a turn up, so that in
    turn, the length allowed shortened by a turn's worth of string at every second switch, they wind without end. The string
    is the upper limit of a tendon's length, so it pulls and never pushes.
    """
    p, s = parameters, settings
    x, y = light_position(math, p.free_length, p.release_angle, p.rod_radius)
    stiffness = f'solreflimit="{s.string_time_constant!r} 1" solimplimit="{s.impedance!r} {s.impedance!r} 0.001"'
    string = f'range="0 {p.string_length!r}" {stiffness}'  # the rig switches the limit of the tendon in use on
    friction = f'solreffriction="{s.friction_time_constant!r} 1" solimpfriction="{s.impedance!r} {s.impedance!r} 0.001"'
    heavy_joint = f'<joint name="heavy_y" type="slide" axis="0 0 1" ref="{-p.hanging_length!r}" {friction}/>'
    return f"""
<mujoco model="looping pendulum">
  <compiler angle="degree"/>
  <option timestep="{s.time_step!r}" integrator="{s.integrator}" jacobian="{s.jacobian}" solver="Newton"
          tolerance="{s.solver_tolerance!r}" iterations="{s.solver_iterations}" gravity="0 0 {-p.coefficients["gravity"]!r}">
    <flag contact="disable" autoreset="disable"/>
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
      {"" if p.release is Release.HELD else heavy_joint}
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
  </tendon>
</mujoco>"""


def _beside_rod(parameters: Parameters, degrees: float) -> str:
    """A position one radius off the rod's surface at this polar angle, where a tendon's side site stands."""
    distance, angle = 2 * parameters.rod_radius, math.radians(degrees)
    return f"{distance * math.cos(angle)!r} 0 {distance * math.sin(angle)!r}"
