"""Compare the tracked points with the declared motion, and name large mistakes of filming or of declaration.

A mistake is named if undoing it alone brings the points near the declared motion, and nothing less does: the study's
uncertain values (friction, drag, what was measured with an error) are fitted both with and without it. Effects that the
declared model lacks are left to the fit of `identify`. They move the points by centimetres, a mistake by decimetres, and they
do not vanish with another unit or another sign. A declared value of unusual size may be right, and is worth a second look.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from looping_pendulum.discrepancy.blas import one_blas_thread
from looping_pendulum.discrepancy.first_look.evidence import Evidence
from looping_pendulum.discrepancy.first_look.exchanged import without_exchanged_rows
from looping_pendulum.discrepancy.first_look.misfit import (
    CLOCK_ERROR,
    DeclaredTrial,
    Distance,
    declared_trial,
    evidence_of_trial,
    measured_distance,
    problem_of_trial,
)
from looping_pendulum.discrepancy.first_look.mistakes import (
    COMMON,
    LENGTHS,
    MAX_FITTED_MISFIT,
    MAX_GOOD_MISFIT,
    MISTAKES,
    RIVAL,
    SAME_ROWS,
    Correction,
    TrialSearch,
    is_left_open,
)
from looping_pendulum.discrepancy.first_look.row_times import (
    CLEAR_SHIFT_RATIO,
    row_shift,
    shifts_by_motion,
    without_shift,
    wrong_times,
)
from looping_pendulum.discrepancy.first_look.smoothing import smoothing_in_words
from looping_pendulum.discrepancy.fit.event_prediction import check_event_rows
from looping_pendulum.measured.displaced_rows import (
    MIN_CHANGE,
    WrongTimes,
    by_either_clock,
    clock_faults,
    sentences,
)
from looping_pendulum.measured.observations import Channel, DataError, ImplausibleLengthError, Observations
from looping_pendulum.measured.study import Study, Trial, refuse_seen_points
from looping_pendulum.measured.usable_points import read_trial, usable_points
from looping_pendulum.pages.numbers import quantity
from looping_pendulum.processes import ReportShare
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios.quantities import QUANTITIES

CHECKED = ("light_mass", "heavy_mass", "rod_radius", "free_length")
"""Parameters whose values are compared with their usual range."""
MAX_MISFIT_RATIO = 0.7
"""Largest misfit with other times, as a share of that with those of the file, at which these are wrong."""
MAX_MENDED_MISFIT = 2.5
"""Largest misfit with other times at which they are right: that of trials in which a hidden effect moves the mass by 50 mm."""
SHORT_UNIT = "0.001 mm"
"""Unit in which lengths are read that are too large in the study's own: shorter than any that a tracker writes."""
STEPS = (1, 2)
"""Numbers of mistakes at once that are tried, one after the other: two are no explanation where one suffices."""
MAX_LOSS = 0.3
"""Largest rise of the misfits by other times at which the way of the masses is believed."""
MAX_CLEAR_DISTANCE_RATIO = 0.25
"""Largest distance from the declared motion by another shift of rows, in that by the file, that needs no fit."""
MIN_ORIGIN_SHIFT = 0.1
"""Smallest distance of the origin from where it was declared, in free lengths, that is no error of measurement."""
MIN_ORIGIN_SIGMAS = 10.0
"""The same in standard errors of the declared place."""
ORIGIN = ("origin_x", "origin_y")
"""Parameters of the camera that say where the rod's centre is."""


class DeclarationError(DataError):
    """Tracked points and declaration contradict each other; `check` says how."""

    def __init__(self, check: DeclarationCheck) -> None:
        super().__init__("; ".join(m.text for m in check.mistakes))
        self.check = check


