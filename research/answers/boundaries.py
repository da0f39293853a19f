"""Find where the sequence of events changes with the release angle and why, how far the motion jumps, and the exponents."""

import math
from collections import Counter
from typing import Any

import numpy as np

from looping_pendulum.reference_ode.batch import solve_batch
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solve import solve

from .common import CASES, DURATION, PAPER_ANGLES, at_angle, case, letters, rounded
from .grazing import ParameterLine, SequenceChange, approach, find_changes, gap
from .lyapunov import solve_tangent_map
from .uncertainty import uncertain_fractions, uncertainty_exponent

BRACKET_WIDTH = 1e-8
"""Width to which a change is bracketed [rad]; below about 1e-9 rad, rounding decides which events the solver finds."""
STATIC_EXCESS = 1.16
"""Ratio of static to kinetic friction in the comparison: the value that fits the paper's measured 2:1 trial best."""
DISTANCES = 10.0 ** -np.arange(1.5, 8.6, 0.5)
"""Distances for the uncertainty exponent, as fractions of each axis's range."""
FIRST_FITTED, FIRST_OF_TAIL = 2, 6
"""Indices of the first of `DISTANCES` to which the exponent is fitted, and of the first of its last four decades.

At larger distances almost every release is uncertain, so the fraction does not follow a power law there.
"""
OUTCOME_DURATION = 5.0
"""Limit on the simulated time of the runs whose outcomes are compared [s]."""
REPLICATES, STARTS = 8, 64
ANGLES, RATIOS = (60.0, 130.0), (1.0, 12.0)
"""Ranges of the release angle [deg] and of M2/M1."""


def near_75() -> dict[str, Any]:
    """Find the changes between 74 and 77 degrees in steps of 1e-4 deg, and examine two narrow intervals around 75.1 deg."""
    summary: dict[str, Any] = {}
    for name in CASES:
        line = ParameterLine(base=case(name), name="release_angle", duration=DURATION)
        values = np.radians(np.linspace(74.0, 77.0, 30001))
        scan = solve_batch(line.base, {line.name: values}, duration=DURATION)
        summary[name] = {
            "changes": [_describe_change(line, c) for c in find_changes(line, values, width=BRACKET_WIDTH)],
            "halting_time": rounded(scan.halting_time[::150], 7),
            "angle": rounded(np.degrees(values)[::150], 7),
            "largest_step": _largest_step(scan.halting_time),
            "zooms": [_zoom(line, half) for half in (1e-3, 1e-6)],
        }
    return summary


def _largest_step(times: np.ndarray) -> float | None:
    """Return the largest difference between halting times of neighbouring releases that both halt [s]."""
    steps = np.abs(np.diff(times))
    return float(np.nanmax(steps)) if np.isfinite(steps).any() else None


def _zoom(line: ParameterLine, half: float) -> dict[str, Any]:
    """Solve 2001 releases within ``half`` [deg] of 75.1 deg; count sequences and measure the halting time's curvature."""
    degrees = np.linspace(-half, half, 2001)
    scan = solve_batch(line.base, {line.name: np.radians(75.1 + degrees)}, duration=DURATION)
    times = scan.halting_time
    bend = None
    if np.isfinite(times).all():
        bend = float(np.abs(times - np.polyval(np.polyfit(degrees / half, times, 1), degrees / half)).max())
    return {"half_width": half, "sequences": len(np.unique(scan.sequence)), "from_line": bend}


