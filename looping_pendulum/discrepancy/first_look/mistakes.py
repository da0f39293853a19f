"""The mistakes that a first look can name, and which of them explain why one trial's points are far from the declared motion.

A table says how each is undone, what it makes wrong, and the key that corrects it.
"""

from __future__ import annotations

import dataclasses
import json
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np

from looping_pendulum.discrepancy.first_look.evidence import Evidence
from looping_pendulum.discrepancy.first_look.misfit import (
    MIN_UNIT_FACTOR,
    OTHER_MASS,
    DeclaredTrial,
    Distance,
    evidence_of_trial,
    measured_distance,
    pictured_otherwise,
    released_where_first_seen,
    with_columns_exchanged,
    with_lengths,
    with_masses_exchanged,
    with_tracks_exchanged,
)
from looping_pendulum.discrepancy.first_look.prior import COMMON, RARE
from looping_pendulum.measured.study import Trial
from looping_pendulum.pages.numbers import number, quantity
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios.units import UnitError, to_si

Undo = Callable[[DeclaredTrial], DeclaredTrial | None]
"""Function that returns a trial without a mistake; None: the trial cannot have that mistake."""

TIME_FACTORS = (
    *(f for f in (2.0 ** (np.arange(-28, 29) / 4)).tolist() if not 1 / MIN_UNIT_FACTOR < f < MIN_UNIT_FACTOR), 1e-3, 1e3,
)  # fmt: skip
"""Factors on the file's times that are tried: steps of 1/4 octave, and milliseconds; a fit refines the best."""
MAX_DECLARED_ERROR = 0.1
"""Largest standard error, or distance from 1, of a declared scale or clock ratio with which a trial is looked at.

Beyond it the study itself says that lengths or times may be off by a factor.
"""
FRAME_RATES = (24.0, 25.0, 30.0, 48.0, 50.0, 60.0, 90.0, 100.0, 120.0, 200.0, 240.0, 250.0, 300.0, 400.0, 480.0, 500.0, 600.0,
               960.0, 1000.0)  # fmt: skip
"""Frame rates of cameras [Hz], one of which is named if the points' rate is near it."""
LENGTH_UNITS = {"mm": 1e-3, "cm": 1e-2, "inch": 0.0254, "foot": 0.3048, "m": 1.0}
"""Units of length that are named if the points' unit is near one of them [m]."""
NEARNESS = 0.05
"""Largest relative distance from a usual frame rate or unit at which that one is named."""
CAUSES = {1 / 2: ", as where a diameter was given for the radius", 1e-3: ", as where kg was written for g",
          1e3: ", as where g was written for kg",
          **dict.fromkeys((1 / 10, 10.0), ", as by a slip of the decimal point")}  # fmt: skip
"""Factor that a declared value must be multiplied by -> its likely cause in words."""
_PLAIN_NAME = re.compile(r"\w(?:[\w ./()+-]*[\w.()+-])?")
"""Name that YAML reads as it stands, also within braces."""
WITH_BOTH_MASSES = (Release.LOOPING, Release.VERTICAL)
"""Releases in whose motion both masses and the rod's radius take part."""
MAX_GOOD_MISFIT = 1.2
"""Largest misfit of a trial in which no mistake is looked for: the noise of points is not known better."""
MIN_DROP_DISTANCE = 0.25
"""Smallest distance of a dropped mass from its fall in the first part, in units of its free length, that may be a mistake.

Its path has one number, which the air, the scale and the clock change alike: real drops are up to 0.11 off.
"""
MIN_POINTS_OF_FRAME_RATE = 10
"""Smallest number of points in the first part of the motion after a factor on the times: fewer fit too many motions."""
MAX_TRIED = 6
"""Number of mistakes, those of the smallest distances, whose probability is computed."""


