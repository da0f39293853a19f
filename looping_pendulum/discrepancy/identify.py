"""Identify the physics that a declared model lacks: read the data, calibrate, search, and put the result together."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import platform
import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from looping_pendulum import __version__
from looping_pendulum.discrepancy.blas import one_blas_thread
from looping_pendulum.discrepancy.candidates import in_words
from looping_pendulum.discrepancy.evidence.explain import Explanations, Judged, explain
from looping_pendulum.discrepancy.evidence.explanation import Explanation, Key
from looping_pendulum.discrepancy.evidence.prior import least_distance
from looping_pendulum.discrepancy.first_look.check import take_first_look
from looping_pendulum.discrepancy.fit.calibration import Fit
from looping_pendulum.discrepancy.fit.data import TrialData, noises_of
from looping_pendulum.discrepancy.fit.likelihood import stated_interval
from looping_pendulum.discrepancy.fit.residual import check_residuals, event_rms_by_unit, failures_in_words
from looping_pendulum.discrepancy.formulas import FittedFormula, describe_unlisted_force, refit
from looping_pendulum.discrepancy.inputs import Inputs, read_inputs
from looping_pendulum.discrepancy.next_experiment import best_experiments
from looping_pendulum.discrepancy.result import (
    CorrelatedError,
    EventResidual,
    Experiment,
    FitReport,
    FittedParameter,
    Identification,
    IdentifiedEffect,
    Outliers,
    RankedExplanation,
    RecordStart,
    TrialError,
    TrialFigure,
    UnlistedLaw,
    Verdict,
)
from looping_pendulum.discrepancy.verdict import ModelTests, decide, tests_of
from looping_pendulum.discrepancy.verdict_sentence import effect_in_words, verdict_notes, verdict_sentence
from looping_pendulum.errors import HarnessError
from looping_pendulum.measured.observations import BODIES
from looping_pendulum.measured.study import Study
from looping_pendulum.processes import ReportShare
from looping_pendulum.reference_ode.effects import EFFECTS
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.scenarios import loader
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.versions import MISSING, installed_version

READING_SHARE = 0.5
"""Share of the work that reading is where films are tracked."""
STEP_SHARE = 0.2
"""Share of the work that is left which a step counts for."""
REPORT_SHARE = 0.97
"""Share of the work from which on only the result is put together, which the time limit does not end."""
MAX_EXPLANATIONS = 12
"""Explanations in the result beside the best of each kind and that nothing is missing, if not more of them are credible."""
_FitsOfTrial = tuple[Fit, Fit, int, bool]
"""Fit of the declared model, of the most probable one, index of the trial in them, and whether it is held out."""


class OutOfTimeError(HarnessError, TimeoutError):
    """The time limit was over before the declared model was calibrated."""


def identify(
    study: Study,
    *,
    seed: int = 0,
    progress: ReportShare = lambda what, share: None,
    time_limit: float | None = None,
    anyway: bool = False,
) -> Identification:
    """Find what the declared model of a study lacks.

    Parameters
    ----------
    seed
        Seed of the random second start of the calibration; nothing else is random.
    progress
        Called with a description of each step and the share of all work that is done.
    time_limit
        Time [s] after which the search ends at its next step, as after Ctrl-C, and the verdict says so; None: no limit.
    anyway
        Whether to search even if the tracked points contradict the declaration. What looks wrong is then among the notes.

    Raises
    ------
    DataError
        If the data cannot be used.
    DeclarationError
        If the tracked points contradict the declaration, and ``anyway`` is false.
    FitError
        If the declared model cannot run.
    OutOfTimeError
        If the declared model was not even calibrated within the time limit.
    """
    deadline = math.inf if time_limit is None else time.monotonic() + time_limit

    def is_time_over() -> bool:
        return time.monotonic() > deadline

    def refuse_if_time_is_over() -> None:
        if is_time_over():
            raise OutOfTimeError(
                f"--time-limit: found no fit of the declared model within {time_limit:g} s; check the study's units and "
                "values, or allow more"
            )

    read = 0.0

    def reading(what: str, share: float) -> None:
        nonlocal read
        read = READING_SHARE * share
        refuse_if_time_is_over()
        progress(what, read)

    progress("reading", 0.0)
    with one_blas_thread():
        first_look = take_first_look(study, reading)
        if not anyway:
            first_look.refuse_mistakes()
        inputs = read_inputs(study, first_look.observations)
        refuse_if_time_is_over()
        result = _identify(inputs, seed, progress, is_time_over, done=read)
    return dataclasses.replace(result, notes=(*first_look.notes, *result.notes), first_look=first_look)


def _identify(
    inputs: Inputs, seed: int, progress: ReportShare, is_time_over: Callable[[], bool], done: float
) -> Identification:
    """Identify; an interrupt after the calibration ends the search, an earlier one is raised."""

    def report(what: str) -> None:
        # How many steps there will be, is not known: each takes a part of what is left
        nonlocal done
        progress(what, done)
        done += STEP_SHARE * (REPORT_SHARE - done)

    def judged(e: Explanation) -> Judged:
        # Without this there is no report: an interrupt ends what follows, and only a second one what is judged here
        try:
            return found.judged(e)
        except KeyboardInterrupt:
            found.interrupted = True
            return found.judged(e)

    study = inputs.study
    found, start_costs = explain(inputs, seed, report, is_time_over)
    progress("reporting", REPORT_SHARE)
    before = judged(found.nothing)
    after = before if found.best is found.nothing else judged(found.best)
    unlisted = None
    credible = [e for e in found.ranked if e.key in found.credible]
    law = next((e for e in credible if e.parts.law), None)
    of_law = None
    if law and after is not before and decide(found.verdict, tests_of(after, before, ())) is not Verdict.UNEXPLAINED:
        is_best = law is found.best
        of_law = after if is_best else judged(law)
        without, recovered = found.force(of_law)
        formulas: list[FittedFormula] = []
        try:
            if not found.interrupted:
                formulas = refit(without, recovered, inputs.held_out)
        except KeyboardInterrupt:
            found.interrupted = True
        unlisted = describe_unlisted_force(recovered, formulas, before.held_out.worst)
        if unlisted.formula and formulas[0].held_out and is_best:
            fit = formulas[0].fit
            after = dataclasses.replace(after, fit=fit, training=fit, held_out=formulas[0].held_out, tests=check_residuals(fit))
    tests_before = tests_of(before, before, found.contradiction)
    tests = tests_before if after is before else tests_of(after, before, ())
    verdict = decide(found.verdict, tests)
    if verdict is Verdict.UNEXPLAINED:
        unlisted = None
    ties = [e for e in credible if not e.parts.law]
    experiments: tuple[Experiment, ...] = ()
    if verdict is Verdict.AMBIGUOUS and len(ties) > 1:
        # An interrupt now costs the advice on the next trial, but not the verdict
        with contextlib.suppress(KeyboardInterrupt):
            names = [tuple(sorted(e.key)) or ("nothing",) for e in ties]
            experiments = best_experiments(study, [found.fit(e) for e in ties], names)

    known = {m.explanation.key: math.sqrt(m.held_out.worst) for m in (of_law, before, after) if m}
    explanations = _explanations(found, known)
    effects = () if verdict is Verdict.UNEXPLAINED else explanations[0].effects
    # Of every trial: fits of the declared and of the most probable model, the trial's index in them, and whether it is held out
    fits = [(before.training, after.training, k, False) for k in range(len(before.training.problem.data))]
    fits += [(b, a, 0, True) for b, a in zip(before.held_out.fits, after.held_out.fits, strict=True)]
    outliers, errors, noise = _outliers(fits), _errors(fits, (before, after)), _correlated_noise(after)
    visible = found.search.smallest_visible(after.explanation)
    packages = ("numpy", "scipy", "wasmtime", *sorted({e.package for e in EFFECTS.values() if e.package}))
    versions = {package: installed_version(package) for package in packages}
    return Identification(
        study=study.name,
        title=study.title,
        seed=seed,
        verdict=verdict,
        sentence=verdict_sentence(
            verdict,
            explanations,
            unlisted,
            errors,
            tests=tests,
            declared=tests_before,
            own_effects=bool(before.fit.problem.study.own_effects),
        ),
        notes=verdict_notes(
            verdict,
            explanations,
            [(in_words(c.name), c.bounds_reason) for c in found.search.ruled_out],
            noise,
            outliers,
            trials=len(study.trials),
        ),
        effects=effects,
        explanations=explanations,
        explanations_fitted=len(found.search.tried),
        unlisted=unlisted,
        correlated_noise=noise,
        smallest_visible=tuple(v for v in visible if not v.can_hide),
        can_hide=tuple(sorted(v.name for v in visible if v.can_hide)),
        next_experiments=experiments,
        errors=errors,
        events=_events(fits),
        outliers=outliers,
        record_starts=_record_starts(fits),
        before=_fit_report(before, tests_before, start_costs),
        after=_fit_report(after, tests, start_costs if after is before else ()),
        judged_on="held-out trials" if before.held_out.fits else "held-out blocks of time",
        data=tuple(o.summary() for _, o in inputs.observed),
        provenance={"looping-pendulum": __version__, "python": platform.python_version()}
        | {package: version for package, version in versions.items() if version != MISSING},
        scenario=_scenario(study, before if verdict is Verdict.UNEXPLAINED else after, effects),
        trial_figures=tuple(_trial_figure(*pair) for pair in fits if pair[0].problem.data[pair[2]].channels),
    )


def _explanations(found: Explanations, held_out: Mapping[Key, float]) -> tuple[RankedExplanation, ...]:
    """Return the most probable explanations, the best of each number of effects with and without a law, and nothing.

    Parameters
    ----------
    held_out
        What an explanation adds -> its error of the worst held-out trial [noise], where it was judged.
    """
    declared, least = found.nothing.log_posterior, least_distance(len(found.search.library))
    rows = []
    count = max(MAX_EXPLANATIONS, len(found.credible))
    best_of_kind: dict[tuple[int, bool], Explanation] = {}
    for e in found.ranked:
        best_of_kind.setdefault((len(e.parts.effects), e.parts.law is not None), e)
    for e in (e for i, e in enumerate(found.ranked) if i < count or e in best_of_kind.values()):
        fit, is_credible, law = found.fit(e), e.key in found.credible, e.parts.law
        values, errors = fit.values, fit.errors
        effects = tuple(
            IdentifiedEffect(
                name=c.name,
                kind=c.kind,
                acts_on=c.acts_on,
                depends_on=c.depends_on,
                direction=c.direction,
                formula=c.formula,
                source=c.source,
                parameter=c.parameter,
                meaning=c.role.value,
                value=values[c.name],
                error=errors[c.name],
                # Where the model is far from linear in an effect, a standard error misleads: of static friction that holds all
                # is known but that it is large enough. It misleads, too, where the evidence only just suffices: noise has
                # enlarged most of these values.
                interval=stated_interval(fit, c.name, c.null, least) if is_credible else None,
                null_value=c.null,
                unit=c.unit,
                companions=tuple((k.name, values[k.name], errors[k.name]) for k in c.companions),
            )
            for c in sorted(e.parts.effects, key=lambda c: c.name)
        )
        rows.append(
            RankedExplanation(
                effects=effects,
                law=UnlistedLaw(acts_on=law.target, depends_on=law.coordinate, multiplied_by=law.factor) if law else None,
                probability=found.probabilities.get(e.key),
                log10_odds=(e.log_posterior - declared) / math.log(10),
                credible=is_credible,
                checked=e.checked,
                held_out_error=held_out.get(e.key),
            )
        )
    return tuple(rows)


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


def _outliers(fits: Sequence[_FitsOfTrial]) -> tuple[Outliers, ...]:
    """Return the tracked points of each trial and body that the fits left out as outliers."""
    rows = []
    for _, fit, k, held_out in fits:
        d = fit.problem.data[k]
        residual = d.value - fit.problem.predict(fit.x, k)
        for names in BODIES.values():
            channels = [c for c in d.channels if c.name in names and d.is_outlier[d.slices[c.name]].any()]
            if not channels:
                continue
            # One coordinate of a point may be missing, or stand in another row
            t = np.unique(np.concatenate([c.t for c in channels]))
            is_outlier, distance = np.zeros(len(t), dtype=bool), np.zeros(len(t))
            for c in channels:
                at, part = np.searchsorted(t, c.t), d.slices[c.name]
                is_outlier[at] |= d.is_outlier[part]
                distance[at] = np.hypot(distance[at], residual[part])
            index = np.flatnonzero(is_outlier)
            # Cut where an index is left out, so that each run is one interval of time
            runs = np.split(index, 1 + np.flatnonzero(np.diff(index) > 1))
            rows.append(
                Outliers(
                    trial=d.trial.name,
                    held_out=held_out,
                    channels=tuple(c.name for c in channels),
                    count=len(index),
                    of=len(t),
                    intervals=tuple((float(t[run[0]]), float(t[run[-1]])) for run in runs),
                    largest_distance=float(np.max(distance[index])),
                    unit=channels[0].unit,
                )
            )
    return tuple(rows)


def _record_starts(fits: Sequence[_FitsOfTrial]) -> tuple[RecordStart, ...]:
    """Return how the motion begins in the records that begin in mid-swing."""
    starts = []
    for _, fit, k, held_out in fits:
        trial = fit.problem.data[k].trial
        if not trial.in_mid_swing:
            continue
        parameters, _ = fit.problem.parameters_and_camera(fit.x, k)
        errors = {n.parameter: fit.errors[n.name] for n in fit.problem.free_parameters if trial.name in n.trials}
        starts.append(
            RecordStart(
                trial=trial.name,
                held_out=held_out,
                time=float(fit.problem.data[k].t.min()),
                angle=parameters.release_angle,
                angle_error=errors.get("release_angle", 0.0),
                speed=parameters.coefficients["push_across"],
                speed_error=errors.get("push_across", 0.0),
            )
        )
    return tuple(starts)


def _errors(fits: Sequence[_FitsOfTrial], models: Sequence[Judged]) -> tuple[TrialError, ...]:
    """Return the errors of both models for every trial, and for all held-out blocks of time together."""
    # Of each trial or of all blocks: name, whether it is held out, unit, and of both models RMS, chi2 per value, RMS of events
    rows = []
    for before, after, k, held_out in fits:
        each = []
        for fit in (before, after):
            # Values that are left out have an infinite sigma, so that their zeros would lower the mean
            used = np.isfinite(fit.problem.data[k].sigma)
            chi2 = fit.cost / fit.problem.count if held_out else float(np.mean(np.square(_standardised(fit, k)[used])))
            each.append((_rms(fit, k), chi2, event_rms_by_unit(fit, k)))
        d = before.problem.data[k]
        rows.append((d.trial.name, held_out, _unit_of_position(d), each))
    # Blocks of time are judged together and have no fits of their own
    if not models[0].held_out.fits:
        units = {_unit_of_position(d) for d in models[0].training.problem.data if d.channels}
        each = [(m.held_out.rms_of_blocks, m.held_out.chi2[0], {}) for m in models]
        rows.append(("blocks of time", True, units.pop() if len(units) == 1 else "", each))
    return tuple(
        TrialError(
            trial=name,
            held_out=is_held_out,
            rms_before=rms_before,
            rms_after=rms_after,
            standardised_rms_before=math.sqrt(chi2_before),
            standardised_rms_after=math.sqrt(chi2_after),
            events_before=events_before,
            events_after=events_after,
            unit=unit,
        )
        for name, is_held_out, unit, (
            (rms_before, chi2_before, events_before),
            (rms_after, chi2_after, events_after),
        ) in rows
    )


def _rms(fit: Fit, k: int) -> float | None:
    """Return the root mean square residual of trial ``k`` [SI]; None: it has only events.

    It is that of the light mass's position, a distance, or of all channels if the position was not measured.
    """
    d = fit.problem.data[k]
    if not d.channels:
        return None
    residual = d.value - fit.problem.predict(fit.x, k)
    used = np.isfinite(d.sigma)
    return math.sqrt(sum(float(np.mean(residual[p][used[p]] ** 2)) for p in _position_slices(d)))


def _position_slices(d: TrialData) -> list[slice]:
    """Return the data that errors are reported for: the light mass's coordinates or, without them, all channels."""
    return [d.slices[n] for n in ("light_x", "light_y") if n in d.slices] or list(d.slices.values())


def _unit_of_position(d: TrialData) -> str:
    """Return the SI unit of the data that `_rms` is of; empty: there are several, or no channels."""
    parts = _position_slices(d)
    units = {c.unit for c in d.channels if d.slices[c.name] in parts}
    return units.pop() if len(units) == 1 else ""


def _standardised(fit: Fit, k: int) -> Array:
    """Return the residuals of trial ``k`` in units of their standard errors."""
    d = fit.problem.data[k]
    return d.standardise(d.value - fit.problem.predict(fit.x, k))


def _events(fits: Sequence[_FitsOfTrial]) -> tuple[EventResidual, ...]:
    rows = []
    for before, after, k, held_out in fits:
        data = before.problem.data[k]
        # Not `predict`, which puts an event that does not happen far off, for the fit's sake
        predicted = [fit.problem.predict_events(fit.x, k).tolist() for fit in (before, after)] if data.events else [[], []]
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


def _fit_report(model: Judged, tests: ModelTests, start_costs: tuple[float, ...]) -> FitReport:
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
        failed_tests=failures_in_words(tests.all),
        start_costs=start_costs,
        tests=tests.all,
    )


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
