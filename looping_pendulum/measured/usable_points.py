"""How long a trial shows a mass on a string: until the light mass touches the rod, or something other than its string stops it.

With phi the bearing at which the string leaves the rod and l the free length, the light mass moves across the string at
W = l phi'. Whatever the string does, taut or slack, it pulls along itself alone, so that across it

    W' + (l' + R phi') phi' = g sin(phi) + (all other forces) / M1,

where the second term turns speed along the string into speed across it. What W keeps of this balance is

    U = W + integral of (l' + R phi') dphi - integral of g sin(phi) dt,

which string and gravity leave as it is, and the air and all effects of the library change slowly. A hand, a wall or a knot ends
it within some hundredths of a second.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, median_filter

from looping_pendulum.measured.camera import Camera
from looping_pendulum.measured.noise import estimate_noise, speed_at
from looping_pendulum.measured.observations import Channel, Observations, UnusedValues
from looping_pendulum.measured.study import Estimate, Study, Trial, read_files
from looping_pendulum.processes import ReportShare
from looping_pendulum.reference_ode.effects import GRAVITY
from looping_pendulum.reference_ode.geometry import Array, string_coordinates
from looping_pendulum.reference_ode.parameters import Release

MAX_OTHER_FORCE = 2.0
"""Largest force on the light mass beside its string's, in its weights: air and magnets stay far below, a hand is far above."""
SPEED_TIME = 8e-3
"""Time over which a speed is measured [s], and a step between points at least."""
SIGMAS = 5.0
"""Change of U, in standard errors, that noise does not reach in any trial."""
SPEED_POINTS, LEAP = 7, 1.5
"""Steps of which the usual speed is the median, and how many times that a leap departs from the steps beside it.

A rebound departs by one, a turn of the string by a radian in a step by less.
"""
SPEED_WINDOWS = 4
"""Windows of time on either side of a stop in which a single wrong point may make it up."""
LEAST_RESTING, LEAST_MOVING = 4, 25
"""Fewest points of a mass that rests, and of one that moves whose noise is estimated."""
TOUCH_SIGMAS = 2.0
"""Standard errors of its distance by which the ball is clear of the rod as long as its points are used."""
MAX_TURN = 2.5
"""Turn of the string from one point to the next up to which its sense is known [rad]; half a turn has two."""


def read_trial(study: Study, trial: Trial, progress: ReportShare | None = None) -> Observations:
    """Read the files of a trial of ``study``, as `read_files` does, up to where something holds the light mass for good."""
    rod = study.estimate("rod_radius", trial)
    return until_held(study, trial, read_files(study.folder, trial, None if rod is None else rod.value, progress))


def with_ball(study: Study, trial: Trial, observations: Observations) -> Trial:
    """Return a trial with the light mass's radius, stated or as its film shows it, as exact.

    It ends the run, and no point from there on is used: a fit could not tell it.
    """
    radius = _radius(study, trial, observations)
    if radius is None:
        return trial
    return dataclasses.replace(trial, estimates={**trial.estimates, "light_radius": Estimate(value=radius[0])})


def _radius(study: Study, trial: Trial, observations: Observations) -> tuple[float, float] | None:
    """Return the light mass's radius and its standard error [m]; None if it is not known, or counts for nothing."""
    if trial.release not in (Release.LOOPING, Release.VERTICAL):
        return None
    stated = study.estimate("light_radius", trial)
    if stated is None:
        return observations.light_radius
    return None if stated.free else (stated.value, stated.sigma or 0.0)


def until_held(study: Study, trial: Trial, observations: Observations) -> Observations:
    """Return the usable observations of a record at whose end something holds the light mass, and any other as it is.

    That a mass stands still is beyond doubt, and what follows tells nothing of the clock. A change of speed alone may also be a
    mistake of clock, columns or tracker, which only all points tell.
    """
    record = _Record.of(study, trial, observations)
    if record is None or record.rests is None:
        return observations
    return usable_points(study, trial, observations)


