"""Mistakes of filming and of declaration: a table of what undoes each, how often it is made, and what is found.

The key that corrects a mistake follows from what was changed to undo it (`keys_of`).
"""

from __future__ import annotations

import dataclasses
import json
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from looping_pendulum.discrepancy.look.case import CANNOT_RUN, Case, Rows
from looping_pendulum.discrepancy.look.prior import COMMON, RARE
from looping_pendulum.measured import observations as measured
from looping_pendulum.measured.camera import Camera
from looping_pendulum.measured.clock import USUAL_RATES
from looping_pendulum.measured.edits import with_free_start
from looping_pendulum.measured.measurement import predict
from looping_pendulum.measured.observations import Channel
from looping_pendulum.measured.study import Estimate, Trial
from looping_pendulum.pages.numbers import number, quantity
from looping_pendulum.reference_ode.geometry import Array, next_string_coordinates
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios.quantities import QUANTITIES
from looping_pendulum.scenarios.units import UnitError, to_si

OTHER = {"light": "heavy", "heavy": "light"}
TWO_MASSES = (Release.LOOPING, Release.VERTICAL)
MIN_FACTOR, MIN_ANGLE = 1.4, math.radians(5)
"""Smallest factor on lengths or times, and smallest difference of angles, that is no error of measurement."""
TIME_FACTORS = (*(f for f in (2.0 ** (np.arange(-28, 29) / 4)).tolist() if not 1 / MIN_FACTOR < f < MIN_FACTOR), 1e-3, 1e3)
LENGTH_UNITS = {"mm": 1e-3, "cm": 1e-2, "inch": 0.0254, "foot": 0.3048, "m": 1.0}
NEARNESS = 0.05
"""Relative difference of a factor from a usual one that is none."""
MIN_SQUEEZE, MAX_SQUEEZE = 1.05, 3.0
"""Smallest and largest ratio of the sizes of the axes that is a mistake: pixels of 16:15, a film squeezed from 16:9."""
CAUSES = {
    1 / 2: ", as where a diameter was given for the radius", 1e-3: ", as where kg was written for g",
    1e3: ", as where g was written for kg",
}  # fmt: skip
WINDOW = 1.5
"""Part of the motion that is compared before anything is fitted, in times in which a mass falls through the free length."""
MIN_POINTS, FARTHEST = 6, 0.5
"""Fewest points of it, and farthest distance of a point that counts [free lengths]."""
_PLAIN = re.compile(r"\w(?:[\w ./()+-]*[\w.()+-])?")


@dataclass(frozen=True)
class Mistake:
    """One row of the table."""

    name: str
    undo: Callable[[Case], Case | None]
    """Return the case without it; None: it cannot have it."""
    found: str
    """In words."""
    share: float = COMMON
    """Prior probability."""
    way_out: str = ""
    """What corrects it, where no key does."""
    of_apparatus: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Distance:
    """Distance of the points from the declared motion in its first part, nothing fitted but shifts."""

    rms: float = math.inf
    """Root mean square over all coordinates [m]; that of an angle is multiplied by the free length; infinite: not compared."""
    relative: float = 1.0
    """The same in free lengths; 1: no points could be compared."""
    reason: str = ""
    """Why no points could be compared."""
    points: tuple[tuple[Channel, Array], ...] = ()
    """Channels of the first part, and what is declared of them; a height begins at the points'."""
    window: float = 0.0
    """Length of the first part [s]."""

    @property
    def is_cut_off(self) -> bool:
        """Return whether most points are farther away than counts."""
        return math.isfinite(self.rms) and self.relative > 0.9 * FARTHEST

    @property
    def text(self) -> str:
        """Return the distance in words."""
        return f"{quantity(self.rms, 'm')}{' or more' if self.is_cut_off else ''}"


