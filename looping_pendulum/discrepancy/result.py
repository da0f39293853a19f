"""The result of an identification as plain data: report, figures and verdict.json are made of this one object.

SI and radians throughout, unless a unit is given. verdict.json has ``schema`` {id, version}, then the fields of
`Identification` by their names, as documented there; null for what is not known or not finite. Fields marked `compare=False`
(arrays for figures) are left out. `verdict.schema.json` beside this file is its JSON Schema, which
`python -m scripts.result_schema` writes.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import InstanceOf
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue, SkipJsonSchema
from pydantic_core import core_schema

from looping_pendulum.compare import json_text
from looping_pendulum.discrepancy.candidates import Candidate
from looping_pendulum.discrepancy.evidence.explain import Explanations, Judged
from looping_pendulum.discrepancy.evidence.explanation import Explanation, Key, parts_in_words
from looping_pendulum.discrepancy.evidence.laws import Closure
from looping_pendulum.discrepancy.evidence.prior import least_distance
from looping_pendulum.discrepancy.evidence.templates import SmallestVisible
from looping_pendulum.discrepancy.fit.calibration import Fit, FittedParameter
from looping_pendulum.discrepancy.fit.data import CorrelatedNoise, TrialData
from looping_pendulum.discrepancy.fit.likelihood import stated_interval
from looping_pendulum.discrepancy.fit.problem import OutOfTime, time_limits
from looping_pendulum.discrepancy.fit.residual import BLOCKS, ModelTest, failures_in_words
from looping_pendulum.discrepancy.formulas import Unlisted
from looping_pendulum.discrepancy.look.check import DeclarationCheck
from looping_pendulum.discrepancy.next_experiment import Experiment
from looping_pendulum.measured.free_parameter import ParameterRole
from looping_pendulum.measured.observations import BODIES, EventObservation
from looping_pendulum.measured.study import Estimate
from looping_pendulum.pages.tables import data_frame, text_table
from looping_pendulum.reference_ode.geometry import Array

SCHEMA_ID = "looping-pendulum/identification"
SCHEMA_VERSION = 12
MAX_EXPLANATIONS = 12
"""Explanations in the result beside the best of each kind and that nothing is missing, if not more of them are credible."""
NORMAL_95 = 1.96
"""Standard errors that contain 95 % of a normal distribution, on either side."""


class Verdict(StrEnum):
    """What the data say about the declared model."""

    NO_MISSING_EFFECT = "no_missing_effect"
    """The declared model explains the data to their noise."""
    IDENTIFIED = "identified"
    """One explanation by listed effects has 95 % of the probability."""
    AMBIGUOUS = "ambiguous"
    """It takes several explanations to have 95 % of the probability."""
    UNLISTED = "unlisted"
    """Only with an unknown force as a function of one coordinate is a model probable."""
    UNEXPLAINED = "unexplained"
    """The most probable explanation fails a test: its fit has not converged, its residuals do not look like noise, or held-out
    data are predicted neither to their noise nor better than by the declared model."""
    INTERRUPTED = "interrupted"
    """The search was ended by Ctrl-C or by its time limit."""


@dataclass(frozen=True, kw_only=True)
class WrongValue:
    """A stated value of the apparatus or of gravity that is wrong, and the one that the data ask for."""

    stated: Estimate
    asked: Estimate


@dataclass(frozen=True, kw_only=True)
class FittedEffect:
    """One candidate that the declared model lacks or has wrong, with its fitted value."""

    candidate: Candidate
    value: float
    """Fitted value [unit of the candidate]."""
    error: float
    """Standard error [unit]."""
    interval: tuple[float | None, float | None] | None = None
    """Where the value lies with 95 % probability [unit]; an end that is None: the data set no limit on that side.

    By its profile likelihood where the model is far from linear in the value, and with an end farther towards the null value
    where the effect is just large enough to be named (`likelihood.stated_interval`). None in its place: 1.96 standard errors on
    either side.
    """
    companions: tuple[tuple[str, float, float], ...] = ()
    """Further coefficients that were fitted with the effect: name, value, standard error [SI]."""
    wrong_values: tuple[WrongValue, ...] = ()
    """The values that it says are wrong, each once if several trials share it; empty: it is a missing effect."""

    @property
    def name(self) -> str:
        """Name of the candidate."""
        return self.candidate.name

    @property
    def interval_95(self) -> tuple[float | None, float | None]:
        """Return where the value lies with 95 % probability [unit]; None: the data set no limit on that side."""
        reach = NORMAL_95 * self.error
        return self.interval or (self.value - reach, self.value + reach)


@dataclass(frozen=True, kw_only=True)
class RankedExplanation:
    """What may be missing, beside others: listed effects, a law that no library lists, or both."""

    effects: tuple[FittedEffect, ...]
    """Listed effects; empty without a law: nothing is missing."""
    law: Closure | None
    probability: float | None
    """None: it adds nothing that shows to another explanation, which is a part of it and with which it is counted."""
    log10_odds: float
    """Decimal logarithm of how much more probable it is than that nothing is missing."""
    credible: bool
    """Whether it is in the smallest set of explanations that has 95 % of the probability, or tied with one that is."""
    checked: bool = False
    """Whether its probability is by importance sampling, and not by a Gaussian about the best fit."""
    held_out_error: float | None = None
    """Its RMS error in the worst held-out trial, or in all blocks of time [noise]; None: it was not fitted without these."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its parts."""
        return (*(e.name for e in self.effects), *((f"unlisted {self.law.in_words}",) if self.law else ()))

    @property
    def in_words(self) -> str:
        """Its parts in plain words; "nothing" without any."""
        return parts_in_words((e.name for e in self.effects), self.law)


