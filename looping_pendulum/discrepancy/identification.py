"""Turn the models that a search ends with into the result object."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from looping_pendulum.discrepancy.data.observations import BODIES
from looping_pendulum.discrepancy.data.study import Study
from looping_pendulum.discrepancy.fit.calibration import Fit
from looping_pendulum.discrepancy.fit.correlated_noise_fit import noises_of
from looping_pendulum.discrepancy.fit.event_tests import event_rms_by_unit
from looping_pendulum.discrepancy.fit.likelihood import stated_interval
from looping_pendulum.discrepancy.fit.problem import TrialData
from looping_pendulum.discrepancy.listed.attribution import min_distance
from looping_pendulum.discrepancy.listed.candidates import Candidate
from looping_pendulum.discrepancy.listed.held_out import position_slices, rms
from looping_pendulum.discrepancy.listed.screening import MAX_NULL_SCORE
from looping_pendulum.discrepancy.outlier_summary import summarise_outliers
from looping_pendulum.discrepancy.record_start_summary import record_starts
from looping_pendulum.discrepancy.result import (
    Experiment,
    FitReport,
    FittedParameter,
    Identification,
    IdentifiedEffect,
    Round,
    SmallestVisible,
    Unlisted,
    Verdict,
)
from looping_pendulum.discrepancy.trial_results import CorrelatedError, EventResidual, TrialError, TrialFigure
from looping_pendulum.discrepancy.verdict_sentence import effect_in_words, verdict_notes, verdict_sentence
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.scenarios import loader
from looping_pendulum.scenarios.scenario import Scenario

if TYPE_CHECKING:
    from looping_pendulum.discrepancy.listed.candidate_model import CandidateModel


@dataclass(frozen=True, kw_only=True, eq=False)
class Conclusion:
    """Models and records that a search ended with."""

    before: CandidateModel
    """The declared model, calibrated."""
    after: CandidateModel
    """The repaired model; the declared one if nothing was added."""
    ties: tuple[CandidateModel, ...]
    """Models that the data cannot tell apart, the best (``after``) first; empty: the data tell."""
    rounds: tuple[Round, ...]
    experiments: tuple[Experiment, ...]
    unlisted: Unlisted | None = None


def identification(
    study: Study, data: Sequence[str], seed: int, verdict: Verdict, conclusion: Conclusion, provenance: Mapping[str, str]
) -> Identification:
    """Return the result; ``data`` says for each trial what was used of it."""
    before, after = conclusion.before, conclusion.after
    ties = tuple(_effects(t) for t in conclusion.ties)
    effects = ties[0] if ties else _effects(after)
    repaired_fits = [(fit, k, held_out) for _, fit, k, held_out in _fits_of_trials(before, after)]
    outliers = summarise_outliers(repaired_fits)
    errors, noise = _errors(before, after), _correlated_noise(after)
    return Identification(
        study=study.name,
        title=study.title,
        seed=seed,
        verdict=verdict,
        sentence=verdict_sentence(
            verdict,
            effects,
            ties,
            conclusion.unlisted,
            errors,
            failures=before.failed_tests,
            own_effects=bool(before.fit.problem.study.own_effects),
        ),
        notes=verdict_notes(verdict, conclusion.rounds, conclusion.unlisted, noise, outliers),
        effects=effects,
        ties=ties,
        unlisted=conclusion.unlisted,
        correlated_noise=noise,
        smallest_visible=_smallest_visible(after),
        can_hide=tuple(sorted(s.candidate.name for s in after.remaining if s.can_hide)),
        next_experiments=conclusion.experiments,
        rounds=conclusion.rounds,
        errors=errors,
        events=_events(before, after),
        outliers=outliers,
        record_starts=record_starts(repaired_fits),
        before=_fit_report(before),
        after=_fit_report(after),
        judged_on="held-out trials" if before.held_out.fits else "held-out blocks of time",
        data=tuple(data),
        provenance=provenance,
        scenario=_scenario(study, after, effects),
        trial_figures=_trial_figures(before, after),
    )


def _effects(model: CandidateModel) -> tuple[IdentifiedEffect, ...]:
    values, errors = model.fit.values, model.fit.errors
    # Where the model is far from linear in an effect, a standard error misleads: of static friction that holds all is known
    # but that it is large enough. It misleads, too, where the evidence only just suffices: noise has enlarged
    # most of these values.
    intervals = {c.name: stated_interval(model.fit, c.name, c.null, min_distance(c, model.fit)) for c in model.added}
    return tuple(_identified_effect(c, values, errors, intervals[c.name]) for c in model.added)


def _identified_effect(
    c: Candidate, values: Mapping[str, float], errors: Mapping[str, float], interval: tuple[float | None, float | None] | None
) -> IdentifiedEffect:
    return IdentifiedEffect(
        name=c.name,
        kind=c.kind,
        acts_on=c.acts_on,
        depends_on=c.depends_on,
        formula=c.formula,
        source=c.source,
        parameter=c.parameter,
        meaning=c.role.value,
        value=values[c.name],
        error=errors[c.name],
        interval=interval,
        null_value=c.null,
        unit=c.unit,
        companions=tuple((k.name, values[k.name], errors[k.name]) for k in c.companions),
    )


def _correlated_noise(model: CandidateModel) -> tuple[CorrelatedError, ...]:
    """Return the errors of tracked points that last longer than a frame, which a model's data are taken to have."""
    channels = {
        body: [c for d in model.fit.problem.data for c in d.channels if c.name in names] for body, names in BODIES.items()
    }
    return tuple(
        CorrelatedError(
            body=body,
            amplitude=noise.amplitude,
            unit=channels[body][0].unit,
            correlation_time=noise.correlation_time,
            points=noise.correlation_time / channels[body][0].time_step,
        )
        for body, noise in noises_of(model.fit).items()
    )


