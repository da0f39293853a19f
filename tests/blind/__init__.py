"""Blind test data: a simulator and a camera that share no equation with the package. Here: what may be simulated."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Apparatus:
    """What the experimenter would declare: the paper's model."""

    light_mass: float = 0.010
    heavy_mass: float = 0.100
    rod_radius: float = 0.00625
    free_length: float = 0.58
    release_angle: float = math.radians(112)
    hanging_length: float = 0.05
    gravity: float = 9.81
    friction: float = 0.34
    light_drag: float = 1e-3
    heavy_drag: float = 1e-3
    string_drag: float = 1e-3
    release: str = "looping"
    """"looping", "vertical", "held" (heavy mass clamped) or "drop" (no string)."""


@dataclass(frozen=True, kw_only=True)
class Effects:
    """What nobody declared. Every default is the null value: the effect is absent."""

    linear_drag: float = 0.0
    """F = -b v on the light mass [kg/s]."""
    wind: float = 0.0
    """Horizontal speed of the air at the light mass, for its quadratic and linear drag [m/s]."""
    attitude_drag: float = 0.0
    """Relative growth of the light mass's quadratic drag: 1 + c cos^2 of the angle between velocity and string [1]."""
    static_excess: float = 0.0
    """Static over kinetic friction, less 1 [1]."""
    friction_per_speed: float = 0.0
    """Relative growth of friction with the speed of the string on the rod [s/m]."""
    friction_per_wrap: float = 0.0
    """Relative growth of friction with wrap angle [1/rad]."""
    friction_per_turn: float = 0.0
    """Relative growth of friction per turn of wrap, from half a turn on [1]."""
    string_on_string: float = 0.0
    """Friction added to that of the rod for wrap beyond the first full turn [1]."""
    string_density: float = 0.0
    """Mass of the string per length [kg/m]. Approximate: its hanging part joins the heavy mass (weight and inertia); of its
    free part, half the weight and a half (along) or a third (across) of the inertia join the light mass; the part on the rod
    and the momentum of string that changes sides are left out."""
    compliance: float = 0.0
    """Stretch of the whole string per force [m/N]; each part has its share by length."""
    string_loss_time: float = 0.0
    """Damping over stiffness of a string that stretches [s]; 0: that of the numerics."""
    string_thickness: float = 0.0
    """Growth of the radius per turn, from the second turn on: the string lies on itself [m]."""
    rod_mobility: float = 0.0
    """R^2 over the rod's moment of inertia: how freely it turns in its bearing [1/kg]; 0: it is fixed."""
    bearing_friction: float = 0.0
    """Coulomb friction of the bearing, as a force at the rod's surface [N]."""
    light_radius: float = 0.0
    """Of a solid ball that turns with the string (moment of inertia 2/5 M1 r^2); the run ends when it touches the rod [m]."""
    heavy_swing: float = 0.0
    """Angle to the vertical from which the heavy mass, too, is released at rest [rad]."""
    sideways_push: float = 0.0
    """Speed of the light mass along the rod at release [m/s]. The string may shift along the rod without friction."""
    side_force: float = 0.0
    """Constant horizontal force on the light mass [N]."""
    side_stiffness: float = 0.0
    """Horizontal force on the light mass per x [N/m]; positive: away from the rod's vertical plane."""
    push: float = 0.0
    """Speed of the light mass across the string at release, the way it loops [m/s]."""
    magnet: float = 0.0
    """Largest force of a magnet on the light mass, F = k exp(-d^2 / 2 s^2) towards it (negative: away) [N]."""
    magnet_place: tuple[float, float] = (-0.3, -0.35)
    magnet_range: float = 0.08
    pull: float = 0.0
    """Pull on the light mass towards a point, F = k d / (d^2 + s^2)^(3/2) [N m^2]."""
    pull_place: tuple[float, float] = (-0.20, -0.30)
    pull_softening: float = 0.03
    thrust: float = 0.0
    """Largest force of a pulse along the light mass's velocity, F = k exp(-(t - t0)^2 / 2 s^2) [N]."""
    thrust_time: float = 0.3
    thrust_width: float = 0.05
    brake: float = 0.0
    """Drag per speed of the heavy mass between two heights, -b v between y = -0.16 m and -0.09 m, with soft edges [kg/s]."""
    brake_from: float = -0.16
    brake_to: float = -0.09
    brake_edge: float = 0.008
    rough_patch: float = 0.0
    """Relative growth of friction while the string leaves the rod between two wrap angles, with soft edges [1]."""
    patch_from: float = 2.4
    patch_to: float = 3.4
    patch_edge: float = 0.1