@dataclass(frozen=True, kw_only=True)
class TrialError:
    """How far the declared and the repaired model are from one trial."""

    trial: str
    held_out: bool
    rms_before: float | None
    """RMS residual of the calibrated declared model [unit]: of the light mass's position where it was tracked, else of all
    channels; None: the trial has only events."""
    rms_after: float | None
    """The same of the repaired model [unit]."""
    standardised_rms_before: float
    """RMS residual of the calibrated declared model in units of the noise; 1 is the best possible."""
    standardised_rms_after: float
    """The same of the repaired model."""
    unit: str = "m"
    """SI unit of the RMS residuals; empty: channels of several units together."""


@dataclass(frozen=True, kw_only=True)
class Outliers:
    """Tracked points of one body in one trial that do not show it, and so were left out of all fits and tests."""

    trial: str
    held_out: bool
    channels: tuple[str, ...]
    """Channels of the body."""
    count: int
    of: int
    """Number of tracked points of the body, outliers included."""
    intervals: tuple[tuple[float, float], ...]
    """First and last time of each run of neighbouring outliers, by the file's clock [s]."""
    largest_distance: float
    """Largest distance of an outlier from the repaired model [unit]."""
    unit: str


@dataclass(frozen=True, kw_only=True)
class EventResidual:
    """One measured event beside the predictions of both models."""

    trial: str
    held_out: bool
    event: EventObservation
    before: float | None
    """Prediction of the calibrated declared model [unit of the event]; None: the event does not happen in its run."""
    after: float | None
    """The same of the repaired model."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PredictedTrial:
    """A trial beside both models: "before", the declared one, and "after", the most probable one."""

    data: TrialData
    held_out: bool
    predicted: Mapping[str, Array]
    """Model -> its prediction of the data [SI], shape (n,); NaN: an event that does not happen."""
    residuals: Mapping[str, Array]
    """Model -> its residuals in units of noise, shape (n,); NaN: outliers."""
    chi2: Mapping[str, float]
    """Model -> chi2 per value."""


@dataclass(frozen=True, kw_only=True)
class FitReport:
    """Parameters and diagnostics of a fit."""

    parameters: tuple[FittedParameter, ...]
    correlations: tuple[tuple[str, str, float], ...]
    """Pairs of parameters whose correlation exceeds 0.9 in size: two names, and the correlation."""
    condition_number: float
    """Condition number of the scaled Jacobian."""
    start_costs: tuple[float, ...]
    """Cost (sum of squared standardised residuals) at which the fit from each start ended."""
    tests: tuple[ModelTest, ...]
    """Every test of the model, with its value and limit."""

    @property
    def failed_tests(self) -> tuple[str, ...]:
        """What the tests that the model fails say, in words; empty: the model explains the data to their noise."""
        return failures_in_words(self.tests)


Table = Literal["explanations", "effects", "trials", "residuals"]
"""Tables of `Identification.rows`."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Identification:
    """Everything that an identification yields; `repr` shows the verdict and the explanations."""

    study: str
    title: str
    seed: int
    verdict: Verdict
    sentence: str
    """The verdict in one sentence."""
    notes: tuple[str, ...] = ()
    """Further sentences: what was ruled out, what nearly shows, errors of the tracked points, outliers."""
    effects: tuple[FittedEffect, ...]
    """Effects that were added to the model: those of the most probable explanation; none if it is not said to explain."""
    explanations: tuple[RankedExplanation, ...]
    """The most probable of all that were fitted, in their order, the best of each kind, and that nothing is missing."""
    explanations_fitted: int
    """Number of explanations that were fitted."""
    unlisted: Unlisted | None
    """The unknown force of the most probable explanation that has one, if that is credible."""
    correlated_noise: Mapping[str, CorrelatedNoise]
    """Body -> errors of its tracked points that last longer than a frame, as of a tracker that wanders over its mark, under the
    model of `after`; empty: they are white noise."""
    smallest_visible: tuple[SmallestVisible, ...]
    """For each candidate that was not added, the smallest size that these data would show beside the repaired model."""
    next_experiments: tuple[Experiment, ...]
    """Trials that would separate tied explanations, the best first."""
    errors: tuple[TrialError, ...]
    events: tuple[EventResidual, ...]
    """Every row of every event table."""
    outliers: tuple[Outliers, ...]
    """For each trial and body that has some, the tracked points that were left out as outliers."""
    before: FitReport
    """Fit of the declared model."""
    after: FitReport
    """Fit of the most probable model: the repaired one or, if the verdict is `unexplained`, the nearest."""
    judged_on: str
    """Kind of held-out data: "held-out trials" or "held-out blocks of time"."""
    data: tuple[str, ...]
    """For each trial, how many values were used, and which were not and why."""
    provenance: Mapping[str, str]
    """Package -> version."""
    scenario: str = field(compare=False)
    """The repaired model of the first trial as a scenario file."""
    trial_figures: SkipJsonSchema[tuple[InstanceOf[PredictedTrial], ...]] = field(default=(), compare=False)
    """Every trial that was tracked, for its figure."""
    first_look: SkipJsonSchema[InstanceOf[DeclarationCheck]] | None = field(default=None, compare=False)
    """Comparison of the points with the declaration before any fit; what looked wrong there is among the notes."""

    @property
    def has_other_model(self) -> bool:
        """Whether the model of `after` differs from the declared one."""
        return bool(self.explanations[0].names)

    @property
    def other_model(self) -> str:
        """What that model is called."""
        return "nearest model" if self.verdict is Verdict.UNEXPLAINED else "repaired model"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the added effects."""
        return tuple(e.name for e in self.effects)

    @property
    def credible(self) -> tuple[RankedExplanation, ...]:
        """The smallest set of explanations that has 95 % of the probability, the most probable first."""
        return tuple(e for e in self.explanations if e.credible)

    @property
    def ties(self) -> tuple[tuple[FittedEffect, ...], ...]:
        """Effects of every explanation by listed ones that these data cannot tell from the best; empty unless ambiguous."""
        if self.verdict is not Verdict.AMBIGUOUS:
            return ()
        return tuple(e.effects for e in self.credible if e.effects and not e.law)

    def rows(self, table: Table = "explanations") -> list[dict[str, Any]]:
        """Return a table, one dict a row [SI].

        Parameters
        ----------
        table
            "explanations": the most probable first. "effects": the effects of each explanation, with the ends of the interval
            of 95 %, None where the data set none. "trials": the errors of each trial before and after. "residuals": every value
            of a channel beside both models.
        """
        if table == "residuals":
            return residual_rows(self.trial_figures, {"before": "_before", "after": "_after"})
        if table == "trials":
            return [dataclasses.asdict(e) for e in self.errors]
        if table == "effects":
            return [
                {
                    "explanation": e.in_words,
                    "name": effect.name,
                    "value": effect.value,
                    "error": effect.error,
                    "low": effect.interval_95[0],
                    "high": effect.interval_95[1],
                    "unit": effect.candidate.unit,
                }
                for e in self.explanations
                for effect in e.effects
            ]
        columns = ("probability", "log10_odds", "credible", "held_out_error")
        return [{"explanation": e.in_words} | {name: getattr(e, name) for name in columns} for e in self.explanations]

    def to_frame(self, table: Table = "explanations") -> Any:
        """Return `rows` as a `pandas.DataFrame`, in which None is NaN.

        Raises
        ------
        MissingPackageError
            If pandas is not installed.
        """
        return data_frame(self.rows(table))

    def __repr__(self) -> str:
        """Return the verdict, and what explains the data as a table."""
        return f"{self.study}: {self.verdict}. {self.sentence}\n{text_table(self.rows())}"


def dump(result: Identification) -> str:
    """Write a result as JSON text."""
    return json_text.dump(result, SCHEMA_ID, SCHEMA_VERSION)


class _VerdictSchema(GenerateJsonSchema):
    """Generator of a JSON Schema in which a number may be null: it is not finite."""

    def float_schema(self, schema: core_schema.FloatSchema) -> JsonSchemaValue:
        return super().float_schema(schema) | {"type": ["number", "null"]}


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of `dump`'s text."""
    return json_text.file_schema(Identification, SCHEMA_ID, SCHEMA_VERSION, _VerdictSchema)


