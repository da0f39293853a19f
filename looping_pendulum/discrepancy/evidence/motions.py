"""Closures, as laws of unknown form are called, and the motion of all trials by a fit.

A closure says where a law acts, and what it is a function of. The motion says where along it closures act, and how the data
respond to pulses of force at all times. A law may be a force on a mass or a change of the friction of the string on the rod.
While the string slides, a force on the heavy mass and one along the light mass's string move everything alike, so a force as a
function of *time* cannot name its body; as a function of the *state* it can, and the ranking says which of both the data
prefer.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.discrepancy.fit.calibration import Fit
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.discrepancy.result import STRING_ON_ROD
from looping_pendulum.measured.free_parameter import FreeParameter
from looping_pendulum.measured.study import Estimate, Study
from looping_pendulum.reference_ode.effects.closure import (
    COORDINATES,
    FACTORS,
    N_BASIS_FUNCTIONS,
    ROUNDING_DISTANCE,
    coordinates_at,
    weight_name,
)
from looping_pendulum.reference_ode.effects.types import Kinematics
from looping_pendulum.reference_ode.geometry import Array, light_position
from looping_pendulum.reference_ode.transitions import Mode

STRING = STRING_ON_ROD
"""Target of a law of the string: a change of its coefficient of friction."""
TARGETS: dict[str, tuple[str, ...]] = {
    "light mass, along the string": ("along",),
    "light mass, across the string": ("across",),
    "light mass": ("along", "across"),
    "light mass, to the right": ("gradient",),
    "light mass, upward": ("gradient",),
    "light mass, away from a point": ("gradient",),
    "heavy mass": ("heavy",),
    STRING: ("friction",),
}
"""Where an unknown law may act -> sides of the closure in `reference_ode.effects.closure`."""
_OF_LIGHT_MASS = ("time", "free_length", "wrap_angle", "retreat_speed", "across_speed")
COORDINATES_OF: dict[str, tuple[str, ...]] = {
    "light mass, along the string": _OF_LIGHT_MASS,
    "light mass, across the string": _OF_LIGHT_MASS,
    "light mass": _OF_LIGHT_MASS,
    "light mass, to the right": ("horizontal_position",),
    "light mass, upward": ("height",),
    "light mass, away from a point": ("distance",),
    "heavy mass": ("time", "retreat_speed", "hanging_length"),
    STRING: ("wrap_angle", "slip_speed", "normal_load"),
}
"""Target -> coordinates of which a law there is searched for: time, and the place and speeds of what it acts on."""
assert {c for names in COORDINATES_OF.values() for c in names} <= set(COORDINATES)
POINT_SCALE = 0.01
"""Unit of a point's coordinates in a fit [m]."""
MAX_SHIFT = 0.3
"""Largest distance of a fitted point from where the linear model has it, in each direction [m]."""
WEAK_PRIOR = 1e6
"""Prior standard deviation, in scales of a parameter, that leaves it to the data."""
END_MARGIN = 0.5
"""By how many spacings the basis functions reach beyond either end of the coordinate's range."""
MIN_SPACING = 1e-4
"""Spacing of basis functions [SI] below which a coordinate counts as constant, and is not tried."""
PULSE_SIZE = 1e-3
"""Height of a pulse that counts as one [N, or 1 for friction]: its change of the prediction is of order one."""
N_PULSES = 60
"""Pulses along the longest trial, a width apart."""
MAX_PULSE_SPACING = 0.1
"""Largest distance of pulses [s]: wider ones would not show where in a swing a force acts."""
PULSED_SIDES = ("along", "across", "heavy", "friction")
"""Sides whose responses give those of all closures: a force along a gradient is one along and across the string."""
POINT_GRID = 9
"""Points in each direction at which a point of attraction is tried first."""
POINT_MARGIN = 0.2
"""Share of the light mass's range by which this grid is larger on every side."""
MAX_POINT_TRIALS = 50
"""Points that are tried from the best of the grid."""


