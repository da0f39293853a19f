"""What the pymunk variants share: calls of Chipmunk, the masses at release, and a rig that steps and reads them."""

from __future__ import annotations

import math
from typing import Any

from looping_pendulum.engines.chain import point_on_string
from looping_pendulum.engines.protocol import groups_per_sample
from looping_pendulum.engines.studies import DefaultRow
from looping_pendulum.pages.numbers import quantity
from looping_pendulum.reference_ode.cartesian import cartesian_force, release_velocity
from looping_pendulum.reference_ode.parameters import Parameters, Release

DEFAULT_TIME_STEP = 1e-3
"""Step of the studies' defaults [s]. Chipmunk has no default step; this is ten times finer than what its guides use."""
DEFAULT_ITERATIONS = 10
"""Chipmunk's default number of solver iterations per step."""
DEFAULT_COLLISION_SLOP = 0.1
"""Chipmunk's default penetration that contacts leave uncorrected, in units of length: here 10 cm."""
DEFAULT_RATE = -60 * math.log(1 - 0.1)
"""Chipmunk's default rate of error correction [1/s]: a tenth of the error in every sixtieth of a second."""
DEFAULT_RATE_TEXT = f"a tenth of it every 1/60 s ({DEFAULT_RATE:.1f} /s)"
MAX_SLOP_IN_RADIUS = 1e-3
"""Largest penetration slop that the circle's radius makes up for [m]; Chipmunk's default slop, 10 cm, exceeds the rod."""


class ForceIntervals:
    """What follows from settings with an interval between updates; a dataclass that derives from it has the fields."""

    time_step: float
    """Length of a step [s]; it must divide the sample interval."""
    force_interval: int
    """Steps between two updates of the drag forces."""

    def __post_init__(self) -> None:
        """Raise EngineError where steps or groups of steps do not divide the sample interval."""
        groups_per_sample(self.time_step, self.force_interval)


class PublicCalls:
    """The calls to Chipmunk that a rig makes at every step, by pymunk's published interface only."""

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


Vector = tuple[float, float]
"""x and y components, in the unit of the quantity."""


def velocity_on_string(parameters: Parameters, arc: float) -> Vector:
    """Return the velocity [m/s] of the taut string just after release, ``arc`` [m] from the light mass.

    String on the rod and on the heavy side moves along itself with the heavy mass's speed; on the free part the velocity is
    linear between that of the tangent point and the light mass's.
    """
    p = parameters
    vx, vy, heavy_vy = release_velocity(p)
    wound_arc = min(max(arc - p.free_length, 0.0), p.rod_radius * p.release_angle)
    angle = p.release_angle - wound_arc / p.rod_radius
    along = (-heavy_vy * math.sin(angle), heavy_vy * math.cos(angle))
    share = max(1 - arc / p.free_length, 0.0)
    return (along[0] + share * (vx - along[0]), along[1] + share * (vy - along[1]))


def masses(space: Any, parameters: Parameters, *, light_mass: float | None = None) -> tuple[Any, Any]:
    """Create the light and the heavy mass as bodies of ``space``, as they are released; a clamped mass is a static body.

    Parameters
    ----------
    light_mass
        Mass of the light body [kg]; None: that of ``parameters``. A chain subtracts part of its own mass from it.
    """
    import pymunk

    # An infinite moment of inertia: the masses are points, and joints at their centres exert no torque.
    light = pymunk.Body(parameters.light_mass if light_mass is None else light_mass, math.inf)
    if parameters.release is Release.HELD:
        heavy = pymunk.Body(body_type=pymunk.Body.STATIC)
    else:
        heavy = pymunk.Body(parameters.heavy_mass, math.inf)
    light.position = point_on_string(parameters, 0.0, parameters.rod_radius)
    heavy.position = point_on_string(parameters, parameters.string_length, parameters.rod_radius)
    vx, vy, heavy_vy = release_velocity(parameters)
    light.velocity = (vx, vy)
    if parameters.release is not Release.HELD:
        heavy.velocity = (0.0, heavy_vy)
    space.add(light, heavy)
    return light, heavy


