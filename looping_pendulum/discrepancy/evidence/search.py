"""Search among explanations: a linear model says where exact fits begin, and their evidence decides."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
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
from looping_pendulum.discrepancy.evidence.laws import Law, laws_beside
from looping_pendulum.discrepancy.evidence.marginal import Marginal, NoiseGrid
from looping_pendulum.discrepancy.evidence.prior import (
    BEAM,
    LINEAR_ERROR,
    MARGIN,
    MAX_EFFECTS,
    VISIBLE,
    log_occam,
    log_prior,
)
from looping_pendulum.discrepancy.evidence.templates import Case, Template, columns, smallest_visible, templates
from looping_pendulum.discrepancy.fit.calibration import Fit
from looping_pendulum.discrepancy.fit.residual import ResidualTests, check_residuals
from looping_pendulum.discrepancy.fit.residual_noise import data_with_noise_of_residuals
from looping_pendulum.discrepancy.result import SmallestVisible
from looping_pendulum.reference_ode.geometry import Array

MAX_SETTINGS = 5
"""Settings of the noise by which explanations are compared at first: white, and the most probable ones of the best so far."""

FAR = 50.0
"""Log posterior below the best so far from which on no other settings are looked at: they may add half of that distance."""
SETTINGS_OF_LAWS = 2
"""How many of these laws are looked at by, where their fits begin."""


class OutOfTime(Exception):
    """Raised within the search where its time is over."""


class Search:
    """Explanations of a study that were fitted exactly.

    Parameters
    ----------
    base
        Fit of the declared model to all trials, with white noise.
    library
        Listed effects that may be missing.
    report
        Called with a description of each step that begins.
    is_time_over
        Asked before each fit whether to end.
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
        self.ruled_out: list[Candidate] = []
        """Listed effects that would explain much with a value that is known to be impossible."""
        self.tried: set[Key] = {NOTHING}
        """What was added in any exact fit, those that were given up as needless or could not run included."""
        self._expanded: set[Key] = set()
        self._dropped: set[tuple[Key, str]] = set()
        """What was added, and the part that was dropped again."""
        self._at_most: dict[Key, tuple[float, float]] = {}
        """What is made -> the log evidence of the best parent by whose linear model it was looked at, and its log posterior at
        most."""
        self._templates: dict[Key, list[Template]] = {}
        self._finite: dict[Case, list[Template]] = {}
        self._tested: dict[Key, tuple[Fit, ResidualTests]] = {}
        self._settings: Sequence[int] | None = None
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
        try:
            self._go_on()
            if not self.passes(self.best):
                # Once more, from other starts: where none is right, a fit may have gone astray
                for e in sorted((e for e in self.fitted.values() if e.key), key=lambda e: -e.log_posterior)[:BEAM]:
                    self._refuse_if_time_is_over()
                    fit = fit_again(e)
                    if fit is not None:
                        self._add(fit, e.parts)
                self._go_on()
            if self.best.key != NOTHING:  # whose noise is known
                self._with_noise_of(self.best)
                self._go_on()
        except OutOfTime:
            return False
        # What may be said, by all settings of the noise
        for e in (*self._near_best(), self.fitted[NOTHING]):
            self.fitted[e.key] = explained(self.grid, e.fit, e.parts, len(self.library))
        return True

    def _refuse_if_time_is_over(self) -> None:
        if self._is_time_over():
            raise OutOfTime

    def _go_on(self) -> None:
        """Add to what is near the best whatever may come near it, until nothing new is."""
        while True:
            self._fit_without_parts()
            new = [e for e in self._near() if e.key not in self._expanded]
            if not new:
                return
            self._expand(max(new, key=lambda e: e.log_posterior))

    def _add(self, fit: Fit, parts: Parts) -> Explanation:
        """Keep an explanation unless a better fit of it is known; return it."""
        e = explained(self.grid, fit, parts, len(self.library), self._settings)
        # Which lasting noise hides a misfit best, depends on the misfit
        if e.setting and self._settings is not None and e.log_posterior > self.best.log_posterior - FAR:
            e = explained(self.grid, fit, parts, len(self.library))
        known = self.fitted.get(e.key)
        if known is None or e.log_posterior > known.log_posterior:
            self.fitted[e.key] = e
            self._tested.pop(e.key, None)
        if e is self.best:
            self._settings = list(dict.fromkeys(i for one in (e, self.fitted[NOTHING]) for i in _likely_settings(one)))
        return e

    def _is_needless(self, e: Explanation) -> bool:
        """Return whether a part of an explanation is as probable as the whole."""
        return any(key < e.key and part.log_posterior >= e.log_posterior for key, part in self.fitted.items())

    def _near_best(self) -> list[Explanation]:
        limit = self.best.log_posterior - MARGIN
        return [e for e in self.fitted.values() if e.log_posterior > limit and not self._is_needless(e)]

    def _near(self) -> list[Explanation]:
        """Return the explanations to which more is added: those near the best, and the best of each kind.

        Of a kind with fewer parts than the best has, once that is settled, only those that were hardly worse than the one to
        which it adds something; while it leaves a misfit, of every kind.
        """
        near, best, is_settled = self._near_best(), self.best, self.settled
        for of_kind in self._by_kind().values():
            if not is_settled or len(of_kind[0].key) < len(best.key):
                limit = of_kind[0].log_posterior - MARGIN if is_settled else -math.inf
                near += [e for e in of_kind[:BEAM] if e.log_posterior > limit]
        return near

    def _by_kind(self) -> dict[tuple[int, bool], list[Explanation]]:
        """Return the explanations of each kind, the most probable first, without what is needless."""
        kinds: dict[tuple[int, bool], list[Explanation]] = {}
        for e in sorted(self.fitted.values(), key=lambda e: -e.log_posterior):
            if not self._is_needless(e):
                kinds.setdefault(kind(e.parts), []).append(e)
        return kinds

    def _fit_without_parts(self) -> None:
        """Fit what the explanations near the best leave if one of their parts is dropped, begun where they are.

        Where a misfit is large, a part alone may have ended in another minimum.
        """
        for e in self._near_best():
            for part in sorted(e.key):
                if (e.key, part) not in self._dropped:
                    self._dropped.add((e.key, part))
                    self._refuse_if_time_is_over()
                    fit = fit_without(e, part)
                    if fit is not None:
                        self._add(fit, e.parts.without(part))

    def _with_noise_of(self, best: Explanation) -> None:
        """Estimate the noise and the outliers beside the best explanation, and fit all that are near it again with these."""
        data = [data_with_noise_of_residuals(best.fit, k) for k in range(len(best.fit.problem.data))]
        limit = best.log_posterior - 2 * MARGIN
        near = {e.key for e in self.fitted.values() if e.log_posterior > limit and not self._is_needless(e)}
        # What they add to, and the best of each kind
        near |= {key for key in self.fitted for whole in near if key < whole}
        near |= {e.key for of_kind in self._by_kind().values() for e in of_kind[:BEAM]}
        kept = [e for e in self.fitted.values() if e.key in near]
        self._expanded -= {e.key for e in self._near_best()}
        self.grid, self._settings = NoiseGrid(data), None
        self.fitted.clear()
        self._tested.clear()
        self._at_most.clear()
        for e in sorted(kept, key=lambda e: len(e.key)):  # nothing first
            fit = fit_to_data(e.fit, data)
            if fit is not None:
                self._add(fit, e.parts)

    def _expand(self, e: Explanation) -> None:
        """Add to an explanation each effect, each law, and each pair of effects beside nothing, and fit what may matter."""
        self.report(f"looking beside {in_words(e.key)}")
        self._expanded.add(e.key)
        self._refuse_if_time_is_over()
        count = len(e.parts.effects)
        found = self._templates_beside(e) if count < (1 if e.parts.law else MAX_EFFECTS) else []
        fitted = raw(e.fit)
        m = Marginal(self.grid, fitted, columns(found, self.grid.count), bounded(e.fit), _likely_settings(e))
        if e.key == NOTHING:
            self.ruled_out = _impossible(m, found)
        added = self._of_effects(e, m, found, _best_of_each(m, found))
        # A second law is not looked for, nor one beside two effects
        if e.parts.law is None and count <= 1:
            some = slice(SETTINGS_OF_LAWS)
            laws = laws_beside(e.fit, self.grid, m.settings[some].tolist(), m.log_z_of_settings[some], fitted)
            for law in laws.all() if laws else ():
                gain = law.log_bayes_factor
                added.append(self._addition(e, (), (), law, step=law.step, gain=gain, decrease=law.decrease))
        self._fit_what_may_matter(added)
        # Where one effect shows, others are added to it; two may show together of which neither does alone
        if self.best.key == NOTHING == e.key:
            self._fit_what_may_matter(self._of_effects(e, m, found, _best_of_each_pair(m, found)))

    def _fit_what_may_matter(self, added: Sequence[Addition]) -> None:
        """Fit additions, effects first and the best first: the fit of one that cannot come near the best ends early."""
        for a in sorted(added, key=lambda a: (a.law is not None, -a.log_posterior)):
            if a.key not in self.fitted and self._may_matter(a):
                self._refuse_if_time_is_over()
                self.tried.add(a.key)
                fit = fit_addition(a, self._needless_below(a))
                if fit is not None:
                    self._add(*fit)

    def _of_effects(
        self, parent: Explanation, m: Marginal, found: Sequence[Template], chosen: Iterable[_Chosen]
    ) -> list[Addition]:
        """Return additions of effects."""
        additions = []
        for indices, gain, amounts in chosen:
            step, _ = m.solution(indices)
            of = tuple(found[i] for i in indices)
            additions.append(self._addition(parent, of, amounts, step=step, gain=gain, decrease=m.decrease(indices)))
        return additions

    def _needless_below(self, a: Addition) -> float:
        """Return the log posterior with which neither a verdict needs an addition, nor is anything added to it."""
        # With noise that lasts longer than a frame a misfit is no measure of the evidence
        if self.best.setting:
            return -math.inf
        of_kind = sorted((e.log_posterior for e in self.fitted.values() if kind(e.parts) == kind(a.parts)), reverse=True)
        return min(self.best.log_posterior - 2 * MARGIN, of_kind[BEAM - 1] if len(of_kind) >= BEAM else -math.inf)

    def _addition(
        self, parent: Explanation, added: tuple[Template, ...], amounts: tuple[float, ...], law: Law | None = None,
        *, step: Array, gain: float, decrease: float,
    ) -> Addition:  # fmt: skip
        count, closure = len(parent.parts.effects) + len(added), law.closure if law else parent.parts.law
        return Addition(
            parent=parent, templates=added, amounts=amounts, law=law, step=step, gain=gain, decrease=decrease,
            log_prior=log_prior(count, len(self.library), closure),
        )  # fmt: skip

    def _may_matter(self, a: Addition) -> bool:
        """Return whether an addition is fitted exactly: others than single effects if they may come near the best.

        The linear model may be wrong by a share of what there is to be explained, and says nothing of an effect that has no
        derivative. What is then no better than a part of it, is needless.
        """
        is_finite = len(a.templates) == 1 and a.templates[0].finite
        if a.parts.law is None and (len(a.key) == 1 or (is_finite and not self.settled)):
            return True
        missing = max(self.best.log_z - a.parent.log_z, a.gain, 0.0)
        # The more its parent explains, the less is left to the linear model
        said = max(self._at_most.get(a.key, (-math.inf, 0.0)), (a.parent.log_z, a.log_posterior + LINEAR_ERROR * missing))
        self._at_most[a.key] = said
        parts = [frozenset(part) for size in range(len(a.key)) for part in combinations(a.key, size)]
        best_part = max((self.fitted[part].log_posterior for part in parts if part in self.fitted), default=-math.inf)
        return said[1] > max(self.best.log_posterior - MARGIN, best_part)

    def _templates_beside(self, e: Explanation) -> list[Template]:
        """Return the templates of the effects that may be added; finite changes are those beside nothing."""
        if e.key not in self._templates:
            others = [c for c in self.library if c not in e.parts.effects]
            self._templates[e.key] = templates(e.fit, others, self._finite)
        return self._templates[e.key]


