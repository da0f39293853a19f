"""Formats numbers for readers: two or three significant digits, a unit that suits the size, no exponent."""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

GAP = "–"
"""Text in place of a missing number."""


class DisplayUnit(NamedTuple):
    """Unit in which tables show a column of numbers, whatever their size."""

    name: str
    per_si_unit: float
    """Number of these units in one SI unit."""


DISPLAY_UNITS = MappingProxyType(
    {
        "m": DisplayUnit("mm", 1e3),
        "s": DisplayUnit("ms", 1e3),
        "rad": DisplayUnit("mrad", 1e3),
        "rad/s": DisplayUnit("mrad/s", 1e3),
    }
)
"""SI unit -> unit in which errors and deviations are shown."""

PERCENT = DisplayUnit("%", 1e2)
"""Unit in which relative errors and shares are shown."""

PLAIN_EXPONENTS = range(-4, 7)
"""Powers of ten of a number's first digit at which it is written without an exponent: 0.0001 to 9999999."""

MAX_DIGITS = 6
"""Largest number of significant digits of a value whose error is very small."""


def number(value: float | None, scale: float = 1.0, digits: int = 3) -> str:
    """Return ``value * scale`` to ``digits`` significant digits, without an exponent as long as that is readable."""
    if value is None:
        return GAP
    scaled = float(value) * scale
    if not math.isfinite(scaled):
        return str(scaled)
    mantissa, exponent = f"{scaled:.{digits - 1}e}".split("e")
    if float(mantissa) == 0:
        return "0"
    if int(exponent) in PLAIN_EXPONENTS:
        # Rounded already, so that 0.99996 is judged and written as the 1 that it becomes.
        return np.format_float_positional(float(f"{mantissa}e{exponent}"), trim="-")
    return f"{mantissa.rstrip('0').rstrip('.') if '.' in mantissa else mantissa}e{int(exponent)}"


def amount(value: float | None, scale: float = 1.0, digits: int = 2) -> str:
    """Format like `number`, but keep all digits before the decimal point: 262 with ``digits=2``, not 260."""
    if value is None or not 1 <= abs(value * scale) < 10.0**PLAIN_EXPONENTS.stop:
        return number(value, scale, digits)
    size = round(float(value) * scale, max(0, digits - 1 - math.floor(math.log10(abs(value * scale)))))
    return number(size, digits=max(digits, PLAIN_EXPONENTS.stop))


def signed(value: float | None, scale: float = 1.0, digits: int = 3) -> str:
    """Format like `number`, with a sign for positive values too."""
    text = number(value, scale, digits)
    return f"+{text}" if value is not None and value * scale > 0 else text


def fixed(value: float | None, decimals: int) -> str:
    """Return ``value`` with a fixed number of decimals."""
    return GAP if value is None else f"{value:.{decimals}f}"


_Step = tuple[float, str, float]
"""Size of a unit in the SI unit, its name, and the smallest number that is written in it: smaller ones use the next unit."""


def _metric(unit: str) -> tuple[_Step, ...]:
    """Return the steps of a unit; thousandths are used down to 0.01, since 0.053 mm is easier to read than 53 µm."""
    return (1.0, unit, 1.0), (1e-3, f"m{unit}", 0.01), (1e-6, f"µ{unit}", 0.01), (1e-9, f"n{unit}", 0.0)


_STEPS: dict[str, tuple[_Step, ...]] = {
    "m": _metric("m"),
    "s": _metric("s"),
    "N": _metric("N"),
    "m/s": _metric("m/s"),
    "kg": ((1.0, "kg", 1.0), (1e-3, "g", 0.01), (1e-6, "mg", 0.0)),
    "rad": ((math.pi / 180, "deg", 0.01), (1e-6, "µrad", 0.01), (1e-9, "nrad", 0.0)),
}
"""SI unit -> units in which it is written, the largest first."""


def quantity(value: float | None, unit: str, digits: int = 2) -> str:
    """Return an amount in SI with the unit that a person would choose: "700 ms", "0.053 mm", "12 mm", "1.2 s".

    Parameters
    ----------
    value
        In ``unit``; its sign is kept. None gives a gap.
    unit
        SI unit; one without smaller siblings in this module stays as it is.
    digits
        Significant digits. A whole number of three digits keeps them all: "278 mm".
    """
    if value is None:
        return GAP
    size = float(value)
    steps = _STEPS.get(unit, ((1.0, unit, 0.0),))
    if size == 0 or not math.isfinite(size):
        return f"{number(size)} {steps[min(1, len(steps) - 1)][1]}".rstrip()
    texts = ((amount(size / unit_size, digits=digits), name, least) for unit_size, name, least in steps)
    text, name = next((text, name) for text, name, least in texts if abs(float(text)) >= least)
    return f"{text} {unit_in_words(name)}".rstrip()


def unit_in_words(unit: str) -> str:
    """Return a unit as people write it: "m/s^2" for "m/s**2"."""
    return unit.replace("**", "^")


def uncertain(value: float | None, error: float | None, unit: str = "") -> str:
    """Return "0.0133 +/- 0.00042 kg/s": the error to two digits, and the value to the same decimal place.

    Parameters
    ----------
    error
        Standard error in the same unit. None, zero or one that is not finite leaves the value alone, to four digits.
    """
    if value is None:
        return GAP
    if error is None or not math.isfinite(error) or error <= 0 or not math.isfinite(value):
        return f"{number(value, digits=4)} {unit_in_words(unit)}".rstrip()
    largest = max(abs(value), error)
    power = math.floor(math.log10(largest))
    # Of the error as it will be written: 0.0996 becomes 0.10, which has one decimal less
    last = math.floor(math.log10(float(f"{error:.1e}"))) - 1
    if power - last > MAX_DIGITS:  # more digits would not be readable
        text = f"{number(value, digits=MAX_DIGITS)} +/- {number(error, digits=2)}"
    elif power in PLAIN_EXPONENTS:
        text = " +/- ".join(f"{round(x, -last):.{max(0, -last)}f}" for x in (value, error))
    else:
        inner = " +/- ".join(f"{x / 10.0**power:.{power - last}f}" for x in (value, error))
        text = f"({inner})e{power}"
    return f"{text} {unit_in_words(unit)}".rstrip()
