"""What identification found, as plain data: the one object that the report, the figures and verdict.json are made of.

Layout of ``verdict.json``: ``schema`` {id, version}, then the fields of `Identification` by their names, as documented there;
SI and radians; null for what is not known or not finite. Fields marked `compare=False` (arrays for figures) are left out.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from looping_pendulum.compare.json_text import plain
from looping_pendulum.reference_ode.geometry import Array

SCHEMA_ID = "looping-pendulum/identification"
SCHEMA_VERSION = 2


class Verdict(StrEnum):
    """What the data say about the declared model."""

    NO_MISSING_EFFECT = "no_missing_effect"
    IDENTIFIED = "identified"
    AMBIGUOUS = "ambiguous"
    UNLISTED = "unlisted"
    UNEXPLAINED = "unexplained"
    INTERRUPTED = "interrupted"


@dataclass(frozen=True, kw_only=True)
class IdentifiedEffect:
    """One effect that the declared model lacks or has wrong."""

    name: str
    kind: str
    acts_on: str
    depends_on: tuple[str, ...]
    formula: str
    source: str
    parameter: str
    meaning: str
    """How the value enters: "is", "multiplies"."""
    value: float
    error: float
    """Standard error."""
    interval: tuple[float, float] | None
    """Where the cost rises by nine, all else refitted, as at three standard errors; None: the model is nearly linear in it."""
    null: float
    """Value at which the effect is absent."""
    unit: str
    companions: tuple[tuple[str, float, float], ...]
    """Further coefficients of the effect, fitted with it: name, value, standard error [SI]."""


@dataclass(frozen=True, kw_only=True)
class RankedCandidate:
    """One candidate in one round."""

    name: str
    kind: str
    score: float
    """z of its sensitivity against what the model leaves."""
    gain: float | None
    """On the Bayesian information criterion; None: not refitted."""
    value: float | None
    error: float | None
    held_out: float | None
    """Largest chi2 per value on data that no fit saw; None: not judged."""
    passes: bool
    reason: str
    """Why it does not pass; empty if it does."""


@dataclass(frozen=True, kw_only=True)
class Round:
    """One addition: what the model had, and how the candidates did."""

    added_before: tuple[str, ...]
    ranking: tuple[RankedCandidate, ...]
    """Best first."""
    best: str
    runner_up: str
    margin: float | None
    """Gain of the best less that of the runner-up."""
    errors_times: float = 1.0
    """By how much the marks' standard errors were multiplied, so that they contain the remainder."""


@dataclass(frozen=True, kw_only=True)
class TrialError:
    """How far a model is from one trial."""

    trial: str
    held_out: bool
    rms_before: float | None
    """Residual of the declared model after calibration, of the light mass's place where it was seen [m]; None: only events."""
    rms_after: float | None
    noise_before: float
    """Root mean square in units of the noise."""
    noise_after: float
    events_before: Mapping[str, float]
    """SI unit -> root mean square of measured less predicted events of that unit."""
    events_after: Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class EventResidual:
    """One measured event beside both models."""

    trial: str
    held_out: bool
    quantity: str
    index: int
    unit: str
    measured: float
    """[unit]"""
    sigma: float
    """Standard error [unit]."""
    before: float | None
    """What the declared model says after its calibration [unit]; None: it does not happen in its run."""
    after: float | None


@dataclass(frozen=True, kw_only=True)
class FittedParameter:
    """One number of the fit."""

    name: str
    value: float
    error: float
    measured: float
    """What was measured or where the fit began."""
    measured_error: float | None
    at_bound: bool


@dataclass(frozen=True, kw_only=True)
class FitReport:
    """How a fit went."""

    numbers: tuple[FittedParameter, ...]
    correlations: tuple[tuple[str, str, float], ...]
    """Pairs above 0.9 in size."""
    condition: float
    """Of the scaled Jacobian."""
    chi2_per_dof: float
    held_out: float
    """Largest chi2 per value on data that no fit saw."""
    largest_score: float
    """Of any candidate that was left."""
    alarms: tuple[str, ...]
    """What is not quiet; empty: nothing is left."""
    starts: tuple[float, ...]
    """Costs that the starts ended at."""


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """A trial that would separate what is tied."""

    release: str
    release_angle: float
    """[rad]"""
    mass_ratio: float
    """M2/M1"""
    distance: float
    """Expected distance between the tied explanations [units of noise], after all else is fitted to the new trial."""
    tells_apart: tuple[str, str]


@dataclass(frozen=True, kw_only=True)
class ForceProfile:
    """An unknown force on one side, as a function of one coordinate."""

    side: str
    """"along" the light mass's string towards the rod, "across" it, or on the "heavy" mass upward."""
    coordinate: tuple[float, ...]
    value: tuple[float, ...]
    """[N], or [N s/m] if multiplied by a speed."""
    error: tuple[float, ...]
    """Standard error of each value."""
    largest: float
    largest_at: float
    """Coordinate of the largest value."""
    sure_from: float | None
    sure_to: float | None
    """Where it exceeds two standard errors; None: nowhere."""
    formula: str
    """What acts on this side in the model that goes on: the refitted formula, or words for the bumps where none stands; s is
    the coordinate, u and w the light mass's speeds."""
    written: tuple[float, ...] | None
    """Values of the refitted formula along the coordinate; None: none stands."""


