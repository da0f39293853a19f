"""How the pymunk adapter talks to Chipmunk: its settings, and the calls of every step, direct where pymunk allows it."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import Any, Protocol

from looping_pendulum.engines.protocol import Profile, groups_per_sample, steps_per_sample

DIRECT_CALLS = ("cpBodyGetPosition", "cpBodyGetVelocity", "cpBodySetForce", "cpSpaceSetCurrentTimeStep", "cpSpaceStep")
"""Chipmunk functions that pymunk calls but does not publish."""


@dataclass(frozen=True, kw_only=True)
class PymunkChainSettings:
    """Numerical settings of the bead chain."""

    time_step: float
    """[s]; divides the sample interval."""
    bend: float
    """Angle between neighbouring links on the rod [rad]; a link is R times this long."""
    bead_mass_ratio: float
    """Mass of one bead over the light mass. Lighter: a softer chain; heavier: the string's own inertia shows."""
    iterations: int = 20
    """Sweeps of the solver per step."""
    impulse_leak: float = 150.0
    """Rate at which joints forget their warm-start impulse [1/s]: damps the spring that it makes of the chain."""
    leak_interval: int = 5
    """Steps of which the last one's impulse is forgotten for all at once, as telling takes a call. Divides `force_interval`."""
    error_rate: float = 100.0
    """Rate at which joints remove their length error [1/s]; it must stay below the leak, or the chain rings ever louder."""
    contact_rate: float = 100.0
    """Rate at which contacts remove penetration beyond the slop [1/s]."""
    bead_radius: float = 1e-3
    """[m]; the circle is that much smaller, so that the bead's centre runs where the string should."""
    contact_slop: float = 1e-5
    """Depth to which beads rest in the circle [m]; allowed for in its radius."""
    force_interval: int = 50
    """Steps between two updates of the drag forces and of the beads on the straight parts; a test shows that it may be 1."""
    polygon_friction: bool = True
    """Whether the contact's friction is corrected for the polygon that the beads' links are."""
    polygon_radius: bool = True
    """Whether the beads' circle is corrected for it."""

    def __post_init__(self) -> None:
        """Refuse a step that samples cannot be taken at."""
        if self.force_interval % self.leak_interval:
            raise ValueError(
                f"leak_interval: found {self.leak_interval}, needed a divisor of force_interval, {self.force_interval}"
            )
        groups_per_sample(self.time_step, self.force_interval)

    @property
    def steps_per_sample(self) -> int:
        """Steps in one sample interval."""
        return steps_per_sample(self.time_step)


SETTINGS = {
    Profile.QUICK: PymunkChainSettings(time_step=5e-6, bend=0.28, bead_mass_ratio=2e-4),
    Profile.ACCURATE: PymunkChainSettings(time_step=2e-6, bend=0.24, bead_mass_ratio=1e-4),
}

MOST_ALLOWED = 1e-3
"""Slop that is allowed for in the circle's radius, at most [m]."""

PUBLIC_ERROR_RATE = 6.3
"""Chipmunk's default rate [1/s]. Without the leak nothing damps the chain, so it must correct no faster."""


class Calls(Protocol):
    """What the rig asks of Chipmunk at every step."""

    def step(self, count: int) -> None:
        """Take ``count`` steps."""

    def place(self, body: Any) -> tuple[float, float]:
        """Position [m]: x, y."""

    def motion(self, body: Any) -> tuple[float, float, float, float]:
        """Position [m] and velocity [m/s]: x, y, vx, vy."""

    def push(self, body: Any, fx: float, fy: float) -> None:
        """Apply a force [N] for the next step."""


class DirectCalls:
    """Straight to Chipmunk: the only way to the leaky warm start.

    Chipmunk scales warm-start impulses by the new step over the last one. Told before a step that the last one was
    dt / (1 - n leak dt) long, it keeps the share 1 - n leak dt of them; n is the number of steps between two such tellings.
    """

    def __init__(self, library: Any, space: Any, settings: PymunkChainSettings) -> None:
        self._library = library
        self._space = space._space
        self._time_step = settings.time_step
        self._interval = settings.leak_interval
        self._claimed_step = settings.time_step / (1 - self._interval * settings.impulse_leak * settings.time_step)

    def step(self, count: int) -> None:
        """Take ``count`` steps."""
        space, time_step, claimed_step = self._space, self._time_step, self._claimed_step
        claim, step = self._library.cpSpaceSetCurrentTimeStep, self._library.cpSpaceStep
        interval = range(self._interval)
        for _ in range(count // self._interval):
            claim(space, claimed_step)
            for _ in interval:
                step(space, time_step)

    def place(self, body: Any) -> tuple[float, float]:
        """Position [m]: x, y."""
        position = self._library.cpBodyGetPosition(body._body)
        return position.x, position.y

    def motion(self, body: Any) -> tuple[float, float, float, float]:
        """Position [m] and velocity [m/s]: x, y, vx, vy."""
        position = self._library.cpBodyGetPosition(body._body)
        velocity = self._library.cpBodyGetVelocity(body._body)
        return position.x, position.y, velocity.x, velocity.y

    def push(self, body: Any, fx: float, fy: float) -> None:
        """Apply a force [N] for the next step."""
        self._library.cpBodySetForce(body._body, (fx, fy))


class PublicCalls:
    """pymunk's published interface only."""

    def __init__(self, space: Any, time_step: float) -> None:
        self._space = space
        self._time_step = time_step

    def step(self, count: int) -> None:
        """Take ``count`` steps."""
        for _ in range(count):
            self._space.step(self._time_step)

    def place(self, body: Any) -> tuple[float, float]:
        """Position [m]: x, y."""
        return (*body.position,)

    def motion(self, body: Any) -> tuple[float, float, float, float]:
        """Position [m] and velocity [m/s]: x, y, vx, vy."""
        return (*body.position, *body.velocity)

    def push(self, body: Any, fx: float, fy: float) -> None:
        """Apply a force [N] for the next step."""
        body.force = (fx, fy)


def direct_library() -> Any:
    """Chipmunk's functions below pymunk, or None where this pymunk has not all of `DIRECT_CALLS`."""
    try:
        library = importlib.import_module("pymunk._chipmunk").lib
    except (ImportError, AttributeError):
        return None
    return library if all(hasattr(library, name) for name in DIRECT_CALLS) else None
