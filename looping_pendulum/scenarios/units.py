"""Convert quantities with units to SI numbers and back, "6.25 mm" to 0.00625, without rounding errors in between."""

from __future__ import annotations

import decimal
import functools
import math
import re
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
hour = 60 * minute = h
day = 24 * hour = _
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

The list is short, unlike pint's own: it loads in milliseconds, an angle is not a plain number in it (so that "112" is no angle
and "10 deg" no friction), and a typing error is an unknown unit rather than a barn or a fortnight.
"""

QUANTITY_NOUNS = {
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
"""SI unit -> name of a quantity in it, with its article."""

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
"""SI unit -> example of a quantity in it, as a user would write it."""

COMMON = {
    ("%", ""): Decimal("0.01"),
    ("mm", "m"): Decimal("0.001"),
    ("cm", "m"): Decimal("0.01"),
    ("g", "kg"): Decimal("0.001"),
    ("ms", "s"): Decimal("0.001"),
    ("Hz", "Hz"): Decimal(1),
    ("deg", "rad"): Decimal(DEGREE),
    ("MiB", "byte"): Decimal(1024**2),
    ("GiB", "byte"): Decimal(1024**3),
} | {(text_unit, unit): Decimal(1) for unit in QUANTITY_NOUNS for text_unit in (unit, unit.replace("**", "^"))}
"""(unit in the text, SI unit) -> conversion factor, for the units of nearly all files.

pint gives the same factors, but importing it takes longer than a whole command without it.
"""

_DECIMAL_CONTEXT = decimal.Context(prec=60, Emin=-9999, Emax=9999)
"""Arithmetic with far more digits than a float has, so that only the final conversion to float rounds."""
# At most three digits of exponent, as many as a float has
_NUMBER = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]{1,3})?")
# Only one digit per exponent and a few factors are allowed: pint expands powers, and m^999999999 would fill the memory.
_FACTOR = r"[A-Za-zµ°%]{1,20}(?:(?:\^|\*\*)-?[1-9])?"
_UNIT = re.compile(rf"(?:1 ?/ ?)?{_FACTOR}(?: ?[*/ ] ?{_FACTOR}){{0,5}}")
_MAX_LENGTH = 80
"""Longest text that is read as a quantity [characters]."""
# Characters that keyboards, editors and copied text put in place of those on the right
_SPELLINGS = str.maketrans(
    {"μ": "µ", "·": "*", "⋅": "*", "×": "*", "−": "-", "²": "^2", "³": "^3", "\u00a0": " "} | dict.fromkeys("º˚∘", "°")
)


class UnitError(ValueError):
    """A text is not a quantity of the required kind; the message says why, or is empty if that is obvious."""


class RangeError(UnitError):
    """A quantity is of the required kind, but too large or too small."""


@dataclass(frozen=True, kw_only=True)
class QuantityKind:
    """Kind of quantity that a key takes: its SI unit and bounds."""

    unit: str
    """SI unit, as pint reads it; '' for a plain number."""
    low: float = -math.inf
    """Smallest value allowed [SI]."""
    high: float = math.inf
    """Largest value allowed [SI]."""
    exclusive_low: bool = False
    """Whether ``low`` itself is refused."""
    example: str = ""
    """Example for messages; empty: that of `EXAMPLES`."""

    @property
    def noun(self) -> str:
        """Return the name of the quantity with its article: "a length"."""
        return QUANTITY_NOUNS.get(self.unit) or f"a quantity in {pretty(self.unit)}"

    @property
    def requirement(self) -> str:
        """Return the name of the quantity with its bounds: "a length above 0"."""
        noun, above = self.noun, self.exclusive_low
        low, high = (show(bound, self.unit) if bound else "0" for bound in (self.low, self.high))
        if math.isfinite(self.low) and math.isfinite(self.high):
            return f"{noun} {'above' if above else 'from'} {low} {'up ' if above else ''}to {high}"
        if math.isfinite(self.low):
            return f"{noun} above {low}" if above else f"{noun} of {low} or more"
        return noun

    @property
    def example_text(self) -> str:
        """Return an example of such a quantity, as a user would write it."""
        return self.example or EXAMPLES.get(self.unit) or f"1 {pretty(self.unit)}"

    def parse(self, text: str) -> float:
        """Return the value [SI] of ``text``.

        Raises
        ------
        RangeError
            If it is out of bounds.
        UnitError
            If it is not a quantity of this dimension.
        """
        value = to_si(text, self.unit)
        if value > self.high or value < self.low or (self.exclusive_low and value == self.low):
            # Without words, as the caller says what is required
            raise RangeError("")
        return value


def to_si(text: str, unit: str) -> float:
    """Return the value of a text such as "6.25 mm" in the SI ``unit``, rounded only once.

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
    text_unit = unit_text(text)
    if text_unit.startswith(","):
        raise UnitError("write a decimal point, not a comma")
    if len(text) > _MAX_LENGTH or (text_unit and not _UNIT.fullmatch(text_unit)):
        raise UnitError("")
    if not text_unit and unit:
        raise UnitError("the unit is missing")
    value = float(_DECIMAL_CONTEXT.multiply(Decimal(number[0]), factor(text_unit, unit)))
    if not math.isfinite(value):
        raise UnitError("it must be finite")
    return value


