"""How fast neighbouring motions part: the tangent map of a whole run, saltation at its events included, and its exponents.

Nearness is measured in what can be seen: the places of both masses over the release's free length l0, and their velocities over
sqrt(g l0), squared and added. The tangent map takes a small difference at the release to the difference at the same later time;
its largest singular value is the greatest growth, and ln(growth) / t the finite-time Lyapunov exponent [1/s]. A stop that
holds takes one direction away for good, whose exponent is then minus infinity.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from looping_pendulum.errors import MissingPackageError, ParameterError
from looping_pendulum.reference_ode import dual
from looping_pendulum.reference_ode.driver import Driver
from looping_pendulum.reference_ode.dual import Dual
from looping_pendulum.reference_ode.effects import GRAVITY
from looping_pendulum.reference_ode.geometry import Array, light_position, light_velocity
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.sensitivity import DualDriver
from looping_pendulum.reference_ode.solution import Run, Samples, join
from looping_pendulum.reference_ode.solve import DURATION, TOLERANCE, available_integrators
from looping_pendulum.reference_ode.state import State, own_variables, variables, winds

SEEN = ("x1", "y1", "vx1", "vy1", "y2", "vy2")
"""What nearness is measured in: place and velocity of the light mass, height and speed of the heavy one."""
LOST = 1e-13
"""Growth over the largest one at that time that is none but for rounding: a direction that a stop has taken away for good."""


@dataclass(frozen=True, kw_only=True)
class Stretching:
    """Tangent map of a run at the times of its n samples. SI, but for what is said to be scaled."""

    samples: Samples
    """The run itself."""
    names: tuple[str, ...]
    """The m entries of the state that are free at release."""
    start: Array
    """Derivatives of the state at release by themselves, shape (len(State), m): a taut string carries the heavy mass along."""
    state: Array
    """Derivatives of every entry of the state by those at release, at fixed time, shape (n, len(State), m)."""

    @cached_property
    def scales(self) -> Array:
        """What each of `SEEN` is divided by: l0 [m] for a place, sqrt(g l0) [m/s] for a velocity."""
        p = self.samples.run.parameters
        length, gravity = p.free_length, p.coefficients["gravity"] or GRAVITY.coefficients[0].default
        speed = math.sqrt(gravity * length)
        return np.array([length, length, speed, speed, length, speed])

    @cached_property
    def matrices(self) -> Array:
        """Tangent maps from unit differences at release to scaled differences in `SEEN`, shape (n, 6, m)."""
        p = self.samples.run.parameters
        start = _seen(self.samples.run.events[0].state, self.start, p) / self.scales[:, None]
        _, upper = np.linalg.qr(start)
        then = [_seen(State(*row), slopes, p) for row, slopes in zip(np.array(self.samples.state).T, self.state, strict=True)]
        return np.array(then).reshape(-1, len(SEEN), len(self.names)) / self.scales[:, None] @ np.linalg.inv(upper)

    @cached_property
    def growth(self) -> Array:
        """Singular values of `matrices`, largest first, shape (n, m); 0 where a direction is `LOST`."""
        values = np.asarray(np.linalg.svd(self.matrices, compute_uv=False), dtype=float)
        return np.where(values <= LOST * values[:, :1], 0.0, values)

    @cached_property
    def exponents(self) -> Array:
        """Finite-time Lyapunov exponents ln(growth) / t [1/s], shape (n, m); nan at the release, -inf where one is lost."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.log(self.growth) / self.samples.t[:, None]


def solve_stretching(
    parameters: Parameters, t: Array, *, duration: float = DURATION, tolerance: float = TOLERANCE
) -> Stretching:
    """Run as `solve_at` does and follow every small difference at release to the times ``t`` [s], ascending.

    The differences are those that the mode of the release lets exist: of a taut string free length, wrap angle and the two
    speeds (along the string, in the direction in which it begins to slide). The string's length never differs. Times after the
    run's end are left out.

    Raises
    ------
    MissingPackageError
        If heyoka is not installed.
    ParameterError
        If an effect has a state of its own or thickens the rod: the norm is that of two points in a plane.
    SensitivityError
        If an event is only touched: there the tangent map does not exist.
    """
    if "heyoka" not in available_integrators():
        raise MissingPackageError("exponents need heyoka, which is not installed: `pip install heyoka` (Linux x86-64)")
    own = own_variables(parameters.effects)
    if own or winds(parameters.effects):
        names = ", ".join(e.name for e in parameters.effects if e.variables or e.winding)
        raise ParameterError(f"effects: found {names}, needed effects without a state or a winding of their own")
    driver = _SeededDriver(parameters, duration, tolerance)
    released, count = driver.y, len(driver.seeded)
    parts = driver.run_sampled(np.asarray(t, dtype=float))
    run = Run(**(driver.record() | {"events": driver.plain_events()}))
    samples = join(run, parts)
    start = np.array([dual.slopes(v, count) for v in released])
    first = np.repeat(start[:, :, None], len(parts[0].t), axis=2)  # within `driver.START` of the release
    slopes = np.concatenate([first, *driver.variational.derivatives], axis=2)
    return Stretching(samples=samples, names=driver.seeded, start=start, state=slopes.transpose(2, 0, 1))


class _SeededDriver(DualDriver):
    """The driver with dual numbers whose derivatives are by the entries of the state at release."""

    def __init__(self, parameters: Parameters, duration: float, tolerance: float) -> None:
        mode = Driver(parameters, duration, tolerance, "heyoka").mode
        self.seeded = tuple(name for name in variables(mode, parameters.effects) if name != "slack")  # 0 at every release
        super().__init__(parameters, duration, tolerance, len(self.seeded))

    def _released_state(self) -> State:
        y = super()._released_state()._asdict()
        for name, unit in zip(self.seeded, np.eye(len(self.seeded)), strict=True):
            y[name] = Dual(float(y[name]), unit)
        if "retreat_speed" in self.seeded and "heavy_speed" not in self.seeded:
            y["heavy_speed"] = y["retreat_speed"]
        return State(**y)


def _seen(y: State, slopes: Array, p: Parameters) -> Array:
    """Derivatives of `SEEN` where those of the state ``y`` are ``slopes``, shape (len(State), m)."""
    moving = State(*(Dual(float(v), row) for v, row in zip(y, slopes, strict=True)))
    height = moving.free_length + p.rod_radius * moving.wrap_angle + moving.slack
    quantities: list[Any] = [
        *light_position(dual, moving.free_length, moving.wrap_angle, p.rod_radius),
        *light_velocity(dual, moving.wrap_angle, moving.retreat_speed, moving.across_speed),
        height,
        moving.heavy_speed,
    ]
    return np.array([dual.slopes(q, slopes.shape[1]) for q in quantities])
