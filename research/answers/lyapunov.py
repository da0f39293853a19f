"""Growth of small differences: the tangent map of a whole run, with saltation at its events, and its Lyapunov exponents.

The norm is of observable quantities: the positions of both masses over the free length l0 at release, and their velocities over
sqrt(g l0), squared and added. The tangent map takes a small difference at the release to the difference at the same later time;
its largest singular value is the greatest growth, and ln(growth) / t the finite-time Lyapunov exponent [1/s]. A stop
after which the rod holds the string takes one direction away for good; its exponent is then minus infinity.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from looping_pendulum.errors import ParameterError
from looping_pendulum.reference_ode import dual
from looping_pendulum.reference_ode.dual import Dual
from looping_pendulum.reference_ode.effects import GRAVITY
from looping_pendulum.reference_ode.geometry import Array, light_position, light_velocity
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.sensitivity import DualDriver
from looping_pendulum.reference_ode.solution import Run, Samples, join_samples
from looping_pendulum.reference_ode.solve import DURATION, TOLERANCE, Driver, require_heyoka
from looping_pendulum.reference_ode.state import State, extra_variables, string_has_thickness, variables

OBSERVABLES = ("x1", "y1", "vx1", "vy1", "y2", "vy2")
"""Quantities in the norm: position and velocity of the light mass, height and speed of the heavy one."""
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
    start: Array
    """Derivatives of the state at release by ``names``, shape (len(State), m): a taut string carries the heavy mass along."""
    state: Array
    """Derivatives of every entry of the state by ``names`` at release, at fixed time, shape (n, len(State), m)."""

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
        p = self.samples.run.parameters
        start = _observable_derivatives(self.samples.run.events[0].state, self.start, p) / self.scales[:, None]
        # start = Q R: multiplied by the inverse of R, differences at release are orthonormal in the norm
        _, upper = np.linalg.qr(start)
        then = [
            _observable_derivatives(State(*row), derivatives, p)
            for row, derivatives in zip(np.array(self.samples.state).T, self.state, strict=True)
        ]
        return np.array(then).reshape(-1, len(OBSERVABLES), len(self.names)) / self.scales[:, None] @ np.linalg.inv(upper)

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


def solve_tangent_map(
    parameters: Parameters, t: Array, *, duration: float = DURATION, tolerance: float = TOLERANCE
) -> TangentMap:
    """Solve as `solve_at` does and follow every small difference at release to the times ``t`` [s], ascending.

    The differences are those that the mode at release allows: with a taut string in free length, wrap angle and the two speeds
    (along the string, in the direction in which it begins to slide). The length of the string never differs. Times after the
    run's end are left out.

    Raises
    ------
    MissingPackageError
        If heyoka is not installed.
    ParameterError
        If an effect adds state variables or thickens the rod: the norm is that of two points in a plane.
    SensitivityError
        If an event is only grazed: there the tangent map does not exist.
    """
    require_heyoka("Lyapunov exponents")
    own = extra_variables(parameters.effects)
    if own or string_has_thickness(parameters.effects):
        names = ", ".join(e.name for e in parameters.effects if e.variables or e.winding)
        raise ParameterError(f"effects: found {names}, needed effects that neither add state variables nor thicken the rod")
    driver = _ReleaseStateDriver(parameters, duration, tolerance)
    released, count = driver.motion.y, len(driver.seeded)
    parts = driver.run_sampled(np.asarray(t, dtype=float))
    run = Run(**(driver.record() | {"events": driver.events_without_derivatives()}))
    samples = join_samples(run, parts)
    start = np.array([dual.derivatives_of(v, count) for v in released])
    first = np.repeat(start[:, :, None], len(parts[0].t), axis=2)  # within `rules.REST_SERIES_DURATION` of the release
    derivatives = np.concatenate([first, *driver.variational.derivatives], axis=2)
    return TangentMap(samples=samples, names=driver.seeded, start=start, state=derivatives.transpose(2, 0, 1))


class _ReleaseStateDriver(DualDriver):
    """The driver with dual numbers, their derivatives by the entries of the state at release."""

    def __init__(self, parameters: Parameters, duration: float, tolerance: float) -> None:
        # Which entries can differ depends on the mode at release, which a driver without derivatives finds
        mode = Driver(parameters, duration, tolerance, "heyoka").motion.mode
        self.seeded = tuple(name for name in variables(mode, parameters.effects) if name != "slack")  # 0 at every release
        super().__init__(parameters, duration, tolerance, len(self.seeded))

    def _state_at_release(self) -> State:
        y = super()._state_at_release()._asdict()
        for name, unit in zip(self.seeded, np.eye(len(self.seeded)), strict=True):
            y[name] = Dual(float(y[name]), unit)
        if "retreat_speed" in self.seeded and "heavy_speed" not in self.seeded:
            # A taut string carries the heavy mass along
            y["heavy_speed"] = y["retreat_speed"]
        return State(**y)


def _observable_derivatives(y: State, derivatives: Array, p: Parameters) -> Array:
    """Return the derivatives of `OBSERVABLES` where those of the state ``y`` are ``slopes``, shape (len(State), m)."""
    dual_state = State(*(Dual(float(v), row) for v, row in zip(y, derivatives, strict=True)))
    height = dual_state.free_length + p.rod_radius * dual_state.wrap_angle + dual_state.slack
    quantities: list[Any] = [
        *light_position(dual, dual_state.free_length, dual_state.wrap_angle, p.rod_radius),
        *light_velocity(dual, dual_state.wrap_angle, dual_state.retreat_speed, dual_state.across_speed),
        height,
        dual_state.heavy_speed,
    ]
    return np.array([dual.derivatives_of(q, derivatives.shape[1]) for q in quantities])
