"""Write the page `research/answers.md` from a template; every number in it comes from the committed summaries."""

from pathlib import Path
from typing import Any

import jinja2
import numpy as np

from .common import CASES, DATA, DURATION, PAPER_ANGLES, read
from .precision import METHODS
from .questions import RATIO_STEP

TEMPLATE = Path(__file__).with_name("answers.md.j2")
EVENT_DESCRIPTIONS = {
    "slip_onset_down": "a slip onset downwards",
    "slip_onset_up": "a slip onset upwards",
    "stop": "a stop",
    "light_reaches_rod": "the light mass's arrival at the rod",
    "heavy_reaches_rod": "the heavy mass's arrival at the rod",
    "unwrapped": "the string's leaving the rod",
    "time_up": "the time limit",
}
END_WORDS = {
    "light_reaches_rod": "the light mass reaches the rod while the string slides",
    "heavy_reaches_rod": "the heavy mass is pulled up to the rod",
    "unwrapped": "the string leaves the rod",
    "time_up": "the outcome is undecided at the time limit",
}
KIND_WORDS = {
    "graze": "only just happens, or only just does not",
    "race": "comes only just before another event that ends the motion, or only just after it",
    "choice": "only just lets the string stick, or only just does not",
}


def render() -> str:
    """Return the page's text."""
    environment = jinja2.Environment(
        undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True, autoescape=False
    )
    environment.filters |= {"power": power, "f": fixed, "pct": percent}
    data = {file.stem: read(file.stem) for file in DATA.glob("*.json")}
    return environment.from_string(TEMPLATE.read_text()).render(
        **data,
        cases=CASES,
        angles=PAPER_ANGLES,
        methods=METHODS,
        event_words=EVENT_DESCRIPTIONS,
        kind_words=KIND_WORDS,
        end_words=END_WORDS,
        time_limit=DURATION,
        ratio_step=RATIO_STEP,
        derived=derived_values(data),
    )


def fixed(x: float | None, digits: int = 3) -> str:
    """Return a number with this many decimals, or a dash for None."""
    return "–" if x is None else f"{x:.{digits}f}"


def percent(x: float) -> str:
    """Return a share in per cent."""
    return f"{100 * x:.1f} %"


def power(x: float | None, digits: int = 1) -> str:
    """Return a number in the form 1.2e-3, or a dash for None."""
    if x is None:
        return "–"
    mantissa, exponent = f"{x:.{digits}e}".split("e")
    return f"{mantissa}e{int(exponent)}"


def derived_values(data: dict[str, Any]) -> dict[str, Any]:
    """Return the numbers of the page that are computed from the summaries."""
    worst = {name: _largest_deviations(data["four_angles"][name]) for name in CASES}
    return {
        "spread": {name: _spread(data["four_angles"][name]) for name in CASES},
        "worst": worst,
        "largest": max(error for by_solver in worst.values() for error in by_solver.values()),
        "all_same": all(all(a["same_sequence"].values()) for case in data["four_angles"].values() for a in case.values()),
        "solvers": len(next(iter(data["four_angles"]["scenario"].values()))["deviations"]) + 1,
        "near_75": {name: len(data["near_75"][name]["changes"]) for name in CASES},
        "along": _boundary_statistics(data["along_the_angle"]),
        "growth_to_halt": _growth(data["growth"]["over_angle"]),
        "cascade": _narrow_range(data["along_the_angle"]["equal"]),
        "shares": _halting_shares(data["halting_map"]),
        "friction_words": _friction_sentence(data["friction_and_radius"]["powers"]),
    }


def _event_times(angles: dict[str, Any]) -> list[float]:
    return [float(a["reported_time"]) for a in angles.values()]


def _spread(angles: dict[str, Any]) -> float:
    return max(_event_times(angles)) - min(_event_times(angles))


def _largest_deviations(angles: dict[str, Any]) -> dict[str, float]:
    """Return the largest deviation from the 128-bit run at any of the four angles, for each solver and tolerance."""
    labels = next(iter(angles.values()))["deviations"]
    return {label: max(abs(a["deviations"][label]) for a in angles.values()) for label in labels}


def _boundary_statistics(summary: dict[str, Any]) -> dict[str, Any]:
    """Count the changes of the sequence by kind, and state how fast the motions on their two sides approach each other."""
    out: dict[str, Any] = {"kinds": {}}
    for name in ("equal", "static_above"):
        gaps = np.array([c["gap"] for c in summary[name]], dtype=float)
        shrink_factors = gaps[:, 0] / gaps[:, 1]
        out[name] = {
            "count": len(summary[name]),
            "halting_changes": sum(_halting_time_jumps(c) for c in summary[name]),
            "largest_near": float(gaps[:, 1].max()),
            "continuous": int((shrink_factors > 50).sum()),
            "least_shrink": float(shrink_factors.min()),
        }
    for change in summary["equal"]:
        out["kinds"][change["kind"]] = out["kinds"].get(change["kind"], 0) + 1
    powers = [_power(c["distances_deg"], c["quantity"]) for c in summary["equal"] if None not in c["quantity"]]
    near_one = int((np.abs(np.array(powers) - 1) < 0.1).sum())
    out["power"] = {"median": float(np.median(powers)), "count": len(powers), "near_one": near_one}
    return out


def _halting_time_jumps(change: dict[str, Any]) -> bool:
    """Return whether the halting time jumps, appears or disappears at a change."""
    a, b = change["halting_times"]
    return (a is None) != (b is None) or (a is not None and abs(a - b) > 1e-3)


def _power(distances: list[float], quantity: list[float]) -> float:
    """Return the power of the distance with which the event's quantity goes to zero, from the two smallest distances."""
    x, y = np.log(distances[-2:]), np.log(np.abs(quantity[-2:]))
    return float((y[1] - y[0]) / (x[1] - x[0]))


def _growth(rows: list[dict[str, Any]]) -> dict[str, float]:
    halting = [r for r in rows if r["halts"]]
    return {
        "median": float(np.median([r["growth"] for r in halting])),
        "largest": max(r["growth"] for r in halting),
        "greatest": max(r["greatest"] for r in rows),
    }


def _narrow_range(changes: list[dict[str, Any]]) -> dict[str, float]:
    """Return the narrow range of angles in which most changes lie, and their number."""
    at = np.array([c["angle"] for c in changes])
    inside = (at > 99) & (at < 100)
    return {"count": int(inside.sum()), "low": float(at[inside].min()), "high": float(at[inside].max())} if inside.any() else {}


def _halting_shares(summary: dict[str, Any]) -> list[dict[str, float]]:
    """Return the share of release angles at which the heavy mass halts, for a few mass ratios."""
    ratios = np.array(summary["ratio"])
    nearest = [int(np.abs(ratios - r).argmin()) for r in (8.0, 4.0, 2.5, 2.0, 1.5, 1.2)]
    return [{"ratio": float(ratios[i]), "share": summary["share_per_ratio"][i]} for i in nearest]


def _friction_sentence(powers: dict[str, dict[str, float]]) -> str:
    friction, radius = (powers[name]["drop"] for name in ("kinetic_friction", "rod_radius"))
    return (
        f"At the 10:1 trial one per cent more friction changes the drop by {friction:.2f} %, "
        f"one per cent more radius by {radius:.2f} %."
    )
