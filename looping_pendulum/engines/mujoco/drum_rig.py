"""The apparatus in its own coordinates: the wrap angle is a hinge, the free length a slide, the string a fixed tendon.

A fixed tendon's length is a fixed sum of joint coordinates, here free length + R wrap angle - heavy mass's height. Its
derivative does not turn, so nothing is left out of its acceleration, and the turns need no counting.
"""

from __future__ import annotations

import math

from looping_pendulum.engines.mujoco.effective_mass_rig import EffectiveMassRig
from looping_pendulum.engines.mujoco.tendon_model import EffectiveMassSettings
from looping_pendulum.engines.mujoco.winding import TAUT
from looping_pendulum.reference_ode.effects import Kinematics
from looping_pendulum.reference_ode.geometry import light_position
from looping_pendulum.reference_ode.parameters import Parameters, Release

ANGLE, LENGTH = 0, 1
"""The light mass's degrees of freedom: the hinge's wrap angle and the slide's free length."""
NOTHING = 'mass="1e-9" diaginertia="1e-13 1e-13 1e-13"'
"""Inertia of the arm that turns with the string: MuJoCo wants some; the light mass at 4 mm has 10^6 times this."""


def drum_xml(parameters: Parameters, settings: EffectiveMassSettings) -> str:
    """Write the MuJoCo model (MJCF): at wrap angle 0 the string leaves the rod's right edge straight upwards."""
    p, s = parameters, settings
    held, string = p.release is Release.HELD, p.release is not Release.DROP
    heavy_joint = f'<joint name="heavy_y" type="slide" axis="0 0 1" ref="{-p.hanging_length!r}"/>'
    heavy_coordinate = '<joint joint="heavy_y" coef="-1"/>'
    longest = p.string_length - (p.hanging_length if held else 0.0)
    lock = f'<joint name="lock" joint1="heavy_y" active="false" solref="{s.string_time_constant!r} 1" solimp="{s.solimp}"/>'
    return f"""
<mujoco model="looping pendulum, drum">
  <compiler angle="radian"/>
  {s.option(p.coefficients["gravity"])}
  <worldbody>
    <body name="arm">
      <joint name="wrap_angle" type="hinge" axis="0 -1 0"/>
      <inertial pos="0 0 0" {NOTHING}/>
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
    <fixed name="string" limited="{"true" if string else "false"}" range="-1 {longest!r}"
           solreflimit="{s.string_time_constant!r} 1" solimplimit="{s.solimp}">
      <joint joint="free_length" coef="1"/><joint joint="wrap_angle" coef="{p.rod_radius!r}"/>
      {"" if held else heavy_coordinate}
    </fixed>
  </tendon>
  <equality>{"" if held else lock}</equality>
</mujoco>"""


class DrumRig(EffectiveMassRig):
    """Hinge, slide and fixed tendon."""

    def __init__(self, parameters: Parameters, settings: EffectiveMassSettings, end_length: float) -> None:
        super().__init__(parameters, settings, drum_xml(parameters, settings), end_length)
        self._radius = parameters.rod_radius
        self._allowed = self._model.tendon_range
        self._longest = float(self._allowed[0, 1])
        self._qpos[ANGLE], self._qpos[LENGTH] = parameters.release_angle, parameters.free_length
        cosine, sine = math.cos(parameters.release_angle), math.sin(parameters.release_angle)
        vx, vy, _ = self._release_velocity
        turning = -(vx * cosine + vy * sine) / parameters.free_length
        self._qvel[ANGLE], self._qvel[LENGTH] = turning, vy * cosine - vx * sine - self._radius * turning
        self._start()

    def _light(self, ahead: float = 0.0) -> tuple[float, float, float, float]:
        length, angle = self._string(ahead)
        turning, growing, *_ = self._qvel.tolist()
        turning_faster, growing_faster, *_ = self._qacc.tolist()
        turning, growing = turning + ahead * turning_faster, growing + ahead * growing_faster
        x, y = light_position(math, max(length, 0.0), angle, self._radius)  # below 0 the step ended inside the rod
        cosine, sine = math.cos(angle), math.sin(angle)
        return x, y, -turning * y - growing * sine, turning * x + growing * cosine

    def _string(self, ahead: float = 0.0) -> tuple[float, float]:
        angle, length, *_ = self._qpos.tolist()
        turning, growing, *_ = self._qvel.tolist()
        return length + ahead * growing, angle + ahead * turning

    def _generalized(self, fx: float, fy: float) -> tuple[float, float]:
        length, angle = self._string()
        x, y = light_position(math, length, angle, self._radius)
        return fy * x - fx * y, fy * math.cos(angle) - fx * math.sin(angle)

    def _prepare(self, kinematics: Kinematics) -> None:
        self._allowed[0, 1] = self._longest + self._caught - TAUT
