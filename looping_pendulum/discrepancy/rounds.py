"""Rounds of the search for missing effects: screen the candidates beside a model, refit the best, test these."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from functools import cached_property

from looping_pendulum.discrepancy.fit.calibration import Fit
from looping_pendulum.discrepancy.fit.model_test import ModelTest
from looping_pendulum.discrepancy.fit.residual import check_residuals
from looping_pendulum.discrepancy.fit.residual_noise import with_noise_of_residuals
from looping_pendulum.discrepancy.inputs import Inputs
from looping_pendulum.discrepancy.listed.attribution import (
    MIN_DELTA_BIC,
    Refit,
    delta_bic_beside_wander,
    refits,
    with_own_noises,
)
from looping_pendulum.discrepancy.listed.candidate_model import CandidateModel
from looping_pendulum.discrepancy.listed.candidates import Candidate
from looping_pendulum.discrepancy.listed.held_out import (
    HeldOutTest,
    check_held_out,
    improvement_test,
    loss_test,
    square_ratio,
)
from looping_pendulum.discrepancy.listed.round_record import MIN_DELTA_BIC_MARGIN, record_round, wander_test
from looping_pendulum.discrepancy.listed.screening import ScreenedCandidate, screen
from looping_pendulum.discrepancy.result import Round
from looping_pendulum.discrepancy.workers import Workers

MAX_REFITS = 6
"""Candidates that are refitted in a round."""
MAX_FURTHER_REFITS, MIN_SHARE_OF_BEST_SCORE = 12, 1 / 3
"""Further ones that are refitted if none of these passes, and the smallest score of those over the best.

Of an effect that fitted parameters nearly undo the scores say little: a linear drag that moved the light mass by 50 mm came
ninth, with a delta BIC of 750 where the best of six had 150; beside a wind it came tenth, with 260 where they had 45.
"""
MIN_REFIT_SCORE = 2.0
"""Smallest |z| of a candidate that is refitted.

The delta BIC that a score z predicts is z^2 less log(n), far below `MIN_DELTA_BIC` for such z.
"""
MAX_SCORE_RATIO = 6
"""Largest ratio of the best candidate's |z| to that of a candidate that is refitted."""
MAX_NONLINEARITY = 1.5
"""Largest decrease of chi2 by a refit over what its score predicts, z^2, up to which the scores are trusted to rank candidates.

A string that is smoother on itself had a score of 17, friction per wrap angle one of 33 in its place, which predicts 1100; its
refit had 2530. In another study the scores were 1 and 4.7, and the refits as good as each other.
"""
MIN_SHARE_OF_ALIKE = 0.6
"""Share of the best refit's score from which on candidates that act on the same are refitted, however many scored between.

For a string that rubs on itself friction per wrap angle was named, by a score of 12.1; the right one, of 9.4, was not refitted.
"""
MAX_WEAK_DELTA_BIC = 50.0
"""Delta BIC up to which an effect is tested beside a tracker that wanders too little to be noticed.

In clean studies of such trackers effects reached 18 under white noise, and 8 beside the wandering.
"""
MAX_CHANCE_DELTA_BIC = 20.0
"""Delta BIC up to which an effect that further tests refuse is taken for chance; of a larger one something must be missing.

In clean studies of trackers that wander effects reached 18 under white noise.
"""
MAX_RESCREENED = 5
"""Candidates that are screened again with all added effects in the model, which costs compilations."""
MAX_SQUARE_LEFT = 0.5
"""Share of the held-out mean square residual up to which an effect is not refused for the pattern that it leaves.

The errors of real marks are seldom as simple as correlated noise, so that a pattern stays beside the right effect, too.
"""

FractionCallback = Callable[[str, float], None]
"""Called with a description of the step that begins, and the share of all work that is done at least."""


