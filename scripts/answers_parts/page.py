"""The page `docs/answers.md`: a template, and every number in it from the committed summaries."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jinja2
import numpy as np

from .common import CASES, DURATION, PAPER_ANGLES, read
from .precision import METHODS
from .questions import RATIO_STEP

TEMPLATE = Path(__file__).with_name("answers.md.j2")
SUMMARIES = (
    "four_angles",
    "plain_programs",
    "growth",
    "near_75",
    "along_the_angle",
    "family",
    "exponents",
    "halting_map",
    "lowest_ratio",
    "mass_scale",
    "friction_and_radius",
)
EVENT_WORDS = {
    "slip_onset_down": "a slip onset downwards",
    "slip_onset_up": "a slip onset upwards",
    "stop": "a stop",
    "light_reaches_rod": "the light mass's arrival at the rod",
    "heavy_reaches_rod": "the heavy mass's arrival at the rod",
    "unwrapped": "the string's leaving the rod",
    "time_up": "the end of the watched time",
}
END_WORDS = {
    "light_reaches_rod": "the light mass reaches the rod while the string slides",
    "heavy_reaches_rod": "the heavy mass is pulled up to the rod",
    "unwrapped": "the string leaves the rod",
    "time_up": "it is undecided when the watch ends",
}
KIND_WORDS = {
    "graze": "only just happens, or only just does not",
    "race": "comes just before another event that ends the motion, or just too late",
    "choice": "leaves the string just held, or just not",
}


def render() -> str:
    """Return the page's text."""
    environment = jinja2.Environment(
        undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True, autoescape=False
    )
    environment.filters |= {"power": power, "f": fixed, "pct": percent}
    data = {name: read(name) for name in SUMMARIES}
    return environment.from_string(TEMPLATE.read_text()).render(
        **data,
        cases=CASES,
        angles=PAPER_ANGLES,
        methods=METHODS,
        event_words=EVENT_WORDS,
        kind_words=KIND_WORDS,
        end_words=END_WORDS,
        watch=DURATION,
        ratio_step=RATIO_STEP,
        told=told(data),
    )


def fixed(x: float | None, digits: int = 3) -> str:
    """A number with this many decimals; a dash for none."""
    return "–" if x is None else f"{x:.{digits}f}"


def percent(x: float) -> str:
    """A share in per cent."""
    return f"{100 * x:.1f} %"


def power(x: float | None, digits: int = 1) -> str:
    """A number as 1.2e-3."""
    if x is None:
        return "–"
    mantissa, exponent = f"{x:.{digits}e}".split("e")
    return f"{mantissa}e{int(exponent)}"


def told(data: dict[str, Any]) -> dict[str, Any]:
    """What the page says that is not in a summary as it stands."""
    worst = {name: _worst(data["four_angles"][name]) for name in CASES}
    return {
        "spread": {name: _spread(data["four_angles"][name]) for name in CASES},
        "worst": worst,
        "largest": max(error for by_solver in worst.values() for error in by_solver.values()),
        "all_same": all(all(a["same_sequence"].values()) for case in data["four_angles"].values() for a in case.values()),
        "solvers": len(next(iter(data["four_angles"]["scenario"].values()))["deviations"]) + 1,
        "near_75": {name: len(data["near_75"][name]["changes"]) for name in CASES},
        "along": _along(data["along_the_angle"]),
        "growth_to_halt": _growth(data["growth"]["over_angle"]),
        "cascade": _cascade(data["along_the_angle"]["equal"]),
        "shares": _shares(data["halting_map"]),
        "friction_words": _friction_words(data["friction_and_radius"]["powers"]),
    }


def _times(angles: dict[str, Any]) -> list[float]:
    return [float(a["told_time"]) for a in angles.values()]


def _spread(angles: dict[str, Any]) -> float:
    return max(_times(angles)) - min(_times(angles))


def _worst(angles: dict[str, Any]) -> dict[str, float]:
    """Largest deviation from 128 bits at any of the four angles, by solver and tolerance."""
    labels = next(iter(angles.values()))["deviations"]
    return {label: max(abs(a["deviations"][label]) for a in angles.values()) for label in labels}


def _along(found: dict[str, Any]) -> dict[str, Any]:
    """Kinds of the changes, and how the two sides come together."""
    out: dict[str, Any] = {"kinds": {}}
    for name in ("equal", "static_above"):
        gaps = np.array([c["gap"] for c in found[name]], dtype=float)
        shrinks = gaps[:, 0] / gaps[:, 1]
        out[name] = {
            "count": len(found[name]),
            "halting_changes": sum(_jumps(c) for c in found[name]),
            "largest_near": float(gaps[:, 1].max()),
            "continuous": int((shrinks > 50).sum()),
            "least_shrink": float(shrinks.min()),
        }
    for change in found["equal"]:
        out["kinds"][change["kind"]] = out["kinds"].get(change["kind"], 0) + 1
    powers = [_power(c["distances_deg"], c["quantity"]) for c in found["equal"] if None not in c["quantity"]]
    near_one = int((np.abs(np.array(powers) - 1) < 0.1).sum())
    out["power"] = {"median": float(np.median(powers)), "count": len(powers), "near_one": near_one}
    return out


def _jumps(change: dict[str, Any]) -> bool:
    """Whether the halting time jumps, appears or disappears."""
    a, b = change["halting_times"]
    return (a is None) != (b is None) or (a is not None and abs(a - b) > 1e-3)


def _power(distances: list[float], quantity: list[float]) -> float:
    """Power of the distance with which what passes zero goes to zero, from the two nearest distances."""
    x, y = np.log(distances[-2:]), np.log(np.abs(quantity[-2:]))
    return float((y[1] - y[0]) / (x[1] - x[0]))


def _growth(rows: list[dict[str, Any]]) -> dict[str, float]:
    halting = [r for r in rows if r["halts"]]
    return {
        "median": float(np.median([r["growth"] for r in halting])),
        "largest": max(r["growth"] for r in halting),
        "greatest": max(r["greatest"] for r in rows),
    }


def _cascade(changes: list[dict[str, Any]]) -> dict[str, float]:
    """The narrow band of angles in which most changes lie."""
    at = np.array([c["angle"] for c in changes])
    inside = (at > 99) & (at < 100)
    return {"count": int(inside.sum()), "low": float(at[inside].min()), "high": float(at[inside].max())} if inside.any() else {}


def _shares(found: dict[str, Any]) -> list[dict[str, float]]:
    """Share of angles that halt, at a few ratios."""
    ratios = np.array(found["ratio"])
    nearest = [int(np.abs(ratios - r).argmin()) for r in (8.0, 4.0, 2.5, 2.0, 1.5, 1.2)]
    return [{"ratio": float(ratios[i]), "share": found["share_per_ratio"][i]} for i in nearest]


def _friction_words(powers: dict[str, dict[str, float]]) -> str:
    friction, radius = (powers[name]["drop"] for name in ("kinetic_friction", "rod_radius"))
    return (
        f"At the 10:1 trial one per cent more friction changes the drop by {friction:.2f} %, "
        f"one per cent more radius by {radius:.2f} %."
    )
