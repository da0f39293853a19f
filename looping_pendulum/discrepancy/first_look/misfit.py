"""How far tracked points are from the declared motion as it stands, and how probable they are by it.

Both compare the first part of a trial, before small errors have grown. The camera's origin and the height of the heavy mass
are left out of it: they shift a whole picture, and no other mistake looks like that. A trial is looked at as the study declares
it, and as it would be without one mistake: with other points, or other declared values.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from types import MappingProxyType
from typing import Any

import numpy as np

from looping_pendulum.discrepancy.first_look.evidence import LOOPING, MIN_POINTS, Evidence, evidence_of
from looping_pendulum.discrepancy.fit.data import trial_data
from looping_pendulum.discrepancy.fit.problem import Problem, free_parameters_of
from looping_pendulum.errors import HarnessError
from looping_pendulum.measured import observations as measured
from looping_pendulum.measured.camera import Camera
from looping_pendulum.measured.free_parameter import FreeParameter, ParameterRole
from looping_pendulum.measured.measurement import FIT_TOLERANCE, predict
from looping_pendulum.measured.noise import Noise
from looping_pendulum.measured.observations import Channel, Observations
from looping_pendulum.measured.record_start import with_free_start
from looping_pendulum.measured.study import Estimate, Study, Trial
from looping_pendulum.pages.numbers import quantity
from looping_pendulum.reference_ode.effects import GRAVITY
from looping_pendulum.reference_ode.geometry import Array, next_string_coordinates
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.reference_ode.solution import Samples, Solution
from looping_pendulum.reference_ode.solve import solve

QUARTER_TURN = math.pi / 2
OTHER_MASS = {"light": "heavy", "heavy": "light"}
MIN_UNIT_FACTOR = 1.4
"""Smallest factor on lengths or times, or inverse of one, that is no error of measurement; a scale's may be smaller."""
MIN_ANGLE_DIFFERENCE = math.radians(5)
"""Smallest difference of two release angles that is no error of measurement [rad]."""
CANNOT_RUN = (HarnessError, ValueError, ArithmeticError)
"""Errors of a model that cannot run with some values."""
MAX_DISTANCE = 0.5
"""Distance in free lengths at which the weight of a point ends, so that no outlier decides."""
UNKNOWN_OFFSET = 0.5
"""Assumed error of the clock's offset where the study says that it is not known [s]."""
CAMERA_ERRORS = {"clock_offset": 0.0, "clock_ratio": 0.03, "scale": 0.03, "tilt": 0.03}
"""What a camera may get wrong by little -> its standard error where the study has none; 0: that of the study's prior."""
UNKNOWN_PLACE = 0.2
"""Standard error of the origin and of the heavy mass's height, in free lengths."""
_SHIFTS = {"light_x": "x", "heavy_x": "x", "light_y": "y", "heavy_y": "height of the heavy mass", "height": "height"}
"""Channel -> name of the unknown shift that it shares with others."""


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


def with_lengths(declared: DeclaredTrial, factor: float) -> DeclaredTrial:
    """Return the trial with its points' lengths multiplied by ``factor``."""
    return declared.with_channels(lambda c: dataclasses.replace(c, value=c.value * factor) if c.unit == "m" else c)


def pictured_otherwise(declared: DeclaredTrial, *, mirror: bool, quarter_turns: int) -> DeclaredTrial | None:
    """Return the trial with a picture that is mirrored, turned or both, beside what the study says of it.

    None: its points do not show whether it is. Where they do not show the side on which the light mass begins, a mirrored
    picture looks as the other one does. Of two that look alike, the commoner one is taken: y downwards rather than half a turn,
    a quarter turn rather than x and y exchanged.

    Parameters
    ----------
    mirror
        Whether `Trial.mirrored` is the other one.
    quarter_turns
        Quarter turns that are added to the declared tilt.
    """
    trial = declared.trial
    directions = {c.name.rpartition("_")[2] for c in declared.observations.channels}
    if quarter_turns and not directions >= ({"x", "y"} if quarter_turns % 2 else {"y"}):
        return None
    if not _shows_side(declared) and (not quarter_turns or mirror == (quarter_turns % 2 == 1)):
        return None
    camera = dict(trial.camera)
    if quarter_turns:
        tilt = camera.get("tilt", Estimate(value=0.0))
        turned = math.remainder(tilt.value + quarter_turns * QUARTER_TURN, 4 * QUARTER_TURN)
        camera["tilt"] = dataclasses.replace(tilt, value=turned)
    otherwise = declared.with_trial(dataclasses.replace(trial, mirrored=trial.mirrored != mirror, camera=camera))
    return dataclasses.replace(otherwise, observations=measured.mirrored(declared.observations)) if mirror else otherwise


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
    names = [c.name.partition("_") for c in declared.observations.channels]
    if not {body for body, *_ in names} >= set(OTHER_MASS):
        return None
    return _renamed(declared, {f"{body}_{axis}": f"{OTHER_MASS[body]}_{axis}" for body, _, axis in names if body in OTHER_MASS})


