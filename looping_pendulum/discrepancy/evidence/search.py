"""Search among explanations: a linear model says where exact fits begin, and their evidence decides."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.discrepancy.candidates import Candidate
from looping_pendulum.discrepancy.evidence.explanation import (
    NOTHING,
    Addition,
    Explanation,
    Key,
    Parts,
    explained,
    fit_addition,
    fit_again_at,
    fit_to_data,
    fit_without,
    raw,
    with_best_prior,
)
from looping_pendulum.discrepancy.evidence.laws import laws_beside
from looping_pendulum.discrepancy.evidence.marginal import Marginal, NoiseGrid
from looping_pendulum.discrepancy.evidence.prior import BEAM, LINEAR_ERROR, MARGIN, MAX_EFFECTS, VISIBLE, log_occam
from looping_pendulum.discrepancy.evidence.templates import (
    Case,
    SmallestVisible,
    Template,
    columns,
    smallest_visible,
    templates,
)
from looping_pendulum.discrepancy.fit.calibration import Fit
from looping_pendulum.discrepancy.fit.problem import refuse_if_time_is_over
from looping_pendulum.discrepancy.fit.residual import ResidualTests, check_residuals
from looping_pendulum.discrepancy.fit.residual_noise import data_with_noise_of_residuals
from looping_pendulum.reference_ode.geometry import Array


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
    report_fit
        Called with a description of each fit that begins, of which a step may have hundreds.
    """

    def __init__(
        self,
        base: Fit,
        library: Sequence[Candidate],
        report: Callable[[str], None] = lambda what: None,
        report_fit: Callable[[str], None] = lambda what: None,
    ) -> None:
        self.library, self.report, self.report_fit = tuple(library), report, report_fit
        self.grid = NoiseGrid(base.problem.data)
        self.fitted: dict[Key, Explanation] = {}
        """What an explanation adds -> the explanation, of all that were fitted exactly."""
        self.ruled_out: list[Candidate] = []
        """Listed effects that would explain much with a value that is known to be impossible."""
        self.tried: set[Key] = {NOTHING}
        """What was added in any exact fit, those that could not run included."""
        self._expanded: set[Key] = set()
        self._fitted_again: set[tuple[Key, str]] = set()
        """What was added, and the part that was dropped again, or got other shapes."""
        self.proposed: dict[Key, tuple[float, float]] = {}
        """What is made -> the log evidence of the best parent by whose linear model it was looked at, and its log posterior at
        most."""
        self._templates: dict[Key, list[Template]] = {}
        self._finite: dict[Case, list[Template]] = {}
        self._tested: dict[Key, tuple[Fit, ResidualTests]] = {}
        self._add(base, Parts())

    @property
    def best(self) -> Explanation:
        """The most probable explanation."""
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
        m = Marginal(self.grid, raw(e.fit), columns(found, self.grid.count), e.fit.at_bounds, [e.setting])
        return smallest_visible(e.fit, found, m.complement[0])

    def leaves_a_misfit(self, e: Explanation) -> bool:
        """Return whether it fails the test by white noise: noise that lasts longer than a frame passes too easily."""
        return bool(e.setting) or not self.passes(e)

    @property
    def settled(self) -> bool:
        """Whether the best explanation leaves no misfit, and has no law: one of any form passes too easily."""
        return not self.best.parts.law and not self.leaves_a_misfit(self.best)

    def run(self) -> None:
        """Fit explanations until no other comes near the best."""
        self._go_on()
        if self.best.key != NOTHING:  # whose noise is known
            self._with_noise_of(self.best)
            self._go_on()
        for e in self._near_best():
            self.fitted[e.key] = explained(self.grid, e.fit, e.parts, len(self.library))
            self._tested.pop(e.key, None)

    def _go_on(self) -> None:
        """Add to what is near the best whatever may come near it, until nothing new is."""
        while True:
            self._fit_again()
            new = [e for e in self._worth_expanding() if e.key not in self._expanded]
            if not new:
                return
            self._expand(max(new, key=lambda e: e.log_posterior))

    def _add(self, fit: Fit, parts: Parts) -> None:
        """Keep an explanation unless a better fit of it is known."""
        # Those settings alone that matter so far: all of them, for what may be said in the end
        settings = sorted({0, self.best.setting, self.fitted[NOTHING].setting}) if self.fitted else None
        e = explained(self.grid, *with_best_prior(fit, parts), len(self.library), settings)
        known = self.fitted.get(e.key)
        if known is None or e.log_posterior > known.log_posterior:
            self.fitted[e.key] = e
            self._tested.pop(e.key, None)

    def _needed(self) -> list[Explanation]:
        """Return the explanations of which no part is as probable as the whole, the most probable first."""
        fitted = self.fitted.items()
        return [
            e
            for e in sorted(self.fitted.values(), key=lambda e: -e.log_posterior)
            if not any(key < e.key and part.log_posterior >= e.log_posterior for key, part in fitted)
        ]

    def _near_best(self, margin: float = MARGIN) -> list[Explanation]:
        limit = self.best.log_posterior - margin
        return [e for e in self._needed() if e.log_posterior > limit]

    def _by_kind(self) -> list[list[Explanation]]:
        """Return the needed explanations of each kind, by their number of effects and whether they have a law."""
        kinds: dict[tuple[int, bool], list[Explanation]] = {}
        for e in self._needed():
            kinds.setdefault(e.parts.kind, []).append(e)
        return list(kinds.values())

    def _worth_expanding(self) -> list[Explanation]:
        """Return the explanations to which more is added: those near the best, every part of these, and others.

        These are of each kind with fewer parts what explains as much as the best of the kind; while the best of all leaves a
        misfit, of every kind the best, and what leaves least by white noise as well.
        """
        found, best, is_settled = self._near_best(), self.best, self.settled
        found += [e for key, e in self.fitted.items() if any(key < near.key for near in found)]
        for of_kind in self._by_kind():
            if not is_settled:
                # Errors that last longer than a frame take in what is still missing, so that what is left counts as well
                found += [*of_kind[:BEAM], *sorted(of_kind, key=lambda e: e.fit.cost)[:BEAM]]
            elif len(of_kind[0].key) < len(best.key):
                found += [e for e in of_kind[:BEAM] if e.log_posterior > of_kind[0].log_posterior - MARGIN]
        return found

    def _fit_again(self) -> None:
        """Fit what is near the best again: without each of its parts, begun where it is, and from other shapes of each.

        Where a misfit is large, a part alone may have ended in another minimum, as may what has an effect with a shape.
        """
        for e in self._near_best():
            for part in sorted(e.key):
                if (e.key, part) in self._fitted_again:
                    continue
                self._fitted_again.add((e.key, part))
                refuse_if_time_is_over()
                self.report_fit(f"fitting {in_words(e.key)} without {part}")
                if fit := fit_without(e, part):
                    self._add(fit, e.parts.without(part))
                for shape in e.parts.shapes_of(part):
                    self.report_fit(f"fitting {in_words(e.key)} from another shape of {part}")
                    if fit := fit_again_at(e.fit, shape):
                        self._add(fit, e.parts)

    def _with_noise_of(self, best: Explanation) -> None:
        """Estimate the noise and the outliers beside the best explanation, and fit all that are near it again with these."""
        data = [data_with_noise_of_residuals(best.fit, k) for k in range(len(best.fit.problem.data))]
        near = {e.key for e in self._near_best(2 * MARGIN)}
        # What they add to, and the best of each kind
        near |= {key for key in self.fitted for whole in near if key < whole}
        near |= {e.key for of_kind in self._by_kind() for e in of_kind[:BEAM]}
        kept = [e for e in self.fitted.values() if e.key in near]
        self._expanded -= {e.key for e in self._near_best()}
        before = self.grid, self.fitted
        self.grid, self.fitted = NoiseGrid(data), {}
        self._tested.clear()
        self.proposed.clear()
        try:
            for e in sorted(kept, key=lambda e: len(e.key)):  # nothing first
                if fit := fit_to_data(e.fit, data):
                    self._add(fit, e.parts)
        except KeyboardInterrupt:  # what has another noise cannot be compared
            self.grid, self.fitted = before
            self._tested.clear()
            raise

    def _expand(self, e: Explanation) -> None:
        """Add to an explanation each effect, each law, and each pair of effects beside nothing, and fit what may matter."""
        self.report(f"looking beside {in_words(e.key)}")
        self._expanded.add(e.key)
        refuse_if_time_is_over()
        count = len(e.parts.effects)
        found = self._templates_beside(e) if count < (1 if e.parts.law else MAX_EFFECTS) else []
        # Errors that last longer than a frame can hide what would explain the data by white noise
        fitted, settings = raw(e.fit), sorted({0, e.setting})
        m = Marginal(self.grid, fitted, columns(found, self.grid.count), e.fit.at_bounds, settings)
        if e.key == NOTHING:
            self.ruled_out = _impossible(m, found)
        added = self._of_effects(e, m, found, 1)
        # A second law is not looked for, nor one beside two effects
        if e.parts.law is None and count <= 1:
            for setting, log_z in zip(settings, m.log_z_of_settings.tolist(), strict=True):
                added += self._of_laws(e, setting, fitted, log_z - m.log_z)
        self._fit_what_may_matter(added)
        # Where one effect shows, others are added to it; two may show together of which neither does alone
        if self.best.key == NOTHING == e.key:
            self._fit_what_may_matter(self._of_effects(e, m, found, 2))

    def _fit_what_may_matter(self, added: Sequence[Addition]) -> None:
        """Fit additions, effects first and the best first."""
        for a in sorted(added, key=lambda a: (a.law is not None, -a.log_posterior)):
            if a.key not in self.fitted and self._may_matter(a):
                refuse_if_time_is_over()
                self.tried.add(a.key)
                self.report_fit(f"fitting {in_words(a.key)}")
                if fit := fit_addition(a, self._needless_below(a)):
                    self._add(fit, a.parts)
                    # An effect with a shape has several minima: from where the best has it, too
                    for shaped in [t.candidate.name for t in a.templates if t.companions and t.candidate.name in self.best.key]:
                        at = {name: self.best.fit.values[name] for name in a.parts.parameters_of(shaped)}
                        if again := fit_again_at(fit, at):
                            self._add(again, a.parts)

    def _needless_below(self, a: Addition) -> float:
        """Return the log posterior with which neither a verdict needs an addition, nor is anything added to it."""
        of_kind = sorted(e.log_posterior for e in self.fitted.values() if e.parts.kind == a.parts.kind)
        # With noise that lasts longer than a frame a misfit is no measure of the evidence
        if self.best.setting or len(of_kind) < BEAM:
            return -math.inf
        return min(self.best.log_posterior - 2 * MARGIN, of_kind[-BEAM])

    def _of_effects(self, parent: Explanation, m: Marginal, found: Sequence[Template], size: int) -> list[Addition]:
        """Return the addition of each set of so many effects by those of their templates that gain most."""
        names = [t.candidate.name for t in found]
        sets = [chosen for chosen in combinations(range(len(found)), size) if len({names[i] for i in chosen}) == size]
        if not sets:
            return []
        amounts, gain = _amounts_and_gain(m, np.array(sets), np.array([t.stated_size for t in found]))
        best: dict[tuple[str, ...], Addition] = {}
        for k in np.argsort(-gain).tolist():
            chosen, key = [found[i] for i in sets[k]], tuple(names[i] for i in sets[k])
            of_chosen = tuple(amounts[k].tolist())
            if key not in best and all(t.value(v) is not None for t, v in zip(chosen, of_chosen, strict=True)):
                best[key] = Addition(
                    parent=parent, templates=tuple(chosen), amounts=of_chosen, step=m.step(sets[k]), gain=float(gain[k]),
                    decrease=m.decrease(sets[k]), library=len(self.library),
                )  # fmt: skip
        return list(best.values())

    def _of_laws(self, parent: Explanation, setting: int, fitted: Array, log_share: float) -> list[Addition]:
        """Return the additions of all laws, by a setting of the noise that has a share of the parent's evidence."""
        laws = laws_beside(parent.fit, self.grid, setting, fitted)
        return [
            Addition(
                parent=parent, law=law, step=law.step, gain=law.log_bayes_factor + log_share, decrease=law.decrease,
                library=len(self.library),
            )
            for law in (laws.all() if laws else ())
        ]  # fmt: skip

    def _may_matter(self, a: Addition) -> bool:
        """Return whether an addition is fitted exactly: others than single effects if they may come near the best.

        The linear model may be wrong by a share of what there is to be explained, and says nothing of an effect that has no
        derivative: that is fitted while the best one is not settled, or if that has it, beside what may replace its other
        parts. What is then no better than a part of it, is needless.
        """
        if a.parts.law is None and len(a.key) == 1:
            return True
        if len(a.templates) == 1 and (t := a.templates[0]).finite and (not self.settled or t.candidate.name in self.best.key):
            return True
        missing = max(self.best.log_z - a.parent.log_z, a.gain, 0.0)
        # The more its parent explains, the less is left to the linear model
        said = max(self.proposed.get(a.key, (-math.inf, 0.0)), (a.parent.log_z, a.log_posterior + LINEAR_ERROR * missing))
        self.proposed[a.key] = said
        best_part = max((e.log_posterior for key, e in self.fitted.items() if key < a.key), default=-math.inf)
        # That parent may be in another minimum, as a law is whose point lies elsewhere
        return max(said[1], a.log_posterior) > max(self.best.log_posterior - MARGIN, best_part)

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