def posterior(fitted: Mapping[Key, Explanation]) -> list[tuple[Key, float]]:
    """Return the probability of every explanation, the most probable first.

    One that adds something to another and is less probable than that counts as a part of it: what it adds is too small to be
    seen.
    """
    logs = {key: e.log_posterior for key, e in fitted.items()}
    top = max(logs.values())
    p = {key: math.exp(log - top) for key, log in logs.items()}
    for key in sorted(p, key=lambda k: -len(k)):
        # By what each has of its own: with what it takes in, the least of them would in the end take in all
        within = [k for k in p if k < key and logs[k] >= logs[key]]
        if within:
            p[max(within, key=lambda k: logs[k])] += p.pop(key)
    total = sum(p.values())
    return sorted(((key, v / total) for key, v in p.items()), key=lambda one: -one[1])


def _likely_settings(e: Explanation) -> list[int]:
    """Return white noise and the most probable other settings of an explanation."""
    return [0, *(i for i in e.settings if i)][:MAX_SETTINGS]


def kind(parts: Parts) -> tuple[int, bool]:
    """Return how many effects an explanation adds, and whether it adds a law."""
    return len(parts.effects), parts.law is not None


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


_Chosen = tuple[tuple[int, ...], float, tuple[float, ...]]
"""Indices of templates, gain of log evidence by them, and their amounts."""


