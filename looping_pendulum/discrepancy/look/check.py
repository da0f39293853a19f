"""A first look: which one hypothesis makes the points of a trial most probable, and is it probable enough to be named?

The table as it is written, every mistake of filming or declaration, other times of its rows and smoothed points are judged by
one score (`evidence.fit`). Effects that the declared model lacks are left to the fit of `identify`: they are part of every
hypothesis. What the points contradict is named with the key that corrects it, what is beyond doubt is put right and said.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, compress

import numpy as np
from threadpoolctl import threadpool_limits

from looping_pendulum.discrepancy.fit.event_prediction import check_event_rows
from looping_pendulum.discrepancy.look.case import Case, Rows
from looping_pendulum.discrepancy.look.evidence import NO_FIT, Fit, fit
from looping_pendulum.discrepancy.look.mistakes import HIDDEN, LENGTHS, MISTAKES, ROWS, Distance, Mistake, distance, keys_of
from looping_pendulum.discrepancy.look.prior import MAX_LEFT, MAX_LEFT_OUT, RIVAL, SMOOTHED_SHARE, STAYS
from looping_pendulum.discrepancy.look.smoothing import smoothing
from looping_pendulum.discrepancy.look.times import Path, Times, about, grown, held_or_later, shifted, uneven
from looping_pendulum.measured.edits import HELD, Change, end_of_record, left_out_rows, read_trial, until_end
from looping_pendulum.measured.observations import BODIES, DataError, ImplausibleLengthError, Observations
from looping_pendulum.measured.study import Study, Trial, refuse_seen_points
from looping_pendulum.pages.numbers import quantity
from looping_pendulum.processes import ReportShare
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios.quantities import QUANTITIES

CHECKED = ("light_mass", "heavy_mass", "rod_radius", "free_length")
"""Parameters whose values are compared with their usual range."""
SHORT_UNIT = "0.001 mm"
"""Unit in which lengths are read that are too large in the study's own: shorter than any that a tracker writes."""
MIN_ORIGIN_SHIFT, MIN_ORIGIN_SIGMAS = 0.1, 10.0
"""Smallest distance of the origin from where it was declared that is no error: in free lengths, and in its standard errors."""
MAX_OPEN_ERROR = 0.1
"""Error of a scale or a clock's ratio by which the study leaves open what a first look compares."""
TRIED, SCREENED_ROWS = 6, 120
"""Number of mistakes, those that leave points nearest to the declared motion, that are judged, and most rows for it."""
FARTHER, SURELY_NEAR = 3.0, 0.05
"""How many times farther than with the nearest mistake points may be with those, or how far [free lengths]."""
MAX_RECORD = 40
"""Longest record of which other times are looked for, in times in which a mass falls through the free length."""
MAY_REST = 3
"""Fewest rows in turn in which a mark stays where it was as its mass may rest there."""
HARDLY_MOVES = 0.1
"""Largest range of y, in that of x, of a plane that is not the one in which the masses fall."""


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


@dataclass(frozen=True, kw_only=True, eq=False)
class Hypothesis:
    """One explanation of a trial's points."""

    name: str
    """Name of the mistake, or kind of the times; '' of the table as it stands."""
    fit: Fit
    gain: float = 0.0
    """Logarithm of its probability in that of the table."""
    text: str = ""
    """What is found, and what is needed."""
    keys: str = ""
    """Keys that correct it."""
    mistake: Mistake | None = None
    times: Times | None = None
    corrected: Case | None = None
    """The case without it."""

    @property
    def explains(self) -> bool:
        """Return whether it explains the points; an effect that begins may be of any size."""
        return self.fit.shows_masses if self.name == "later" else self.fit.explains


