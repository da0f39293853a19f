"""Start of a held pendulum's record: its angle and speed at the first tracked point, where the record begins in mid-swing.

Of angular velocities alone, the angle phi from the vertical follows from torque and energy of a pendulum without losses,

    sin(phi) = -phi'' l / g        cos(phi) = 1 - (w^2 - phi'^2) l / (2 g)

with the largest angular velocity w of its first period.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from looping_pendulum.measured.camera import Camera
from looping_pendulum.measured.noise import estimate_noise
from looping_pendulum.measured.observations import Observations
from looping_pendulum.measured.study import PLACEHOLDERS, Estimate, Study, Trial
from looping_pendulum.reference_ode.effects import GRAVITY
from looping_pendulum.reference_ode.geometry import Array, string_coordinates
from looping_pendulum.reference_ode.parameters import Release

PART_OF_A_PERIOD = 0.12
"""Length of the part of the record that shows its start, in periods of a small swing: a parabola is within 1 % of it."""
ANGLE_DEGREE, RATE_DEGREE = 2, 3
"""Degree of the polynomial through the first angles or angular velocities: of these the slope counts, not only the value."""
MIN_POINTS, MAX_POINTS = 5, 60
"""Fewest and most points of that part."""
MIN_SPEED_SIGMAS = 4.0
"""Standard errors by which the speed at the first point must exceed zero."""
FRAMES_AFTER_RELEASE = 2
"""Number of frames after the release at which a record may begin: it is then that of a release from rest."""
PRIOR_WIDENING = 10.0
"""Standard error of the prior, in those of the polynomial, so that few points, which also enter the fit, hardly count twice."""
MIN_ANGLE_ERROR, MIN_SPEED_ERROR = 0.05, 0.05
"""Smallest standard error of the prior of the angle [rad] and of the speed, as a part of sqrt(g l)."""
MAX_ANGLE_SIGMAS = 4.0
"""Standard errors by which the angle at the first point may differ from a stated one, which is otherwise that of a release."""


@dataclass(frozen=True, kw_only=True)
class _Start:
    """Angle and angular velocity at the first point, by a polynomial through the first ones."""

    t: float
    """Time of the first point by the file's clock [s]."""
    step: float
    """Time between points [s]."""
    angle: float
    """Wrap angle [rad]."""
    angle_error: float
    rate: float
    """Its rate [rad/s]."""
    rate_error: float


def with_free_start(study: Study, trial: Trial, observations: Observations) -> Trial:
    """Return a trial whose angle and speed at the first point are free, if it is a held one whose record begins in mid-swing.

    The record is one if it moves at its first point faster than two frames after a release from rest, if that point is later
    than these by its clock, or if no angle of release is stated. Then its motion begins at the first point. A stated angle is
    kept if the first point has it, a stated speed in any case. Without a free start, the trial is returned as it is.
    """
    if trial.release is not Release.HELD:
        return trial
    clock, camera = trial.camera.get("clock_offset"), Camera(**{n: e.value for n, e in trial.camera.items()})
    stated_angle, stated_speed = study.estimate("release_angle", trial), study.estimate("push_across", trial)
    start = _start(study, trial, observations)
    if start is None or (clock is not None and clock.free):  # then the study looks for the release itself
        return trial
    length, gravity = _value(study, trial, "free_length"), _value(study, trial, "gravity")
    if stated_angle is not None:
        late = FRAMES_AFTER_RELEASE * start.step + 2 * ((clock and clock.sigma) or 0.0)
        from_rest = gravity / length * max(abs(math.sin(stated_angle.value)), abs(math.sin(start.angle))) * late
        is_slow = abs(start.rate) <= max(from_rest, MIN_SPEED_SIGMAS * start.rate_error)
        if is_slow and camera.clock_offset + camera.clock_ratio * start.t <= late:
            return trial
    estimates = dict(trial.estimates)
    if stated_angle is None or not _agrees(stated_angle, start):
        sigma = max(PRIOR_WIDENING * start.angle_error, MIN_ANGLE_ERROR)
        estimates["release_angle"] = Estimate(value=start.angle, sigma=sigma)
    if stated_speed is None:
        sigma = max(PRIOR_WIDENING * start.rate_error * length, MIN_SPEED_ERROR * math.sqrt(gravity * length))
        estimates["push_across"] = Estimate(value=start.rate * length, sigma=sigma)
    clock_of_start = {"clock_offset": Estimate(value=-start.t * camera.clock_ratio)}
    return dataclasses.replace(trial, estimates=estimates, camera={**trial.camera, **clock_of_start}, in_mid_swing=True)