def ranked_explanations(found: Explanations, held_out: Mapping[Key, float], until: float) -> tuple[RankedExplanation, ...]:
    """Return the most probable explanations, the best of each number of effects with and without a law, and nothing.

    Parameters
    ----------
    held_out
        What an explanation adds -> its error of the worst held-out trial [noise], where it was judged.
    until
        Time by the clock `time.monotonic` [s] from which on no interval is computed, so that standard errors have to do.
    """
    best_of_kind: dict[tuple[int, bool], Explanation] = {}
    for e in found.ranked:
        best_of_kind.setdefault(e.parts.kind, e)
    first = found.ranked[: max(MAX_EXPLANATIONS, len(found.credible))]
    return tuple(
        RankedExplanation(
            effects=tuple(_fitted_effect(found, e, c, until) for c in sorted(e.parts.effects, key=lambda c: c.name)),
            law=e.parts.law,
            probability=found.probabilities.get(e.key),
            log10_odds=(e.log_posterior - found.nothing.log_posterior) / math.log(10),
            credible=e.key in found.credible,
            checked=e.checked,
            held_out_error=held_out.get(e.key),
        )
        for e in found.ranked
        if e in first or e in best_of_kind.values()
    )


def _fitted_effect(found: Explanations, e: Explanation, c: Candidate, until: float) -> FittedEffect:
    """Return an effect of an explanation with its fitted values."""
    fit, interval = found.fit(e), None
    values, errors = fit.values, fit.errors
    # Where the model is far from linear in an effect, a standard error misleads: of static friction that holds, all that is
    # known is that it is large enough. So it does where the evidence only just suffices: noise has enlarged most of these.
    if e.key in found.credible and not found.interrupted:
        with contextlib.suppress(OutOfTime), time_limits(stop=until):
            interval = stated_interval(fit, c.name, c.null, least_distance(len(found.search.library)))
    return FittedEffect(
        candidate=c,
        value=values[c.name],
        error=errors[c.name],
        interval=interval,
        companions=tuple((k.name, values[k.name], errors[k.name]) for k in c.companions),
        wrong_values=_wrong_values(c, fit) if c.kind == "wrong value" else (),
    )


