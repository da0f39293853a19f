"""Changes of the prediction by every listed candidate beside a fit: derivatives, and finite changes where there are none."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from looping_pendulum.discrepancy.candidates import Candidate
from looping_pendulum.discrepancy.evidence.marginal import sigma_of
from looping_pendulum.discrepancy.evidence.prior import VISIBLE
from looping_pendulum.discrepancy.fit.calibration import Fit
from looping_pendulum.measured.free_parameter import FreeParameter
from looping_pendulum.pages.numbers import amount, quantity
from looping_pendulum.reference_ode.geometry import Array

SCALE_SIZE = 10.0
"""Change of the prediction by one scale of a candidate [RMS, in units of noise]."""
MIN_INDEPENDENT_SHARE = 1e-3
"""Smallest part of a change that the fitted parameters cannot make; below it, errors of the runs decide."""
FINITE_SIZES, SMALL_SIZE = (3.0, 12.0), 0.3
"""Changes of the prediction that are tried of a candidate without a derivative [RMS, in units of noise].

Only the small one counts of an effect that grows with the square of its value, and in a long swing: what a larger change does
to its phase, the fitted parameters nearly undo, so that the curvature would be left.
"""
LEAST_SIZE = 0.03
"""Size of the largest possible change below which a candidate changes nothing, or has no derivative to speak of."""
MAX_TRIES, MAX_FAILURES = 10, 2
"""Largest number of values of a candidate that are tried for a size, and of those with which the model cannot run."""
MAX_FACTOR = 100.0
"""Largest factor between two values that are tried, since far from there the change is hardly proportional."""
Case = tuple[Candidate, tuple[float, ...]]
"""A candidate and values of its companions."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Template:
    """What a value of a candidate does to the prediction."""

    candidate: Candidate
    companions: tuple[FreeParameter, ...]
    """Parameters that shape it, at the values for which this is its change."""
    delta: float
    """Change of its value [SI]."""
    change: Array
    """Change of the prediction [units of the data], shape (n,)."""
    scale: float
    """Change of the value that changes the prediction by about `SCALE_SIZE` [units of noise]."""
    finite: bool
    """Whether it is a change by this very value, not a derivative times it."""

    @property
    def stated_size(self) -> float:
        """Size of the change in stated errors of the value, of one that may be wrong; nan: of any other effect."""
        return abs(self.delta) / self.candidate.stated_error

    def value(self, amount: float) -> float | None:
        """Return the value less its null value [SI] that ``amount`` templates stand for; None: it is not possible."""
        if amount <= 0 and self.finite:
            return None
        value = self.delta * (amount**0.5 if self.candidate.even else amount)
        c = self.candidate
        return float(value) if c.bounds[0] <= c.null + value <= c.bounds[1] else None


def templates(fit: Fit, chosen: Sequence[Candidate], finite: dict[Case, list[Template]]) -> list[Template]:
    """Return the templates of candidates beside a fit.

    Parameters
    ----------
    finite
        Finite changes beside any fit, which are taken where they are known; those that are found are added. What they are
        beside another explanation hardly matters: exact fits begin there.
    """
    # A problem has each candidate once, so that those with other companions are in another one
    groups: dict[tuple[bytes, int], list[Case]] = {}
    for c in chosen:
        for i, values in enumerate(c.companion_grid()):
            if (c, values) not in finite and not c.even:
                groups.setdefault((c.where_it_acts(fit.problem.free_parameters, fit.x).tobytes(), i), []).append((c, values))
    derivatives: dict[Case, Template] = {}
    for (at, _), cases in groups.items():
        derivatives |= _derivatives(fit, np.frombuffer(at), cases)
    basis, sigma = np.linalg.qr(fit.jacobian)[0], sigma_of(fit.problem.data)

    def is_independent(t: Template) -> bool:
        return _independent_share(basis, _standardised(t.change, sigma)) >= MIN_INDEPENDENT_SHARE

    found = []
    for case in ((c, values) for c in chosen for values in c.companion_grid()):
        if case in derivatives and is_independent(derivatives[case]):
            found.append(derivatives[case])
            continue
        # What the fitted parameters can make to first order, they cannot where it is large
        if case not in finite:
            finite[case] = _finite_changes(fit, *case)
        found += filter(is_independent, finite[case])
    return found


def columns(found: Sequence[Template], n: int) -> Array:
    """Return the changes by templates, shape (n, m)."""
    return np.stack([t.change for t in found], axis=1) if found else np.zeros((n, 0))


