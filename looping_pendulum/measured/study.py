"""A study: trials, measured values of the apparatus with their errors, and the effects that are declared to act."""

from __future__ import annotations

import dataclasses
import functools
import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field, InstanceOf, ValidationInfo, model_validator
from pydantic.dataclasses import dataclass

from looping_pendulum.errors import ParameterError
from looping_pendulum.measured.camera import CAMERA
from looping_pendulum.measured.free_parameter import FreeParameter
from looping_pendulum.measured.keywords import (
    OF_STUDY,
    OF_TRIAL,
    Measured,
    Quantity,
    StudyError,
    read_keywords,
    table_text,
)
from looping_pendulum.measured.observations import (
    BOXES,
    KINDS,
    PLANES,
    DataError,
    Observations,
    merge,
    mirrored,
    rates_from_release,
)
from looping_pendulum.measured.study_file import (
    CAMERA_ERRORS,
    FILES,
    MEASURED_APPARATUS,
    MEASURED_IN_TRIAL,
    RELEASE,
    RELEASE_OF_TRIAL,
    UNITS,
    DeclaredEffects,
    low_and_high,
)

# `as` exports it once more, as a part of a study
from looping_pendulum.measured.study_file import Estimate as Estimate
from looping_pendulum.reference_ode import effects as effect_library
from looping_pendulum.reference_ode.effects import Coefficient, Effect
from looping_pendulum.reference_ode.parameters import Parameters, Release, effect_tables, is_possible
from looping_pendulum.scenarios.document import Document
from looping_pendulum.scenarios.fields import (
    FILE_CONFIG,
    Flag,
    QuantityField,
    Text,
    gathered,
    in_brackets,
    in_no_file,
    one_of,
    suggest,
)
from looping_pendulum.scenarios.own_effects import KEY_IN_STUDY, OwnEffects, warn_of_faulty_packages
from looping_pendulum.scenarios.quantities import APPARATUS, QUANTITIES
from looping_pendulum.scenarios.units import QuantityKind

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
EARTH_GRAVITY = (9.764, 9.834)
"""Smallest and largest acceleration of free fall on the Earth's surface [m/s^2].

On Huascaran and on the Arctic Ocean (Hirt et al., Geophys. Res. Lett. 40 (2013) 4279).
"""
_RATE = QuantityField(QUANTITIES["frame_rate"].kind)
_LOW_AND_HIGH = {
    "release_angle": low_and_high(QUANTITIES["release_angle"].kind, "[60 deg, 130 deg]"),
    "mass_ratio": low_and_high(QUANTITIES["mass_ratio"].kind, "[2, 10]"),
    "gravity": low_and_high(QuantityKind(unit="m/s**2", low=0.0), "[1.61 m/s^2, 1.64 m/s^2]"),
}


def _name(name: str, info: ValidationInfo) -> str:
    """Return the name of a trial, by default that of its file."""
    return name or Path(info.data["files"][0][0]).stem if "files" in info.data else name


def _takes_keywords(read: Callable[..., Any], field_of_file: str) -> Callable[[Any], Any]:
    """Return the decorator of a model that a script makes by keywords: those of its `by_keywords`, which ``read`` understands.

    Parameters
    ----------
    field_of_file
        Field without a default: where it is given, the program makes the model, by its fields.
    """

    def decorate(model: Any) -> Any:
        by_fields, signature = model.__init__, inspect.signature(model.by_keywords)

        @functools.wraps(by_fields)
        def init(self: Any, **keywords: Any) -> None:
            if field_of_file not in keywords:
                made = read(**keywords)
                keywords = {f.name: getattr(made, f.name) for f in dataclasses.fields(made)}
            by_fields(self, **keywords)

        model.__init__ = init
        # For help and completion
        model.__signature__ = signature.replace(parameters=[*signature.parameters.values()][1:])
        return model

    return decorate


TABLE_KEYS = ("tracks", "kind", "frame_rate", "clip_rate", "units", "plane", "box", "run")
"""Keys that say how a table is read."""