def _wrong_values(c: Candidate, fit: Fit) -> tuple[WrongValue, ...]:
    """Return the stated values that a candidate says are wrong, and what the data ask for in their place.

    A factor is known no better than the value that it multiplies, which is fitted by its stated error; their product is.
    """
    p = fit.problem
    rows: dict[Estimate, WrongValue] = {}
    for trial in (t for t in p.study.trials if t.name in c.trials):
        known = p.study.estimate(c.parameter, trial)
        if known is None or known in rows:
            continue
        # The candidate itself, and the stated value where that is fitted
        parts = [n for n in p.free_parameters if n.parameter == c.parameter and trial.name in n.trials]
        index = [p.names.index(n.name) for n in parts]
        values = np.array([fit.values[n.name] for n in parts])
        is_factor = c.role is ParameterRole.TIMES
        asked = float(np.prod(values)) if is_factor else fit.values[c.name]
        if is_factor and len(parts) == 1:
            asked *= known.value
        # Relative errors of factors add, with their correlation
        slope = np.array([n.scale for n in parts]) * (asked / values if is_factor else [n.name == c.name for n in parts])
        error = math.sqrt(max(float(slope @ fit.covariance[np.ix_(index, index)] @ slope), 0.0))
        rows[known] = WrongValue(stated=known, asked=Estimate(value=asked, sigma=error))
    return tuple(rows.values())


