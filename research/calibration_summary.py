"""Summarise the outcomes of blind studies: rates with intervals, and what was asked of them."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import binomtest

from research.known_answer import SHOWN, Outcome
from tests.discrepancy.blind_sample import NOISE_KINDS, BlindStudy
from tests.discrepancy.expected import truth

CONFIDENCE = 0.95
HIDDEN = {
    "one": "one effect",
    "two": "two effects",
    "law": "an unlisted law",
    "mixed": "an effect beside an unlisted law",
}
"""What may be hidden, and its words."""
JUDGEMENTS = {
    "right": "named",
    "tied": "tied with others",
    "law": "the effect beside another law",
    "part": "only a part is named",
    "wrong": "something else is named",
    "none": "nothing is named",
}
"""Judgement of `calibration.judgement` -> its words."""
NAMED = ("right", "tied")
EDGES = (0.0, 0.05, 0.2, 0.5, 0.8, 0.95, 1.0)
"""Edges of the classes of stated probabilities."""
TIME_QUANTILES = (0.5, 0.9, 0.99)

Pair = tuple[BlindStudy, Outcome]
"""A study, and what its file in the work folder says: plain data."""


def proportion(count: int, of: int) -> dict[str, Any]:
    """Return a share with its two-sided 95 % interval by Clopper and Pearson; None for both if there are no studies."""
    if not of:
        return {"count": 0, "of": 0, "share": None, "interval": None}
    interval = binomtest(count, of).proportion_ci(CONFIDENCE, method="exact")
    return {"count": count, "of": of, "share": count / of, "interval": [float(interval.low), float(interval.high)]}


def hidden_in(study: BlindStudy) -> str:
    """Return what is hidden in a study: a key of `HIDDEN`, or "clean"."""
    effects, law = truth(study.hidden)
    if law:
        return "mixed" if effects else "law"
    return ("clean", "one", "two")[len(effects)]


def is_shown(outcome: Outcome) -> bool:
    """Return whether the data show all that is hidden, by the fits with the known answer."""
    return outcome["log_odds"] is not None and bool(outcome["log_odds"] >= SHOWN)


def summary(pairs: Sequence[Pair]) -> dict[str, Any]:
    """Return the summary of all studies as plain data."""
    judged = [(s, o) for s, o in pairs if "judgement" in o]
    clean = [(s, o) for s, o in judged if not s.hidden]
    estimates = [e["within"] for _, o in judged for e in o["estimates"]]
    found = [o for s, o in judged if s.hidden and o["judgement"] in NAMED]
    return {
        "studies": len(judged),
        "unreachable": sum("unreachable" in o for _, o in pairs),
        "failed": sum("failed" in o for _, o in pairs),
        "failed_known_answers": sum(bool(s.hidden) and o["log_odds"] is None for s, o in judged),
        "clean": {kind: _clean([(s, o) for s, o in clean if s.noise_kind == kind]) for kind in NOISE_KINDS},
        "hidden": {key: _hidden([p for p in judged if hidden_in(p[0]) == key]) for key in HIDDEN},
        "by_size": _by_size(judged),
        "probabilities": _probabilities(judged),
        "coverage": proportion(sum(estimates), len(estimates)),
        "held_out_error": _quantiles([o["held_out_error"] for o in found if o["held_out_error"] is not None]),
        "cpu_seconds": _quantiles([o["cpu_seconds"] for _, o in judged]),
        "explanations_fitted": _quantiles([o["explanations_fitted"] for _, o in judged]),
        "perhaps_nothing": proportion(sum([[], None] in o["explanations"] for o in found), len(found)),
        "each": [_one(s, o) for s, o in judged],
    }


def _clean(pairs: Sequence[Pair]) -> dict[str, Any]:
    said = Counter(o["judgement"] for _, o in pairs)
    return {"additions": proportion(said["wrong"], len(pairs)), "unexplained": proportion(said["none"], len(pairs))}


def _hidden(pairs: Sequence[Pair]) -> dict[str, Any]:
    """Return how many studies show what is hidden, and what is said of these and of the others."""
    shown, others = ([o for _, o in pairs if is_shown(o) is wanted] for wanted in (True, False))
    return {
        "shown": proportion(len(shown), len(pairs)),
        "named_of_shown": _named(shown),
        "named_of_others": _named(others),
        "said_of_shown": dict(Counter(o["judgement"] for o in shown)),
        "said_of_others": dict(Counter(o["judgement"] for o in others)),
    }


def _named(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    return proportion(sum(o["judgement"] in NAMED for o in outcomes), len(outcomes))


def _by_size(judged: Sequence[Pair]) -> dict[str, Any]:
    """Return for one hidden effect or law, by its size [m], how many studies show it, and how many of these name it."""
    sizes = sorted({s.size for s, _ in judged if s.size is not None})
    found = {}
    for key in ("one", "law"):
        of_key = [(s, o) for s, o in judged if hidden_in(s) == key]
        found[key] = {f"{size:g}": _hidden([(s, o) for s, o in of_key if s.size == size]) for size in sizes}
    return found


def _probabilities(judged: Sequence[Pair]) -> list[dict[str, Any]]:
    """Return for each class of stated probabilities their mean, and how many of these explanations are right.

    That nothing is missing is left out. Studies with two hidden things are also counted by themselves.
    """
    stated = [
        (len(s.hidden) > 1, p, right) for s, o in judged for effects, law, p, right in o["probabilities"] if effects or law
    ]
    classes = []
    for low, high in zip(EDGES[:-1], EDGES[1:], strict=True):
        here = [one for one in stated if low <= one[1] < high or (one[1] >= high == EDGES[-1])]
        of_two = [right for is_two, _, right in here if is_two]
        classes.append(
            {
                "from": low,
                "to": high,
                "mean": float(np.mean([p for _, p, _ in here])) if here else None,
                "right": proportion(sum(right for *_, right in here), len(here)),
                "right_where_two_are_hidden": proportion(sum(of_two), len(of_two)),
            }
        )
    return classes


def _one(study: BlindStudy, outcome: Outcome) -> dict[str, Any]:
    odds = outcome["log_odds"]
    return {
        "name": study.name,
        "hidden": list(study.hidden),
        "size": study.size,
        "log10_odds": None if odds is None else odds / float(np.log(10.0)),
        "verdict": outcome["verdict"],
        "judgement": outcome["judgement"],
    }


def _quantiles(values: Sequence[float]) -> dict[str, float]:
    if not values:
        return {}
    return {f"{q:g}": float(np.quantile(values, q)) for q in TIME_QUANTILES} | {"largest": float(max(values))}


@dataclass(frozen=True, kw_only=True)
class Target:
    """What was asked of a measured share."""

    what: str
    """What is measured, as a row of a table says it."""
    asked: str
    """The limit in words."""
    measured: Callable[[dict[str, Any]], dict[str, Any]]
    """Function of a summary that returns the share, as `proportion` does."""
    failures: Callable[[dict[str, Any]], dict[str, int]] = lambda summary: {}
    """Function of a summary that returns what was said in the studies of that share, by judgement."""
    low: float = 0.0
    """Smallest share that meets the target."""
    high: float = 1.0
    """Largest one."""

    def is_met(self, summary: dict[str, Any]) -> bool:
        """Return whether the measured share is within the limits; not if nothing was measured."""
        share = self.measured(summary)["share"]
        return share is not None and self.low <= share <= self.high


def _addition(kind: str, words: str) -> Target:
    return Target(
        what=f"nothing hidden, {words}: something is added",
        asked="at most 1 %",
        measured=lambda s: s["clean"][kind]["additions"],
        high=0.01,
    )


def _of_shown(key: str, low: float) -> Target:
    return Target(
        what=f"{HIDDEN[key]}, of the studies that show it: named, or tied",
        asked=f"at least {100 * low:g} %",
        measured=lambda s: s["hidden"][key]["named_of_shown"],
        failures=lambda s: s["hidden"][key]["said_of_shown"],
        low=low,
    )


def _stated(low: float, high: float, least: float, most: float) -> Target:
    limits = f"at least {100 * least:g} %" if most == 1 else f"{100 * least:g} to {100 * most:g} %"

    def together(s: dict[str, Any]) -> dict[str, Any]:
        classes = [c["right"] for c in s["probabilities"] if low <= c["from"] and c["to"] <= high]
        return proportion(sum(c["count"] for c in classes), sum(c["of"] for c in classes))

    return Target(
        what=f"explanations with a stated probability of {low:g} to {high:g}: right",
        asked=limits, measured=together, low=least, high=most,
    )  # fmt: skip


TARGETS = (
    _addition("white", "white noise"),
    _addition("wander", "a tracker that wanders"),
    _addition("outliers", "outliers"),
    _of_shown("one", 0.99),
    _of_shown("two", 0.90),
    _of_shown("mixed", 0.85),
    _of_shown("law", 0.90),
    _stated(0.95, 1.0, 0.93, 1.0),
    _stated(0.5, 0.8, 0.4, 0.9),
)
"""What `identify` should reach: limits that were set before the studies were judged."""