def distance(case: Case) -> Distance:
    """Return how far the points of a case are from the declared motion."""
    try:
        start = case.with_trial(with_free_start(case.study, case.trial, case.observations))
        shown, length, window = _declared_points(start), case.free_length, WINDOW * case.fall_time
    except CANNOT_RUN as error:
        return Distance(reason=f"the declared motion could not be computed ({error})")
    groups: dict[str, list[Array]] = {}  # the origin is common to both masses, the heavy one's height is not
    points, lengths = [], []
    for c, there in shown:
        if len(c):
            there = there + (c.value[0] - there[0] if c.name == "height" else 0.0)
            points.append((c, there))
            worth = length if c.unit == "rad" else length * math.sqrt(length / 9.81) if c.unit == "rad/s" else 1.0
            groups.setdefault("x" if c.name.endswith("_x") else c.name, []).append((c.value - there) * worth)
            lengths.append(len(c))
    if max(lengths, default=0) < MIN_POINTS:
        return Distance(
            reason=f"fewer than {MIN_POINTS} points lie in the first {quantity(window, 's')} of the declared motion"
        )
    away = np.concatenate([np.concatenate(g) - np.median(np.concatenate(g)) for g in groups.values()])
    relative = math.sqrt(float(np.mean(np.minimum(np.abs(away) / length, FARTHEST) ** 2)))
    return Distance(rms=relative * length, relative=relative, points=tuple(points), window=window)


def _declared_points(case: Case) -> list[tuple[Channel, Array]]:
    """Return each channel's first part and what the declared motion shows of it, nothing fitted.

    Raises
    ------
    HarnessError
        If the model cannot run.
    """
    window = WINDOW * case.fall_time
    parameters = case.study.parameters({}, case.trial)
    camera = Camera(**{n: e.value for n, e in case.trial.camera.items()})
    first = [(c, camera.true_time(c.t) <= window) for c in case.observations.channels]
    channels = [dataclasses.replace(c, t=c.t[kept], value=c.value[kept]) for c, kept in first]
    there = predict(parameters, camera, [c for c in channels if len(c)], dropped=case.trial.dropped)
    return [(c, there.get(c.name, np.zeros(0))) for c in channels]


def pictured(case: Case, mirror: bool, turns: int) -> Case | None:
    """Return the case with a picture that is mirrored, turned by quarter turns, or both, beside what the study says."""
    names, trial = {c.name for c in case.observations.channels}, case.trial
    axes = {n.rpartition("_")[2] for n in names}
    if turns and not axes >= ({"x", "y"} if turns % 2 else {"y"}):
        return None
    shows_side = {
        Release.DROP: False,
        Release.HELD: case.estimate("release_angle") is not None,
        Release.VERTICAL: names >= {"light_x", "heavy_x"},
    }.get(trial.release, bool(names & {"light_x", "angle", "angle_rate"}))
    if not shows_side and (not turns or mirror == (turns % 2 == 1)):
        return None
    camera = dict(trial.camera)
    if turns:
        tilt = camera.get("tilt", Estimate(value=0.0))
        camera["tilt"] = dataclasses.replace(tilt, value=math.remainder(tilt.value + turns * math.pi / 2, 2 * math.pi))
    other = case.with_trial(dataclasses.replace(trial, mirrored=trial.mirrored != mirror, camera=camera))
    return dataclasses.replace(other, observations=measured.mirrored(case.observations)) if mirror else other


def renamed(case: Case, names: Mapping[str, str]) -> Case | None:
    """Return the case with the values of channels under other names; None: not all are there."""
    if not names or not names.keys() <= {c.name for c in case.observations.channels}:
        return None
    return case.with_channels(lambda c: dataclasses.replace(c, name=names.get(c.name, c.name)))


def with_other_tracks(case: Case) -> Case | None:
    """Return the case with each mass's points in the other one's track."""
    parts = [c.name.partition("_") for c in case.observations.channels]
    both = {body for body, *_ in parts} >= set(OTHER)
    other = renamed(case, {f"{b}_{a}": f"{OTHER[b]}_{a}" for b, _, a in parts if b in OTHER}) if both else None
    return other and dataclasses.replace(other, has_other_tracks=not case.has_other_tracks)