@dataclass(frozen=True, kw_only=True)
class Mistake:
    """A mistake of filming or of declaration, large enough to be seen before any fit."""

    name: str
    """Short name; variants of one mistake, as by other factors, share it."""
    undo: Undo
    found: Callable[[Correction], str]
    """What is wrong with the points or the declaration, in words."""
    keys: Callable[[Correction], str] = lambda undone: ""
    """Keys of the study that correct it, with their values; '' if none does."""
    way_out: Callable[[Correction], str] = lambda undone: ""
    """What else corrects it, where no key does."""
    releases: tuple[Release, ...] = tuple(Release)
    of_apparatus: bool = False
    """Whether the mended key may stand in `apparatus`, so that all trials together say whether it is wrong."""
    fits: tuple[str, ...] = ()
    """Camera parameters that a fit refines: "clock_ratio" after a factor on times, "scale" after one on lengths."""
    steps: int = 1
    """Number of mistakes that this one is made of."""
    share: float = COMMON
    """Prior probability."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Correction:
    """A trial before and after a mistake that may have been made was undone."""

    mistake: Mistake
    declared: DeclaredTrial
    corrected: DeclaredTrial
    distance: Distance
    """Distance of the points from the motion without the mistake."""
    guessed_factors: Mapping[str, float]
    """What the points' "lengths" and "times" must be multiplied by, from a grid or the motion before anything is fitted."""

    @cached_property
    def search(self) -> TrialSearch:
        """Return the trial without the mistake, to be looked at as any other."""
        return TrialSearch(declared=self.corrected, distance=self.distance)

    @property
    def evidence(self) -> Evidence:
        """Return how probable the points are without the mistake."""
        return self.search.as_declared

    @cached_property
    def factors(self) -> dict[str, float]:
        """Return `guessed_factors` as the fit refines them."""
        factors = dict(self.guessed_factors)
        if "times" in factors:
            factors["times"] *= self.evidence.values.get("clock_ratio", 1.0)
        if "lengths" in factors:
            factors["lengths"] /= self.evidence.values.get("scale", 1.0)
        return factors

    @property
    def log_posterior(self) -> float:
        """Return the logarithm of the probability of the mistake, but for a constant."""
        return self.evidence.log + math.log(self.mistake.share)

    @property
    def is_of_trial(self) -> bool:
        """Return whether the trial itself states all values that are corrected."""
        before, after = self.declared.trial.estimates, self.corrected.trial.estimates
        return before.keys() >= {name for name, value in after.items() if value != before.get(name)}

    def value(self, parameter: str, *, corrected: bool = True) -> float:
        """Return the corrected or the declared value of a parameter [SI]."""
        known = (self.corrected if corrected else self.declared).estimate(parameter)
        return math.nan if known is None else known.value


def is_left_open(trial: Trial, name: str) -> bool:
    """Return whether the study says that this parameter of the camera may be far from 1."""
    known = trial.camera.get(name)
    return known is not None and (
        known.free or (known.sigma or 0.0) > MAX_DECLARED_ERROR or abs(known.value - 1) > MAX_DECLARED_ERROR
    )


def _times_text(factor: float) -> str:
    """Write a factor as "25 times" or "1/25 of"."""
    return f"{number(factor, digits=2)} times" if factor >= 1 else f"1/{number(1 / factor, digits=2)} of"


def _frame_rate(undone: Correction) -> str:
    """Return the key of the frame rate, and the rate that the corrected times have."""
    step = min(c.time_step for c in undone.declared.observations.channels if c.time_step > 0)
    rate = 1 / (step * undone.factors["times"])
    usual = min(FRAME_RATES, key=lambda r: abs(math.log(r / rate)))
    rate = usual if abs(rate / usual - 1) <= NEARNESS else rate
    return f"frame_rate: {number(rate)} Hz"


def _length_unit(undone: Correction) -> str:
    """Return the key of the unit of length: a usual unit, or how long one unit of the file is, as of a pixel."""
    if undone.declared.observations.length_unit:
        return ""
    declared_unit = undone.declared.trial.units.get("length", "m")
    try:
        unit = to_si(declared_unit if declared_unit[:1].isdigit() else f"1 {declared_unit}", "m") * undone.factors["lengths"]
    except UnitError:
        unit = undone.factors["lengths"]
    for name, size in LENGTH_UNITS.items():
        if abs(unit / size - 1) <= NEARNESS:
            return f"units: {{length: {name}}}"
    return f"units: {{length: {number(1e3 * unit)} mm}}"