def _trial_of_keywords(*, points: Any = None, name: str = "", **keywords: Any) -> Trial:
    """Return the trial of a script's keywords."""
    label = f"trial '{name}'" if name else "trial"
    if points is None and not (keywords.get("file") or keywords.get("files")):
        raise StudyError(f"{label}: found neither points nor a file, needed one of them; write for example points=frame")
    if points is not None:
        if twice := [key for key in ("file", "files") if key in keywords]:
            raise StudyError(f"{label}: {twice[0]}: found a file beside points, needed one of them; leave one out")
        if isinstance(points, Observations):
            if needless := [key for key in TABLE_KEYS if keywords.get(key) is not None]:
                found = "found it beside observations, which are read already"
                raise StudyError(f"{label}: {needless[0]}: {found}; leave it out")
            name = name or points.name
        else:
            points = table_text(points, label)
        keywords["file"] = points.file if isinstance(points, Observations) else f"{name}.csv" if name else ""
    return read_keywords(Trial, {"name": name, **keywords}, OF_TRIAL, {"<points>": points}, label=label)


def _study_of_keywords(*, trials: Sequence[Trial] = (), name: str = "study", title: str = "", **keywords: Any) -> Study:
    """Return the study of a script's keywords."""
    warn_of_faulty_packages()
    if strange := [t for t in trials if not isinstance(t, Trial)]:
        raise StudyError(f"study: trials: found an object of the type {type(strange[0]).__name__}, needed a list of lp.Trial")
    # Points may have no name, and so the file of them that `study_io.dump` names has none
    named = [
        t if t.name else dataclasses.replace(t, name=f"trial_{i}", files=((f"trial_{i}.csv", t.files[0][1]),))
        for i, t in enumerate(trials, 1)
    ]
    given = {"title": title or name, "trials": named, **keywords}
    return read_keywords(Study, given, OF_STUDY, {"<name>": name, "<folder>": Path()}, label="study", check=check_study)


# The text under a field describes it in the program, in docs/keys.md and in an editor; in the program all values are in SI. A
# field whose alias is in brackets is several keys of a file, which its type describes, or none.
@_takes_keywords(_trial_of_keywords, "files")
@dataclass(frozen=True, kw_only=True, config=FILE_CONFIG)
class Trial:
    """A trial: its file of tracked points or measured events, its release and its camera.

    A script makes one by keywords: ``points``, which are a DataFrame, a mapping of names to arrays, or what `lp.track` returns;
    the keys of a trial in a study file; and measured parameters by their names, such as ``heavy_mass`` and ``release_angle``.
    Names and units of columns are those of a file's header, "light_x [cm]".
    """

    files: Annotated[tuple[tuple[str, Mapping[str, str]], ...], FILES, in_brackets("files")]
    """Path from the study's folder, and mass -> name of its track in that file (an empty name: the only track)."""
    name: Annotated[Text, AfterValidator(_name), Field(validate_default=True)] = ""
    """Name in reports; that of the file if not given."""
    events: Text | None = None
    """Table of measured events beside the tracked points; one that stands alone is the trial's file."""
    kind: Annotated[str, one_of(*KINDS)] = "auto"
    """What the file holds; auto: as its header says."""
    frame_rate: Annotated[float, _RATE] | None = None
    """True frame rate of the camera; the file's times then only count frames."""
    clip_rate: Annotated[float, _RATE] | None = None
    """Frame rate by which the file's times were computed, for slow motion; not given: one row is one frame."""
    units: Annotated[Mapping[str, str], UNITS] = field(default_factory=dict)
    """Units of the columns whose header has none."""
    plane: Annotated[str, one_of(*PLANES)] | None = None
    """Axes of a table in space that are to the right and up in the plane of the motion; x and y if not given."""
    box: Annotated[str, one_of(*BOXES)] | None = None
    """What x and y of a table of boxes are: the middle of each, or its corner of smallest x and y."""
    run: Text | None = None
    """Number of the run or drop, in a file of several."""
    dropped: Annotated[str, one_of("light", "heavy")] = "heavy"
    """Mass whose height the file has, or that a drop lets fall."""
    mirrored: Flag = False
    """Whether the light mass starts on the right: the camera stood on the other side."""
    held_out: Flag = False
    """Whether the error before and after is judged on the trial, by fits to the others alone."""
    in_mid_swing: Annotated[bool, in_no_file("in_mid_swing")] = False
    """Whether the motion begins at the first tracked point, in mid-swing (`edits.with_free_start`); the data decide."""
    release: Annotated[Release, RELEASE_OF_TRIAL, in_brackets("release")] = Release.LOOPING
    """Kind of release."""
    estimates: Annotated[Mapping[str, Estimate], MEASURED_IN_TRIAL, in_brackets("estimates")] = field(default_factory=dict)
    """Parameter -> measured value in this trial: of the release, and of parts that differ from the apparatus."""
    camera: Annotated[Mapping[str, Estimate], CAMERA_ERRORS] = field(default_factory=dict)
    """Errors of the camera, with what is known of each; it replaces the usual prior."""
    points: Annotated[InstanceOf[Observations] | str | None, in_no_file("points")] = field(default=None, repr=False)
    """What a script gives in place of files: observations, or the text of a table."""

    def __init__(
        self,
        *,
        points: Observations | Mapping[str, Any] | Any = None,
        name: str = "",
        file: str | None = None,
        files: Mapping[str, str] | None = None,
        tracks: Mapping[str, str] | None = None,
        events: str | None = None,
        kind: str | None = None,
        frame_rate: Quantity | None = None,
        clip_rate: Quantity | None = None,
        units: Mapping[str, str] | None = None,
        plane: str | None = None,
        box: str | None = None,
        run: str | None = None,
        dropped: str | None = None,
        mirrored: bool = False,
        held_out: bool = False,
        light_mass: Measured | None = None,
        light_radius: Measured | None = None,
        heavy_mass: Measured | None = None,
        release: Release | str | None = None,
        release_angle: Measured | None = None,
        free_length: Measured | None = None,
        hanging_length: Measured | None = None,
        push_across: Measured | None = None,
        camera: Mapping[str, Measured] | None = None,
    ) -> None:
        """Declare the keywords by which a script makes one; `_takes_keywords` carries it out."""

    by_keywords = __init__

    @model_validator(mode="before")
    @classmethod
    def _gather(cls, keys: Any) -> Any:
        """Put the keys of a file together that make up one field."""
        places = {"<files>": FILES.keys, "<release>": ("release",), "<estimates>": MEASURED_IN_TRIAL.keys}
        return gathered(keys, places)


