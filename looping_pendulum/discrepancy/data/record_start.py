"""Start of a held pendulum's record: its angle and speed at the first tracked point, where the record begins in mid-swing."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from looping_pendulum.discrepancy.data.camera import Camera
from looping_pendulum.discrepancy.data.noise import estimate_noise
from looping_pendulum.discrepancy.data.observations import Observations
from looping_pendulum.discrepancy.data.study import PLACEHOLDERS, Estimate, Study, Trial
from looping_pendulum.reference_ode.effects import GRAVITY
from looping_pendulum.reference_ode.geometry import Array, string_coordinates
from looping_pendulum.reference_ode.parameters import Release

PART_OF_A_PERIOD = 0.12
"""Length of the part of the record that shows its start, in periods of a small swing: a parabola is within 1 % of it."""
MIN_POINTS, MAX_POINTS = 5, 60
"""Fewest and most points of that part."""
MIN_SPEED_SIGMAS = 4.0
"""Standard errors by which the speed at the first point must exceed zero."""
FRAMES_AFTER_RELEASE = 2
"""Number of frames after the release at which a record may begin: it is then that of a release from rest."""
PRIOR_WIDENING = 10.0
"""Standard error of the prior, in those of the parabola, so that the few points that also enter the fit hardly count twice."""
MIN_ANGLE_ERROR, MIN_SPEED_ERROR = 0.05, 0.05
"""Smallest standard error of the prior of the angle [rad] and of the speed, as a part of sqrt(g l)."""
MAX_ANGLE_SIGMAS = 4.0
"""Standard errors by which the angle at the first point may differ from a stated one, which is otherwise that of a release."""


@dataclass(frozen=True, kw_only=True)
class _Start:
    """Parabola through the first points, at the first one."""

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

    The record is one if it moves at its first point faster than two frames after a release from rest, or if no angle of
    release is stated. Then its motion begins at the first point. A stated angle is kept if the first point has it, a stated
    speed in any case. Without a free start, the trial is returned as it is.
    """
    if trial.release is not Release.HELD:
        return trial
    clock = trial.camera.get("clock_offset")
    stated_angle, stated_speed = study.estimate("release_angle", trial), study.estimate("push_across", trial)
    start = _start(study, trial, observations)
    if start is None or (clock is not None and clock.free):  # then the study looks for the release itself
        return trial
    length, gravity = _value(study, trial, "free_length"), _value(study, trial, "gravity")
    if stated_angle is not None:
        late = FRAMES_AFTER_RELEASE * start.step + 2 * ((clock and clock.sigma) or 0.0)
        from_rest = gravity / length * max(abs(math.sin(stated_angle.value)), abs(math.sin(start.angle))) * late
        if abs(start.rate) <= max(from_rest, MIN_SPEED_SIGMAS * start.rate_error):
            return trial
    estimates = dict(trial.estimates)
    if stated_angle is None or not _agrees(stated_angle, start):
        sigma = max(PRIOR_WIDENING * start.angle_error, MIN_ANGLE_ERROR)
        estimates["release_angle"] = Estimate(value=start.angle, sigma=sigma)
    if stated_speed is None:
        sigma = max(PRIOR_WIDENING * start.rate_error * length, MIN_SPEED_ERROR * math.sqrt(gravity * length))
        estimates["push_across"] = Estimate(value=start.rate * length, sigma=sigma)
    ratio = trial.camera["clock_ratio"].value if "clock_ratio" in trial.camera else 1.0
    camera = {**trial.camera, "clock_offset": Estimate(value=-start.t * ratio)}
    return dataclasses.replace(trial, estimates=estimates, camera=camera, in_mid_swing=True)


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
    """Return the parabola through the first points; None: there are too few, or they show no angle."""
    length, gravity = _value(study, trial, "free_length"), _value(study, trial, "gravity")
    t, angle, noise = _angles(study, trial, observations, length)
    if len(t) < MIN_POINTS:
        return None
    part = PART_OF_A_PERIOD * 2 * math.pi * math.sqrt(length / gravity)
    count = int(np.clip(np.searchsorted(t, t[0] + part, side="right"), MIN_POINTS, MAX_POINTS))
    t, angle = t[:count], angle[:count]
    powers = np.vander(t - t[0], 3, increasing=True)
    coefficients, *_ = np.linalg.lstsq(powers, angle, rcond=None)
    residual = angle - powers @ coefficients
    scatter = max(math.sqrt(float(residual @ residual) / (len(t) - 3)), noise)
    errors = scatter * np.sqrt(np.diag(np.linalg.inv(powers.T @ powers)))
    return _Start(
        t=float(t[0]),
        step=float(np.median(np.diff(t))),
        angle=float(coefficients[0]),
        angle_error=float(errors[0]),
        rate=float(coefficients[1]),
        rate_error=float(errors[1]),
    )


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