def along_the_angle() -> dict[str, Any]:
    """Find every change between 60 and 130 degrees, with static friction equal to the kinetic one, and above it."""
    base = case("scenario")
    more = base.replace(static_friction=STATIC_EXCESS * base.coefficients["kinetic_friction"])
    values = np.radians(np.arange(*ANGLES, 0.02))
    out: dict[str, Any] = {"static_excess": STATIC_EXCESS}
    for name, parameters in (("equal", base), ("static_above", more)):
        line = ParameterLine(base=parameters, name="release_angle", duration=DURATION)
        out[name] = [_describe_change(line, c) for c in find_changes(line, values, width=BRACKET_WIDTH)]
    scan = solve_batch(base, {"release_angle": values}, duration=DURATION)
    out["angle"], out["halting_time"] = rounded(np.degrees(values)[::5], 6), rounded(scan.halting_time[::5], 6)
    out["kinds"] = dict(Counter(f"{c['kind']} {c['event']}" for c in out["equal"]))
    return out


def _describe_change(line: ParameterLine, c: SequenceChange) -> dict[str, Any]:
    distances = np.radians([1e-3, 1e-4, 1e-5])
    widths = (1e-4, 1e-6)
    middle = 0.5 * (c.low + c.high)
    return {
        "angle": float(f"{math.degrees(middle):.9g}"),
        "below": letters(c.sequences[0][0]),
        "above": letters(c.sequences[1][0]),
        "halting_times": rounded([math.nan if x is None else x for x in c.halting_times], 7),
        "kind": c.kind,
        "event": str(c.event),
        "rival": str(c.rival),
        "time": float(f"{c.time:.5g}"),
        "distances_deg": [1e-3, 1e-4, 1e-5],
        "quantity": rounded(approach(line, c, distances), 4),
        "gap_widths_deg": list(widths),
        "gap": rounded([gap(*(line.run(middle + math.radians(s * w) / 2) for s in (-1, 1))) for w in widths], 3),
    }


def family() -> dict[str, Any]:
    """Solve the paper's four releases over ranges of the unprinted parameters: friction, free length and string drag."""
    frictions, lengths, drags = np.linspace(0.2, 0.4, 41), np.linspace(0.3, 1.0, 29), (0.0, 1e-4, 1e-3)
    base = case("scenario")
    mesh = np.meshgrid(frictions, lengths, drags, np.radians(PAPER_ANGLES), indexing="ij")
    names = ("kinetic_friction", "free_length", "string_drag", "release_angle")
    columns = {n: m.ravel() for n, m in zip(names, mesh, strict=True)}
    columns["static_friction"] = columns["kinetic_friction"]
    scan = solve_batch(base, columns, duration=DURATION)
    times, codes = scan.halting_time.reshape(-1, len(PAPER_ANGLES)), scan.sequence.reshape(-1, len(PAPER_ANGLES))
    halts = np.isfinite(times)
    spread = np.where(halts.all(axis=1), times.max(axis=1) - times.min(axis=1), np.nan)
    same = (codes == codes[:, :1]).all(axis=1)
    worst = int(np.nanargmax(spread))
    return {
        "apparatuses": len(times),
        "same_sequence": int(same.sum()),
        "all_halt": int(halts.all(axis=1).sum()),
        "none_halts": int((~halts).all(axis=1).sum()),
        "some_halt": int((halts.any(axis=1) & ~halts.all(axis=1)).sum()),
        "largest_spread_same": float(np.nanmax(np.where(same, spread, np.nan))),
        "median_spread": float(np.nanmedian(spread)),
        "spread_above_50ms": int((spread > 0.05).sum()),
        "largest_spread": float(spread[worst]),
        "worst": {n: float(columns[n].reshape(-1, len(PAPER_ANGLES))[worst, 0]) for n in names[:3]},
        "worst_times": rounded(times[worst], 7),
        "spread": rounded(spread[np.isfinite(spread)], 3),
    }