@dataclass(frozen=True, kw_only=True, config=FILE_CONFIG)
class ExperimentLimits:
    """Limits of the trials that could be done next, for the proposal of the next experiment."""

    release_angle: Annotated[tuple[float, float], _LOW_AND_HIGH["release_angle"]] | None = None
    """Smallest and largest angle of release."""
    mass_ratio: Annotated[tuple[float, float], _LOW_AND_HIGH["mass_ratio"]] | None = None
    """Smallest and largest ratio M2/M1."""
    releases: Annotated[tuple[Annotated[Release, one_of(*Release)], ...], Field(min_length=1)] = tuple(Release)
    """Kinds of release that are possible; all if not given."""


@_takes_keywords(_study_of_keywords, "folder")
@dataclass(frozen=True, kw_only=True, config=FILE_CONFIG)
class Study:
    """Trials of one apparatus, and the effects that are declared to act in them.

    A script makes one by keywords: ``trials``, the keys of a study file, and the measured apparatus by the names of its
    parameters, such as ``light_mass`` and ``rod_radius``.
    """

    name: Annotated[str, in_no_file("name")]
    """Name of the file, without its ending."""
    title: Text
    """A few words."""
    folder: Annotated[Path, in_no_file("folder")] = field(compare=False)
    """Folder that the trials' paths are relative to."""
    apparatus: Annotated[Mapping[str, Estimate], MEASURED_APPARATUS] = field(default_factory=dict)
    """The apparatus, as measured for all trials; a trial may give another value."""
    own_effects: Annotated[OwnEffects, Field(validation_alias=KEY_IN_STUDY, serialization_alias=KEY_IN_STUDY)] = ()
    """Effects that the library lacks, each with its formula: candidates, unless `effects` declares them."""
    effects: Annotated[Mapping[str, Estimate], DeclaredEffects()] = field(default_factory=dict)
    """Effects that are declared to act: each coefficient, by the name that `identify` gives it, with its value."""
    fit: Annotated[tuple[Text, ...], Field(min_length=1)] | None = None
    """Names of what a fit may change; if not given, all that is free or has a standard error."""
    trials: Annotated[tuple[Trial, ...], Field(min_length=1)]
    """The trials; at least one is not held out."""
    limits: ExperimentLimits = field(default_factory=ExperimentLimits)
    """Limits of the trials that could be done next, for the proposal of the next experiment."""
    gravity_range: Annotated[tuple[float, float], _LOW_AND_HIGH["gravity"]] = EARTH_GRAVITY
    """Acceleration of free fall that there may be where the trials were made; that on Earth if not given."""

    def __init__(
        self,
        *,
        trials: Sequence[Trial],
        name: str = "study",
        title: str = "",
        effects: Mapping[str, Any] | None = None,
        candidates: Mapping[str, Mapping[str, Any]] | None = None,
        fit: Sequence[str] | None = None,
        limits: Mapping[str, Any] | None = None,
        gravity_range: tuple[Quantity, Quantity] | None = None,
        light_mass: Measured | None = None,
        light_radius: Measured | None = None,
        heavy_mass: Measured | None = None,
        rod_radius: Measured | None = None,
    ) -> None:
        """Declare the keywords by which a script makes one; `_takes_keywords` carries it out."""

    by_keywords = __init__

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
        effect_of = {c.name: effect for effect in self.known_effects for c in effect.coefficients}
        owners: dict[tuple[str, Estimate], str] = {}
        # The training trials first, so that a parameter that both share is named after one of these
        for trial in (*self.training, *self.held_out):
            names[trial.name] = {}
            for parameter in (*self.effects, *APPARATUS, *RELEASE):
                known = self.estimate(parameter, trial)
                acts = _acts_in(parameter, effect_of.get(parameter), trial)
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
        here = {parameter: values[name] for parameter, name in self._names.get(trial.name, {}).items() if name in values}
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