def with_columns_exchanged(declared: DeclaredTrial, first: str, second: str) -> DeclaredTrial | None:
    """Return the trial with the values of two channels exchanged; None: not both were tracked."""
    if not {first, second} <= {c.name for c in declared.observations.channels}:
        return None
    return _renamed(declared, {first: second, second: first})


def _renamed(declared: DeclaredTrial, names: Mapping[str, str]) -> DeclaredTrial:
    return declared.with_channels(lambda c: dataclasses.replace(c, name=names.get(c.name, c.name)))


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


@dataclass(frozen=True, kw_only=True, eq=False)
class Distance:
    """Distance of the points from the motion as declared, nothing fitted but shifts."""

    rms: float = math.inf
    """Root mean square over all coordinates [m]; that of an angle is multiplied by the free length.

    Infinite: no points could be compared.
    """
    relative: float = 1.0
    """The same in free lengths; 1: no points could be compared."""
    reason: str = ""
    """Why no points could be compared."""
    length_factor: float = 1.0
    """Factor on the points' lengths with which it was found."""
    points: tuple[tuple[Channel, Array], ...] = ()
    """Channels of the first window, and what is declared of them in the same units; a height begins at the points'."""
    window: float = 0.0
    """Length of the first window [s]."""
    shifts: Mapping[str, float] = field(default_factory=dict)
    """Channel -> shift of its points from the motion about the rod's centre, which is left out of the distance [m]."""

    @property
    def is_cut_off(self) -> bool:
        """Return whether most points are farther away than the weight of a point reaches: it is no less than said."""
        return math.isfinite(self.rms) and self.relative > 0.9 * MAX_DISTANCE

    @property
    def text(self) -> str:
        """Return the root mean square in words."""
        return f"{quantity(self.rms, 'm')}{' or more' if self.is_cut_off else ''}"


def measured_distance(declared: DeclaredTrial, *, with_length_factor: bool = False) -> Distance:
    """Return the distance of the points from the motion as declared.

    Parameters
    ----------
    with_length_factor
        Whether the points' lengths are first multiplied by the factor that suits the motion best.
    """
    try:
        declared = _with_start(declared)
        parameters = declared.study.parameters({}, declared.trial)
        window = LOOPING * fall_time(parameters)
        # Many mistakes leave the parameters as they are
        solution = _solve(_Key(parameters=parameters), window)
        shifts = _clock_shifts(declared)
        found = [_distance(declared, parameters, window, solution, shift, with_length_factor) for shift in shifts]
    except CANNOT_RUN as error:
        return Distance(reason=f"the declared motion could not be computed ({error})")
    few = f"fewer than {MIN_POINTS} points lie in the first {quantity(window, 's')} of the declared motion"
    return min((d for d in found if d is not None), key=lambda d: d.relative, default=Distance(reason=few))


def _with_start(declared: DeclaredTrial) -> DeclaredTrial:
    """Return the trial with y up, as shifts are told from motion by it, and with its start in mid-swing, if it has one."""
    upright = declared.upright()
    return upright.with_trial(with_free_start(upright.study, upright.trial, upright.observations))


