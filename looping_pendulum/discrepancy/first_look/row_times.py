"""Accounts of how the rows of a table came by their times, judged by the probability of the points.

An account says at which time each row's points were taken. The declared model is fitted at these times, and the likelihood of
all points is compared with that of the table as it stands: pictures lost or stored again, a clock that changes, frames that are
uneven in turn or at random, columns that stand in other rows than the rest.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.discrepancy.first_look.evidence import MIN_ROWS, Evidence
from looping_pendulum.discrepancy.first_look.misfit import (
    DeclaredTrial,
    evidence_of_trial,
    fall_time,
    length_per_unit,
    measured_distance,
)
from looping_pendulum.discrepancy.first_look.mistakes import MAX_GOOD_MISFIT, TrialSearch
from looping_pendulum.discrepancy.first_look.paths import (
    Change,
    Filtered,
    Motion,
    Rows,
    filtered,
    likeliest_paths,
    log_of_change,
    times_with,
)
from looping_pendulum.discrepancy.first_look.prior import COMMON, EVEN_SHARE, RIVAL, UNEVEN_SHARE, UNREST
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.measured.clock import even_clock
from looping_pendulum.measured.noise import estimate_noise
from looping_pendulum.measured.observations import BODIES, Channel, Observations
from looping_pendulum.measured.usable_points import usable_points
from looping_pendulum.reference_ode.geometry import Array

END = 3.0
"""End of the rows that are looked at, in times in which a mass falls through the free length."""
ROUNDS = 5
"""Largest number of times that accounts are looked for about the fit of the best one so far."""
PROPOSED = 2
"""Number of accounts of each kind that are fitted in a round."""
PARTS = (0.25, 0.37, 0.5, 0.67, 0.83, 1.0)
"""Parts of the film over which a path is found, each about the fit to the one before."""
LATE = tuple(n / 10 for n in range(-4, 5) if n)
"""By how much frames in turn may be late [steps]."""
IN_TURN = ((2, 1), (3, 0), (3, 1), (3, 2))
"""Of how many frames in turn one is late or early, and which."""
UNEVEN = (0.06, 0.12, 0.25)
"""Errors of the times of uneven frames [steps]."""
COLUMNS = ("heavy", "light", "light_x", "light_y", "heavy_y")
"""Columns that may stand in other rows than the rest: of one mass, or one alone."""
MAX_SHIFT, MIN_ROWS_A_SHIFT = 20, 4
"""Largest number of rows by which columns may stand in other rows, and smallest number of rows in a table for each of these."""
FITS, MAX_SLIPS = 3, 0.2
"""Largest number of fits at an account's times, and largest share of points to which a tracker slips."""
MAX_COPIES = 0.25
"""Largest share of rows after what looks like a hand in which a mass may be where it was before, if it is none."""
MAX_SHOWN = 3
"""Largest number of rows that a sentence names."""
OWN_TIMES = "export the film's own frame times, or its frame numbers"
"""Way out where pictures are lost, repeated or uneven."""
ONE_CLOCK = (
    "share the film as the camera took it, without a part in slow motion, and mark it again, or mark one part and state its "
    "'frame_rate'"
)
"""Way out where the clock changes."""
SAME_ROWS = "needed each row to show both masses at one time; correct the rows of these columns"
"""Way out where columns stand in other rows."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Account:
    """At which time each row was taken."""

    family: str
    """Kind of account."""
    time: Array
    """[s], shape (rows, channels)."""
    log_share: float
    """Logarithm of the prior probability."""
    text: str = ""
    """What is wrong with the times, and what is needed; empty: nothing."""
    unrest: float = UNREST
    """Error of each time [steps]."""
    changes: tuple[Change, ...] = ()
    """Changes of the times from row to row."""

    @property
    def copied(self) -> NDArray[np.bool_]:
        """Return whether each row shows the picture before again, shape (rows,)."""
        return np.isin(np.arange(len(self.time)), [c.row for c in self.changes if c.lost < 0])

    @property
    def key(self) -> tuple[object, ...]:
        """Return what tells it from others."""
        return self.family, self.unrest, self.changes, self.time.tobytes()


@dataclass(frozen=True, kw_only=True, eq=False)
class Judged:
    """An account with the fit at its own times."""

    account: Account
    evidence: Evidence
    log: float
    """Logarithm of its probability, but for a constant that all accounts of a film share."""
    filtered: Filtered | None = None
    """How the points are filtered with it; None: the model cannot run."""

    @property
    def log_posterior(self) -> float:
        """Return the logarithm of its probability, to be compared with that of other mistakes."""
        return self.evidence.log + self.account.log_share

    @property
    def explains_all(self) -> bool:
        """Return whether only noise is left."""
        return self.evidence.explains and self.evidence.misfit <= MAX_GOOD_MISFIT

    @property
    def begins_later(self) -> bool:
        """Return whether something acts that the model lacks, from a later row on."""
        return self.filtered is not None and self.filtered.begin < len(self.account.time)


class FilmTimes:
    """The accounts of one trial's times."""

    def __init__(self, search: TrialSearch, problem: Problem, last: float) -> None:
        """Take the rows up to the time ``last`` [s]."""
        self._search, self._problem, self._last = search, problem, last
        self._upright = search.declared.upright()
        parameters, data = search.declared.study.parameters({}, search.declared.trial), problem.data[0]
        self._rows = Rows.of(data, {c.unit: length_per_unit(c.unit, parameters.free_length) for c in data.channels})
        self._names = [c.name for c in data.channels]
        bodies = dataclasses.replace(self._upright.observations, channels=data.channels).bodies()
        self._noise = {body: estimate_noise(channels) for body, channels in bodies.items()}
        self._end = END * fall_time(parameters)
        # After the end of its run the model says nothing, if it is known where that is
        explained = search.as_declared.explains_all
        ends = self._motion(search.as_declared).end if explained else math.inf
        self._count = int(np.searchsorted(self._rows.t, min(self._end, last, ends), side="right"))
        self._judged_before: dict[Hashable, Judged] = {}
        even = even_clock(self._rows.t)
        self._even_clock = even if even and np.ptp(even.t - self._rows.t) > 2 * UNREST * self._rows.step else None

    @staticmethod
    @lru_cache(maxsize=16)
    def of(search: TrialSearch) -> FilmTimes | None:
        """Return the accounts of a trial; None: its model cannot run, or it has too few rows."""
        problem = search.as_declared.problem
        if problem is None or not len(search.as_declared.x):
            return None
        # After one mass was lost, the other alone tells too little
        times = FilmTimes(search, problem, min(c.t[-1] for c in search.declared.observations.channels))
        return times if times._count >= MIN_ROWS else None

    def before_hand(self) -> FilmTimes:
        """Return the accounts of the rows before a hand stops the light mass; the same ones: none does."""
        declared = self._search.declared
        usable = usable_points(declared.study, declared.trial, declared.observations)
        of_string = min(c.t[-1] for c in usable.channels)
        if of_string < self._last:
            before = FilmTimes(self._search, self._problem, of_string)
            if before._count >= MIN_ROWS and self._shows_hand(of_string):
                return before
        return self

    def _shows_hand(self, stop: float) -> bool:
        """Return whether a hand stops the light mass at a time [s], which wrong times look like."""
        found, t = self.found, self._rows.t[: self._count]
        if found is None:
            # A mark that only stays for a while goes on as the model says
            left = self._as_declared.filtered
            return left is None or not self.explains_table or bool(left.unexplained[t > stop].any(axis=1).mean() > 0.5)
        # A mass that a hand stops is where it was before, row by row, and a hand changes nothing before it stops it
        if (t > stop).any() and float(found.account.copied[t > stop].mean()) > MAX_COPIES:
            return True
        is_earlier = any(t[c.row] < stop - self._rows.step for c in found.account.changes)
        explains = found.explains_all or (is_earlier and found.evidence.lacks_nothing)
        return found.account.family in ("path", "uneven") and not explains

    @cached_property
    def found(self) -> Judged | None:
        """Return the most probable account; None: that of the table."""
        # Perhaps the tracker slips, or something begins to act
        first = self._search.as_declared
        self._judged(self._table, first.x, first)
        declared = self._as_declared.evidence
        best = self._refined(declared)
        is_explained = declared.explains_all if best is None else best.explains_all and best.account.family != "uneven"
        if not is_explained:
            # A fit to wrong times may be so far off that it leads nowhere
            best = max(filter(None, (best, self._refined(self._grown()))), key=lambda judged: judged.log, default=None)
        if best is None:
            return None
        # Its fit may serve the table, too, with points left out to which the tracker slips
        self._judged(self._table, best.evidence.x, best.evidence)
        # Where hundreds of millimetres are missing as before, nothing is explained
        judged = [j for j in self._judged_before.values() if len(j.account.time) == self._count and j.account.log_share]
        explained = [j for j in judged if j.evidence.explains_all or declared.explains_all]
        best = max(explained, key=lambda j: j.log, default=None)
        # The table itself may be a rival, of which nothing is said
        return best if best is not None and best.log > self.log_of_table + math.log(RIVAL) else None

    @property
    def log_of_table(self) -> float:
        """Return the logarithm of the probability of the table as it stands, but for a constant."""
        return self._as_declared.log

    @property
    def explains_table(self) -> bool:
        """Return whether only noise is left of the table as it stands, without points to which the tracker slips."""
        return self._as_declared.explains_all and not self._as_declared.begins_later

    @property
    def most_to_gain_of_row(self) -> float:
        """Return what any account can gain of a row at most: with it, only noise is left."""
        count = np.isfinite(self._rows.points[: self._count]).sum(axis=0)
        of_noise = -np.sum(count * (np.log(self._rows.sigma * math.sqrt(2 * math.pi)) + 0.5))
        return (float(of_noise) - self.log_of_table) / self._count

    @property
    def gain(self) -> float:
        """Return the logarithm of how much more probable the most probable account is than that of the table."""
        return self.found.log - self.log_of_table if self.found else 0.0

    @property
    def best(self) -> Account:
        """Return the most probable account."""
        return self.found.account if self.found else self._table

    @property
    def _as_declared(self) -> Judged:
        """Return the table as it stands with the best of its fits."""
        self._judged(self._table, self._search.as_declared.x)
        return max((j for j in self._judged_before.values() if j.account.family == "table"), key=lambda judged: judged.log)

    @property
    def text(self) -> str:
        """Return what is wrong with the times in words, with other accounts that are about as probable; empty: nothing."""
        texts: dict[str, str] = {}
        if self.found is not None:
            texts, least = {self.best.family: self.best.text}, self.found.log - math.log(RIVAL)
            for rival in sorted(self._judged_before.values(), key=lambda j: -j.log):
                if rival.log >= least and rival.account.text and len(rival.account.time) == self._count:
                    texts.setdefault(rival.account.family, rival.account.text)
        said = ["; or ".join(texts.values())] if texts else []
        if self._put_right_times and (rows := np.flatnonzero(self._stays)).size:
            where = _places(rows, self._rows)
            said.append(f"at {where} the light mass's mark stays where it was, though the mass moves on: left out")
        return "; ".join(said)

    @property
    def put_right(self) -> Observations | None:
        """Return the observations with the times put right and marks that stay left out; None: they cannot be, or need not."""
        right = self._put_right_times
        if right is None or (right is self._search.declared.observations and not self._stays.any()):
            return None
        stays = self._rows.t[: self._count][self._stays]
        channels = tuple(_without(c, stays) if c.name in BODIES["light"] else c for c in right.channels)
        return dataclasses.replace(right, channels=channels)

    @property
    def _put_right_times(self) -> Observations | None:
        """Return the observations with the times put right, the same ones if they are right; None: they cannot be."""
        account, observations = self.best, self._search.declared.observations
        if account.family == "table":
            return observations
        if account.family == "uneven":
            error = account.unrest * self._rows.step
            changed = [dataclasses.replace(c, time_error=max(error, c.time_error)) for c in observations.channels]
        elif account.family == "even" and self._even_clock:
            even = dict(zip(self._rows.t.tolist(), self._even_clock.t.tolist(), strict=True))
            changed = [
                dataclasses.replace(c, t=np.array([even.get(t, t) for t in c.t.tolist()])) for c in observations.channels
            ]
            errors = {**self._even_clock.camera_errors, **observations.camera_errors}
            observations = dataclasses.replace(observations, camera_errors=errors)
        elif account.changes and all(c.alone for c in account.changes):
            changed = [_without(c, self._rows.t[: self._count][account.copied]) for c in observations.channels]
        else:
            return None
        return dataclasses.replace(observations, channels=tuple(changed))

    @property
    def _stays(self) -> NDArray[np.bool_]:
        """Return in which rows the light mass's mark stays where it was and later goes on, shape (rows,).

        A mass that hangs on a string by its weight stands still nowhere but where it turns.
        """
        judged, bodies = self.found or self._as_declared, self._rows.bodies
        light = next((b for b, body in enumerate(bodies) if self._names[body[0]] in BODIES["light"]), None)
        if light is None or judged.filtered is None or not judged.explains_all or judged.account.family == "even":
            return np.zeros(self._count, dtype=bool)
        goes_on = np.flatnonzero(~judged.filtered.unexplained[:, light])
        stays = judged.filtered.stays[:, light].copy()
        stays[goes_on[-1] if len(goes_on) else 0 :] = False
        return stays & ~judged.account.copied

    @cached_property
    def _table(self) -> Account:
        time = np.repeat(self._rows.t[: self._count, None], len(self._names), axis=1)
        return Account(family="table", time=time, log_share=0.0)

    def _refined(self, evidence: Evidence) -> Judged | None:
        """Return the best account, looked for about a fit and then about its own; None: that of the table."""
        best, tried, family = None, {self._table.key}, ""
        if evidence.problem is not None:
            self._judged(self._table, evidence.x, evidence)
        for _ in range(ROUNDS):
            found = []
            for account, start in self._proposed(evidence, family):
                if account.key not in tried:
                    tried.add(account.key)
                    found.append(self._judged(account, start))
            if not found:
                break
            better = max(found, key=lambda j: j.log)
            if not better.evidence.lacks_nothing:  # about a fit to other times
                better = max(better, self._judged(better.account, None), key=lambda j: j.log)
            if better.log <= (best or self._as_declared).log:
                break
            best, evidence = better, better.evidence
            # Uneven times explain a little of everything
            family = "" if better.account.family == "uneven" else better.account.family
        return best

    def _grown(self) -> Evidence:
        """Return a fit to the likeliest path of times, which is found over longer and longer parts of the film."""
        table = self._table
        changes: tuple[Change, ...] = ()
        found, time = self._search.as_declared, table.time[:, 0]
        for part in PARTS:
            count = max(int(part * self._count), MIN_ROWS)
            start = None if part == PARTS[0] else found.x
            about = None if part == PARTS[0] or found.problem is None else found
            fitted = self._judged(self._of_path(time[:count], changes), start, about).evidence
            found = found if fitted.problem is None else fitted  # with too few rows
            if part == PARTS[0] and found.misfit > MAX_GOOD_MISFIT:  # its times are wrong from the start
                found = dataclasses.replace(found, x=np.zeros_like(found.x))
            if part < 1:
                further = max(int(PARTS[PARTS.index(part) + 1] * self._count), MIN_ROWS)
                path = likeliest_paths(self._rows, self._motion(found), further)[0]
                changes, time = path.changes, path.time
        return found

    def _proposed(self, evidence: Evidence, family: str) -> list[tuple[Account, Array | None]]:
        """Return accounts of a family, or of all, that may be more probable than the table, and where their fits begin."""
        if evidence.problem is None:
            return []
        motion = self._motion(evidence)
        proposed: list[tuple[Account, Array | None]] = []
        if family in ("", "path"):
            paths = likeliest_paths(self._rows, motion, self._count)
            own = next((p.log for p in paths if not p.changes), -math.inf)
            # A rate that all rows have is another mistake
            changed = [p for p in paths if any(c.row for c in p.changes) and p.log + math.log(COMMON) > own]
            # About a fit to other times, one of the changes may be wrong
            without_one = [(*c[:n], *c[n + 1 :]) for c in (p.changes for p in changed[:1]) if len(c) > 1 for n in range(len(c))]
            for changes in dict.fromkeys([*(p.changes for p in changed[:PROPOSED]), *without_one]):
                time = times_with(self._rows, self._count, changes)
                proposed.append((self._of_path(time, changes), evidence.x))
        if family != "path":
            others = {"turn": self._in_turn, "uneven": self._uneven, "even": self._even, "shifted": self._shifted}
            accounts = [self._table, *(a for name, them in others.items() if family in ("", name) for a in them())]
            time, unrest = np.array([a.time for a in accounts]), np.array([a.unrest for a in accounts])
            share = np.array([a.log_share for a in accounts])
            log = share + filtered(self._rows, motion, time, unrest, lacking=evidence.lacking).log
            for name in others:
                of_name = [i for i, a in enumerate(accounts) if a.family == name and log[i] > log[0]]
                proposed += [(accounts[i], evidence.x) for i in sorted(of_name, key=lambda i: -log[i])[:PROPOSED]]
            if not evidence.explains_all:  # a fit to columns that are shifted far is none
                shifted = [a for a in accounts if a.family == "shifted"]
                nearest = sorted(shifted, key=lambda a: measured_distance(self._at_own_times(a)).relative)
                proposed += [(account, None) for account in nearest[:PROPOSED]]
        return proposed

    def _motion(self, evidence: Evidence, end: float = 0.0) -> Motion:
        """Return the motion by a fit."""
        if evidence.problem is None:
            raise ValueError("a fit without a problem")  # those are sorted out where they are made
        return Motion.of(evidence.problem, evidence.x, self._rows, end or 1.1 * self._end)

    def _of_path(self, time: Array, changes: tuple[Change, ...]) -> Account:
        return Account(
            family="path",
            time=np.repeat(time[:, None], len(self._names), axis=1),
            log_share=math.log(COMMON) + log_of_change(self._count) * len(changes),
            text="; ".join(_sentences(changes, self._rows)),
            changes=changes,
        )

    def _in_turn(self) -> Iterator[Account]:
        table, step = self._table, self._rows.step
        number = np.rint((self._rows.t[: self._count] - self._rows.t[0]) / step)
        for period, place in IN_TURN:
            for late in LATE:
                lateness = late * (np.arange(period) == place)
                means = " and ".join(f"{m:.2g}" for m in 1 + np.roll(lateness, -1) - lateness)
                yield dataclasses.replace(
                    table,
                    family="turn",
                    time=table.time + step * lateness[(number % period).astype(int)][:, None],
                    log_share=math.log(COMMON / (len(IN_TURN) * len(LATE))),
                    text=f"frames in turn last {means} of their mean, by the masses' motion, unlike their times; {OWN_TIMES}",
                )

    def _uneven(self) -> Iterator[Account]:
        for unrest in UNEVEN:
            text = (
                f"by the masses' motion, pictures were taken unevenly, {1e3 * unrest * self._rows.step:.2g} ms beside their "
                "times: taken as an error of each time"
            )
            share = math.log(UNEVEN_SHARE / len(UNEVEN))
            yield dataclasses.replace(self._table, family="uneven", log_share=share, text=text, unrest=unrest)

    def _even(self) -> Iterator[Account]:
        if self._even_clock:
            time = np.repeat(self._even_clock.t[: self._count, None], len(self._names), axis=1)
            yield Account(family="even", time=time, log_share=math.log(EVEN_SHARE), text=self._even_clock.text)

    def _shifted(self) -> Iterator[Account]:
        table, most = self._table, min(MAX_SHIFT, self._count // MIN_ROWS_A_SHIFT)
        shifts = [n for n in range(-most, most + 1) if n]
        groups = {name: np.array([n.startswith(name) for n in self._names]) for name in COLUMNS}
        groups = {name: of for name, of in groups.items() if of.any() and not of.all()}
        for name, of in groups.items():
            body, _, axis = name.partition("_")
            what = f"{axis} of the {body} mass" if axis else f"the {body} mass's points"
            for n in shifts:
                rows = f"{abs(n)} row{'s' if abs(n) > 1 else ''} {'later' if n > 0 else 'earlier'}"
                yield dataclasses.replace(
                    table,
                    family="shifted",
                    time=table.time - n * self._rows.step * of,
                    log_share=math.log(COMMON / (len(groups) * len(shifts))),
                    text=f"found {what} {rows} than the other columns; {SAME_ROWS}",
                )

    def _at_own_times(self, account: Account, slipped: NDArray[np.bool_] | None = None) -> DeclaredTrial:
        """Return the trial with the rows' times by an account, without points of bodies that slipped."""
        rows, count = self._rows, len(account.time)
        left_out = np.repeat(account.copied[:, None], len(self._names), axis=1)
        if slipped is not None:
            for b, body in enumerate(rows.bodies):
                left_out[:, list(body)] |= slipped[:, b, None]

        def at_own_times(channel: Channel) -> Channel:
            if channel.name not in self._names:  # rates, which were computed from the angles
                return channel
            row, number = np.searchsorted(rows.t, channel.t), self._names.index(channel.name)
            kept = (row < count) & ~left_out[np.minimum(row, count - 1), number]
            t, value = account.time[row[kept], number], channel.value[kept]
            order = np.argsort(t, kind="stable")
            apart = np.diff(t[order], prepend=-math.inf) > 0
            return dataclasses.replace(channel, t=t[order][apart], value=value[order][apart])

        return self._upright.with_channels(at_own_times)

    def _judged(self, account: Account, start: Array | None, about: Evidence | None = None) -> Judged:
        """Return an account with the density of all points by a fit at its times.

        Points to which a tracker slips, or which something moves that begins to act later, are left out of a further fit where
        that makes all points more probable; those to which it slips as seen from another fit, ``about``, of the first one.
        """
        key = (account.key, None if start is None else start.tobytes(), about is None)
        if key in self._judged_before:
            return self._judged_before[key]
        best = Judged(account=account, evidence=Evidence(log=-math.inf), log=-math.inf)
        unexplained = None
        if about is not None:
            found = filtered(
                self._rows, self._motion(about), account.time[None], np.array([account.unrest]), account.copied[None]
            )
            unexplained = found.unexplained
        for _ in range(FITS):
            declared = self._at_own_times(account, unexplained)
            distance = measured_distance(declared) if account.family == "shifted" else self._search.distance
            evidence = evidence_of_trial(declared, distance, self._noise, end=END, start=start)
            if not len(evidence.x) or evidence.problem is None:  # the model cannot run there
                break
            motion = self._motion(evidence, float(account.time.max()) + self._rows.step)
            found = filtered(self._rows, motion, account.time[None], np.array([account.unrest]), account.copied[None])
            prior = np.array([n.prior_sigma for n in evidence.problem.free_parameters])
            log = float(found.log[0]) + account.log_share - 0.5 * float(np.sum((evidence.x / prior) ** 2))
            if log <= best.log:
                break
            best = Judged(account=account, evidence=evidence, log=log, filtered=found)
            slips = found.unexplained[: found.begin]
            if evidence.misfit <= MAX_GOOD_MISFIT or not found.unexplained.any() or slips.mean() > MAX_SLIPS:
                break
            unexplained, start = found.unexplained, evidence.x
        self._judged_before[key] = best
        return best


def _sentences(changes: Sequence[Change], rows: Rows) -> list[str]:
    """Return in words which rows' times are wrong, and how."""
    said = []
    rates = [c for c in changes if c.factor != 1]
    if rates:
        ratios = (f"{c.factor:.3g} times" if c.factor > 1 else f"1/{1 / c.factor:.3g}" for c in rates)
        found = " and ".join(
            f"from {rows.t[c.row]:.3g} s on a row lasts {words} as long" for c, words in zip(rates, ratios, strict=True)
        )
        said.append(f"by the masses' motion, the clock changes: {found}; {ONE_CLOCK}")
    lost = [c for c in changes if c.lost > 0]
    if lost:
        of_first = f"as where pictures are lost (at the first place {lost[0].lost})"
        said.append(
            f"from {_places([c.row for c in lost], rows)} on the masses are ahead of their times, {of_first}; {OWN_TIMES}"
        )
    again = [c for c in changes if c.lost < 0]
    if again:
        alone = len(again) == len(changes) and all(c.alone for c in again)
        what = "the masses are where they were a row before, so that a picture is stored again there"
        said.append(f"at {_places([c.row for c in again], rows)} {what}{': left out' if alone else f'; {OWN_TIMES}'}")
    return said


def _places(numbers: Sequence[int] | NDArray[np.intp], rows: Rows) -> str:
    """Return the times of rows by the file in words."""
    shown = ", ".join(f"{rows.t[n]:.4g} s" for n in numbers[:MAX_SHOWN])
    return f"{shown} and {len(numbers) - MAX_SHOWN} more" if len(numbers) > MAX_SHOWN else shown


def _without(channel: Channel, t: Array) -> Channel:
    """Return a channel without its points at some times."""
    kept = ~np.isin(channel.t, t)
    return dataclasses.replace(channel, t=channel.t[kept], value=channel.value[kept])