def _acts_in(parameter: str, effect: Effect | None, trial: Trial) -> bool:
    """Return whether a parameter, of an effect if it is a coefficient, influences the motion or the measurement of a trial."""
    if effect is not None and effect not in effect_library.LIBRARY:
        on_light = effect.force_on_light_mass is not None or effect.inertia_of_light_mass is not None
        on_heavy = effect.force_on_heavy_mass is not None or effect.inertia_of_heavy_mass is not None
        if trial.release is Release.DROP:
            return not effect.needs_string and (on_light if trial.dropped == "light" else on_heavy)
        return on_light or trial.release is not Release.HELD
    if trial.release is Release.DROP:
        other = "light" if trial.dropped == "heavy" else "heavy"
        if parameter.startswith((other, "rod", "string", "kinetic", "static", "release", "free_length", "hanging")):
            return False
    if effect is not None:
        return can_act(effect, trial.release)
    if trial.release is Release.HELD:
        return not parameter.startswith(("heavy", "hanging"))
    return not (trial.release is Release.VERTICAL and parameter == "release_angle")


def read_files(folder: Path, trial: Trial, rod_radius: Estimate | None = None) -> Observations:
    """Read a trial's files, whose paths are relative to ``folder``; of a film, the points that tracking left beside it.

    Parameters
    ----------
    rod_radius
        As a film needs to have been tracked with it.

    Raises
    ------
    DataError
        If a file cannot be used.
    """
    from looping_pendulum.measured.film import is_film
    from looping_pendulum.measured.film_points import read_film
    from looping_pendulum.measured.tables.readers import read  # imports much that fits do not need

    has_film = any(is_film(path) for path, _ in trial.files)
    parts = tuple(
        dataclasses.replace(trial.points, name=trial.name)
        if isinstance(trial.points, Observations)
        else read_film(folder / path, stated_of_film(trial, rod_radius), trial.name)
        if is_film(path)
        else read(
            folder / path if trial.points is None else f"points of '{trial.name}'",
            content=trial.points,
            frame_rate=trial.frame_rate,
            clip_rate=trial.clip_rate,
            tracks=tracks or None,
            kind=trial.kind,
            units=trial.units,
            plane=trial.plane,
            box=trial.box,
            run=trial.run,
            name=trial.name,
            starts_at_release="clock_offset" not in trial.camera and trial.events is None,
        )
        for path, tracks in trial.files
    )
    if trial.events is not None:
        parts = (*parts, read(folder / trial.events, kind="events", name=trial.name))
    observations = merge(trial.name, parts)
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


