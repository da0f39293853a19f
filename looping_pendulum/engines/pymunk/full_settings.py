"""Numerical settings of the full chains: links along the whole string."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

from looping_pendulum.engines.chain import polygon_friction, polygon_radius
from looping_pendulum.engines.protocol import Profile, groups_per_sample, steps_per_sample


class FullChainVariant(StrEnum):
    """How the whole string is made of links."""

    BEADS = "beads"
    """Point-mass beads on pin joints."""
    SEGMENTS = "segments"
    """Rigid segments on pivot joints."""
    DEFAULTS = "defaults"
    """As `BEADS`, with everything else left as Chipmunk has it."""


DEFAULT_TIME_STEP = 1e-3
"""Step of the defaults variant [s]. Chipmunk has no default step; this is ten times finer than what its guides use."""
DEFAULT_ITERATIONS = 10
"""Chipmunk's default number of solver iterations per step."""
DEFAULT_COLLISION_SLOP = 0.1
"""Chipmunk's default penetration that contacts leave uncorrected, in units of length: here 10 cm."""
DEFAULT_RATE = -60 * math.log(1 - 0.1)
"""Chipmunk's default rate of error correction [1/s]: a tenth of the error in every sixtieth of a second."""


@dataclass(frozen=True, kw_only=True)
class FullChainSettings:
    """Numerical settings of a chain of links along the whole string."""

    time_step: float
    """Length of a step [s]; it must divide the sample interval."""
    link_length: float
    """Length of a link [m]; adjusted so that equal links make up the string."""
    iterations: int
    """Iterations (sweeps over all constraints) of the solver per step."""
    long_range: int
    """Longest span, in links, of the slide joints that pass the pull over 2, 4, 8, ... links at once; 0: none."""
    mass_fraction: float = 0.01
    """Mass of the whole chain over the light mass. Lighter: a softer chain; heavier: the string's own inertia shows."""
    error_rate: float = DEFAULT_RATE
    """Rate at which joints correct their length error [1/s]; Chipmunk's `error_bias` is exp(-rate).

    Nothing damps the chain, so a high rate makes it oscillate: of the quick profile's held pendulum, 30 costs 1 % of its
    energy and 100 costs 12 %.
    """
    collision_slop: float = 1e-5
    """Depth to which links rest in the circle [m]; its radius is larger by as much, up to `MAX_SLOP_IN_RADIUS`."""
    bead_radius: float = 1e-3
    """Half of the links' thickness [m]; the circle is that much smaller, so that their middle runs where the string should."""
    polygon_friction: bool = True
    """Whether the contact's friction is corrected for the polygon that the links are."""
    polygon_radius: bool = True
    """Whether the circle's radius is corrected for it."""
    force_interval: int = 10
    """Steps between two updates of the drag forces."""

    def __post_init__(self) -> None:
        """Raise ValueError where steps or groups of steps do not divide the sample interval."""
        groups_per_sample(self.time_step, self.force_interval)

    @property
    def steps_per_sample(self) -> int:
        """Number of steps in one sample interval."""
        return steps_per_sample(self.time_step)

    def bend(self, rod_radius: float) -> float:
        """Return the angle between neighbouring links on a rod of ``rod_radius`` [m], in rad."""
        return self.link_length / rod_radius


def full_settings(variant: FullChainVariant, profile: Profile) -> FullChainSettings:
    """Return the settings of ``variant`` in ``profile``."""
    return _SETTINGS[variant, profile]


_DEFAULTS = FullChainSettings(
    time_step=DEFAULT_TIME_STEP,
    link_length=6e-3,
    iterations=DEFAULT_ITERATIONS,
    long_range=0,
    collision_slop=DEFAULT_COLLISION_SLOP,
    polygon_friction=False,
    polygon_radius=False,
    force_interval=1,
)

_SETTINGS = {
    (FullChainVariant.BEADS, Profile.QUICK): FullChainSettings(
        time_step=2e-5, link_length=6e-3, iterations=10, long_range=64, error_rate=30.0
    ),
    (FullChainVariant.BEADS, Profile.ACCURATE): FullChainSettings(
        time_step=4e-6, link_length=3e-3, iterations=10, long_range=64, error_rate=100.0
    ),
    (FullChainVariant.SEGMENTS, Profile.QUICK): FullChainSettings(
        time_step=2e-5, link_length=5e-3, iterations=10, long_range=64, error_rate=30.0, bead_radius=0.0
    ),
    (FullChainVariant.SEGMENTS, Profile.ACCURATE): FullChainSettings(
        time_step=4e-6, link_length=3e-3, iterations=10, long_range=64, error_rate=100.0, bead_radius=0.0
    ),
    (FullChainVariant.DEFAULTS, Profile.QUICK): _DEFAULTS,
    (FullChainVariant.DEFAULTS, Profile.ACCURATE): _DEFAULTS,
}
"""Variant and profile -> settings. The defaults variant has one for both profiles, as it shows what the defaults do."""


def contact_friction(variant: FullChainVariant, friction: float, bend: float) -> float:
    """Return the contact friction with which a polygon of links obeys the capstan law of a circle.

    Beads touch the circle where the string bends: `engines.chain.polygon_friction`. A rigid segment touches it in its middle,
    and the string bends at its ends. Let joint forces grow by exp(mu b) from one end to the other, at the same angle to the
    radius at both: then the segment's three equations of equilibrium give m = sinh(mu b) / sin(b). That is above mu, where the
    beads' coefficient is below it.
    """
    if variant is FullChainVariant.SEGMENTS:
        return math.sinh(friction * bend) / math.sin(bend)
    return polygon_friction(friction, bend)


def link_contact_radius(variant: FullChainVariant, rod_radius: float, bend: float) -> float:
    """Return the distance from the rod's centre [m] at which the links' middle lines must touch it to wind up R per radian.

    Segments of length h = R b on a circle of radius r turn the string by b where r tan(b/2) = h / 2.
    """
    if variant is FullChainVariant.SEGMENTS:
        return rod_radius * (bend / 2) / math.tan(bend / 2)
    return float(polygon_radius(rod_radius, bend))
