"""A scenario as the engines see it: physics, how long to watch, and what counts as near enough."""

from __future__ import annotations

from dataclasses import dataclass

from looping_pendulum.reference_ode.parameters import Parameters


@dataclass(frozen=True, kw_only=True)
class Tolerance:
    """One limit that one engine's result must keep."""

    engine: str
    """Engine and variant, "pymunk:chain"."""
    profile: str
    """"quick" or "accurate"."""
    metric: str
    """Name of the metric, "rms_0.35s"."""
    limit: float
    """Largest absolute value allowed, in the metric's SI unit."""
    reason: str
    """Why this much: its source."""
    expected_failure: str = ""
    """Measured reason why it is not kept; then keeping it is the surprise. Empty: it must be kept."""


@dataclass(frozen=True, kw_only=True)
class Inference:
    """A value that the source does not print and somebody inferred."""

    parameters: tuple[str, ...]
    how: str
    script: str


@dataclass(frozen=True, kw_only=True)
class MeasuredTrial:
    """Where the measured event table of this trial is, outside the package."""

    file: str
    """Path below a data folder, with forward slashes."""
    sha256: str
    source: str


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """One apparatus, one release, and what is expected of an engine that rebuilds it."""

    name: str
    title: str
    description: str
    parameters: Parameters
    duration: float
    """How long engines are watched [s]; a run ends sooner if the light mass reaches the rod."""
    tolerances: tuple[Tolerance, ...] = ()
    inferred: tuple[Inference, ...] = ()
    measured: MeasuredTrial | None = None
