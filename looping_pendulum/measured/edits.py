"""The one step that edits observations: pictures stored again, the record's start, wrong times, points after the model's end.

Each edit is kept with a sentence (`observations.Edit`). What the points alone show beyond doubt is edited as they are read
(`read_trial`); all else is judged about a fit (`discrepancy.look`), which chooses among the changes that stand here.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from looping_pendulum.measured.camera import Camera
from looping_pendulum.measured.clock import even_clock
from looping_pendulum.measured.film import is_film
from looping_pendulum.measured.noise import estimate_noise, scatter
from looping_pendulum.measured.observations import BODIES, Channel, Edit, Observations, ReadingNotes
from looping_pendulum.measured.study import PLACEHOLDERS, Estimate, Study, Trial, read_files
from looping_pendulum.reference_ode.effects import GRAVITY
from looping_pendulum.reference_ode.geometry import Array, string_coordinates
from looping_pendulum.reference_ode.parameters import Release

Change = Callable[[Observations], Observations]
"""Edit of a trial's observations."""
MAX_PERIOD, MIN_TURNS, MIN_COPIES = 6, 6, 3
"""Longest pattern of pictures that are stored again [rows], and how often it must be seen, less often if points are equal."""
STILL = 0.15
"""Largest share of the way to a copy in that to a new picture, squared: marks that are set again have some noise."""
MIN_ROWS, MIN_NEW = 12, 6
"""Fewest rows of which some repeat the one before in every digit, and fewest points that are left without them."""
MAX_CHANCE_DIGIT, MIN_NOISE = 0.2, 5e-5
"""Last digit up to which equal points are copies [noise], and least noise, in the range of the values."""
PART_OF_A_PERIOD = 0.12
"""Length of the part of the record that shows its start, in periods of a small swing: a parabola is within 1 % of it."""
MIN_POINTS, MAX_POINTS = 5, 60
"""Fewest and most points of that part."""
MIN_SPEED_SIGMAS, MAX_ANGLE_SIGMAS = 4.0, 4.0
"""Standard errors by which the speed at the first point must exceed zero, and its angle may differ from the stated one."""
FRAMES_AFTER_RELEASE = 2
"""Number of frames after the release at which a record may begin: it is then that of a release from rest."""
PRIOR_WIDENING, MIN_ANGLE_ERROR, MIN_SPEED_ERROR = 10.0, 0.05, 0.05
"""Errors of the prior of the start, in those of the polynomial, so that the first points hardly count twice; and the smallest
errors of angle [rad] and speed [sqrt(g l)]."""
MIN_REST_ROWS, REST_SIGMAS = 6, 5.0
"""Fewest rows in which a mass rests, and their largest distance from where it does, in the noise of the points."""
ROWS_BEFORE, MIN_WAY = 3, 5.0
"""Rows in which a mass is stopped, and least way in them, in that distance: at the end of a swing, it is less than 4."""
SLOWED = 0.7
"""Largest way from row to row, in that before, of a mass that is being stopped."""
HELD = "something other than its string holds the light mass: a hand, a wall, a knot, the rod"
TOUCH_SIGMAS = 2.0
"""Standard errors of its distance by which the ball is clear of the rod as long as its points are used."""


def read_trial(study: Study, trial: Trial) -> Observations:
    """Read the files of a trial, as `read_files` does, without pictures stored again, a film until its ball is at the rod."""
    observations = read_files(study.folder, trial, study.estimate("rod_radius", trial))
    if any(is_film(path) for path, _ in trial.files):  # the decoder knows which pictures are stored again
        # A film shows radius and rod in one scale. Where a ball rests on the wound string, it looks like a clock that is slow
        is_placed = not any(e.free for e in trial.camera.values())
        return _until_rod(study, trial, observations, {}) if is_placed else observations
    notes = ReadingNotes()
    channels = without_copies(observations.channels, notes)
    return _edited(observations, tuple(channels), *notes.edits())


