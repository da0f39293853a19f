"""Hypotheses of the times at which the points of each row were taken, proposed by a fit, to be judged like any other.

Of each row and each instant of the modelled motion, one table says how probable its points are (`Instants`). The likeliest
path through it is found by dynamic programming: from row to row the instant moves on by what the file says, by another rate, by
some lost pictures more, or not at all, where a picture is stored again. Columns that stand in other rows are read off the same
table, about a fit without them.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.discrepancy.look.case import END, MIN_ROWS, Case, Rows
from looping_pendulum.discrepancy.look.evidence import NO_FIT, Fit, Taken, fit
from looping_pendulum.discrepancy.look.prior import (
    CHANGES,
    COMMON,
    EVEN_SHARE,
    LACKING,
    LATE_IN_TURN,
    LATER_SHARE,
    LOST,
    RATES,
    SLIPS,
    UNEVEN,
    UNEVEN_SHARE,
)
from looping_pendulum.measured.clock import even_clock
from looping_pendulum.measured.edits import HELD, REST_SIGMAS, Change, end_of_record, even_times, left_out_rows, uneven_times
from looping_pendulum.measured.noise import GAUSSIAN_MAD
from looping_pendulum.reference_ode.geometry import Array

IN_TURN = ((2, 1), (3, 0), (3, 1), (3, 2))
"""Of how many frames in turn one is late or early, and which."""
GROUPS = ("heavy", "light", "light_x", "light_y", "heavy_y")
"""Columns that may stand in other rows than the rest."""
MAX_SHIFT, SHIFT_STEPS, GROUPS_TRIED = 20, (4, 2, 1), 2
"""Largest number of rows by which they may be shifted, by how many others are tried, and how many of the groups are."""
PARTS = (0.12, 0.25, 0.4, 0.6, 0.8, 1.0)
"""Growing parts of the film over which a path is found."""
TOLERANCES, HELD_TOLERANCES = (0.03, 0.01, 0.003), (2e-3, 2e-4)
"""Errors of a fit to a part where it goes on, after half a second [m]; where a hand is looked for, and again near it."""
MAX_TRIED_WITHOUT = 9
"""Most changes of a path that are each tried without."""
MIN_HELD, LATER_BEFORE = 4, 4
"""Fewest rows after the masses are held, and rows before an effect that begins is seen."""
SHOWN = 3
OWN_TIMES = "export the film's own frame times, or its frame numbers"
ONE_CLOCK = (
    "share the film as the camera took it, without a part in slow motion, and mark it again, or mark one part and state its "
    "'frame_rate'"
)
Changes = tuple[tuple[int, str, float], ...]
"""Row, "rate" (and how long a row lasts), "lost" (and how many), or "again" (1: later rows show their own pictures)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Times:
    """When the points of each row were taken, by a hypothesis."""

    kind: str
    taken: Taken
    log_share: float
    """Logarithm of the prior probability, and of the density of points that are not compared."""
    text: str = ""
    """What is wrong with the times, and what is needed; '': nothing."""
    changes: Changes = ()
    put_right: Change | None = None
    """Edit of the observations that puts it right; None: it cannot be."""

    def fitted(self, case: Case, rows: Rows, start: Array | None) -> Fit:
        """Return the fit at these times."""
        return fit(case, rows, self.taken, start=start)


Path = tuple[Times, Fit]
"""A hypothesis of times with its fit."""


def log_of(path: Path) -> float:
    """Return the logarithm of the probability of a hypothesis of times."""
    return path[0].log_share + path[1].log


