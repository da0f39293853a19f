"""The paper's four releases by every solver, tolerance and precision at hand, and by plain programs that have no events."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np

from looping_pendulum.reference_ode import equations
from looping_pendulum.reference_ode.extended import solve_extended
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solution import Run
from looping_pendulum.reference_ode.solve import solve
from looping_pendulum.reference_ode.state import Signs, State
from looping_pendulum.reference_ode.transitions import Mode

from .common import CASES, DURATION, PAPER_ANGLES, at_angle, case, letters, rounded

TOLERANCES = tuple(10.0**-k for k in range(8, 16))
SCIPY_TOLERANCES = tuple(10.0**-k for k in range(8, 14))
"""DOP853 gains nothing below."""
STEPS = (0.02, 0.01, 0.005, 0.002, 0.001, 0.0001)
"""Fixed steps of the plain programs [s]."""
DRAWN_STEP = 0.02
"""Step of the curves that are drawn [s]."""
PLAIN_DURATION = 3.0
"""[s]"""
SEEN = 1e-3
"""A heavy mass counts as halted on a plot once it stays this near to its last place [m]."""
SMOOTH_SPEED = 0.01
"""Speed over which the smoothed sign tanh(u / `SMOOTH_SPEED`) turns over [m/s]."""
METHODS = ("rk4", "euler", "smooth")
"""Runge-Kutta with the sign of u; Euler with it; Runge-Kutta with the smoothed sign."""
FASTEST = 1e6
"""A plain run counts as broken down beyond this speed [m/s] or wrap angle [rad]."""


def four_angles() -> dict[str, Any]:
    """Halting times (or where there is none the end) of the four releases in every case, and their deviations from 128 bits."""
    return {name: {f"{degrees:g}": _one(at_angle(case(name), degrees)) for degrees in PAPER_ANGLES} for name in CASES}


def _one(parameters: Parameters) -> dict[str, Any]:
    exact = solve_extended(parameters, precision="128-bit", duration=DURATION)
    runs: dict[str, Run] = {"heyoka 80-bit": solve_extended(parameters, precision="80-bit", duration=DURATION)}
    runs |= {f"heyoka {tol:.0e}": solve(parameters, duration=DURATION, tolerance=tol) for tol in TOLERANCES}
    runs |= {
        f"scipy {tol:.0e}": solve(parameters, duration=DURATION, tolerance=tol, integrator="scipy") for tol in SCIPY_TOLERANCES
    }
    return {
        "halting_time": None if exact.halting_time is None else str(exact.halting_time),
        "told_time": str(_told(exact)),
        "told": "halt" if exact.halting_time is not None else "last stop",
        "end_time": float(exact.end_time),
        "end": str(exact.end.event),
        "sequence": letters(exact.modes),
        "deviations": {label: _apart(_told(run), _told(exact)) for label, run in runs.items()},
        "same_sequence": {label: run.modes == exact.modes for label, run in runs.items()},
    }


def _apart(a: Any, b: Any) -> float:
    """Difference of two numbers of any precision, ``b`` of 128 bits."""
    return float((type(b)(str(a)) if isinstance(a, np.longdouble) else a) - b)


def _told(run: Run) -> Any:
    """Halting time, or without one the time of the last stop [s]."""
    return run.stops[-1] if run.halting_time is None else run.halting_time


def plain_programs() -> dict[str, Any]:
    """What Runge-Kutta and Euler steps of fixed length make of the four releases, without events or sticking."""
    summary: dict[str, Any] = {"steps": list(STEPS), "seen": SEEN, "cases": {}}
    for name in CASES:
        found: dict[str, Any] = {"exact": [seen_halt(*exact_path(at_angle(case(name), d))) for d in PAPER_ANGLES]}
        for method in METHODS:
            found[method] = [
                [seen_halt(*plain_path(at_angle(case(name), d), method, step)) for d in PAPER_ANGLES] for step in STEPS
            ]
        summary["cases"][name] = found
    summary["curves"] = {"exact": _curves(exact_path), "rk4": _curves(lambda p: plain_path(p, "rk4", DRAWN_STEP))}
    summary["drawn_step"] = DRAWN_STEP
    return summary


def _curves(path: Any) -> list[dict[str, Any]]:
    curves = []
    for degrees in PAPER_ANGLES:
        t, drop = path(at_angle(case("scenario"), degrees))
        keep = np.unique(np.linspace(0, len(t) - 1, min(len(t), 200)).astype(int))
        curves.append({"angle": degrees, "t": rounded(t[keep], 5), "drop": rounded(drop[keep], 5)})
    return curves


def exact_path(parameters: Parameters) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] and drop of the heavy mass [m] of the exact run."""
    run = solve(parameters, duration=DURATION)
    t = np.linspace(0.0, run.end_time, 20001)
    return t, run.heavy_drop(run.sample(t).state)


def seen_halt(t: np.ndarray, drop: np.ndarray) -> float | None:
    """When the heavy mass comes to stay within `SEEN` of its last place [s]; None if it moves to the end."""
    away = np.flatnonzero(np.abs(drop - drop[-1]) > SEEN)
    return None if away[-1] + 2 >= len(t) else round(float(t[away[-1] + 1]), 6)


def plain_path(parameters: Parameters, method: str, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] and drop [m] with steps of fixed length [s], the friction's sign taken from the speed of the moment.

    This is the paper's pair of equations with sign(u) in it, integrated as it stands: nothing sticks, and a change of sign is
    met wherever a step happens to land.
    """
    y = np.array([parameters.free_length, parameters.release_angle, 0.0, 0.0])
    path = [y]
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        while len(path) * step < PLAIN_DURATION and y[0] > parameters.end_length:
            try:
                y = _advance(parameters, y, method, step)
            except (OverflowError, ZeroDivisionError):
                break
            if not np.all(np.isfinite(y)) or np.abs(y).max() > FASTEST:
                break
            path.append(y)
    rows = np.array(path)
    wound = rows[:, 0] + parameters.rod_radius * rows[:, 1]
    return step * np.arange(len(rows)), wound[0] - wound


def _advance(parameters: Parameters, y: np.ndarray, method: str, h: float) -> np.ndarray:
    smooth = method == "smooth"
    first = _rates(parameters, y, smooth)
    if method == "euler":
        return np.asarray(y + h * first)
    second = _rates(parameters, y + 0.5 * h * first, smooth)
    third = _rates(parameters, y + 0.5 * h * second, smooth)
    fourth = _rates(parameters, y + h * third, smooth)
    return np.asarray(y + h / 6 * (first + 2 * second + 2 * third + fourth))


def _rates(parameters: Parameters, y: np.ndarray, smooth: bool) -> np.ndarray:
    """Rates of (l, theta, u, w), from the reference's own equations of a sliding string."""
    slide = math.tanh(y[2] / SMOOTH_SPEED) if smooth else float(np.sign(y[2]))
    signs = Signs(slide=slide, across=1.0 if y[3] >= 0 else -1.0, heavy=slide, phase=0.0)
    state = State(*y.tolist(), float(y[2]), 0.0)
    mode = Mode.SLIDING_UP if slide > 0 else Mode.SLIDING_DOWN
    rate = equations.rates(math, mode, 0.0, state, signs, parameters.values(), parameters.effects)
    return np.array([rate.free_length, rate.wrap_angle, rate.retreat_speed, rate.across_speed])