@dataclass(frozen=True, kw_only=True, eq=False)
class TrialLook:
    """All hypotheses of one trial."""

    case: Case
    distance: Distance
    rows: Rows
    table: Fit
    hypotheses: tuple[Hypothesis, ...]

    @property
    def name(self) -> str:
        """Return the trial's name."""
        return self.case.trial.name

    @property
    def best(self) -> list[Hypothesis]:
        """Return the most probable hypothesis, and its rivals, in the order of `MISTAKES`; empty: the table is right."""
        able = sorted((h for h in self.hypotheses if h.explains), key=lambda h: -h.gain)
        if not able or able[0].gain < math.log(RIVAL) or self._leaves_out_much(able[0]):
            return []
        rivals = {h.name: h for h in reversed(able) if h.mistake and h.gain > able[0].gain - math.log(RIVAL)}
        return sorted(rivals.values(), key=lambda h: MISTAKES.index(h.mistake)) if able[0].mistake else able[:1]

    def _leaves_out_much(self, h: Hypothesis) -> bool:
        """Whether a hypothesis leaves many points out, without explaining the others to their noise."""
        left_out = 0.0 if h.times is None else 1 - float(h.times.taken.used.sum() / self.rows.is_point.sum())
        return left_out > MAX_LEFT_OUT and not h.fit.explains_to_noise


def look_at(case: Case, away: Distance) -> TrialLook | str:
    """Return all hypotheses of one trial, whose points are so far away as declared, or why no mistake is looked for."""
    try:
        rows, few = Rows.of(case), Rows.of(case, most=SCREENED_ROWS)
    except DataError as error:
        return str(error)
    table, hypotheses = fit(case, rows), list[Hypothesis]()
    mistakes = _mistakes(case, few, len(rows.t), table, away)
    for proposed in chain((mistakes,), _times(case, rows, table), (_smoothings(case, rows, table),)):
        hypotheses += proposed
        if any(_is_sure(h) for h in hypotheses):  # then no rarer ones are looked for
            break
    # A hypothesis that is near may have led its fit to where the table is more probable, too
    near = max((h for h in hypotheses if h.times), key=lambda h: h.gain, default=None)
    if near and near.gain > math.log(RIVAL) and (again := fit(case, rows, start=near.fit.x)).log > table.log:
        hypotheses = [dataclasses.replace(h, gain=h.gain + table.log - again.log) if h.times else h for h in hypotheses]
        table = again
    return TrialLook(case=case, distance=away, rows=rows, table=table, hypotheses=tuple(hypotheses))


def _is_sure(h: Hypothesis) -> bool:
    """Return whether a hypothesis leaves only noise, and is none of those that look like an effect."""
    explains = h.fit.explains_to_noise if h.mistake and h.mistake not in HIDDEN else h.fit.is_clean
    return explains and h.gain > math.log(RIVAL) and h.name not in ("uneven", "turn", "held", "later")


def _mistakes(case: Case, rows: Rows, count: int, table: Fit, declared: Distance) -> Iterator[Hypothesis]:
    """Yield the mistakes without which the points are nearest to the declared motion; ``rows`` are some of ``count``."""
    nearest: dict[str, tuple[float, Mistake, Case]] = {}
    for mistake in (ROWS,) if table.is_clean else HIDDEN if table.explains_to_noise else MISTAKES:
        after = mistake.undo(case)
        if after is not None:
            away = distance(after).relative
            if away <= declared.relative and (mistake.name not in nearest or away < nearest[mistake.name][0]):
                nearest[mistake.name] = away, mistake, after
    if not nearest:
        return
    as_written = fit(case, rows)
    tried = sorted(nearest.values(), key=lambda n: n[0])[:TRIED]
    for _, mistake, after in (n for n in tried if n[0] <= max(FARTHER * tried[0][0], SURELY_NEAR)):
        yield _without(case, count, as_written, mistake, after)


def _without(case: Case, count: int, as_written: Fit, mistake: Mistake, after: Case) -> Hypothesis:
    """Return a mistake as a hypothesis, on the same of the first ``count`` rows as the table's fit."""
    found = fit(after, Rows.of(after, count, SCREENED_ROWS))
    words, keys = keys_of(case, after, found.values)
    needed = " and ".join(filter(None, (f"'{keys}'" if keys else "", mistake.way_out)))
    return Hypothesis(
        name=mistake.name,
        fit=found,
        gain=found.log - max(as_written.log, -1e300) + math.log(mistake.share),
        text=f"found {mistake.found}{words}; needed {needed or 'the unit of the points there'}",
        keys=keys,
        mistake=mistake,
        corrected=after,
    )


