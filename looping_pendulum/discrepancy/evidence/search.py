"""Search among explanations: a linear model says which are fitted next, all in step, and their exact evidence decides."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np
from scipy.special import logsumexp

from looping_pendulum.discrepancy.evidence.explanation import (
    Addition,
    Explanation,
    addition_steps,
    bounded,
    explained,
    law_name,
    raw,
    refit_steps,
    without_steps,
)
from looping_pendulum.discrepancy.evidence.laws import Law, laws_beside
from looping_pendulum.discrepancy.evidence.marginal import Marginal, NoiseGrid
from looping_pendulum.discrepancy.evidence.prior import (
    LARGE_MISFIT,
    LINEAR_ERROR,
    LOG_RANGE,
    MARGIN,
    MAX_EFFECTS,
    MAX_ROUNDS,
    MAX_TOGETHER,
    log_occam,
    log_prior,
)
from looping_pendulum.discrepancy.evidence.templates import Template, columns, templates
from looping_pendulum.discrepancy.fit.calibration import Fit
from looping_pendulum.discrepancy.fit.correlated_noise_fit import with_noises
from looping_pendulum.discrepancy.fit.predictions import Steps, alone, together
from looping_pendulum.discrepancy.fit.residual import check_residuals
from looping_pendulum.discrepancy.fit.residual_noise import data_with_noise_of_residuals
from looping_pendulum.discrepancy.inputs import Inputs
from looping_pendulum.discrepancy.listed.screening import steps_together
from looping_pendulum.discrepancy.workers import SERIAL, Workers
from looping_pendulum.reference_ode.geometry import Array

Key = frozenset[str]
NOTHING: Key = frozenset()


class Search:
    """Explanations of a study that were fitted exactly, and what a linear model says of others."""

    def __init__(self, inputs: Inputs, base: Fit, workers: Workers = SERIAL, log: Callable[[str], None] = lambda text: None) -> None:
        self.inputs, self.workers, self.log = inputs, workers, log
        self.grid = NoiseGrid(base.problem.data)
        self.fitted: dict[Key, Explanation] = {}
        self.possible: dict[Key, Addition] = {}
        """Best addition that makes an explanation which was not fitted yet."""
        self.linear: dict[tuple[Key, Key], Addition] = {}
        """(Parent, what is made) -> addition, of all that were looked at."""
        self.errors: dict[tuple[Key, bool], list[float]] = {}
        self.expanded: set[Key] = set()
        self.templates: list[Template] = []
        """Those beside nothing."""
        self.rounds = 0
        self._passes: dict[Key, bool] = {}
        self.add(self.explained(base))

    def explained(self, fit: Fit, of: Explanation | Addition | None = None) -> Explanation:
        """Return a fit as an explanation; ``of`` says what it adds."""
        if of is None:
            return explained(self.grid, fit, library=len(self.inputs.library))
        if isinstance(of, Explanation):
            mixed, effects, law = of.mixed, of.effects, of.law
        else:
            effects, law = of.parent.effects + tuple(t.candidate for t in of.templates), of.parent.law
            mixed = of.parent.mixed
            if of.law:
                law, mixed = of.law.closure, of.law.mixed
        return explained(self.grid, fit, effects, law, library=len(self.inputs.library), mixed=mixed)

    @property
    def best(self) -> Explanation:
        """Return the most probable explanation."""
        return max(self.fitted.values(), key=lambda e: e.log_posterior)

    def add(self, e: Explanation) -> None:
        """Keep an explanation, unless a better fit of it is known."""
        known = self.fitted.get(e.key)
        if known is None or e.log_posterior > known.log_posterior:
            self.fitted[e.key] = e
            self._passes.pop(e.key, None)
        self.log(f"  {name(e.key)}: log posterior {e.log_posterior:.1f}, cost {e.fit.cost:.0f}, noise {e.setting}")

    def passes(self, e: Explanation) -> bool:
        """Return whether the residuals of an explanation look like its own noise: the one absolute test."""
        if e.key not in self._passes:
            fit, noises = e.fit, self.grid.noises(e.setting)
            if noises:
                fit = alone(refit_steps(fit, fit.problem.with_data([with_noises(d, noises) for d in fit.problem.data]))) or fit
            tests = check_residuals(fit)
            # Errors of real marks are seldom as simple as such a process, so that a pattern stays beside the right effect, too
            self._passes[e.key] = tests.passes if not noises else tests.chi2_per_dof <= tests.limit
        return self._passes[e.key]

    @property
    def settled(self) -> bool:
        """Whether the best explanation has listed effects and white noise alone, and passes the test.

        A law of any form passes too easily, and so does noise that lasts longer than a frame.
        """
        return not self.best.law and not self.best.setting and self.passes(self.best)

    def run(self) -> None:
        """Fit explanations until no other comes near the best."""
        self.go_on()
        if self.best.key != NOTHING:  # whose noise it is
            self.with_noise_of(self.best)
            self.go_on()

    def go_on(self) -> None:
        """Look at what may be added to explanations near the best, and fit what may come near, in rounds."""
        for _ in range(MAX_ROUNDS):
            self.rounds += 1
            self.fit_subsets()
            for e in self.near():
                self.expand(e)
            chosen = self.promising()
            self.log(f" round {self.rounds}: {[name(a.key) for a in chosen]}")
            if not chosen:
                return
            expected = {}
            for a in chosen:
                expected[a.key] = self.expected(a, 0.0)[0], self.start_of(a).key
                del self.possible[a.key]
            for fit, a in self.fit_all([(addition_steps(a), a) for a in chosen]):
                e = self.explained(fit, a)
                self.errors.setdefault((expected[e.key][1], a.law is not None), []).append(e.log_posterior - expected[e.key][0])
                self.log(f"   expected {expected[e.key][0]:.1f}")
                self.add(e)

    def fit_all(self, steps: Sequence[tuple[Steps[Fit | None], object]]) -> list[tuple[Fit, object]]:
        """Take the steps of fits together; return those that can run, with what they are of."""
        found = together([s for s, _ in steps])
        return [(fit, of) for fit, (_, of) in zip(found, steps, strict=True) if fit is not None]

    def add_all(self, found: Sequence[Explanation]) -> None:
        """Keep explanations."""
        for e in found:
            self.add(e)

    def near(self) -> list[Explanation]:
        """Return the explanations whose neighbours are looked at next: those near the best, and what it adds something to.

        What it adds something to, with another part in its place, may be better still.
        """
        best = self.best
        near = [e for e in self.fitted.values() if e.log_posterior > best.log_posterior - MARGIN and not self.is_needless(e)]
        if not self.settled:
            near += [self.fitted[best.key - {part}] for part in best.key if best.key - {part} in self.fitted]
        return [e for e in dict.fromkeys(near) if e.key not in self.expanded]

    def fit_subsets(self) -> None:
        """Fit what the explanations near the best leave if one of their parts is dropped."""
        best, todo = self.best, {}
        for e in self.fitted.values():
            if e.log_posterior > best.log_posterior - MARGIN and not self.is_needless(e):
                for c in e.effects:
                    todo.setdefault(e.key - {c.name}, (e, tuple(k for k in e.effects if k is not c), e.law, (c.name, *(k.name for k in c.companions))))
                if e.law and e.effects:
                    names = (*e.law.point_coefficients, *e.law.names)
                    todo.setdefault(e.key - {law_name(e.law)}, (e, e.effects, None, names))
        steps = [(without_steps(e.fit, names), of) for key, (e, *of, names) in todo.items() if key not in self.fitted]
        for fit, (effects, law) in self.fit_all(steps):
            mixed = next(e.mixed for e, *of, _ in todo.values() if of == [effects, law]) if law else 0.0
            self.add(explained(self.grid, fit, effects, law, library=len(self.inputs.library), mixed=mixed))

    def is_needless(self, e: Explanation) -> bool:
        """Return whether a part of an explanation is more probable than the whole."""
        return any(k < e.key and part.log_posterior >= e.log_posterior for k, part in self.fitted.items())

    def expand(self, e: Explanation) -> None:
        """Look at what one more effect, a pair of them or a law would add to an explanation, by a linear model."""
        self.expanded.add(e.key)
        library = len(self.inputs.library)
        others = [c for c in self.inputs.library if c not in e.effects]
        fresh = not self.templates or e.log_z - self.fitted[NOTHING].log_z > LARGE_MISFIT
        found: list[Template] = []
        if len(e.effects) < (MAX_EFFECTS if not e.law else 1):
            anew = [c for c in others if not self.templates or steps_together(e.fit.problem, c)] if fresh else []
            found = templates(e.fit, anew, self.workers)
            found += [t for t in self.templates if t.candidate in others and t.candidate not in anew]
            if e.key == NOTHING:
                self.templates = found
        changes, fitted = columns(found, self.grid.count), raw(e.fit)
        settings = self.settings_of(e)
        m = Marginal(self.grid, fitted, changes, bounded(e.fit), settings)
        for chosen, gain, amounts in _additions(m, found, pairs=len(e.effects) + 2 <= MAX_EFFECTS and not e.law):
            step, _ = m.solution(chosen)
            s = m.complement[0]
            index = [1 + i for i in chosen]
            decrease = float(s[0, index] @ np.linalg.lstsq(s[np.ix_(index, index)], s[0, index], rcond=None)[0])
            self.offer(
                Addition(
                    parent=e, templates=tuple(found[i] for i in chosen), amounts=amounts, law=None, step=step, gain=gain,
                    decrease=decrease, log_prior=log_prior(len(e.effects) + len(chosen), library, e.law),
                )  # fmt: skip
            )
        if e.law or len(e.effects) > 1 or not self.needs_laws(e):
            return
        known = laws_beside(e.fit, self.grid, settings[:2], m.log_z_of_settings[:2], fitted, changes, self.workers)
        if known is None:
            return
        ranked = known.all()
        self.log(f"   laws beside {name(e.key)}: {[(law.closure.target, law.closure.coordinate, round(law.log_bayes_factor, 1)) for law in ranked[:3]]}")
        allowed = [t.linear for t in found]
        seen: set[tuple[str, str]] = set()
        for law in ranked:
            which = law.closure.target.split(",")[0], law.closure.coordinate
            if which in seen:
                continue
            seen.add(which)
            self.offer(
                Addition(
                    parent=e, templates=(), amounts=(), law=law, step=law.step, gain=law.log_bayes_factor,
                    decrease=law.decrease, log_prior=log_prior(len(e.effects), library, law.closure),
                )  # fmt: skip
            )
            if e.effects:
                continue
            best: dict[str, Addition] = {}
            for both in known.with_effects(law, allowed):
                t = found[both.template]
                if t.value(both.amount) is None:
                    continue
                a = Addition(
                    parent=e, templates=(t,), amounts=(both.amount,), law=both.law, step=both.law.step,
                    gain=both.log_bayes_factor, decrease=both.law.decrease, log_prior=log_prior(1, library, law.closure),
                )  # fmt: skip
                if t.candidate.name not in best or a.gain > best[t.candidate.name].gain:
                    best[t.candidate.name] = a
            for a in best.values():
                self.offer(a)

    def needs_laws(self, e: Explanation) -> bool:
        """Return whether laws are looked for beside an explanation."""
        return e.key == NOTHING or not self.settled

    def settings_of(self, e: Explanation) -> list[int]:
        """Return the settings of the noise by which additions to an explanation are judged: white, and its most probable."""
        m = Marginal(self.grid, raw(e.fit), at_bounds=bounded(e.fit))
        best = np.argsort(-m.log_z_of_settings)[:4].tolist()
        return [0, *(i for i in best if i)]

    def offer(self, a: Addition) -> None:
        """Keep an addition if it makes an explanation that was not fitted, and no other is known to make it as probable."""
        self.linear[a.parent.key, a.key] = a
        if a.key in self.fitted:
            return
        known = self.possible.get(a.key)
        if known is None or a.log_posterior > known.log_posterior:
            self.possible[a.key] = a

    def promising(self) -> list[Addition]:
        """Return what is fitted next: what may come near the best, the most probable first."""
        limit = self.best.log_posterior - MARGIN
        least = min(self.fitted[NOTHING].fit.problem.count, *(e.fit.cost for e in self.fitted.values()))
        found = []
        for a in self.possible.values():
            if not self.is_usable(a.parent):
                continue
            log_posterior, slack = self.expected(a, least)
            # What adds nothing to a part of it is no explanation of its own
            if log_posterior + slack > limit and log_posterior + slack > self.best_part(a.key):
                found.append((log_posterior, a))
        chosen: list[Addition] = []
        for _, a in sorted(found, key=lambda one: -one[0]):
            # First a part of it, since more may add nothing
            if len(chosen) < MAX_TOGETHER and not any(b.key < a.key for b in chosen):
                chosen.append(a)
        return chosen

    def is_usable(self, parent: Explanation) -> bool:
        """Return whether a linear model beside an explanation says enough of what is near the best.

        Beside a parent that leaves much more unexplained than the best does, it does so only for a part in another one's place.
        """
        best = self.best
        return best.log_z - parent.log_z < 4 * LARGE_MISFIT or (parent.key < best.key and len(parent.key) == len(best.key) - 1)

    def best_part(self, key: Key) -> float:
        """Return the largest log posterior of what an explanation adds something to."""
        parts = [e.log_posterior for k, e in self.fitted.items() if k < key]
        return max([*parts, *(a.log_posterior for k, a in self.possible.items() if k < key)])

    def expected(self, a: Addition, least: float) -> tuple[float, float]:
        """Return the log posterior that an addition leads to, and by how much more it may be.

        The linear model may be wrong by a share of what there is to be explained, but no fit is expected to leave less than noise
        does, or than the best fit: a cost of ``least``. Where a part of what is added was fitted exactly, it starts there.
        """
        start = self.start_of(a)
        log_z, cost, gain = a.parent.log_z, a.parent.fit.cost - a.decrease, a.gain
        if start is not a.parent:
            known = self.linear[a.parent.key, start.key]
            log_z, gain = start.log_z, a.gain - known.gain
            cost = start.fit.cost - (a.decrease - known.decrease)
        missing = max(self.best.log_z - log_z, gain, 0.0)
        room = max(0.5 * (cost - least), 0.0) + 1.0
        slack = min(LINEAR_ERROR * missing**2 / (missing + LARGE_MISFIT), room)
        known_errors = self.errors.get((start.key, a.law is not None), [])
        if len(known_errors) >= 2:
            slack = min(slack, 1.0 + 1.5 * max(0.0, *known_errors))
        return log_z + gain + a.log_prior, slack

    def start_of(self, a: Addition) -> Explanation:
        """Return the most probable explanation between an addition's parent and what it makes that was fitted exactly."""
        between = [e for k, e in self.fitted.items() if k < a.key and (a.parent.key, k) in self.linear]
        return max([a.parent, *between], key=lambda e: e.log_z)

    def with_noise_of(self, best: Explanation) -> None:
        """Estimate the noise and the outliers beside the best explanation, and fit all that are near it again with these."""
        data = [data_with_noise_of_residuals(best.fit, k) for k in range(len(best.fit.problem.data))]
        self.grid = NoiseGrid(data)
        limit = best.log_posterior - 2 * MARGIN
        kept = [e for e in self.fitted.values() if (e.log_posterior > limit and not self.is_needless(e)) or e.key == NOTHING]
        found = self.fit_all([(refit_steps(e.fit, e.fit.problem.with_data(data)), e) for e in kept])
        dropped = self.fitted.keys() - {e.key for _, e in found}
        self.fitted.clear()
        self._passes.clear()
        self.expanded &= {NOTHING}
        for fit, e in found:
            self.add(self.explained(fit, e))
        # What was far off, is with anything more
        kept = [a for a in self.possible.values() if a.parent.key in self.fitted and not any(k < a.key for k in dropped)]
        self.possible = {a.key: dataclasses.replace(a, parent=self.fitted[a.parent.key]) for a in kept}