def _picture_keys(undone: Correction) -> str:
    """Return the keys of a picture that is mirrored, turned or both."""
    before, after = undone.declared.trial, undone.corrected.trial
    keys = [f"mirrored: {str(after.mirrored).lower()}"] if after.mirrored != before.mirrored else []
    tilt = after.camera.get("tilt")
    if tilt is not None and tilt != before.camera.get("tilt"):
        free = "free from " if tilt.free else ""
        error = f" +/- {number(math.degrees(tilt.sigma))} deg" if tilt.sigma else ""
        keys.append(f"camera: {{tilt: {free}{number(math.degrees(tilt.value), digits=6)} deg{error}}}")
    return "' and '".join(keys)


def _tracks(undone: Correction) -> str:
    """Return the key that exchanges the tracks, or the files of the two masses."""
    trial = undone.declared.trial
    if len(trial.files) > 1:
        return f"files: {_by_other_mass({mass: path for path, named in trial.files for mass in named})}"
    return f"tracks: {_by_other_mass(undone.declared.observations.tracks)}"


def _by_other_mass(names: Mapping[str, str]) -> str:
    """Write the names of the masses' tracks or files as a study file has them, each for the other mass."""
    written = {m: n if _PLAIN_NAME.fullmatch(n) else json.dumps(n, ensure_ascii=False) for m, n in names.items()}
    return f"{{{', '.join(f'{mass}: {written[other]}' for mass, other in OTHER_MASS.items())}}}"


def _changes_of_place(undone: Correction, *, key: bool) -> list[str]:
    """Return what is changed of the place of release, as keys or in words with the declared values."""
    parts = []
    for parameter, as_key, in_words in (
        ("free_length", "free_length: {}", "{} from the rod instead of the declared {}"),
        ("release_angle", "angle: {}", "near {} (0: straight up, 180: straight down) instead of the declared {}"),
    ):
        values = [undone.value(parameter, corrected=corrected) for corrected in (True, False)]
        if values[0] != values[1]:
            shown = (
                quantity(v, "m", digits=3) if parameter == "free_length" else f"{number(math.degrees(v))} deg" for v in values
            )
            parts.append((as_key if key else in_words).format(*shown))
    return parts


def _joined(first: Mistake, second: Mistake) -> Mistake:
    """Return two mistakes at once."""

    def undo(declared: DeclaredTrial) -> DeclaredTrial | None:
        half = first.undo(declared)
        return None if half is None else second.undo(half)

    return Mistake(
        name=f"{first.name} and {second.name}",
        undo=undo,
        found=lambda undone: f"{first.found(undone)} and {second.found(undone)}",
        keys=lambda undone: "' and '".join(filter(None, (first.keys(undone), second.keys(undone)))),
        way_out=lambda undone: " and ".join(filter(None, (first.way_out(undone), second.way_out(undone)))),
        fits=first.fits + second.fits,
        steps=first.steps + second.steps,
        share=first.share * second.share,
    )