def _times(case: Case, rows: Rows, table: Fit) -> Iterator[Iterator[Hypothesis]]:
    """Yield groups of hypotheses of other times of the rows, the quickest to find first."""

    def judged(paths: Iterable[Path | None]) -> Iterator[Hypothesis]:
        for times, found in filter(None, paths):
            gain = found.log + times.log_share - table.log
            yield Hypothesis(name=times.kind, fit=found, gain=gain, text=times.text, times=times)

    if table is NO_FIT:
        return
    near = about(case, rows, table)
    yield judged([near])
    if rows.t[-1] < MAX_RECORD * case.fall_time:
        yield judged((t, t.fitted(case, rows, None if t.kind == "even" else table.x)) for t in uneven(case, rows))
        if not table.explains_to_noise:
            yield judged(shifted(case, rows, table))
            yield judged([grown(case, rows, table)])
        if near or not table.explains_to_noise:  # a mass that stops is a clock that is slow, too
            yield judged(held_or_later(case, rows))


def _smoothings(case: Case, rows: Rows, table: Fit) -> Iterator[Hypothesis]:
    """Yield the likeliest smoothing of the points."""
    found = None if table is NO_FIT or table.is_quiet else smoothing(case, rows, table.x)
    if found:
        text = (
            f"found points that were {found[0]}, by the errors that they are left with; needed the points as they were tracked"
        )
        yield Hypothesis(name="smoothed", fit=found[2], gain=found[1] + math.log(SMOOTHED_SHARE), text=text)


def decide(look: TrialLook, looks: Sequence[TrialLook]) -> list[Hypothesis]:
    """Return what is wrong with a trial: the most probable hypothesis and its rivals; empty: nothing.

    A mistake of the apparatus must explain all trials together. Points that nothing explains are a hypothesis of their own.
    """
    best = look.best
    mistake = best[0].mistake if best else None
    if mistake and mistake.of_apparatus and not _explains_all(mistake, best[0].gain, look, looks):
        best = []
    if best and best[0].name == "later":
        return []
    # Points that are scattered by metres leave nothing but noise
    if (
        not best
        and math.isfinite(look.distance.rms)
        and (look.distance.is_cut_off or not (look.table.leaves_noise or look.table.leaves_little))
    ):
        return [Hypothesis(name="unexplained", fit=look.table, text=_unexplained(look))]
    return best or _other_origin(look)


def _explains_all(mistake: Mistake, gain: float, look: TrialLook, looks: Sequence[TrialLook]) -> bool:
    """Return whether all trials together speak for a mistake of their apparatus, with its gain in one of them."""
    for other in looks:
        if other is not look and (after := mistake.undo(other.case)) is not None:
            rows = Rows.of(other.case, most=SCREENED_ROWS)
            without = _without(other.case, len(other.rows.t), fit(other.case, rows), mistake, after)
            gain += without.gain - math.log(mistake.share)
    return gain > 0


def _unexplained(look: TrialLook) -> str:
    """Return that the points are far from the declared motion, and what may be looked at."""
    ranges = {c.name: float(np.ptp(c.value)) for c in look.case.observations.channels}
    masses = [m for m in ("light", "heavy") if ranges.keys() >= {f"{m}_x", f"{m}_y"}]
    hint = "check this trial's masses, free length, angle and file"
    if masses and all(ranges[f"{m}_y"] < HARDLY_MOVES * max(ranges[f"{n}_x"] for n in masses) for m in masses):
        hint = "y hardly moves: if the masses move in x and z, needed 'plane: xz'"
    return (
        f"the points are {look.distance.text} from the declared motion, more than an effect moves them, and no single usual "
        f"mistake explains it; {hint}"
    )


