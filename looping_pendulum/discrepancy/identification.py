"""Turn the models that a search ends with into the result object."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from looping_pendulum.discrepancy.candidates import Candidate
from looping_pendulum.discrepancy.evidence.explain import Explanations, Judged, Ranked
from looping_pendulum.discrepancy.evidence.prior import least_distance
from looping_pendulum.discrepancy.evidence.templates import Visible
from looping_pendulum.discrepancy.fit.calibration import Fit
from looping_pendulum.discrepancy.fit.event_tests import event_rms_by_unit
from looping_pendulum.discrepancy.fit.held_out import position_slices, rms
from looping_pendulum.discrepancy.fit.likelihood import stated_interval
from looping_pendulum.discrepancy.fit.model_test import ModelTest, failures_in_words
from looping_pendulum.discrepancy.fit.problem import TrialData, noises_of
from looping_pendulum.discrepancy.outlier_summary import summarise_outliers
from looping_pendulum.discrepancy.record_start_summary import record_starts
from looping_pendulum.discrepancy.result import (
    Experiment,
    FitReport,
    FittedParameter,
    Identification,
    IdentifiedEffect,
    RankedExplanation,
    SmallestVisible,
    Unlisted,
    UnlistedLaw,
)
from looping_pendulum.discrepancy.trial_results import CorrelatedError, EventResidual, TrialError, TrialFigure
from looping_pendulum.discrepancy.verdict_sentence import effect_in_words, verdict_notes, verdict_sentence
from looping_pendulum.measured.observations import BODIES
from looping_pendulum.measured.study import Study
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.scenarios import loader
from looping_pendulum.scenarios.scenario import Scenario

MAX_EXPLANATIONS = 12
"""Explanations in the result beside that nothing is missing, if not more of them are credible."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Conclusion:
    """What a search ended with."""

    found: Explanations
    before: Judged
    """The declared model, calibrated."""
    after: Judged
    """The repaired model; the declared one if nothing was added."""
    start_costs: tuple[float, ...]
    """Cost at which the fit of the declared model ended from each of its starts."""
    experiments: tuple[Experiment, ...] = ()
    unlisted: Unlisted | None = None


def identification(
    study: Study, data: Sequence[str], seed: int, conclusion: Conclusion, provenance: Mapping[str, str]
) -> Identification:
    """Return the result; ``data`` says for each trial what was used of it."""
    before, after, found = conclusion.before, conclusion.after, conclusion.found
    explanations = _explanations(found)
    effects = next((e.effects for e in explanations), ()) if after is not before else ()
    credible = [e for e in explanations if e.credible]
    fits = _fits_of_trials(before, after)
    repaired_fits = [(fit, k, held_out) for _, fit, k, held_out in fits]
    outliers = summarise_outliers(repaired_fits)
    errors, noise = _errors(before, after), _correlated_noise(after)
    visible = found.search.smallest_visible(after.explanation)
    ruled_out = [(c.name, c.bounds_reason) for c in found.search.ruled_out]
    tests = _tests(before)
    return Identification(
        study=study.name,
        title=study.title,
        seed=seed,
        verdict=found.verdict,
        sentence=verdict_sentence(
            found.verdict,
            effects,
            credible,
            conclusion.unlisted,
            errors,
            failures=failures_in_words(tests),
            own_effects=bool(before.fit.problem.study.own_effects),
        ),
        notes=verdict_notes(found.verdict, explanations, ruled_out, noise, outliers),
        effects=effects,
        explanations=explanations,
        unlisted=conclusion.unlisted,
        correlated_noise=noise,
        smallest_visible=_smallest_visible(visible),
        can_hide=tuple(sorted(v.candidate.name for v in visible if v.can_hide)),
        next_experiments=conclusion.experiments,
        errors=errors,
        events=_events(before, after),
        outliers=outliers,
        record_starts=record_starts(repaired_fits),
        before=_fit_report(before, conclusion.start_costs),
        after=_fit_report(after, conclusion.start_costs if after is before else ()),
        judged_on="held-out trials" if before.held_out.fits else "held-out blocks of time",
        data=tuple(data),
        provenance=provenance,
        scenario=_scenario(study, after, effects),
        trial_figures=_trial_figures(fits),
    )


def _explanations(found: Explanations) -> tuple[RankedExplanation, ...]:
    declared, least = found.nothing.log_posterior, least_distance(len(found.search.library))
    rows = []
    count = max(MAX_EXPLANATIONS, len(found.credible))
    for r in (r for i, r in enumerate(found.ranked) if i < count or r.explanation is found.nothing):
        law = r.explanation.parts.law
        rows.append(
            RankedExplanation(
                effects=tuple(_effect(c, r, least) for c in sorted(r.explanation.parts.effects, key=lambda c: c.name)),
                law=UnlistedLaw(acts_on=law.target, depends_on=law.coordinate, multiplied_by=law.factor) if law else None,
                probability=r.probability,
                log10_odds=(r.explanation.log_posterior - declared) / math.log(10),
                credible=r.credible,
            )
        )
    return tuple(rows)