class SpaceRig:
    """Two masses in a Chipmunk space; a subclass creates the masses and the string between them."""

    _light: Any
    _heavy: Any
    _calls: PublicCalls

    def __init__(self, parameters: Parameters, settings: Any, *, slop: float) -> None:
        import pymunk

        self._settings = settings
        self._space: Any = pymunk.Space()
        self._space.gravity = (0.0, -parameters.coefficients["gravity"])
        self._space.iterations = settings.iterations
        self._space.collision_slop = slop
        self._force = cartesian_force(parameters)
        self._clamped = parameters.release is Release.HELD
        self._groups = 0

    def advance(self) -> None:
        """Advance the simulation by one `SAMPLE_INTERVAL`."""
        group = self._settings.force_interval
        for _ in range(groups_per_sample(self._settings.time_step, group)):
            self._update_beads()
            self._apply_effect_forces(group)
            self._calls.step(group)
            self._groups += 1

    def read(self) -> tuple[float, ...]:
        """Return positions [m], velocities [m/s], string stretch and slip [m]: `COLUMNS` without the time."""
        lx, ly, lvx, lvy = self._calls.position_and_velocity(self._light)
        hx, hy, hvx, hvy = self._calls.position_and_velocity(self._heavy)
        return lx, ly, lvx, lvy, hx, hy, hvx, hvy, *self._read_string((lx, ly), (hx, hy))

    def _apply_effect_forces(self, group: int) -> None:
        """Apply the effects' forces for a whole group of steps in its first step, as Chipmunk clears forces after each step.

        The first group gets half of its impulse, so that on average over a group the speeds are neither early nor late.
        """
        if self._force is None:
            return
        share = group if self._groups else 0.5 * group
        time = self._groups * group * self._settings.time_step
        heavy_vy = self._calls.position_and_velocity(self._heavy)[3]
        fx, fy, heavy_fy = self._force(time, *self._calls.position_and_velocity(self._light), heavy_vy)
        self._calls.apply_force(self._light, share * fx, share * fy)
        if not self._clamped:
            self._calls.apply_force(self._heavy, 0.0, share * heavy_fy)

    def _update_beads(self) -> None:
        """Add or remove beads before a group of steps; a rig whose links stay as they are does nothing."""

    def _read_string(self, light: Vector, heavy: Vector) -> tuple[float, float]:
        """Return the string's stretch beyond its rest length and its slip over the rod [m]; NaN without a string.

        Parameters
        ----------
        light, heavy
            Positions of the masses [m].
        """
        return math.nan, math.nan


def step_default(settings: Any, **with_long_step: int) -> DefaultRow:
    """Return the long step as a hidden default; ``with_long_step`` are intervals in steps, for which it has room for one."""
    changes = {"time_step": DEFAULT_TIME_STEP, "force_interval": 1} | with_long_step
    effect = "length of a step; joints soften with its square"
    return "dt", "none; 1 ms is finer than its guides use", quantity(settings.time_step, "s", 3), effect, changes


def iterations_default(settings: Any) -> DefaultRow:
    """Return Chipmunk's number of iterations as a hidden default."""
    effect = "sweeps of the solver per step; joints stiffen in proportion"
    return "iterations", f"{DEFAULT_ITERATIONS}", f"{settings.iterations}", effect, {"iterations": DEFAULT_ITERATIONS}


def slop_default(settings: Any, field: str) -> DefaultRow:
    """Return Chipmunk's slop as a hidden default of the setting ``field``."""
    effect, ours = "how deep shapes may rest in one another; the adapter allows for it up to 1 mm", getattr(settings, field)
    return "collision_slop", "0.1 units of length: 10 cm", quantity(ours, "m", 3), effect, {field: DEFAULT_COLLISION_SLOP}


def error_bias_default(settings: Any) -> DefaultRow:
    """Return Chipmunk's rate of the joints as a hidden default."""
    effect = "how fast a stretched joint returns to its length"
    return "error_bias", DEFAULT_RATE_TEXT, f"{settings.error_rate:g} /s", effect, {"error_rate": DEFAULT_RATE}
