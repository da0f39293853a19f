"""Infer the parameters that the paper does not print (release angle, free length, drag) from its numerical columns.

    python -m research.infer_paper_trials --data ../shared/data

The paper prints masses, the friction coefficient of the 10:1 trial and the rod's diameter (1.2 to 1.3 cm), but neither the
release angle nor the free length, and drag only by its order of magnitude. This fits them so that the reference reproduces the
*numerical* columns of the paper's tables (its own model's output, so the model is not in question), from many starts, for
several rod radii, and prints the values, the rows that they give, and the differences from the table. It writes no file.

Since the tables are rounded, a family of values fits them. Of those that keep every row within MAX_MISS half digits, the script
chooses the one whose drag is nearest, in decades, to the paper's estimates (1e-3 in SI units for both masses and the string).
"""

import argparse
import csv
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from looping_pendulum.errors import HarnessError
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solution import Solution
from looping_pendulum.reference_ode.solve import solve
from looping_pendulum.reference_ode.transitions import Event, Mode

Array = np.ndarray
START_COUNT = 16
SAMPLE_STEP = 5e-4
DRAG_ESTIMATE = 1e-3
"""The paper's order of magnitude for both masses [kg/m] and for the string [kg/m^2]."""
MAX_MISS = 0.93
"""Largest difference from a row, in half printed digits, that is allowed when the drag is chosen among equally good values."""


@dataclass(frozen=True)
class Trial:
    """The parameters that are fitted to one of the paper's tables."""

    name: str
    file: str
    fixed: dict[str, float]
    free: dict[str, tuple[float, float, float]]
    """Parameter -> (lower bound, upper bound, scale by which the fit divides it)."""
    predict: Callable[[Solution], dict[tuple[str, int], float]]


def velocity_zeros(t: Array, velocity: Array) -> Array:
    """Return the times at which a sampled velocity changes sign, by linear interpolation."""
    i = np.flatnonzero(velocity[:-1] * velocity[1:] < 0)
    return t[i] + (t[i + 1] - t[i]) * velocity[i] / (velocity[i] - velocity[i + 1])


def predict_ten_to_one(run: Solution) -> dict[tuple[str, int], float]:
    """Predict the rows of the 10:1 table."""
    t = np.arange(0.0, run.end_time, SAMPLE_STEP)
    velocity = run.sample(t).light_velocity
    rows = {
        (f"{axis}1_extremum", i + 1): time
        for axis, column in (("x", 0), ("y", 1))
        for i, time in enumerate(velocity_zeros(t[1:], velocity[1:, column])[:7])
    }
    if run.halt is not None:
        rows["halting_time", 1] = run.halt.time
        rows["drop_at_halt", 1] = float(run.heavy_drop(run.halt.state))
        rows["wrap_angle_at_halt", 1] = run.halt.state.wrap_angle
        rows["free_length_at_halt", 1] = run.halt.state.free_length
    rows["time_light_reaches_rod", 1] = run.end_time
    return rows


def predict_two_to_one(run: Solution) -> dict[tuple[str, int], float]:
    """Predict the rows of the 2:1 table; empty if the run does not have their sequence of events."""
    stops = [e for e in run.events if e.event is Event.STOP]
    breaks = [e for e in run.events if e.event is Event.SLIP_ONSET_DOWN]
    rows: dict[tuple[str, int], float] = {}
    if len(stops) >= 3 and breaks and stops[0].mode_after is Mode.SLIDING_UP and stops[1].mode_after is Mode.STICKING:
        for name, event in (("A", stops[0]), ("B", stops[1])):
            rows[f"t_{name}", 1] = event.time
            rows[f"height_change_at_{name}", 1] = -float(run.heavy_drop(event.state))
        rows["t_C", 1] = breaks[0].time
        rows["halting_time", 1] = stops[2].time
        rows["height_change_at_halt", 1] = -float(run.heavy_drop(stops[2].state))
    return rows


TRIALS = [
    Trial(
        name="ten_to_one",
        file="paper/trial_10to1.csv",
        fixed={"light_mass": 0.01, "heavy_mass": 0.1},
        free={
            "release_angle": (math.radians(60), math.radians(140), 0.1),
            "free_length": (0.4, 0.8, 0.05),
            "kinetic_friction": (0.335, 0.345, 0.01),
            "light_drag": (0.0, 4e-3, 1e-3),
            "heavy_drag": (0.0, 4e-3, 1e-3),
            "string_drag": (0.0, 8e-3, 1e-3),
        },
        predict=predict_ten_to_one,
    ),
    Trial(
        name="two_to_one",
        file="paper/trial_2to1.csv",
        fixed={"light_mass": 0.05, "heavy_mass": 0.1},
        free={
            "release_angle": (math.radians(50), math.radians(120), 0.1),
            "free_length": (0.4, 0.8, 0.05),
            "kinetic_friction": (0.1, 0.5, 0.05),
            "light_drag": (0.0, 4e-3, 1e-3),
            "heavy_drag": (0.0, 4e-3, 1e-3),
            "string_drag": (0.0, 8e-3, 1e-3),
        },
        predict=predict_two_to_one,
    ),
]


def read_numerical_column(path: Path) -> dict[tuple[str, int], tuple[float, float]]:
    """Read a table as (quantity, index) -> (value, half of its last printed digit)."""
    table = {}
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    for row in csv.DictReader(lines):
        text = row["paper_numerical"]
        digits = len(text.partition(".")[2])
        table[row["quantity"], int(row["index"])] = float(text), 0.5 * 10.0**-digits
    return table


