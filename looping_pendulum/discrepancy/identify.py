"""The loop: read, calibrate what is declared, search for what it lacks, conclude."""

from __future__ import annotations

import contextlib
import math
import platform
import time
from importlib.metadata import PackageNotFoundError, version

from looping_pendulum import __version__
from looping_pendulum.discrepancy.identification import Conclusion, identification
from looping_pendulum.discrepancy.data.study import Study
from looping_pendulum.discrepancy.inputs import read_inputs
from looping_pendulum.discrepancy.next_experiment import best_experiments
from looping_pendulum.discrepancy.result import Experiment, Identification, Verdict
from looping_pendulum.discrepancy.search import Progress, Search
from looping_pendulum.discrepancy.unlisted.description import unlisted
from looping_pendulum.discrepancy.workers import Workers, available
from looping_pendulum.errors import HarnessError

REPORTING = 0.97
"""Share of the work after which only the report is made, whatever the time limit."""


class OutOfTimeError(HarnessError, TimeoutError):
    """The time limit was over before anything was found."""


class _OutOfTime(KeyboardInterrupt):
    """The time limit is over: what was found is told as after Ctrl-C, and nothing on the way takes it for a fault."""


def identify(
    study: Study,
    *,
    seed: int = 0,
    progress: Progress = lambda what, share: None,
    workers: int | None = None,
    time_limit: float | None = None,
) -> Identification:
    """Find what the declared model of a study lacks.

    Parameters
    ----------
    seed
        Of the second start of the calibration; all else is the same for the same input.
    progress
        Called now and then.
    workers
        Processes that share the work, this one included: the result is the same by any number. None: two, if there are as many
        processors.
    time_limit
        After this long [s] the search ends with the step that it is at, as after Ctrl-C, and says so; None: never.

    Raises
    ------
    DataError
        If the data cannot be used.
    FitError
        If the declared model cannot run.
    OutOfTimeError
        If the declared model was not even calibrated within the time limit.
    """
    deadline = math.inf if time_limit is None else time.monotonic() + time_limit

    def watched(what: str, share: float) -> None:
        if time.monotonic() > deadline and share < REPORTING:
            raise _OutOfTime
        progress(what, share)

    progress("reading", 0.0)
    try:
        with Workers(available() if workers is None else workers) as team:
            return _identify(study, seed, watched, team)
    except _OutOfTime:
        message = (
            f"--time-limit: found no fit of the declared model within {time_limit:g} s; check the study's units and values"
        )
        raise OutOfTimeError(f"{message}, or allow more") from None


def _identify(study: Study, seed: int, progress: Progress, workers: Workers) -> Identification:
    inputs = read_inputs(study)
    search = Search(inputs, seed, progress, workers)
    interrupted = False
    try:
        search.run()
    except KeyboardInterrupt:
        if search.base is None:
            raise
        interrupted = True
    progress("reporting", REPORTING)
    verdict, model, ties = search.conclusion(interrupted)
    assert search.base is not None
    experiments: tuple[Experiment, ...] = ()
    if len(ties) > 1:
        with contextlib.suppress(KeyboardInterrupt):
            experiments = best_experiments(study, [t.fit for t in ties], [t.names for t in ties])
    force = unlisted(search.forces, search.formulas, search.base.unseen.worst) if verdict is Verdict.UNLISTED else None
    return identification(
        inputs.study,
        [o.summary() for _, o in inputs.observed],
        seed,
        verdict,
        Conclusion(
            before=search.base,
            after=model,
            ties=ties,
            rounds=tuple(search.rounds),
            experiments=experiments,
            unlisted=force,
            scaled=search.scaled,
        ),
        _provenance(),
    )


def _provenance() -> dict[str, str]:
    found = {"looping-pendulum": __version__, "python": platform.python_version()}
    for package in ("numpy", "scipy", "heyoka"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found
