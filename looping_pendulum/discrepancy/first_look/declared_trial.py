"""A trial as the study declares it, and the same without one mistake: other points, or other declared values."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from looping_pendulum.measured import observations as measured
from looping_pendulum.measured.camera import Camera
from looping_pendulum.measured.observations import Channel, Observations
from looping_pendulum.measured.study import Estimate, Study, Trial
from looping_pendulum.reference_ode.geometry import next_string_coordinates
from looping_pendulum.reference_ode.parameters import Release

QUARTER_TURN = math.pi / 2
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

    @property
    def quarter_turns(self) -> int:
        """Return by how many quarter turns, counterclockwise, the picture is declared to be turned; a small tilt is none."""
        tilt = self.trial.camera.get("tilt")
        return 0 if tilt is None else round(tilt.value / QUARTER_TURN)

    def upright(self) -> DeclaredTrial:
        """Return the trial with points and camera turned back by quarter turns, so that y is up but for a small tilt."""
        turns = self.quarter_turns
        if not turns:
            return self
        camera = {}
        for name, known in self.trial.camera.items():
            origin, _, direction = name.rpartition("_")
            if origin == "origin":
                direction, sign = _turned_back(direction, turns)
                camera[f"origin_{direction}"] = dataclasses.replace(known, value=sign * known.value)
            else:
                camera[name] = known
        camera["tilt"] = dataclasses.replace(camera["tilt"], value=camera["tilt"].value - turns * QUARTER_TURN)

        def turn_back(channel: Channel) -> Channel:
            if channel.name == "angle":
                return dataclasses.replace(channel, value=channel.value - turns * QUARTER_TURN)
            body, _, direction = channel.name.partition("_")
            if direction not in ("x", "y"):
                return channel
            direction, sign = _turned_back(direction, turns)
            return dataclasses.replace(channel, name=f"{body}_{direction}", value=sign * channel.value)

        return self.with_trial(dataclasses.replace(self.trial, camera=camera)).with_channels(turn_back)

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


def _turned_back(direction: str, quarter_turns: int) -> tuple[str, float]:
    """Return the axis, "x" or "y", onto which clockwise quarter turns bring an axis, and the sign of its direction there."""
    axis = {"x": 1, "y": 1j}[direction] * (-1j) ** (quarter_turns % 4)
    return ("x", axis.real) if axis.real else ("y", axis.imag)


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


def pictured_otherwise(declared: DeclaredTrial, *, mirror: bool, quarter_turns: int) -> DeclaredTrial | None:
    """Return the trial with a picture that is mirrored, turned or both, beside what the study says of it.

    None: its points do not show whether it is.

    Parameters
    ----------
    mirror
        Whether `Trial.mirrored` is the other one.
    quarter_turns
        Quarter turns that are added to the declared tilt.
    """
    trial = declared.trial
    if not _shows_picture(declared, mirror=mirror, quarter_turns=quarter_turns):
        return None
    camera = dict(trial.camera)
    if quarter_turns:
        tilt = camera.get("tilt", Estimate(value=0.0))
        turned = math.remainder(tilt.value + quarter_turns * QUARTER_TURN, 4 * QUARTER_TURN)
        camera["tilt"] = dataclasses.replace(tilt, value=turned)
    otherwise = declared.with_trial(dataclasses.replace(trial, mirrored=trial.mirrored != mirror, camera=camera))
    return dataclasses.replace(otherwise, observations=measured.mirrored(declared.observations)) if mirror else otherwise


def _shows_picture(declared: DeclaredTrial, *, mirror: bool, quarter_turns: int) -> bool:
    """Return whether points would show that their picture is mirrored or turned so.

    Where they do not show the side on which the light mass begins, a mirrored picture looks as the other one does. Of two that
    look alike, the commoner one is taken: y downwards rather than half a turn, a quarter turn rather than x and y exchanged.
    """
    directions = {c.name.rpartition("_")[2] for c in declared.observations.channels}
    if quarter_turns and not directions >= ({"x", "y"} if quarter_turns % 2 else {"y"}):
        return False
    return _shows_side(declared) or (quarter_turns != 0 and mirror == (quarter_turns % 2 == 0))


def _shows_side(declared: DeclaredTrial) -> bool:
    """Return whether points show on which side of the rod the light mass begins."""
    release, names = declared.trial.release, {c.name for c in declared.observations.channels}
    if release is Release.DROP or (release is Release.HELD and declared.estimate("release_angle") is None):
        return False
    if release is Release.VERTICAL:
        return names >= {"light_x", "heavy_x"}  # the masses hang a rod's diameter apart
    return bool(names & {"light_x", "angle", "angle_rate"})


def with_tracks_exchanged(declared: DeclaredTrial) -> DeclaredTrial | None:
    """Return the trial with the points of both masses exchanged; None: not both were tracked."""
    bodies = {c.name.partition("_")[0] for c in declared.observations.channels}
    if not bodies >= set(OTHER_MASS):
        return None

    def exchange(channel: Channel) -> Channel:
        body, _, direction = channel.name.partition("_")
        return dataclasses.replace(channel, name=f"{OTHER_MASS[body]}_{direction}") if body in OTHER_MASS else channel

    return declared.with_channels(exchange)


def with_columns_exchanged(declared: DeclaredTrial, first: str, second: str) -> DeclaredTrial | None:
    """Return the trial with the values of two channels exchanged; None: not both were tracked."""
    other = {first: second, second: first}
    if not other.keys() <= {c.name for c in declared.observations.channels}:
        return None
    return declared.with_channels(lambda c: dataclasses.replace(c, name=other.get(c.name, c.name)))


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
