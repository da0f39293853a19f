"""A study: trials, measured values of the apparatus with their errors, and the effects that are declared to act."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from looping_pendulum.measured.camera import CAMERA
from looping_pendulum.measured.free_parameter import FreeParameter
from looping_pendulum.measured.observations import (
    DataError,
    Observations,
    merge,
    mirrored,
    rates_from_release,
    with_event_errors,
)
from looping_pendulum.reference_ode import effects as effect_library
from looping_pendulum.reference_ode.effects import Coefficient, Effect
from looping_pendulum.reference_ode.effects.own import OwnEffect
from looping_pendulum.reference_ode.parameters import Parameters, Release, effect_tables, is_possible
from looping_pendulum.scenarios.quantities import APPARATUS, QUANTITIES

if TYPE_CHECKING:
    from looping_pendulum.processes import ReportShare

RELEASE = ("release_angle", "free_length", "hanging_length", "push_across")
"""Parameters of a release; a study gives the speed of a push with them, not under ``effects``."""
FREE_SCALE = 1 / 3
"""Scale of a parameter that was not measured, relative to its initial value."""
PLACEHOLDERS = MappingProxyType(
    {"light_mass": 1.0, "heavy_mass": 1.0, "rod_radius": 1e-6, "free_length": 1.0, "release_angle": 0.5 * math.pi}
)
"""Values for parameters that a release does not depend on [SI]: a held pendulum's pivot is a rod of almost no thickness."""
REQUIRED = MappingProxyType(
    {
        Release.LOOPING: ("light_mass", "heavy_mass", "rod_radius", "release_angle", "free_length"),
        Release.VERTICAL: ("light_mass", "heavy_mass", "rod_radius", "free_length"),
        Release.HELD: ("light_mass", "free_length"),
        Release.DROP: (),
    }
)
"""Release -> parameters that must have been measured. A drop needs the dropped mass, which its trial names.

The angle of a held pendulum follows from its first points, if it is not stated.
"""
_EFFECT_OF = MappingProxyType({c.name: effect for effect in effect_library.EFFECTS.values() for c in effect.coefficients})
"""Coefficient -> its effect."""


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """Measured value of one parameter with its standard error, or an initial value if nothing is known."""

    value: float
    """Measured value, or initial value of a free parameter [SI]."""
    sigma: float | None = None
    """Standard error [SI]; None: the value is exact, or free."""
    free: bool = False
    """Whether nothing is known of the parameter, so that only the fit determines it."""

    @property
    def uncertain(self) -> bool:
        """Return whether a fit may change the value."""
        return self.free or self.sigma is not None


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One trial: its files, its release and its camera."""

    name: str
    files: tuple[tuple[str, Mapping[str, str]], ...]
    """Path from the study's folder, and mass -> name of its track in that file (an empty name: the only track)."""
    events: str | None = None
    """Path of a table of events beside the files; a table that stands alone is one of `files`."""
    kind: str = "auto"
    """Kind of the files, one of `readers.KINDS`."""
    frame_rate: float | None = None
    """True frame rate [Hz]."""
    clip_rate: float | None = None
    """Frame rate that the file's times were computed with [Hz]."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Units of columns whose header names none, by "length", "time" and "angle"."""
    run: str | None = None
    """Number of the run or drop, if the file has several."""
    dropped: str = "heavy"
    """Mass that a channel "height" shows."""
    mirrored: bool = False
    """Whether the camera stood on the other side, where the light mass is seen to loop the other way."""
    held_out: bool = False
    """Whether the trial is kept from all fits, to judge them by."""
    in_mid_swing: bool = False
    """Whether the motion begins at the first tracked point, in mid-swing (`record_start`); the data decide, not the study."""
    release: Release = Release.LOOPING
    estimates: Mapping[str, Estimate] = field(default_factory=dict)
    """Parameter -> measured value in this trial: of the release, and of parts that differ from the apparatus."""
    camera: Mapping[str, Estimate] = field(default_factory=dict)
    """Camera parameter -> estimate that replaces the usual prior."""
    event_errors: Mapping[str, float] = field(default_factory=dict)
    """SI unit -> standard error of the events of that unit [SI]."""


EARTH_GRAVITY = (9.764, 9.834)
"""Smallest and largest acceleration of free fall on the Earth's surface [m/s^2].

On Huascaran and on the Arctic Ocean (Hirt et al., Geophys. Res. Lett. 40 (2013) 4279).
"""


