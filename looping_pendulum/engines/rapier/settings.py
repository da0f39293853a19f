"""Settings of the Rapier chain, in SI units."""

from __future__ import annotations

from dataclasses import dataclass

from looping_pendulum.engines.bead_rig import BeadRigSettings
from looping_pendulum.engines.protocol import Profile


@dataclass(frozen=True, kw_only=True)
class RapierChainSettings(BeadRigSettings):
    """Numerical settings of the bead chain, in SI units."""

    iterations: int
    """Number of times that joints and contacts are solved in a sub-step (num_internal_pgs_iterations)."""
    sub_steps: int = 1
    """Number of sub-steps of the solver in a step, for which contacts keep their directions (num_solver_iterations)."""
    contact_hertz: float = 1e6
    """Frequency of the contacts with the rod [Hz] (static_contact_softness), as high as Rapier's of joints."""
    friction_in_bias_pass: bool = True
    """Whether friction is solved before places move in a sub-step, too, and not only after it."""
    contact_recycling: bool = False
    """Whether a contact keeps its direction until its bodies have moved by 50 mm against each other."""
    sleeping: bool = False
    """Whether bodies that move slowly for a while fall asleep, until something wakes them."""
    locked_plane: bool = False
    """Whether the bodies' axis z is locked, by which friction loses a third; without it they stay in the plane all the same."""


SETTINGS = {
    Profile.QUICK: RapierChainSettings(time_step=1e-5, iterations=32, bend=0.28, bead_mass_ratio=1e-4),
    Profile.ACCURATE: RapierChainSettings(time_step=1e-5, iterations=64, bend=0.2, bead_mass_ratio=1e-4),
}
