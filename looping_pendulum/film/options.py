"""Read what a person says of a film: lengths with errors, places in it, a rule, a region."""

from __future__ import annotations

import re

from looping_pendulum.errors import one_line, shorten
from looping_pendulum.film.decode import FilmError
from looping_pendulum.film.track import ScaleRule, Shown
from looping_pendulum.scenarios.units import UnitError, to_si

_NUMBER = r"\d{1,6}(?:\.\d{1,6})?"
_PLACE = re.compile(rf"({_NUMBER}),({_NUMBER})")
_SHOWN = re.compile(rf"({_NUMBER}),({_NUMBER})@(\d{{1,7}})")
_REGION = re.compile(rf"({_NUMBER}),({_NUMBER}) ({_NUMBER}),({_NUMBER})")
MAX_LENGTH = 100.0
"""Largest length of an apparatus [m]; a larger one is in another unit."""

MAX_RATE = 1e6
"""Largest frame rate [Hz]."""


def _error(option: str, text: str, needed: str) -> FilmError:
    return FilmError(one_line(f"{option}: found '{shorten(text)}', needed {needed}"))


def read_length(option: str, text: str) -> tuple[float, float]:
    """Return a length and its standard error [m] of a text such as "58 cm +/- 1 mm"; the error is 0 if none is stated.

    Raises
    ------
    FilmError
        If it is no length above 0.
    """
    needed = f'a length; write for example {option} "58 cm +/- 1 mm"'
    value, sign, error = text.partition("+/-")
    try:
        length = to_si(value, "m")
        if not sign:
            sigma = 0.0
        elif error.strip().endswith("%"):
            sigma = length * to_si(error.strip()[:-1], "") / 100
        else:
            sigma = to_si(error, "m")
    except UnitError:
        raise _error(option, text, needed) from None
    if not (0 < length <= MAX_LENGTH and 0 <= sigma < length):
        raise _error(option, text, needed)
    return length, sigma


def read_quantity(option: str, text: str, unit: str, example: str) -> float:
    """Return a quantity [SI] that is not negative.

    Raises
    ------
    FilmError
        If it is none of that unit.
    """
    try:
        value = to_si(text, unit)
    except UnitError:
        value = -1.0
    if value < 0:
        raise _error(option, text, f'a quantity in {unit}; write for example {option} "{example}"')
    return value


def read_rate(option: str, text: str) -> float:
    """Return a frame rate [Hz] above 0; a number without a unit is one.

    Raises
    ------
    FilmError
        If it is none.
    """
    try:
        rate = to_si(text, "Hz" if any(c.isalpha() for c in text) else "")
    except UnitError:
        rate = 0.0
    if not 0 < rate <= MAX_RATE:
        raise _error(option, text, f'frames per second; write for example {option} "240 Hz"')
    return rate


def read_place(option: str, text: str) -> tuple[float, float]:
    """Return a place in the picture [pixels, y downwards] of "X,Y".

    Raises
    ------
    FilmError
        If it is none.
    """
    match = _PLACE.fullmatch(text.strip())
    if match is None:
        raise _error(option, text, f"a place in the picture in pixels; write for example {option} 790,262")
    return float(match[1]), float(match[2])


def read_shown(option: str, text: str) -> Shown:
    """Return a place in a frame of "X,Y@FRAME".

    Raises
    ------
    FilmError
        If it is none.
    """
    match = _SHOWN.fullmatch(text.strip())
    if match is None:
        raise _error(option, text, f"a place in pixels and the frame's number; write for example {option} 343,438@72")
    return Shown(float(match[1]), float(match[2]), int(match[3]))


def read_rule(option: str, text: str) -> ScaleRule:
    """Return a rule of "640,120 640,920 = 1 m".

    Raises
    ------
    FilmError
        If it is none.
    """
    needed = f'two places in pixels and their distance; write for example {option} "640,120 640,920 = 1 m"'
    places, _, length = text.partition("=")
    match = _REGION.fullmatch(" ".join(places.split()))
    if match is None:
        raise _error(option, text, needed)
    x0, y0, x1, y1 = (float(v) for v in match.groups())
    try:
        metres = to_si(length, "m")
    except UnitError:
        raise _error(option, text, needed) from None
    if not 0 < metres <= MAX_LENGTH or (x0, y0) == (x1, y1):
        raise _error(option, text, needed)
    return ScaleRule((x0, y0), (x1, y1), metres)


def read_region(option: str, text: str) -> tuple[int, int, int, int]:
    """Return left, top, right and bottom [pixels] of "X,Y X,Y".

    Raises
    ------
    FilmError
        If it is no rectangle.
    """
    match = _REGION.fullmatch(" ".join(text.split()))
    x0, y0, x1, y1 = (int(float(v)) for v in match.groups()) if match else (0, 0, 0, 0)
    if x1 <= x0 or y1 <= y0:
        raise _error(option, text, f'two corners in pixels, left upper one first; write for example {option} "100,80 1200,700"')
    return x0, y0, x1, y1