def _edited(observations: Observations, channels: tuple[Channel, ...], *edits: Edit) -> Observations:
    return dataclasses.replace(observations, channels=channels, edits=(*observations.edits, *edits))


def _left_out(observations: Observations, keep: Callable[[Channel], NDArray[np.bool_]], reason: str) -> Observations:
    """Return the observations without some of the values of each channel."""
    channels = tuple(dataclasses.replace(c, t=c.t[k], value=c.value[k]) for c in observations.channels for k in (keep(c),))
    count = sum(map(len, observations.channels)) - sum(map(len, channels))
    return _edited(observations, channels, Edit(reason=reason, count=count)) if count else observations


def left_out_rows(t: Array, reason: str, body: str = "") -> Change:
    """Return the change that leaves out rows, by their times [s], of all channels or of those of one body."""
    return lambda o: _left_out(
        o, lambda c: ~np.isin(c.t, t) if c.name.startswith(body) else np.ones(len(c), dtype=bool), reason
    )


def end_of_record(end: float, reason: str) -> Change:
    """Return the change that leaves out all rows from a time on [s]."""
    return lambda o: _left_out(o, lambda c: c.t < end, f"from {end:.3f} s on {reason}")


def uneven_times(sigma: float, reason: str) -> Change:
    """Return the change that gives each time an error [s]."""

    def change(o: Observations) -> Observations:
        channels = tuple(dataclasses.replace(c, time_error=max(c.time_error, sigma)) for c in o.channels)
        return _edited(o, channels, Edit(reason=f"{reason}: taken as an error of each time"))

    return change


def even_times() -> Change:
    """Return the change that puts equal steps in place of uneven ones."""

    def change(o: Observations) -> Observations:
        t = np.unique(np.concatenate([c.t for c in o.channels]))
        clock = even_clock(t)
        assert clock is not None
        channels = tuple(dataclasses.replace(c, t=clock.t[np.searchsorted(t, c.t)]) for c in o.channels)
        o = dataclasses.replace(o, camera_errors={**clock.camera_errors, **o.camera_errors})
        return _edited(o, channels, Edit(reason=clock.text))

    return change


def ball_radius(study: Study, trial: Trial, observations: Observations) -> Estimate | None:
    """Return the light mass's radius [m], as stated or as its film shows it; None if it is not known, or counts for nothing."""
    if trial.release not in (Release.LOOPING, Release.VERTICAL):
        return None
    stated = study.estimate("light_radius", trial)
    if stated is None and observations.light_radius is not None:
        return Estimate(value=observations.light_radius[0], sigma=observations.light_radius[1])
    return None if stated is None or stated.free else stated


def with_ball(study: Study, trial: Trial, observations: Observations) -> Trial:
    """Return a trial with the light mass's radius as exact: no point is used that could tell it."""
    radius = ball_radius(study, trial, observations)
    if radius is None:
        return trial
    return dataclasses.replace(trial, estimates={**trial.estimates, "light_radius": Estimate(value=radius.value)})


def until_end(study: Study, trial: Trial, observations: Observations, fitted: Mapping[str, float]) -> Observations:
    """Return the observations before the ball reaches the rod, or something stops it for good.

    Parameters
    ----------
    fitted
        Parameter -> its value in a fit [SI], for what the trial leaves free of its camera: the first guess of a free origin
        says nothing of where the rod is.
    """
    return until_stop(_until_rod(study, trial, observations, fitted))


def _light_points(observations: Observations) -> tuple[Array, Array, tuple[Channel, Channel]] | None:
    """Return the times of the light mass's points [s], shape (n,), the points [m], shape (n, 2), and their channels."""
    channels = {c.name: c for c in observations.channels}
    if not {"light_x", "light_y"} <= channels.keys():
        return None
    x, y = channels["light_x"], channels["light_y"]
    t, in_x, in_y = np.intersect1d(x.t, y.t, return_indices=True)
    return t, np.stack([x.value[in_x], y.value[in_y]], axis=1), (x, y)


