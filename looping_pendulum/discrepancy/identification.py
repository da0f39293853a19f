"""From fitted models to the one result object."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from looping_pendulum.discrepancy.data.study import Study
from looping_pendulum.discrepancy.fit.calibration import Fit
from looping_pendulum.discrepancy.fit.event_tests import errors_by_unit
from looping_pendulum.discrepancy.fit.likelihood import interval
from looping_pendulum.discrepancy.listed.attribution import rms
from looping_pendulum.discrepancy.listed.candidates import Candidate
from looping_pendulum.discrepancy.result import (
    EventResidual,
    Experiment,
    FitReport,
    FittedParameter,
    Identification,
    IdentifiedEffect,
    Remainder,
    Round,
    TrialError,
    TrialFigure,
    Unlisted,
    Verdict,
)
from looping_pendulum.pages.numbers import amount, number, quantity, uncertain
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.scenarios import loader
from looping_pendulum.scenarios.scenario import Scenario

if TYPE_CHECKING:
    from looping_pendulum.discrepancy.listed.remainder import ScaledErrors
    from looping_pendulum.discrepancy.search import CandidateModel


@dataclass(frozen=True, kw_only=True, eq=False)
class Conclusion:
    """What the search ended with."""

    before: CandidateModel
    after: CandidateModel
    ties: tuple[CandidateModel, ...]
    rounds: tuple[Round, ...]
    experiments: tuple[Experiment, ...]
    unlisted: Unlisted | None = None
    scaled: ScaledErrors | None = None
    """Set if errors were scaled to contain a remainder."""

    @property
    def enlarged(self) -> bool:
        """Whether the models' errors contain it."""
        return self.scaled is not None and bool(self.after.added)

    @property
    def lasting(self) -> float:
        """Marks that count as one in the models' errors."""
        return self.scaled.lasting if self.scaled and self.enlarged else 1.0


def identification(
    study: Study, data: Sequence[str], seed: int, verdict: Verdict, found: Conclusion, provenance: Mapping[str, str]
) -> Identification:
    """Put the result together."""
    before, after = found.before, found.after
    effects = _effects(after)
    ties = tuple(_effects(t) for t in found.ties)
    return Identification(
        study=study.name,
        title=study.title,
        seed=seed,
        verdict=verdict,
        sentence=_sentence(verdict, effects, ties, found),
        effects=effects,
        ties=ties,
        unlisted=found.unlisted,
        remainder=_remainder(found),
        next_experiments=found.experiments,
        rounds=found.rounds,
        errors=_errors(before, after, found.lasting),
        events=_events(before, after),
        before=_fit_report(before),
        after=_fit_report(after),
        judged_on="held-out trials" if before.unseen.fits else "held-out blocks of time",
        data=tuple(data),
        provenance=provenance,
        scenario=_scenario(study, after, effects),
        pictures=_pictures(before, after, found.lasting),
    )


def _effects(model: CandidateModel) -> tuple[IdentifiedEffect, ...]:
    values, errors = model.fit.values, model.fit.errors
    # what its companions shape is seldom linear in the numbers
    curved = {c.name: interval(model.fit, c.name) for c in model.added if c.companions}
    return tuple(_effect(c, values, errors, curved.get(c.name)) for c in model.added)


def _effect(
    c: Candidate, values: Mapping[str, float], errors: Mapping[str, float], between: tuple[float, float] | None
) -> IdentifiedEffect:
    return IdentifiedEffect(
        name=c.name,
        kind=c.kind,
        acts_on=c.acts_on,
        depends_on=c.depends_on,
        formula=c.formula,
        source=c.source,
        parameter=c.parameter,
        meaning=c.how.value,
        value=values[c.name],
        error=errors[c.name],
        interval=between,
        null=c.null,
        unit=c.unit,
        companions=tuple((k.name, values[k.name], errors[k.name]) for k in c.companions),
    )


def told(effect: IdentifiedEffect) -> str:
    """One effect in words: "linear_drag = 0.00120 +/- 0.00003 kg/s"."""
    known = f"{effect.name} = {uncertain(effect.value, effect.error, effect.unit)}"
    if effect.interval is None:
        return known
    low, high = (number(x) for x in effect.interval)
    return f"{known} ({low} to {high} by likelihood)"