@dataclass(frozen=True, kw_only=True)
class ExperimentLimits:
    """Limits of trials that the experimenter could do next; None: no limit."""

    release_angle: tuple[float, float] | None = None
    """Smallest and largest release angle [rad]."""
    mass_ratio: tuple[float, float] | None = None
    """Smallest and largest ratio M2/M1."""
    releases: tuple[Release, ...] = tuple(Release)
    """Kinds of release that are possible."""


@dataclass(frozen=True, kw_only=True)
class Study:
    """Trials of one apparatus, with the measured values and effects that are declared for it."""

    name: str
    title: str
    folder: Path = field(compare=False)
    """Folder that the trials' paths are relative to."""
    apparatus: Mapping[str, Estimate]
    """Parameter of the apparatus -> its measured value."""
    effects: Mapping[str, Estimate]
    """Coefficient of a declared effect -> its value."""
    own_effects: tuple[OwnEffect, ...] = ()
    """Effects that the library lacks; candidates, as those of the library are, unless `effects` declares them."""
    fit: tuple[str, ...] | None = None
    """Parameters and coefficients that may be fitted; None: all that are free or have a standard error."""
    trials: tuple[Trial, ...]
    limits: ExperimentLimits = ExperimentLimits()
    gravity_range: tuple[float, float] = EARTH_GRAVITY
    """Smallest and largest acceleration of free fall that there may be where the trials were made [m/s^2]."""

    def trial(self, name: str) -> Trial:
        """Return the trial of that name."""
        return next(t for t in self.trials if t.name == name)

    @property
    def training(self) -> tuple[Trial, ...]:
        """Return the trials that are fitted."""
        return tuple(t for t in self.trials if not t.held_out)

    @property
    def held_out(self) -> tuple[Trial, ...]:
        """Return the trials on which the error before and after is judged."""
        return tuple(t for t in self.trials if t.held_out)

    @property
    def declared(self) -> tuple[str, ...]:
        """Return the names of the declared effects; gravity is always one."""
        return tuple(
            e.name for e in self.known_effects if e.name == "gravity" or any(c.name in self.effects for c in e.coefficients)
        )

    @property
    def known_effects(self) -> tuple[Effect, ...]:
        """Return the effects of the library and the study's own."""
        return effect_tables(self.own_effects).effects

    @cached_property
    def coefficients(self) -> dict[str, Coefficient]:
        """Return every coefficient of every known effect, by name."""
        return {c.name: c for effect in self.known_effects for c in effect.coefficients}

    def estimate(self, parameter: str, trial: Trial) -> Estimate | None:
        """Return the value of a parameter or coefficient in a trial; None: there is none, and the release does not need it."""
        # A trial's own value comes first: a part may have been exchanged for it
        return trial.estimates.get(parameter) or self.apparatus.get(parameter) or self.effects.get(parameter)

    def free_parameters(self, trials: tuple[Trial, ...] | None = None) -> tuple[FreeParameter, ...]:
        """Return every parameter of the model that a fit of ``trials`` (default: the training trials) changes, each once."""
        free: dict[str, FreeParameter] = {}
        for trial in self.training if trials is None else trials:
            for parameter, name in self._names[trial.name].items():
                known = self.estimate(parameter, trial)
                assert known is not None
                before = free[name].trials if name in free else ()
                free[name] = FreeParameter(
                    name=name,
                    parameter=parameter,
                    trials=(*before, trial.name),
                    init_value=known.value,
                    # An initial value of zero has no size to take a share of
                    scale=known.sigma or FREE_SCALE * abs(known.value) or 1e-3,
                    prior=1.0 if known.sigma else None,
                    bounds=self._bounds(parameter),
                )
        return tuple(free.values())

    @cached_property
    def _names(self) -> dict[str, dict[str, str]]:
        """Trial -> parameter that a fit may change in it -> name of the `FreeParameter`."""
        names: dict[str, dict[str, str]] = {}
        brought = {c.name: e for e in self.known_effects if e not in effect_library.LIBRARY for c in e.coefficients}
        owners: dict[tuple[str, Estimate], str] = {}
        # The training trials first, so that a parameter that both share is named after one of these
        for trial in (*self.training, *self.held_out):
            names[trial.name] = {}
            for parameter in (*self.effects, *APPARATUS, *RELEASE):
                known = self.estimate(parameter, trial)
                acts = _effect_acts_in(brought[parameter], trial) if parameter in brought else _acts_in(parameter, trial)
                if known is None or not self._is_fitted(parameter, known, trial) or not acts:
                    continue
                name = parameter
                if parameter in trial.estimates:
                    name = f"{trial.name}.{parameter}"
                    if parameter in APPARATUS:  # the same mass, used in several trials, is one parameter
                        name = owners.setdefault((parameter, known), name)
                names[trial.name][parameter] = name
        return names

    def _is_fitted(self, parameter: str, known: Estimate, trial: Trial) -> bool:
        """Return whether the study lets a fit change a parameter."""
        if self.fit is None or (trial.in_mid_swing and parameter in ("release_angle", "push_across")):
            return known.uncertain
        return parameter in self.fit

    def changes_of_model(self, changes: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the parameters of the model, numbers or arrays, that a fit changes by these changes of its parameters."""
        return changes

    def parameters(self, values: Mapping[str, float], trial: Trial) -> Parameters:
        """Return the reference's parameters for a trial.

        Parameters
        ----------
        values
            Name of a `FreeParameter`, or of any parameter or coefficient -> value [SI]. All others keep their measured
            value. A name with the trial ("first.free_length") takes precedence over the shared one.

        Raises
        ------
        ParameterError
            If they are impossible together.
        """
        here = {
            n.parameter: values[n.name]
            for n in self.free_parameters((*self.trials,))
            if trial.name in n.trials and n.name in values
        }
        fields: dict[str, Any] = {"release": trial.release}
        coefficients = {}
        for name in (*APPARATUS, *RELEASE, *self.coefficients):
            known = self.estimate(name, trial)
            value = here.get(name, values.get(f"{trial.name}.{name}", values.get(name, known.value if known else None)))
            if name in self.coefficients:
                if value is not None:
                    coefficients[name] = value
            elif value is not None or name in PLACEHOLDERS:
                fields[name] = PLACEHOLDERS[name] if value is None else value
        return Parameters(**fields, coefficients=coefficients, own_effects=self.own_effects)

    def _bounds(self, parameter: str) -> tuple[float, float]:
        """Return the physically possible values of a parameter or coefficient [SI]."""
        if parameter == "gravity":
            return self.gravity_range
        if parameter in self.coefficients:
            return self.coefficients[parameter].bounds
        kind = QUANTITIES[parameter].kind
        return kind.low, kind.high

    def camera_priors(self, trial: Trial, observations: Observations) -> dict[str, Estimate]:
        """Return the priors of the camera parameters that these observations depend on."""
        named = {c.name: c for c in observations.channels}
        measured: set[str] = {"angle", "height"} & named.keys()
        measured |= {"positions"} if any(n.endswith(("_x", "_y")) for n in named) else set()
        measured |= {"angle_rate"} if named.keys() == {"angle_rate"} else set()
        measured |= {"events"} if observations.events else set()
        acting = [
            c for c in CAMERA.values() if measured.intersection(c.changes) and (c.name in trial.camera or not c.if_stated)
        ]
        priors = {c.name: Estimate(value=c.null, sigma=c.error) for c in acting}
        if named:
            step = max(c.time_step for c in named.values())
            # The first frame after the release is known to a frame or two.
            priors["clock_offset"] = Estimate(value=0.0, sigma=max(CAMERA["clock_offset"].error, 2 * step))
        if "height" in named:
            height = named["height"].value
            # Heights are measured from the ground. That of the release is the first point's, to a fiftieth of the fall.
            priors["origin_y"] = Estimate(
                value=float(height[0]), sigma=max(float(np.ptp(height)) / 50, CAMERA["origin_y"].error)
            )
        by_reading = {n: Estimate(value=CAMERA[n].null, sigma=sigma) for n, sigma in observations.camera_errors.items()}
        return priors | by_reading | {n: e for n, e in trial.camera.items() if n in priors}


def can_act(effect: Effect, release: Release) -> bool:
    """Return whether an effect can change what is seen of the masses after this release."""
    # A held pendulum shows neither the heavy mass nor the rod, nor a string that slides over it
    hidden = effect.kind is effect_library.EffectKind.STRING_LAW or effect.acts_on in ("heavy mass", "rod")
    return is_possible(effect, release) and not (release is Release.HELD and hidden)


def _acts_in(parameter: str, trial: Trial) -> bool:
    """Return whether a parameter influences the motion or the measurement of a trial."""
    if trial.release is Release.DROP:
        other = "light" if trial.dropped == "heavy" else "heavy"
        if parameter.startswith((other, "rod", "string", "kinetic", "static", "release", "free_length", "hanging")):
            return False
    effect = _EFFECT_OF.get(parameter)
    if effect is not None:
        return can_act(effect, trial.release)
    if trial.release is Release.HELD:
        return not parameter.startswith(("heavy", "hanging"))
    return not (trial.release is Release.VERTICAL and parameter == "release_angle")


def _effect_acts_in(effect: Effect, trial: Trial) -> bool:
    """Return whether an effect that is not of the library influences the motion of a trial."""
    on_light = effect.force_on_light_mass is not None or effect.inertia_of_light_mass is not None
    on_heavy = effect.force_on_heavy_mass is not None or effect.inertia_of_heavy_mass is not None
    if trial.release is Release.DROP:
        return not effect.needs_string and (on_light if trial.dropped == "light" else on_heavy)
    return on_light or trial.release is not Release.HELD


def read_files(
    folder: Path, trial: Trial, rod_radius: float | None = None, progress: ReportShare | None = None
) -> Observations:
    """Read a trial's files, whose paths are relative to ``folder``; a film needs the rod's radius [m].

    Parameters
    ----------
    progress
        Called while a film is tracked, which takes some seconds.

    Raises
    ------
    DataError
        If a file cannot be used.
    """
    from looping_pendulum.film.decode import is_film
    from looping_pendulum.measured.film_points import read_film
    from looping_pendulum.measured.readers import read  # imports units, which takes a while and which fits do not need

    has_film = any(is_film(path) for path, _ in trial.files)
    parts = tuple(
        read_film(folder / path, _stated_of_film(trial, rod_radius), trial.name, progress)
        if is_film(path)
        else read(
            folder / path,
            frame_rate=trial.frame_rate,
            clip_rate=trial.clip_rate,
            tracks=tracks or None,
            kind=trial.kind,
            units=trial.units,
            run=trial.run,
            name=trial.name,
            starts_at_release="clock_offset" not in trial.camera and trial.events is None,
        )
        for path, tracks in trial.files
    )
    if trial.events is not None:
        parts = (*parts, read(folder / trial.events, kind="events", name=trial.name))
    observations = with_event_errors(merge(trial.name, parts), dict(trial.event_errors))
    # The points of a film are as if the light mass had started on the left, on whichever side it did
    observations = mirrored(observations) if trial.mirrored and not has_film else observations
    length, angle = (trial.estimates.get(name) for name in ("free_length", "release_angle"))
    if trial.release is not Release.HELD or length is None:
        return observations
    period = 2 * math.pi * math.sqrt(length.value / effect_library.GRAVITY.coefficients[0].default)
    return rates_from_release(observations, period, None if angle is None else angle.value)


SAME_ROWS = 3
"""Successive rows that two trials cannot both have to the last digit."""


def refuse_seen_points(observed: Sequence[tuple[Trial, Observations]]) -> None:
    """Refuse held-out trials whose points a training trial has, too: these judge nothing.

    Raises
    ------
    DataError
        If more than half of a held-out trial's points, or all its events, are those of a training trial.
    """
    training = [(t, o, _rows(o)) for t, o in observed if not t.held_out]
    for held_out, observations in ((t, o) for t, o in observed if t.held_out):
        rows = _rows(observations)
        for trial, other, known in training:
            is_same = 2 * len(rows & known) > len(rows) if rows else observations.events == other.events
            if is_same:
                found = f"found the points of '{trial.name}' in '{held_out.name}' again, needed points that no fit has seen"
                raise DataError(
                    f"{observations.file}: {found} in a held-out trial; give another film or table, or leave one out"
                )


def _rows(observations: Observations) -> set[tuple[object, ...]]:
    """Return every few successive values of each moving body."""
    rows: set[tuple[object, ...]] = set()
    for body, channels in observations.bodies().items():
        shortest = min(map(len, channels))
        # Without what converting a unit adds
        values = np.round([c.value[:shortest] for c in channels], 9).T
        rows |= {(body, *values[i : i + SAME_ROWS].ravel()) for i in range(shortest - SAME_ROWS + 1)}
    return rows


def _stated_of_film(trial: Trial, rod_radius: float | None) -> dict[str, float]:
    """Return what a study states of a film: fields of `TrackSettings` and their values [SI]."""
    length = trial.estimates.get("free_length")
    stated = {
        "free_length": None if length is None else length.value,
        "free_length_error": None if length is None else length.sigma,
        "rod_radius": rod_radius,
        "frame_rate": trial.frame_rate,
    }
    return {name: value for name, value in stated.items() if value is not None}
