"""Answer the paper's other questions: where it halts, the lowest halting mass ratio, scaled masses, friction and rod radius."""

import math
from typing import Any

import numpy as np

from looping_pendulum.reference_ode.batch import ENDS, BatchResult, solve_batch
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solve import solve
from looping_pendulum.sweep import map_file
from looping_pendulum.sweep.map_file import MapPlan
from looping_pendulum.sweep.quantities import columns

from .common import CASES, case, letters, rounded, write_map
from .grazing import ParameterLine, explain

LOWEST_ANGLES = np.arange(3.0, 136.0, 3.0)
"""Release angles of the search for the lowest ratio [deg]."""
RATIO_STEP = 0.01
"""Step of the scan over M2/M1."""
LOWEST_RATIOS = np.arange(0.90, 2.001, RATIO_STEP)
"""Values of M2/M1 in the search for the lowest ratio."""

TIME_LIMITS = (2.0, 5.0, 10.0, 40.0)
"""Limits on the simulated time within which the heavy mass must halt [s]."""
LONGEST_TIME_LIMIT = TIME_LIMITS[-1]
RATIO_WIDTH = 1e-11
"""Width to which the lowest halting ratio is bracketed."""
SCENARIO = "ten_to_one"
FRICTION_THAT_HALTS = 0.32
"""Friction coefficient at which the heavy mass halts for every rod radius of the map."""
MAX_POWER_LAW_RESIDUAL = 0.05
"""Largest distance of the logarithms from a straight line at which a curve is called a power law."""


def run_plan(name: str) -> tuple[MapPlan, BatchResult]:
    """Solve every run of a shipped map file."""
    plan = map_file.load(name)
    values = plan.values_in(tuple(slice(0, n) for n in plan.sizes.values()))
    result = solve_batch(
        plan.scenario.parameters,
        columns(plan.scenario.parameters, values),
        duration=plan.duration,
        tolerance=plan.tolerance,
    )
    return plan, result


def _store(name: str, plan: MapPlan, result: BatchResult) -> None:
    shape = tuple(plan.sizes.values())
    write_map(
        name,
        **{axis.name: axis.values for axis in plan.axes},
        halting_time=result.halting_time.reshape(shape),
        end=result.end.reshape(shape).astype(np.uint8),
        stops=np.minimum(result.stops, 255).reshape(shape).astype(np.uint8),
    )


