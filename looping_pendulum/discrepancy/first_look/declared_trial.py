"""A trial as the study declares it, and the same without one mistake: other points, or other declared values."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from looping_pendulum.discrepancy.data import observations as measured
from looping_pendulum.discrepancy.data.camera import Camera
from looping_pendulum.discrepancy.data.observations import Channel, Observations
from looping_pendulum.discrepancy.data.study import Estimate, Study, Trial
from looping_pendulum.reference_ode.geometry import next_string_coordinates

OTHER_MASS = {"light": "heavy", "heavy": "light"}
MIN_UNIT_FACTOR = 1.4
"""Smallest factor on lengths or times, or inverse of one, that is no error of measurement; a scale's may be smaller."""
MIN_ANGLE_DIFFERENCE = math.radians(5)
"""Smallest difference of two release angles that is no error of measurement [rad]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DeclaredTrial:
    """One trial of a study with its observations."""

    study: Study
    """Study that has this trial alone, as one to be fitted."""
    observations: Observations

    @property
    def trial(self) -> Trial:
        """Return the trial itself."""
        return self.study.trials[0]

    def estimate(self, parameter: str) -> Estimate | None:
        """Return the declared value of a parameter; None: there is none."""
        return self.study.estimate(parameter, self.trial)

    def with_trial(self, trial: Trial) -> DeclaredTrial:
        """Return the same points with another declaration of their trial."""
        return dataclasses.replace(self, study=dataclasses.replace(self.study, trials=(trial,)))

    def with_channels(self, change: Callable[[Channel], Channel]) -> DeclaredTrial:
        """Return the same declaration with every channel changed."""
        channels = tuple(change(c) for c in self.observations.channels)
        return dataclasses.replace(self, observations=dataclasses.replace(self.observations, channels=channels))

    def with_values(self, values: dict[str, float]) -> DeclaredTrial | None:
        """Return the same points with other declared values [SI]; None: the study does not state them, or leaves them open."""
        estimates = dict(self.trial.estimates)
        for parameter, value in values.items():
            known = self.estimate(parameter)
            if known is None or known.free:
                return None
            # An angle's standard error does not grow with the angle, those of masses and lengths do
            ratio = 1.0 if parameter == "release_angle" else abs(value / known.value)
            sigma = None if known.sigma is None else known.sigma * ratio
            estimates[parameter] = Estimate(value=value, sigma=sigma)
        return self.with_trial(dataclasses.replace(self.trial, estimates=estimates))


def declared_trial(study: Study, trial: Trial, observations: Observations) -> DeclaredTrial:
    """Return one trial of a study by itself, held out or not."""
    alone = dataclasses.replace(trial, held_out=False)
    return DeclaredTrial(study=dataclasses.replace(study, trials=(alone,)), observations=observations)


def with_times(declared: DeclaredTrial, factor: float) -> DeclaredTrial:
    """Return the trial with its points' times multiplied by ``factor``."""
    return declared.with_channels(lambda c: dataclasses.replace(c, t=c.t * factor))


def with_lengths(declared: DeclaredTrial, factor: float) -> DeclaredTrial:
    """Return the trial with its points' lengths multiplied by ``factor``."""
    return declared.with_channels(lambda c: dataclasses.replace(c, value=c.value * factor) if c.unit == "m" else c)


def mirrored(declared: DeclaredTrial) -> DeclaredTrial:
    """Return the trial as seen from the other side."""
    return dataclasses.replace(declared, observations=measured.mirrored(declared.observations))


def upside_down(declared: DeclaredTrial) -> DeclaredTrial | None:
    """Return the trial with heights measured downwards; None: no heights were measured."""
    if not any(c.name.endswith("_y") for c in declared.observations.channels):
        return None
    return declared.with_channels(lambda c: dataclasses.replace(c, value=-c.value) if c.name.endswith("_y") else c)


def with_tracks_exchanged(declared: DeclaredTrial) -> DeclaredTrial | None:
    """Return the trial with the points of both masses exchanged; None: not both were tracked."""
    bodies = {c.name.partition("_")[0] for c in declared.observations.channels}
    if not bodies >= set(OTHER_MASS):
        return None

    def exchange(channel: Channel) -> Channel:
        body, _, direction = channel.name.partition("_")
        return dataclasses.replace(channel, name=f"{OTHER_MASS[body]}_{direction}") if body in OTHER_MASS else channel

    return declared.with_channels(exchange)


def with_masses_exchanged(declared: DeclaredTrial) -> DeclaredTrial | None:
    """Return the trial with the declared masses exchanged; None: one of them is not declared."""
    light, heavy = declared.estimate("light_mass"), declared.estimate("heavy_mass")
    if light is None or heavy is None:
        return None
    return declared.with_values({"light_mass": heavy.value, "heavy_mass": light.value})


def released_where_first_seen(declared: DeclaredTrial) -> DeclaredTrial | None:
    """Return the trial released from where the light mass's first point is, as seen from the declared origin.

    None: the trial may have begun elsewhere, it was declared about there, or the place was not tracked.
    """
    trial = declared.trial
    channels = {c.name: c for c in declared.observations.channels}
    length, angle = (declared.estimate(name) for name in ("free_length", "release_angle"))
    if trial.in_mid_swing or not {"light_x", "light_y"} <= channels.keys() or length is None or angle is None:
        return None
    camera = Camera(**{name: estimate.value for name, estimate in trial.camera.items()})
    first = np.array([[channels["light_x"].value[0], channels["light_y"].value[0]]])
    ((x, y),) = camera.true_position(first).tolist()
    rod_radius = declared.study.parameters({}, trial).rod_radius
    seen_length, seen_angle = next_string_coordinates(x, y, rod_radius, angle.value)
    values = {}
    if not 1 / MIN_UNIT_FACTOR < seen_length / length.value < MIN_UNIT_FACTOR:
        values["free_length"] = seen_length
    if abs(seen_angle - angle.value) > MIN_ANGLE_DIFFERENCE:
        values["release_angle"] = seen_angle % (2 * math.pi)
    return declared.with_values(values) if values else None
