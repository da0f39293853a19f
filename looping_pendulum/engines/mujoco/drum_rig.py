"""MuJoCo rig in the string's own coordinates: the wrap angle is a hinge, the free length a slide, the string a fixed tendon.

A fixed tendon's length is a linear combination of joint coordinates, here free length + R wrap angle - heavy mass's height. Its
Jacobian is constant, so MuJoCo leaves nothing out of its acceleration, and full turns need not be counted.
"""

from __future__ import annotations

import math

from looping_pendulum.engines.mujoco.effective_mass_rig import EffectiveMassRig
from looping_pendulum.engines.mujoco.tendon_model import EffectiveMassSettings
from looping_pendulum.engines.mujoco.winding import TAUT_MARGIN
from looping_pendulum.reference_ode.effects import Kinematics
from looping_pendulum.reference_ode.geometry import light_position
from looping_pendulum.reference_ode.parameters import Parameters, Release

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
    """The rig with hinge, slide and fixed tendon."""

    def __init__(self, parameters: Parameters, settings: EffectiveMassSettings, end_length: float) -> None:
        super().__init__(parameters, settings, drum_xml(parameters, settings), end_length)
        self._radius = parameters.rod_radius
        self._length_range = self._model.tendon_range
        self._max_sum = float(self._length_range[0, 1])
        self._qpos[ANGLE_DOF], self._qpos[LENGTH_DOF] = parameters.release_angle, parameters.free_length
        cosine, sine = math.cos(parameters.release_angle), math.sin(parameters.release_angle)
        vx, vy, _ = self._release_velocity
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