def _other_origin(look: TrialLook) -> list[Hypothesis]:
    """Return an origin that is far from where it was declared, in a trial that agrees otherwise."""
    priors, values = look.case.study.camera_priors(look.case.trial, look.case.observations), look.table.values
    names, least = ("origin_x", "origin_y"), MIN_ORIGIN_SHIFT * look.case.free_length
    if not values.keys() >= set(names) or not any(
        not priors[n].free and abs(values[n] - priors[n].value) > max(least, MIN_ORIGIN_SIGMAS * (priors[n].sigma or 0.0))
        for n in names
    ):
        return []
    x, y = (quantity(values[n], "m") for n in names)
    keys = f"camera: {{origin_x: free from {x}, origin_y: free from {y}}}"
    text = f"found the rod's centre near x = {x}, y = {y}; needed the axes' origin there, or '{keys}'"
    return [Hypothesis(name="origin", fit=look.table, text=text, keys=keys)]


def take_first_look(study: Study, *, progress: ReportShare = lambda what, share: None) -> DeclarationCheck:
    """Read the files of a study and compare them with what it declares.

    Parameters
    ----------
    progress
        Called with what is being done, and the share of it that is done.

    Raises
    ------
    DataError
        If a file cannot be read, or has an event that no model can predict.
    """
    observed, unreadable = _read(study)
    with threadpool_limits(1, user_api="blas"):
        check = _check(study, observed, progress)
    for name, error in unreadable.items():
        if not any(name in m.trials and any(LENGTHS.name in n for n in m.names) for m in check.mistakes):
            raise error
    return dataclasses.replace(check, observations={n: o for n, o in check.observations.items() if n not in unreadable})


def _read(study: Study) -> tuple[list[tuple[Trial, Observations]], dict[str, ImplausibleLengthError]]:
    """Read all trials; those of too large lengths in a unit that is far too short: the motion says how long one is."""
    observed, unreadable = [], {}
    for trial in study.trials:
        try:
            observed.append((trial, read_trial(study, trial)))
        except ImplausibleLengthError as error:
            readable = dataclasses.replace(trial, units={**trial.units, "length": SHORT_UNIT})
            try:
                observed.append((readable, read_trial(study, readable)))
            except DataError:
                raise error from None
            unreadable[trial.name] = error
    for _, observations in observed:
        check_event_rows(observations)
    refuse_seen_points(observed)
    return observed, unreadable


def _check(study: Study, observed: Sequence[tuple[Trial, Observations]], progress: ReportShare) -> DeclarationCheck:
    """Look at all trials, and edit their observations once."""
    checks, looks, said = [], [], []
    edited = {trial.name: observations for trial, observations in observed}
    for i, (trial, observations) in enumerate(observed):
        progress(f"comparing trial '{trial.name}' with the study", i / len(observed))
        case = Case.of(study, trial, observations)
        reason, away = _reason_to_pass(case), None
        if not reason:
            away = distance(case)
            look = look_at(case, away)
            if isinstance(look, str):
                said.append(f"trial '{trial.name}': no mistake is looked for, as {look}")
            else:
                looks.append(look)
            away, reason = (away, "") if math.isfinite(away.rms) else (None, f"as {away.reason}")
        checks.append(TrialCheck(trial=trial.name, reading=observations.assumptions, distance=away, reason=reason))
    wrong: dict[str, list[tuple[TrialLook, list[Hypothesis]]]] = {}
    put_right: dict[str, list[str]] = {}
    for look in looks:
        best = decide(look, looks)
        putting_right = best[0].times.put_right if best and best[0].times else None
        if putting_right:
            edited[look.name] = putting_right(edited[look.name])
            put_right.setdefault(best[0].text, []).append(look.name)
        elif best:
            by = best[0].text if not any(h.mistake for h in best) else " ".join(h.name for h in best)
            wrong.setdefault(by, []).append((look, best))
        found = best[0].fit if best and best[0].times else look.table
        if found.explains and (putting_right or not best):  # not of a trial that is refused, whose points are elsewhere
            for change, text in _stuck(look.rows, found, MAX_LEFT * look.case.free_length):
                edited[look.name] = change(edited[look.name])
                put_right.setdefault(text, []).append(look.name)
        edited[look.name] = until_end(study, look.case.trial, edited[look.name], found.values if found.explains else {})
    said += [f"{_trials(names)}: {text}" for text, names in put_right.items()]
    return DeclarationCheck(
        trials=tuple(checks),
        mistakes=tuple(map(_named, wrong.values())),
        warnings=(*said, *_implausible_values([look.case for look in looks])),
        put_right=frozenset(name for names in put_right.values() for name in names),
        observations=edited,
    )