@dataclass(frozen=True, kw_only=True)
class OtherClosure:
    """Another form of the unknown force that was refitted."""

    acts_on: str
    depends_on: str
    multiplied_by: str
    gain: float
    held_out: float


@dataclass(frozen=True, kw_only=True)
class FormulaParameter:
    """One number of a formula, fitted to the trajectories together with all numbers of the declared model."""

    name: str
    """"place", "width", or the side and what it is there: "across_height"."""
    value: float
    error: float
    """Standard error."""
    unit: str


@dataclass(frozen=True, kw_only=True)
class Formula:
    """A formula of the unknown force, refitted by trajectory."""

    form: str
    depends_on: str
    multiplied_by: str
    numbers: tuple[FormulaParameter, ...]
    gain: float
    """On the Bayesian information criterion, over the declared model."""
    gain_of_bumps: float
    """The same of the bumps that it came from, by the number of weights that the data set."""
    held_out: float | None
    """Largest chi2 per value on data that no fit saw; None: not judged, for it gains less."""
    held_out_of_bumps: float
    stands: bool
    """Whether it gains more than its bumps and explains unseen data as well as the best bumps of all do."""


@dataclass(frozen=True, kw_only=True)
class Unlisted:
    """A force that no listed effect is."""

    acts_on: str
    depends_on: str
    multiplied_by: str
    unit: str
    """Of the coordinate."""
    profiles: tuple[ForceProfile, ...]
    formula: Formula | None
    """The formula that the model goes on with; None: no simple formula explains unseen data as well as the bumps."""
    formulas: tuple[Formula, ...]
    """Every formula that was refitted, the best first."""
    phase: str
    """When most of it acts."""
    gain: float
    """Twice the log evidence over the declared model."""
    held_out_before: float
    """Largest chi2 per value of data that no fit saw."""
    held_out_after: float
    others: tuple[OtherClosure, ...]
    """Refitted forms that explain unseen data less well."""


@dataclass(frozen=True, kw_only=True)
class Remainder:
    """What no explanation removes, taken for errors of the marks that last longer than a frame."""

    rms: float
    """By how much marks are off the repaired model beyond their scatter [SI]."""
    unit: str
    """Of `rms`."""
    ratio: float
    """Of the marks' errors that explain what is left to their scatter (Birge's ratio)."""
    lasting: float
    """Marks over which they keep their sign: n marks count as n / lasting."""
    least: str
    """Explanation that leaves least; the errors are from it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrialFigure:
    """One trial's arrays for the figures; residuals in units of noise."""

    trial: str
    held_out: bool
    channels: tuple[str, ...]
    t: Mapping[str, Array]
    measured: Mapping[str, Array]
    before: Mapping[str, Array]
    after: Mapping[str, Array]
    residual_before: Mapping[str, Array]
    residual_after: Mapping[str, Array]


@dataclass(frozen=True, kw_only=True)
class Identification:
    """Everything that identification found."""

    study: str
    title: str
    seed: int
    verdict: Verdict
    sentence: str
    """The verdict in words."""
    effects: tuple[IdentifiedEffect, ...]
    """Added to the model; if ambiguous, one of the tied explanations, the best."""
    ties: tuple[tuple[IdentifiedEffect, ...], ...]
    """Every explanation that these data cannot tell from the best, the best included; empty unless ambiguous."""
    unlisted: Unlisted | None
    """The unknown force, if the verdict is unlisted."""
    remainder: Remainder | None
    """What even the best explanation leaves; None if data are explained to their noise, or were not asked for it."""
    next_experiments: tuple[Experiment, ...]
    """Best first."""
    rounds: tuple[Round, ...]
    errors: tuple[TrialError, ...]
    events: tuple[EventResidual, ...]
    """Every row of every event table."""
    before: FitReport
    after: FitReport
    judged_on: str
    """What no fit saw: "held-out trials" or "held-out blocks of time"."""
    data: tuple[str, ...]
    """What was used of each trial, and what not and why."""
    provenance: Mapping[str, str]
    """Versions."""
    scenario: str = field(compare=False)
    """The repaired model of the first trial as a scenario file."""
    pictures: tuple[TrialFigure, ...] = field(default=(), compare=False)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the added effects."""
        return tuple(e.name for e in self.effects)

    def _repr_html_(self) -> str:
        """Show verdict, what was added and the errors in a notebook."""
        from looping_pendulum.discrepancy.report.markdown import before_figures
        from looping_pendulum.pages.markdown import html

        return str(html("\n\n".join(before_figures(self))))


def dump(result: Identification) -> str:
    """Write a result as JSON text."""
    tree: dict[str, Any] = {"schema": {"id": SCHEMA_ID, "version": SCHEMA_VERSION}} | plain(result)
    return json.dumps(tree, indent=2, allow_nan=False, ensure_ascii=False) + "\n"