def _smallest_visible(model: CandidateModel) -> tuple[SmallestVisible, ...]:
    """Return the smallest change of each remaining candidate that the data would show, first those that can hide best.

    Those that can hide at any size are left out.
    """
    visible = [
        SmallestVisible(
            name=s.candidate.name,
            value=MAX_NULL_SCORE * s.error,
            unit=s.candidate.unit,
            acts_on=s.candidate.acts_on,
            null_value=s.candidate.null,
            motion=MAX_NULL_SCORE * s.motion_by_error,
        )
        for s in model.remaining
        if math.isfinite(s.error) and not s.can_hide
    ]
    return tuple(sorted(visible, key=lambda v: (-v.motion, v.name)))


def _errors(before: CandidateModel, after: CandidateModel) -> tuple[TrialError, ...]:
    """Return the errors of both models for every trial, or for all held-out blocks of time together."""
    rows = []
    for k, d in enumerate(before.fit.problem.data):
        chi2 = [_chi2(m.fit, k) for m in (before, after)]
        rms_values = [rms(m.fit, k) for m in (before, after)]
        event_rms = [event_rms_by_unit(m.fit, k) for m in (before, after)]
        rows.append(_trial_error(d.trial.name, False, rms_values, chi2, event_rms, _unit_of_position(d)))
    for i, name in enumerate(before.held_out.names if before.held_out.fits else ()):
        chi2 = [m.held_out.chi2[i] for m in (before, after)]
        event_rms = [event_rms_by_unit(m.held_out.fits[i], 0) for m in (before, after)]
        unit = _unit_of_position(before.held_out.fits[i].problem.data[0])
        rows.append(_trial_error(name, True, [m.held_out.rms[i] for m in (before, after)], chi2, event_rms, unit))
    # Blocks of time are judged together and have no fits of their own
    if not before.held_out.fits:
        rms_values = [m.held_out.rms[0] for m in (before, after)]
        units = {_unit_of_position(d) for d in before.fit.problem.data if d.channels}
        unit = units.pop() if len(units) == 1 else ""
        chi2 = [m.held_out.chi2[0] for m in (before, after)]
        rows.append(_trial_error("blocks of time", True, rms_values, chi2, [{}, {}], unit))
    return tuple(rows)


def _unit_of_position(d: TrialData) -> str:
    """Return the SI unit of the data that `attribution.rms` is of; empty: there are several, or no channels."""
    parts = position_slices(d)
    units = {c.unit for c in d.channels if d.slices[c.name] in parts}
    return units.pop() if len(units) == 1 else ""


def _trial_error(
    name: str,
    held_out: bool,
    rms_values: Sequence[float | None],
    chi2: Sequence[float],
    event_rms: Sequence[Mapping[str, float]],
    unit: str,
) -> TrialError:
    return TrialError(
        trial=name,
        held_out=held_out,
        rms_before=rms_values[0],
        rms_after=rms_values[1],
        standardised_rms_before=math.sqrt(chi2[0]),
        standardised_rms_after=math.sqrt(chi2[1]),
        events_before=event_rms[0],
        events_after=event_rms[1],
        unit=unit,
    )