def _effect(c: Candidate, r: Ranked, least: float) -> IdentifiedEffect:
    # Where the model is far from linear in an effect, a standard error misleads: of static friction that holds all is known
    # but that it is large enough. It misleads, too, where the evidence only just suffices: noise has enlarged
    # most of these values.
    values, errors = r.fit.values, r.fit.errors
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
        interval=stated_interval(r.fit, c.name, c.null, least) if r.credible else None,
        null_value=c.null,
        unit=c.unit,
        companions=tuple((k.name, values[k.name], errors[k.name]) for k in c.companions),
    )


def _correlated_noise(model: Judged) -> tuple[CorrelatedError, ...]:
    """Return the errors of tracked points that last longer than a frame, which a model's data are taken to have."""
    data = model.fit.problem.data
    channels = {body: [c for d in data for c in d.channels if c.name in names] for body, names in BODIES.items()}
    return tuple(
        CorrelatedError(
            body=body,
            amplitude=noise.amplitude,
            unit=channels[body][0].unit,
            correlation_time=noise.correlation_time,
            points=noise.correlation_time / channels[body][0].time_step,
        )
        for body, noise in noises_of(data).items()
    )


def _smallest_visible(visible: Sequence[Visible]) -> tuple[SmallestVisible, ...]:
    """Return the smallest visible sizes, without those that can hide at any size."""
    return tuple(
        SmallestVisible(
            name=v.candidate.name,
            value=v.value,
            unit=v.candidate.unit,
            acts_on=v.candidate.acts_on,
            null_value=v.candidate.null,
            motion=v.motion,
        )
        for v in visible
        if not v.can_hide
    )


def _errors(before: Judged, after: Judged) -> tuple[TrialError, ...]:
    """Return the errors of both models for every trial, or for all held-out blocks of time together."""
    rows = []
    for k, d in enumerate(before.training.problem.data):
        chi2 = [_chi2(m.training, k) for m in (before, after)]
        rms_values = [rms(m.training, k) for m in (before, after)]
        event_rms = [event_rms_by_unit(m.training, k) for m in (before, after)]
        rows.append(_trial_error(d.trial.name, False, rms_values, chi2, event_rms, _unit_of_position(d)))
    for i, name in enumerate(before.held_out.names if before.held_out.fits else ()):
        chi2 = [m.held_out.chi2[i] for m in (before, after)]
        event_rms = [event_rms_by_unit(m.held_out.fits[i], 0) for m in (before, after)]
        unit = _unit_of_position(before.held_out.fits[i].problem.data[0])
        rows.append(_trial_error(name, True, [m.held_out.rms[i] for m in (before, after)], chi2, event_rms, unit))
    # Blocks of time are judged together and have no fits of their own
    if not before.held_out.fits:
        rms_values = [m.held_out.rms[0] for m in (before, after)]
        units = {_unit_of_position(d) for d in before.training.problem.data if d.channels}
        unit = units.pop() if len(units) == 1 else ""
        chi2 = [m.held_out.chi2[0] for m in (before, after)]
        rows.append(_trial_error("blocks of time", True, rms_values, chi2, [{}, {}], unit))
    return tuple(rows)


def _unit_of_position(d: TrialData) -> str:
    """Return the SI unit of the data that `held_out.rms` is of; empty: there are several, or no channels."""
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


def _events(before: Judged, after: Judged) -> tuple[EventResidual, ...]:
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


def _fit_report(model: Judged, start_costs: tuple[float, ...]) -> FitReport:
    fit = model.fit
    values, errors, at_bounds, tests = fit.values, fit.errors, set(fit.at_bounds), _tests(model)
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
        failed_tests=failures_in_words(tests),
        start_costs=start_costs,
        tests=tests,
    )


def _tests(model: Judged) -> tuple[ModelTest, ...]:
    return (*model.tests.results, *model.held_out.results)


def _scenario(study: Study, model: Judged, effects: Sequence[IdentifiedEffect]) -> str:
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


def _fits_of_trials(before: Judged, after: Judged) -> list[tuple[Fit, Fit, int, bool]]:
    """Return (fit of the declared model, of the repaired one, index of the trial in them, whether held out) of every trial."""
    pairs = [(before.training, after.training, k, False) for k in range(len(before.training.problem.data))]
    return pairs + [(b, a, 0, True) for b, a in zip(before.held_out.fits, after.held_out.fits, strict=True)]


def _trial_figures(fits: Sequence[tuple[Fit, Fit, int, bool]]) -> tuple[TrialFigure, ...]:
    return tuple(_trial_figure(*pair) for pair in fits if pair[0].problem.data[pair[2]].channels)


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
