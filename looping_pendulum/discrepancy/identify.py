"""Identify the physics that a declared model lacks: look, fit, explain, and put the result together."""

from __future__ import annotations

import contextlib
import math
import platform
import time

from threadpoolctl import threadpool_limits

from looping_pendulum import __version__
from looping_pendulum.discrepancy.candidates import in_words
from looping_pendulum.discrepancy.evidence.explain import Explanations, Judged, explain
from looping_pendulum.discrepancy.evidence.explanation import NOTHING, Explanation
from looping_pendulum.discrepancy.evidence.templates import SmallestVisible
from looping_pendulum.discrepancy.fit.data import noises_of
from looping_pendulum.discrepancy.fit.problem import OutOfTime, fits_end_now, refuse_if_time_is_over, time_limits
from looping_pendulum.discrepancy.formulas import describe_unlisted_force
from looping_pendulum.discrepancy.inputs import Inputs, read_inputs
from looping_pendulum.discrepancy.look.check import DeclarationCheck, take_first_look
from looping_pendulum.discrepancy.next_experiment import Experiment, best_experiments
from looping_pendulum.discrepancy.result import (
    FitReport,
    FittedEffect,
    Identification,
    Verdict,
    event_residuals,
    outliers_of,
    predicted_trials,
    ranked_explanations,
    trial_errors,
)
from looping_pendulum.discrepancy.verdict import (
    ModelTests,
    decide,
    effect_in_words,
    tests_of,
    verdict_by_evidence,
    verdict_notes,
    verdict_sentence,
)
from looping_pendulum.errors import HarnessError
from looping_pendulum.measured.study import Study
from looping_pendulum.processes import ReportShare, notebook_progress
from looping_pendulum.reference_ode.effects import EFFECTS
from looping_pendulum.scenarios import loader
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.versions import MISSING, installed_version

LOOK_SHARE = 0.2
"""Share of the work that the first look counts for."""
STEP_SHARE = 0.2
"""Share of the work that is left which a step counts for."""
REPORT_SHARE = 0.97
"""Share of the work from which on only the result is put together, which the time limit does not end."""
RESERVED_SHARE, LEAST_RESERVED, MOST_RESERVED = 0.15, 4.0, 20.0
"""Share of a time limit that is kept for judging and reporting what the search found, and the least and the most of it [s]."""
SETTLING_SHARE = 0.5
"""Share of the reserved time after which the fits that judge end where they are."""


class OutOfTimeError(HarnessError, TimeoutError):
    """The time limit was over before the declared model was calibrated."""