def _events(before: CandidateModel, after: CandidateModel) -> tuple[EventResidual, ...]:
    rows = []
    for b, a, k, held_out in _fits_of_trials(before, after):
        data = b.problem.data[k]
        # Not `predict`, which puts an event that does not happen far off, for the fit's sake
        predicted = [fit.problem.predict_events(fit.x, k).tolist() for fit in (b, a)] if data.events else [[], []]
        for row, by_declared, by_repaired in zip(data.events, *predicted, strict=True):
            rows.append(
                EventResidual(
                    trial=data.trial.name,
                    held_out=held_out,
                    quantity=row.quantity,
                    index=row.index,
                    unit=row.unit,
                    measured=row.value,
                    sigma=row.sigma,
                    before=by_declared if math.isfinite(by_declared) else None,
                    after=by_repaired if math.isfinite(by_repaired) else None,
                )
            )
    return tuple(rows)


def _chi2(fit: Fit, k: int) -> float:
    """Return chi-square per value of trial ``k``."""
    # Values that are left out have an infinite sigma, so that their zeros would lower the mean
    return float(np.mean(np.square(_standardised(fit, k)[np.isfinite(fit.problem.data[k].sigma)])))


def _standardised(fit: Fit, k: int) -> Array:
    """Return the residuals of trial ``k`` in units of their standard errors."""
    d = fit.problem.data[k]
    return d.standardise(d.value - fit.problem.predict(fit.x, k))


def _fit_report(model: CandidateModel) -> FitReport:
    fit = model.fit
    values, errors, at_bounds = fit.values, fit.errors, set(fit.at_bounds)
    return FitReport(
        parameters=tuple(
            FittedParameter(
                name=n.name,
                value=values[n.name],
                error=errors[n.name],
                measured=n.init_value,
                measured_error=n.sigma,
                at_bound=n.name in at_bounds,
            )
            for n in fit.problem.free_parameters
        ),
        correlations=fit.correlations(),
        condition_number=fit.condition,
        chi2_per_dof=model.tests.chi2_per_dof,
        held_out_chi2=model.held_out.worst,
        largest_score=abs(model.remaining[0].score) if model.remaining else 0.0,
        failed_tests=model.failed_tests,
        start_costs=model.start_costs,
        tests=model.test_results,
    )


def _scenario(study: Study, model: CandidateModel, effects: Sequence[IdentifiedEffect]) -> str:
    """Return the first training trial under the repaired model as the text of a scenario file."""
    parameters, _ = model.fit.problem.parameters_and_camera(model.fit.x, 0)
    d = model.fit.problem.data[0]
    camera = ", ".join(effect_in_words(e) for e in effects if e.acts_on == "camera")
    added = ", ".join(effect_in_words(e) for e in effects if e.acts_on != "camera") or "nothing"
    text = f"Fitted to the trials of the study '{study.name}', as trial '{d.trial.name}'. Added to what was declared: {added}."
    if camera:
        text += f" The camera's own errors are no part of a scenario: {camera}."
    return loader.dump(
        Scenario(
            name=f"{study.name}_repaired",
            title=f"{study.title}: repaired model",
            description=text,
            parameters=parameters.without_absent_own_effects(),
            duration=float(d.t.max()),
        )
    )


def _fits_of_trials(before: CandidateModel, after: CandidateModel) -> list[tuple[Fit, Fit, int, bool]]:
    """Return (fit of the declared model, of the repaired one, index of the trial in them, whether held out) of every trial."""
    pairs = [(before.fit, after.fit, k, False) for k in range(len(before.fit.problem.data))]
    return pairs + [(b, a, 0, True) for b, a in zip(before.held_out.fits, after.held_out.fits, strict=True)]


def _trial_figures(before: CandidateModel, after: CandidateModel) -> tuple[TrialFigure, ...]:
    tracked = [pair for pair in _fits_of_trials(before, after) if pair[0].problem.data[pair[2]].channels]
    return tuple(_trial_figure(*pair) for pair in tracked)


def _trial_figure(before: Fit, after: Fit, k: int, held_out: bool) -> TrialFigure:
    """Return the arrays of a trial's figure."""
    d = before.problem.data[k]
    is_outlier = after.problem.data[k].is_outlier

    def by_channel(values: Array) -> dict[str, Array]:
        return {name: values[part] for name, part in d.slices.items()}

    return TrialFigure(
        trial=d.trial.name,
        held_out=held_out,
        channels=tuple(d.slices),
        t=by_channel(d.t),
        measured=by_channel(d.value),
        before=by_channel(before.problem.predict(before.x, k)),
        after=by_channel(after.problem.predict(after.x, k)),
        residual_before=by_channel(np.where(is_outlier, np.nan, _standardised(before, k))),
        residual_after=by_channel(np.where(is_outlier, np.nan, _standardised(after, k))),
        outliers={name: is_outlier[part] for name, part in d.slices.items()},
    )