def usable_points(study: Study, trial: Trial, observations: Observations) -> Observations:
    """Return the observations without the points from which on the light mass is no point mass on a string.

    Points of both masses end there: without the light mass's pull, the string holds the heavy one no longer.
    """
    record = _Record.of(study, trial, observations)
    if record is None:
        return observations
    priors = study.camera_priors(trial, observations)
    origin_error = math.hypot(*(priors[n].sigma or 0.0 for n in ("origin_x", "origin_y"))) / math.sqrt(2)
    t, place, rests = record.t, record.place, record.rests
    end = math.inf if rests is None else float(t[rests])
    # Points at rest show little of the noise of those that move; what neighbouring points share changes no speed
    error = np.maximum(record.noise(end), record.least(Channel.rounding_sigma))
    clear = np.ones(len(t), dtype=bool)
    if record.radius > 0:
        sigma = np.sqrt(error**2 + origin_error**2 + record.radius_error**2)
        is_near = np.hypot(*place.T) < record.rod_radius + record.radius + TOUCH_SIGMAS * sigma
        touching = np.flatnonzero(is_near & np.append(is_near[1:], True))  # a single one may be a wrong point
        if len(touching):
            clear = t < t[touching[0]]
            end = min(end, float(t[touching[0]]))
    stop = stopped_at(record.true_time[clear], place[clear], error[clear], record.rod_radius, origin_error, record.gravity)
    if stop is not None:
        end = min(end, float(t[stop]))
    if math.isinf(end):
        return observations
    rests_at_rod = rests is not None and _is_at_rod(place[rests:], record.rod_radius, record.radius)
    if rests_at_rod or (stop is None and not clear.all()):
        why = f"the light mass, {1e3 * record.radius:.3g} mm in radius, is at the rod, where it is no point any more"
    else:
        why = "something other than its string stops the light mass: a hand, a wall, a knot"
    return _until(observations, end, why)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Record:
    """The light mass's way in a trial."""

    channels: tuple[Channel, Channel]
    """x and y."""
    used: tuple[NDArray[np.intp], NDArray[np.intp]]
    """Their values of the same times."""
    t: Array
    """These times by the file's clock [s], shape (n,)."""
    true_time: Array
    place: Array
    """From the rod's centre [m], shape (n, 2)."""
    rod_radius: float
    radius: float
    """Of the light mass [m]; 0: not known, or it counts for nothing."""
    radius_error: float
    gravity: float
    """[m/s^2]"""

    @classmethod
    def of(cls, study: Study, trial: Trial, observations: Observations) -> _Record | None:
        """Return that of a trial; None if its points do not tell it."""
        channels = {c.name: c for c in observations.channels}
        rod, gravity = study.estimate("rod_radius", trial), study.estimate("gravity", trial)
        if (
            trial.release not in (Release.LOOPING, Release.VERTICAL)
            or rod is None
            or not {"light_x", "light_y"} <= channels.keys()
        ):
            return None
        x, y = channels["light_x"], channels["light_y"]
        t, *used = np.intersect1d(x.t, y.t, return_indices=True)
        if len(t) < LEAST_MOVING:
            return None
        camera = Camera(**{n: e.value for n, e in trial.camera.items()})
        radius, radius_error = _radius(study, trial, observations) or (0.0, 0.0)
        return cls(
            channels=(x, y), used=(used[0], used[1]), t=t, true_time=camera.true_time(t),
            place=camera.true_position(np.stack([c.value[k] for c, k in zip((x, y), used, strict=True)], axis=1)),
            rod_radius=rod.value, radius=radius, radius_error=radius_error,
            gravity=GRAVITY.coefficients[0].default if gravity is None else gravity.value,
        )  # fmt: skip

    def noise(self, end: float = math.inf) -> Array:
        """Return the errors of the points [m] by the noise of those before ``end``, if there are enough, shape (n,)."""
        moving = tuple(_before(c, end) for c in self.channels)
        law = estimate_noise(moving if min(map(len, moving)) >= LEAST_MOVING else self.channels)
        return law.sigma(speed_at(self.channels, self.t, law.a))

    def least(self, of: Callable[[Channel, Array], Array]) -> Array:
        """Return the errors that a method of the channels states for the points at least [m], shape (n,)."""
        return np.maximum(*(of(c, speed_at(self.channels, c.t))[k] for c, k in zip(self.channels, self.used, strict=True)))

    @cached_property
    def rests(self) -> int | None:
        """The first point from which on the light mass stands still to the end, as something holds it; None: it does not."""
        error = np.maximum(self.noise(), self.least(Channel.least_sigma))
        return rests_from(self.true_time, self.place, error, self.rod_radius, self.radius, self.gravity)


def _before(c: Channel, end: float) -> Channel:
    n = int(np.searchsorted(c.t, end))
    return dataclasses.replace(c, t=c.t[:n], value=c.value[:n])


def _is_at_rod(rest: Array, rod_radius: float, radius: float) -> bool:
    """Return whether a ball that rests at points (n, 2) is as near to the rod as it is large: string may lie between."""
    return float(np.hypot(*np.median(rest, axis=0))) < rod_radius + 2 * radius


def rests_from(t: Array, place: Array, error: Array, rod_radius: float, radius: float, gravity: float) -> int | None:
    """Return the first point from which on the light mass stands still to the end, as something holds it; None: it does not.

    A hand holds it if its weight alone would have moved it visibly by then, which it does not where it hangs.
    """
    is_off = np.hypot(*(place - np.median(place[-LEAST_RESTING:], axis=0)).T) > SIGMAS * error
    off = np.flatnonzero(is_off & np.append(is_off[1:], True))  # a single one may be a wrong point
    begins = int(off[-1]) + 1 if len(off) else 0
    begins += int(begins < len(t) and bool(is_off[begins]))
    if begins == 0 or len(t) - begins < LEAST_RESTING:
        return None
    rest = place[begins:]
    _, phi = string_coordinates(rest, rod_radius, 0.0)
    pull = 1.0 if _is_at_rod(rest, rod_radius, radius) else abs(math.sin(float(np.median(phi))))
    way = 0.5 * gravity * pull * (t[-1] - t[begins]) ** 2
    return begins if way > 2 * SIGMAS * float(np.max(error[begins:])) else None


