"""The loop: calibrate what is declared, look at what is left, screen, refit, judge, add; until nothing is left or passes."""

from __future__ import annotations

import contextlib
import math
import platform
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import PackageNotFoundError, version

import numpy as np

from looping_pendulum import __version__
from looping_pendulum.discrepancy import outcome
from looping_pendulum.discrepancy.attribution import SCORE_LIMIT, Refit, Screened, Unseen, judge, refit, screen
from looping_pendulum.discrepancy.calibration import Data, Fit, Number, Problem, calibrate, minimise, numbers_of
from looping_pendulum.discrepancy.candidates import Candidate, candidates
from looping_pendulum.discrepancy.discovery import Found, discover
from looping_pendulum.discrepancy.next_experiment import best_experiments
from looping_pendulum.discrepancy.observations import DataError, Observations
from looping_pendulum.discrepancy.residual import (
    ResidualTests,
    best_of,
    calibrated,
    check_residuals,
    data_of,
    started,
    with_noise_of_residuals,
)
from looping_pendulum.discrepancy.study import Study, Trial, read_trial
from looping_pendulum.discrepancy.unlisted import unlisted
from looping_pendulum.discrepancy.verdict import Experiment, Identification, Ranked, Round, Verdict
from looping_pendulum.reference_ode.solve import available_integrators

GAIN = 10.0
"""On the Bayesian information criterion that an effect must bring; in 120 clean studies none did."""
MARGIN = 10.0
"""Of that over the next candidate's: all wrong winners of the trials were nearer than this."""
REFITS = 6
"""Candidates that are refitted in a round."""
LEAST_SCORE = 2.0
"""Of a candidate that is refitted, and a sixth of the best one's: by far less, it would not gain."""
EXACT = 5
"""Candidates that are screened again with all added effects at work, which costs compilations."""
MOST_EFFECTS = 2
"""Added at once; three of the library can mimic most of what it lacks."""

Progress = Callable[[str, float], None]
"""Told what goes on, and the share of all work that is surely done."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Model:
    """A fitted model, and everything that may speak against it."""

    fit: Fit
    added: tuple[Candidate, ...]
    tests: ResidualTests
    unseen: Unseen
    screening: Callable[[], tuple[Screened, ...]]
    starts: tuple[float, ...] = ()

    @cached_property
    def left(self) -> tuple[Screened, ...]:
        """What could still be added, best first; found when it is first asked for."""
        return self.screening()

    @cached_property
    def alarms(self) -> tuple[str, ...]:
        """Whatever is not quiet; where something else speaks against an added effect, candidates are not asked any more."""
        found = [] if self.tests.quiet else [self.tests.loudest]
        if not self.unseen.explained:
            found.append(f"data that no fit saw: chi2 per value {self.unseen.worst:.3f}")
        if not (found and self.added):
            found += [f"{s.candidate.name}: score {s.score:.1f}" for s in self.left[:1] if abs(s.score) > SCORE_LIMIT]
        return tuple(found)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of what was added."""
        return tuple(c.name for c in self.added)


@dataclass(frozen=True, kw_only=True, eq=False)
class Inputs:
    """Everything read from a study's files."""

    study: Study
    observed: tuple[tuple[Trial, Observations], ...]
    training: tuple[Data, ...]
    numbers: tuple[Number, ...]
    held: tuple[tuple[Data, tuple[Number, ...]], ...]
    library: tuple[Candidate, ...]


def read_inputs(study: Study) -> Inputs:
    """Read every trial.

    Raises
    ------
    DataError
        If a file cannot be used.
    """
    observed = tuple((t, read_trial(study, t)) for t in study.trials)
    for _, o in observed:
        if not o.channels:
            raise DataError(f"{o.file}: found only events, needed places or angles over time to fit; leave this trial out")
    training = tuple((t, o) for t, o in observed if not t.held_out)
    numbers = numbers_of(study, training)
    cameras = [set(study.camera_priors(t, o)) for t, o in training]
    shared = [n for n in study.camera_priors(*training[0]) if all(n in c for c in cameras)]
    return Inputs(
        study=study,
        observed=observed,
        training=tuple(data_of(t, o) for t, o in training),
        numbers=numbers,
        held=tuple((data_of(t, o), numbers_of(study, [(t, o)])) for t, o in observed if t.held_out),
        library=candidates(study, numbers, shared),
    )