def _value(study: Study, trial: Trial, name: str) -> float:
    """Return the stated value of a parameter [SI], or the usual one."""
    known = study.estimate(name, trial)
    if known is not None:
        return known.value
    return GRAVITY.coefficients[0].default if name == "gravity" else PLACEHOLDERS[name]


def _agrees(stated: Estimate, start: _Start) -> bool:
    """Return whether the first point has the stated angle."""
    sigma = math.hypot(stated.sigma or 0.0, start.angle_error)
    return stated.free or abs(stated.value - start.angle) <= MAX_ANGLE_SIGMAS * sigma


def _start(study: Study, trial: Trial, observations: Observations) -> _Start | None:
    """Return the start by the first points; None: there are too few, or they show no angle."""
    length, gravity = _value(study, trial, "free_length"), _value(study, trial, "gravity")
    is_rate = [c.name for c in observations.channels] == ["angle_rate"]
    if is_rate:
        (rates,) = observations.channels
        offset = trial.camera.get("rate_offset")
        t, value, noise = rates.t, rates.value - (offset.value if offset else 0.0), estimate_noise((rates,)).a
    else:
        t, value, noise = _angles(study, trial, observations, length)
    if len(t) < MIN_POINTS:
        return None
    period = 2 * math.pi * math.sqrt(length / gravity)
    (first, slope), (error, slope_error) = _value_and_slope(
        t, value, noise, PART_OF_A_PERIOD * period, RATE_DEGREE if is_rate else ANGLE_DEGREE
    )
    angle, angle_error, rate, rate_error = first, error, slope, slope_error
    if is_rate:
        largest = float(np.max(np.abs(value[t <= t[0] + period])))
        sine, cosine = -slope * length / gravity, 1 - (largest**2 - first**2) * length / (2 * gravity)
        angle, angle_error, rate, rate_error = math.pi + math.atan2(sine, cosine), slope_error * length / gravity, first, error
    return _Start(
        t=float(t[0]), step=float(np.median(np.diff(t))),
        angle=angle, angle_error=angle_error, rate=rate, rate_error=rate_error,
    )  # fmt: skip


def _value_and_slope(t: Array, value: Array, noise: float, part: float, degree: int) -> tuple[list[float], list[float]]:
    """Return value and slope at the first point, and their errors, by a polynomial through the first ``part`` [s]."""
    count = int(np.clip(np.searchsorted(t, t[0] + part, side="right"), MIN_POINTS, MAX_POINTS))
    powers = np.vander(t[:count] - t[0], degree + 1, increasing=True)
    coefficients, *_ = np.linalg.lstsq(powers, value[:count], rcond=None)
    residual = value[:count] - powers @ coefficients
    scatter = max(math.sqrt(float(residual @ residual) / (len(residual) - degree - 1)), noise)
    errors = scatter * np.sqrt(np.diag(np.linalg.inv(powers.T @ powers)))
    return coefficients[:2].tolist(), errors[:2].tolist()


def _angles(study: Study, trial: Trial, observations: Observations, length: float) -> tuple[Array, Array, float]:
    """Return the times of the light mass's points by the file's clock [s], its wrap angles [rad] and their noise [rad]."""
    channels = {c.name: c for c in observations.channels}
    camera = Camera(**{n: e.value for n, e in trial.camera.items()})
    if "angle" in channels:
        c = channels["angle"]
        return c.t, c.value + math.pi - camera.tilt, estimate_noise((c,)).a
    if not {"light_x", "light_y"} <= channels.keys():
        return np.zeros(0), np.zeros(0), 0.0
    x, y = channels["light_x"], channels["light_y"]
    t, in_x, in_y = np.intersect1d(x.t, y.t, return_indices=True)
    position = camera.true_position(np.stack([x.value[in_x], y.value[in_y]], axis=1))
    _, angle = string_coordinates(position, _value(study, trial, "rod_radius"), math.pi)
    return t, angle, estimate_noise((x, y)).a / length
