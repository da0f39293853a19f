"""Numerical settings of the PyBullet variants."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

NO_SPEED_LIMIT = 1e9
"""Limit of joint speeds [m/s or rad/s] that is never reached; links turn faster than PyBullet's as they pass over the rod."""
DEFAULT_SPEED_LIMIT = 100.0
"""PyBullet's limit of every joint's speed [m/s or rad/s]."""
DEFAULT_DAMPING = 0.04
"""PyBullet's linear and angular damping of every body [1/s]."""
DEFAULT_ITERATIONS = 50
"""PyBullet's number of solver iterations per step."""
DEFAULT_NEIGHBOUR_MARGIN = 0.02
"""PyBullet's contactBreakingThreshold [m]."""
LARGEST_STEP = 1e-3
"""Largest step [s]: samples are a millisecond apart and are not interpolated; PyBullet's own step is 1/240 s."""


class RodShape(StrEnum):
    """Collision shape of the rod."""

    SPHERE = "sphere"
    """Has the rod's section in the plane of motion; sphere on sphere is Bullet's only exact contact."""
    CYLINDER = "cylinder"
    """Bullet finds its contacts by a general algorithm, whose points and normals are inexact at sizes of a millimetre."""


@dataclass(frozen=True, kw_only=True)
class WorldSettings:
    """Settings that every PyBullet variant has."""

    time_step: float
    """Length of a step [s]; it must divide the sample interval."""
    solver_iterations: int
    """Iterations (sweeps over all constraints) of the solver per step (numSolverIterations)."""
    force_interval: int = 5
    """Steps between two updates of the effects' forces; a test compares it with 1."""
    joint_error_reduction: float = 0.2
    """Fraction of a joint's position error that a step corrects (Bullet's erp)."""
    contact_error_reduction: float = 0.2
    """Fraction of a penetration that a step corrects (contactERP)."""
    friction_error_reduction: float = 0.2
    """Fraction of the drift of a sticking contact that a step corrects (frictionERP)."""
    neighbour_margin: float = DEFAULT_NEIGHBOUR_MARGIN
    """Margin by which the bounding boxes of the neighbour search exceed the shapes [m] (contactBreakingThreshold).

    With PyBullet's 20 mm a node has a dozen others for neighbours, and sorting them out costs as much as the contacts. Whether
    spheres touch does not depend on it, but the order does in which the solver sweeps over the contacts.
    """
    linear_damping: float = 0.0
    """Fraction of a body's velocity lost per second."""
    angular_damping: float = 0.0
    """Fraction of a body's angular velocity lost per second."""
    speed_limit: float = NO_SPEED_LIMIT
    """Largest speed of a multibody's joints [m/s or rad/s] (maxJointVelocity)."""
    rod: RodShape = RodShape.SPHERE
    """Collision shape of the rod."""
    friction_with_damping: bool = False
    """Whether to set a link's friction and damping in one call.

    PyBullet's documentation allows it, but PyBullet then ignores the friction.
    """
    node_radius: float = 2e-4
    """Radius of a node's contact sphere [m]; the rod is thinner by as much, so that the string's middle lies at its radius."""
    polygon: bool = True
    """Whether the rod's radius and coefficient are corrected for the polygon that the links are (`engines.chain`)."""