def valued(case: Case, values: Mapping[str, float | None]) -> Case | None:
    """Return the case with other declared values; None: the study does not state them, or leaves them open."""
    estimates = dict(case.trial.estimates)
    for name, value in values.items():
        known = case.estimate(name)
        if known is None or known.free or value is None or value <= 0:
            return None
        ratio = 1.0 if name == "release_angle" else abs(value / known.value)  # an angle's error does not grow with it
        estimates[name] = Estimate(value=value, sigma=None if known.sigma is None else known.sigma * ratio)
    return case.with_trial(dataclasses.replace(case.trial, estimates=estimates)) if values else None


def scaled(case: Case, factor: float, *names: str) -> Case | None:
    """Return the case with declared values that are multiplied by a factor."""
    known = {n: case.estimate(n) for n in names}
    return (
        valued(case, {n: e.value * factor if e else None for n, e in known.items()})
        if case.trial.release in TWO_MASSES
        else None
    )


def with_other_masses(case: Case) -> Case | None:
    """Return the case with the two masses exchanged."""
    light, heavy = (case.estimate(f"{mass}_mass") for mass in OTHER)
    values = {"light_mass": heavy.value if heavy else None, "heavy_mass": light.value if light else None}
    return valued(case, values) if case.trial.release in TWO_MASSES else None


def slower(case: Case, factor: float) -> Case | None:
    """Return the case with times that are multiplied by a factor; None: no camera is so slow."""
    step = min((c.time_step for c in case.observations.channels if c.time_step > 0), default=0.0)
    if factor > 1 and step * factor > MIN_FACTOR / USUAL_RATES[0]:
        return None
    return case.with_channels(
        lambda c: dataclasses.replace(c, t=c.t * factor, time_error=c.time_error * factor),
        factors={**case.factors, "times": factor},
        open=case.open | {"clock_ratio"},
    )


def _axis_factors(case: Case) -> dict[str, tuple[float, float]]:
    """Return of each axis the points' product with the declared motion and their square, each from its mean."""
    sums = {}
    shown = {c.name: (c.value, there) for c, there in _declared_points(case) if len(c)}
    for axis in "xy":  # both masses have one origin
        pairs = [pair for name, pair in shown.items() if name.endswith(f"_{axis}") or (axis == "y" and name == "height")]
        if pairs:
            points, model = (np.concatenate([p[i] - (p[i].mean() if axis == "y" else 0) for p in pairs]) for i in (0, 1))
            points, model = points - points.mean(), model - model.mean()
            sums[axis] = float(points @ model), float(points @ points)
    return sums


def longer(case: Case) -> Case | None:
    """Return the case with lengths in the unit that suits the declared motion best."""
    if any(c.unit != "m" for c in case.observations.channels):
        return None
    try:
        product, square = np.sum([*_axis_factors(case).values()], axis=0)
    except CANNOT_RUN:
        return None
    factor = float(product / square) if square else 0.0
    if factor <= 0 or 1 / MIN_FACTOR < factor < MIN_FACTOR:
        return None
    return case.with_channels(
        lambda c: dataclasses.replace(c, value=c.value * factor, last_digit=c.last_digit * factor),
        log_volume=math.log(factor),
        factors={**case.factors, "lengths": factor},
        open=case.open | {"scale"},
    )


def squeezed(case: Case) -> Case | None:
    """Return the case with axes of different size, as those of pixels that are not square."""
    if "foreshortening" in case.trial.camera:
        return None
    try:
        sums = _axis_factors(case)
    except CANNOT_RUN:
        return None
    if len(sums) < 2 or any(product <= 0 for product, _ in sums.values()):
        return None
    x, y = (sums[axis][1] / sums[axis][0] for axis in "xy")
    if not MIN_SQUEEZE < max(x / y, y / x) < MAX_SQUEEZE:
        return None
    camera = {**case.trial.camera, "foreshortening": Estimate(value=x / y, sigma=0.1 * x / y)}
    other = case.with_trial(dataclasses.replace(case.trial, camera=camera))
    return dataclasses.replace(other, open=case.open | {"scale", "foreshortening"})


