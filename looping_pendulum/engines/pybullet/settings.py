"""Numerical settings of the PyBullet variants."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

NO_SPEED_LIMIT = 1e9
"""In place of PyBullet's clamp of joint speeds, 100 m/s or rad/s: links turn faster than that as they pass over the rod."""
DEFAULT_SPEED_LIMIT = 100.0
DEFAULT_DAMPING = 0.04
"""PyBullet's linear and angular damping of every body [1/s]."""
DEFAULT_ITERATIONS = 50
DEFAULT_NEIGHBOUR_MARGIN = 0.02
"""PyBullet's contactBreakingThreshold [m]."""
LARGEST_STEP = 1e-3
"""Samples are a millisecond apart and nothing is resampled; PyBullet's own step is 1/240 s."""


class RodShape(StrEnum):
    """What stands for the rod."""

    SPHERE = "sphere"
    """It has the rod's section in the plane of motion, and sphere on sphere is Bullet's one exact contact."""
    CYLINDER = "cylinder"
    """Bullet meets it by a general algorithm, whose points and normals are inexact at a millimetre's size."""


@dataclass(frozen=True, kw_only=True)
class WorldSettings:
    """What every variant sets."""

    time_step: float
    """[s]; divides the sample interval."""
    solver_iterations: int
    force_interval: int = 5
    """Steps between two updates of the effects' forces; a test shows that it may be 1."""
    joint_error_reduction: float = 0.2
    """Share of a joint's error that a step takes back (Bullet's erp)."""
    contact_error_reduction: float = 0.2
    """Share of a penetration that a step takes back (contactERP)."""
    friction_error_reduction: float = 0.2
    """Share of a sliding of a contact at rest that a step takes back (frictionERP)."""
    neighbour_margin: float = DEFAULT_NEIGHBOUR_MARGIN
    """By how much the boxes that find neighbours are larger than the shapes [m] (contactBreakingThreshold).

    With PyBullet's 20 mm a node has a dozen others for neighbours, and sorting them out costs as much as the contacts. Spheres
    touch or do not, whatever it is; but it changes the order in which the solver sweeps over the contacts."""
    linear_damping: float = 0.0
    """Share of a body's velocity lost per second."""
    angular_damping: float = 0.0
    speed_limit: float = NO_SPEED_LIMIT
    """Of a multibody's joints [m/s or rad/s] (maxJointVelocity)."""
    rod: RodShape = RodShape.SPHERE
    friction_with_damping: bool = False
    """Set a link's friction in one call with its damping, as PyBullet's documentation allows; the friction is then ignored."""
    node_radius: float = 2e-4
    """Radius of a node's contact sphere [m]; the rod is that much thinner, so that the string's middle runs at its radius."""
    polygon: bool = True
    """Whether radius and coefficient are those of the polygon that stands for the circle (`engines.chain`)."""