def _amounts_and_gain(m: Marginal, sets: NDArray[np.intp], stated_sizes: Array) -> tuple[Array, Array]:
    """Return the amounts of the templates of each set by the first setting, shape (sets, size), and the gain of log evidence.

    Parameters
    ----------
    sets
        Indices of the templates of each set, shape (sets, size).
    stated_sizes
        `Template.stated_size` of each template.
    """
    along = m.complement[:, 0, 1 + sets]
    square = m.complement[:, 1 + sets[:, :, None], 1 + sets[:, None, :]]
    # The tiny summand keeps the matrix regular where templates do the same, or nothing
    square = square + np.eye(sets.shape[1]) * (1e-9 * np.einsum("gsii->gsi", square) + 1e-12)[..., None]
    inverse = np.linalg.inv(square)
    # No amount is known better than alone; where templates do nearly the same, rounding leaves the inverse less than that
    alone = 1 / np.maximum(np.einsum("gsii->gsi", square), 1e-12)
    amounts, widths = np.einsum("gsij,gsj->gsi", inverse, along), np.sqrt(np.maximum(np.einsum("gsii->gsi", inverse), alone))
    # The widths are those of each amount by itself; all together have less room by their correlation
    together = -0.5 * np.linalg.slogdet(square)[1] - np.sum(np.log(widths), axis=2)
    log_bf = np.sum(0.5 * amounts * along + log_occam(amounts / widths, stated_sizes[sets] * widths), axis=2) + together
    return amounts[0], np.logaddexp.reduce(m.log_z_of_settings[:, None] + log_bf, axis=0) - m.log_z
