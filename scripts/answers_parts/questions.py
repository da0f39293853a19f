"""The paper's other questions: where it halts, the lowest mass ratio that halts, scaled masses, friction against rod radius."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from looping_pendulum.reference_ode.batch import ENDS, BatchResult, solve_batch
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solve import solve
from looping_pendulum.sweep import map_file
from looping_pendulum.sweep.grazing import ParameterLine, explain
from looping_pendulum.sweep.plan import MapPlan
from looping_pendulum.sweep.quantities import columns

from .common import CASES, case, letters, rounded, write_map

LOWEST_ANGLES = np.arange(3.0, 136.0, 3.0)
"""Release angles of the search for the lowest ratio [deg]."""
RATIO_STEP = 0.01
LOWEST_RATIOS = np.arange(0.90, 2.001, RATIO_STEP)
WATCHED = (2.0, 5.0, 10.0, 40.0)
"""Watches [s]: it must halt within one."""
LONGEST = WATCHED[-1]
RATIO_WIDTH = 1e-11
"""How narrowly the edge of the halting ratios is bracketed."""
POINT = "ten_to_one"
MIDDLE = 0.32
"""A friction that halts on every rod of the map."""
STRAIGHT = 0.05
"""A curve whose logarithm is this near to a straight line everywhere is called a power."""


def run_plan(name: str) -> tuple[MapPlan, BatchResult]:
    """Every run of a shipped map file."""
    plan = map_file.load(name)
    given = plan.design.given(tuple(slice(0, n) for n in plan.design.shape))
    result = solve_batch(
        plan.scenario.parameters,
        columns(plan.scenario.parameters, given),
        duration=plan.duration,
        tolerance=plan.tolerance,
    )
    return plan, result


def _store(name: str, plan: MapPlan, result: BatchResult) -> None:
    shape = plan.design.shape
    write_map(
        name,
        **{axis.name: axis.values for axis in plan.design.axes},
        halting_time=result.halting_time.reshape(shape),
        end=result.end.reshape(shape).astype(np.uint8),
        stops=np.minimum(result.stops, 255).reshape(shape).astype(np.uint8),
    )


def halting_map() -> dict[str, Any]:
    """Halting over release angle and mass ratio."""
    plan, result = run_plan("angle_and_ratio")
    _store("halting_map", plan, result)
    ratios = plan.design.axes[1].values
    halts = np.isfinite(result.halting_time).reshape(plan.design.shape)
    first = result.stops.reshape(plan.design.shape) == 1
    return {
        "scenario": POINT,
        "runs": plan.runs,
        "duration": plan.duration,
        "ends": {str(end): int((result.end == i).sum()) for i, end in enumerate(ENDS)},
        "halts": float(halts.mean()),
        "at_first_stop": float((halts & first).mean()),
        "ratio": rounded(ratios, 6),
        "share_per_ratio": rounded(halts.mean(axis=0), 4),
        "latest": float(np.nanmax(result.halting_time)),
        "earliest": float(np.nanmin(result.halting_time)),
    }


def lowest_ratio() -> dict[str, Any]:
    """The lowest M2/M1 that halts: for each release angle, and over all of them, in every case, within several watches."""
    return {"watched": WATCHED} | {name: _lowest(case(name)) for name in CASES}


def _lowest(base: Parameters) -> dict[str, Any]:
    scan = _scan(base, LOWEST_ANGLES, LOWEST_RATIOS)
    times = scan.halting_time.reshape(len(LOWEST_ANGLES), -1)
    at_75 = _times(base, np.array([75.0]), LOWEST_RATIOS)
    shorter = {f"{limit:g}": _first(times, LOWEST_RATIOS, limit) for limit in WATCHED}
    lowest = shorter[f"{LONGEST:g}"]
    edges = np.array([math.nan if math.isnan(r) else _edge(base, a, r) for a, r in zip(LOWEST_ANGLES, lowest, strict=True)])
    best = int(np.nanargmin(edges))
    angle, edge = float(LOWEST_ANGLES[best]), float(edges[best])
    for step in (0.2, 0.02):  # nearer and nearer to the best angle, and below the best ratio found so far
        angles, ratios = angle + step * np.arange(-10, 11), edge + step * 0.02 * np.arange(-10, 3)
        found = _first(_times(base, angles, ratios), ratios, LONGEST)
        k = int(np.nanargmin(found))
        angle = round(float(angles[k]), 6)
        edge = _edge(base, angle, float(found[k]), step * 0.02)
    edge_75 = _edge(base, 75.0, float(_first(at_75, LOWEST_RATIOS, LONGEST)[0]))
    return {
        "angle": rounded(LOWEST_ANGLES),
        "edge": rounded(edges, 8),
        "watched": {limit: rounded(row, 5) for limit, row in shorter.items()},
        "lowest_by": {limit: float(f"{np.nanmin(row):.5g}") for limit, row in shorter.items()},
        "lowest_by_at_75": {f"{limit:g}": rounded(_first(at_75, LOWEST_RATIOS, limit), 5)[0] for limit in WATCHED},
        "ends_below": _ends_below(scan, edge),
        "halting_angles": int(np.isfinite(edges).sum()),
        "best": {"angle": angle, "ratio": edge, "why": (why := _why(base, angle, edge))},
        "cut_short": bool(why["halting_time"] > 0.9 * LONGEST),
        "at_75": {"ratio": edge_75, "why": _why(base, 75.0, edge_75)},
    }


def _scan(base: Parameters, degrees: np.ndarray, ratios: np.ndarray) -> BatchResult:
    """Every (angle, ratio), the ratio fastest."""
    angle, ratio = np.meshgrid(np.radians(degrees), ratios, indexing="ij")
    columns = {"release_angle": angle.ravel(), "heavy_mass": base.light_mass * ratio.ravel()}
    return solve_batch(base, columns, duration=LONGEST)


def _times(base: Parameters, degrees: np.ndarray, ratios: np.ndarray) -> np.ndarray:
    """Halting time of each (angle, ratio) [s], nan without one, shape (angles, ratios)."""
    return _scan(base, degrees, ratios).halting_time.reshape(len(degrees), len(ratios))


def _ends_below(scan: BatchResult, ratio: float) -> dict[str, float]:
    """How the runs of the scan end whose ratio is lower, as shares."""
    below = np.tile(LOWEST_RATIOS, len(LOWEST_ANGLES)) < ratio
    return {str(end): float((scan.end[below] == i).mean()) for i, end in enumerate(ENDS) if below.any()}


def _first(times: np.ndarray, ratios: np.ndarray, limit: float) -> np.ndarray:
    """Lowest of the ``ratios`` that halts within ``limit`` [s], for each row of ``times``; nan without one."""
    halts = np.nan_to_num(times, nan=np.inf) <= limit
    return np.where(halts.any(axis=1), ratios[halts.argmax(axis=1)], np.nan)


def _edge(base: Parameters, degrees: float, ratio: float, step: float = RATIO_STEP) -> float:
    """Lower edge of the halting ratios that ``ratio`` belongs to, by bisection; about a ``step`` below it none halts."""
    line = _line(base, degrees)
    low, high = ratio - step, ratio
    while line.run(base.light_mass * low).halting_time is not None:
        low, high = low - step, low
    while high - low > RATIO_WIDTH:
        middle = 0.5 * (low + high)
        if line.run(base.light_mass * middle).halting_time is None:
            low = middle
        else:
            high = middle
    return high


def _line(base: Parameters, degrees: float) -> ParameterLine:
    return ParameterLine(base=base.replace(release_angle=math.radians(degrees)), name="heavy_mass", duration=LONGEST)


def _why(base: Parameters, degrees: float, ratio: float) -> dict[str, Any]:
    """What happens just above and just below the edge."""
    line = _line(base, degrees)
    low, high = ((ratio + s * 2 * RATIO_WIDTH) * base.light_mass for s in (-1, 1))
    change = explain(line, low, high)
    return {
        "kind": change.kind,
        "event": str(change.event),
        "rival": str(change.rival),
        "below": letters(change.sequences[0][0]),
        "below_end": str(change.sequences[0][1]),
        "above": letters(change.sequences[1][0]),
        "halting_time": change.halting_times[1],
        "quantity": change.quantity,
    }


def mass_scale() -> dict[str, Any]:
    """Both masses scaled, their ratio kept: with the drag as it is, and with drag that grows as the masses' faces do."""
    plan, result = run_plan("masses_at_fixed_ratio")
    scales, ratios = (axis.values for axis in plan.design.axes)
    shape = plan.design.shape
    base = plan.scenario.parameters
    times = result.halting_time.reshape(shape)
    out: dict[str, Any] = {"scale": rounded(scales), "ratio": rounded(ratios), "ratios": []}
    for j, ratio in enumerate(ratios):
        heavy = base.replace(heavy_mass=float(ratio) * base.light_mass)
        free = solve(heavy.replace(light_drag=0.0, heavy_drag=0.0, string_drag=0.0), duration=plan.duration)
        solids = solve_batch(heavy, _as_solids(heavy, scales), duration=plan.duration).halting_time
        out["ratios"].append(
            {
                "ratio": float(ratio),
                "halting_time": rounded(times[:, j], 8),
                "as_solids": rounded(solids, 8),
                "without_drag": free.halting_time,
                "power": _power(scales, times[:, j], free.halting_time),
                "power_as_solids": _power(scales, solids, free.halting_time),
                "sometimes": bool(np.isfinite(times[:, j]).any() and not np.isfinite(times[:, j]).all()),
            }
        )
    out["identity"] = _identity(base)
    return out


