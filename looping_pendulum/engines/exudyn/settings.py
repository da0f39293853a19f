"""Settings of Exudyn's variants, in SI units."""

from __future__ import annotations

from dataclasses import dataclass

from looping_pendulum.engines.chain import MASS_FRACTION
from looping_pendulum.engines.protocol import Profile, steps_per_sample


@dataclass(frozen=True, kw_only=True)
class SolverSettings:
    """Settings of Exudyn's implicit solver, a generalised-alpha method with Newton's iterations."""

    time_step: float
    """Longest time step [s]; it must divide the sample interval. A step in which the iterations fail is halved, and again."""
    spectral_radius: float = 0.6
    """Factor by which the method damps oscillations that are much faster than a step; 1 damps nothing."""
    relative_tolerance: float = 1e-6
    """Decrease of the residual at which Newton's iterations end."""
    contact_tolerance: float = 1e-3
    """Largest change of a contact's force [N] between iterations over the contacts' states, with which a step is accepted."""
    contact_iterations: int = 20
    """Largest number of these iterations in a step."""
    modified_newton: bool = False
    """Whether the Jacobian is kept from step to step until the iterations fail to converge with it."""

    def __post_init__(self) -> None:
        """Raise EngineError where a step does not divide the sample interval."""
        steps_per_sample(self.time_step)


@dataclass(frozen=True, kw_only=True)
class CableSettings(SolverSettings):
    """Numerical settings of the cable."""

    bend: float
    """Angle that an element spans on the rod [rad]; an element is R times this long."""
    segments: int
    """Number of straight contact segments in an element; each touches the rod with its middle."""
    contact_stiffness: float
    """Stiffness of the contact of a segment with the rod [N/m]."""
    friction_stiffness: float
    """Stiffness of a sticking segment along the rod [N/m]; 0: it does not stick, and creeps if there is a velocity penalty."""
    friction_velocity_penalty: float = 0.0
    """Friction of a segment per sliding speed, until it reaches the friction coefficient's share of the load [N s/m]."""
    axial_stiffness: float
    """Stiffness of the string, EA [N]: force per strain."""
    axial_damping: float
    """Damping of the string [N s]: force per rate of strain."""
    bending_stiffness: float
    """Stiffness of the string against bending, EI [N m^2]."""
    integration: int = 2
    """Exudyn's useReducedOrderIntegration: 0 and 1 are Gauss's rules, 2 mixes Lobatto's with Gauss's."""
    mass_fraction: float = MASS_FRACTION
    """Mass of the string over the light mass."""
    initial_tension: float = 0.1
    """Tension of the string before release [N], without which a string that bends so easily would first buckle."""
    polygon: bool = True
    """Whether the rod's radius and friction are corrected for the polygon of the contact segments."""


@dataclass(frozen=True, kw_only=True)
class ReevingSettings(SolverSettings):
    """Numerical settings of the reeving system."""

    axial_stiffness: float
    """Stiffness of the rope, EA [N]: force per strain."""
    axial_damping: float
    """Damping of the rope [N s]: force per rate of strain."""
    push_force: float = 1e-3
    """Exudyn's regularizationForce: the largest force with which a slack rope pushes [N]; negative: no bound."""


CABLE_SETTINGS = {
    Profile.QUICK: CableSettings(
        time_step=1e-4,
        bend=0.64,
        segments=4,
        contact_stiffness=1e4,
        friction_stiffness=3e3,
        axial_stiffness=1e3,
        axial_damping=1.0,
        bending_stiffness=1e-8,
    ),
    Profile.ACCURATE: CableSettings(
        time_step=5e-5,
        bend=0.32,
        segments=4,
        contact_stiffness=1e4,
        friction_stiffness=3e3,
        axial_stiffness=2e3,
        axial_damping=2.0,
        bending_stiffness=1e-8,
    ),
}

REEVING_SETTINGS = {
    Profile.QUICK: ReevingSettings(time_step=1e-4, axial_stiffness=1e4, axial_damping=10.0),
    Profile.ACCURATE: ReevingSettings(time_step=1e-5, axial_stiffness=1e5, axial_damping=30.0),
}