def halting_map() -> dict[str, Any]:
    """Map the halting time over release angle and mass ratio."""
    plan, result = run_plan("angle_and_ratio")
    _store("halting_map", plan, result)
    ratios = plan.axes[1].values
    shape = tuple(plan.sizes.values())
    halts = np.isfinite(result.halting_time).reshape(shape)
    first = result.stops.reshape(shape) == 1
    return {
        "scenario": SCENARIO,
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
    """Find the lowest M2/M1 that halts in every case, for each release angle and over all, within several time limits."""
    return {"watched": TIME_LIMITS} | {name: _lowest_halting_ratios(case(name)) for name in CASES}


def _lowest_halting_ratios(base: Parameters) -> dict[str, Any]:
    scan = _solve_grid(base, LOWEST_ANGLES, LOWEST_RATIOS)
    times = scan.halting_time.reshape(len(LOWEST_ANGLES), -1)
    at_75 = _halting_times(base, np.array([75.0]), LOWEST_RATIOS)
    shorter = {f"{limit:g}": _lowest_ratio_within(times, LOWEST_RATIOS, limit) for limit in TIME_LIMITS}
    lowest = shorter[f"{LONGEST_TIME_LIMIT:g}"]
    edges = np.array(
        [math.nan if math.isnan(r) else _bisect_lowest_ratio(base, a, r) for a, r in zip(LOWEST_ANGLES, lowest, strict=True)]
    )
    best = int(np.nanargmin(edges))
    angle, edge = float(LOWEST_ANGLES[best]), float(edges[best])
    for step in (0.2, 0.02):  # nearer and nearer to the best angle, and below the best ratio found so far
        angles, ratios = angle + step * np.arange(-10, 11), edge + step * 0.02 * np.arange(-10, 3)
        lowest_ratios = _lowest_ratio_within(_halting_times(base, angles, ratios), ratios, LONGEST_TIME_LIMIT)
        k = int(np.nanargmin(lowest_ratios))
        angle = round(float(angles[k]), 6)
        edge = _bisect_lowest_ratio(base, angle, float(lowest_ratios[k]), step * 0.02)
    edge_75 = _bisect_lowest_ratio(base, 75.0, float(_lowest_ratio_within(at_75, LOWEST_RATIOS, LONGEST_TIME_LIMIT)[0]))
    return {
        "angle": rounded(LOWEST_ANGLES),
        "edge": rounded(edges, 8),
        "watched": {limit: rounded(row, 5) for limit, row in shorter.items()},
        "lowest_by": {limit: float(f"{np.nanmin(row):.5g}") for limit, row in shorter.items()},
        "lowest_by_at_75": {
            f"{limit:g}": rounded(_lowest_ratio_within(at_75, LOWEST_RATIOS, limit), 5)[0] for limit in TIME_LIMITS
        },
        "ends_below": _ends_below(scan, edge),
        "halting_angles": int(np.isfinite(edges).sum()),
        "best": {"angle": angle, "ratio": edge, "why": (why := _explain_boundary(base, angle, edge))},
        "cut_short": bool(why["halting_time"] > 0.9 * LONGEST_TIME_LIMIT),
        "at_75": {"ratio": edge_75, "why": _explain_boundary(base, 75.0, edge_75)},
    }


def _solve_grid(base: Parameters, degrees: np.ndarray, ratios: np.ndarray) -> BatchResult:
    """Solve every (angle, ratio); the ratio varies fastest."""
    angle, ratio = np.meshgrid(np.radians(degrees), ratios, indexing="ij")
    columns = {"release_angle": angle.ravel(), "heavy_mass": base.light_mass * ratio.ravel()}
    return solve_batch(base, columns, duration=LONGEST_TIME_LIMIT)


def _halting_times(base: Parameters, degrees: np.ndarray, ratios: np.ndarray) -> np.ndarray:
    """Return the halting time of each (angle, ratio) [s], NaN if there is none, shape (angles, ratios)."""
    return _solve_grid(base, degrees, ratios).halting_time.reshape(len(degrees), len(ratios))


def _ends_below(scan: BatchResult, ratio: float) -> dict[str, float]:
    """Return in which ways the scan's runs with a lower ratio end, as shares."""
    below = np.tile(LOWEST_RATIOS, len(LOWEST_ANGLES)) < ratio
    return {str(end): float((scan.end[below] == i).mean()) for i, end in enumerate(ENDS) if below.any()}


def _lowest_ratio_within(times: np.ndarray, ratios: np.ndarray, limit: float) -> np.ndarray:
    """Return the lowest of the ``ratios`` that halts within ``limit`` [s], for each row of ``times``; NaN if none does."""
    halts = np.nan_to_num(times, nan=np.inf) <= limit
    return np.where(halts.any(axis=1), ratios[halts.argmax(axis=1)], np.nan)


def _bisect_lowest_ratio(base: Parameters, degrees: float, ratio: float, step: float = RATIO_STEP) -> float:
    """Bisect the lower end of the interval of halting ratios that contains ``ratio``, starting about a ``step`` below it."""
    line = _mass_ratio_line(base, degrees)
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


def _mass_ratio_line(base: Parameters, degrees: float) -> ParameterLine:
    return ParameterLine(base=base.replace(release_angle=math.radians(degrees)), name="heavy_mass", duration=LONGEST_TIME_LIMIT)


def _explain_boundary(base: Parameters, degrees: float, ratio: float) -> dict[str, Any]:
    """Explain which event decides between the runs just above and just below the lowest ratio."""
    line = _mass_ratio_line(base, degrees)
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
    """Scale both masses at a fixed ratio, with constant drag and with drag that grows as the cross-sections do."""
    plan, result = run_plan("masses_at_fixed_ratio")
    scales, ratios = (axis.values for axis in plan.axes)
    shape = tuple(plan.sizes.values())
    base = plan.scenario.parameters
    times = result.halting_time.reshape(shape)
    out: dict[str, Any] = {"scale": rounded(scales), "ratio": rounded(ratios), "ratios": []}
    for j, ratio in enumerate(ratios):
        heavy = base.replace(heavy_mass=float(ratio) * base.light_mass)
        free = solve(heavy.replace(light_drag=0.0, heavy_drag=0.0, string_drag=0.0), duration=plan.duration)
        solids = solve_batch(heavy, _scaled_as_solids(heavy, scales), duration=plan.duration).halting_time
        out["ratios"].append(
            {
                "ratio": float(ratio),
                "halting_time": rounded(times[:, j], 8),
                "as_solids": rounded(solids, 8),
                "without_drag": free.halting_time,
                "power": _fitted_power(scales, times[:, j], free.halting_time),
                "power_as_solids": _fitted_power(scales, solids, free.halting_time),
                "sometimes": bool(np.isfinite(times[:, j]).any() and not np.isfinite(times[:, j]).all()),
            }
        )
    out["identity"] = _mass_drag_equivalence(base)
    return out


def _scaled_as_solids(p: Parameters, scales: np.ndarray) -> dict[str, np.ndarray]:
    """Return masses that grow like volumes, with drag coefficients that grow like areas."""
    area = scales ** (2 / 3)
    return {
        "light_mass": p.light_mass * scales,
        "heavy_mass": p.heavy_mass * scales,
        "light_drag": p.coefficients["light_drag"] * area,
        "heavy_drag": p.coefficients["heavy_drag"] * area,
    }


def _fitted_power(scales: np.ndarray, times: np.ndarray, limit: float | None) -> float | None:
    """Fit the power of the scale with which the halting time approaches that without drag; None if it is no power law."""
    last = scales >= scales[-1] / 10
    if limit is None or not np.isfinite(times[last]).all():
        return None
    x, y = np.log(scales[last]), np.log(np.abs(times[last] - limit))
    fit = np.polyfit(x, y, 1)
    return float(fit[0]) if np.abs(y - np.polyval(fit, x)).max() < MAX_POWER_LAW_RESIDUAL else None


def _mass_drag_equivalence(base: Parameters) -> dict[str, Any]:
    """Compare runs with masses times s and runs with every drag coefficient divided by s, which are the same motion."""
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
    """Map the halting time over friction and rod radius for the 10:1 trial."""
    plan, result = run_plan("friction_and_radius")
    _store("friction_and_radius", plan, result)
    halts = np.isfinite(result.halting_time).reshape(tuple(plan.sizes.values()))
    base = plan.scenario.parameters
    frictions = plan.axes[0].values
    radii = plan.axes[1].values
    shown = [int(np.abs(radii - r).argmin()) for r in (0.002, 0.004, base.rod_radius, 0.010, 0.015, 0.020)]
    windows = [_halting_interval(frictions, halts[:, i]) for i in shown]
    return {
        "runs": plan.runs,
        "halts": float(halts.mean()),
        "windows": [{"radius": float(radii[i]), "low": w[0], "high": w[1]} for i, w in zip(shown, windows, strict=True)],
        "unwrapped_above": float((result.end.reshape(halts.shape)[frictions > 0.6] == ENDS.index("unwrapped")).mean()),
        "ends": {str(end): int((result.end == i).sum()) for i, end in enumerate(ENDS)},
        "powers": {name: _logarithmic_derivatives(base, name) for name in ("kinetic_friction", "rod_radius", "free_length")},
        "at": {"friction": base.coefficients["kinetic_friction"], "radius": base.rod_radius},
    }


def _halting_interval(frictions: np.ndarray, halts: np.ndarray) -> tuple[float, float]:
    """Return the lowest and highest friction of the interval around `FRICTION_THAT_HALTS` in which every run halts."""
    low = high = int(np.abs(frictions - FRICTION_THAT_HALTS).argmin())
    assert halts[low]
    while low > 0 and halts[low - 1]:
        low -= 1
    while high + 1 < len(halts) and halts[high + 1]:
        high += 1
    return float(frictions[low]), float(frictions[high])


def _logarithmic_derivatives(base: Parameters, name: str, step: float = 1e-3) -> dict[str, float]:
    """Return d ln(quantity) / d ln(``name``) for the quantities at the halt of ``base``, by central differences."""
    value = base.values().__dict__[name]
    quantities = []
    for factor in (1 + step, 1 - step):
        run = solve(base.replace(**{name: factor * value}))
        halt = run.halt
        assert halt is not None
        quantities.append((halt.time, float(run.heavy_drop(halt.state)), halt.state.free_length, halt.state.wrap_angle))
    width = math.log((1 + step) / (1 - step))
    names = ("halting_time", "drop", "free_length", "wrap_angle")
    return {n: math.log(a / b) / width for n, a, b in zip(names, *quantities, strict=True)}