@dataclass(frozen=True, kw_only=True, eq=False)
class NamedMistake:
    """A mistake that the points show."""

    trials: tuple[str, ...]
    names: tuple[str, ...]
    """Names of `mistakes.Mistake`; several if the points do not tell which of them was made."""
    keys: str
    """Keys of the study that correct it, with their values in the first of these trials."""
    text: str
    """One line: where, what was found, what was needed, and the key that corrects it."""
    corrected: Mapping[str, Distance] = field(default_factory=dict)
    """Trial -> distance of its points without the mistake; empty: only the origin is elsewhere."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrialCheck:
    """Comparison of one trial."""

    trial: str
    distance: Distance | None
    """Distance of its points from the declared motion; None: the trial was not looked at."""
    reason: str = ""
    """Why it was not looked at."""
    reading: tuple[str, ...] = ()
    """What was assumed or put right when its files were read."""

    @property
    def text(self) -> str:
        """Return in one line how near the points are."""
        if self.distance is None:
            return f"trial '{self.trial}': not looked at, {self.reason}"
        return (
            f"trial '{self.trial}': in the first {quantity(self.distance.window, 's')} the points are "
            f"{self.distance.text} from the declared motion, before anything is fitted"
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class DeclarationCheck:
    """Result of a first look at a study."""

    trials: tuple[TrialCheck, ...]
    mistakes: tuple[NamedMistake, ...] = ()
    """What looks wrong."""
    warnings: tuple[str, ...] = ()
    """Declared values of unusual size, in one line each; they do not contradict the points."""
    observations: Mapping[str, Observations] = field(default_factory=dict, repr=False, compare=False)
    """Trial -> what its files hold, read as they are declared."""

    @property
    def notes(self) -> tuple[str, ...]:
        """Return everything that looks wrong or unusual, in one sentence each."""
        return tuple(f"At first look: {text}." for text in (*(m.text for m in self.mistakes), *self.warnings))

    def refuse_mistakes(self) -> None:
        """Raise what looks wrong, if anything does.

        Raises
        ------
        DeclarationError
            If there is a mistake; its message is one line.
        """
        if self.mistakes:
            raise DeclarationError(self)


def take_first_look(study: Study, progress: ReportShare = lambda what, share: None) -> DeclarationCheck:
    """Read the files of a study and compare them with what it declares.

    Parameters
    ----------
    progress
        Called while films are tracked, with the share of all trials that is read.

    Raises
    ------
    DataError
        If a file cannot be read, or has an event that no model can predict.
    """
    observed, unreadable = [], dict[str, str]()
    for i, trial in enumerate(study.trials):

        def report(what: str, share: float, name: str = trial.name, before: int = i) -> None:
            progress(f"{name}: {what}", (before + share) / len(study.trials))

        try:
            observed.append((trial, read_trial(study, trial, report)))
        except ImplausibleLengthError as error:
            # Pixels, perhaps. In a unit that is far too short they can be read, and the motion then says how long one is
            readable = dataclasses.replace(trial, units={**trial.units, "length": SHORT_UNIT})
            try:
                observed.append((readable, read_trial(study, readable)))
            except DataError:
                raise error from None
            unreadable[trial.name] = str(error)
    for _, observations in observed:
        check_event_rows(observations)
    refuse_seen_points(observed)
    with one_blas_thread():
        check = check_declaration(study, observed)
    for name, message in unreadable.items():
        if not any(name in m.trials and any(LENGTHS.name in n for n in m.names) for m in check.mistakes):
            raise ImplausibleLengthError(message)
    return dataclasses.replace(check, observations={t.name: o for t, o in observed if t.name not in unreadable})


def check_declaration(study: Study, observed: Iterable[tuple[Trial, Observations]]) -> DeclarationCheck:
    """Take a first look at a study.

    Parameters
    ----------
    observed
        Every trial with its observations as they were read.
    """
    observed = tuple(observed)
    checks, searches = [], []
    for trial, observations in observed:
        distance, reason = None, ""
        if not observations.channels:
            reason = "it has events only"
        elif (left_open := next((name for name in ("scale", "clock_ratio") if is_left_open(trial, name)), None)) is not None:
            reason = f"as its camera's {left_open} may be far from 1"
        else:
            declared = declared_trial(study, trial, observations)
            measured = measured_distance(declared)
            searches.append(TrialSearch(declared=declared, distance=measured))
            distance, reason = (measured, "") if math.isfinite(measured.rms) else (None, f"as {measured.reason}")
        checks.append(TrialCheck(trial=trial.name, reading=observations.assumptions, distance=distance, reason=reason))
    mistakes = (*_altered_points(searches),)
    altered = {name for mistake in mistakes for name in mistake.trials}
    mistakes += (*_clock_faults([(t, o) for t, o in observed if t.name not in altered], searches),)
    # With wrong times other mistakes would be named for them, and all trials were filmed alike; but one that explains a trial
    # to its noise without other times is no chance, as where columns are exchanged
    named = {name for mistake in mistakes for name in mistake.trials}
    others = [e for s in searches if s.name in named and not s.is_near for e in _best(s, searches)]
    if not mistakes or any(e.evidence.misfit <= MAX_GOOD_MISFIT and "times" not in e.factors for e in others):
        mistakes = _named(searches)
    named = {trial for mistake in mistakes for trial in mistake.trials}
    far = filter(None, (_far_text(s) for s in searches if s.name not in named))
    return DeclarationCheck(
        trials=tuple(checks),
        mistakes=mistakes,
        warnings=(*_implausible_values([s.declared for s in searches]), *far),
    )


def _altered_points(searches: Sequence[TrialSearch]) -> list[NamedMistake]:
    """Return what was done to points after they were tracked; what several trials share is named once."""
    trials: dict[str, list[str]] = {}
    for search in searches:
        if not search.is_near and (found := _alteration(search)):
            trials.setdefault(found, []).append(search.name)
    return [
        NamedMistake(trials=tuple(names), names=("points",), keys="", text=f"{_where(names)}: found {found}")
        for found, names in trials.items()
    ]


def _alteration(search: TrialSearch) -> str:
    """Return what was done to the points of a trial, and what is needed, in words; empty: they are as they were tracked."""
    as_declared, exchanged = search.as_declared, without_exchanged_rows(search.declared)
    if exchanged is not None:
        corrected = evidence_of_trial(exchanged.declared, measured_distance(exchanged.declared))
        if corrected.explains_all and corrected.log + len(exchanged.spans) * math.log(COMMON) > as_declared.log:
            return (
                f"the points of the two masses exchanged in rows {exchanged.text}; needed each mass in its own columns: "
                "exchange them there, or leave these rows out"
            )
    # The errors of smoothed points look like something large that is missing; an effect of a usual size is no smoothing
    if as_declared.problem is None or not as_declared.explains or as_declared.explains_all:
        return ""
    declared = search.declared
    if usable_points(declared.study, declared.trial, declared.observations) is not declared.observations:
        return ""  # nor is a hand
    text = smoothing_in_words(as_declared.problem, as_declared.x, {"m": 1.0})
    return text and f"points that were {text}, by the errors that they are left with; needed the points as they were tracked"


def _clock_faults(observed: Sequence[tuple[Trial, Observations]], searches: Sequence[TrialSearch]) -> list[NamedMistake]:
    """Return what the points say against their own times; what several trials share is named once."""
    by_name = {search.name: search for search in searches}
    trials: dict[str, list[str]] = {}
    for trial, observations in observed:
        search = by_name.get(trial.name)
        for fault in observations.faults if search is None else _by_points_or_model(observations.channels, search):
            trials.setdefault(fault, []).append(trial.name)
    return [
        NamedMistake(trials=tuple(names), names=("clock",), keys="", text=f"{_where(names)}: {fault}")
        for fault, names in trials.items()
    ]


def _by_points_or_model(channels: Sequence[Channel], search: TrialSearch) -> list[str]:
    """Return what is wrong with the times of a trial's rows, by the model's way or, where that does not tell, by the points."""
    model, fit = _Model(search), search.quickly_fitted
    if fit.problem is None:
        return clock_faults(channels, model)
    as_declared = problem_of_trial(search.declared, camera_errors=CLOCK_ERROR)
    for wrong in wrong_times([(as_declared, as_declared.prior_mean), (fit.problem, fit.x)]):
        onward = tuple(rows for rows in wrong if rows.onward)
        # The way says it clearly, so that the first part of the motion need only not contradict it. Where the likeliest account
        # has no wrong times, there are none
        if not (onward and all(model.gain(each, ()) < -MAX_LOSS for each in by_either_clock(onward))):
            return sentences(wrong, float(np.median(np.diff(channels[0].t))))
    return clock_faults(channels, model)


class _Model:
    """The declared model, fitted to one trial's points at the times at which they were filmed by their own account."""

    def __init__(self, search: TrialSearch) -> None:
        self._search = search
        self._at: dict[tuple[WrongTimes, ...], TrialSearch] = {(): search}

    def agrees(self, wrong: tuple[WrongTimes, ...]) -> bool | None:
        return _is_nearer(self._search, self._at_other_times(wrong))

    def gain(self, wrong: tuple[WrongTimes, ...], known: tuple[WrongTimes, ...]) -> float:
        return _gain(self._at_other_times(known), self._at_other_times(wrong))

    def _at_other_times(self, wrong: tuple[WrongTimes, ...]) -> TrialSearch:
        def at_own_times(channel: Channel) -> Channel:
            t = channel.t
            # The last ones first, as their times are the file's
            for each in sorted(wrong, key=lambda w: w.t, reverse=True):
                t = each.undone(t)
            order = np.argsort(t)
            apart = np.append(True, np.diff(t[order]) > 0)
            return dataclasses.replace(channel, t=t[order][apart], value=channel.value[order][apart])

        if wrong not in self._at:
            # Its fit begins at the same shifts
            declared = self._search.declared.with_channels(at_own_times)
            self._at[wrong] = TrialSearch(declared=declared, distance=self._search.distance)
        return self._at[wrong]


