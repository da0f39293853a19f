"""Numbers for every cell of the report, each its own, and the rows of its tables."""

import dataclasses

from looping_pendulum.compare.deviation import Departure
from looping_pendulum.compare.report import comparison_markdown
from looping_pendulum.compare.result import MeasuredRow, ToleranceOutcome, ToleranceResult
from looping_pendulum.runs.events import RESOLUTIONS, HaltingTimeAt, Landmarks, Rebound, Stop

OWN = Landmarks(
    halting_time=0.41234567,
    halting_times=tuple(HaltingTimeAt(resolution=r, time=0.4 + k / 100) for k, r in enumerate(RESOLUTIONS)),
    halting_time_uncertainty=2.5e-3,
    rebound=Rebound(travel=3.5e-3, speed=0.0456),
    drop_at_halt=0.31234567,
    wrap_angle_at_halt=5.1234567,
    free_length_at_halt=0.21234567,
)
TRUE = dataclasses.replace(OWN, halting_time=0.51234567, drop_at_halt=0.61234567, rebound=None, halting_time_uncertainty=None)
METRICS = {
    "rms_0.35s": 1.1e-3, "rms_0.7s": 2.2e-3, "rms_1.0s": 3.3e-3, "rms_halt": 4.4e-3, "halting_time_error": -5.5e-3,
    "rebound": 6.6e-3, "drop_error": 7.7e-3, "wrap_angle_error": -8.8e-3, "free_length_error": 9.9e-3, "string_stretch": 1.2e-3,
    "acceleration_error": None, "tube_fraction": 0.97, "simulated_time": 1.05,
}  # fmt: skip
ME = "pymunk:chain, quick"
GOOD, BAD, FEARED, NOT_RUN = (
    ToleranceOutcome.PASSED,
    ToleranceOutcome.FAILED,
    ToleranceOutcome.EXPECTED_FAILURE,
    ToleranceOutcome.NOT_RUN,
)


def gone(threshold, time):
    return Departure(threshold=threshold, time=time, mode="", after="release", after_time=0.0, along=0.0, across=0.0, heavy=0.0)


def with_engine(result, engine=None, **fields):
    return dataclasses.replace(result, engines=(dataclasses.replace(engine or result.engines[0], **fields),))


def cells(text, first, after=""):
    """Rows of the tables of ``text``, behind ``after``, whose first cell is ``first``."""
    part = text[text.index(after) :] if after else text
    rows = [line.strip("|").split("|") for line in part.splitlines() if line.startswith(f"| {first} |")]
    return [[cell.strip() for cell in row] for row in rows]


def limit(outcome, metric="rms_0.7s", value=2.2e-3, explanation="", **fields):
    made = {"engine": "pymunk:chain", "profile": "quick", "limit": 1e-3, "reason": "by design", "expected_failure": ""}
    return ToleranceResult(metric=metric, value=value, outcome=outcome, explanation=explanation, **(made | fields))


def section(text, heading):
    """The section of a report; empty without it."""
    return next((part for part in text.split("\n## ") if part.startswith(f"{heading}\n")), "")


def rendered(result, reference, own, end=1.0, engine=None):
    true = dataclasses.replace(result.reference, sampled=reference)
    made = with_engine(dataclasses.replace(result, reference=true), landmarks=own, end_time=end, **(engine or {}))
    return section(comparison_markdown(made), "Detail").partition("\n\nEvent times of")[2]


def at(*times):
    return tuple(Stop(time=time, height_change=-0.2) for time in times)


def measured(**fields):
    made = {"quantity": "halting_time", "index": 1, "unit": "s", "measured": 0.4, "paper_numerical": 0.41, "reference": 0.42}
    return MeasuredRow(**(made | {"engines": (0.43,)} | fields))