def predicted_trials(before: Judged, after: Judged) -> tuple[PredictedTrial, ...]:
    """Return all trials beside both models, the training trials first."""
    trials = [(before.training, after.training, k, False) for k in range(len(before.training.problem.data))]
    trials += [(b, a, 0, True) for b, a in zip(before.held_out.fits, after.held_out.fits, strict=True)]
    return tuple(
        predicted_trial({"before": by_declared, "after": by_repaired}, k, held_out=held_out)
        for by_declared, by_repaired, k, held_out in trials
    )


def predicted_trial(fits: Mapping[str, Fit], k: int, *, held_out: bool) -> PredictedTrial:
    """Return trial ``k`` of the problems of fits, by the key of the model of each, beside its predictions by these."""
    data = [*fits.values()][-1].problem.data[k]
    predicted, residuals, chi2 = {}, {}, {}
    for model, fit in fits.items():
        own = fit.problem.data[k]  # with the noise that this model leaves
        values = fit.problem.predict(fit.x, k)
        standardised = own.standardise(own.value - values)
        # Values that are left out have an infinite sigma, so that their zeros would lower the mean
        of_data = float(np.mean(standardised[np.isfinite(own.sigma)] ** 2))
        chi2[model] = fit.cost / fit.problem.count if held_out else of_data
        # `predict` puts an event that does not happen far off, for the fit's sake
        values[data.event_slice] = fit.problem.predict_events(fit.x, k) if data.events else []
        predicted[model], residuals[model] = values, np.where(data.is_outlier, np.nan, standardised)
    return PredictedTrial(data=data, held_out=held_out, predicted=predicted, residuals=residuals, chi2=chi2)


def trial_errors(trials: Sequence[PredictedTrial], before: Judged, after: Judged) -> tuple[TrialError, ...]:
    """Return the errors of both models for every trial, and for all held-out blocks of time together."""
    rows = [
        TrialError(
            trial=t.data.trial.name,
            held_out=t.held_out,
            rms_before=rms_of_position(t, "before"),
            rms_after=rms_of_position(t, "after"),
            standardised_rms_before=math.sqrt(t.chi2["before"]),
            standardised_rms_after=math.sqrt(t.chi2["after"]),
            unit=unit_of_position(t.data),
        )
        for t in trials
    ]
    if not before.held_out.fits:  # blocks of time are judged together and have no fits of their own
        units = {unit_of_position(t.data) for t in trials if t.data.channels}
        rows.append(
            TrialError(
                trial=BLOCKS,
                held_out=True,
                rms_before=before.held_out.rms_of_blocks,
                rms_after=after.held_out.rms_of_blocks,
                standardised_rms_before=math.sqrt(before.held_out.worst.value),
                standardised_rms_after=math.sqrt(after.held_out.worst.value),
                unit=units.pop() if len(units) == 1 else "",
            )
        )
    return tuple(rows)