class Rounds:
    """Rounds that were made, what they found, and the steps of one."""

    def __init__(self, inputs: Inputs, progress: FractionCallback, workers: Workers) -> None:
        self.inputs = inputs
        self.workers = workers
        self.report_progress = progress
        self.rounds: list[Round] = []
        self.declared_model: CandidateModel | None = None
        """The declared model, calibrated; None until then."""
        self.accepted_models: tuple[CandidateModel, ...] = ()
        """Accepted explanations, the best first; all are within the margin of the best, so more than one are tied."""
        self.screened: dict[str, ScreenedCandidate] = {}
        """Candidate's name -> its latest screening."""
        self.white_rounds: dict[int, tuple[CandidateModel, list[Refit], dict[str, CandidateModel]]] = {}
        """Rounds with white noise, by their index: the model before, its refits, and those of them that were tested."""
        self.tested_beside_declared: dict[str, CandidateModel] = {}
        """Candidate's name -> the declared model with it, of those that were tested in the last round beside it."""
        self.correlated_base: CandidateModel | None = None
        """The declared model with errors of the tracked points that last longer than a frame; None: the search takes none."""
        self.correlated_fit: Fit | None = None
        """Fit of the declared model with such errors, once it is known that there are some."""

    def run_round(self, current: CandidateModel, share: float) -> CandidateModel | None:
        """Try to add one effect; return the best model to go on from, or None if no delta BIC is sufficient."""
        return self.judge_round(current, self.refit_candidates(current, share), share)

    def run_wider_round(self, current: CandidateModel, share: float) -> CandidateModel | None:
        """Refit further candidates where none of the last round passed; return the best model, or None if it is the same."""
        known = {r.candidate.name: r for r in self.white_rounds[len(self.rounds) - 1][1]}
        further = [
            s
            for s in current.remaining
            if s.amplitude
            and s.candidate.name not in known
            and abs(s.score) >= MIN_SHARE_OF_BEST_SCORE * abs(current.remaining[0].score)
        ]
        # With the known ones, so that what cannot beat the best of them gets no second start
        wider = [*known.values(), *refits(current.fit, further[:MAX_FURTHER_REFITS], known, self.workers)]
        best = max(wider, key=lambda r: r.delta_bic, default=None)
        if best is None or best.candidate.name in known:
            return None
        self.rounds.pop()  # the round is part of this one
        return self.judge_round(current, sorted(wider, key=lambda r: -r.delta_bic), share)

    def judge_round(self, current: CandidateModel, refits: Sequence[Refit], share: float) -> CandidateModel | None:
        """Test the best refits and record the round; return the best model, or None if no delta BIC is sufficient."""
        near = [r for r in refits if r.delta_bic >= refits[0].delta_bic - MIN_DELTA_BIC_MARGIN]
        evident = [r for r in near if r.delta_bic >= MIN_DELTA_BIC]
        share += 0.01 if self.correlated_base else 0.2
        judged = self.judge_refits(current, evident, share, current.held_out)
        within_bounds = {r.candidate.name for r in near if r.within_bounds}
        passing = {name: m for name, m in judged.items() if name in within_bounds and not m.failed_tests}
        if passing:
            # What is found is no chance, so that an effect whose own evidence would not suffice may explain it, too
            judged |= self.judge_refits(current, [r for r in near if r.within_bounds and r not in evident], share)
        self.record(current, refits, judged)
        if self.correlated_base is None:
            self.white_rounds[len(self.rounds) - 1] = (current, list(refits), judged)
        if not current.added:
            self.tested_beside_declared = judged
        # A model within the margin that fails a test is no winner, but its delta BIC is too near to the best to rule it out.
        others = [m for name, m in judged.items() if name in within_bounds and name not in passing]
        self.accepted_models = (*passing.values(), *others) if passing else ()
        return next(iter(judged.values()), None)

    def refit_candidates(self, current: CandidateModel, share: float, delta_bic_to_beat: float = 0.0) -> list[Refit]:
        """Refit the model with each of the best candidates; return the refits, best first.

        Of one that cannot come near to ``delta_bic_to_beat`` no second start is tried.
        """
        min_score = max(MIN_REFIT_SCORE, abs(current.remaining[0].score) / MAX_SCORE_RATIO) if current.remaining else 0.0
        # An amplitude of zero means that no change within the bounds looks like the residuals
        eligible = [s for s in current.remaining if s.amplitude and abs(s.score) >= min_score]
        chosen = eligible[:MAX_REFITS]
        chosen += [s for s in current.remaining if s.amplitude and not s.acts_at_fit and s not in chosen]
        known: dict[str, Refit | None] = dict(current.refitted)
        if self.correlated_base and not current.added:
            # Correlated noise may hide from the score what the candidate's own noise shows
            known.update((r.candidate.name, r) for r in self.refits_with_own_noise)
            chosen += [s for s in current.remaining if s.candidate.name in known and s not in chosen]
        counter = itertools.count()

        def report(name: str) -> None:
            self.report_progress(
                f"refitting with {name}", share + (0.01 if self.correlated_base else 0.15) * next(counter) / MAX_REFITS
            )

        results = refits(current.fit, chosen, known, self.workers, report, delta_bic_to_beat)
        alike = _alike(results[0], current.remaining, chosen) if results else []
        if alike:
            known.update((r.candidate.name, r) for r in results)
            results = refits(current.fit, [*chosen, *alike], known, self.workers, report, delta_bic_to_beat)
        return results

    @cached_property
    def refits_with_own_noise(self) -> list[Refit]:
        """Return the refits of the first round, each with the noise that its own residuals show."""
        assert self.correlated_fit is not None
        return with_own_noises(self.correlated_fit, self.white_rounds[0][1], self.workers)

    def judge_refits(
        self, current: CandidateModel, refits: Sequence[Refit], share: float, without: HeldOutTest | None = None
    ) -> dict[str, CandidateModel]:
        """Test each refit, and whether held-out data are less likely than ``without`` it; return candidate name -> model."""
        judged = {}
        for r in refits:
            self.report_progress(f"testing {r.candidate.name}", share)
            fit = r.fit if self.correlated_base else with_noise_of_residuals(r.fit)
            wander_tests: tuple[ModelTest, ...] = ()
            if without and not self.correlated_base and r.delta_bic < MAX_WEAK_DELTA_BIC:
                wander_tests = (wander_test(delta_bic_beside_wander(current.fit, fit, r.candidate)),)
            judged[r.candidate.name] = self.judge(fit, (*current.added, r.candidate), without=without, other_tests=wander_tests)
        return judged

    def judge(
        self,
        fit: Fit,
        added: tuple[Candidate, ...],
        start_costs: tuple[float, ...] = (),
        without: HeldOutTest | None = None,
        other_tests: tuple[ModelTest, ...] = (),
    ) -> CandidateModel:
        """Test a fit on its residuals, on held-out data and by the scores of the remaining candidates."""
        held_out = check_held_out(fit, self.inputs.held_out, workers=self.workers)
        other_tests += (loss_test(without, held_out),) if without else ()
        tests = check_residuals(fit)
        if added and self.correlated_base and self.declared_model:
            other_tests += (improvement_test(self.correlated_base.held_out, held_out),)
            if square_ratio(self.declared_model.held_out, held_out) <= MAX_SQUARE_LEFT:
                tests = dataclasses.replace(tests, groups=())
        return CandidateModel(
            fit=fit,
            added=added,
            tests=tests,
            held_out=held_out,
            screening=lambda: self.screen_candidates(fit, added),
            start_costs=start_costs,
            other_tests=other_tests,
        )

    @property
    def small_changes(self) -> dict[str, float]:
        """Candidate's name -> `ScreenedCandidate.small_change` of its latest screening."""
        return {name: s.small_change for name, s in self.screened.items()}

    def screen_candidates(self, fit: Fit, added: tuple[Candidate, ...]) -> tuple[ScreenedCandidate, ...]:
        """Screen the candidates that could still be added, best first.

        The reference is compiled anew for every set of effects, so beside an added effect that needs it only the best are
        screened exactly.
        """
        added_names = {c.name for c in added}
        costly = {k for c in added if c.needs_compilation for k in (c.name, *(k.name for k in c.companions))}
        library = [c for c in self.inputs.library if c.name not in added_names]
        rough = screen(fit, library, tuple(costly), self.workers, self.small_changes)
        self.screened |= {s.candidate.name: s for s in rough}
        if not costly:
            return tuple(rough)
        best = [s.candidate for s in rough[:MAX_RESCREENED] if abs(s.score) > MIN_REFIT_SCORE]
        exact = screen(fit, best, workers=self.workers, known_changes=self.small_changes)
        rescreened = {s.candidate.name for s in exact}
        both = [*exact, *(s for s in rough if s.candidate.name not in rescreened)]
        return tuple(sorted(both, key=lambda s: -abs(s.score)))

    def record(self, current: CandidateModel, refits: Sequence[Refit], judged: dict[str, CandidateModel]) -> None:
        """Record a round."""
        self.rounds.append(record_round(current, refits, judged, correlated_noise=self.correlated_base is not None))


def _alike(best: Refit, remaining: Sequence[ScreenedCandidate], chosen: Sequence[ScreenedCandidate]) -> list[ScreenedCandidate]:
    """Return candidates that act on the same as the best refit, were not chosen, and may explain as much."""
    if best.delta_bic < MIN_DELTA_BIC:
        return []
    score = abs(best.screened.score)
    # Where the best is far from linear the scores say little, so that one may be as good with however small a score
    least = MIN_SHARE_OF_ALIKE * score if best.chi2_decrease <= MAX_NONLINEARITY * score**2 else 0.0
    alike = [s for s in remaining if s.amplitude and s.candidate.acts_on == best.candidate.acts_on and s not in chosen]
    return [s for s in alike if abs(s.score) >= least][:MAX_REFITS]
