"""Numbers with their units written out: "6.25 mm" to 0.00625 and back, without a rounding error on the way."""

from __future__ import annotations

import decimal
import functools
import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal
from typing import Any

DEGREE = "0.01745329251994329576923690768488612713443"
"""One degree [rad], to 40 digits."""

DEFINITIONS = f"""
nano- = 1e-9 = n-
micro- = 1e-6 = µ- = u-
milli- = 1e-3 = m-
centi- = 1e-2 = c-
deci- = 1e-1 = d-
hecto- = 1e2 = h-
kilo- = 1e3 = k-
mega- = 1e6 = M-
meter = [length] = m = metre
second = [time] = s = sec
gram = [mass] = g
kelvin = [temperature] = K
radian = [angle] = rad
degree = {DEGREE} * radian = deg = °
turn = 6.283185307179586476925286766559005768394 * radian = _ = revolution
percent = 0.01 = %
minute = 60 * second = min
hertz = 1 / second = Hz
newton = kilogram * meter / second ** 2 = N
pascal = newton / meter ** 2 = Pa
joule = newton * meter = J
watt = joule / second = W
inch = 0.0254 * meter = in
foot = 0.3048 * meter = ft = feet
pound = 0.45359237 * kilogram = lb
ounce = 0.028349523125 * kilogram = oz
byte = [memory] = B
gigabyte = 1e9 * byte = GB
kibibyte = 1024 * byte = KiB
mebibyte = 1024 * kibibyte = MiB
gibibyte = 1024 * mebibyte = GiB
"""
"""Units that a scenario or a limit on memory may use, for pint.

A short list rather than pint's own: it loads in milliseconds, an angle is no plain number in it (so that "112" is no angle and
"10 deg" no friction), and a slip of the pen is an unknown unit rather than a barn or a fortnight.
"""

WORDS = {
    "": "a plain number",
    "m": "a length",
    "kg": "a mass",
    "s": "a time",
    "rad": "an angle",
    "m/s": "a speed",
    "m/s**2": "an acceleration",
    "m**2": "an area",
    "kg/m": "a drag coefficient (mass per length)",
    "kg/m**2": "a string drag coefficient (mass per area)",
    "kg/m**3": "a density",
    "kg/s": "a linear drag coefficient (mass per time)",
    "N": "a force",
    "N/m": "a stiffness",
    "byte": "an amount of memory",
}
"""SI unit -> what a quantity in it is called."""

EXAMPLES = {
    "": "0.34",
    "m": "6.25 mm",
    "kg": "10 g",
    "s": "0.5 s",
    "rad": "112 deg",
    "m/s**2": "9.81 m/s^2",
    "m**2": "4 cm^2",
    "kg/m": "1e-3 kg/m",
    "kg/m**2": "1e-3 kg/m^2",
    "kg/m**3": "1.2 kg/m^3",
    "byte": "2 GiB",
}
"""SI unit -> a quantity in it as one would write it."""

COMMON = {
    ("%", ""): Decimal("0.01"),
    ("mm", "m"): Decimal("0.001"),
    ("cm", "m"): Decimal("0.01"),
    ("g", "kg"): Decimal("0.001"),
    ("ms", "s"): Decimal("0.001"),
    ("deg", "rad"): Decimal(DEGREE),
    ("MiB", "byte"): Decimal(1024**2),
    ("GiB", "byte"): Decimal(1024**3),
} | {(written, unit): Decimal(1) for unit in WORDS for written in (unit, unit.replace("**", "^"))}
"""What is written, and the SI unit wanted -> how many of those it is, for what nearly all files write.

pint says the same, but its import takes longer than a whole command does without it.
"""

_DIGITS = decimal.Context(prec=60, Emin=-9999, Emax=9999)
_NUMBER = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]{1,3})?")
# One digit per exponent and a few factors: pint expands powers, and m^999999999 would fill the memory.
_FACTOR = r"[A-Za-zµ°%]{1,20}(?:(?:\^|\*\*)-?[1-9])?"
_UNIT = re.compile(rf"(?:1 ?/ ?)?{_FACTOR}(?: ?[*/ ] ?{_FACTOR}){{0,5}}")
_LONGEST = 80
_SPELLINGS = str.maketrans({"μ": "µ", "·": "*", "⋅": "*", "×": "*", "−": "-", "²": "^2", "³": "^3", "\u00a0": " "})


class UnitError(ValueError):
    """A text is not a quantity of the wanted kind; the message says why, unless that is plain to see."""


class RangeError(UnitError):
    """A quantity is of the wanted kind but too large or too small."""


@dataclass(frozen=True, kw_only=True)
class QuantityKind:
    """What sort of quantity a key takes."""

    unit: str
    """SI unit, as pint reads it; '' for a plain number."""
    low: float = -math.inf
    """Smallest value allowed [SI]."""
    high: float = math.inf
    """Largest value allowed [SI]."""
    above_low: bool = False
    """Whether ``low`` itself is refused."""
    example: str = ""

    @property
    def words(self) -> str:
        """What to call it: "a length"."""
        return WORDS.get(self.unit) or f"a quantity in {pretty(self.unit)}"

    @property
    def wanted(self) -> str:
        """The same with its bounds: "a length above 0"."""
        words = self.words
        shown = [show(bound, self.unit) if bound else "0" for bound in (self.low, self.high)]
        if math.isfinite(self.low) and math.isfinite(self.high):
            return f"{words} {'above' if self.above_low else 'from'} {shown[0]} {'up ' if self.above_low else ''}to {shown[1]}"
        if math.isfinite(self.low):
            return f"{words} above {shown[0]}" if self.above_low else f"{words} of {shown[0]} or more"
        return words

    @property
    def way_out(self) -> str:
        """A quantity of this kind, to copy."""
        return self.example or EXAMPLES.get(self.unit) or f"1 {pretty(self.unit)}"

    def parse(self, text: str) -> float:
        """Value [SI] of ``text``.

        Raises
        ------
        RangeError
            If it is out of bounds.
        UnitError
            If it is no quantity of this dimension.
        """
        value = to_si(text, self.unit)
        if value > self.high or value < self.low or (self.above_low and value == self.low):
            raise RangeError("")
        return value