def unit_text(text: str) -> str:
    """Return the text after the number of a quantity: "mm" of "6.25 mm"; '' if there is none, or no number."""
    text = text.strip().translate(_SPELLINGS)
    number = _NUMBER.match(text)
    return " ".join(text[number.end() :].split()) if number else ""


@functools.lru_cache(maxsize=256)
def factor(text_unit: str, unit: str) -> Decimal:
    """Return the factor that converts a number in ``text_unit`` to ``unit``.

    Raises
    ------
    UnitError
        If ``text_unit`` is not a unit, or is one of another dimension.
    """
    if (text_unit, unit) in COMMON:
        return COMMON[text_unit, unit]
    registry = _registry()
    import pint

    try:
        with decimal.localcontext(_DECIMAL_CONTEXT):
            one = registry.Quantity(Decimal(1), registry.parse_units(text_unit))
            return Decimal(one.to(registry.parse_units(unit)).magnitude)
    except pint.UndefinedUnitError as error:
        names = error.unit_names if isinstance(error.unit_names, str) else ", ".join(error.unit_names)
        raise UnitError(f"{names!r} is no known unit") from None
    except pint.DimensionalityError:
        raise UnitError("") from None
    except (pint.PintError, ArithmeticError, ValueError, TypeError, AttributeError, AssertionError):
        # for words that pint reads as numbers (nan), and for units whose powers overflow
        raise UnitError(f"{text_unit!r} is no known unit") from None


def pretty(unit: str) -> str:
    """Return a unit in the usual notation: "kg/m**2" as "kg/m^2"."""
    return unit.replace("**", "^")


def show(value: float, unit: str) -> str:
    """Write ``value`` [SI] in a unit of convenient size, so that `to_si` returns exactly it: 0.00625, "m" as "6.25 mm"."""
    convenient_unit = {
        "m": "mm" if abs(value) < 0.02 else "cm" if abs(value) < 1 else "m",
        "kg": "g" if abs(value) < 1 else "kg",
        "s": "ms" if 0 < abs(value) < 0.1 else "s",
        "rad": "deg",
    }.get(unit, pretty(unit))
    exact = Decimal(repr(value + 0.0))  # 0 for -0
    # The shortest number that is exactly the value; 17 digits are enough for any float. One that would be long in the
    # convenient unit, such as degrees of an arbitrary angle, is written in the SI unit.
    for text_unit, most_digits in ((convenient_unit, 12), (pretty(unit), 17)):
        per_unit = Decimal(1) if text_unit == pretty(unit) else factor(text_unit, unit)
        for digits in range(1, most_digits + 1):
            number = decimal.Context(prec=digits, Emin=-9999, Emax=9999).divide(exact, per_unit)
            if float(_DECIMAL_CONTEXT.multiply(number, per_unit)) == value:
                return f"{_decimal_text(number)} {text_unit}".rstrip()
    return f"{value!r} {pretty(unit)}".rstrip()


def _decimal_text(number: Decimal) -> str:
    """Return a number in plain decimals unless that would be long: 0.0010 as "0.001", 3.4E-12 as "3.4e-12"."""
    number = number.normalize(_DECIMAL_CONTEXT)
    return format(number, "f") if -5 <= number.adjusted() < 15 else format(number, "e")


@functools.cache
def _registry() -> Any:
    """Return the unit registry; pint is imported on use, since it takes longer than the rest of a scenario."""
    import pint

    with decimal.localcontext(_DECIMAL_CONTEXT):
        registry: Any = pint.UnitRegistry(None, non_int_type=Decimal)
        registry.load_definitions(DEFINITIONS.strip().splitlines())
    return registry
