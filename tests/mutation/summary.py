"""From outcomes to the share caught: its interval, the survivors, and those that nothing can catch."""

import math
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

EQUIVALENT = Path(__file__).with_name("equivalent.yaml")
"""Mutants that behave as the code does, each with the reason."""

SURVIVED = frozenset({"survived", "no test runs it"})


@dataclass(frozen=True)
class Asked:
    """One mutant and what became of it."""

    key: str
    path: str
    line: int
    operator: str
    before: str
    """The changed line, stripped."""
    after: str
    outcome: str
    """"test failed", "time limit", "process died", "does not import", "survived" or "no test runs it"."""
    by: str
    """Test that caught it, if one did."""
    tests: int
    """How many tests were to be asked."""
    seconds: float
    source: str
    """Hash of the file before."""
    test_source: str
    """Hash of the test files that the outcome rests on."""

    @property
    def caught(self) -> bool:
        return self.outcome not in SURVIVED


def wilson(caught: int, of: int, z: float = 1.959964) -> tuple[float, float]:
    """Interval of a share by Wilson's score, 95 % for the default ``z``; (0, 1) of nothing.

    Wilson, J. Am. Stat. Assoc. 22 (1927) 209.
    """
    if of == 0:
        return 0.0, 1.0
    p, square = caught / of, z * z / of
    middle = (p + square / 2) / (1 + square)
    half = z / (1 + square) * math.sqrt(p * (1 - p) / of + square / (4 * of))
    return middle - half, middle + half


def read_equivalent(path: Path) -> dict[tuple[str, str, str], str]:
    """(file, line before, line after) -> why nothing can tell them apart."""
    entries = yaml.safe_load(path.read_text(encoding="utf-8")) or [] if path.exists() else []
    return {(e["file"], e["before"], after): e["why"] for e in entries for after in e["after"]}


def summary(
    name: str, asked: list[Asked], population: int, seed: int, equivalent: dict[tuple[str, str, str], str], broken: list[str]
) -> dict[str, Any]:
    """Everything that is worth keeping of a run."""
    survivors = sorted((a for a in asked if not a.caught), key=lambda a: (a.path, a.line, a.operator, a.after))
    reasons = {a.key: equivalent.get((a.path, a.before, a.after), "") for a in survivors}
    same = sum(bool(r) for r in reasons.values())
    caught, of = len(asked) - len(survivors), len(asked) - same
    low, high = wilson(caught, len(asked))
    low_without, high_without = wilson(caught, of)
    return {
        "folder": name,
        "mutants": population,
        "sample": len(asked),
        "seed": seed,
        "draw": "without replacement, each mutant equally likely",
        "outcomes": dict(sorted(Counter(a.outcome for a in asked).items())),
        "caught": caught,
        "share": round(caught / max(1, len(asked)), 4),
        "interval_95": [round(low, 4), round(high, 4)],
        "equivalent": same,
        "share_without_equivalent": round(caught / max(1, of), 4),
        "interval_95_without_equivalent": [round(low_without, 4), round(high_without, 4)],
        "not_asked_because_they_fail_anyway": sorted(broken),
        "by_file": {
            path: f"{sum(a.caught for a in asked if a.path == path)} of {count}"
            for path, count in sorted(Counter(a.path for a in asked).items())
        },
        "survivors": [
            {"file": a.path, "line": a.line, "before": a.before, "after": a.after, "outcome": a.outcome}
            | ({"equivalent": reasons[a.key]} if reasons[a.key] else {})
            for a in survivors
        ],
    }


def verdict_lines(result: dict[str, Any]) -> list[str]:
    """Two lines for the terminal."""

    def share(key: str, interval: str) -> str:
        low, high = result[interval]
        return f"{100 * result[key]:.1f} % (95 %: {100 * low:.1f} to {100 * high:.1f} %)"

    head = f"{result['folder']}: {result['caught']} of {result['sample']} mutants caught, {share('share', 'interval_95')}"
    rest = (
        f"  drawn from {result['mutants']}; without {result['equivalent']} equivalent ones "
        f"{share('share_without_equivalent', 'interval_95_without_equivalent')}"
    )
    return [head, rest]