def _is_nearer(search: TrialSearch, corrected: TrialSearch) -> bool | None:
    """Return whether a trial comes nearer to the model with other times: clearly so if it was far, or at all if it was near.

    None: what is compared of it is the same.
    """
    before, after, gain = search.fully_fitted.largest, corrected.fully_fitted.largest, _gain(search, corrected)
    if before > MAX_FITTED_MISFIT:
        return gain > 0 and after <= max(MAX_FITTED_MISFIT, min(MAX_MISFIT_RATIO * before, MAX_MENDED_MISFIT))
    return None if abs(gain) < MIN_CHANGE else gain > 0


def _gain(search: TrialSearch, corrected: TrialSearch) -> float:
    """Return by how much the misfits fall with other times."""
    return sum(search.fully_fitted.misfits) - sum(corrected.fully_fitted.misfits)


def _named(searches: Sequence[TrialSearch]) -> tuple[NamedMistake, ...]:
    """Return the mistakes of all trials; one that several trials share is named once."""
    by_names: dict[tuple[str, ...], list[tuple[TrialSearch, list[Correction]]]] = {}
    for search in searches:
        if search.is_near:
            continue
        # Most mistakes are made in all trials alike, so those of other trials are tried first
        known = (_same(explanations, search, searches) for ((_, explanations), *_) in by_names.values())
        best = next(filter(None, known), None) or _best(search, searches)
        if best:
            by_names.setdefault(tuple(e.mistake.name for e in best), []).append((search, best))
    mistakes = [_mistake(names, members) for names, members in by_names.items()]
    explained = {s.name for members in by_names.values() for s, _ in members}
    misplaced = [s for s in searches if s.name not in explained and _origin_is_wrong(s)]
    if misplaced:
        mistakes.append(_origin_mistake(misplaced))
    for search in (s for s in searches if s.name not in explained):
        by_string = row_shift(search.declared, CLEAR_SHIFT_RATIO)
        possible = [by_string] if by_string else []
        if math.isfinite(search.distance.rms) and not search.is_near and search.fully_fitted.largest > MAX_MENDED_MISFIT:
            possible += shifts_by_motion(search.declared)
        for shift in possible:
            declared = without_shift(search.declared, shift)
            corrected = TrialSearch(declared=declared, distance=measured_distance(declared))
            is_clear = corrected.distance.relative <= MAX_CLEAR_DISTANCE_RATIO * search.distance.relative
            # A fit costs a hundred times the distance
            if not is_clear and shift is not by_string and corrected.fully_fitted.largest > MAX_FITTED_MISFIT:
                continue
            if not is_clear and not _is_nearer(search, corrected):
                continue
            text = f"{_where([search.name])}: found {shift.text}; needed {SAME_ROWS}"
            mistakes.append(NamedMistake(trials=(search.name,), names=("rows shifted",), keys="", text=text))
            break
    return tuple(mistakes)


