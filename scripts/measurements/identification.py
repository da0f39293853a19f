"""Measurements of `identify`: on real data, and on blind data from the separate simulator of the tests."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from looping_pendulum.discrepancy.data.study_io import load
from looping_pendulum.discrepancy.identify import identify
from looping_pendulum.discrepancy.verdict import Identification
from tests.blind.cases import CASES
from tests.discrepancy import test_discovery as discovery
from tests.discrepancy import test_real_data as real_data
from tests.discrepancy.blind_study import write_study

SEEDS = (1, 2, 3, 4)


def summary(result: Identification) -> dict[str, Any]:
    """Verdict, what was added, and the held-out trial before and after."""
    held_out = next((e for e in result.errors if e.held_out), None)
    return {
        "verdict": result.verdict.value,
        "effects": {e.name: {"value": e.value, "error": e.error, "unit": e.unit} for e in result.effects},
        "ties": [{e.name: {"value": e.value, "error": e.error, "unit": e.unit} for e in tie} for tie in result.ties],
        "margin": result.rounds[0].margin if result.rounds else None,
        "held_out_before": None if held_out is None else held_out.rms_before,
        "held_out_after": None if held_out is None else held_out.rms_after,
        "sentence": result.sentence,
    }


def falling_balls() -> dict[str, Any]:
    """Balls that fall from a bridge: two drops each, one held out; needs the data folder."""
    found = {}
    for ball in real_data.BALLS:
        with tempfile.TemporaryDirectory() as folder:
            found[ball] = summary(real_data.falling(Path(folder), ball))
    return found


def thrust() -> dict[str, Any]:
    """A pulse of thrust that no library lists: what comes back of its place, width and size, seed by seed."""
    return _unlisted("thrust")


def magnet() -> dict[str, Any]:
    """A magnet's pull, which is no function of one coordinate, seed by seed."""
    return _unlisted("magnet")


def _unlisted(case: str) -> dict[str, Any]:
    names = ("place", "width", "across_height")
    planted = dict(zip(names, discovery.pulses_planted(), strict=True)) if case == "thrust" else {}
    seeds = {}
    for seed in SEEDS:
        with tempfile.TemporaryDirectory() as folder:
            result = identify(load(write_study(Path(folder), CASES[case], seed)))
        one = summary(result)
        if result.unlisted is not None:
            force, written = result.unlisted, result.unlisted.formula
            one["depends_on"], one["formula"] = force.depends_on, None if written is None else written.form
            one["stands"] = written is not None and written.stands
            if written is not None and planted:
                numbers = {n.name: n for n in written.numbers}
                one["recovered"] = {
                    name: {"planted": float(x), "found": numbers[name].value, "error": numbers[name].error}
                    for name, x in planted.items()
                    if name in numbers
                }
                one["within_three_errors"] = set(one["recovered"]) == set(planted) and all(
                    abs(x["found"] - x["planted"]) < 3 * x["error"] for x in one["recovered"].values()
                )
        seeds[str(seed)] = one
    return {
        "count": len(SEEDS),
        "unlisted": sum(one["verdict"] == "unlisted" for one in seeds.values()),
        "recovered": sum(bool(one.get("within_three_errors")) for one in seeds.values()),
        "formulas_that_stand": sum(bool(one.get("stands")) for one in seeds.values()),
        "imitated_by_listed_effects": sum(one["verdict"] in ("identified", "ambiguous") for one in seeds.values()),
        "seeds": seeds,
    }