def identify(study: Study, *, seed: int = 0, progress: Progress = lambda what, share: None) -> Identification:
    """Find what the declared model of a study lacks.

    Parameters
    ----------
    seed
        Of the second start of the calibration; all else is the same for the same input.
    progress
        Called now and then.

    Raises
    ------
    DataError
        If the data cannot be used.
    FitError
        If the declared model cannot run.
    """
    progress("reading", 0.0)
    _hush()
    inputs = read_inputs(study)
    search = _Search(inputs, seed, progress)
    interrupted = False
    try:
        search.run()
    except KeyboardInterrupt:
        if search.base is None:
            raise
        interrupted = True
    progress("reporting", 0.97)
    verdict, model, ties = search.conclusion(interrupted)
    assert search.base is not None
    experiments: tuple[Experiment, ...] = ()
    if len(ties) > 1:
        with contextlib.suppress(KeyboardInterrupt):
            experiments = best_experiments(study, [t.fit for t in ties], [t.names for t in ties])
    force = unlisted(search.forces, search.base.unseen.worst) if verdict is Verdict.UNLISTED else None
    return outcome.identification(
        inputs.study,
        [o.summary() for _, o in inputs.observed],
        seed,
        verdict,
        outcome.Conclusion(
            before=search.base,
            after=model,
            ties=ties,
            rounds=tuple(search.rounds),
            experiments=experiments,
            unlisted=force,
        ),
        _provenance(),
    )


class _Search:
    """The state of the loop."""

    def __init__(self, inputs: Inputs, seed: int, progress: Progress) -> None:
        self.inputs = inputs
        self.rng = np.random.default_rng(seed)
        self.progress = progress
        self.rounds: list[Round] = []
        self.base: Model | None = None
        self.winners: tuple[Model, ...] = ()
        """Explanations that pass, the best first; those within the margin are tied."""
        self.forces: tuple[Found, ...] = ()
        """Unlisted forces that explain what no fit saw, the best first."""

    def run(self) -> None:
        """Search until nothing is left or nothing passes."""
        self.progress("calibrating", 0.02)
        first = calibrated(calibrate(Problem(self.inputs.study, self.inputs.training, self.inputs.numbers)))
        second = started(first, self.rng)
        best = best_of([first, second])
        if best is second and second.cost < first.cost - 1:
            best = calibrated(second)
        self.base = self.model(best, (), (first.cost, second.cost))
        current = self.base
        for number in range(MOST_EFFECTS):
            if not current.alarms:
                return
            following = self.round(current, 0.1 + 0.25 * number)
            if self.winners:
                return self.contest() if number else None
            if following is None:
                break
            current = following
        self.forces = self.unlisted_forces()

    def contest(self) -> None:
        """Look for rivals of every effect that was added before the last, with the later ones in the model."""
        best = self.winners[0]
        for dropped in best.added[:-1]:
            others = tuple(c for c in best.added if c is not dropped)
            gone = {dropped.name, *(c.name for c in dropped.companions)}
            kept = [i for i, n in enumerate(best.fit.problem.names) if n not in gone]
            numbers = [best.fit.problem.numbers[i] for i in kept]
            fit = minimise(Problem(self.inputs.study, best.fit.problem.data, numbers), best.fit.x[kept])
            left = tuple(s for s in self.screened(fit, others) if s.candidate is not dropped)
            current = Model(fit=fit, added=others, tests=best.tests, unseen=best.unseen, screening=_known(left))
            least = fit.cost - best.fit.cost - math.log(fit.problem.count) - MARGIN
            refits = self.refits(current, 0.7)
            judged = self.judged(current, [r for r in refits if r.gain >= max(least, GAIN) and r.inside], 0.8)
            self.rounds.append(_round(current, refits, judged))
            self.winners += tuple(judged.values())

    def model(self, fit: Fit, added: tuple[Candidate, ...], starts: tuple[float, ...] = ()) -> Model:
        """Ask everything that may speak against a fit."""
        return Model(
            fit=fit,
            added=added,
            tests=check_residuals(fit),
            unseen=judge(fit, self.inputs.held),
            screening=lambda: self.screened(fit, added),
            starts=starts,
        )

    def screened(self, fit: Fit, added: tuple[Candidate, ...]) -> tuple[Screened, ...]:
        """Score all that could still be added."""
        names = {c.name for c in added}
        costly = {k for c in added if c.compiled for k in (c.name, *(k.name for k in c.companions))}
        rough = screen(fit, [c for c in self.inputs.library if c.name not in names], tuple(costly))
        if not costly:
            return tuple(rough)
        exact = screen(fit, [s.candidate for s in rough[:EXACT] if abs(s.score) > LEAST_SCORE])
        known = {s.candidate.name for s in exact}
        both = [*exact, *(s for s in rough if s.candidate.name not in known)]
        return tuple(sorted(both, key=lambda s: -abs(s.score)))

    def round(self, current: Model, share: float) -> Model | None:
        """Try to add one effect; return the best model, to go on from, or None if nothing gains enough."""
        refits = self.refits(current, share)
        least = max(GAIN, refits[0].gain - MARGIN) if refits else GAIN
        judged = self.judged(current, [r for r in refits if r.gain >= least], share + 0.2)
        self.rounds.append(_round(current, refits, judged))
        inside = {r.candidate.name for r in refits if r.inside}
        passing = [m for name, m in judged.items() if name in inside and not m.alarms]
        # what is as good but for an alarm is not far enough behind to be ruled out
        near = [m for name, m in judged.items() if name in inside and m.alarms]
        self.winners = (*passing, *near) if passing else ()
        return next(iter(judged.values()), None)

    def refits(self, current: Model, share: float) -> list[Refit]:
        """Fit the model with each of the best candidates, best first."""
        found: list[Refit] = []
        least = max(LEAST_SCORE, abs(current.left[0].score) / 6) if current.left else 0.0
        chosen = [s for s in current.left if s.amplitude and abs(s.score) >= least][:REFITS]
        for i, screened in enumerate(chosen):
            self.progress(f"refitting with {screened.candidate.name}", share + 0.15 * i / REFITS)
            one = refit(current.fit, screened, max((r.gain for r in found), default=0.0))
            found += [one] if one else []
        return sorted(found, key=lambda r: -r.gain)

    def judged(self, current: Model, refits: Sequence[Refit], share: float) -> dict[str, Model]:
        """Ask of each refit everything that may speak against it."""
        found = {}
        for r in refits:
            self.progress(f"judging {r.candidate.name}", share)
            found[r.candidate.name] = self.model(with_noise_of_residuals(r.fit), (*current.added, r.candidate))
        return found

    def unlisted_forces(self) -> tuple[Found, ...]:
        """Search for a force that no library lists; keep those that gain and explain unseen data."""
        assert self.base is not None
        found = discover(self.base.fit, self.inputs.held, lambda what: self.progress(what, 0.85))
        passing = [f for f in found if f.gain >= GAIN and f.unseen.explained and f.unseen.worst < self.base.unseen.worst]
        return tuple(passing + [f for f in found if f not in passing]) if passing else ()

    def conclusion(self, interrupted: bool) -> tuple[Verdict, Model, tuple[Model, ...]]:
        """Verdict, the model to go on with, and what is tied."""
        assert self.base is not None
        if interrupted:
            return Verdict.INTERRUPTED, self.winners[0] if self.winners else self.base, ()
        if not self.base.alarms:
            return Verdict.NO_MISSING_EFFECT, self.base, ()
        if not self.winners and self.forces:
            best = self.forces[0]
            tests = check_residuals(best.fit)
            return Verdict.UNLISTED, Model(fit=best.fit, added=(), tests=tests, unseen=best.unseen, screening=tuple), ()
        if not self.winners:
            return Verdict.UNEXPLAINED, self.base, ()
        if len(self.winners) > 1:
            return Verdict.AMBIGUOUS, self.winners[0], self.winners
        return Verdict.IDENTIFIED, self.winners[0], ()


