"""A study: trials, what was measured of the apparatus and how well, and which effects the experimenter believes in."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from looping_pendulum.discrepancy.data.measurement import CAMERA
from looping_pendulum.discrepancy.data.observations import Observations, merge, mirrored, with_event_errors
from looping_pendulum.reference_ode import effects as effect_library
from looping_pendulum.reference_ode.parameters import Parameters, Release

SHARED = MappingProxyType({"light_mass": "kg", "light_radius": "m", "heavy_mass": "kg", "rod_radius": "m"})
"""Parameters of the apparatus -> SI unit."""
PER_TRIAL = MappingProxyType({"release_angle": "rad", "free_length": "m", "hanging_length": "m"})
"""Parameters of a release -> SI unit."""
HANGING = 0.03
"""Start of a hanging length that was not measured [m]: it moves nothing, and only says how high the heavy mass is seen."""
UNSEEN = MappingProxyType(
    {"light_mass": 1.0, "heavy_mass": 1.0, "rod_radius": 1e-6, "free_length": 1.0, "release_angle": 0.5 * math.pi}
)
"""Stands in where a release does not depend on a parameter [SI]: a held pendulum's pivot is a rod without thickness."""
NEEDS = MappingProxyType(
    {
        Release.LOOPING: ("light_mass", "heavy_mass", "rod_radius", "release_angle", "free_length"),
        Release.VERTICAL: ("light_mass", "heavy_mass", "rod_radius", "free_length"),
        Release.HELD: ("light_mass", "release_angle", "free_length"),
        Release.DROP: (),
    }
)
"""What must have been measured for a release; of a drop, the mass that is dropped."""


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """What the experimenter knows of one number."""

    value: float
    """Measured value, or where a free one starts [SI]."""
    sigma: float | None = None
    """Its standard error [SI]; None: taken as exact, or free."""
    free: bool = False
    """Whether nothing is known of it."""

    @property
    def uncertain(self) -> bool:
        """Whether a fit may move it."""
        return self.free or self.sigma is not None


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One trial: its files, and how the masses were let go."""

    name: str
    files: tuple[tuple[str, Mapping[str, str]], ...]
    """Path from the study's folder, and which mass is which track in it (an empty name: the only track)."""
    events: str | None = None
    """Table of events beside the files; one that stands alone is a file like any other."""
    kind: str = "auto"
    frame_rate: float | None = None
    """True frame rate [Hz]."""
    clip_rate: float | None = None
    """Frame rate by which the file's times were made [Hz]."""
    units: Mapping[str, str] = field(default_factory=dict)
    drop: int | None = None
    dropped: str = "heavy"
    """Which mass a channel "height" sees."""
    mirrored: bool = False
    """Whether the camera stood where the light mass loops the other way."""
    held_out: bool = False
    release: Release = Release.LOOPING
    own: Mapping[str, Estimate] = field(default_factory=dict)
    """Release, and masses other than the apparatus's, by parameter."""
    camera: Mapping[str, Estimate] = field(default_factory=dict)
    """What is known of the camera beside its usual errors."""
    event_errors: Mapping[str, float] = field(default_factory=dict)
    """SI unit -> standard error."""


@dataclass(frozen=True, kw_only=True)
class ExperimentLimits:
    """What the experimenter could do next; None: anything."""

    release_angle: tuple[float, float] | None = None
    """[rad]"""
    mass_ratio: tuple[float, float] | None = None
    """M2/M1."""
    releases: tuple[Release, ...] = tuple(Release)


