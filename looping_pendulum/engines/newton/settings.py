"""Numerical settings of Newton's tendon, with the values of each profile."""

from __future__ import annotations

from dataclasses import dataclass

from looping_pendulum.engines.protocol import Profile, groups_per_sample
from looping_pendulum.errors import EngineError


@dataclass(frozen=True, kw_only=True)
class NewtonTendonSettings:
    """Numerical settings of Newton's tendon, in SI units."""

    time_step: float
    """Length of a step [s]; it must divide the sample interval."""
    compliance: float
    """Stretch of each straight part of the string per tension [m/N].

    Newton's friction reads the tensions from the stretch, in single precision: without one, a string at rest does not slide.
    Its error grows with the time step over the compliance.
    """
    damping: float
    """Tension per rate of stretch of each straight part [N s/m], which damps the string's own oscillations."""
    iterations: int = 1
    """Iterations of the solver per step."""
    relaxation: float = 1.0
    """Share of each correction that an iteration makes."""
    settle_tolerance: float = 1e-3
    """Relative change of the tensions at which the friction of an iteration counts as converged."""
    length_unit: float = 1e-3
    """Length of Newton's unit [m]. The solver stops masses that are slower than 1e-4 units per second."""
    steps_per_group: int = 10
    """Steps between two updates of the effects' forces; Newton replays such a group as one recorded graph."""

    def __post_init__(self) -> None:
        """Raise EngineError where groups do not divide the sample interval, or do not end in the state they began in."""
        groups_per_sample(self.time_step, self.steps_per_group)
        if self.steps_per_group % 2:
            raise EngineError(
                f"steps_per_group: found {self.steps_per_group}, needed an even number, as two states take turns; write 2"
            )

    @property
    def groups_per_sample(self) -> int:
        """Number of groups of steps in one sample interval."""
        return groups_per_sample(self.time_step, self.steps_per_group)

    @property
    def group_time(self) -> float:
        """Length of a group [s]."""
        return self.steps_per_group * self.time_step


SETTINGS = {
    Profile.QUICK: NewtonTendonSettings(time_step=1e-5, compliance=1e-4, damping=2.0),
    Profile.ACCURATE: NewtonTendonSettings(time_step=4e-6, compliance=5e-5, damping=3.0),
}
"""Profile -> settings."""