def _same(others: Sequence[Correction], search: TrialSearch, searches: Sequence[TrialSearch]) -> list[Correction]:
    """Return the explanations of another trial as those of this one; empty if they are not as probable as its own."""
    own = _best(search, searches)
    same = [e for other in others if (e := search.explanation_by(other.mistake)) is not None]
    if not own or len(same) < len(others):
        return []
    least = max(e.log_posterior for e in own) - math.log(RIVAL)
    return same if all(e.log_posterior >= least for e in same) else []


def _best(search: TrialSearch, searches: Sequence[TrialSearch]) -> list[Correction]:
    """Return the most probable explanation of a trial's points and those that may be as well; empty: they are as declared."""
    for steps in STEPS:
        found = [e for e in search.explanations(steps) if _is_more_probable(e, search, searches)]
        if found:
            probable = [e for e in found if e.log_posterior >= found[0].log_posterior - math.log(RIVAL)]
            return sorted(probable, key=lambda e: MISTAKES.index(e.mistake))
    return []


def _is_more_probable(explanation: Correction, search: TrialSearch, searches: Sequence[TrialSearch]) -> bool:
    """Return whether a mistake was probably made; one of the apparatus must explain all trials together."""
    gain = explanation.log_posterior - search.as_declared.log
    # First by the trial itself, as a fit of every other one takes its time
    if explanation.mistake.of_apparatus and gain > 0:
        for other in searches:
            if other is not search:
                same = other.explanation_by(explanation.mistake)
                gain += 0.0 if same is None else same.evidence.log - other.as_declared.log
    return gain > 0 and explanation.evidence.explains_all