def _clock_shifts(declared: DeclaredTrial) -> tuple[float, ...]:
    """Return times by which the clock may be off by what the study allows of it [s]."""
    offset = declared.trial.camera.get("clock_offset")
    if offset is None or declared.trial.in_mid_swing:
        return (0.0,)
    error = UNKNOWN_OFFSET if offset.free else 2 * (offset.sigma or 0.0)
    return tuple(error * share for share in (0.0, -1.0, -0.5, 0.5, 1.0)) if error else (0.0,)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Key:
    """Parameters as the key of a cache: by value, as they hold a mapping and so have no hash."""

    parameters: Parameters

    def __hash__(self) -> int:
        return hash(repr(self.parameters.as_dict()))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and self.parameters == other.parameters


@lru_cache(maxsize=64)
def _solve(key: _Key, window: float) -> Solution:
    return solve(key.parameters, duration=window, tolerance=FIT_TOLERANCE)


def fall_time(parameters: Parameters) -> float:
    """Return the time in which a mass falls through the free length on Earth [s]."""
    return math.sqrt(2 * parameters.free_length / 9.81)


def _distance(
    declared: DeclaredTrial, parameters: Parameters, window: float, solution: Solution, shift: float, with_factor: bool
) -> Distance | None:
    """Return the distance with the clock shifted by ``shift`` [s]; None: there are too few points."""
    values = {n: e.value for n, e in declared.trial.camera.items() if n not in ("origin_x", "origin_y")}
    camera = Camera(**values | {"clock_offset": values.get("clock_offset", 0.0) + shift})
    channels = []
    for c in declared.observations.channels:
        count = int(np.searchsorted(camera.true_time(c.t), window, side="right"))
        # A rate was computed from the angles, and a factor on the times would change it, too
        if count >= MIN_POINTS and (c.name != "angle_rate" or len(declared.observations.channels) == 1):
            channels.append(dataclasses.replace(c, t=c.t[:count], value=c.value[:count]))
    if not channels or (with_factor and any(c.unit != "m" for c in channels)):
        return None

    def sample(t: Array) -> Samples:
        return solution.sample(t[t <= solution.end_time])

    predicted = predict(sample, camera, channels, dropped=declared.trial.dropped)
    groups: dict[str, list[Channel]] = {}
    for c in channels:
        groups.setdefault(_SHIFTS.get(c.name, ""), []).append(c)
    factor = _best_length_factor(groups, predicted) if with_factor else 1.0
    if factor <= 0:
        return None
    length, squares, shown, shifts = parameters.free_length, [], [], {}
    for name, members in groups.items():
        residuals = [factor * c.value - predicted[c.name] if c.unit == "m" else c.value - predicted[c.name] for c in members]
        common = float(np.median(np.concatenate(residuals))) if name else 0.0
        for c, residual in zip(members, residuals, strict=True):
            unit = length_per_unit(c.unit, length)
            shifts[c.name] = common
            squares.append(np.minimum(np.abs(unit * (residual - common)), MAX_DISTANCE * length) ** 2)
            # What is declared, in the units of the points and with the declared origin
            origin = declared.trial.camera.get(f"origin_{c.name[-1]}") if c.name.endswith(("_x", "_y")) else None
            seen = predicted[c.name] + (common if c.name == "height" else 0.0) + (origin.value if origin else 0.0)
            shown.append((c, np.asarray(seen / (factor if c.unit == "m" else 1.0))))
    rms = math.sqrt(float(np.mean(np.concatenate(squares))))
    return Distance(rms=rms, relative=rms / length, length_factor=factor, points=tuple(shown), window=window, shifts=shifts)


def length_per_unit(unit: str, free_length: float) -> float:
    """Return the length [m] that one unit of a channel is worth: of an angle at the string's end, of a rate in a swing."""
    swing = math.sqrt(free_length / GRAVITY.coefficients[0].default)
    return {"m": 1.0, "rad": free_length, "rad/s": free_length * swing}[unit]


def _best_length_factor(groups: Mapping[str, Sequence[Channel]], predicted: Mapping[str, Array]) -> float:
    """Return the factor on the points' lengths that suits the motion best; 0 if there is none."""
    product = square = 0.0
    for members in groups.values():
        points, model = (np.concatenate(v) for v in ([c.value for c in members], [predicted[c.name] for c in members]))
        points, model = points - points.mean(), model - model.mean()
        product += float(points @ model)
        square += float(points @ points)
    return product / square if square else 0.0