@dataclass(frozen=True, kw_only=True)
class Closure:
    """A sum of radial basis functions of one coordinate, times a factor, as an unknown force or change of friction."""

    coordinate: str
    """Name of the coordinate, of `COORDINATES`."""
    factor: str
    """Name of the factor, of `FACTORS`."""
    target: str
    """Where it acts, of `TARGETS`."""
    first_centre: float
    """Coordinate of the first basis function's centre."""
    spacing: float
    """Distance of neighbouring centres, which is also each basis function's width, in units of the coordinate."""
    point: tuple[float, float] | None = None
    """Point (x, y) from which the coordinate "distance" is measured [m]; None for the other coordinates."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the weights, side by side."""
        return tuple(weight_name(side, i) for side in TARGETS[self.target] for i in range(N_BASIS_FUNCTIONS))

    @property
    def coefficients(self) -> dict[str, float]:
        """Coefficients of the effect beside its weights: which coordinate, factor and point, and where the centres are."""
        return {
            f"closure_of_{self.coordinate}": 1.0,
            f"closure_by_{self.factor}": 1.0,
            "closure_scale": 1 / self.spacing,
            "closure_start": self.first_centre / self.spacing,
            **self.point_coefficients,
        }

    @property
    def point_coefficients(self) -> dict[str, float]:
        """Coefficients that say where the point is; empty without one."""
        return dict(zip(("closure_point_x", "closure_point_y"), self.point, strict=True)) if self.point else {}

    def added_to(self, study: Study) -> Study:
        """Return ``study`` with this closure among its effects, its weights still zero."""
        fixed = {n: Estimate(value=v) for n, v in self.coefficients.items()}
        return dataclasses.replace(study, effects={**study.effects, **fixed})

    def basis_functions(self, s: Array) -> Array:
        """Return every basis function at coordinates ``s`` of shape (n,), shape (n, N_BASIS_FUNCTIONS)."""
        centres = self.first_centre + self.spacing * np.arange(N_BASIS_FUNCTIONS)
        return np.asarray(np.exp(-0.5 * ((s[:, None] - centres) / self.spacing) ** 2), dtype=np.float64)

    def profile(self, weights: Array, s: Array) -> Array:
        """Return the weighted sum at coordinates ``s``, shape of ``s``; [N], or [N s/m] times a speed; [1] for friction."""
        return np.asarray(self.basis_functions(s) @ weights)


def factors_of(target: str) -> tuple[str, ...]:
    """Return the factors with which a law is searched for: friction and a force along a gradient have none."""
    if target == "heavy mass":
        return FACTORS[:2]  # while the string is taut, the first speed is its own
    return FACTORS if TARGETS[target][0] in ("along", "across") else FACTORS[:1]


def point_parameters(closure: Closure, trials: tuple[str, ...], prior: float = WEAK_PRIOR) -> list[FreeParameter]:
    """Return x and y of the point from which a closure's distance is measured as free parameters; empty without one.

    Their standard deviation is ``prior`` times `POINT_SCALE`.
    """
    return [
        FreeParameter(
            name=name, parameter=name, trials=trials, init_value=value, scale=POINT_SCALE, prior=prior,
            bounds=(value - MAX_SHIFT, value + MAX_SHIFT),
        )
        for name, value in closure.point_coefficients.items()
    ]  # fmt: skip


def weight_parameters(closure: Closure, trials: tuple[str, ...], scale: float) -> list[FreeParameter]:
    """Return a closure's weights as free parameters, of standard deviation ``scale``."""
    return [
        FreeParameter(name=n, parameter=n, trials=trials, init_value=0.0, scale=scale, prior=1.0, bounds=(-1e6, 1e6))
        for n in closure.names
    ]