def log_of_change(rows: Rows) -> float:
    """Return the logarithm of the prior probability of one change at one row."""
    return math.log(CHANGES) - math.log(len(rows.t) * (len(RATES) + len(LOST)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Instants:
    """How probable the points of each row are, if they were taken at each of closely spaced instants of a fitted motion."""

    rows: Rows
    per_row: int
    """Instants from row to row."""
    number: NDArray[np.intp]
    """Instant of each row by the file, shape (rows,)."""
    of_channel: NDArray[np.float32]
    """Logarithm of the density of each point, that of a slip at least, shape (channels, rows, instants)."""
    of_row: NDArray[np.float32]
    """The same of each row, shape (rows, instants)."""

    @staticmethod
    def about(rows: Rows, found: Fit, end: float, tolerance: float) -> Instants:
        """Return them of a fitted motion up to an end [s], whose error after half a second is ``tolerance`` [m]."""
        per_row = 8 if len(rows.t) <= 160 else 4
        step = rows.step / per_row
        t = np.arange(rows.t[0], max(end, rows.t[-1] + 4 * rows.step), step)
        place = found.places(rows, t)
        grown = tolerance * np.sqrt(0.1 + (np.maximum(t, 0) / 0.5) ** 3)[:, None] / rows.unit
        blur = 0.5 / math.sqrt(12) * np.gradient(place, axis=0)  # of an instant that lies between two
        at, moving, noise, value = (v.astype(np.float32) for v in (place, grown**2 + blur**2, rows.sigma**2, rows.value))
        of_channel = np.zeros((len(rows.channels), len(rows.t), len(t)), dtype=np.float32)
        of_row, otherwise = np.zeros(of_channel.shape[1:], dtype=np.float32), rows.log_otherwise().astype(np.float32)
        for b, body in enumerate(rows.bodies):
            own = np.zeros_like(of_row)
            for i in body:
                variance = noise[:, i, None] + moving[:, i]
                each = -0.5 * (
                    (value[:, i, None] - at[:, i]) ** 2 / variance + np.log(2 * math.pi * rows.unit[i] ** 2 * variance)
                )
                each[~rows.is_point[:, i]] = 0.0
                of_channel[i] = np.where(rows.is_point[:, i, None], np.maximum(each, math.log(SLIPS) + rows.log_anywhere), 0.0)
                own += each
            seen = np.any(rows.is_point[:, body], axis=1, keepdims=True)
            own = np.nan_to_num(own, nan=-1e9, neginf=-1e9)  # a fit may have led the masses far away
            of_row += np.where(seen, np.logaddexp(own + math.log1p(-SLIPS), otherwise[:, b, None]), 0.0)
        number = np.rint((rows.t - rows.t[0]) / step).astype(int)
        return Instants(rows=rows, per_row=per_row, number=number, of_channel=of_channel, of_row=of_row)

    def ways(self, rate: int, k: int) -> list[tuple[int, float, str, float]]:
        """Return the ways to row ``k`` at a rate: by how many instants, its prior's logarithm, and what it changes."""
        gap = int(self.number[k] - self.number[k - 1])
        moved, change = round(gap * RATES[rate]), log_of_change(self.rows)
        ways = [(moved, 0.0, "", 0.0), (moved, 2 * change, "rate", RATES[rate])]
        if rate == 0:
            before = int(self.number[k - 1] - self.number[max(k - 2, 0)])
            ways += [(moved + lost * self.per_row, change, "lost", float(lost)) for lost in LOST]
            ways += [(moved, 0.0, "again", 0.0), (moved + before, 0.0, "again", 1.0)]
        return ways

    def path(self) -> Changes:
        """Return the changes on the likeliest path."""
        n, size = self.of_row.shape
        change, copied, rates = log_of_change(self.rows), self.rows.log_copied(), len(RATES)
        best = np.full((rates + 1, size), -np.inf, dtype=np.float32)  # of each rate; the last: a copy of the row before
        best[:rates, 0] = self.of_row[0, 0] + np.array([0.0, *[2 * change] * (rates - 1)])
        way_to = np.zeros((n, rates, size), dtype=np.int8)
        rate_before = np.zeros((n, size), dtype=np.int8)
        for k in range(1, n):
            new = np.full_like(best, -np.inf)
            rate_before[k] = np.argmax(best[:rates], axis=0)
            likeliest = best[rate_before[k], np.arange(size)]
            for r in range(rates):
                for way, (moved, log_share, kind, _) in enumerate(self.ways(r, k)):
                    source = {"": best[r], "rate": likeliest, "lost": best[0], "again": best[rates]}[kind]
                    there = np.full(size, -np.inf, dtype=np.float32)
                    there[moved:] = source[: max(size - moved, 0)] + log_share
                    way_to[k, r][there > new[r]] = way
                    np.maximum(new[r], there, out=new[r])
            new[:rates] += self.of_row[k]
            new[rates] = best[0] + change + copied[k]
            best = new
        return self._changes_to(best, way_to, rate_before)

    def _changes_to(self, best: NDArray[np.float32], way_to: NDArray[np.int8], rate_before: NDArray[np.int8]) -> Changes:
        """Return the changes on the way to the most probable end."""
        r, g = (int(v) for v in np.unravel_index(int(np.argmax(best)), best.shape))
        changes: list[tuple[int, str, float]] = []
        for k in range(len(way_to) - 1, 0, -1):
            if r == len(RATES):
                if not changes or changes[-1][:2] != (k, "again"):
                    changes.append((k, "again", 0.0))
                r = 0
                continue
            moved, _, kind, amount = self.ways(r, k)[way_to[k, r, g]]
            g -= moved
            if kind:
                changes.append((k - (kind == "again"), kind, amount))
            r = int(rate_before[k, g]) if kind == "rate" else len(RATES) if kind == "again" else r
        if r < len(RATES) and RATES[r] != 1:
            changes.append((0, "rate", RATES[r]))
        return tuple(changes[::-1])

    def shift(self, members: Sequence[int]) -> tuple[int, float]:
        """Return by how many rows some columns are most probably late, and what the logarithm of their density gains by it."""
        row, most = np.arange(len(self.number)), min(MAX_SHIFT, len(self.number) // 4)

        def log(shift: int) -> float:
            at = np.clip(self.number - shift * self.per_row, 0, self.of_row.shape[1] - 1)
            return float(sum(self.of_channel[i, row, at].sum() for i in members))

        shift = max(range(-most, most + 1), key=log)
        return shift, log(shift) - log(0)


def _end(case: Case) -> float:
    """Return the end of the motion in which rows are looked for [s], a little after that of the rows that are looked at."""
    return 1.1 * END * case.fall_time


def with_changes(rows: Rows, changes: Changes) -> Times:
    """Return the times of rows if these changes were made; pictures that are stored again count as marks set again."""
    n, rate, now, owed = len(rows.t), 1.0, float(rows.t[0]), 0.0
    at, copied, time = {(k, kind): amount for k, kind, amount in changes}, np.zeros(n, dtype=bool), np.zeros(n)
    for k in range(n):
        rate = at.get((k, "rate"), rate)
        moved = (float(rows.t[k] - rows.t[k - 1]) if k else 0.0) * rate + rows.step * at.get((k, "lost"), 0)
        copied[k] = (k, "again") in at
        now, owed = (now, owed + moved * at[k, "again"]) if copied[k] else (now + moved + owed, 0.0)
        time[k] = now
    alone = all(kind == "again" and again for _, kind, again in changes)
    share = math.log(COMMON) + sum(log_of_change(rows) * (2 if kind == "rate" else 1) for _, kind, _ in changes)
    return Times(
        kind="path" if changes else "table",
        taken=Taken.as_written(rows, time, used=rows.is_point & ~copied[:, None]),
        log_share=(share if changes else 0.0) + float(rows.log_copied()[copied].sum()),
        text=_in_words(changes, rows, alone),
        changes=changes,
        put_right=left_out_rows(rows.t[copied], f"at {_where(changes, rows, 'again')} a picture is stored again")
        if alone
        else None,
    )


def about(case: Case, rows: Rows, found: Fit, known: Times | None = None) -> Path | None:
    """Return the likeliest path of times about a fit, to times ``known``, with the fit at these times; None: the table's."""
    best = None if known is None else (known, found)
    for _ in range(3):
        times = with_changes(rows, Instants.about(rows, found, _end(case), 0.002).path())
        if not times.changes or (best is not None and times.changes == best[0].changes):
            break
        new = times, times.fitted(case, rows, found.x)
        if new[1] is NO_FIT or (best is not None and log_of(new) <= log_of(best)):
            break
        best, found = new, new[1]
    if best is None or not best[0].changes:
        return None
    best = max(best, (best[0], best[0].fitted(case, rows, None)), key=log_of)
    if len(best[0].changes) <= MAX_TRIED_WITHOUT:  # about a fit to other times, one of them may be wrong
        for change in best[0].changes:
            times = with_changes(rows, tuple(c for c in best[0].changes if c != change))
            if times.changes:
                best = max(best, (times, times.fitted(case, rows, best[1].x)), key=log_of)
    return best


def unfitted(found: Fit) -> Fit:
    """Return the declared motion as a fit."""
    return dataclasses.replace(
        found, x=np.zeros_like(found.x), amounts=np.zeros_like(found.amounts), lacking=LACKING[0], later=None
    )


def grown(case: Case, rows: Rows, found: Fit) -> Path | None:
    """Return the likeliest path, found over longer and longer parts of the film, each about the fit to the one before."""
    declared, now = unfitted(found), None
    changes: Changes = ()
    for count in (max(int(share * len(rows.t)), MIN_ROWS) for share in PARTS):
        part = rows.part(slice(count))
        times = with_changes(part, changes)
        best = times, times.fitted(case, part, now.x if now else None)
        around = now or (best[1] if best[1].explains else declared)
        for tolerance in () if best[1].is_clean else TOLERANCES:
            times = with_changes(part, Instants.about(part, around, _end(case), tolerance).path())
            new = times, times.fitted(case, part, None if around is declared else around.x)
            around = new[1] if new[1].explains else around
            best = max(best, new, key=log_of)
        if best[1].problem is not None and (best[1].explains or now is None):
            changes, now = best[0].changes, best[1]
    return about(case, rows, now, with_changes(rows, changes)) if now else None


def uneven(case: Case, rows: Rows) -> Iterator[Times]:
    """Yield frames that are late in turn, uneven frames, and even frames with uneven times."""
    number = np.rint((rows.t - rows.t[0]) / rows.step).astype(int)
    for period, place in IN_TURN:
        late = LATE_IN_TURN * rows.step * (number % period == place)[:, None] * np.ones(rows.value.shape)
        yield Times(
            kind="turn", taken=Taken.as_written(rows, late=late), log_share=math.log(COMMON / len(IN_TURN)),
            text=f"one of {period} frames in turn lasts longer than their times say, by the masses' motion: frames in turn "
                 f"last unlike their mean; {OWN_TIMES}",
        )  # fmt: skip
    for unrest in UNEVEN:
        text = f"by the masses' motion, pictures were taken unevenly, {1e3 * unrest * rows.step:.2g} ms beside their times"
        yield Times(
            kind="uneven", taken=Taken.as_written(rows, unrest=unrest), log_share=math.log(UNEVEN_SHARE / len(UNEVEN)),
            text=text, put_right=uneven_times(unrest * rows.step, text),
        )  # fmt: skip
    clock = even_clock(rows.t)
    if clock and np.ptp(clock.t - rows.t) > 0.04 * rows.step:
        yield Times(
            kind="even", taken=Taken.as_written(rows, clock.t), log_share=math.log(EVEN_SHARE), text=clock.text,
            put_right=even_times(),
        )  # fmt: skip


def shifted(case: Case, rows: Rows, found: Fit) -> Iterator[Path]:
    """Yield the columns that most probably stand in other rows than the others, with the fit at their own times."""
    names, looks = [c.name for c in rows.channels], []
    for group in GROUPS:
        members = [i for i, n in enumerate(names) if n.startswith(group)]
        if not 0 < len(members) < len(names):
            continue
        used = rows.is_point.copy()
        used[:, members] = False
        others = fit(case, rows, Taken.as_written(rows, used=used), start=found.x if found.explains else None)
        if others.explains:
            shift, gain = Instants.about(rows, others, _end(case), 0.01).shift(members)
            looks.append((gain, shift, group, members, others.x))
    for gain, shift, group, members, start in sorted(looks, key=lambda look: -look[0])[:GROUPS_TRIED]:
        if gain > 0:
            best = _shifted_by(case, rows, shift, group, members, start)
            for size in SHIFT_STEPS:  # what the model lacks has some of a shift
                near = (_shifted_by(case, rows, shift + way * size, group, members, best[1].x) for way in (-1, 1))
                new, better = max(zip((shift - size, shift + size), near, strict=True), key=lambda n: n[1][1].log)
                if better[1].log > best[1].log and new:
                    shift, best = new, better
            yield best


def _shifted_by(case: Case, rows: Rows, shift: int, group: str, members: Sequence[int], start: Array) -> Path:
    """Return that some columns are late by a number of rows."""
    time = np.repeat(rows.t[:, None], len(rows.channels), axis=1)
    time[:, members] -= shift * rows.step
    body, _, axis = group.partition("_")
    what = f"{axis} of the {body} mass" if axis else f"the {body} mass's points"
    text = (
        f"found {what} {abs(shift)} row{'s' * (abs(shift) > 1)} {'later' if shift > 0 else 'earlier'} than the other columns; "
        "needed each row to show both masses at one time; correct the rows of these columns"
    )
    share = math.log(COMMON / (2 * MAX_SHIFT * len(GROUPS)))
    times = Times(kind="shifted", taken=Taken.as_written(rows, time), log_share=share, text=text)
    return times, times.fitted(case, rows, start)


def held_or_later(case: Case, rows: Rows) -> Iterator[Path]:
    """Yield that something else holds or moves the masses from a row on, and that more begins to act within the film.

    Where, is read off the longest part of the film that the model explains to its noise.
    """
    known = None
    for count in (max(int(share * len(rows.t)), MIN_ROWS) for share in PARTS):
        part = rows.part(slice(count))
        of_part = fit(case, part, start=known and known[0].x)
        if not of_part.explains_to_noise:
            break
        known = of_part, count
    if known is None:
        return
    held, near = rows.log_held(), known[0]
    for tolerance in HELD_TOLERANCES:
        instants = Instants.about(rows, near, _end(case), tolerance)
        own = instants.of_row[np.arange(len(rows.t)), np.minimum(instants.number, instants.of_row.shape[1] - 1)]
        row = int(np.argmax(np.concatenate([[0.0], np.cumsum(own - held)[:-MIN_HELD]]))) - 1  # a stop is seen a row late
        if not MIN_ROWS <= row < len(rows.t) - MIN_HELD - 1:
            return
        used = rows.is_point & (rows.t < rows.t[row])[:, None]
        near = fit(case, rows, Taken.as_written(rows, used=used), start=near.x)
    begins = Taken.as_written(rows, later=float(rows.t[max(row - LATER_BEFORE, 0)]))
    later = Times(kind="later", taken=begins, log_share=math.log(LATER_SHARE / len(rows.t)))
    yield later, later.fitted(case, rows, near.x)
    if _rests(rows.part(slice((row + len(rows.t)) // 2, None))):
        share = math.log(COMMON / len(rows.t)) + float(held[row:].sum())
        end = end_of_record(float(rows.t[row]), HELD)
        yield Times(kind="held", taken=Taken.as_written(rows, used=used), log_share=share, text=HELD, put_right=end), near


def _rests(rows: Rows) -> bool:
    """Return whether the first body that was tracked stands still, as far as it is seen, but for some slips."""
    body = list(rows.bodies[0])
    rows = rows.part(np.asarray(rows.is_point[:, body].all(axis=1)))
    if not len(rows.t):
        return True
    moved = GAUSSIAN_MAD * np.median(np.abs(rows.value[:, body] - np.median(rows.value[:, body], axis=0)), axis=0)
    return bool(np.all(moved < REST_SIGMAS * np.median(rows.at_rest[:, body], axis=0)))


def _where(changes: Changes, rows: Rows, kind: str) -> str:
    """Return the first places of the changes of a kind in words."""
    of_kind = [k for k, what, _ in changes if what == kind]
    more = f" and {len(of_kind) - SHOWN} more" if len(of_kind) > SHOWN else ""
    return ", ".join(f"{rows.t[k]:.4g} s" for k in of_kind[:SHOWN]) + more


def _in_words(changes: Changes, rows: Rows, alone: bool) -> str:
    """Return in words which rows' times are wrong, and how; ``alone``: they are pictures that are stored again, left out."""
    said = []
    if rates := [(k, r) for k, kind, r in changes if kind == "rate"]:
        lasts = ((rows.t[k], f"{r:.3g} times" if r >= 1 else f"1/{1 / r:.3g}") for k, r in rates)
        found = " and ".join(f"from {t:.3g} s on a row lasts {times} as long" for t, times in lasts)
        said.append(f"by the masses' motion, the clock changes: {found}; {ONE_CLOCK}")
    if lost := [n for _, kind, n in changes if kind == "lost"]:
        said.append(
            f"from {_where(changes, rows, 'lost')} on the masses are ahead of their times, as where pictures are lost "
            f"(at the first place {lost[0]:.0f}); {OWN_TIMES}"
        )
    if any(kind == "again" for _, kind, _ in changes):
        what = "the masses are where they were a row before, so that a picture is stored again there"
        said.append(f"at {_where(changes, rows, 'again')} {what}{': left out' if alone else f'; {OWN_TIMES}'}")
    return "; ".join(said)