def growth() -> dict[str, Any]:
    """Compute the largest growth of a small difference along the run at 75 degrees, and up to the halt for each angle."""
    out: dict[str, Any] = {}
    for name in CASES:
        parameters = at_angle(case(name), 75.0)
        run = solve(parameters, duration=DURATION)
        t = np.linspace(0.005, run.end_time * (1 - 1e-9), 400)
        s = solve_tangent_map(parameters, t, duration=DURATION)
        last = run.stops[-1]
        at = solve_tangent_map(parameters, np.array([last + 1e-9]), duration=DURATION)
        out[name] = {
            "t": rounded(t, 5),
            "growth": rounded(s.growth[:, 0], 5),
            "stops": rounded(run.stops, 6),
            "halting_time": run.halting_time,
            "end_time": run.end_time,
            "at_last_stop": {"t": last, "growth": at.growth[0, 0], "exponent": at.exponents[0, 0]},
        }
    base, rows = case("scenario"), []
    for degrees in np.arange(*ANGLES, 0.5):
        rows.append(_growth_at(at_angle(base, float(degrees)), float(degrees)))
    out["over_angle"] = rows
    return out


def _growth_at(parameters: Parameters, degrees: float) -> dict[str, Any]:
    run = solve(parameters, duration=DURATION)
    reference_time = run.halting_time if run.halting_time is not None else (run.stops[-1] if run.stops else run.end_time)
    t = np.unique([reference_time + 1e-9, *np.linspace(0.02, run.end_time * (1 - 1e-9), 200)])
    s = solve_tangent_map(parameters, t, duration=DURATION)
    k = int(np.searchsorted(t, reference_time))
    return {
        "angle": degrees,
        "halts": run.halting_time is not None,
        "time": float(f"{reference_time:.6g}"),
        "growth": float(f"{s.growth[k, 0]:.5g}"),
        "exponent": float(f"{s.exponents[k, 0]:.5g}"),
        "greatest": float(f"{s.growth[:, 0].max():.5g}"),
    }


def exponents() -> dict[str, Any]:
    """Fit uncertainty exponents of the sequence of modes: along the angle at M2/M1 = 2.5, and over angle and mass ratio."""
    base = case("scenario")

    def outcome_on_line(x: np.ndarray) -> np.ndarray:
        return _outcome_codes(base, {"release_angle": _scale_to_range(x[:, 0], *np.radians(ANGLES))})

    def outcome_in_plane(x: np.ndarray) -> np.ndarray:
        angle = _scale_to_range(x[:, 0], *np.radians(ANGLES))
        return _outcome_codes(
            base, {"release_angle": angle, "heavy_mass": light_mass * np.abs(_scale_to_range(x[:, 1], *RATIOS))}
        )

    light_mass = base.light_mass
    out: dict[str, Any] = {
        "eps": rounded(DISTANCES, 6),
        "starts": STARTS,
        "replicates": REPLICATES,
        "duration": OUTCOME_DURATION,
    }
    for name, outcome, dimension in (("line", outcome_on_line, 1), ("plane", outcome_in_plane, 2)):
        rows = uncertain_fractions(outcome, dimension, DISTANCES, count=STARTS, replicates=REPLICATES, seed=0)
        fit = uncertainty_exponent(DISTANCES[FIRST_FITTED:], rows[:, FIRST_FITTED:])
        tail = uncertainty_exponent(DISTANCES[FIRST_OF_TAIL:], rows[:, FIRST_OF_TAIL:])
        out[name] = {
            "fractions": [rounded(row, 5) for row in rows],
            "exponent": fit.value,
            "standard_error": fit.standard_error,
            "tail_exponent": tail.value,
            "tail_standard_error": tail.standard_error,
        }
    return out


def _scale_to_range(share: np.ndarray, low: float, high: float) -> np.ndarray:
    return low + (high - low) * share


def _outcome_codes(base: Parameters, columns: dict[str, np.ndarray]) -> np.ndarray:
    """Return a code of each run's outcome: its sequence of modes and the way in which it ended."""
    scan = solve_batch(base, columns, duration=OUTCOME_DURATION)
    # the highest byte of the hash is combined with the end, so that runs that end differently have different codes
    return scan.sequence ^ (scan.end.astype(np.uint64) << np.uint64(56))
