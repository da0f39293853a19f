"""The results of a study of releases: frozen data, their form as JSON, what moved in them, and what they say in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from types import MappingProxyType

from looping_pendulum.compare.json_text import JsonResult
from looping_pendulum.pages.numbers import PERCENT, number
from looping_pendulum.scenarios.metrics import METRICS, Metric

FILE = "versions.json"
"""Name of the file of the results in the folder of a study."""

CAPSTAN = Metric(
    name="static_capstan_error",
    unit="",
    shown_in=PERCENT,
    heading="static capstan error",
    description="Relative error of ln(T2/T1) over half a turn, the string just sliding (`engines.static_capstan`).",
    has_sign=True,
)
"""The static capstan test, as one more number."""
# Shares of the samples and the run's length change in steps of a sample, which gives no spread
QUANTITIES = MappingProxyType(
    {name: metric for name, metric in METRICS.items() if not metric.has_lower_limit} | {CAPSTAN.name: CAPSTAN}
)
"""Name -> each number whose moves are named."""
FLOOR = 1e-6
"""Smallest move that is named [SI]: a micron, a microsecond, a microradian, a millionth.

Halting times are read from samples a millisecond apart, and smooth variants have spreads of nanometres, which rounding on
another processor passes.
"""
SHOWN = ("rms_0.35s", "rms_0.7s", "halting_time_error", CAPSTAN.name)
"""Numbers with columns of their own; the others are in the file."""
HEADER = ("release", "variant", *(QUANTITIES[name].column for name in SHOWN), "CPU [s]", "remark")


@dataclass(frozen=True, kw_only=True)
class VariantRow:
    """One variant with one release."""

    label: str
    status: str
    """Name of the scenario run's `RunStatus`, "FINISHED"."""
    ok: bool
    """Whether that run came to its proper end."""
    error: str = ""
    """Why it did not, in one line."""
    values: dict[str, float | None]
    """Name in `QUANTITIES` -> value, SI."""
    capstan_note: str = ""
    """Why the static capstan test has no value, in one line."""
    cpu_time: float | None = None
    """Processor time of the scenario's run, without building [s]; runs went on beside it."""

    @property
    def ran(self) -> bool:
        """Whether the engine computed something, a run that broke off included."""
        return self.status not in NOT_RUN


NOT_RUN = ("FAILED", "CRASHED", "MISSING", "TIME_LIMIT", "MEMORY_LIMIT", "UNSUPPORTED", "INTERRUPTED")
"""Statuses of runs that say nothing of the engine's numbers."""


@dataclass(frozen=True, kw_only=True)
class ReleaseRow:
    """All variants with one release, or why there are none."""

    release: str
    error: str = ""
    """Why it could not be installed, in one line."""
    packages: dict[str, str]
    """Package -> version in its environment, as the runs report it."""
    pins: tuple[str, ...] = ()
    """Requirements beside the newest allowed, "numpy<2", without which it does not run."""
    variants: tuple[VariantRow, ...] = ()

    def variant(self, label: str) -> VariantRow | None:
        """Return one variant's row if it ran."""
        return next((v for v in self.variants if v.label == label and v.ran), None)

    @property
    def ran(self) -> bool:
        """Whether at least one variant ran."""
        return any(v.ran for v in self.variants)


@dataclass(frozen=True, kw_only=True)
class Spread:
    """How far small changes of the start move the numbers of each variant."""

    release: str
    """Release with which it was measured, the newest that ran."""
    values: dict[str, dict[str, float | None]]
    """Label -> name in `QUANTITIES` -> standard deviation, SI; None for fewer than three values."""


@dataclass(frozen=True, kw_only=True)
class Move:
    """A number that a release moved by more than its spread."""

    label: str
    quantity: str
    release: str
    since: str
    """Earlier release that it is compared with: the last that ran."""
    before: float | None
    """Value with that one, SI; None: it had none, as a run that never halts has no halting time."""
    after: float | None
    spreads: float | None
    """Change in units of the spread; None where a value appears or vanishes."""