def _sentence(
    verdict: Verdict, effects: Sequence[IdentifiedEffect], ties: Sequence[Sequence[IdentifiedEffect]], found: Conclusion
) -> str:
    if verdict is Verdict.NO_MISSING_EFFECT:
        return "The declared model explains the data to their noise; nothing was added."
    left = _left(found.before)
    remainder = _remainder(found)
    if verdict is Verdict.IDENTIFIED:
        added = " and ".join(told(e) for e in effects)
        rest = f"but for a remainder: {_told_remainder(remainder)}" if remainder else "and nothing is left"
        return f"{added} explains what the declared model leaves, {rest}. Without it, {left}."
    if verdict is Verdict.AMBIGUOUS:
        each = "; or ".join(" and ".join(told(e) for e in tie) for tie in ties)
        rest = f" A remainder stays: {_told_remainder(remainder)}." if remainder else ""
        return f"The declared model leaves something: {left}. These data cannot tell which explains it: {each}.{rest}"
    if verdict is Verdict.INTERRUPTED:
        return f"Interrupted; what was found until then stands below. With the declared model, {left or 'nothing is left'}."
    if found.unlisted is not None:
        force = found.unlisted
        each = "; ".join(f"{p.side}: {p.formula} N" for p in force.profiles)
        name = force.depends_on.replace("_", " ")
        return (
            f"The declared model leaves something that no listed effect explains: {left}. A force on the {force.acts_on} "
            f"that depends on the {name} s does ({each}): on data that no fit saw chi2 per value falls from "
            f"{number(force.held_out_before)} to {number(force.held_out_after)}."
        )
    best = next((r for r in found.rounds[0].ranking if r.gain is not None), None) if found.rounds else None
    nearest = f" The nearest is {best.name}, which does not pass: {best.reason}." if best else ""
    rest = ""
    if found.scaled is not None:
        errors = f"errors that contain what even the best explanation leaves ({amount(found.scaled.ratio)} times the scatter)"
        asked = found.rounds and found.rounds[-1].errors_times != 1
        rest = f" Nor does one by {errors}." if asked else f" By {errors} the declared model is not refuted."
    return f"The declared model leaves something that no listed effect explains: {left}.{nearest}{rest} Nothing was added."


def _left(model: CandidateModel) -> str:
    """In words what a model leaves; the tests with their numbers stand under the model in the report. Empty: nothing."""
    tests, found = model.tests, []
    if tests.chi2_per_dof > tests.limit:
        found.append(f"the residual is {amount(math.sqrt(tests.chi2_per_dof))} times as large as the noise")
    if loud := sum(not group.quiet for group in tests.groups):
        found.append(f"{loud} of the residual's {len(tests.groups)} parts show structure")
    if tests.events is not None and not tests.events.quiet:
        found.append(tests.events.told)
    if not model.unseen.explained:
        found.append(f"the data that no fit saw are off by {amount(math.sqrt(model.unseen.worst))} times the noise")
    found += model.objections
    return ", ".join(found) or "; ".join(model.alarms)


def _remainder(found: Conclusion) -> Remainder | None:
    if found.scaled is None:
        return None
    channel = found.after.fit.problem.data[0].channels[0]
    return Remainder(
        rms=found.scaled.beyond(found.after.fit, found.after.unseen, enlarged=found.enlarged),
        unit=channel.unit,
        ratio=found.scaled.ratio,
        lasting=found.scaled.lasting,
        least=found.scaled.least,
    )


def _told_remainder(remainder: Remainder) -> str:
    rms = quantity(remainder.rms, remainder.unit)
    return (
        f"marks are off by {rms} more than they scatter; nothing in the library explains that, "
        f"and it was taken for errors of the marks (times {amount(remainder.ratio)}, lasting {amount(remainder.lasting)} marks)"
    )


def _errors(before: CandidateModel, after: CandidateModel, lasting: float) -> tuple[TrialError, ...]:
    rows = []
    for k, d in enumerate(before.fit.problem.data):
        chi2 = [lasting * _chi2(m.fit, k) for m in (before, after)]
        sizes = [rms(m.fit, k) for m in (before, after)]
        units = [errors_by_unit(m.fit, k) for m in (before, after)]
        rows.append(_trial_error(d.trial.name, False, sizes, chi2, units))
    for i, name in enumerate(before.unseen.names if before.unseen.fits else ()):
        chi2 = [m.unseen.chi2[i] for m in (before, after)]
        units = [errors_by_unit(m.unseen.fits[i], 0) for m in (before, after)]
        rows.append(_trial_error(name, True, [m.unseen.rms[i] for m in (before, after)], chi2, units))
    if not before.unseen.fits:
        sizes = [m.unseen.rms[0] for m in (before, after)]
        rows.append(_trial_error("blocks of time", True, sizes, [m.unseen.chi2[0] for m in (before, after)], [{}, {}]))
    return tuple(rows)