def placed(case: Case) -> Case | None:
    """Return the case released from where the light mass's first point is, if that is far from where it was declared."""
    channels = {c.name: c for c in case.observations.channels}
    length, angle = case.estimate("free_length"), case.estimate("release_angle")
    if not {"light_x", "light_y"} <= channels.keys() or length is None or angle is None:
        return None
    camera = Camera(**{n: e.value for n, e in case.trial.camera.items()})
    ((x, y),) = camera.true_position(np.array([[channels["light_x"].value[0], channels["light_y"].value[0]]])).tolist()
    seen, at = next_string_coordinates(x, y, case.study.parameters({}, case.trial).rod_radius, angle.value)
    values = {} if 1 / MIN_FACTOR < seen / length.value < MIN_FACTOR else {"free_length": seen}
    return valued(case, values if abs(at - angle.value) <= MIN_ANGLE else {**values, "release_angle": at % (2 * math.pi)})


def angled(case: Case, change: Callable[[float], float]) -> Case | None:
    """Return the case with another angle of release; None: there is none, or it is impossible."""
    angle = case.estimate("release_angle")
    return valued(case, {"release_angle": change(angle.value)}) if angle and 0 < change(angle.value) < 2 * math.pi else None


def with_rows_exchanged_back(case: Case) -> Case | None:
    """Return the case with rows exchanged in which each mass is nearer to where the other one should be next."""
    rows = Rows.of(case)
    names = [c.name for c in rows.channels]
    if sorted(names) != ["heavy_x", "heavy_y", "light_x", "light_y"]:
        return None
    own = rows.value[:, [names.index(n) for n in ("light_x", "light_y", "heavy_x", "heavy_y")]].reshape(-1, 2, 2)
    before, last, swapped = own[0], own[0], np.zeros(len(own), dtype=bool)
    for k in range(1, len(own)):
        onward = last + 0.5 * (last - before)
        away = [np.nansum(np.linalg.norm(each - onward, axis=1)) for each in (own[k], own[k, ::-1])]
        swapped[k] = away[1] < away[0]
        here = own[k, ::-1] if swapped[k] else own[k]
        before, last = last, np.where(np.isfinite(here), here, onward)
    if not swapped.any():
        return None
    at = rows.t[swapped]
    by_name = {c.name: c for c in case.observations.channels}

    def back(c: Channel) -> Channel:
        body, _, axis = c.name.partition("_")
        other = by_name[f"{OTHER[body]}_{axis}"]
        stays, comes = ~np.isin(c.t, at), np.isin(other.t, at)
        t, order = np.unique(np.append(c.t[stays], other.t[comes]), return_index=True)
        return dataclasses.replace(c, t=t, value=np.append(c.value[stays], other.value[comes])[order])

    return case.with_channels(back, exchanged=tuple(at.tolist()))


def _words_of_factor(factor: float) -> str:
    times = f"{number(factor, digits=2)} times" if factor >= 1 else f"1/{number(1 / factor, digits=2)} of"
    return f" that are {times} what the declared apparatus allows"