@dataclass(frozen=True, kw_only=True)
class ReleasesResult(JsonResult):
    """A study of the releases of one engine."""

    SCHEMA_ID = "looping-pendulum/releases"
    SCHEMA_VERSION = 1
    FILE = FILE
    COMMAND = "versions"

    engine: str
    distribution: str
    """The engine's package, as pip names it."""
    scenario: str
    profile: str
    python: str
    date: str
    """Day on which it was written."""
    interrupted: bool
    releases: tuple[ReleaseRow, ...]
    """Oldest first."""
    spread: Spread | None
    """None if no release ran."""
    moves: tuple[Move, ...]

    def labels(self) -> tuple[str, ...]:
        """Return the variants, in the order of the study."""
        return tuple(dict.fromkeys(v.label for row in self.releases for v in row.variants))


def find_moves(rows: Sequence[ReleaseRow], spread: Spread) -> tuple[Move, ...]:
    """Return every move among ``rows``, oldest release first; each release is compared with the last before it that ran."""
    moves: list[Move] = []
    last: dict[str, tuple[str, VariantRow]] = {}
    for row in rows:
        for variant in row.variants:
            if not variant.ran:
                continue
            if variant.label in last:
                since, before = last[variant.label]
                moves += _moves(row.release, variant, since, before, spread.values.get(variant.label, {}))
            last[variant.label] = row.release, variant
    return tuple(moves)


def _moves(release: str, variant: VariantRow, since: str, before: VariantRow, spreads: dict[str, float | None]) -> list[Move]:
    moves = []
    for name in QUANTITIES:
        old, new = before.values.get(name), variant.values.get(name)
        if old is None and new is None:
            continue
        ratio = None
        if old is not None and new is not None:
            spread = max(spreads.get(name) or 0.0, FLOOR)
            ratio = abs(new - old) / spread
            if ratio <= 1:
                continue
        moves.append(
            Move(label=variant.label, quantity=name, release=release, since=since, before=old, after=new, spreads=ratio)
        )
    return moves


def rows(result: ReleasesResult) -> list[tuple[str, ...]]:
    """Return a row for each variant with each release, as `HEADER`."""
    gaps = [""] * (len(HEADER) - 3)
    made: list[tuple[str, ...]] = []
    for row in result.releases:
        if row.error:
            made.append((row.release, "", *gaps, f"not installed: {row.error}"))
        for variant in row.variants:
            values = [QUANTITIES[name].cell(variant.values.get(name)) for name in SHOWN]
            cells = [*values, number(variant.cpu_time, digits=2)] if variant.ran else gaps
            made.append((row.release, variant.label, *cells, remark(row, variant)))
    return made


def remark(row: ReleaseRow, variant: VariantRow) -> str:
    """Return what is unusual about a variant's run."""
    parts = [variant.error, variant.capstan_note, f"with {', '.join(row.pins)}" if row.pins else ""]
    return "; ".join(part for part in parts if part)


def move_sentences(result: ReleasesResult) -> list[tuple[str, str, str]]:
    """Return (release, variant, what moved) for each variant that a release moved, oldest first."""
    groups = groupby(result.moves, lambda move: (move.release, move.label))
    return [(release, label, moved(list(group))) for (release, label), group in groups]


def moved(moves: list[Move]) -> str:
    """Return one sentence of all moves of a variant with one release: the shown numbers, and how many others moved."""
    shown = [move for move in moves if move.quantity in SHOWN] or moves
    text = "; ".join(_change(move) for move in shown)
    others = len(moves) - len(shown)
    return f"since {moves[0].since}: {text}" + (f"; and {others} other number{'s' if others > 1 else ''}" if others else "")


def _change(move: Move) -> str:
    metric = QUANTITIES[move.quantity]
    size = "" if move.spreads is None else f" ({number(move.spreads, digits=2)} × its spread)"
    return f"{metric.heading} {metric.cell(move.before)} → {metric.cell(move.after)} {metric.shown_in.name}{size}"