def _trial_error(
    name: str, held_out: bool, sizes: Sequence[float | None], chi2: Sequence[float], units: Sequence[Mapping[str, float]]
) -> TrialError:
    return TrialError(
        trial=name,
        held_out=held_out,
        rms_before=sizes[0],
        rms_after=sizes[1],
        noise_before=math.sqrt(chi2[0]),
        noise_after=math.sqrt(chi2[1]),
        events_before=units[0],
        events_after=units[1],
    )


def _events(before: CandidateModel, after: CandidateModel) -> tuple[EventResidual, ...]:
    rows = []
    for b, a, k, held_out in _pairs(before, after):
        data = b.problem.data[k]
        found = [fit.problem.predict_events(fit.x, k).tolist() for fit in (b, a)] if data.events else [[], []]
        for row, first, last in zip(data.events, *found, strict=True):
            rows.append(
                EventResidual(
                    trial=data.trial.name,
                    held_out=held_out,
                    quantity=row.quantity,
                    index=row.index,
                    unit=row.unit,
                    measured=row.value,
                    sigma=row.sigma,
                    before=first if math.isfinite(first) else None,
                    after=last if math.isfinite(last) else None,
                )
            )
    return tuple(rows)


def _chi2(fit: Fit, k: int) -> float:
    return float(np.mean(np.square(_standardised(fit, k))))


def _standardised(fit: Fit, k: int) -> Array:
    d = fit.problem.data[k]
    return np.asarray((d.value - fit.problem.predict(fit.x, k)) / d.sigma)


def _fit_report(model: CandidateModel) -> FitReport:
    fit = model.fit
    values, errors, stuck = fit.values, fit.errors, set(fit.at_bounds)
    return FitReport(
        numbers=tuple(
            FittedParameter(
                name=n.name,
                value=values[n.name],
                error=errors[n.name],
                measured=n.start,
                measured_error=n.scale if n.prior == 1.0 else None,
                at_bound=n.name in stuck,
            )
            for n in fit.problem.numbers
        ),
        correlations=fit.correlations(),
        condition=fit.condition,
        chi2_per_dof=model.tests.chi2_per_dof,
        held_out=model.unseen.worst,
        largest_score=abs(model.left[0].score) if model.left else 0.0,
        alarms=model.alarms,
        starts=model.starts,
    )


def _scenario(study: Study, model: CandidateModel, effects: Sequence[IdentifiedEffect]) -> str:
    """The first training trial under the repaired model, as a scenario file."""
    parameters, _ = model.fit.problem.setting(model.fit.x, 0)
    d = model.fit.problem.data[0]
    camera = ", ".join(told(e) for e in effects if e.acts_on == "camera")
    added = ", ".join(told(e) for e in effects if e.acts_on != "camera") or "nothing"
    text = f"Fitted to the trials of the study '{study.name}', as trial '{d.trial.name}'. Added to what was declared: {added}."
    if camera:
        text += f" The camera's own errors are no part of a scenario: {camera}."
    return loader.dump(
        Scenario(
            name=f"{study.name}_repaired",
            title=f"{study.title}: repaired model",
            description=text,
            parameters=parameters,
            duration=float(d.t.max()),
        )
    )


def _pairs(before: CandidateModel, after: CandidateModel) -> list[tuple[Fit, Fit, int, bool]]:
    """Fits before and after of every trial, which of theirs it is, and whether it was held out."""
    pairs = [(before.fit, after.fit, k, False) for k in range(len(before.fit.problem.data))]
    return pairs + [(b, a, 0, True) for b, a in zip(before.unseen.fits, after.unseen.fits, strict=True)]


def _pictures(before: CandidateModel, after: CandidateModel, lasting: float) -> tuple[TrialFigure, ...]:
    seen = [pair for pair in _pairs(before, after) if pair[0].problem.data[pair[2]].channels]
    return tuple(_picture(*pair, math.sqrt(lasting)) for pair in seen)


def _picture(before: Fit, after: Fit, k: int, held_out: bool, times: float) -> TrialFigure:
    d = before.problem.data[k]

    def split(values: Array) -> dict[str, Array]:
        return {name: values[part] for name, part in d.slices.items()}

    return TrialFigure(
        trial=d.trial.name,
        held_out=held_out,
        channels=tuple(d.slices),
        t=split(d.t),
        measured=split(d.value),
        before=split(before.problem.predict(before.x, k)),
        after=split(after.problem.predict(after.x, k)),
        residual_before=split(times * _standardised(before, k)),
        residual_after=split(times * _standardised(after, k)),
    )
