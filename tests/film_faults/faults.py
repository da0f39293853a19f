"""Faults of films and of tables: each is put into a clean study at random, and says by which words it may be named."""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from tests.film_faults.films import FILMED, Array, CleanStudy, Film, Tree
from tests.film_faults.forms import Form

T = TypeVar("T")
PLAIN = Form()
TRACKER = Form(tracker=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class Faulty:
    """A study with one fault."""

    films: tuple[Film, ...]
    form: Form = PLAIN
    detail: str = ""
    """What was done, with its numbers."""
    words: str = "$^"
    """Regular expression of what a message must say that names the fault; by default nothing is right."""
    said: str = "$^"
    """The same of what is said of a fault that becomes an error of each time."""
    clock_offset: float = 0.0
    """Largest constant error of the times that nothing in the file tells [s]."""
    entry: Tree = dataclasses.field(default_factory=dict)
    """What the study says of every trial."""


Put = Callable[[np.random.Generator, CleanStudy], Faulty]


def pick(rng: np.random.Generator, values: Sequence[T]) -> T:
    """Return one of some values."""
    return values[int(rng.integers(len(values)))]


def plain_form(rng: np.random.Generator) -> Form:
    """Return one of the two commonest forms."""
    return pick(rng, (PLAIN, TRACKER))


def _stated_rate(rng: np.random.Generator, study: CleanStudy, share: float = 0.3) -> Tree:
    """Return the true frame rate as some studies state it."""
    return {"frame_rate": f"{study.films[0].rate:g} Hz"} if rng.random() < share else {}


def nothing(rng: np.random.Generator, study: CleanStudy) -> Faulty:
    return Faulty(films=study.films, form=plain_form(rng), detail="as it is")


# ------------------------------------------------------------------------------------------------- rounding


def rounded_times(rng: np.random.Generator, study: CleanStudy) -> Faulty:
    rate = study.films[0].rate
    decimals = pick(rng, [d for d in (2, 3, 4) if rate * 10.0**-d < 5])
    truncated = bool(rng.random() < 0.2)
    entry = _stated_rate(rng, study, 0.5)
    form = dataclasses.replace(plain_form(rng), time_decimals=decimals, truncated=truncated)
    cut = "cut off after" if truncated else "rounded to"
    return Faulty(
        films=study.films, form=form, entry=entry,
        detail=f"times {cut} {decimals} decimals at {rate:g}/s, frame_rate {'stated' if entry else 'not stated'}",
        words="decimals|frame numbers|numbers of the frames", clock_offset=10.0**-decimals,
    )  # fmt: skip


def rounded_points(rng: np.random.Generator, study: CleanStudy) -> Faulty:
    decimals = int(rng.integers(2, 5))
    form = dataclasses.replace(plain_form(rng), length_decimals=decimals)
    return Faulty(
        films=study.films, form=form, detail=f"points rounded to {decimals} decimals of a metre", words="decimals|digits|coarse"
    )


def few_digits(rng: np.random.Generator, study: CleanStudy) -> Faulty:
    digits = int(rng.integers(3, 5))
    entry = _stated_rate(rng, study, 0.5)
    form = dataclasses.replace(PLAIN, significant=digits)
    return Faulty(
        films=study.films, form=form, entry=entry, detail=f"every number to {digits} digits at {study.films[0].rate:g}/s",
        words="decimals|digits|coarse|numbers of the frames", clock_offset=0.5 * 10.0**-digits,
    )  # fmt: skip


# ------------------------------------------------------------------------------------------------- pictures


def _frames(film: Film) -> NDArray[np.intp]:
    """Return the number of each row's picture."""
    return np.asarray(np.round(film.t * film.rate).astype(np.intp))


def _showing(film: Film, picture: NDArray[np.intp], t: Array, jitter: float, rng: np.random.Generator) -> Film:
    """Return a film whose row k shows a picture at a time of its own; rows whose picture has no points are left out.

    Parameters
    ----------
    jitter
        Error of a point that is tracked again in a copy, as a share of the noise.
    """
    row_of = {int(frame): row for row, frame in enumerate(_frames(film))}
    kept = np.array([k for k, p in enumerate(picture) if int(p) in row_of], dtype=np.intp)
    shown = film.rows(np.array([row_of[int(picture[k])] for k in kept], dtype=np.intp))
    again = np.append(False, picture[kept][1:] == picture[kept][:-1])
    points = shown.points + again[:, None] * jitter * film.noise * rng.standard_normal(shown.points.shape)
    return dataclasses.replace(shown, t=t[kept], points=points, written=points.copy())


def every_picture_repeated(rng: np.random.Generator, study: CleanStudy) -> Faulty:
    times = int(rng.integers(2, 5))
    jitter = float(pick(rng, (0.0, 0.0, 0.1, 0.3)))
    films = []
    for film in study.films:
        row = np.arange(_frames(film)[-1] + 1)
        films.append(_showing(film, times * (row // times), row / film.rate, jitter, rng))
    return Faulty(
        films=tuple(films), form=plain_form(rng),
        words="stored again|stored .* times|repeated|copy|frames in turn last|beside their times",
        detail=f"every picture stored {times} times at {study.films[0].rate:g}/s, tracked again to {jitter:g} of the noise",
    )  # fmt: skip


def pulled_down(rng: np.random.Generator, study: CleanStudy) -> Faulty:
    """As films of 24 pictures are shown at 30 or 60 a second."""
    new, shown = pick(rng, ((2, 5), (4, 5), (5, 6), (1, 2), (2, 3), (3, 4)))
    jitter = float(pick(rng, (0.0, 0.0, 0.1, 0.3)))
    films = []
    for film in study.films:
        row = np.arange((_frames(film)[-1] + 1) * shown // new)
        films.append(_showing(film, row * new // shown, row * new / shown / film.rate, jitter, rng))
    return Faulty(
        films=tuple(films), form=plain_form(rng),
        words="stored again|stored .* times|show|repeated|copy|frames in turn last|beside their times",
        detail=f"{new} pictures of {study.films[0].rate:g}/s in {shown} rows, tracked again to {jitter:g} of the noise",
    )  # fmt: skip


def pictures_repeated_once(rng: np.random.Generator, study: CleanStudy) -> Faulty:
    count = int(rng.integers(1, 5))
    jitter = float(pick(rng, (0.0, 0.1, 0.3)))
    films, places = [], []
    for film in study.films:
        row = np.arange(_frames(film)[-1] + 1)
        at = np.sort(rng.choice(row[2:-2], count, replace=False))
        picture = row.copy()
        picture[at] = at - 1
        places.append(", ".join(f"{k / film.rate:.3f}" for k in at))
        films.append(_showing(film, picture, row / film.rate, jitter, rng))
    return Faulty(
        films=tuple(films), form=plain_form(rng), words="stored again|repeated|copy|lost|beside their times",
        detail=f"at {study.films[0].rate:g}/s the picture before again at {'; '.join(places)} s, {jitter:g} of the noise",
    )  # fmt: skip


def pictures_lost(rng: np.random.Generator, study: CleanStudy) -> Faulty:
    """The rows are numbered on, as if nothing were missing."""
    gaps = int(rng.integers(1, 4))
    films, places = [], []
    for film in study.films:
        frame = _frames(film)
        gone = np.zeros(len(frame), dtype=bool)
        at = np.sort(rng.choice(np.arange(3, len(frame) - 3), gaps, replace=False))
        for k in at:
            gone[k : k + int(rng.integers(1, 4))] = True
        places.append(", ".join(f"{film.t[k]:.3f}" for k in at))
        kept = np.flatnonzero(~gone)
        t = film.t - np.cumsum(gone) / film.rate
        films.append(dataclasses.replace(film.rows(kept), t=t[kept]))
    return Faulty(
        films=tuple(films), form=plain_form(rng), words="lost",
        detail=f"at {study.films[0].rate:g}/s pictures lost at {'; '.join(places)} s and numbered on",
    )  # fmt: skip


def rows_missing(rng: np.random.Generator, study: CleanStudy) -> Faulty:
    share = float(rng.uniform(0.05, 0.3))
    films = []
    for film in study.films:
        kept = rng.random(len(film.t)) > share
        kept[:2] = True
        films.append(film.rows(np.flatnonzero(kept)))
    return Faulty(
        films=tuple(films), form=plain_form(rng), entry=_stated_rate(rng, study), detail=f"{share:.0%} of the rows not tracked"
    )


# ------------------------------------------------------------------------------------------------- clock


def _retaken(film: Film, taken: Array, t: Array, rng: np.random.Generator) -> Film:
    """Return the trial as a camera films it that takes its pictures at other times."""
    times = np.tile(taken[:, None], (1, 4))
    points = film.motion(taken) + film.sigma(times) * rng.standard_normal((len(taken), 4))
    points[taken > FILMED] = np.nan  # nobody knows the motion after its end
    return dataclasses.replace(film, taken=times, points=points, t=t, written=points.copy())


def uneven_in_turn(rng: np.random.Generator, study: CleanStudy) -> Faulty:
    period = int(rng.integers(2, 4))
    uneven = float(rng.uniform(0.1, 0.4))
    films = []
    for film in study.films:
        row = np.arange(_frames(film)[-1] + 1)
        shift = np.where(row % period == 1, uneven, 0.0)
        films.append(_retaken(film, (row + shift) / film.rate, row / film.rate, rng))
    return Faulty(
        films=tuple(films), form=plain_form(rng), words="frames in turn last|uneven|beside their times",
        detail=f"at {study.films[0].rate:g}/s every frame of {period} late by {uneven:.2f} of a frame, times even",
    )  # fmt: skip


def uneven_at_random(rng: np.random.Generator, study: CleanStudy) -> Faulty:
    unrest = float(rng.uniform(0.1, 0.45))
    films = []
    for film in study.films:
        row = np.arange(_frames(film)[-1] + 1)
        taken = row + np.where(row > 0, rng.uniform(-unrest, unrest, len(row)), 0.0)
        films.append(_retaken(film, taken / film.rate, row / film.rate, rng))
    return Faulty(
        films=tuple(films), form=plain_form(rng),
        words="frames .*last|uneven|lost|stored again|beside their times", said="taken unevenly",
        detail=f"at {study.films[0].rate:g}/s frames off by up to {unrest:.2f} of a frame, times even",
    )  # fmt: skip


def times_of_a_recorder(rng: np.random.Generator, study: CleanStudy) -> Faulty:
    unrest = float(rng.uniform(0.1, 0.45))
    films = []
    for film in study.films:
        jitter = np.where(film.t > 0, rng.uniform(-unrest, unrest, len(film.t)), 0.0) / film.rate
        films.append(dataclasses.replace(film, t=film.t + jitter))
    return Faulty(
        films=tuple(films), form=plain_form(rng), words="frames .*last|uneven|beside their times", said="taken unevenly",
        clock_offset=0.1 / study.films[0].rate,
        detail=f"at {study.films[0].rate:g}/s even frames, times off by up to {unrest:.2f} of a frame",
    )  # fmt: skip


def true_uneven_times(rng: np.random.Generator, study: CleanStudy) -> Faulty:
    unrest = float(rng.uniform(0.1, 0.45))
    films = []
    for film in study.films:
        row = np.arange(_frames(film)[-1] + 1)
        taken = (row + np.where(row > 0, rng.uniform(-unrest, unrest, len(row)), 0.0)) / film.rate
        films.append(_retaken(film, taken, taken, rng))
    return Faulty(
        films=tuple(films), form=plain_form(rng),
        detail=f"at {study.films[0].rate:g}/s frames off by up to {unrest:.2f} of a frame, with their own times",
    )  # fmt: skip


def slow_in_the_middle(rng: np.random.Generator, study: CleanStudy) -> Faulty:
    rate = float(pick(rng, (25.0, 30.0, 30.0, 60.0)))
    slower = int(pick(rng, (2, 4, 4, 8)))
    start = float(rng.uniform(0.1, 0.4))
    end = float(pick(rng, (2.0, start + float(rng.uniform(0.15, 0.4)))))
    declared = bool(rng.random() < 0.4)
    films = []
    for film in study.films:
        taken, now = [], 0.0
        while now <= film.t[-1]:
            taken.append(now)
            now += 1 / (rate * slower) if start <= now < end else 1 / rate
        films.append(_retaken(film, np.array(taken), np.arange(len(taken)) / rate, rng))
    until = f"to {end:.2f} s" if end < 1 else "to the end"
    return Faulty(
        films=tuple(films), form=plain_form(rng), words="clock",
        entry={"frame_rate": f"{rate * slower:g} Hz"} if declared else {},
        detail=f"{slower} times slower from {start:.2f} s {until}, {rate:g} rows/s, frame_rate "
        + (f"stated as {rate * slower:g} Hz" if declared else "not stated"),
    )  # fmt: skip


def late_rows(rng: np.random.Generator, study: CleanStudy) -> Faulty:
    which = pick(rng, ("heavy", "heavy", "light", "light", "light_x", "light_y", "heavy_y"))
    # With more, too few rows are left in which both masses were marked
    most = min(20, min(len(film.t) for film in study.films) // 5)
    shift = int(rng.integers(1, most + 1)) * int(pick(rng, (-1, 1)))
    columns = {"light": [0, 1], "heavy": [2, 3], "light_x": [0], "light_y": [1], "heavy_y": [3]}[which]
    films = []
    for film in study.films:
        points, written, taken = film.points.copy(), film.written.copy(), film.taken.copy()
        source = np.arange(len(film.t)) - shift
        inside = (source >= 0) & (source < len(source))
        for c in columns:
            points[:, c] = np.where(inside, film.points[np.clip(source, 0, len(source) - 1), c], np.nan)
            written[:, c] = points[:, c]
            taken[:, c] = np.where(inside, film.taken[np.clip(source, 0, len(source) - 1), c], film.taken[:, c])
        films.append(dataclasses.replace(film, points=points, written=written, taken=taken))
    return Faulty(
        films=tuple(films), form=plain_form(rng), words="rows|shifted|later|earlier",
        detail=f"{which} {abs(shift)} rows too {'late' if shift > 0 else 'early'} at {study.films[0].rate:g}/s",
    )  # fmt: skip


def wrong_unit_of_time(rng: np.random.Generator, study: CleanStudy) -> Faulty:
    kind = pick(rng, ("ms without a unit", "ms called s", "s called ms", "numbers of frames", "slow playback", "minutes"))
    rate = study.films[0].rate
    factor = {
        "ms without a unit": 1e3,
        "ms called s": 1e3,
        "s called ms": 1e-3,
        "numbers of frames": rate,
        "slow playback": rate / 30 if rate > 50 else 1 / 8,
        "minutes": 1 / 60,
    }[kind]
    # All digits, as these faults are not those of rounding
    form = dataclasses.replace(PLAIN, time_decimals=9)
    if kind.startswith(("ms called", "s called")):
        form = dataclasses.replace(form, with_units=True, time="s" if kind == "ms called s" else "ms")
        form = dataclasses.replace(form, time_decimals=9 if form.time == "s" else 12)
    films = tuple(dataclasses.replace(film, t=film.t * factor) for film in study.films)
    return Faulty(
        films=films, form=form, words="frame_rate|units: {time|if times are in|they are in ms|correct the times or their unit",
        detail=f"{kind} at {rate:g}/s (times {factor:g} times what they are)",
    )  # fmt: skip


# ------------------------------------------------------------------------------------------------- picture and columns


def _pictured(study: CleanStudy, turn: Callable[[Array, Array], tuple[Array, Array]]) -> tuple[Film, ...]:
    films = []
    for film in study.films:
        written = film.written.copy()
        for i in (0, 2):
            written[:, i], written[:, i + 1] = turn(film.written[:, i], film.written[:, i + 1])
        films.append(dataclasses.replace(film, written=written))
    return tuple(films)


def turned(rng: np.random.Generator, study: CleanStudy) -> Faulty:
    turns = int(rng.integers(1, 4))
    films = study.films
    for _ in range(turns):
        films = _pictured(dataclasses.replace(study, films=films), lambda x, y: (-y, x))
    return Faulty(
        films=films, form=plain_form(rng), words="turned|upside down|exchanged", detail=f"turned by {90 * turns} degrees"
    )


def mirrored(rng: np.random.Generator, study: CleanStudy) -> Faulty:
    how = pick(rng, ("left and right", "up and down", "x and y", "x and y, and both reversed"))
    turn = {
        "left and right": lambda x, y: (-x, y),
        "up and down": lambda x, y: (x, -y),
        "x and y": lambda x, y: (y, x),
        "x and y, and both reversed": lambda x, y: (-y, -x),
    }[how]
    return Faulty(
        films=_pictured(study, turn),
        form=plain_form(rng),
        words="mirrored|upside down|exchanged|turned",
        detail=f"{how} exchanged",
    )


def _weighted(study: CleanStudy, kernel: Callable[[Film], Array]) -> tuple[Film, ...]:
    """Return films whose points are weighted sums of those in their neighbours' rows; rows with a missing point stay apart."""
    films = []
    for film in study.films:
        whole = film.rows(np.flatnonzero(np.isfinite(film.written).all(axis=1)))
        films.append(dataclasses.replace(whole, written=kernel(whole) @ whole.written))
    return tuple(films)


def smoothed(rng: np.random.Generator, study: CleanStudy) -> Faulty:
    rate = study.films[0].rate
    window = int(pick(rng, (3, 5, 7, 9, 15, 21)))
    cutoff = float(pick(rng, [c for c in (8.0, 10.0, 15.0, 20.0) if c < 0.3 * rate] or [0.3 * rate]))
    how = pick(rng, ("average", "parabola", "Butterworth"))
    window = max(window, 5) if how == "parabola" else window

    def kernel(film: Film) -> Array:
        one = np.eye(len(film.t))
        if how == "average":
            near = np.abs(np.subtract.outer(np.arange(len(one)), np.arange(len(one)))) <= window // 2
            return np.asarray(near / near.sum(axis=1, keepdims=True))
        if how == "parabola":
            return np.asarray(signal.savgol_filter(one, window, 2, axis=0))
        return np.asarray(signal.filtfilt(*signal.butter(2, 2 * cutoff / rate), one, axis=0))

    over = f"{cutoff:g} Hz" if how == "Butterworth" else f"{window} rows"
    return Faulty(
        films=_weighted(study, kernel), form=plain_form(rng), words="averaged|smoothed|filtered|interpolated",
        detail=f"{how} over {over} at {rate:g}/s",
    )  # fmt: skip


def interpolated(rng: np.random.Generator, study: CleanStudy) -> Faulty:
    every = int(pick(rng, (2, 3, 4)))

    def kernel(film: Film) -> Array:
        k = np.arange(len(film.t))
        before = k // every * every
        last = (len(k) - 1) // every * every
        weights = np.zeros((len(k), len(k)))
        weights[k, before] += 1 - (k - before) / every
        weights[k, np.minimum(before + every, last)] += (k - before) / every
        return weights

    return Faulty(
        films=_weighted(study, kernel), form=plain_form(rng), words="averaged|smoothed|filtered|interpolated",
        detail=f"one row of {every} is a picture at {study.films[0].rate:g}/s",
    )  # fmt: skip


def objects_exchanged(rng: np.random.Generator, study: CleanStudy) -> Faulty:
    films, places = [], []
    for film in study.films:
        first = int(rng.integers(3, len(film.t) - 3))
        last = len(film.t) if rng.random() < 0.3 else min(len(film.t), first + int(rng.integers(1, 30)))
        written = film.written.copy()
        written[first:last] = written[first:last][:, [2, 3, 0, 1]]
        films.append(dataclasses.replace(film, written=written))
        places.append(f"{film.t[first]:.3f} to {film.t[last - 1]:.3f}")
    return Faulty(
        films=tuple(films), form=plain_form(rng), words="exchanged in rows",
        detail=f"at {study.films[0].rate:g}/s both objects exchanged {'; '.join(places)} s",
    )  # fmt: skip


EXCHANGES = {
    "the objects": (2, 3, 0, 1),
    "x and y of the light mass": (1, 0, 2, 3),
    "x and y of the heavy mass": (0, 1, 3, 2),
    "x of both": (2, 1, 0, 3),
    "y of both": (0, 3, 2, 1),
}


def exchanged_columns(rng: np.random.Generator, study: CleanStudy) -> Faulty:
    which = pick(rng, [*EXCHANGES, "time and x of the light mass", "time and y of the heavy mass"])
    words = "exchanged|tracks|column|turned|heavy mass's motion|times that grow"
    if which in EXCHANGES:
        order = list(EXCHANGES[which])
        films = tuple(dataclasses.replace(film, written=film.written[:, order]) for film in study.films)
        return Faulty(films=films, form=plain_form(rng), words=words, detail=f"{which} exchanged")
    names = ["t", "light_x", "light_y", "heavy_x", "heavy_y"]
    at = 1 if "light" in which else 4
    names[0], names[at] = names[at], names[0]
    # Under the names that the table has, the times are the values of another column
    return Faulty(films=study.films, form=Form(names=tuple(names)), words=words, detail=f"{which} exchanged")


def contradicting_names(rng: np.random.Generator, study: CleanStudy) -> Faulty:
    right = PLAIN.names
    wrong = {
        "names moved by one column": ("heavy_y", "t", "light_x", "light_y", "heavy_x"),
        "frame over times": ("frame", *right[1:]),
        "x over times, no time": ("light_x", "light_y", "t", "heavy_x", "heavy_y"),
        "cm over metres": ("t", *(f"{n} [cm]" for n in right[1:])),
        "mm over metres": ("t", *(f"{n} (mm)" for n in right[1:])),
        "inch over metres": ("t", *(f"{n}/inch" for n in right[1:])),
        "velocity over positions": ("t", "light_vx", "light_vy", "heavy_vx", "heavy_vy"),
    }
    which = pick(rng, list(wrong))
    return Faulty(
        films=study.films,
        form=Form(names=wrong[which]),
        words="column|frame|unit|times that grow|needed positions",
        detail=which,
    )


KINDS: dict[str, Put] = {
    "smoothed": smoothed,
    "interpolated": interpolated,
    "objects exchanged": objects_exchanged,
    "rounded times": rounded_times,
    "rounded points": rounded_points,
    "few digits": few_digits,
    "every picture repeated": every_picture_repeated,
    "pulled down": pulled_down,
    "pictures repeated once": pictures_repeated_once,
    "pictures lost": pictures_lost,
    "rows missing": rows_missing,
    "uneven in turn": uneven_in_turn,
    "uneven at random": uneven_at_random,
    "times of a recorder": times_of_a_recorder,
    "true uneven times": true_uneven_times,
    "slow in the middle": slow_in_the_middle,
    "turned": turned,
    "mirrored": mirrored,
    "late rows": late_rows,
    "wrong unit of time": wrong_unit_of_time,
    "exchanged columns": exchanged_columns,
    "contradicting names": contradicting_names,
}
"""Name of each kind of fault -> the function that puts one into a study."""
NONE = "none"
"""Name of the kind that leaves a study as it is."""