def _until_rod(study: Study, trial: Trial, observations: Observations, fitted: Mapping[str, float]) -> Observations:
    """Return the observations before the ball reaches the rod, where it is no point any more, if its radius is known."""
    radius, rod = ball_radius(study, trial, observations), study.estimate("rod_radius", trial)
    points = _light_points(observations)
    if radius is None or rod is None or points is None:
        return observations
    t, place, (x, y) = points
    camera = Camera(**{n: fitted.get(n, e.value) if e.free else e.value for n, e in trial.camera.items()})
    distance = np.hypot(*camera.true_position(place).T)
    sigma = math.hypot(estimate_noise((x, y)).a, radius.sigma or 0.0)
    is_near = distance < rod.value + radius.value + TOUCH_SIGMAS * sigma
    touching = np.flatnonzero(is_near & np.append(is_near[1:], True))  # a single one may be a wrong point
    why = f"the light mass, {1e3 * radius.value:.3g} mm in radius, is at the rod, where it is no point any more"
    return end_of_record(float(t[touching[0]]), why)(observations) if len(touching) else observations


def until_stop(observations: Observations) -> Observations:
    """Return the observations before the light mass stops within a few rows, and stays there to the end of the record."""
    points = _light_points(observations)
    if points is None or len(points[0]) < MIN_ROWS + MIN_REST_ROWS:
        return observations
    t, place, (x, y) = points
    near = REST_SIGMAS * max(scatter(x), scatter(y))
    away = np.hypot(*(place - np.median(place[-MIN_REST_ROWS:], axis=0)).T)
    stop = int(np.flatnonzero(np.append(True, away > near))[-1])
    if not ROWS_BEFORE <= stop <= len(t) - MIN_REST_ROWS or away[stop - ROWS_BEFORE] < MIN_WAY * near:
        return observations
    step = np.hypot(*np.diff(place, axis=0).T)
    while step[stop - 1] < SLOWED * step[stop - 2] and stop > ROWS_BEFORE:
        stop -= 1
    return end_of_record(float(t[stop]), HELD)(observations)


