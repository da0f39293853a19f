"""Measurements of `identify`: on real data, and on the study that `init` writes."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from looping_pendulum.discrepancy.identify import identify
from looping_pendulum.discrepancy.result import Identification
from looping_pendulum.measured.study_io import load
from looping_pendulum.teaching.example_folder import write_example
from tests.discrepancy import test_real_data as real_data


def summary(result: Identification) -> dict[str, Any]:
    """Return the verdict, what was added, the best two explanations, and errors of the held-out trial before and after."""
    held_out = next((e for e in result.errors if e.held_out), None)
    return {
        "verdict": result.verdict.value,
        "effects": {e.name: {"value": e.value, "error": e.error, "unit": e.unit} for e in result.effects},
        "ties": [{e.name: {"value": e.value, "error": e.error, "unit": e.unit} for e in tie} for tie in result.ties],
        "explanations": {
            " + ".join(e.names) or "nothing": {"probability": e.probability, "log10_odds": e.log10_odds}
            for e in result.explanations[:2]
        },
        "held_out_before": None if held_out is None else held_out.rms_before,
        "held_out_after": None if held_out is None else held_out.rms_after,
        "correlated_noise": {e.body: {"amplitude": e.amplitude, "points": e.points} for e in result.correlated_noise},
        "sentence": result.sentence,
    }


def falling_balls() -> dict[str, Any]:
    """Identify balls that fall from a bridge: two drops each, one held out; needs the data folder."""
    summaries = {}
    for ball in real_data.BALLS:
        with tempfile.TemporaryDirectory() as folder:
            summaries[ball] = summary(real_data.falling(Path(folder), ball))
    return summaries


def example_study() -> dict[str, Any]:
    """Identify the study of the folder that `init` writes, whose verdict docs/tracker.md shows."""
    with tempfile.TemporaryDirectory() as folder:
        example = Path(folder) / "example"
        write_example(example)
        return summary(identify(load(example / "study.yaml")))