def identify(
    study: Study,
    *,
    seed: int = 0,
    progress: ReportShare | None = None,
    time_limit: float | None = None,
    anyway: bool = False,
) -> Identification:
    """Find what the declared model of a study lacks.

    Parameters
    ----------
    seed
        Seed of the random second start of the calibration; nothing else is random.
    progress
        Called with a description of each step and the share of all work that is done; None: a notebook shows both.
    time_limit
        Time [s] that all of this takes at most, reports included that are written of its result within some seconds: the search
        ends before, as after Ctrl-C, and the verdict says so; None: no limit.
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
    search_ends, judging_ends = _deadlines(time_limit)
    progress = notebook_progress() if progress is None else progress
    done = LOOK_SHARE

    def next_step(what: str) -> None:
        nonlocal done
        progress(what, done)
        done += STEP_SHARE * (REPORT_SHARE - done)  # nobody knows how many steps there will be

    progress("reading", 0.0)
    try:
        # With matrices this small a second thread only takes processor time, and sums by two differ in their last digits
        with threadpool_limits(1, user_api="blas"):
            with time_limits(stop=search_ends):
                first_look = take_first_look(study, progress=lambda what, share: progress(what, LOOK_SHARE * share))
                if not anyway:
                    first_look.refuse_mistakes()
                inputs = read_inputs(study, first_look.observations)
                refuse_if_time_is_over()
                found, start_costs = explain(inputs, seed, next_step, lambda what: progress(what, done))
            progress("reporting", REPORT_SHARE)
            return _put_together(inputs, first_look, found, start_costs, seed, judging_ends)
    except OutOfTime:
        raise OutOfTimeError(
            f"--time-limit: found no fit of the declared model within {time_limit:g} s; check the study's units and "
            "values, or allow more"
        ) from None


def _deadlines(time_limit: float | None) -> tuple[float, float]:
    """Return when the search ends, and the fits that judge what it found, by the clock `time.monotonic` [s]."""
    if time_limit is None:
        return math.inf, math.inf
    reserved = min(max(RESERVED_SHARE * time_limit, min(LEAST_RESERVED, 0.5 * time_limit)), MOST_RESERVED)
    search_ends = time.monotonic() + time_limit - reserved
    return search_ends, search_ends + SETTLING_SHARE * reserved


def _put_together(
    inputs: Inputs,
    first_look: DeclarationCheck,
    found: Explanations,
    start_costs: tuple[float, ...],
    seed: int,
    ends: float,
) -> Identification:
    """Test what the search found, decide on the verdict, and put the result together.

    Parameters
    ----------
    ends
        Time by the clock `time.monotonic` [s] from which on fits end where they are, and what the result may lack is left out.
    """
    before = _judged(found, found.nothing, ends)
    after = before if found.best is found.nothing else _judged(found, found.best, ends)
    contradiction = found.contradiction
    declared_tests = tests_of(before, before, contradiction if found.credible == (NOTHING,) else None)
    tests = declared_tests if after is before else tests_of(after, before, None)
    is_explained = decide(verdict_by_evidence(found), tests) is not Verdict.UNEXPLAINED
    credible = [e for e in found.ranked if e.key in found.credible]
    law = next((e for e in credible if e.parts.law), None) if is_explained and after is not before else None
    by_law = after if law is found.best else law and _judged(found, law, ends)
    verdict = decide(verdict_by_evidence(found), tests)  # again, as an interrupt may have ended what judged the law

    known = {m.explanation.key: math.sqrt(m.held_out.worst.value) for m in (by_law, before, after) if m}
    with time_limits(settle=ends):
        explanations = ranked_explanations(found, known, ends)
        unlisted = describe_unlisted_force(found, by_law, before.held_out.worst.value) if by_law else None
    visible: list[SmallestVisible] = []
    with contextlib.suppress(KeyboardInterrupt), time_limits(stop=ends):  # costs this part, but not the verdict
        visible = found.search.smallest_visible(after.explanation)
    effects = explanations[0].effects if is_explained else ()
    noise = noises_of(after.fit.problem.data)
    predicted = predicted_trials(before, after)
    errors, outliers = trial_errors(predicted, before, after), outliers_of(predicted)
    own_effects = bool(inputs.study.own_effects)
    ruled_out = [(in_words(c.name), c.bounds_reason) for c in found.search.ruled_out]
    return Identification(
        study=inputs.study.name,
        title=inputs.study.title,
        seed=seed,
        verdict=verdict,
        sentence=verdict_sentence(
            verdict, explanations, unlisted, errors, tests=tests, declared=declared_tests, own_effects=own_effects
        ),
        notes=(
            *first_look.notes,
            *verdict_notes(verdict, explanations, contradiction, ruled_out, noise, outliers, inputs.study.trials),
        ),
        effects=effects,
        explanations=explanations,
        explanations_fitted=len(found.search.tried),
        unlisted=unlisted,
        correlated_noise=noise,
        smallest_visible=tuple(visible),
        next_experiments=_next_experiments(found, credible, inputs.study, ends) if verdict is Verdict.AMBIGUOUS else (),
        errors=errors,
        events=event_residuals(predicted),
        outliers=outliers,
        before=_fit_report(before, declared_tests, start_costs),
        after=_fit_report(after, tests, start_costs if after is before else ()),
        judged_on="held-out trials" if before.held_out.fits else "held-out blocks of time",
        data=tuple(o.summary() for _, o in inputs.observed),
        provenance=_provenance(),
        scenario=_scenario(inputs.study, after if is_explained else before, effects),
        trial_figures=tuple(t for t in predicted if t.data.channels),
        first_look=first_look,
    )


def _judged(found: Explanations, e: Explanation, ends: float) -> Judged:
    """Judge an explanation, without which there is no report.

    An interrupt ends what follows, and only a second one what is judged here.
    """
    with time_limits(settle=ends):
        try:
            judged = found.judged(e)
        except KeyboardInterrupt:
            found.interrupted = True
            judged = found.judged(e)
        found.interrupted |= fits_end_now()
        return judged


def _next_experiments(found: Explanations, credible: list[Explanation], study: Study, ends: float) -> tuple[Experiment, ...]:
    """Return trials that would separate the tied explanations by listed effects; an interrupt costs this, not the verdict."""
    ties = [e for e in credible if not e.parts.law]
    with contextlib.suppress(KeyboardInterrupt), time_limits(stop=ends):
        names = [tuple(sorted(e.key)) or ("nothing",) for e in ties]
        return best_experiments(study, [found.fit(e) for e in ties], names) if len(ties) > 1 else ()
    return ()


def _fit_report(model: Judged, tests: ModelTests, start_costs: tuple[float, ...]) -> FitReport:
    """Return the parameters and diagnostics of a model's fit to all data."""
    return FitReport(
        parameters=model.fit.parameters,
        correlations=model.fit.correlations(),
        condition_number=model.fit.condition,
        start_costs=start_costs,
        tests=tests.all,
    )


def _scenario(study: Study, model: Judged, effects: tuple[FittedEffect, ...]) -> str:
    """Return the first training trial under a model as the text of a scenario file; ``effects``: what it adds."""
    parameters, _ = model.fit.problem.parameters_and_camera(model.fit.x, 0)
    d = model.fit.problem.data[0]
    camera = ", ".join(effect_in_words(e) for e in effects if e.candidate.acts_on == "camera")
    added = ", ".join(effect_in_words(e) for e in effects if e.candidate.acts_on != "camera") or "nothing"
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


def _provenance() -> dict[str, str]:
    """Return package -> version of all that a result depends on."""
    packages = ("numpy", "scipy", "wasmtime", *sorted({e.package for e in EFFECTS.values() if e.package}))
    versions = {package: installed_version(package) for package in packages}
    known = {package: version for package, version in versions.items() if version != MISSING}
    return {"looping-pendulum": __version__, "python": platform.python_version()} | known
