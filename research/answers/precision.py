"""Solve the paper's four releases by every available solver, tolerance and precision, and by simple programs without events."""

import math
import warnings
from typing import Any

import numpy as np

from looping_pendulum.reference_ode.equations import Equations
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solution import Run
from looping_pendulum.reference_ode.solve import solve
from looping_pendulum.reference_ode.state import Signs, State
from looping_pendulum.reference_ode.transitions import Mode
from research import heyoka_runs

from .common import CASES, DURATION, PAPER_ANGLES, at_angle, case, letters, rounded

TOLERANCES = tuple(10.0**-k for k in range(8, 16))
REFERENCE_TOLERANCES = tuple(10.0**-k for k in range(8, 14))
"""Tolerances of the reference, whose least is 1e-13."""
STEPS = (0.02, 0.01, 0.005, 0.002, 0.001, 0.0001)
"""Fixed time steps of the simple programs [s]."""
PLOTTED_STEP = 0.02
"""Time step of the curves in the figure [s]."""
FIXED_STEP_DURATION = 3.0
"""Simulated time of the simple programs [s]."""
HALT_TOLERANCE = 1e-3
"""Largest distance from its final position at which the heavy mass of a simple program counts as halted [m]."""
SMOOTHING_SPEED = 0.01
"""Speed scale of the smoothed sign, tanh(u / `SMOOTHING_SPEED`) [m/s]."""
METHODS = ("rk4", "euler", "smooth")
"""Methods of the simple programs: Runge-Kutta with sign(u), Euler with sign(u), Runge-Kutta with the smoothed sign."""
DIVERGENCE_LIMIT = 1e6
"""Speed [m/s] or wrap angle [rad] beyond which a simple program's integration counts as diverged."""


def four_angles() -> dict[str, Any]:
    """Return halting times (or times of the last stop) of the four releases in every case, and deviations from 128 bits."""
    return {
        name: {f"{degrees:g}": _solve_with_every_solver(at_angle(case(name), degrees)) for degrees in PAPER_ANGLES}
        for name in CASES
    }


def _solve_with_every_solver(parameters: Parameters) -> dict[str, Any]:
    exact = heyoka_runs.solve(parameters, precision="128-bit", duration=DURATION)
    runs: dict[str, Run] = {"heyoka 80-bit": heyoka_runs.solve(parameters, precision="80-bit", duration=DURATION)}
    runs |= {f"heyoka {tol:.0e}": heyoka_runs.solve(parameters, duration=DURATION, tolerance=tol) for tol in TOLERANCES}
    runs |= {f"reference {tol:.0e}": solve(parameters, duration=DURATION, tolerance=tol) for tol in REFERENCE_TOLERANCES}
    return {
        "halting_time": None if exact.halting_time is None else str(exact.halting_time),
        "reported_time": str(_event_time(exact)),
        "reported": "halt" if exact.halting_time is not None else "last stop",
        "end_time": float(exact.end_time),
        "end": str(exact.end.event),
        "sequence": letters(exact.modes),
        "deviations": {label: _difference(_event_time(run), _event_time(exact)) for label, run in runs.items()},
        "same_sequence": {label: run.modes == exact.modes for label, run in runs.items()},
    }


def _difference(a: Any, b: Any) -> float:
    """Return ``a - b``, where ``a`` has any precision and ``b`` 128 bits."""
    return float((type(b)(str(a)) if isinstance(a, np.longdouble) else a) - b)


def _event_time(run: Run) -> Any:
    """Return the halting time, or the time of the last stop if the run does not halt [s]."""
    return run.stops[-1] if run.halting_time is None else run.halting_time


def plain_programs() -> dict[str, Any]:
    """Integrate the four releases by Runge-Kutta and Euler with fixed steps, without events or sticking."""
    summary: dict[str, Any] = {"steps": list(STEPS), "seen": HALT_TOLERANCE, "cases": {}}
    for name in CASES:
        halting_times: dict[str, Any] = {
            "exact": [apparent_halting_time(*exact_path(at_angle(case(name), d))) for d in PAPER_ANGLES]
        }
        for method in METHODS:
            halting_times[method] = [
                [apparent_halting_time(*fixed_step_path(at_angle(case(name), d), method, step)) for d in PAPER_ANGLES]
                for step in STEPS
            ]
        summary["cases"][name] = halting_times
    summary["curves"] = {"exact": _curves(exact_path), "rk4": _curves(lambda p: fixed_step_path(p, "rk4", PLOTTED_STEP))}
    summary["drawn_step"] = PLOTTED_STEP
    return summary


def _curves(path: Any) -> list[dict[str, Any]]:
    curves = []
    for degrees in PAPER_ANGLES:
        t, drop = path(at_angle(case("scenario"), degrees))
        keep = np.unique(np.linspace(0, len(t) - 1, min(len(t), 200)).astype(int))
        curves.append({"angle": degrees, "t": rounded(t[keep], 5), "drop": rounded(drop[keep], 5)})
    return curves


def exact_path(parameters: Parameters) -> tuple[np.ndarray, np.ndarray]:
    """Return times [s] and the heavy mass's drop [m] of the reference."""
    run = solve(parameters, duration=DURATION)
    t = np.linspace(0.0, run.end_time, 20001)
    return t, run.heavy_drop(run.sample(t).state)


def apparent_halting_time(t: np.ndarray, drop: np.ndarray) -> float | None:
    """Return the time from which the drop stays within `HALT_TOLERANCE` of its final value [s]; None if it never does."""
    away = np.flatnonzero(np.abs(drop - drop[-1]) > HALT_TOLERANCE)
    return None if away[-1] + 2 >= len(t) else round(float(t[away[-1] + 1]), 6)


def fixed_step_path(parameters: Parameters, method: str, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Return times [s] and drop [m] of an integration with fixed steps [s], whose friction has the sign of the current speed.

    This integrates the paper's pair of equations with sign(u) directly: nothing sticks, and a change of sign takes effect
    only at the next step.
    """
    y = np.array([parameters.free_length, parameters.release_angle, 0.0, 0.0])
    path = [y]
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        while len(path) * step < FIXED_STEP_DURATION and y[0] > parameters.end_length:
            try:
                y = _advance(parameters, y, method, step)
            except (OverflowError, ZeroDivisionError):
                break
            if not np.all(np.isfinite(y)) or np.abs(y).max() > DIVERGENCE_LIMIT:
                break
            path.append(y)
    rows = np.array(path)
    light_side_length = rows[:, 0] + parameters.rod_radius * rows[:, 1]  # length of string on the light mass's side [m]
    return step * np.arange(len(rows)), light_side_length[0] - light_side_length


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
    """Return the rates of (l, theta, u, w), from the reference's own equations of a sliding string."""
    slide = math.tanh(y[2] / SMOOTHING_SPEED) if smooth else float(np.sign(y[2]))
    signs = Signs(slide=slide, across=1.0 if y[3] >= 0 else -1.0, heavy=slide, phase=0.0)
    state = State(*y.tolist(), float(y[2]), 0.0)
    mode = Mode.SLIDING_UP if slide > 0 else Mode.SLIDING_DOWN
    rate = Equations(math, parameters.values(), parameters.effects).rates(mode, 0.0, state, signs)
    return np.array([rate.free_length, rate.wrap_angle, rate.retreat_speed, rate.across_speed])