def without_copies(channels: Sequence[Channel], notes: ReadingNotes) -> list[Channel]:
    """Return the channels without pictures that are stored again: every picture as often, or single ones with equal points."""
    t = np.unique(np.concatenate([np.zeros(0), *(c.t for c in channels)]))
    step = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    new = _pattern(channels, t, step) if step > 0 else None
    if new is None:
        bodies = {name: body for body, names in BODIES.items() for name in names}
        together = [[c for c in channels if bodies[c.name] == body] for body in dict.fromkeys(bodies[c.name] for c in channels)]
        return [c for body in together for c in _without_equal_points(body, notes)]
    period, count, first = len(new), int(new.sum()), int(np.argmax(new))
    by_file, even = [], []
    for c in channels:
        number = np.rint((c.t - t[0]) / step).astype(int)
        kept = new[number % period]
        rank = (np.cumsum(new)[number % period] - 1 + count * (number // period))[kept]
        by_file.append(dataclasses.replace(c, t=c.t[kept], value=c.value[kept]))
        # A camera's pictures are even in time, which a film shows twice and three times in turn
        even.append(dataclasses.replace(by_file[-1], t=t[0] + (first + rank * period / count) * step))
    noise = [scatter(c) for c in by_file]
    chosen = min((by_file, even), key=lambda those: sum(scatter(c) / n for c, n in zip(those, noise, strict=True) if n))
    every = f"every picture is stored {period} times" if count == 1 else f"{period} rows show {count} pictures"
    left = sum(map(len, channels)) - sum(map(len, chosen))
    notes.unused[f"{every}: one row of each is kept"] += left
    return chosen


def _pattern(channels: Sequence[Channel], t: Array, step: float) -> NDArray[np.bool_] | None:
    """Return which rows of a period show a new picture; None: there is no such pattern."""
    number, square = np.rint((t - t[0]) / step).astype(int), np.zeros(len(t) - 1)
    for c in channels:
        noise = max(scatter(c), c.last_digit)
        if c.name != "angle_rate" and noise:
            values = np.full(len(t), np.nan)
            values[np.searchsorted(t, c.t)] = c.value / noise
            square += np.diff(values) ** 2
    seen = (np.diff(number) == 1) & np.isfinite(square)
    if not (seen.any() and square[seen].any()):
        return None
    square, place, best = np.where(seen, square, 0.0), number[1:][seen], None
    for period in range(2, MAX_PERIOD + 1):
        turns = np.bincount(place % period, minlength=period)
        if turns.min() < MIN_COPIES:
            break
        # By the largest step nearby, as masses come to rest, and so that a leap of the tracker decides nothing
        share = square / np.maximum(maximum_filter1d(square, 2 * period + 1), np.finfo(float).tiny)
        mean = np.bincount(place % period, weights=share[seen], minlength=period) / turns
        new = mean > STILL * mean.max()
        # Points that are equal in every digit tell more than those that hardly move
        is_seen = turns.min() >= MIN_TURNS or not np.any(mean[~new])
        # Of pictures stored four times, every second one is stored twice, too
        if is_seen and new.any() and not new.all() and (best is None or new.mean() < best.mean()):
            best = new
    return best


def _without_equal_points(body: list[Channel], notes: ReadingNotes) -> list[Channel]:
    """Return a body's channels without points that repeat the one before in every digit, unless by chance."""
    if any(not np.array_equal(c.t, body[0].t) for c in body) or len(body[0]) < MIN_ROWS:
        return body
    values = np.stack([c.value for c in body], axis=1)
    new = np.append(True, np.any(values[1:] != values[:-1], axis=1))
    if new.all() or new.sum() < MIN_NEW:
        return body
    left = [dataclasses.replace(c, t=c.t[new], value=c.value[new]) for c in body]
    # Of rounded points, or of those on a raster such as a picture's pixels, many that are no neighbours are equal, too
    by_chance = max(len(c) - len(np.unique(c.value)) for c in left)
    noise = [scatter(c) for c in left]
    is_fine = (
        n > max(MIN_NOISE * float(np.ptp(c.value)), c.last_digit / MAX_CHANCE_DIGIT) for n, c in zip(noise, left, strict=True)
    )
    if (~new).sum() < max(MIN_COPIES, by_chance) or not all(is_fine):
        return body
    for c in body:
        notes.unused[f"{c.name}: a copy of the point before"] += int(np.sum(~new))
    return left


def with_free_start(study: Study, trial: Trial, observations: Observations) -> Trial:
    """Return a trial whose angle and speed at the first point are free, if it is a held one whose record begins in mid-swing.

    The record is one if it moves at its first point faster than two frames after a release from rest, if that point is later
    than these by its clock, or if no angle of release is stated. Then its motion begins at the first point. A stated angle is
    kept if the first point has it, a stated speed in any case. Without a free start, the trial is returned as it is.
    """
    clock, camera = trial.camera.get("clock_offset"), Camera(**{n: e.value for n, e in trial.camera.items()})
    if trial.release is not Release.HELD or (clock is not None and clock.free):  # then the study looks for the release itself
        return trial
    stated_angle, stated_speed = study.estimate("release_angle", trial), study.estimate("push_across", trial)
    length, gravity = _value(study, trial, "free_length"), _value(study, trial, "gravity")
    start = _start(study, trial, observations, length, gravity)
    if start is None:
        return trial
    first, step, (angle, angle_error), (rate, rate_error) = start
    if stated_angle is not None:
        late = FRAMES_AFTER_RELEASE * step + 2 * ((clock and clock.sigma) or 0.0)
        from_rest = gravity / length * max(abs(math.sin(stated_angle.value)), abs(math.sin(angle))) * late
        is_slow = abs(rate) <= max(from_rest, MIN_SPEED_SIGMAS * rate_error)
        if is_slow and camera.true_time(np.array(first)) <= late:
            return trial
    estimates = dict(trial.estimates)
    sigma = math.hypot((stated_angle and stated_angle.sigma) or 0.0, angle_error)
    if stated_angle is None or not (stated_angle.free or abs(stated_angle.value - angle) <= MAX_ANGLE_SIGMAS * sigma):
        estimates["release_angle"] = Estimate(value=angle, sigma=max(PRIOR_WIDENING * angle_error, MIN_ANGLE_ERROR))
    if stated_speed is None:
        sigma = max(PRIOR_WIDENING * rate_error * length, MIN_SPEED_ERROR * math.sqrt(gravity * length))
        estimates["push_across"] = Estimate(value=rate * length, sigma=sigma)
    clock_of_start = {"clock_offset": Estimate(value=-first * camera.clock_ratio)}
    return dataclasses.replace(trial, estimates=estimates, camera={**trial.camera, **clock_of_start}, in_mid_swing=True)


def _value(study: Study, trial: Trial, name: str) -> float:
    """Return the stated value of a parameter [SI], or the usual one."""
    known = study.estimate(name, trial)
    if known is not None:
        return known.value
    return GRAVITY.coefficients[0].default if name == "gravity" else PLACEHOLDERS[name]


def _start(
    study: Study, trial: Trial, observations: Observations, length: float, gravity: float
) -> tuple[float, float, tuple[float, float], tuple[float, float]] | None:
    """Return time of the first point by the file and step [s], its wrap angle [rad] and its rate [rad/s] with their errors.

    None: there are too few points, or they show no angle. Of angular velocities w alone, the angle phi from the vertical
    follows from torque and energy of a pendulum without losses, with the largest w of its first period:

        sin(phi) = -phi'' l / g        cos(phi) = 1 - (w^2 - phi'^2) l / (2 g).
    """
    channels = {c.name: c for c in observations.channels}
    camera, period = Camera(**{n: e.value for n, e in trial.camera.items()}), 2 * math.pi * math.sqrt(length / gravity)
    is_rate = channels.keys() == {"angle_rate"}
    if is_rate:
        c = channels["angle_rate"]
        t, value, noise = c.t, c.value - camera.rate_offset, estimate_noise((c,)).a
    elif "angle" in channels:
        c = channels["angle"]
        t, value, noise = c.t, c.value + math.pi - camera.tilt, estimate_noise((c,)).a
    elif points := _light_points(observations):
        t, place, of_mass = points
        value = string_coordinates(camera.true_position(place), _value(study, trial, "rod_radius"), math.pi)[1]
        noise = estimate_noise(of_mass).a / length
    else:
        return None
    if len(t) < MIN_POINTS:
        return None
    first, slope = _value_and_slope(t, value, noise, PART_OF_A_PERIOD * period, degree=3 if is_rate else 2)
    step = float(np.median(np.diff(t)))
    if not is_rate:
        return float(t[0]), step, first, slope
    largest = float(np.max(np.abs(value[t <= t[0] + period])))
    sine, cosine = -slope[0] * length / gravity, 1 - (largest**2 - first[0] ** 2) * length / (2 * gravity)
    return float(t[0]), step, (math.pi + math.atan2(sine, cosine), slope[1] * length / gravity), first


def _value_and_slope(
    t: Array, value: Array, noise: float, part: float, degree: int
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return value and slope at the first point with their errors, by a polynomial through the first ``part`` [s]."""
    count = int(np.clip(np.searchsorted(t, t[0] + part, side="right"), MIN_POINTS, MAX_POINTS))
    powers = np.vander(t[:count] - t[0], degree + 1, increasing=True)
    coefficients, *_ = np.linalg.lstsq(powers, value[:count], rcond=None)
    residual = value[:count] - powers @ coefficients
    left = max(math.sqrt(float(residual @ residual) / (len(residual) - degree - 1)), noise)
    errors = left * np.sqrt(np.diag(np.linalg.inv(powers.T @ powers)))
    return (float(coefficients[0]), float(errors[0])), (float(coefficients[1]), float(errors[1]))
