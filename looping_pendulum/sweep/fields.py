"""Fields of a map: what it stores of each run, with units, and how a run may have ended."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.engines.trajectory import RunStatus
from looping_pendulum.reference_ode.batch.runs import ENDS
from looping_pendulum.reference_ode.transitions import Event

REFERENCE = "reference"
"""Name of the exact model, which is run in batches, in the chunk's own process."""
IMPOSSIBLE = "impossible"
"""Ending of a run that was not made because its parameters contradict each other."""
ENDINGS: tuple[str, ...] = tuple(
    # The reference's endings first, so that its codes are those of `ENDS`, which a batch gives
    dict.fromkeys([*map(str, ENDS), IMPOSSIBLE, *(status.name.lower() for status in RunStatus if not status.ok)])
)
"""Endings of a run; the field `end` is the index into this tuple."""
ENDING_DESCRIPTIONS = {
    str(Event.LIGHT_REACHES_ROD): "the light mass reached the rod",
    str(Event.HEAVY_REACHES_ROD): "the heavy mass reached the rod",
    str(Event.UNWRAPPED): "the string left the rod",
    str(Event.TIME_UP): "still moving when its time was up",
    **{status.name.lower(): status.value for status in RunStatus if not status.ok},
    "failed": "the run broke down",
    IMPOSSIBLE: "impossible parameters, not run",
}
"""Ending -> its description."""
UNKNOWN_COUNT = -1
"""Value of a count that an engine does not report."""

Values = dict[str, NDArray[np.generic]]
"""Name of a field -> its values, shape (n,)."""


@dataclass(frozen=True, kw_only=True)
class Field:
    """A field of a map: one value per run."""

    name: str
    unit: str
    """SI unit; '' for a plain number."""
    dtype: str
    meaning: str

    @property
    def fill(self) -> float:
        """Value of runs that are not computed yet."""
        if self.dtype == "float64":
            return float("nan")
        # An unsigned field has no -1
        return 0 if self.dtype == "uint64" else -1


def _real(name: str, unit: str, meaning: str) -> Field:
    return Field(name=name, unit=unit, dtype="float64", meaning=meaning)


def _count(name: str, meaning: str) -> Field:
    return Field(name=name, unit="", dtype="int32", meaning=f"{meaning}; {UNKNOWN_COUNT}: the engine does not tell")


FIELDS = (
    _real("halting_time", "s", "start of the sticking that lasts until the light mass reaches the rod; NaN without one"),
    _real("halting_wrap_angle", "rad", "wrap angle at the halting time; NaN without one"),
    _real("halting_free_length", "m", "free length at the halting time; NaN without one"),
    _real("drop", "m", "how far the heavy mass is below its release at the end of the run"),
    _real("wrap_angle", "rad", "wrap angle at the end of the run"),
    _real("free_length", "m", "free length at the end of the run"),
    _count("stops", "how often the heavy mass's speed became zero"),
    _count("slip_count", "how often a string at rest on the rod began to slide again"),
    _count("slack_intervals", "how often the string was, or became, slack"),
    Field(name="end", unit="", dtype="int8", meaning="how the run ended"),
    _real("end_time", "s", "end of the run"),
    Field(name="sequence", unit="", dtype="uint64", meaning="hash of the sequence of modes; 0: the engine does not tell"),
)


def end_code(ending: str) -> int:
    """Return the index of an ending in `ENDINGS`."""
    return ENDINGS.index(ending)
