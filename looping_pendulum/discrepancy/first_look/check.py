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

from looping_pendulum.discrepancy.blas import one_blas_thread
from looping_pendulum.discrepancy.first_look.evidence import Evidence
from looping_pendulum.discrepancy.first_look.exchanged import without_exchanged_rows
from looping_pendulum.discrepancy.first_look.misfit import DeclaredTrial, Distance, declared_trial, measured_distance
from looping_pendulum.discrepancy.first_look.mistakes import (
    LENGTHS,
    MAX_GOOD_MISFIT,
    MISTAKES,
    Correction,
    TrialSearch,
    is_left_open,
)
from looping_pendulum.discrepancy.first_look.prior import COMMON, RIVAL
from looping_pendulum.discrepancy.first_look.row_times import FilmTimes
from looping_pendulum.discrepancy.first_look.smoothing import smoothing_of
from looping_pendulum.discrepancy.fit.event_prediction import check_event_rows
from looping_pendulum.measured.observations import DataError, ImplausibleLengthError, Observations
from looping_pendulum.measured.study import Study, Trial, refuse_seen_points
from looping_pendulum.measured.usable_points import read_trial
from looping_pendulum.pages.numbers import quantity
from looping_pendulum.processes import ReportShare
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios.quantities import QUANTITIES

CHECKED = ("light_mass", "heavy_mass", "rod_radius", "free_length")
"""Parameters whose values are compared with their usual range."""
SHORT_UNIT = "0.001 mm"
"""Unit in which lengths are read that are too large in the study's own: shorter than any that a tracker writes."""
STEPS = (1, 2)
"""Numbers of mistakes at once that are tried, one after the other: two are no explanation where one suffices."""
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
    put_right: frozenset[str] = frozenset()
    """Trials whose times are put right in `observations`; a warning says how."""
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
    as_read = {t.name: o for t, o in observed if t.name not in unreadable}
    return dataclasses.replace(check, observations=as_read | dict(check.observations))


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
    # Where the picture is turned, any times of the rows fit as badly. So these are not looked at where another mistake explains
    # a trial to its noise, and must be more probable than one that nearly does
    far_off = [s for s in searches if not s.is_near and not s.as_declared.explains_all]
    others = {s.name: max(best, key=lambda e: e.log_posterior) for s in far_off if (best := _best(s, searches))}
    mistaken = any(e.evidence.misfit <= MAX_GOOD_MISFIT for e in others.values())
    altered, put_right, corrected = ([], [], {}) if mistaken else _altered_points(searches, others)
    mistakes = tuple(altered) or _named(searches)
    named = {trial for mistake in mistakes for trial in mistake.trials}
    far = filter(None, (_far_text(s) for s in searches if s.name not in named))
    return DeclarationCheck(
        trials=tuple(checks),
        mistakes=mistakes,
        warnings=(*put_right, *_implausible_values([s.declared for s in searches]), *far),
        put_right=frozenset(corrected),
        observations=corrected,
    )


def _altered_points(
    searches: Sequence[TrialSearch], others: Mapping[str, Correction]
) -> tuple[list[NamedMistake], list[str], dict[str, Observations]]:
    """Return what is wrong with the times of rows or was done to points after they were tracked.

    Parameters
    ----------
    others
        Trial -> the most probable other mistake, where there is one.

    Returns
    -------
    Mistakes, and what is put right of the times, in one line each; what several trials share is named once. And the
    observations of trials with times that are put right.
    """
    named: dict[str, list[str]] = {}
    put_right: dict[str, list[str]] = {}
    observations = {}
    for search in searches:
        times, other = FilmTimes.of(search), others.get(search.name)
        if times is None:
            continue
        altered = _exchange(search, times) or ("" if search.is_near else _smoothing(search, times, other))
        if altered:
            named.setdefault(altered, []).append(search.name)
            continue
        times = times.before_hand()
        if other and times.found and times.found.log_posterior < other.log_posterior:
            continue
        if (changed := times.put_right) is not None:
            put_right.setdefault(times.text, []).append(search.name)
            observations[search.name] = changed
        elif times.text:
            named.setdefault(times.text, []).append(search.name)
    mistakes = [
        NamedMistake(trials=tuple(names), names=("points",), keys="", text=f"{_where(names)}: {found}")
        for found, names in named.items()
    ]
    return mistakes, [f"{_where(names)}: {text}" for text, names in put_right.items()], observations


def _exchange(search: TrialSearch, times: FilmTimes) -> str:
    """Return in which rows the masses are exchanged, and what is needed, in words; empty: in none."""
    exchanged = without_exchanged_rows(search.declared)
    if exchanged is None:
        return ""
    back = TrialSearch(declared=exchanged.declared, distance=measured_distance(exchanged.declared))
    times_back = FilmTimes.of(back)
    if times_back is None or not back.as_declared.explains_all:
        return ""
    gain = times_back.log_of_table + len(exchanged.spans) * math.log(COMMON) - times.log_of_table
    # Where only noise is left, no other times explain more
    if gain <= math.log(RIVAL) or (not times_back.explains_table and gain < times.gain):
        return ""
    return (
        f"found the points of the two masses exchanged in rows {exchanged.text}; needed each mass in its own columns: "
        "exchange them there, or leave these rows out"
    )


def _smoothing(search: TrialSearch, times: FilmTimes, other: Correction | None) -> str:
    """Return how points were smoothed, and what is needed, in words; empty: they are as tracked."""
    as_declared = search.as_declared
    if times.explains_table or as_declared.problem is None:
        return ""
    smoothed = smoothing_of(as_declared.problem, as_declared.x, {"m": 1.0})
    if smoothed is None or smoothed.gain <= math.log(RIVAL):
        return ""
    if other and smoothed.gain < other.log_posterior - as_declared.log:
        return ""
    # The search for other times takes seconds; it may find a better fit of the table, too
    if smoothed.gain / smoothed.rows < times.most_to_gain_of_row and (smoothed.gain < times.gain or times.explains_table):
        return ""
    return (
        f"found points that were {smoothed.text}, by the errors that they are left with; needed the points as they were tracked"
    )


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
                same = other.explanation_by(explanation.mistake, nearer=explanation.is_of_trial)
                gain += 0.0 if same is None else same.evidence.log - other.as_declared.log
    return gain > 0 and explanation.evidence.explains_all and not _acts_later(explanation, search)


def _acts_later(explanation: Correction, search: TrialSearch) -> bool:
    """Return whether the points are more probable with the declared values and something that begins to act later."""
    if explanation.corrected.observations is not explanation.declared.observations:
        return False  # other points have another density
    before, after = FilmTimes.of(search), FilmTimes.of(explanation.search)
    if before is None or after is None:
        return False
    return before.log_of_table >= after.log_of_table + math.log(explanation.mistake.share)


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
    if search.as_declared.reason:
        return f"trial '{search.name}': no mistake is looked for, as {search.as_declared.reason}"
    times = None if search.distance.is_cut_off else FilmTimes.of(search)
    if times and times.explains_table:  # without points to which the tracker slips, of which `identify` speaks
        return ""
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
