"""Apparatus that several tests use."""

import math

from looping_pendulum.reference_ode.parameters import Parameters

TEN_TO_ONE = Parameters(
    light_mass=0.010,
    heavy_mass=0.100,
    rod_radius=0.00625,
    free_length=0.58,
    release_angle=math.radians(112),
    coefficients={"kinetic_friction": 0.34, "light_drag": 1e-3, "heavy_drag": 1e-3, "string_drag": 1e-3},
)
TWO_TO_ONE = Parameters(
    light_mass=0.050,
    heavy_mass=0.100,
    rod_radius=0.0065,
    free_length=0.584,
    release_angle=math.radians(68),
    coefficients={"kinetic_friction": 0.265, "light_drag": 6e-4, "heavy_drag": 1e-3, "string_drag": 5.9e-3},
)
SENSITIVE = Parameters(  # the paper's "sensitive" case, M2/M1 = 2.5
    light_mass=0.0152,
    heavy_mass=0.038,
    rod_radius=0.00625,
    free_length=0.58,
    release_angle=math.radians(75.1),
    coefficients={"kinetic_friction": 0.3, "light_drag": 1e-3, "heavy_drag": 1e-3},
)
WITHOUT_LOSSES = {"kinetic_friction": 0.0, "light_drag": 0.0, "heavy_drag": 0.0, "string_drag": 0.0}