def _until(observations: Observations, end: float, why: str) -> Observations:
    """Return the observations before a time by the file's clock [s]."""
    channels = tuple(_before(c, end) for c in observations.channels)
    count = sum(map(len, observations.channels)) - sum(map(len, channels))
    left_out = UnusedValues(count=count, reason=f"from {end:.3f} s on {why}")
    return dataclasses.replace(observations, channels=channels, unused=(*observations.unused, left_out))


def stopped_at(t: Array, place: Array, error: Array, rod_radius: float, origin_error: float, gravity: float) -> int | None:
    """Return the first point at which something other than its string may act on the light mass; None: nothing does.

    No single point decides it: one without which nothing is seen is wrong, and is left out. Nor does a leap, by which a tracker
    comes to another thing and perhaps back: the parts of the track are looked at apart.

    Parameters
    ----------
    t
        True times [s], ascending, shape (n,).
    place
        Light mass from the rod's centre [m], shape (n, 2).
    error
        Standard errors of each coordinate [m], shape (n,).
    origin_error
        Standard error of the rod's centre [m].
    gravity
        [m/s^2]
    """
    velocity = np.diff(place, axis=0) / np.diff(t)[:, None]
    beside = np.pad(velocity, ((1, 1), (0, 0)), mode="edge")
    departure = np.hypot(*(velocity - 0.5 * (beside[:-2] + beside[2:])).T)
    # Where the mass stops, that of before
    usual = maximum_filter1d(median_filter(np.hypot(*velocity.T), SPEED_POINTS, mode="nearest"), SPEED_POINTS)
    is_leap = departure > LEAP * usual + 2 * SIGMAS * np.maximum(error[1:], error[:-1]) / np.diff(t)
    parts = np.split(np.arange(len(t)), np.flatnonzero(is_leap) + 1)
    stops = (_first_stop(part, t, place, error, rod_radius, origin_error, gravity) for part in parts)
    return next((stop for stop in stops if stop is not None), None)


def _first_stop(
    kept: NDArray[np.intp], t: Array, place: Array, error: Array, rod_radius: float, origin_error: float, gravity: float
) -> int | None:
    """Return the same of the points ``kept``, among which there is no leap."""

    def stop(points: NDArray[np.intp]) -> float:
        return _stop(t[points], place[points], error[points], rod_radius, origin_error, gravity)

    while math.isfinite(end := stop(kept)):
        near = np.flatnonzero(np.abs(t[kept] - end) <= SPEED_WINDOWS * _window(t[kept])[1])
        later = [stop(np.delete(kept, k)) for k in near]
        wrong = int(np.argmax(later))
        if later[wrong] <= t[kept[near[-1]]]:
            return int(np.searchsorted(t, end))
        kept = np.delete(kept, near[wrong])
    return None


def _window(t: Array) -> tuple[int, float]:
    """Return the number of steps over which a speed is measured, and the time that they take [s]."""
    step = float(np.median(np.diff(t)))
    window = max(round(SPEED_TIME / step), 1)
    return window, window * step


def _stop(t: Array, place: Array, error: Array, rod_radius: float, origin_error: float, gravity: float) -> float:
    """Return the time of the first change that only another force explains, one window earlier [s]; infinite: there is none."""
    if len(t) < 6:
        return math.inf
    length, phi = string_coordinates(place, rod_radius, float(np.arctan2(place[0, 1], place[0, 0])))
    dt, turn = np.diff(t), np.diff(phi)
    # Exactly so where the string winds up on the rod
    across = 0.5 * (length[1:] + length[:-1]) * turn
    # What string and gravity take of the speed across the string
    taken = (np.diff(length) + rod_radius * turn) / dt * turn - gravity * np.sin(0.5 * (phi[1:] + phi[:-1])) * dt
    way, taken = (np.concatenate([[0.0], np.cumsum(steps)]) for steps in (across, taken))
    undersampled = np.flatnonzero(np.abs(turn) > MAX_TURN)
    end = int(undersampled[0]) + 1 if len(undersampled) else len(t)
    window, _ = _window(t)
    k = np.arange(2 * window, end - 2 * window)

    def kept_speed(first: NDArray[np.intp], last: NDArray[np.intp]) -> Array:
        """Return the mean of U between two points."""
        return np.asarray((way[last] - way[first]) / (t[last] - t[first]) + 0.5 * (taken[first] + taken[last]))

    change = kept_speed(k + window, k + 2 * window) - kept_speed(k - 2 * window, k - window)
    span = t[k + 2 * window] - t[k - 2 * window]
    turning = np.abs(phi[k + 2 * window] - phi[k - 2 * window]) / span
    sigma = np.hypot(8 * error[k] / span, turning * origin_error)
    excess = change / (MAX_OTHER_FORCE * gravity * 0.75 * span + SIGMAS * sigma)
    found = np.flatnonzero((np.abs(excess[:-1]) > 1) & (np.abs(excess[1:]) > 1) & (excess[:-1] * excess[1:] > 0))
    return float(t[k[found[0]] - window]) if len(found) else math.inf