def _derivatives(fit: Fit, x: Array, cases: Sequence[Case]) -> dict[Case, Template]:
    """Return the templates of candidates that have a derivative where the other parameters are ``x``."""
    companions = [c.companion_parameters(values) for c, values in cases]
    problem = fit.problem.with_parameters(
        *(c.free_parameter(1.0) for c, _ in cases), *(k for group in companions for k in group)
    )
    at = np.concatenate([x, np.zeros(len(problem.names) - len(x))])
    without = problem.without_derivative(at)
    # Minus the derivative of the residuals is that of the prediction
    jacobian = problem.jacobian(at)[: problem.measured_rows, len(x) : len(x) + len(cases)]
    sigma, found = sigma_of(problem.data), {}
    for (c, values), of_case, change in zip(cases, companions, jacobian.T, strict=True):
        size, reach = rms(change), max(c.bounds[1] - c.null, c.null - c.bounds[0])
        # A static friction that is hardly larger than the kinetic one changes nothing but rounding
        if c.name in without or size * reach < LEAST_SIZE:
            continue
        # The side on which there are values
        delta = (1.0 if c.bounds[1] > c.null else -1.0) / size
        found[c, values] = Template(
            candidate=c, companions=of_case, delta=delta, change=delta * change * sigma, scale=SCALE_SIZE / size, finite=False,
        )  # fmt: skip
    return found


def _finite_changes(fit: Fit, c: Candidate, companion_values: Sequence[float]) -> list[Template]:
    """Return what some values of a candidate do, to either side."""
    companions = c.companion_parameters(companion_values)
    problem = fit.problem.with_parameters(c.free_parameter(1.0), *companions)
    x = np.concatenate([c.where_it_acts(fit.problem.free_parameters, fit.x), np.zeros(1 + len(companions))])
    here, sigma = problem.residuals(x), sigma_of(problem.data)
    if here is None:
        return []
    happen = problem.events_that_happen(x)

    def change_to(side: int, size: float) -> Array | None:
        """Return the change of the standardised prediction; None: the model cannot run, or an event is lost."""
        there = x.copy()
        there[len(fit.x)] = side * size
        moved = problem.residuals(there)
        if moved is None or (len(happen) and np.any(happen & ~problem.events_that_happen(there))):
            return None
        return (here - moved)[: problem.measured_rows]

    found = []
    sizes = (SMALL_SIZE,) if problem.is_swing or c.even else FINITE_SIZES
    for side in (1,) if c.even else (1, -1):
        reach, tried = (c.bounds[side > 0] - c.null) * side, dict[float, Array | None]()
        for size in sizes if reach > 0 else ():
            value = _value_of_size(partial(change_to, side), reach, size, 1e-3 * abs(c.null) or 1e-6, tried)
            change = None if value is None else tried[value]
            if value is not None and change is not None:
                factor = SCALE_SIZE / rms(change)
                found.append(
                    Template(
                        candidate=c, companions=companions, delta=side * value, change=change * sigma,
                        scale=value * (math.sqrt(factor) if c.even else factor), finite=True,
                    )
                )  # fmt: skip
    return found


def _value_of_size(
    change: Callable[[float], Array | None], reach: float, size: float, first: float, tried: dict[float, Array | None]
) -> float | None:
    """Return a value, up to ``reach``, that changes the prediction by about ``size``; None: hardly anything changes.

    Steps are in proportion to the change that is missing. Between a change that is too small and one that is too large they
    follow a power law through both, since what an effect does may grow with the square of its value.

    Parameters
    ----------
    first
        Value that is tried first.
    tried
        Value -> change, of all that are known; None: the model cannot run. Those that are tried are added.
    """
    value = min(first, reach)
    for _ in range(MAX_TRIES):
        if value not in tried:
            tried[value] = change(value)
        sizes = sorted((v, rms(made)) for v, made in tried.items() if made is not None)
        near = [v for v, made in sizes if 0.5 < made / size < 2]
        if near:
            return near[0]
        failures = [v for v, made in tried.items() if made is None]
        low = max((s for s in sizes if s[1] < size), default=(0.0, 0.0))
        high = min((s for s in sizes if s[1] > size), default=(math.inf, math.inf))
        if low[0] >= reach or len(failures) > MAX_FAILURES:
            break
        # A string may stretch too little for the steps of a run, and another value be too large for it
        too_small = max((v for v in failures if v < min(high[0], *(v for v, _ in sizes), reach)), default=0.0)
        too_large = min((v for v in failures if v > low[0] > 0), default=math.inf)
        if low[1] > 0 and math.isfinite(high[1]):
            value = low[0] * (high[0] / low[0]) ** (math.log(size / low[1]) / math.log(high[1] / low[1]))
        elif low[0] or math.isinf(high[0]):
            bound = min(high[0], too_large)
            value = low[0] * min(size / max(low[1], 1e-30), MAX_FACTOR) if low[0] else 10 * too_small
            value = math.sqrt(max(low[0], bound / MAX_FACTOR) * bound) if value >= bound else value
        else:
            value = high[0] * max(size / high[1], 1 / MAX_FACTOR)
            value = math.sqrt(too_small * high[0]) if value <= too_small else value
        value = min(value, reach)
    larger = [v for v, made in tried.items() if made is not None and rms(made) > size]
    if larger:  # where a static friction holds the string for good, the change jumps
        return min(larger)
    at_most = tried.get(reach)
    return reach if at_most is not None and rms(at_most) > LEAST_SIZE else None