def _best_of_each(m: Marginal, found: Sequence[Template]) -> list[_Chosen]:
    """Return the best template of each candidate."""
    if not found:
        return []
    s, base, sizes = m.complement, m.log_z_of_settings[:, None], np.array([t.stated_size for t in found])
    square = np.maximum(np.einsum("gii->gi", s)[:, 1:], 1e-12)
    z = s[:, 0, 1:] / np.sqrt(square)
    gain = np.logaddexp.reduce(base + 0.5 * z**2 + log_occam(z, sizes / np.sqrt(square)), axis=0) - m.log_z
    amounts = s[0, 0, 1:] / square[0]
    best: dict[str, _Chosen] = {}
    for i in np.argsort(-gain).tolist():
        name = found[i].candidate.name
        if name not in best and found[i].value(float(amounts[i])) is not None:
            best[name] = (i,), float(gain[i]), (float(amounts[i]),)
    return list(best.values())


def _best_of_each_pair(m: Marginal, found: Sequence[Template]) -> list[_Chosen]:
    """Return the best templates of each pair of candidates."""
    s, base, names = m.complement, m.log_z_of_settings[:, None], [t.candidate.name for t in found]
    sizes = np.array([t.stated_size for t in found])
    i, j = np.triu_indices(len(found), 1)
    of_candidate = np.unique(names, return_inverse=True)[1]
    i, j = (a[of_candidate[i] != of_candidate[j]] for a in (i, j))
    aa, bb, ab = s[:, 1 + i, 1 + i], s[:, 1 + j, 1 + j], s[:, 1 + i, 1 + j]
    along = s[:, 0, 1 + i], s[:, 0, 1 + j]
    determinant = np.maximum(aa * bb - ab**2, 1e-9 * aa * bb + 1e-30)
    x = (bb * along[0] - ab * along[1]) / determinant, (aa * along[1] - ab * along[0]) / determinant
    widths = np.sqrt(bb / determinant), np.sqrt(aa / determinant)
    # The widths are those of each amount by itself; both together have less room by their correlation
    together = 0.5 * np.log(determinant / np.maximum(aa * bb, 1e-30))
    occam = sum(log_occam(x[k] / widths[k], sizes[(i, j)[k]] * widths[k]) for k in (0, 1))
    log_bf = 0.5 * (x[0] * along[0] + x[1] * along[1]) + occam + together
    gain = np.logaddexp.reduce(base + log_bf, axis=0) - m.log_z
    best: dict[tuple[str, str], _Chosen] = {}
    for k in np.argsort(-gain).tolist():
        pair, values = (names[i[k]], names[j[k]]), (float(x[0][0, k]), float(x[1][0, k]))
        if pair not in best and found[i[k]].value(values[0]) is not None and found[j[k]].value(values[1]) is not None:
            best[pair] = (int(i[k]), int(j[k])), float(gain[k]), values
    return list(best.values())