def residual_rows(trials: Sequence[PredictedTrial], models: Mapping[str, str]) -> list[dict[str, Any]]:
    """Return one row for each value of a channel [SI] beside the predictions, those of outliers included.

    Parameters
    ----------
    models
        Model -> what its columns have at their end, "_before".
    """
    rows = []
    for t in trials:
        for name, part in t.data.slices.items():
            columns: dict[str, NDArray[Any]] = {
                "t": t.data.t[part],
                "measured": t.data.value[part],
                "sigma": np.where(np.isfinite(t.data.sigma[part]), t.data.sigma[part], np.nan),
                "outlier": t.data.is_outlier[part],
            }
            for model, ending in models.items():
                columns[f"predicted{ending}"] = t.predicted[model][part]
                columns[f"residual{ending}"] = columns["measured"] - t.predicted[model][part]
            values = zip(*(column.tolist() for column in columns.values()), strict=True)
            known = {"trial": t.data.trial.name, "held_out": t.data.trial.held_out, "channel": name}
            rows += [known | dict(zip(columns, row, strict=True)) for row in values]
    return rows


def _position_channels(d: TrialData) -> list[str]:
    """Return the channels that errors are reported for: the light mass's coordinates or, without them, all."""
    return [n for n in BODIES["light"] if n in d.slices] or list(d.slices)


def rms_of_position(t: PredictedTrial, model: str) -> float | None:
    """Return the RMS residual of the light mass's position, or of all channels [SI]; None: there are only events."""
    if not t.data.channels:
        return None
    residual, used = t.data.value - t.predicted[model], np.isfinite(t.data.sigma)
    parts = [t.data.slices[name] for name in _position_channels(t.data)]
    return math.sqrt(sum(float(np.mean(residual[part][used[part]] ** 2)) for part in parts))


def unit_of_position(d: TrialData) -> str:
    """Return the SI unit of these residuals; empty: there are several, or no channels."""
    units = {c.unit for c in d.channels if c.name in _position_channels(d)}
    return units.pop() if len(units) == 1 else ""


def outliers_of(trials: Sequence[PredictedTrial]) -> tuple[Outliers, ...]:
    """Return the tracked points of each trial and body that the fits left out as outliers."""
    rows = []
    for t in trials:
        d = t.data
        residual = d.value - t.predicted["after"]
        for names in BODIES.values():
            channels = [c for c in d.channels if c.name in names and d.is_outlier[d.slices[c.name]].any()]
            if not channels:
                continue
            # One coordinate of a point may be missing, or stand in another row
            times = np.unique(np.concatenate([c.t for c in channels]))
            is_outlier, distance = np.zeros(len(times), dtype=bool), np.zeros(len(times))
            for c in channels:
                at, part = np.searchsorted(times, c.t), d.slices[c.name]
                is_outlier[at] |= d.is_outlier[part]
                distance[at] = np.hypot(distance[at], residual[part])
            index = np.flatnonzero(is_outlier)
            # Cut where an index is left out, so that each run is one interval of time
            runs = np.split(index, 1 + np.flatnonzero(np.diff(index) > 1))
            rows.append(
                Outliers(
                    trial=d.trial.name,
                    held_out=t.held_out,
                    channels=tuple(c.name for c in channels),
                    count=len(index),
                    of=len(times),
                    intervals=tuple((float(times[run[0]]), float(times[run[-1]])) for run in runs),
                    largest_distance=float(np.max(distance[index])),
                    unit=channels[0].unit,
                )
            )
    return tuple(rows)


def event_residuals(trials: Sequence[PredictedTrial]) -> tuple[EventResidual, ...]:
    """Return every row of every event table beside the predictions of both models."""
    return tuple(
        EventResidual(
            trial=t.data.trial.name,
            held_out=t.held_out,
            event=event,
            before=before if math.isfinite(before) else None,
            after=after if math.isfinite(after) else None,
        )
        for t in trials
        for event, before, after in zip(
            t.data.events, *(t.predicted[model][t.data.event_slice].tolist() for model in ("before", "after")), strict=True
        )
    )
