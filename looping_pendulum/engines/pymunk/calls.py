"""Settings of the pymunk adapter and the calls that it makes at every step, directly to Chipmunk where pymunk allows it."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import Any, Protocol

from looping_pendulum.engines.protocol import Profile, groups_per_sample, steps_per_sample

DIRECT_CALLS = ("cpBodyGetPosition", "cpBodyGetVelocity", "cpBodySetForce", "cpSpaceSetCurrentTimeStep", "cpSpaceStep")
"""Chipmunk functions that pymunk calls itself but does not publish."""


@dataclass(frozen=True, kw_only=True)
class PymunkChainSettings:
    """Numerical settings of the bead chain."""

    time_step: float
    """Length of a step [s]; it must divide the sample interval."""
    bend: float
    """Angle between neighbouring links on the rod [rad]; a link is R times this long."""
    bead_mass_ratio: float
    """Mass of one bead over the light mass. Lighter: a softer chain; heavier: the string's own inertia shows."""
    iterations: int = 20
    """Iterations (sweeps over all constraints) of the solver per step."""
    impulse_leak: float = 150.0
    """Rate at which joints forget their warm-start impulse [1/s].

    Warm starting makes the chain act as an undamped spring; the leak damps it.
    """
    leak_interval: int = 5
    """Steps between two leaks of the warm-start impulse, each for the whole interval, as a leak costs a call.

    It must divide `force_interval`.
    """
    error_rate: float = 100.0
    """Rate at which joints correct their length error [1/s]; above `impulse_leak` the chain's oscillations grow."""
    contact_rate: float = 100.0
    """Rate at which contacts correct penetration beyond `contact_slop` [1/s]."""
    bead_radius: float = 1e-3
    """Radius of a bead [m]; the rod's circle is smaller by as much, so that the bead's centre moves where the string should."""
    contact_slop: float = 1e-5
    """Depth to which beads rest in the circle [m]; allowed for in its radius."""
    force_interval: int = 50
    """Steps between two updates of the drag forces and of the beads on the straight parts; a test compares it with 1."""
    polygon_friction: bool = True
    """Whether the contact's friction is corrected for the polygon that the beads' links are."""
    polygon_radius: bool = True
    """Whether the beads' circle is corrected for it."""

    def __post_init__(self) -> None:
        """Raise ValueError where steps or groups of steps do not divide the sample interval."""
        if self.force_interval % self.leak_interval:
            raise ValueError(
                f"leak_interval: found {self.leak_interval}, needed a divisor of force_interval, {self.force_interval}"
            )
        groups_per_sample(self.time_step, self.force_interval)

    @property
    def steps_per_sample(self) -> int:
        """Number of steps in one sample interval."""
        return steps_per_sample(self.time_step)


SETTINGS = {
    Profile.QUICK: PymunkChainSettings(time_step=5e-6, bend=0.28, bead_mass_ratio=2e-4),
    Profile.ACCURATE: PymunkChainSettings(time_step=2e-6, bend=0.24, bead_mass_ratio=1e-4),
}

MAX_SLOP_IN_RADIUS = 1e-3
"""Largest penetration slop that the circle's radius makes up for [m]; Chipmunk's default slop, 10 cm, exceeds the rod."""

PUBLIC_ERROR_RATE = 6.3
"""Error rate of the joints where the leak is not available [1/s]: Chipmunk's default.

Without the leak nothing damps the chain, so joints must correct their errors no faster.
"""


class Calls(Protocol):
    """Calls to Chipmunk that a rig makes at every step."""

    def step(self, count: int) -> None:
        """Take ``count`` steps."""

    def position(self, body: Any) -> tuple[float, float]:
        """Return the position [m] of ``body``: x, y."""

    def position_and_velocity(self, body: Any) -> tuple[float, float, float, float]:
        """Return position [m] and velocity [m/s] of ``body``: x, y, vx, vy."""

    def apply_force(self, body: Any, fx: float, fy: float) -> None:
        """Apply a force [N] to ``body`` during the next step only."""


class DirectCalls:
    """Call Chipmunk's functions below pymunk, which alone makes the leaky warm start possible.

    Chipmunk scales warm-start impulses by the new step over the previous one. If the previous step is set to
    dt / (1 - n leak dt) before a step, Chipmunk keeps the fraction 1 - n leak dt of the impulses, where n is the number of
    steps between two such settings.
    """

    def __init__(self, library: Any, space: Any, settings: PymunkChainSettings) -> None:
        self._library = library
        self._space = space._space
        self._time_step = settings.time_step
        self._interval = settings.leak_interval
        self._claimed_previous_step = settings.time_step / (1 - self._interval * settings.impulse_leak * settings.time_step)

    def step(self, count: int) -> None:
        """Take ``count`` steps."""
        space, time_step, claimed_previous_step = self._space, self._time_step, self._claimed_previous_step
        set_previous_step, step = self._library.cpSpaceSetCurrentTimeStep, self._library.cpSpaceStep
        interval = range(self._interval)
        for _ in range(count // self._interval):
            set_previous_step(space, claimed_previous_step)
            for _ in interval:
                step(space, time_step)

    def position(self, body: Any) -> tuple[float, float]:
        """Return the position [m] of ``body``: x, y."""
        position = self._library.cpBodyGetPosition(body._body)
        return position.x, position.y

    def position_and_velocity(self, body: Any) -> tuple[float, float, float, float]:
        """Return position [m] and velocity [m/s] of ``body``: x, y, vx, vy."""
        position = self._library.cpBodyGetPosition(body._body)
        velocity = self._library.cpBodyGetVelocity(body._body)
        return position.x, position.y, velocity.x, velocity.y

    def apply_force(self, body: Any, fx: float, fy: float) -> None:
        """Apply a force [N] to ``body`` during the next step only."""
        self._library.cpBodySetForce(body._body, (fx, fy))


class PublicCalls:
    """Call pymunk's published interface only; the warm start does not leak."""

    def __init__(self, space: Any, time_step: float) -> None:
        self._space = space
        self._time_step = time_step

    def step(self, count: int) -> None:
        """Take ``count`` steps."""
        for _ in range(count):
            self._space.step(self._time_step)

    def position(self, body: Any) -> tuple[float, float]:
        """Return the position [m] of ``body``: x, y."""
        return (*body.position,)

    def position_and_velocity(self, body: Any) -> tuple[float, float, float, float]:
        """Return position [m] and velocity [m/s] of ``body``: x, y, vx, vy."""
        return (*body.position, *body.velocity)

    def apply_force(self, body: Any, fx: float, fy: float) -> None:
        """Apply a force [N] to ``body`` during the next step only."""
        body.force = (fx, fy)


def direct_library() -> Any:
    """Return Chipmunk's functions below pymunk, or None where this version of pymunk lacks one of `DIRECT_CALLS`."""
    try:
        library = importlib.import_module("pymunk._chipmunk").lib
    except (ImportError, AttributeError):
        return None
    return library if all(hasattr(library, name) for name in DIRECT_CALLS) else None
