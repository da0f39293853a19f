"""Identify the physics that a declared model lacks: read the data, calibrate, search, and put the result together."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import platform
import time
from collections.abc import Callable

from looping_pendulum import __version__
from looping_pendulum.discrepancy.evidence.explain import explain
from looping_pendulum.discrepancy.first_look.check import take_first_look
from looping_pendulum.discrepancy.fit.residual import check_residuals
from looping_pendulum.discrepancy.identification import Conclusion, identification
from looping_pendulum.discrepancy.inputs import Inputs, read_inputs
from looping_pendulum.discrepancy.next_experiment import best_experiments
from looping_pendulum.discrepancy.result import Experiment, Identification, Verdict
from looping_pendulum.discrepancy.unlisted.description import describe_unlisted_force
from looping_pendulum.discrepancy.unlisted.formula import FittedFormula
from looping_pendulum.discrepancy.unlisted.formula import refit as refit_formulas
from looping_pendulum.discrepancy.workers import Workers, default_process_count, one_blas_thread
from looping_pendulum.errors import HarnessError
from looping_pendulum.measured.study import Study
from looping_pendulum.reference_ode.effects import EFFECTS
from looping_pendulum.versions import MISSING, installed_version

FractionCallback = Callable[[str, float], None]
"""Function that is called with a description of each step that begins, and the share of all work that is done."""
STEP_SHARE = 0.2
"""Share of the work that is left which a step counts for."""
REPORT_SHARE = 0.97
"""Share of the work from which on only the result is put together, which the time limit does not end."""


class OutOfTimeError(HarnessError, TimeoutError):
    """The time limit was over before the declared model was calibrated."""


class _OutOfTime(KeyboardInterrupt):
    """The time limit is over: what was found is reported, as after Ctrl-C.

    A KeyboardInterrupt is no Exception, so no handler of failed fits on the way catches it.
    """


def identify(
    study: Study,
    *,
    seed: int = 0,
    progress: FractionCallback = lambda what, share: None,
    workers: int | Workers | None = None,
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
    workers
        Number of processes that share the work, this one included; the result does not depend on it. None: two, if there are as
        many processors. Or a pool of them, which is left open.
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

    def progress_within_limit(what: str, share: float) -> None:
        if time.monotonic() > deadline and share < REPORT_SHARE:
            raise _OutOfTime
        progress(what, share)

    progress("reading", 0.0)
    try:
        # First, so that the worker processes start and import meanwhile
        with one_blas_thread(), _pool(workers) as team:
            first_look = take_first_look(study)
            if not anyway:
                first_look.refuse_mistakes()
            inputs = read_inputs(study, first_look.observations)
            result = _identify(inputs, seed, progress_within_limit, team)
    except _OutOfTime:
        message = (
            f"--time-limit: found no fit of the declared model within {time_limit:g} s; check the study's units and values"
        )
        raise OutOfTimeError(f"{message}, or allow more") from None
    return dataclasses.replace(result, notes=(*first_look.notes, *result.notes), first_look=first_look)


def _pool(workers: int | Workers | None) -> contextlib.AbstractContextManager[Workers]:
    if isinstance(workers, Workers):
        return contextlib.nullcontext(workers)
    return Workers(default_process_count() if workers is None else workers)


def _identify(inputs: Inputs, seed: int, progress: FractionCallback, workers: Workers) -> Identification:
    """Identify; an interrupt after the calibration ends the search, one before it or while models are judged is raised."""
    done = 0.0

    def report(what: str) -> None:
        # How many steps there will be, is not known: each takes a part of what is left
        nonlocal done
        progress(what, done)
        done += STEP_SHARE * (REPORT_SHARE - done)

    found, start_costs = explain(inputs, seed, workers, report)
    progress("reporting", REPORT_SHARE)
    before = found.judged(found.nothing)
    has_repair = found.verdict not in (Verdict.NO_MISSING_EFFECT, Verdict.UNEXPLAINED) and found.best is not found.nothing
    after = found.judged(found.best) if has_repair else before
    force = None
    law = next((r.explanation for r in found.ranked if r.credible and r.explanation.parts.law), None)
    if law and has_repair:
        is_best = law is found.best
        without, recovered = found.force(after if is_best else found.judged(law))
        formulas: list[FittedFormula] = []
        try:
            if not found.interrupted:
                formulas = refit_formulas(without, recovered, inputs.held_out, workers)
        except KeyboardInterrupt:
            found.interrupted = True
        force = describe_unlisted_force(recovered, formulas, before.held_out.worst)
        if force.formula and formulas[0].held_out and is_best:
            fit = formulas[0].fit
            after = dataclasses.replace(after, fit=fit, training=fit, held_out=formulas[0].held_out, tests=check_residuals(fit))
    ties = [r for r in found.ranked if r.credible and not r.explanation.parts.law]
    experiments: tuple[Experiment, ...] = ()
    if found.verdict is Verdict.AMBIGUOUS and len(ties) > 1:
        # An interrupt now costs the advice on the next trial, but not the verdict
        with contextlib.suppress(KeyboardInterrupt):
            names = [tuple(sorted(r.explanation.key)) or ("nothing",) for r in ties]
            experiments = best_experiments(inputs.study, [r.fit for r in ties], names, workers)
    return identification(
        inputs.study,
        [o.summary() for _, o in inputs.observed],
        seed,
        Conclusion(found=found, before=before, after=after, start_costs=start_costs, experiments=experiments, unlisted=force),
        _provenance(),
    )


def _provenance() -> dict[str, str]:
    """Return package -> version."""
    packages = ("numpy", "scipy", "heyoka", *sorted({e.package for e in EFFECTS.values() if e.package}))
    versions = {package: installed_version(package) for package in packages}
    installed = {package: version for package, version in versions.items() if version != MISSING}
    return {"looping-pendulum": __version__, "python": platform.python_version()} | installed