@dataclass(frozen=True, kw_only=True, eq=False)
class Motions:
    """The undisturbed motion of all training trials, samples end to end, arrays of shape (n,)."""

    kinematics: Kinematics
    parameters: tuple[SimpleNamespace, ...]
    """Parameters of each trial, as the equations read them."""
    trial: Array
    """Index of the trial of every sample."""
    sliding: NDArray[np.bool_]
    """Whether the string slides on the rod."""
    clamped: bool
    """Whether all are held pendulums, of which only a force across the taut string changes the motion."""

    def coordinate(self, name: str, point: tuple[float, float] | None = None) -> Array:
        """Return the values of a coordinate at all samples, shape (n,)."""
        if name == "distance":
            assert point is not None
            x, y = self.positions
            return np.asarray(np.sqrt((x - point[0]) ** 2 + (y - point[1]) ** 2 + ROUNDING_DISTANCE**2))
        return np.asarray(self._coordinates[COORDINATES.index(name)])

    @property
    def is_too_long(self) -> bool:
        """Return whether the records are so long that pulses would not show where in a swing a force acts."""
        return bool(self.kinematics.time.max() > MAX_PULSE_SPACING * N_PULSES)

    @property
    def pulse_spacing(self) -> float:
        """Return the distance of pulses [s]."""
        return float(self.kinematics.time.max()) / (N_PULSES - 1)

    @cached_property
    def positions(self) -> Array:
        """Position (x, y) of the light mass [m], shape (2, n)."""
        return np.concatenate(
            [np.stack(light_position(np, k.free_length, k.wrap_angle, p.rod_radius)) for k, p in self._each_trial], axis=1
        )

    @cached_property
    def _coordinates(self) -> Array:
        rows = [np.stack(coordinates_at(np, k, p)) for k, p in self._each_trial]
        return np.concatenate(rows, axis=1)

    @property
    def _each_trial(self) -> list[tuple[Kinematics, SimpleNamespace]]:
        k = self.kinematics
        return [
            (Kinematics(*(f[self.trial == i] if isinstance(f, np.ndarray) else f for f in k)), p)
            for i, p in enumerate(self.parameters)
        ]

    def where_it_acts(self, closure: Closure) -> Array:
        """Return the values of a closure's coordinate where it can act: friction and the heavy mass's force while it slides."""
        values = self.coordinate(closure.coordinate, closure.point)
        return values[self.sliding] if TARGETS[closure.target][0] in ("friction", "heavy") and self.sliding.any() else values

    def closure(
        self, target: str, name: str, factor: str = "constant", point: tuple[float, float] | None = None
    ) -> Closure | None:
        """Return a closure with its basis functions in their places; None: its coordinate is constant."""
        closure = Closure(coordinate=name, factor=factor, target=target, first_centre=0.0, spacing=1.0, point=point)
        low, high = np.quantile(self.where_it_acts(closure), [0.0, 0.995])
        spacing = float(high - low) / (N_BASIS_FUNCTIONS - 1 - 2 * END_MARGIN)
        if spacing < MIN_SPACING:
            return None
        return dataclasses.replace(closure, first_centre=float(low) - END_MARGIN * spacing, spacing=spacing)

    def best_from_point(self, target: str, evidence: Callable[[Closure], float]) -> Closure | None:
        """Return the closure of the distance from the point that has the most evidence; None: there is none."""
        from scipy.optimize import minimize

        x, y = self.positions

        def closure(point: Sequence[float]) -> Closure | None:
            return self.closure(target, "distance", point=(float(point[0]), float(point[1])))

        def cost(point: Sequence[float]) -> float:
            one = closure(point)
            return -evidence(one) if one else math.inf

        axes = [np.linspace(v.min() - POINT_MARGIN * np.ptp(v), v.max() + POINT_MARGIN * np.ptp(v), POINT_GRID) for v in (x, y)]
        start = min(((a, b) for a in axes[0] for b in axes[1]), key=cost)
        step = 0.5 * max(float(a[1] - a[0]) for a in axes)
        simplex = np.array([start, (start[0] + step, start[1]), (start[0], start[1] + step)])
        options = {"maxfev": MAX_POINT_TRIALS, "initial_simplex": simplex, "xatol": 1e-3, "fatol": 0.1}
        return closure(minimize(cost, start, method="Nelder-Mead", options=options).x)

    def pulses_of(self, k: int) -> Array:
        """Return the matrix that makes pulses of a function of time, at the samples of trial ``k``, shape (N_PULSES, n)."""
        t, spacing = self.kinematics.time[self.trial == k], self.pulse_spacing
        pulses = np.exp(-0.5 * ((t[:, None] - spacing * np.arange(N_PULSES)) / spacing) ** 2)
        return np.asarray(np.linalg.pinv(pulses, rcond=1e-4))

    def directions(self, closure: Closure) -> dict[str, Array]:
        """Return side of `PULSED_SIDES` -> the closure's push there per unit of its profile at all samples, side by side."""
        sides = TARGETS[closure.target]
        if sides != ("gradient",):
            factor = np.ones(len(self.trial)) if closure.factor == "constant" else -getattr(self.kinematics, closure.factor)
            return dict.fromkeys(sides, factor)
        to_right, upward = np.zeros(len(self.trial)), np.zeros(len(self.trial))
        if closure.point is None:
            (to_right if closure.coordinate == "horizontal_position" else upward)[:] = 1.0
        else:
            to_right, upward = (self.positions - np.array(closure.point)[:, None]) / self.coordinate("distance", closure.point)
        cosine, sine = np.cos(self.kinematics.wrap_angle), np.sin(self.kinematics.wrap_angle)
        return {"along": to_right * sine - upward * cosine, "across": -to_right * cosine - upward * sine}