def _reason_to_pass(case: Case) -> str:
    """Return why a trial is not looked at; '': it is."""
    if not case.observations.channels:
        return "it has events only"
    for name in ("scale", "clock_ratio"):
        known = case.trial.camera.get(name)
        if known and (known.free or (known.sigma or 0.0) > MAX_OPEN_ERROR or abs(known.value - 1) > MAX_OPEN_ERROR):
            return f"as its camera's {name} may be far from 1"
    return ""


def _stuck(rows: Rows, found: Fit, far: float) -> Iterator[tuple[Change, str]]:
    """Yield what leaves out rows in which a body's mark stays where it was, though the mass moves on by a fit, and says so.

    Parameters
    ----------
    far
        How far it moves on meanwhile, at least [m].
    """
    if found.weight.shape != rows.value.shape:
        return
    stays = rows.log_stays() + math.log(STAYS) > rows.log_slips()
    for b, body in enumerate(rows.bodies):
        weight = found.weight[:, body].max(axis=1)
        is_stuck = stays[:, b] & (weight > 0) & (weight < 0.5)
        spans = np.flatnonzero(np.diff(is_stuck, prepend=False, append=False)).reshape(-1, 2).tolist()
        if spans:  # a mass that rests stays where it was, too, and an effect may let it rest earlier
            place = (found.places(rows, rows.t) * rows.unit)[:, body]
            moves_on = [bool(np.abs(place[z - 1] - place[a]).max() > far) for a, z in spans]
            is_left_out = [
                moves if z - a >= MAY_REST else found.leaves_noise for (a, z), moves in zip(spans, moves_on, strict=True)
            ]
            spans = list(compress(spans, is_left_out))
        name = next(n for n, of in BODIES.items() if rows.channels[body[0]].name in of)
        if name == "light" and spans and spans[-1][1] == len(rows.t) >= spans[-1][0] + MAY_REST:
            a, _ = spans.pop()
            yield end_of_record(float(rows.t[a]), HELD), HELD
        at = [rows.t[a:z] for a, z in spans]
        if at:
            of = f"the {name} mass's mark" if name in ("light", "heavy") else f"the {name}"
            text = f"at {', '.join(f'{t[0]:.4g} s' for t in at)} {of} stays where it was, though the mass moves on: left out"
            yield left_out_rows(np.concatenate(at), text, name), text


def _named(members: Sequence[tuple[TrialLook, list[Hypothesis]]]) -> NamedMistake:
    """Return what is wrong with trials in words; the first of them gives the values."""
    look, best = members[0]
    trials = tuple(other.name for other, _ in members)
    keys = "' or '".join(dict.fromkeys(h.keys for h in best if h.keys))
    corrected = {o.name: distance(h[0].corrected) for o, h in members if h[0].corrected}
    size = ""
    if look.name in corrected:
        after, before = corrected[look.name].text, look.distance
        if not math.isfinite(before.rms):
            size = f" ({before.reason}; with the change, the points are {after} from it)"
        elif after != before.text:  # rows that are exchanged late change nothing at the beginning
            size = f" (the points are {before.text} from the declared motion and {after} with the change)"
    others = {"' or '".join(dict.fromkeys(h.keys for h in each)) for _, each in members}
    of_first = f" in '{trials[0]}'" if len(others) > 1 else ""
    text = f"{_trials(trials)}: {'; or '.join(h.text for h in best)}{of_first}{size}"
    return NamedMistake(trials=trials, names=tuple(h.name for h in best), keys=keys, text=text, corrected=corrected)


def _trials(names: Sequence[str]) -> str:
    shown = ", ".join(f"'{name}'" for name in names)
    return f"trial {shown}" if len(names) == 1 else f"trials {shown}"


def _implausible_values(cases: Sequence[Case]) -> Iterator[str]:
    """Yield a line for every declared value of unusual size in a trial whose light mass loops."""
    said = set()
    for each in cases:
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
