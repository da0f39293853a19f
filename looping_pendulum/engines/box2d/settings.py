"""Settings of the Box2D chain, in SI units, and the units in which Box2D computes."""

from __future__ import annotations

from dataclasses import dataclass

from looping_pendulum.engines.bead_rig import BeadRigSettings
from looping_pendulum.engines.protocol import Profile


@dataclass(frozen=True, kw_only=True)
class Box2dChainSettings(BeadRigSettings):
    """Numerical settings of the bead chain, in SI units. The directions of the contacts stay as they are for a step."""

    sub_steps: int
    """Number of sub-steps of the solver in a step, in each of which every joint and contact is solved twice."""
    contact_hertz: float = 1e6
    """Frequency of the contacts [Hz]; Box2D takes a quarter of the sub-steps' frequency if that is lower."""
    contact_damping_ratio: float = 10.0
    """Damping ratio of the contacts."""
    push_speed: float = 3.0
    """Largest speed at which a contact drives out a bead that is too deep in the rod [m/s]."""
    length_unit: float = 1e-2
    """Length of Box2D's metre [m]. Its contacts are found within 0.02 of it, and no joint is shorter than 0.005 of it."""
    time_unit: float = 1e-4
    """Length of Box2D's second [s], in which joints have a frequency of 60, or an eighth of the sub-steps' if that is less.

    pyb2d3 cannot set it, so a short second makes the joints stiff.
    """
    sleeping: bool = False
    """Whether bodies that move slowly for a while fall asleep, until something wakes them."""
    continuous: bool = False
    """Whether a bead that would pass into the rod within a step is stopped at its surface for that step."""


SETTINGS = {
    Profile.QUICK: Box2dChainSettings(time_step=1e-5, sub_steps=4, bend=0.28, bead_mass_ratio=2e-4),
    Profile.ACCURATE: Box2dChainSettings(time_step=4e-6, sub_steps=4, bend=0.2, bead_mass_ratio=1e-4),
}
