"""The results of a study of releases: frozen data, and their form as JSON."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

from looping_pendulum.compare.json_text import dump, load
from looping_pendulum.pages.numbers import PERCENT
from looping_pendulum.scenarios.metrics import METRICS, Metric

SCHEMA, SCHEMA_VERSION = "looping-pendulum/releases", 1
FILE = "versions.json"
"""Name of the file of the results in the folder of a study."""

CAPSTAN = Metric(
    name="static_capstan_error",
    unit="",
    shown_in=PERCENT,
    heading="static capstan error",
    description="Relative error of ln(T2/T1) over half a turn, the string just sliding (`engines.tension`).",
    value=lambda _: None,
    has_sign=True,
)
"""The static capstan test, as one more number."""
# Shares of the samples and the run's length change in steps of a sample, which gives no spread
QUANTITIES = MappingProxyType(
    {name: metric for name, metric in METRICS.items() if not metric.has_lower_limit} | {CAPSTAN.name: CAPSTAN}
)
"""Name -> each number whose moves are named."""


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
class ReleasesResult:
    """A study of the releases of one engine."""

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

    def to_json(self) -> str:
        """Return the text of `FILE`."""
        return dump(self, SCHEMA, SCHEMA_VERSION)

    @classmethod
    def from_json(cls, text: str) -> ReleasesResult:
        """Read `to_json`'s text back."""
        return load(
            cls, text, SCHEMA, SCHEMA_VERSION, file=FILE, rewrite_hint="write it again with `looping-pendulum versions`"
        )

    def labels(self) -> tuple[str, ...]:
        """Return the variants, in the order of the study."""
        return tuple(dict.fromkeys(v.label for row in self.releases for v in row.variants))