@dataclass(frozen=True, kw_only=True)
class UncertainParameter:
    """One number that a fit may move."""

    name: str
    """The parameter's, with the trial's in front where it is not shared: "first.release_angle"."""
    parameter: str
    trials: tuple[str, ...]
    """Names of the trials that it acts in."""
    start: float
    """Measured value, or where to start [SI]."""
    sigma: float | None
    """Standard error of the measured value [SI]; None: nothing is known."""
    bounds: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Study:
    """What there is to learn from."""

    name: str
    title: str
    folder: Path = field(compare=False)
    """Where the trials' paths start."""
    apparatus: Mapping[str, Estimate]
    """Parameter -> what was measured of it."""
    effects: Mapping[str, Estimate]
    """Coefficient -> what is known of it, of each declared effect."""
    fit: tuple[str, ...] | None = None
    """Parameters and coefficients that may be fitted; None: all that are free or have a standard error."""
    trials: tuple[Trial, ...]
    limits: ExperimentLimits = ExperimentLimits()

    def trial(self, name: str) -> Trial:
        """Return the trial of that name."""
        return next(t for t in self.trials if t.name == name)

    @property
    def training(self) -> tuple[Trial, ...]:
        """Trials that a fit may see."""
        return tuple(t for t in self.trials if not t.held_out)

    @property
    def held_out(self) -> tuple[Trial, ...]:
        """Trials that no fit may see."""
        return tuple(t for t in self.trials if t.held_out)

    @property
    def declared(self) -> tuple[str, ...]:
        """Names of the declared effects; gravity is always one."""
        library = effect_library.EFFECTS.values()
        return tuple(e.name for e in library if e.name == "gravity" or any(c.name in self.effects for c in e.coefficients))

    def estimate(self, parameter: str, trial: Trial) -> Estimate | None:
        """What is known of a parameter or coefficient in a trial; None: nothing, and the release does not need it."""
        return trial.own.get(parameter) or self.apparatus.get(parameter) or self.effects.get(parameter)

    def unknowns(self, trials: tuple[Trial, ...] | None = None) -> tuple[UncertainParameter, ...]:
        """Every number that a fit of ``trials`` (the training ones) may move, each once."""
        found: dict[str, UncertainParameter] = {}
        for trial in self.training if trials is None else trials:
            for parameter, name in self._names[trial.name].items():
                known = self.estimate(parameter, trial)
                assert known is not None
                before = found[name].trials if name in found else ()
                found[name] = UncertainParameter(
                    name=name,
                    parameter=parameter,
                    trials=(*before, trial.name),
                    start=known.value,
                    sigma=known.sigma,
                    bounds=_bounds(parameter),
                )
        return tuple(found.values())

    @cached_property
    def _names(self) -> dict[str, dict[str, str]]:
        """Trial -> parameter that a fit may move in it -> name of the unknown."""
        names: dict[str, dict[str, str]] = {}
        owners: dict[tuple[str, Estimate], str] = {}
        for trial in (*self.training, *self.held_out):
            names[trial.name] = {}
            for parameter in (*self.effects, *SHARED, *PER_TRIAL):
                known = self.estimate(parameter, trial)
                if known is None or not self._fitted(parameter, known) or not _acts(parameter, trial):
                    continue
                name = parameter
                if parameter in trial.own:
                    name = f"{trial.name}.{parameter}"
                    if parameter in SHARED:  # the same mass, hung on in several trials, is one unknown
                        name = owners.setdefault((parameter, known), name)
                names[trial.name][parameter] = name
        return names

    def _fitted(self, parameter: str, known: Estimate) -> bool:
        return known.uncertain if self.fit is None else parameter in self.fit

    def parameters(self, values: Mapping[str, float], trial: Trial) -> Parameters:
        """Reference parameters of a trial.

        Parameters
        ----------
        values
            Name of an `UncertainParameter`, or of any parameter or coefficient -> value [SI]; the others keep their measured value. A
            trial's own name ("first.free_length") goes before the shared one.

        Raises
        ------
        ParameterError
            If they are impossible together.
        """
        here = {
            u.parameter: values[u.name] for u in self.unknowns((*self.trials,)) if trial.name in u.trials and u.name in values
        }
        fields: dict[str, Any] = {"release": trial.release}
        coefficients = {}
        for name in (*SHARED, *PER_TRIAL, *effect_library.COEFFICIENTS):
            known = self.estimate(name, trial)
            value = here.get(name, values.get(f"{trial.name}.{name}", values.get(name, known.value if known else None)))
            if name in effect_library.COEFFICIENTS:
                if value is not None:
                    coefficients[name] = value
            elif value is not None or name in UNSEEN:
                fields[name] = UNSEEN[name] if value is None else value
        return Parameters(**fields, coefficients=coefficients)

    def camera_priors(self, trial: Trial, observations: Observations) -> dict[str, Estimate]:
        """What is known beforehand of the camera's numbers that these observations depend on."""
        named = {c.name: c for c in observations.channels}
        wanted = ["clock_offset", "clock_ratio"] if named or observations.events else []
        if any(n.endswith(("_x", "_y")) for n in named):
            wanted = ["origin_x", "origin_y", "scale", "tilt", *wanted]
        wanted += ["scale", "tilt"] if observations.events else []
        wanted += ["tilt"] if "angle" in named else []
        wanted += ["origin_y", "scale"] if "height" in named else []
        priors = {n: Estimate(value=CAMERA[n].null, sigma=CAMERA[n].sigma) for n in dict.fromkeys(wanted)}
        if named:
            step = max((float(np.median(np.diff(c.t))) for c in named.values() if len(c) > 1), default=0.0)
            # The first frame after the release is known to a frame or two.
            priors["clock_offset"] = Estimate(value=0.0, sigma=max(CAMERA["clock_offset"].sigma, 2 * step))
        if "height" in named:
            height = named["height"].value
            # Heights count from the ground; that of the release is the first mark's, to a fiftieth of the fall.
            priors["origin_y"] = Estimate(
                value=float(height[0]), sigma=max(float(np.ptp(height)) / 50, CAMERA["origin_y"].sigma)
            )
        return priors | {n: e for n, e in trial.camera.items() if n in priors}


def _acts(parameter: str, trial: Trial) -> bool:
    """Whether a parameter matters in a release."""
    if trial.release is Release.DROP:
        other = "light" if trial.dropped == "heavy" else "heavy"
        return not parameter.startswith((other, "rod", "string", "kinetic", "static", "release", "free_length", "hanging"))
    if trial.release is Release.HELD:
        return not parameter.startswith(("heavy", "kinetic", "static", "hanging"))
    return not (trial.release is Release.VERTICAL and parameter == "release_angle")


def _bounds(parameter: str) -> tuple[float, float]:
    if parameter in effect_library.COEFFICIENTS:
        return effect_library.COEFFICIENTS[parameter].bounds
    return (0.0, 2 * math.pi) if parameter == "release_angle" else (0.0, math.inf)


def read_trial(study: Study, trial: Trial) -> Observations:
    """Read a trial's files.

    Raises
    ------
    DataError
        If one cannot be used.
    """
    from looping_pendulum.discrepancy.data.readers import read  # units take a while to import, and fits do without

    parts = tuple(
        read(
            study.folder / path,
            frame_rate=trial.frame_rate,
            clip_rate=trial.clip_rate,
            tracks=tracks or None,
            kind=trial.kind,
            units=trial.units,
            drop=trial.drop,
            name=trial.name,
        )
        for path, tracks in trial.files
    )
    if trial.events is not None:
        parts = (*parts, read(study.folder / trial.events, kind="events", name=trial.name))
    observations = with_event_errors(merge(trial.name, parts), dict(trial.event_errors))
    return mirrored(observations) if trial.mirrored else observations