def _as_solids(p: Parameters, scales: np.ndarray) -> dict[str, np.ndarray]:
    """Masses that grow as volumes do, their drag as areas do."""
    face = scales ** (2 / 3)
    return {
        "light_mass": p.light_mass * scales,
        "heavy_mass": p.heavy_mass * scales,
        "light_drag": p.coefficients["light_drag"] * face,
        "heavy_drag": p.coefficients["heavy_drag"] * face,
    }


def _power(scales: np.ndarray, times: np.ndarray, limit: float | None) -> float | None:
    """Power of the scale with which the halting time goes to that without drag, over the last decade; None if it is none."""
    last = scales >= scales[-1] / 10
    if limit is None or not np.isfinite(times[last]).all():
        return None
    x, y = np.log(scales[last]), np.log(np.abs(times[last] - limit))
    fit = np.polyfit(x, y, 1)
    return float(fit[0]) if np.abs(y - np.polyval(fit, x)).max() < STRAIGHT else None


def _identity(base: Parameters) -> dict[str, Any]:
    """Masses times s, or every drag over s: the same motion."""
    drags = ("light_drag", "heavy_drag", "string_drag")
    apart = []
    for s in (0.2, 3.0, 50.0):
        heavier = base.replace(light_mass=s * base.light_mass, heavy_mass=s * base.heavy_mass)
        thinner = base.replace(**{name: base.coefficients[name] / s for name in drags})
        a, b = solve(heavier), solve(thinner)
        assert a.halting_time is not None
        assert b.halting_time is not None
        apart.append(abs(a.halting_time - b.halting_time))
    return {"scales": [0.2, 3.0, 50.0], "largest_difference": max(apart)}