def _mistake(names: tuple[str, ...], members: Sequence[tuple[TrialSearch, list[Correction]]]) -> NamedMistake:
    """Return a mistake in words; the first of its trials gives the values."""
    search, explanations = members[0]
    trials = tuple(s.name for s, _ in members)
    found = " or ".join(e.mistake.found(e) for e in explanations)
    keys = "' or '".join(dict.fromkeys(key for e in explanations if (key := e.mistake.keys(e))))
    ways_out = dict.fromkeys(way for e in explanations if (way := e.mistake.way_out(e)))
    needed = " or ".join([*([f"'{keys}'"] if keys else []), *ways_out])
    before, after = search.distance, explanations[0].distance  # both in the units of the declared apparatus
    if not math.isfinite(before.rms):
        size = f"{before.reason}; with the change, the points are {after.text} from it"
    elif after.rms < before.rms:
        size = f"the points are {before.text} from the declared motion and {after.text} with the change"
    else:  # a shorter string moves less
        size = f"with the change, the points are {after.text} from the declared motion"
    # Only the first trial's values are shown, where others need other ones
    others = {"' or '".join(dict.fromkeys(e.mistake.keys(e) for e in each)) for _, each in members}
    of_first = f" in '{trials[0]}'" if len(others) > 1 else ""
    text = f"{_where(trials)}: found {found}; needed {needed}{of_first} ({size})"
    return NamedMistake(trials=trials, names=names, keys=keys, text=text, corrected={s.name: e[0].distance for s, e in members})


