"""Data classes of a scenario: its parameters, duration, tolerances and sources."""

from __future__ import annotations

from dataclasses import dataclass, field

from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.scenarios.metrics import METRICS

# The values of `engines.protocol.Profile`, which stands in a higher layer and cannot be imported here
PROFILES = ("quick", "accurate")
"""Profiles for which a tolerance may be given."""


@dataclass(frozen=True, kw_only=True)
class Tolerance:
    """A limit on one metric of one engine's result."""

    engine: str
    """Engine and variant, "pymunk:chain"."""
    profile: str
    """"quick" or "accurate"."""
    metric: str
    """Name of the metric, "rms_0.35s"."""
    limit: float
    """Largest magnitude allowed, in the metric's SI unit; of a metric that `has_lower_limit`, the smallest value."""
    reason: str
    """Source of the limit."""
    expected_failure: str = ""
    """Measured reason why the engine exceeds the limit; then keeping it counts as a failure. Empty: the limit must be kept."""


@dataclass(frozen=True, kw_only=True)
class Inference:
    """Values that the source does not print."""

    parameters: tuple[str, ...]
    """Keys of this file, as "release.angle"."""
    how: str
    """How they were found."""
    script: str = ""
    """The script that found them; not given for an assumption."""


@dataclass(frozen=True, kw_only=True)
class MeasuredTable:
    """The measured event table of this trial."""

    file: str
    """Path below a data folder, with forward slashes; the data is not part of the package."""
    sha256: str
    """Checksum of that file."""
    source: str
    """Who measured it and where it is printed."""


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """One apparatus, one release, and what is expected of an engine that rebuilds it."""

    name: str
    title: str
    description: str
    parameters: Parameters
    duration: float
    """Simulated time [s]; a run ends sooner if the light mass reaches the rod."""
    # What is printed of a scenario is the trial; of limits and sources alone there are pages
    tolerances: tuple[Tolerance, ...] = field(default=(), repr=False)
    """Limits, sorted by engine, then profile, then in the order of `METRICS`."""
    inferred: tuple[Inference, ...] = field(default=(), repr=False)
    measured: MeasuredTable | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        """Sort the tolerances, so that equal scenarios compare equal."""
        order = {metric: i for i, metric in enumerate(METRICS)}
        ordered = sorted(self.tolerances, key=lambda t: (t.engine, PROFILES.index(t.profile), order[t.metric]))
        # The class is frozen, for everyone but its own constructor
        object.__setattr__(self, "tolerances", tuple(ordered))