def to_si(text: str, unit: str) -> float:
    """Value of a text such as "6.25 mm" in the SI ``unit``, rounded once.

    Raises
    ------
    UnitError
        If it is not a finite number with a unit of that dimension (or, for '', without one).
    """
    text = text.strip().translate(_SPELLINGS)
    number = _NUMBER.match(text)
    if number is None:
        if re.match(r"[+-]?\.?(?:nan|inf)", text, re.IGNORECASE):
            raise UnitError("it must be finite")
        raise UnitError("")
    written = unit_of(text)
    if written.startswith(","):
        raise UnitError("write a decimal point, not a comma")
    if len(text) > _LONGEST or (written and not _UNIT.fullmatch(written)):
        raise UnitError("")
    if not written and unit:
        raise UnitError("the unit is missing")
    value = float(_DIGITS.multiply(Decimal(number[0]), factor(written, unit)))
    if not math.isfinite(value):
        raise UnitError("it must be finite")
    return value


def unit_of(text: str) -> str:
    """What stands behind the number of a quantity: "mm" of "6.25 mm"; '' where nothing does, or where there is no number."""
    text = text.strip().translate(_SPELLINGS)
    number = _NUMBER.match(text)
    return " ".join(text[number.end() :].split()) if number else ""


@functools.lru_cache(maxsize=256)
def factor(written: str, unit: str) -> Decimal:
    """How many ``unit`` one ``written`` is.

    Raises
    ------
    UnitError
        If ``written`` is no unit, or one of another dimension.
    """
    if (written, unit) in COMMON:
        return COMMON[written, unit]
    registry = _registry()
    import pint

    try:
        with decimal.localcontext(_DIGITS):
            one = registry.Quantity(Decimal(1), registry.parse_units(written))
            return Decimal(one.to(registry.parse_units(unit)).magnitude)
    except pint.UndefinedUnitError as error:
        names = error.unit_names if isinstance(error.unit_names, str) else ", ".join(error.unit_names)
        raise UnitError(f"{names!r} is no known unit") from None
    except pint.DimensionalityError:
        raise UnitError("") from None
    except (pint.PintError, ArithmeticError, ValueError, TypeError, AttributeError, AssertionError):
        # Words that pint takes for numbers (nan), and units whose powers leave every range.
        raise UnitError(f"{written!r} is no known unit") from None


def pretty(unit: str) -> str:
    """Unit as people write it: "kg/m**2" to "kg/m^2"."""
    return unit.replace("**", "^")


def _in_unit(value: float, per_unit: Decimal, round_trips: Callable[[Decimal], bool]) -> Decimal | None:
    """Shortest decimal that, times ``per_unit``, is exactly ``value`` again; None if it takes more than 17 digits."""
    exact = _DIGITS.divide(Decimal(repr(value)), per_unit)
    for digits in range(1, 18):
        rounded = decimal.Context(prec=digits, Emin=-9999, Emax=9999).plus(exact)
        if round_trips(rounded):
            return rounded
    return None


def show(value: float, unit: str) -> str:
    """Write ``value`` [SI] with a handy unit so that `to_si` gives exactly it again: 0.00625, "m" to "6.25 mm"."""
    handy = {
        "m": "mm" if abs(value) < 0.02 else "cm" if abs(value) < 1 else "m",
        "kg": "g" if abs(value) < 1 else "kg",
        "s": "ms" if 0 < abs(value) < 0.1 else "s",
        "rad": "deg",
    }.get(unit, pretty(unit))
    for written in dict.fromkeys((handy, pretty(unit))):
        per_unit = factor(written, unit) if written != pretty(unit) else Decimal(1)

        def round_trips(number: Decimal, per_unit: Decimal = per_unit) -> bool:
            return float(_DIGITS.multiply(number, per_unit)) == value

        number = _in_unit(value, per_unit, round_trips)
        if number is not None and (written == pretty(unit) or len(number.as_tuple().digits) <= 12):
            return f"{_digits(number)} {written}".rstrip()
    return f"{value!r} {pretty(unit)}".rstrip()


def _digits(number: Decimal) -> str:
    """Plain decimals unless they would be long: 0.0010 -> "0.001", 3.4E-12 -> "3.4e-12"."""
    number = number.normalize(_DIGITS)
    return format(number, "f") if -5 <= number.adjusted() < 15 else format(number, "e")


@functools.cache
def _registry() -> Any:
    """Return the unit registry; pint is imported on use, since it takes longer than the rest of a scenario."""
    import pint

    with decimal.localcontext(_DIGITS):
        registry: Any = pint.UnitRegistry(None, non_int_type=Decimal)
        registry.load_definitions(DEFINITIONS.strip().splitlines())
    return registry