def keys_of(before: Case, after: Case, fitted: Mapping[str, float]) -> tuple[str, str]:
    """Return what factors or places were found, in words, and the keys that change a study as a case was changed.

    Parameters
    ----------
    fitted
        Parameter -> its value in the fit to the case that was changed [SI].
    """
    old, new, words, keys = before.trial, after.trial, [], []
    if after.exchanged:
        words.append(f" from {after.exchanged[0]:.4g} s to {after.exchanged[-1]:.4g} s")
    if "times" in after.factors:
        factor = after.factors["times"] * fitted.get("clock_ratio", 1.0)
        rate = 1 / (min(c.time_step for c in before.observations.channels if c.time_step > 0) * factor)
        usual = min(USUAL_RATES, key=lambda r: abs(math.log(r / rate)))
        keys.append(f"frame_rate: {number(usual if abs(rate / usual - 1) <= NEARNESS else rate)} Hz")
        words.append(_words_of_factor(1 / after.factors["times"]))
    if "lengths" in after.factors:
        factor = after.factors["lengths"] / fitted.get("scale", 1.0)
        words.append(_words_of_factor(1 / factor))
        if before.observations.length_unit:
            words.append(f" (the header says {before.observations.length_unit})")
        else:
            keys.append(f"units: {{length: {_length_unit(factor, old)}}}")
    if new.mirrored != old.mirrored:
        keys.append(f"mirrored: {str(new.mirrored).lower()}")
    camera = []
    if (tilt := new.camera.get("tilt")) and tilt != old.camera.get("tilt"):
        error = f" +/- {number(math.degrees(tilt.sigma))} deg" if tilt.sigma else ""
        camera.append(f"tilt: {number(math.degrees(tilt.value), digits=6)} deg{error}")
    if "foreshortening" in after.open:
        factor = fitted.get("foreshortening", new.camera["foreshortening"].value)
        camera.append(f"foreshortening: {number(factor, digits=4)}")
        words.append(f", x {number(factor, digits=3)} times as long as y")
    keys += [f"camera: {{{', '.join(camera)}}}"] if camera else []
    if after.has_other_tracks:
        of_files = len(old.files) > 1
        names = {m: path for path, named in old.files for m in named} if of_files else before.observations.tracks
        written = {m: n if _PLAIN.fullmatch(n) else json.dumps(n, ensure_ascii=False) for m, n in names.items()}
        keys.append(f"{'files' if of_files else 'tracks'}: {{{', '.join(f'{m}: {written.get(o)}' for m, o in OTHER.items())}}}")
    return "".join(words), "' and '".join([*keys, *_keys_of_values(before, new)])


def _length_unit(factor: float, trial: Trial) -> str:
    """Return a unit of length that is ``factor`` times what a trial states."""
    stated = trial.units.get("length", "m")
    try:
        unit = factor * to_si(stated if stated[:1].isdigit() else f"1 {stated}", "m")
    except UnitError:
        unit = factor
    return next((n for n, size in LENGTH_UNITS.items() if abs(unit / size - 1) <= NEARNESS), f"{number(1e3 * unit)} mm")


def _keys_of_values(before: Case, trial: Trial) -> list[str]:
    """Return the keys of all values of a trial that are other than before."""
    parts: dict[str, list[str]] = {}
    for name, known in trial.estimates.items():
        if (was := before.estimate(name)) is None or known.value != was.value:
            q = QUANTITIES[name]
            shown = (
                f"{number(math.degrees(known.value))} deg"
                if q.kind.unit == "rad"
                else quantity(known.value, q.kind.unit, digits=3)
            )
            parts.setdefault(q.group, []).append(f"{q.last_key}: {shown}")
    return [f"{group}: {{{', '.join(each)}}}" for group, each in parts.items()]


def _and(first: Mistake, second: Mistake, share: float | None = None) -> Mistake:
    return Mistake(
        f"{first.name} and {second.name}",
        lambda case: None if (half := first.undo(case)) is None else second.undo(half),
        f"{first.found} and {second.found}",
        share or first.share * second.share,
        of_apparatus=first.of_apparatus or second.of_apparatus,
    )


def _wrong(share: float, factor: float, *names: str) -> Mistake:
    """Return the mistake that declared values must be multiplied by a factor."""
    words = " and ".join(n.replace("_", " ") for n in names)
    found = f"the motion of a {words} of {number(factor)} times what is declared{CAUSES.get(factor, '')}"
    return Mistake(
        f"{words} times {number(factor)}", lambda case: scaled(case, factor, *names), found, share, of_apparatus=True
    )