def stated_of_film(trial: Trial, rod_radius: Estimate | None) -> dict[str, float]:
    """Return what a study states of a film: fields of `TrackSettings` and their values [SI]."""
    length = trial.estimates.get("free_length")
    stated = {
        "free_length": None if length is None else length.value,
        "free_length_error": None if length is None else length.sigma,
        "rod_radius": None if rod_radius is None else rod_radius.value,
        "rod_radius_error": None if rod_radius is None else rod_radius.sigma,
        "frame_rate": trial.frame_rate,
    }
    return {name: value for name, value in stated.items() if value is not None}


def check_study(study: Study, doc: Document) -> None:
    """Refuse what no key alone shows to be wrong.

    Raises
    ------
    ScenarioError
        In one line, with the key of ``doc``, of which the study was read.
    """
    _check_own_effects(study, doc)
    _check_gravity(study, doc)
    _check_names(study, doc)
    for i, trial in enumerate(study.trials):
        _check_trial(study, trial, doc, i)


def _check_own_effects(study: Study, doc: Document) -> None:
    """Refuse an effect of a camera parameter's name, as they share a namespace."""
    for name in (own.name for own in study.own_effects if own.name in CAMERA):
        message = f"found the name '{name}', which a camera's parameter has already; needed another, such as 'my_{name}'"
        raise doc.error((KEY_IN_STUDY, name), message)


def _check_gravity(study: Study, doc: Document) -> None:
    """Refuse a gravity that there is not where the trials were made."""
    low, high = study.gravity_range
    gravity = study.effects.get("gravity")
    if gravity is not None and not low <= gravity.value <= high:
        where = "on Earth" if study.gravity_range == EARTH_GRAVITY else "by gravity_range"
        raise doc.error(
            ("effects", "gravity"),
            f"found {gravity.value:g} m/s^2, needed {low:g} to {high:g} m/s^2, as {where}; elsewhere state the possible "
            "values, for example 'gravity_range: [1.61 m/s^2, 1.64 m/s^2]'",
        )


def _check_names(study: Study, doc: Document) -> None:
    """Refuse names of trials that occur twice, and unknown names under 'fit'."""
    first_index: dict[str, int] = {}
    for i, trial in enumerate(study.trials):
        if first_index.setdefault(trial.name, i) != i:
            message = f"found a second trial '{trial.name}', needed names that differ; write for example 'name: {trial.name}-2'"
            raise doc.error(("trials", i, "name"), message)
    if not study.training:
        raise doc.error(("trials",), "found only held-out trials, needed one to learn from; set 'held_out: false' for one")
    known = [*APPARATUS, *RELEASE, *study.effects]
    for i, name in enumerate(study.fit or ()):
        if name not in known:
            raise doc.error(("fit", i), f"found '{name}', needed one of: {', '.join(known)}{suggest(name, known)}")
    for name, known_value in study.effects.items():
        if study.fit is not None and known_value.free and name not in study.fit:
            raise doc.error(("effects", name), f"found 'free', but 'fit' leaves it out; add '{name}' to 'fit' or give a value")


def _check_trial(study: Study, trial: Trial, doc: Document, index: int) -> None:
    """Refuse a trial without a measured value that its release needs, or with impossible values."""
    needs = (f"{trial.dropped}_mass",) if trial.release is Release.DROP else REQUIRED[trial.release]
    for name in needs:
        if study.estimate(name, trial) is None:
            where = f"{'apparatus.' if name in APPARATUS else ''}{QUANTITIES[name].key}"
            example = f"{QUANTITIES[name].last_key}: {QUANTITIES[name].measured_example}"
            message = f"a {trial.release.value} release needed '{where}'; write for example '{example}'"
            raise doc.error(("trials", index), f"{trial.name}: {message}")
    try:
        study.parameters({}, trial)
    except ParameterError as error:
        raise doc.error(("trials", index), f"{trial.name}: {error}") from None
