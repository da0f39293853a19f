"""Growth of small differences: the tangent map of a whole run, through its events, and its Lyapunov exponents.

The norm is of observable quantities: the positions of both masses over the free length l0 at release, and their velocities over
sqrt(g l0), squared and added. The tangent map takes a small difference at the release to the difference at the same later time;
its largest singular value is the greatest growth, and ln(growth) / t the finite-time Lyapunov exponent [1/s]. A stop
after which the rod holds the string takes one direction away for good; its exponent is then minus infinity.

Derivatives are differences of runs in 128 bits, whose starts are closer together than a number of double precision can tell.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from looping_pendulum.errors import ParameterError
from looping_pendulum.reference_ode.effects import GRAVITY
from looping_pendulum.reference_ode.geometry import Array, light_position, light_velocity
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solution import Samples
from looping_pendulum.reference_ode.solve import DURATION
from looping_pendulum.reference_ode.state import State, extra_variables, string_has_thickness, variables
from research import heyoka_runs

OBSERVABLES = ("x1", "y1", "vx1", "vy1", "y2", "vy2")
"""Quantities in the norm: position and velocity of the light mass, height and speed of the heavy one."""
STEP, TOLERANCE = 1e-15, 1e-30
"""Difference at release [m, rad or m/s] to either side, and relative tolerance of a step of these runs.

The error of a central difference is of order STEP^2, that of the runs TOLERANCE / STEP.
"""
# A direction that is lost has a singular value of rounding size, whose digits depend on the processor
MIN_RELATIVE_GROWTH = 1e-13
"""Growth, relative to the largest at that time, that is zero but for rounding: a stop has taken the direction away."""


@dataclass(frozen=True, kw_only=True)
class TangentMap:
    """Tangent map of a run at the times of its n samples. SI, unless said to be scaled."""

    samples: Samples
    """The run itself."""
    names: tuple[str, ...]
    """The m entries of the state that can differ at release."""
    state: Array
    """Derivatives of every entry of the state by ``names`` at release, at fixed time, shape (n, len(State), m)."""
    start: Array
    """Derivatives of `OBSERVABLES` by the same at release, shape (6, m): a taut string carries the heavy mass along."""
    observables: Array
    """Those at the times of the samples, shape (n, 6, m)."""

    @cached_property
    def scales(self) -> Array:
        """Scales by which `OBSERVABLES` are divided: l0 [m] for a position, sqrt(g l0) [m/s] for a velocity."""
        p = self.samples.run.parameters
        # Without gravity the scale of speeds would be 0
        length, gravity = p.free_length, p.coefficients["gravity"] or GRAVITY.coefficients[0].default
        speed = math.sqrt(gravity * length)
        return np.array([length, length, speed, speed, length, speed])

    @cached_property
    def matrices(self) -> Array:
        """Tangent maps from unit differences at release to scaled differences in `OBSERVABLES`, shape (n, 6, m)."""
        # start = Q R: multiplied by the inverse of R, differences at release are orthonormal in the norm
        _, upper = np.linalg.qr(self.start / self.scales[:, None])
        return np.asarray(self.observables / self.scales[:, None] @ np.linalg.inv(upper))

    @cached_property
    def growth(self) -> Array:
        """Singular values of `matrices`, largest first, shape (n, m); 0 where below `MIN_RELATIVE_GROWTH`."""
        values = np.asarray(np.linalg.svd(self.matrices, compute_uv=False), dtype=float)
        return np.where(values <= MIN_RELATIVE_GROWTH * values[:, :1], 0.0, values)

    @cached_property
    def exponents(self) -> Array:
        """Finite-time Lyapunov exponents ln(growth) / t [1/s], shape (n, m); nan at the release, -inf where one is lost."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.log(self.growth) / self.samples.t[:, None]


def solve_tangent_map(parameters: Parameters, t: Array, *, duration: float = DURATION) -> TangentMap:
    """Solve as `solve_at` does and follow every small difference at release to the times ``t`` [s], ascending.

    The differences are those that the mode at release allows: with a taut string in free length, wrap angle and the two speeds
    (along the string, in the direction in which it begins to slide). The length of the string never differs. Times after the
    run's end are left out.

    Raises
    ------
    ParameterError
        If an effect adds state variables or thickens the rod: the norm is that of two points in a plane.
    """
    own = extra_variables(parameters.effects)
    if own or string_has_thickness(parameters.effects):
        names = ", ".join(e.name for e in parameters.effects if e.variables or e.winding)
        raise ParameterError(f"effects: found {names}, needed effects that neither add state variables nor thicken the rod")
    samples = heyoka_runs.solve_at(parameters, t, duration=duration)
    run = heyoka_runs.HeyokaRun(parameters, tolerance=TOLERANCE, precision="128-bit")
    number, released = run.integrator.number_type, run.released
    allowed = variables(released.mode, parameters.effects)
    names = tuple(name for name in allowed if name != "slack")  # 0 at every release
    rows = []
    for name in names:
        # A taut string carries the heavy mass along
        moved = ("retreat_speed", "heavy_speed") if name == "retreat_speed" and "heavy_speed" not in allowed else (name,)
        starts = [
            released.y._replace(**{entry: getattr(released.y, entry) + number(side * STEP) for entry in moved})
            for side in (1, -1)
        ]
        states = [_at_release_and_samples(run, released._replace(y=y), samples.t, duration) for y in starts]
        observed = [_observables(State(*values), number(parameters.rod_radius)) for values in states]
        rows.append([((ahead - behind) / number(2 * STEP)).astype(float) for ahead, behind in (states, observed)])
    state, observables = (np.array(columns).transpose(2, 1, 0) for columns in zip(*rows, strict=True))
    return TangentMap(samples=samples, names=names, state=state[1:], start=observables[0], observables=observables[1:])


def _at_release_and_samples(run: heyoka_runs.HeyokaRun, start: Any, t: Array, duration: float) -> Array:
    """Return the whole states at ``start`` and at the times ``t`` [s], shape (len(State), 1 + n)."""
    _, parts = run.drive(start, t, duration)
    number = run.integrator.number_type
    first = np.array([number(v) for v in start.y], dtype=number)
    return np.concatenate([first[:, None], *(part.values for part in parts)], axis=1)


def _observables(y: State, rod_radius: Any) -> Array:
    """Return `OBSERVABLES` in the states ``y``; the height is up to a constant, which no difference has."""
    return np.array(
        [
            *light_position(np, y.free_length, y.wrap_angle, rod_radius),
            *light_velocity(np, y.wrap_angle, y.retreat_speed, y.across_speed),
            y.free_length + rod_radius * y.wrap_angle + y.slack,
            y.heavy_speed,
        ]
    )