def _far_text(search: TrialSearch) -> str:
    """Return that a trial is farther from what was declared than an effect may move it, though no one mistake explains it.

    Empty: it is not.
    """
    # Points that are scattered by metres fit everything within their noise
    if not search.distance.is_cut_off and (search.is_near or search.as_declared.explains):
        return ""
    if not math.isfinite(search.distance.rms):
        reason = search.distance.reason
        return f"trial '{search.name}': cannot be compared, as {reason}; check this trial's frame_rate, unit of time and camera"
    return (
        f"trial '{search.name}': the points are {search.distance.text} from the declared motion, more than an "
        "effect moves them, and no single usual mistake explains it; check this trial's masses, free length, angle and file"
    )


def _where(trials: Sequence[str]) -> str:
    """Return the trials of a message."""
    shown = ", ".join(f"'{t}'" for t in trials)
    return f"trial {shown}" if len(trials) == 1 else f"trials {shown}"


def _origin_is_wrong(search: TrialSearch) -> bool:
    """Return whether the rod's centre is far from where it was declared, in a trial that agrees otherwise."""
    return search.as_declared.explains and not search.distance.is_cut_off and _has_other_origin(search, search.as_declared)


def _has_other_origin(search: TrialSearch, fit: Evidence) -> bool:
    if not fit.values.keys() >= set(ORIGIN):
        return False
    upright = search.declared.upright()  # as the fit has it
    priors = upright.study.camera_priors(upright.trial, upright.observations)
    least = MIN_ORIGIN_SHIFT * upright.study.parameters({}, upright.trial).free_length
    return any(
        not priors[name].free
        and abs(fit.values[name] - priors[name].value) > max(least, MIN_ORIGIN_SIGMAS * (priors[name].sigma or 0))
        for name in ORIGIN
    )


def _origin_mistake(searches: Sequence[TrialSearch]) -> NamedMistake:
    """Return an origin that is not at the rod, in words."""
    trials = tuple(s.name for s in searches)
    upright = complex(*(searches[0].as_declared.values[name] for name in ORIGIN))
    origin = upright * 1j ** (searches[0].declared.quarter_turns % 4)  # as the file has it
    x, y = quantity(origin.real, "m"), quantity(origin.imag, "m")
    keys = f"camera: {{origin_x: free from {x}, origin_y: free from {y}}}"
    return NamedMistake(
        trials=trials,
        names=("origin",),
        keys=keys,
        text=f"{_where(trials)}: found the rod's centre near x = {x}, y = {y}; needed the axes' origin there, or '{keys}'",
    )


def _implausible_values(declared: Sequence[DeclaredTrial]) -> Iterator[str]:
    """Yield a line for every declared value of unusual size in a trial whose light mass loops."""
    said = set()
    for each in declared:
        if each.trial.release is not Release.LOOPING:
            continue
        for parameter in CHECKED:
            q, known = QUANTITIES[parameter], each.estimate(parameter)
            (low, high), unit = q.usual, q.kind.unit
            if known is None or low <= known.value <= high or (parameter, known) in said:
                continue
            said.add((parameter, known))
            example = f"{q.group}: {{{q.last_key}: {q.kind.example_text}}}"
            yield (
                f"trial '{each.trial.name}': found a {parameter.replace('_', ' ')} of {quantity(known.value, unit)}, which is "
                f"unusual ({quantity(low, unit)} to {quantity(high, unit)}); check its unit, as in '{example}'"
            )