def friction_and_radius() -> dict[str, Any]:
    """Friction against rod radius for the 10:1 trial."""
    plan, result = run_plan("friction_and_radius")
    _store("friction_and_radius", plan, result)
    halts = np.isfinite(result.halting_time).reshape(plan.design.shape)
    base = plan.scenario.parameters
    frictions = plan.design.axes[0].values
    radii = plan.design.axes[1].values
    shown = [int(np.abs(radii - r).argmin()) for r in (0.002, 0.004, base.rod_radius, 0.010, 0.015, 0.020)]
    windows = [_window(frictions, halts[:, i]) for i in shown]
    return {
        "runs": plan.runs,
        "halts": float(halts.mean()),
        "windows": [{"radius": float(radii[i]), "low": w[0], "high": w[1]} for i, w in zip(shown, windows, strict=True)],
        "unwrapped_above": float((result.end.reshape(halts.shape)[frictions > 0.6] == ENDS.index("unwrapped")).mean()),
        "ends": {str(end): int((result.end == i).sum()) for i, end in enumerate(ENDS)},
        "powers": {name: _powers(base, name) for name in ("kinetic_friction", "rod_radius", "free_length")},
        "at": {"friction": base.coefficients["kinetic_friction"], "radius": base.rod_radius},
    }


def _window(frictions: np.ndarray, halts: np.ndarray) -> tuple[float, float]:
    """Lowest and highest friction of the unbroken run of halting ones round `MIDDLE`."""
    low = high = int(np.abs(frictions - MIDDLE).argmin())
    assert halts[low]
    while low > 0 and halts[low - 1]:
        low -= 1
    while high + 1 < len(halts) and halts[high + 1]:
        high += 1
    return float(frictions[low]), float(frictions[high])


def _powers(base: Parameters, name: str, step: float = 1e-3) -> dict[str, float]:
    """Logarithmic derivatives d ln(quantity) / d ln(``name``) at the halt of ``base``, by central differences."""
    value = base.values().__dict__[name]
    told = []
    for factor in (1 + step, 1 - step):
        run = solve(base.replace(**{name: factor * value}))
        halt = run.halt
        assert halt is not None
        told.append((halt.time, float(run.heavy_drop(halt.state)), halt.state.free_length, halt.state.wrap_angle))
    width = math.log((1 + step) / (1 - step))
    names = ("halting_time", "drop", "free_length", "wrap_angle")
    return {n: math.log(a / b) / width for n, a, b in zip(names, *told, strict=True)}
