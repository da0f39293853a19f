"""Search among explanations: a linear model says which are fitted next, and their exact evidence decides."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from itertools import combinations

import numpy as np

from looping_pendulum.discrepancy.candidates import Candidate
from looping_pendulum.discrepancy.evidence.explanation import (
    NOTHING,
    Addition,
    Explanation,
    Key,
    Parts,
    bounded,
    explained,
    fit_addition,
    fit_again,
    fit_to_data,
    fit_without,
    raw,
)
from looping_pendulum.discrepancy.evidence.laws import Law, Laws, laws_beside
from looping_pendulum.discrepancy.evidence.marginal import Marginal, NoiseGrid
from looping_pendulum.discrepancy.evidence.prior import (
    LARGE_MISFIT,
    LEAST_TRIED,
    LINEAR_ERROR,
    MARGIN,
    MAX_EFFECTS,
    MAX_ROUNDS,
    MAX_SETTINGS,
    MAX_SETTINGS_OF_LAWS,
    MAX_TOGETHER,
    MIN_KNOWN_ERRORS,
    NEEDLESS,
    VISIBLE,
    body_of,
    log_occam,
    log_prior,
)
from looping_pendulum.discrepancy.evidence.templates import (
    Template,
    columns,
    smallest_visible,
    templates,
)
from looping_pendulum.discrepancy.fit.calibration import Fit
from looping_pendulum.discrepancy.fit.residual import ResidualTests, check_residuals
from looping_pendulum.discrepancy.fit.residual_noise import data_with_noise_of_residuals
from looping_pendulum.discrepancy.result import SmallestVisible
from looping_pendulum.reference_ode.geometry import Array


class Search:
    """Explanations of a study that were fitted exactly, and what a linear model says of others.

    Parameters
    ----------
    base
        Fit of the declared model to all trials, with white noise.
    library
        Listed effects that may be missing.
    report
        Called with a description of each step that begins.
    is_time_over
        Asked before each step whether to end.
    """

    def __init__(
        self,
        base: Fit,
        library: Sequence[Candidate],
        report: Callable[[str], None] = lambda what: None,
        is_time_over: Callable[[], bool] = lambda: False,
    ) -> None:
        self.library, self.report, self._is_time_over = tuple(library), report, is_time_over
        self.grid = NoiseGrid(base.problem.data)
        self.fitted: dict[Key, Explanation] = {}
        """What an explanation adds -> the explanation, of all that were fitted exactly."""
        self.possible: dict[Key, Addition] = {}
        """The same of those that were not: the best addition by which it is made."""
        self._linear: dict[tuple[Key, Key], Addition] = {}
        """(Parent, what is made) -> addition, of all that were looked at."""
        self._errors: dict[tuple[Key, bool], list[float]] = {}
        """(Parent, whether a law was added) -> evidence of exact fits less what the linear model had said."""
        self._expanded: set[Key] = set()
        self.ruled_out: list[Candidate] = []
        """Listed effects that would explain much with a value that is known to be impossible."""
        self._templates: dict[Key, list[Template]] = {}
        self._tested: dict[Key, tuple[Fit, ResidualTests]] = {}
        self._add(base, Parts())

    @property
    def best(self) -> Explanation:
        """Return the most probable explanation."""
        return max(self.fitted.values(), key=lambda e: e.log_posterior)

    def tested(self, e: Explanation) -> tuple[Fit, ResidualTests]:
        """Return the fit of an explanation with its most probable noise, and the tests of its residuals."""
        if e.key not in self._tested:
            fit, noises = e.fit, self.grid.noises(e.setting)
            if noises:
                fit = fit_to_data(fit, [d.with_noises(noises) for d in fit.problem.data]) or fit
            self._tested[e.key] = fit, check_residuals(fit)
        return self._tested[e.key]

    def passes(self, e: Explanation) -> bool:
        """Return whether the residuals of an explanation look like its own noise: the one absolute test."""
        return self.tested(e)[1].passes

    def smallest_visible(self, e: Explanation) -> list[SmallestVisible]:
        """Return the smallest size of every listed effect that the data would show beside an explanation."""
        found = self._templates_beside(e)
        m = Marginal(self.grid, raw(e.fit), columns(found, self.grid.count), bounded(e.fit), [e.setting])
        return smallest_visible(e.fit, found, m.complement[0])

    @property
    def settled(self) -> bool:
        """Return whether the best explanation has no law and white noise, and passes the test.

        A law of any form passes too easily, and so does noise that lasts longer than a frame.
        """
        return not self.best.parts.law and not self.best.setting and self.passes(self.best)

    def run(self) -> bool:
        """Fit explanations until no other comes near the best; return whether none does, or False: time was over before."""
        if not self._go_on():
            return False
        if not self.passes(self.best):
            # Once more, from other starts: where none is right, a fit may have gone astray
            chosen = sorted((e for e in self.fitted.values() if e.key), key=lambda e: -e.log_posterior)[:MAX_TOGETHER]
            for e, fit in zip(chosen, [fit_again(e) for e in chosen], strict=True):
                if fit is not None:
                    self._add(fit, e.parts)
            if not self._go_on():
                return False
        if self.best.key != NOTHING:  # whose noise is known
            self._with_noise_of(self.best)
            return self._go_on()
        return True

    def _go_on(self) -> bool:
        """Look at what may be added to explanations near the best, and fit what may come near, in rounds.

        Return False if time was over before.
        """
        for _ in range(MAX_ROUNDS):
            self._fit_without_parts()
            for e in self._near():
                if self._is_time_over():
                    return False
                self._expand(e)
            chosen = self._promising()
            if not chosen:
                return True
            if self._is_time_over():
                return False
            self.report(f"fitting {', '.join(in_words(a.key) for a in chosen)}")
            expected = {a.key: (self._start_of(a).key, self._expected(a, 0.0)[0]) for a in chosen}
            for a in chosen:
                del self.possible[a.key]
            # With noise that lasts longer than a frame a misfit is no measure of the evidence
            needless = self.best.log_posterior - NEEDLESS * MARGIN if not self.best.setting else -math.inf
            fits = [fit_addition(a, needless) for a in chosen]
            for a, fit in zip(chosen, fits, strict=True):
                if fit is not None:
                    start, log_posterior = expected[a.key]
                    found = self._add(fit, a.parts)
                    self._errors.setdefault((start, a.law is not None), []).append(found.log_posterior - log_posterior)
        return True

    def _add(self, fit: Fit, parts: Parts) -> Explanation:
        """Keep an explanation unless a better fit of it is known; return it."""
        e = explained(self.grid, fit, parts, len(self.library))
        known = self.fitted.get(e.key)
        if known is None or e.log_posterior > known.log_posterior:
            self.fitted[e.key] = e
            self._tested.pop(e.key, None)
        return e

    def _is_needless(self, e: Explanation) -> bool:
        """Return whether a part of an explanation is as probable as the whole."""
        return any(key < e.key and part.log_posterior >= e.log_posterior for key, part in self.fitted.items())

    def _near_best(self) -> list[Explanation]:
        limit = self.best.log_posterior - MARGIN
        return [e for e in self.fitted.values() if e.log_posterior > limit and not self._is_needless(e)]

    def _near(self) -> list[Explanation]:
        """Return the explanations whose neighbours are looked at next: those near the best, and what it adds something to.

        What it adds something to, with another part in its place, may be better still.
        """
        best, near = self.best, self._near_best()
        if not self.settled:
            near += [self.fitted[best.key - {part}] for part in sorted(best.key) if best.key - {part} in self.fitted]
        return [e for e in dict.fromkeys(near) if e.key not in self._expanded]

    def _fit_without_parts(self) -> None:
        """Fit what the explanations near the best leave if one of their parts is dropped."""
        todo: dict[Key, tuple[Explanation, str]] = {}
        for e in self._near_best():
            for part in sorted(e.key):
                if e.key - {part} not in self.fitted:
                    todo.setdefault(e.key - {part}, (e, part))
        fits = [fit_without(e, part) for e, part in todo.values()]
        for (e, part), fit in zip(todo.values(), fits, strict=True):
            if fit is not None:
                self._add(fit, e.parts.without(part))

    def _with_noise_of(self, best: Explanation) -> None:
        """Estimate the noise and the outliers beside the best explanation, and fit all that are near it again with these."""
        data = [data_with_noise_of_residuals(best.fit, k) for k in range(len(best.fit.problem.data))]
        limit = best.log_posterior - 2 * MARGIN
        kept = [e for e in self.fitted.values() if e.log_posterior > limit and not self._is_needless(e)]
        kept += [e for e in self.fitted.values() if e.key == NOTHING and e not in kept]
        fits = [fit_to_data(e.fit, data) for e in kept]
        before = set(self.fitted)
        self.grid = NoiseGrid(data)
        self.fitted.clear()
        self._tested.clear()
        self._expanded &= {NOTHING}
        for e, fit in zip(kept, fits, strict=True):
            if fit is not None:
                self._add(fit, e.parts)
        # What was far off, is with anything more
        far = before - set(self.fitted)
        possible = [a for a in self.possible.values() if a.parent.key in self.fitted and not any(key < a.key for key in far)]
        self.possible = {a.key: dataclasses.replace(a, parent=self.fitted[a.parent.key]) for a in possible}

    def _expand(self, e: Explanation) -> None:
        """Look at what one more effect, a pair of them, a law or both would add to an explanation, by a linear model."""
        self.report(f"looking beside {in_words(e.key)}")
        self._expanded.add(e.key)
        count = len(e.parts.effects)
        found = self._templates_beside(e) if count < (1 if e.parts.law else MAX_EFFECTS) else []
        changes, fitted = columns(found, self.grid.count), raw(e.fit)
        log_z = Marginal(self.grid, fitted, at_bounds=bounded(e.fit)).log_z_of_settings
        settings = [0, *(int(i) for i in np.argsort(-log_z) if i)][:MAX_SETTINGS]
        m = Marginal(self.grid, fitted, changes, bounded(e.fit), settings)
        if e.key == NOTHING:
            self.ruled_out = _impossible(m, found)
        for chosen, gain, amounts in _additions(m, found, pairs=count + 2 <= MAX_EFFECTS and not e.parts.law):
            step, _ = m.solution(chosen)
            self._offer(e, tuple(found[i] for i in chosen), amounts, step=step, gain=gain, decrease=m.decrease(chosen))
        # A second law is not looked for, nor one beside what is settled
        if e.parts.law or count > 1 or (e.key != NOTHING and self.settled):
            return
        settings = settings[:MAX_SETTINGS_OF_LAWS]
        laws = laws_beside(e.fit, self.grid, settings, m.log_z_of_settings[: len(settings)], fitted, changes)
        if laws is not None:
            self._offer_laws(e, laws, found if not count else [])

    def _templates_beside(self, e: Explanation) -> list[Template]:
        """Return the templates of the effects that may be added: those beside nothing, unless much was added since."""
        if e.key not in self._templates:
            others = [c for c in self.library if c not in e.parts.effects]
            is_far = e.log_z - self.fitted[NOTHING].log_z > LARGE_MISFIT
            anew = others if e.key == NOTHING or is_far else []
            kept = [t for t in self._templates.get(NOTHING, []) if t.candidate in others and t.candidate not in anew]
            self._templates[e.key] = kept + templates(e.fit, anew)
        return self._templates[e.key]

    def _offer_laws(self, e: Explanation, laws: Laws, found: Sequence[Template]) -> None:
        """Look at what a law would add, alone and with one of the templates ``found``: the best of each body and coordinate."""
        seen: set[tuple[str, str]] = set()
        for law in laws.all():
            if (which := (body_of(law.closure.target), law.closure.coordinate)) in seen:
                continue
            seen.add(which)
            cases: list[tuple[Law, tuple[Template, ...], tuple[float, ...]]] = [(law, (), ())]
            for beside_it, t, amount in laws.with_effects(law, [t.linear for t in found]) if found else ():
                if found[t].value(amount) is not None:
                    cases.append((beside_it, (found[t],), (amount,)))
            for one, beside, amounts in cases:
                self._offer(e, beside, amounts, one, step=one.step, gain=one.log_bayes_factor, decrease=one.decrease)

    def _offer(
        self, parent: Explanation, added: tuple[Template, ...], amounts: tuple[float, ...], law: Law | None = None,
        *, step: Array, gain: float, decrease: float,
    ) -> None:  # fmt: skip
        """Keep an addition if it makes an explanation that was not fitted, and none of a better parent makes it."""

        def rank(one: Addition) -> tuple[float, float]:
            return one.parent.log_z, one.log_posterior

        count, closure = len(parent.parts.effects) + len(added), law.closure if law else parent.parts.law
        a = Addition(
            parent=parent, templates=added, amounts=amounts, law=law, step=step, gain=gain, decrease=decrease,
            log_prior=log_prior(count, len(self.library), closure),
        )  # fmt: skip
        before = self._linear.get((parent.key, a.key))
        if before is None or a.gain > before.gain or before.parent is not parent:
            self._linear[parent.key, a.key] = a
        known = self.possible.get(a.key)
        # The more its parent explains, the less is left to the linear model
        if a.key not in self.fitted and (known is None or rank(a) > rank(known)):
            self.possible[a.key] = a

    def _promising(self) -> list[Addition]:
        """Return what is fitted next: what may come near the best, the most probable first."""
        limit = self.best.log_posterior - MARGIN
        least = min(self.best.fit.problem.count, *(e.fit.cost for e in self.fitted.values()))
        found = []
        for a in self.possible.values():
            # Beside what is settled only the linear model there counts
            is_said_nearer = a.parent.key < self.best.key < a.key and self.settled
            if self._is_usable(a.parent) and not is_said_nearer:
                log_posterior, slack = self._expected(a, least)
                if log_posterior + slack > limit and log_posterior + slack > self._best_part(a.key):
                    found.append((log_posterior, a))
        found += [(math.inf, a) for a in self._untried()]
        chosen: dict[Key, Addition] = {}
        for _, a in sorted(found, key=lambda one: -one[0]):
            # First a part of it: more parts may only make up for what the linear model does not show of one
            first, smaller = a, [a.key - {part} for part in a.key]
            if not any(key in self.fitted for key in smaller):
                parts = (self.possible[key] for key in smaller if key in self.possible)
                first = max(parts, key=lambda b: b.log_posterior, default=a)
            if len(chosen) < MAX_TOGETHER and not any(key < first.key for key in chosen):
                chosen.setdefault(first.key, first)
        return list(chosen.values())

    def _best_part(self, key: Key) -> float:
        """Return the log posterior of the best part of an explanation: what adds nothing to it is no explanation of its own."""
        parts = [frozenset(part) for size in range(len(key)) for part in combinations(key, size)]
        known = (of[part].log_posterior for of in (self.fitted, self.possible) for part in parts if part in of)
        return max(known, default=-math.inf)

    def _untried(self) -> list[Addition]:
        """Return the listed effects that are fitted whatever the linear model says: it shows too little of some.

        One, so that nothing is said without a runner-up; more before a law is named, since no library may list that.
        """
        tried = sum(len(e.key) == 1 and not e.parts.law for e in self.fitted.values())
        singles = [a for a in self.possible.values() if len(a.key) == 1 and not a.law]
        left = LEAST_TRIED[self.best.parts.law is not None] - tried
        return sorted(singles, key=lambda a: -a.log_posterior)[: max(left, 0)]

    def _is_usable(self, parent: Explanation) -> bool:
        """Return whether a linear model beside an explanation says enough of what is near the best.

        Beside a parent that leaves much more unexplained than the best does, it does so only for a part in another one's place.
        """
        best = self.best
        return best.log_z - parent.log_z < 4 * LARGE_MISFIT or (parent.key < best.key and len(parent.key) == len(best.key) - 1)

    def _start_of(self, a: Addition) -> Explanation:
        """Return the most probable explanation between an addition's parent and what it makes that was fitted exactly."""
        between = [e for key, e in self.fitted.items() if key < a.key and (a.parent.key, key) in self._linear]
        return max([a.parent, *between], key=lambda e: e.log_z)

    def _expected(self, a: Addition, least: float) -> tuple[float, float]:
        """Return the log posterior that an addition leads to, and by how much more it may be.

        Where a part of what is added was fitted exactly, it starts there. The linear model may be wrong by a share of what
        there is to be explained, or by as much as it was where exact fits have shown it; but no fit is expected to leave less
        than noise does, or than the best fit: a cost of ``least``.
        """
        start = self._start_of(a)
        log_z, cost, gain = a.parent.log_z, a.parent.fit.cost - a.decrease, a.gain
        if start is not a.parent:
            known = self._linear[a.parent.key, start.key]
            log_z, gain = start.log_z, a.gain - known.gain
            cost = start.fit.cost - (a.decrease - known.decrease)
        missing = max(self.best.log_z - log_z, gain, 0.0)
        slack = min(LINEAR_ERROR * missing**2 / (missing + LARGE_MISFIT), 1.0 + max(0.5 * (cost - least), 0.0))
        errors = self._errors.get((start.key, a.law is not None), [])
        if len(errors) >= MIN_KNOWN_ERRORS:
            least_wrong = max(errors)
            slack = min(slack, 1.0 + least_wrong * (1 + math.copysign(LINEAR_ERROR, least_wrong)))
        return log_z + gain + a.log_prior, slack