PICTURES = tuple(
    Mistake(name, lambda case, m=mirror, t=turns: pictured(case, m, t), found)  # type: ignore[misc]
    for name, mirror, turns, found in (
        ("mirrored", True, 0, "a mirrored motion"),
        ("upside down", True, 2, "a motion that is upside down, as where y grows downwards"),
        ("half turn", False, 2, "a motion that is turned by 180 deg, as by a camera upside down"),
        ("quarter turn to the left", False, 1, "a motion that is turned counterclockwise by 90 deg, as by a sideways camera"),
        ("quarter turn to the right", False, -1, "a motion that is turned clockwise by 90 deg, as by a sideways camera"),
        ("axes exchanged", True, 1, "a motion with x and y exchanged"),
        ("axes exchanged and reversed", True, -1, "a motion with x and y exchanged, and both reversed"),
    )
)
TRACKS = Mistake("tracks exchanged", with_other_tracks, "the heavy mass's motion in the light mass's track")
MASSES = Mistake(
    "masses exchanged", with_other_masses, "the motion of a light mass and a heavy mass that are exchanged", of_apparatus=True
)
LENGTHS = Mistake("unit of length", longer, "lengths")
SQUEEZED = Mistake("axes of different size", squeezed, "axes of different size, as where a film's pixels are not square")
RATES = tuple(Mistake("frame rate", lambda case, f=factor: slower(case, f), "times", COMMON / 10) for factor in TIME_FACTORS)  # type: ignore[misc]
ROWS = Mistake(
    "rows exchanged", with_rows_exchanged_back,
    "the points of the two masses exchanged in rows",
    way_out="each mass in its own columns: exchange them there, or leave these rows out",
)  # fmt: skip
ANGLES = (
    math.degrees, math.radians, lambda a: math.pi - a, lambda a: 2 * math.pi - a, lambda a: 1.5 * math.pi - a,
    lambda a: a + math.pi / 2, lambda a: a - math.pi / 2,
)  # fmt: skip
COLUMNS = tuple(
    Mistake(
        "columns exchanged",
        lambda case, a=first, b=second: renamed(case, {a: b, b: a}),  # type: ignore[misc]
        f"the columns of {first} and {second} exchanged",
        RARE,
        "each column under its own name; correct the names in the file",
    )
    for first, second in (("light_x", "light_y"), ("heavy_x", "heavy_y"), ("light_y", "heavy_y"), ("light_x", "heavy_x"))
)
PLACES = tuple(
    Mistake("release place", undo, "another place of release than declared")
    for undo in (placed, *(lambda case, f=f: angled(case, f) for f in ANGLES))
)
HIDDEN = (
    ROWS, MASSES, SQUEEZED, *PLACES,
    *(_wrong(share, f, "rod_radius") for f, share in ((1 / 2, COMMON), (1 / 10, RARE), (10.0, RARE))),
    *(_wrong(RARE, f, f"{m}_mass") for m in OTHER for f in (1e-3, 1 / 10, 10.0, 1e3)),
    *(_wrong(COMMON, f, "light_mass", "heavy_mass") for f in (1e-3, 1e3)),
)  # fmt: skip
"""Mistakes that look like an effect of a usual size."""
MISTAKES = (
    *PICTURES, TRACKS, LENGTHS, *HIDDEN, _and(PICTURES[0], TRACKS), *COLUMNS,
    dataclasses.replace(_and(TRACKS, MASSES, COMMON), name="light and heavy exchanged"),
    *(_and(first, LENGTHS) for first in (*PICTURES, TRACKS, SQUEEZED)),
    *RATES, *(_and(first, rate) for first in (PICTURES[0], TRACKS) for rate in RATES),
)  # fmt: skip
"""All mistakes that are looked for, each alone, and the commonest mistakes of filming in pairs."""