def motions(fit: Fit) -> Motions:
    """Return the motion of all trials by a fit."""
    problem = fit.problem
    samples = [problem.run(fit.x, k) for k in range(len(problem.data))]
    fields = [
        (s.t, s.state.free_length, s.state.wrap_angle, s.state.retreat_speed, s.state.across_speed,
         np.abs(s.state.across_speed), np.hypot(s.state.retreat_speed, s.state.across_speed),
         s.state.heavy_speed, np.abs(s.state.heavy_speed))
        for s in samples
    ]  # fmt: skip
    modes = np.concatenate([s.mode for s in samples])
    return Motions(
        kinematics=Kinematics(*(np.concatenate(f) for f in zip(*fields, strict=True))),
        parameters=tuple(problem.parameters_and_camera(fit.x, k)[0].values() for k in range(len(samples))),
        trial=np.concatenate([np.full(len(s.t), k) for k, s in enumerate(samples)]),
        sliding=np.isin(modes, (Mode.SLIDING_DOWN, Mode.SLIDING_UP)),
        clamped=bool((modes == Mode.CLAMPED).all()),
    )


def respond(problem: Problem, x: Array, spacing: float, sides: Sequence[str]) -> Array:
    """Return the changes of the standardised prediction per unit of each pulse, shape (n, sides, N_PULSES).

    Parameters
    ----------
    spacing
        Distance of the pulses [s].
    sides
        Where they act, of `PULSED_SIDES`.
    """
    trials = tuple(t.name for t in problem.study.trials)
    names = [weight_name(side, i) for side in sides for i in range(N_BASIS_FUNCTIONS)]
    added = [FreeParameter(name=n, parameter=n, trials=trials, init_value=0.0, scale=PULSE_SIZE, prior=1.0) for n in names]
    parameters = (*problem.free_parameters, *added)
    prior = np.zeros(len(parameters)), np.eye(len(parameters))
    found = []
    for first in range(0, N_PULSES, N_BASIS_FUNCTIONS):
        closure = Closure(coordinate="time", factor="constant", target="", first_centre=first * spacing, spacing=spacing)
        pulsed = Problem(closure.added_to(problem.study), problem.data, parameters, prior)
        jacobian = pulsed.jacobian(np.append(x, np.zeros(len(added))))
        found.append(jacobian[: problem.measured_rows, len(x) :].reshape(-1, len(sides), N_BASIS_FUNCTIONS) / PULSE_SIZE)
    return np.concatenate(found, axis=2)