def posterior(fitted: Mapping[Key, Explanation]) -> list[tuple[Key, float]]:
    """Return the probability of every explanation, the most probable first.

    One that adds something to another and is less probable than that counts as a part of it: what it adds is too small to be
    seen.
    """
    logs = {key: e.log_posterior for key, e in fitted.items()}
    top = max(logs.values())
    p = {key: math.exp(log - top) for key, log in logs.items()}
    for key in sorted(p, key=lambda k: (-len(k), p[k])):
        within = [k for k in p if k < key and p[k] >= p[key]]
        if within:
            p[max(within, key=lambda k: p[k])] += p.pop(key)
    total = sum(p.values())
    return sorted(((key, v / total) for key, v in p.items()), key=lambda one: -one[1])


def in_words(key: Key) -> str:
    """Return what an explanation adds, in words."""
    return " + ".join(sorted(key)) or "nothing"


def _impossible(m: Marginal, found: Sequence[Template]) -> list[Candidate]:
    """Return candidates whose value is known to be within bounds, and that would explain most beyond these."""
    held = {t.candidate.name: t.candidate for t in found if t.candidate.bounds_reason}
    s = m.complement[0]
    square = np.maximum(np.diag(s)[1:], 1e-12)
    within, beyond = dict.fromkeys(held, VISIBLE), dict.fromkeys(held, 0.0)
    for t, z, amount in zip(found, s[0, 1:] / np.sqrt(square), s[0, 1:] / square, strict=True):
        if t.candidate.name in held:
            best = beyond if t.value(float(amount)) is None else within
            best[t.candidate.name] = max(best[t.candidate.name], abs(float(z)))
    return [c for name, c in held.items() if beyond[name] > within[name]]