def evidence_of_trial(
    declared: DeclaredTrial, distance: Distance, noise: Mapping[str, Noise] = MappingProxyType({}), **fit: Any
) -> Evidence:
    """Return how probable the points are as the trial is declared, whatever its uncertain values are.

    Parameters
    ----------
    distance
        Distance of the same points, whose shifts the fit starts from.
    noise
        Body -> its noise, where there are too few points to estimate it.
    **fit
        How far and from where it is fitted: keywords of `evidence_of`.
    """
    try:
        problem = problem_of_trial(declared, distance.shifts, CAMERA_ERRORS, noise)
        parameters = declared.study.parameters({}, problem.data[0].trial)
        units = {c.unit for c in problem.data[0].channels}
        worth = {unit: length_per_unit(unit, parameters.free_length) for unit in units}
        return evidence_of(problem, fall_time(parameters), worth, **fit)
    except CANNOT_RUN as error:
        return Evidence(log=-math.inf, reason=str(error))


def problem_of_trial(
    declared: DeclaredTrial,
    shifts: Mapping[str, float] = MappingProxyType({}),
    camera_errors: Mapping[str, float] = MappingProxyType({}),
    noise: Mapping[str, Noise] = MappingProxyType({}),
) -> Problem:
    """Return the problem of fitting the study's uncertain values to one trial, with y up.

    Parameters
    ----------
    shifts
        Channel -> shift of its points, from which the fit begins, as from `measured_distance`.
    camera_errors
        Parameter of the camera that is fitted in any case -> its standard error where the study has none.
    noise
        Body -> its noise, where there are too few points to estimate it.
    """
    declared = _with_start(declared)
    data = trial_data(declared.trial, declared.observations, noise)
    return Problem(declared.study, [data], _free_parameters(declared, shifts, camera_errors))


def _free_parameters(
    declared: DeclaredTrial, shifts: Mapping[str, float], camera_errors: Mapping[str, float]
) -> list[FreeParameter]:
    """Return the study's free parameters; the origin and the heavy mass's height are always among them."""
    trial = declared.trial
    length = declared.study.parameters({}, trial).free_length
    places = _shown_places(declared, shifts)
    free = []
    for known in map(_scaled_by_bound, free_parameters_of(declared.study, [(trial, declared.observations)])):
        if known.parameter in places:
            value, scale = places[known.parameter], max(known.scale, UNKNOWN_PLACE * length)
            bounds = (0.0, math.inf) if known.parameter == "hanging_length" else (-math.inf, math.inf)
            known = dataclasses.replace(known, init_value=value, scale=scale, prior=1.0, bounds=bounds)
        free.append(known)
    priors = declared.study.camera_priors(trial, declared.observations)
    named = {known.parameter for known in free}
    for name, scale in camera_errors.items():
        if name not in named and name in priors and not (name == "clock_offset" and trial.in_mid_swing):
            scale = scale or priors[name].sigma or 1e-3
            free.append(
                FreeParameter(
                    name=f"{trial.name}.{name}", parameter=name, role=ParameterRole.CAMERA, trials=(trial.name,),
                    init_value=priors[name].value, scale=scale, prior=1.0,
                )
            )  # fmt: skip
    return free


def _scaled_by_bound(known: FreeParameter) -> FreeParameter:
    """Return a parameter whose unit is no larger than its distance from its lower bound, with the same prior.

    A mass of 10 g +/- 1 kg would begin its fit at 100 g, a tenth of its unit from the bound.
    """
    distance = known.init_value - known.bounds[0]
    if not 0 < distance < known.scale:
        return known
    return dataclasses.replace(known, scale=distance, prior=known.prior_sigma * known.scale / distance)


def _shown_places(declared: DeclaredTrial, shifts: Mapping[str, float]) -> dict[str, float]:
    """Return the origin and the hanging length that the shifts of the points show [m]."""
    places = {}
    # Of both masses the light one shows the origin, as a length of string that is not known moves the other
    for name in ("heavy_x", "heavy_y", "light_x", "light_y"):
        if name in shifts:
            places[f"origin_{name[-1]}"] = shifts[name]
    known = declared.estimate("hanging_length")
    if known is not None and {"light_y", "heavy_y"} <= shifts.keys():
        # A longer string below the rod shows the heavy mass lower
        places["hanging_length"] = max(known.value + shifts["light_y"] - shifts["heavy_y"], 1e-3)
    return places