# A row: whether it is undone by a mirror image, by how many quarter turns of the tilt, and what is found
PICTURES = tuple(
    Mistake(
        name=name,
        undo=partial(pictured_otherwise, mirror=mirror, quarter_turns=turns),
        found=lambda undone, found=found: found,  # type: ignore[misc]
        keys=_picture_keys,
    )
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
"""All symmetries of the square."""
MIRRORED = PICTURES[0]
TRACKS_EXCHANGED = Mistake(
    name="tracks exchanged",
    undo=with_tracks_exchanged,
    found=lambda undone: "the heavy mass's motion in the light mass's track",
    keys=_tracks,
)
COLUMNS_EXCHANGED = tuple(
    Mistake(
        name="columns exchanged",
        undo=partial(with_columns_exchanged, first=first, second=second),
        found=lambda undone, first=first, second=second: f"the columns of {first} and {second} exchanged",  # type: ignore[misc]
        way_out=lambda undone: "each column under its own name; correct the names in the file",
        share=RARE,
    )
    for first, second in (("light_x", "light_y"), ("heavy_x", "heavy_y"), ("light_y", "heavy_y"), ("light_x", "heavy_x"))
)
"""Those of one mass, and one of each: all of both are other mistakes."""
MASSES_EXCHANGED = Mistake(
    name="masses exchanged",
    undo=with_masses_exchanged,
    found=lambda undone: "the motion of a light mass and a heavy mass that are exchanged",
    keys=lambda undone: "' and '".join(
        f"{mass}: {{mass: {quantity(undone.value(f'{mass}_mass'), 'kg', digits=3)}}}" for mass in ("light", "heavy")
    ),
    releases=WITH_BOTH_MASSES,
    of_apparatus=True,
)
LENGTHS = Mistake(
    name="unit of length",
    # The factor follows from the points themselves (`misfit.measured_distance`)
    undo=lambda declared: declared,
    found=lambda undone: f"lengths that are {_times_text(1 / undone.factors['lengths'])} what the declared apparatus allows",
    keys=_length_unit,
    way_out=lambda undone: (
        f"the header to name the unit of the points; it says {unit}"
        if (unit := undone.declared.observations.length_unit)
        else ""
    ),
    fits=("scale",),
)


def _times(factor: float) -> Mistake:
    return Mistake(
        name="frame rate",
        undo=lambda declared: declared.with_channels(lambda c: dataclasses.replace(c, t=c.t * factor)),
        found=lambda undone: f"times that are {_times_text(1 / undone.factors['times'])} what the declared apparatus allows",
        keys=_frame_rate,
        fits=("clock_ratio",),
    )


def _angle(change: Callable[[float], float]) -> Mistake:
    """Return the mistake that the declared release angle [rad] must be changed."""

    def undo(declared: DeclaredTrial) -> DeclaredTrial | None:
        known = declared.estimate("release_angle")
        if known is None or not 0 < change(known.value) < 2 * math.pi:
            return None
        return declared.with_values({"release_angle": change(known.value)})

    return _place(undo)


def _place(undo: Undo) -> Mistake:
    return Mistake(
        name="release place",
        undo=undo,
        found=lambda undone: f"a release {' and '.join(_changes_of_place(undone, key=False))}",
        keys=lambda undone: f"release: {{{', '.join(_changes_of_place(undone, key=True))}}}",
    )


def _value(name: str, parameters: Mapping[str, str], factor: float, share: float = COMMON) -> Mistake:
    """Return the mistake that declared values must be multiplied by a factor.

    Parameters
    ----------
    parameters
        Parameter -> its SI unit.
    """
    in_words = " and ".join(p.replace("_", " ") for p in parameters)

    def undo(declared: DeclaredTrial) -> DeclaredTrial | None:
        known = {p: e for p in parameters if (e := declared.estimate(p)) is not None}
        return declared.with_values({p: e.value * factor for p, e in known.items()}) if len(known) == len(parameters) else None

    def keys(undone: Correction) -> str:
        parts = []
        for parameter, unit in parameters.items():
            where, _, key = parameter.partition("_")
            parts.append(f"{where}: {{{key}: {quantity(undone.value(parameter), unit, digits=3)}}}")
        return "' and '".join(parts)

    return Mistake(
        name=name,
        undo=undo,
        found=lambda undone: f"the motion of a {in_words} of {number(factor)} times what is declared{CAUSES.get(factor, '')}",
        keys=keys,
        releases=WITH_BOTH_MASSES,
        of_apparatus=True,
        share=share,
    )


EXCHANGED = _joined(TRACKS_EXCHANGED, MASSES_EXCHANGED)
MISTAKES = (
    *PICTURES,
    TRACKS_EXCHANGED,
    *COLUMNS_EXCHANGED,
    MASSES_EXCHANGED,
    # After a vertical release, a mirrored picture looks as if both were exchanged
    dataclasses.replace(EXCHANGED, name="light and heavy exchanged", releases=(Release.LOOPING,), steps=1, share=COMMON),
    LENGTHS,
    *(_joined(first, LENGTHS) for first in (*PICTURES, TRACKS_EXCHANGED)),
    *(mistake for factor in TIME_FACTORS for mistake in (_times(factor), _joined(MIRRORED, _times(factor)),
                                                         _joined(TRACKS_EXCHANGED, _times(factor)))),
    _joined(MIRRORED, TRACKS_EXCHANGED),
    _place(released_where_first_seen),
    # These need no origin at the rod
    *(_angle(change) for change in (
        math.degrees,
        math.radians,
        lambda angle: math.pi - angle,
        lambda angle: 2 * math.pi - angle,
        lambda angle: 1.5 * math.pi - angle,
        lambda angle: angle + math.pi / 2,
        lambda angle: angle - math.pi / 2,
    )),
    # A radius that is twice what was declared is no common mistake, and more friction looks alike
    *(_value(f"rod radius times {number(factor)}", {"rod_radius": "m"}, factor, share)
      for factor, share in ((1 / 2, COMMON), (1 / 10, RARE), (10.0, RARE))),
    *(_value(f"{' and '.join(m)} mass", {f"{mass}_mass": "kg" for mass in m}, factor, share)
      for m, share in ((("light",), RARE), (("heavy",), RARE), (("light", "heavy"), COMMON)) for factor in (1e-3, 1e3)),
    *(_value(f"{mass} mass", {f"{mass}_mass": "kg"}, factor, RARE) for mass in ("light", "heavy") for factor in (1 / 10, 10.0)),
)  # fmt: skip
"""All mistakes that are tried, each alone, and the commonest mistakes of filming in pairs."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrialSearch:
    """Misfits of one trial, computed when they are asked for."""

    declared: DeclaredTrial
    distance: Distance
    _tried: dict[int, list[Correction]] = field(default_factory=dict)
    """Number of steps -> the best corrections of so many."""
    _undone: dict[Mistake, Correction | None] = field(default_factory=dict)
    """Mistake -> the trial without it, which several trials ask for."""

    @property
    def name(self) -> str:
        """Return the trial's name."""
        return self.declared.trial.name

    @property
    def is_near(self) -> bool:
        """Return whether the points are as near to the declared motion as those of a trial without a mistake may be."""
        if self.declared.trial.release is Release.DROP and self.distance.relative < MIN_DROP_DISTANCE:
            return True
        return self.as_declared.misfit <= MAX_GOOD_MISFIT and self.as_declared.lacks_nothing

    @cached_property
    def as_declared(self) -> Evidence:
        """Return how probable the points are with the study as it is."""
        return evidence_of_trial(self.declared, self.distance)

    def corrections(self, steps: int) -> list[Correction]:
        """Return mistakes of so many steps that leave the points nearer to the motion, nearest first; of variants the best."""
        if steps not in self._tried:
            best: dict[str, Correction] = {}
            for mistake in (m for m in MISTAKES if m.steps == steps):
                correction = self._correction(mistake)
                nearest = best[mistake.name].distance if mistake.name in best else self.distance
                if correction is not None and correction.distance.relative < nearest.relative:
                    best[mistake.name] = correction
            self._tried[steps] = sorted(best.values(), key=lambda c: c.distance.relative)
        return self._tried[steps]

    def explanations(self, steps: int) -> list[Correction]:
        """Return the mistakes of so many steps without which the points are nearest, the most probable one first."""
        tried = self.corrections(steps)[:MAX_TRIED]
        return sorted(tried, key=lambda e: e.log_posterior, reverse=True)

    def explanation_by(self, mistake: Mistake, *, nearer: bool = True) -> Correction | None:
        """Return a mistake of another trial as an explanation of this one; None: it cannot have it.

        Parameters
        ----------
        nearer
            Whether it has no mistake that brings its points no nearer.
        """
        correction = self._correction(mistake)
        if nearer and correction is not None and correction.distance.relative >= self.distance.relative:
            return None
        return correction

    def _correction(self, mistake: Mistake) -> Correction | None:
        """Return the trial without a mistake, or None, as `_without` does, which is asked once."""
        if mistake not in self._undone:
            self._undone[mistake] = self._without(mistake)
        return self._undone[mistake]

    def _without(self, mistake: Mistake) -> Correction | None:
        """Return the trial without a mistake; None: it cannot have it, the factor is too near 1, or leaves too few points."""
        declared = self.declared
        corrected = mistake.undo(declared) if declared.trial.release in mistake.releases else None
        if corrected is None:
            return None
        of_length = "scale" in mistake.fits
        distance = measured_distance(corrected, with_length_factor=of_length)
        factors = {}
        if of_length:
            factors["lengths"] = factor = distance.length_factor
            if 1 / MIN_UNIT_FACTOR < factor < MIN_UNIT_FACTOR:
                return None
            corrected = with_lengths(corrected, factor)
        if "clock_ratio" in mistake.fits:
            if max((len(c) for c, _ in distance.points), default=0) < MIN_POINTS_OF_FRAME_RATE:
                return None
            before, after = (d.observations.channels[0].t[-1] for d in (declared, corrected))
            factors["times"] = float(after / before)
        return Correction(mistake=mistake, declared=declared, corrected=corrected, distance=distance, guessed_factors=factors)