def _additions(
    m: Marginal, found: Sequence[Template], *, pairs: bool
) -> list[tuple[tuple[int, ...], float, tuple[float, ...]]]:
    """Return (indices, gain of log evidence, amounts) of each candidate's best template, and of each pair of candidates."""
    if not found:
        return []
    s, base, names = m.complement, m.log_z_of_settings[:, None], [t.candidate.name for t in found]
    square = np.maximum(np.einsum("gii->gi", s)[:, 1:], 1e-12)
    z = s[:, 0, 1:] / np.sqrt(square)
    gain = np.logaddexp.reduce(base + 0.5 * z**2 + log_occam(z), axis=0) - m.log_z
    amounts = s[0, 0, 1:] / square[0]
    best: dict[tuple[str, ...], tuple[tuple[int, ...], float, tuple[float, ...]]] = {}
    for i in np.argsort(-gain).tolist():
        if (names[i],) not in best and found[i].value(float(amounts[i])) is not None:
            best[names[i],] = (i,), float(gain[i]), (float(amounts[i]),)
    if not pairs:
        return list(best.values())
    i, j = np.triu_indices(len(found), 1)
    of_candidate = np.unique(names, return_inverse=True)[1]
    i, j = (a[of_candidate[i] != of_candidate[j]] for a in (i, j))
    aa, bb, ab = s[:, 1 + i, 1 + i], s[:, 1 + j, 1 + j], s[:, 1 + i, 1 + j]
    along = s[:, 0, 1 + i], s[:, 0, 1 + j]
    determinant = np.maximum(aa * bb - ab**2, 1e-9 * aa * bb + 1e-30)
    x = (bb * along[0] - ab * along[1]) / determinant, (aa * along[1] - ab * along[0]) / determinant
    widths = np.sqrt(bb / determinant), np.sqrt(aa / determinant)
    # The widths are those of each amount by itself; both together have less room by their correlation
    together_ = 0.5 * np.log(determinant / np.maximum(aa * bb, 1e-30))
    log_bf = 0.5 * (x[0] * along[0] + x[1] * along[1]) + log_occam(x[0] / widths[0]) + log_occam(x[1] / widths[1]) + together_
    gain = np.logaddexp.reduce(base + log_bf, axis=0) - m.log_z
    for k in np.argsort(-gain).tolist():
        pair, values = (names[i[k]], names[j[k]]), (float(x[0][0, k]), float(x[1][0, k]))
        if pair not in best and found[i[k]].value(values[0]) is not None and found[j[k]].value(values[1]) is not None:
            best[pair] = (int(i[k]), int(j[k])), float(gain[k]), values
    return list(best.values())