@dataclass(frozen=True, kw_only=True)
class SmallestVisible:
    """The smallest size of a candidate that these data would show."""

    candidate: Candidate
    value: float
    """Change of the value [unit of the candidate] that is four standard errors large (`prior.VISIBLE`)."""
    motion: float
    """RMS change of the predictions by this change, all else unchanged [units of noise]: what the fitted parameters hide."""
    can_hide: bool = False
    """Whether it changes nothing, however large it is, at the fit or with some of its companions' initial values: friction
    can hold a rod's bearing, and a drag of zero can be multiplied by anything."""

    @property
    def name(self) -> str:
        """Name of the candidate."""
        return self.candidate.name

    @property
    def in_words(self) -> str:
        """The value with its unit; of a factor, as a percentage."""
        unit = self.candidate.unit
        return f"{amount(self.value, 100)} %" if not unit and self.candidate.null == 1 else quantity(self.value, unit)


def smallest_visible(fit: Fit, found: Sequence[Template], complement: Array) -> list[SmallestVisible]:
    """Return the smallest visible size of every candidate that has a template, those that hide best first.

    Parameters
    ----------
    complement
        Gram matrix of the residuals and the templates beyond what the fitted parameters can do, shape (1 + m, 1 + m).
    """
    sigma = sigma_of(fit.problem.data)
    by_candidate: dict[str, dict[tuple[FreeParameter, ...], list[tuple[float, float]]]] = {}
    for t, square in zip(found, np.diag(complement)[1:], strict=True):
        amount = VISIBLE / math.sqrt(max(float(square), 1e-30))
        if t.finite and not t.candidate.even:
            # What does nothing up to some size, as static friction may, is only known to show at what was tried
            amount = max(amount, 1.0)
        value = abs(t.delta) * (math.sqrt(amount) if t.candidate.even else amount)
        motion = amount * rms(_standardised(t.change, sigma))
        by_candidate.setdefault(t.candidate.name, {}).setdefault(t.companions, []).append((value, motion))
    rows = []
    for c in {t.candidate.name: t.candidate for t in found}.values():
        cases = by_candidate[c.name]
        # Friction in its bearing, say, hides a rod that turns: the companions that hide it best say what is sure to show
        value, motion = max((min(of_case) for of_case in cases.values()), key=lambda one: one[0])
        acts = np.array_equal(fit.x, c.where_it_acts(fit.problem.free_parameters, fit.x))
        rows.append(
            SmallestVisible(candidate=c, value=value, motion=motion, can_hide=not acts or len(cases) < len(c.companion_grid()))
        )
    return sorted(rows, key=lambda v: (-v.motion, v.name))


def _independent_share(basis: Array, change: Array) -> float:
    """Return the size of the part of a change that the fitted parameters cannot make, relative to the change."""
    # A candidate has no row of its own in the prior
    whole = np.append(change, np.zeros(len(basis) - len(change)))
    part = whole - basis @ (basis.T @ whole)
    return float(np.linalg.norm(part)) / max(float(np.linalg.norm(whole)), 1e-300)


def _standardised(change: Array, sigma: Array) -> Array:
    return np.divide(change, sigma, out=np.zeros_like(sigma), where=sigma > 0)


def rms(v: Array) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(v**2)))