def residuals(trial: Trial, radius: float, table: dict[tuple[str, int], tuple[float, float]], x: Array) -> Array:
    """Return predicted less printed values in half printed digits; 40 for a row that the run does not have."""
    scaled = {name: value * scale for value, (name, (_, _, scale)) in zip(x, trial.free.items(), strict=True)}
    try:
        rows = trial.predict(solve(parameters(trial, radius, scaled), tolerance=1e-10))
    except HarnessError:
        rows = {}
    return np.array([(rows[key] - value) / half if key in rows else 40.0 for key, (value, half) in table.items()])


def parameters(trial: Trial, radius: float, values: dict[str, float]) -> Parameters:
    """Return the trial's apparatus with these values."""
    base = Parameters(rod_radius=radius, free_length=0.5, release_angle=1.5, **trial.fixed)
    return base.replace(**values)


def infer(
    trial: Trial, radius: float, table: dict[tuple[str, int], tuple[float, float]], seed: int
) -> tuple[float, dict[str, float]]:
    """Fit from many starts; return the largest difference in half digits, and the best values."""
    rng = np.random.default_rng(seed)
    low, high = (np.array([b[k] / b[2] for b in trial.free.values()]) for k in (0, 1))
    middle = np.array([1.8 / 0.1 if trial.name == "ten_to_one" else 1.2 / 0.1, 0.58 / 0.05])
    tries = [np.concatenate([middle * rng.uniform(0.85, 1.15, 2), rng.uniform(low[2:], high[2:])]) for _ in range(400)]
    tries.sort(key=lambda x: float(np.sum(residuals(trial, radius, table, x) ** 2)))
    fits = [
        least_squares(
            lambda x, power=power: (
                residuals(trial, radius, table, x) ** power
            ),  # cubed residuals weight the largest one most, so that this fit approaches the minimax solution
            np.clip(start, low, high),
            bounds=(low, high),
            diff_step=1e-5,
            max_nfev=80,
        ).x
        for start in tries[:START_COUNT]
        for power in (1, 3)
    ]
    fits += [prefer_plausible_drag(trial, radius, table, x, floor) for x in fits[:START_COUNT] for floor in (1e-3, 0.5)]

    def objective(x: Array) -> float:
        miss = float(np.max(np.abs(residuals(trial, radius, table, x))))
        return max(0.0, miss - MAX_MISS - 0.05) * 1e3 + float(np.sum(implausibility(trial, x) ** 2))

    best = min(fits, key=objective)
    miss = float(np.max(np.abs(residuals(trial, radius, table, best))))
    return miss, {name: v * s for v, (name, (_, _, s)) in zip(best, trial.free.items(), strict=True)}


def implausibility(trial: Trial, x: Array) -> Array:
    """Return the distance in decades between each drag coefficient and the paper's estimate."""
    scales = np.array([scale for _, _, scale in list(trial.free.values())[-3:]])
    return np.log10(np.maximum(x[-3:] * scales, 1e-9) / DRAG_ESTIMATE)


def prefer_plausible_drag(
    trial: Trial, radius: float, table: dict[tuple[str, int], tuple[float, float]], start: Array, floor: float
) -> Array:
    """Move along the family of equal fits towards plausible drag; start from drag of at least ``floor`` (in its scale)."""
    low, high = (np.array([b[k] / b[2] for b in trial.free.values()]) for k in (0, 1))

    def unpack(z: Array) -> Array:
        return np.concatenate([z[:3], 10.0 ** z[3:]])

    def cost(z: Array) -> Array:
        x = unpack(z)
        excess = np.maximum(np.abs(residuals(trial, radius, table, x)) - MAX_MISS, 0.0)
        return np.concatenate([30.0 * excess, 0.1 * implausibility(trial, x)])

    z0 = np.concatenate([start[:3], np.log10(np.clip(start[3:], floor, high[3:] * 0.999))])
    bounds = (np.concatenate([low[:3], np.full(3, -6.0)]), np.concatenate([high[:3], np.log10(high[3:])]))
    return unpack(least_squares(cost, np.clip(z0, *bounds), bounds=bounds, diff_step=1e-5, max_nfev=120).x)


def main() -> None:
    """Print the inferred values of both trials for several rod radii."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder that holds paper/trial_10to1.csv")
    parser.add_argument("--radius", type=float, nargs="*", default=[6.0, 6.25, 6.5], help="rod radii to try [mm]")
    parser.add_argument("--trial", choices=[t.name for t in TRIALS], help="only this trial")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    for trial in TRIALS:
        if options.trial not in (None, trial.name):
            continue
        table = read_numerical_column(options.data / trial.file)
        for radius in options.radius:
            miss, values = infer(trial, radius * 1e-3, table, options.seed)
            print(f"\n{trial.name}, R = {radius:g} mm: largest miss {miss:.2f} half digits")
            print(
                "  "
                + ", ".join(
                    f"{k} = {math.degrees(v):.3f} deg" if k == "release_angle" else f"{k} = {v:.6g}" for k, v in values.items()
                )
            )
            rows = trial.predict(solve(parameters(trial, radius * 1e-3, values)))
            for (quantity, index), (value, half) in table.items():
                predicted = rows.get((quantity, index), math.nan)
                miss_text = f"{predicted - value:+.4f} ({(predicted - value) / half:+.2f} half digits)"
                print(f"  {quantity:24s} {index}  paper {value:8.3f}  here {predicted:9.4f}  miss {miss_text}")


if __name__ == "__main__":
    main()