def _known(left: tuple[Screened, ...]) -> Callable[[], tuple[Screened, ...]]:
    return lambda: left


def _passes(r: Refit, model: Model | None) -> bool:
    return model is not None and r.inside and r.gain >= GAIN and not model.alarms


def _reason(r: Refit, model: Model | None, best: Refit) -> str:
    if r.gain < GAIN:
        return f"gains less than {GAIN:g}"
    if model is None:
        return f"gains {best.gain - r.gain:.1f} less than {best.candidate.name}"
    if not r.inside:
        return "ends on a bound of what is physically possible"
    return "; ".join(model.alarms)


def _round(current: Model, refits: Sequence[Refit], judged: dict[str, Model]) -> Round:
    ranking = []
    for r in refits:
        c, model = r.candidate, judged.get(r.candidate.name)
        ranking.append(
            Ranked(
                name=c.name, kind=c.kind, score=r.screened.score, gain=r.gain, value=r.value, error=r.error,
                held_out=model.unseen.worst if model else None, passes=_passes(r, model), reason=_reason(r, model, refits[0]),
            )
        )  # fmt: skip
    refitted = {r.name for r in ranking}
    for s in current.left:
        if s.candidate.name not in refitted:
            ranking.append(
                Ranked(name=s.candidate.name, kind=s.candidate.kind, score=s.score, gain=None, value=None, error=None,
                       held_out=None, passes=False, reason="not among the best of the screening")
            )  # fmt: skip
    return Round(
        added_before=current.names,
        ranking=tuple(ranking),
        best=ranking[0].name if refits else "",
        runner_up=ranking[1].name if len(refits) > 1 else "",
        margin=refits[0].gain - refits[1].gain if len(refits) > 1 else None,
    )


def _hush() -> None:
    """Keep heyoka from printing where a trial value is beyond what it can integrate: the fit goes elsewhere by itself."""
    if "heyoka" in available_integrators():
        import heyoka

        heyoka.set_logger_level_critical()


def _provenance() -> dict[str, str]:
    found = {"looping-pendulum": __version__, "python": platform.python_version()}
    for package in ("numpy", "scipy", "heyoka"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found