def name(key: Key) -> str:
    """Return the name of an explanation in words."""
    return "+".join(sorted(key)) or "nothing"


def _additions(m: Marginal, found: Sequence[Template], *, pairs: bool) -> list[tuple[tuple[int, ...], float, tuple[float, ...]]]:
    """Return (indices, gain of log evidence, amounts) of the best template of each candidate, and of each pair of candidates."""
    if not found:
        return []
    s = m.complement
    base = m.log_z_of_settings[:, None]
    square = np.maximum(np.einsum("gii->gi", s)[:, 1:], 1e-12)
    z = s[:, 0, 1:] / np.sqrt(square)
    gain = logsumexp(base + 0.5 * z**2 + log_occam(z), axis=0) - m.log_z
    amounts = s[0, 0, 1:] / square[0]
    names = [t.candidate.name for t in found]
    best: dict[str, int] = {}
    for i, t in enumerate(found):
        if t.value(float(amounts[i])) is not None and (names[i] not in best or gain[i] > gain[best[names[i]]]):
            best[names[i]] = i
    result = [((i,), float(gain[i]), (float(amounts[i]),)) for i in best.values()]
    if not pairs:
        return result
    i, j = (a.ravel() for a in np.triu_indices(len(found), 1))
    different = np.array([names[a] != names[b] for a, b in zip(i, j, strict=True)])
    i, j = i[different], j[different]
    aa, bb, ab = s[:, 1 + i, 1 + i], s[:, 1 + j, 1 + j], s[:, 1 + i, 1 + j]
    ra, rb = s[:, 0, 1 + i], s[:, 0, 1 + j]
    det = np.maximum(aa * bb - ab**2, 1e-9 * aa * bb + 1e-30)
    xa, xb = (bb * ra - ab * rb) / det, (aa * rb - ab * ra) / det
    decrease = xa * ra + xb * rb
    # Width of each amount's posterior, the other one integrated out, over its prior's
    za, zb = xa * np.sqrt(det / np.maximum(bb, 1e-30)), xb * np.sqrt(det / np.maximum(aa, 1e-30))
    correlation = 0.5 * np.log(np.maximum(1 - ab**2 / np.maximum(aa * bb, 1e-30), 1e-9))
    log_bf = 0.5 * decrease + log_occam(za) + log_occam(zb) - correlation
    # Both widths are marginal, so that their product is too large by what the correlation takes away
    log_bf += 2 * correlation
    gain = logsumexp(base + log_bf, axis=0) - m.log_z
    of_pair: dict[tuple[str, str], int] = {}
    for k in np.argsort(-gain)[:2000]:
        pair = names[i[k]], names[j[k]]
        if pair in of_pair:
            continue
        if found[i[k]].value(float(xa[0, k])) is None or found[j[k]].value(float(xb[0, k])) is None:
            continue
        of_pair[pair] = int(k)
    result += [((int(i[k]), int(j[k])), float(gain[k]), (float(xa[0, k]), float(xb[0, k]))) for k in of_pair.values()]
    return result


def posterior(fitted: dict[Key, Explanation]) -> list[tuple[Key, float]]:
    """Return the probability of every explanation, the most probable first.

    One that adds something to another and is less probable than that counts as a part of it: what it adds is too small to be
    seen.
    """
    logs = {k: e.log_posterior for k, e in fitted.items()}
    top = max(logs.values())
    p = {k: math.exp(v - top) for k, v in logs.items()}
    for k in sorted(p, key=lambda k: (-len(k), p[k])):
        within = [j for j in p if j < k and p[j] >= p[k]]
        if within:
            p[max(within, key=lambda j: p[j])] += p.pop(k)
    total = sum(p.values())
    return sorted(((k, v / total) for k, v in p.items()), key=lambda kp: -kp[1])
