"""Numbers for people. Oracles: pint reads a quantity back into SI; the bound is half a unit of the last digit shown."""

import math
import re

import pint
import pytest
from hypothesis import given
from hypothesis import strategies as st

from looping_pendulum.pages.numbers import GAP, amount, number, quantity, signed, uncertain

UNITS = ("m", "s", "N", "m/s", "kg", "rad")
SIGNED_SIZES = st.tuples(st.sampled_from([-1.0, 1.0]), st.floats(1e-8, 1e5)).map(lambda pair: pair[0] * pair[1])
"""What this apparatus and its runs can show: a nanometre's tenth apart from rounding, up to a day's seconds."""


@pytest.fixture(scope="module")
def registry():
    """Made for the test that needs it: that takes most of a second, and every worker of pytest collects this file."""
    return pint.UnitRegistry()


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.7, "s", "700 ms"),
        (-0.7, "s", "-700 ms"),
        (0.2784, "m", "278 mm"),
        (5.3e-5, "m", "0.053 mm"),
        (0.012, "m", "12 mm"),
        (0.0123, "m", "12 mm"),
        (0.00123, "m", "1.2 mm"),
        (0.9996, "m", "1 m"),
        (0.9949, "m", "995 mm"),
        (1.0, "s", "1 s"),
        (1.684, "s", "1.7 s"),
        (9.9e-6, "m", "9.9 µm"),
        (7e-7, "s", "0.7 µs"),
        (2e-12, "m", "0.002 nm"),
        (0.0, "m", "0 mm"),
        (-0.0, "m", "0 mm"),
        (0.0133, "kg", "13 g"),
        (0.0133, "kg/s", "0.013 kg/s"),
        (math.radians(0.01), "rad", "0.01 deg"),
        (12345.0, "s", "12345 s"),
        (0.5, "", "0.5"),
        (math.nan, "s", "nan ms"),
        (-math.inf, "m", "-inf mm"),
        (None, "m", GAP),
    ],
)
def test_quantities_read_as_a_person_writes_them(value, unit, text):
    assert quantity(value, unit) == text


@given(SIGNED_SIZES, st.sampled_from(UNITS), st.sampled_from([2, 3]))
def test_a_quantity_is_itself_to_its_digits_in_short_and_without_an_exponent(registry, value, unit, digits):
    text = quantity(value, unit, digits)
    read_back = registry.Quantity(text.replace("deg", "degree")).to(unit).magnitude
    # Rounded to `digits` digits at least: half a unit of the last one, over a first digit of 1; and rounding of doubles.
    assert abs(read_back - value) <= (0.5 * 10.0 ** (1 - digits) + 1e-12) * abs(value)
    assert math.copysign(1, read_back) == math.copysign(1, value)
    written, _, _ = text.partition(" ")
    assert re.fullmatch(r"-?(0\.\d+|[1-9]\d*(\.\d+)?)", written), text
    assert len(written.strip("-0.").replace(".", "")) <= (7 if abs(float(written)) >= 1000 else 3), text


@given(SIGNED_SIZES, st.sampled_from(UNITS))
def test_a_quantity_has_the_unit_that_suits_it(value, unit):
    written, name = quantity(value, unit).split()
    size = abs(float(written))
    assert size >= 0.01 or name.startswith(("n", "mg")), (written, name)
    assert size < 1000 or name in (unit, "deg"), (written, name)


@given(st.floats(-1e300, 1e300), st.integers(1, 9))
def test_a_number_keeps_its_digits_at_every_size(value, digits):
    text = number(value, digits=digits)
    read_back = float(text)
    # Below the smallest normal double the digits themselves are fewer: 5e-324 is one unit of those.
    assert abs(read_back - value) <= (0.5 * 10.0 ** (1 - digits) + 1e-12) * abs(value) + 5e-324
    if 1e-4 <= abs(value) < 9.9e6:
        assert "e" not in text
    assert not re.search(r"\.\d*0$|\.$", text.partition("e")[0]), "a point and zeros say nothing"


@pytest.mark.parametrize(
    ("value", "text"), [(7e2, "700"), (99996.0, "100000"), (0.99996, "1"), (1e-5, "1e-5"), (1.25e9, "1.25e9"), (None, GAP)]
)
def test_numbers_have_no_exponent_as_long_as_they_can_be_read(value, text):
    assert number(value) == text


def test_an_amount_keeps_the_digits_left_of_its_point():
    assert [amount(x) for x in (262.4, 26.24, 2.624, 0.02624, -0.02624, 0.0, 99.96, None)] == [
        "262", "26", "2.6", "0.026", "-0.026", "0", "100", GAP,
    ]  # fmt: skip
    assert amount(0.2624, 1e3) == "262"
    assert [amount(x) for x in (1234567.8, 1.2345678e9, math.inf)] == ["1234568", "1.2e9", "inf"]


def test_a_signed_number_has_its_sign():
    assert [signed(x, 1e3) for x in (0.0012, -0.0012, 0.0, None)] == ["+1.2", "-1.2", "0", GAP]


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (0.013312, 0.00042, "0.01331 +/- 0.00042 kg/s"),
        (0.013312, 0.000996, "0.0133 +/- 0.0010 kg/s"),
        (-123.4, 12.0, "-123 +/- 12 kg/s"),
        (12345.0, 1234.0, "12300 +/- 1200 kg/s"),
        (0.2, 1e-12, "0.2 +/- 1e-12 kg/s"),
        (1.234e-7, 5.6e-9, "(1.234 +/- 0.056)e-7 kg/s"),
        (0.0, 0.5, "0.00 +/- 0.50 kg/s"),
        (0.0133, 0.0, "0.0133 kg/s"),
        (0.0133, None, "0.0133 kg/s"),
        (0.0133, math.inf, "0.0133 kg/s"),
        (None, 1.0, GAP),
    ],
)
def test_a_value_ends_where_its_error_begins(value, error, text):
    assert uncertain(value, error, "kg/s") == text


@given(st.floats(-1e6, 1e6), st.floats(1e-6, 1e6))
def test_a_value_and_its_error_are_read_back_to_half_the_errors_last_digit(value, error):
    text = uncertain(value, error)
    power = 10.0 ** int(text.partition(")e")[2] or 0)
    read_back, spread = (float(x) * power for x in text.partition(")e")[0].strip("(").split(" +/- "))
    # Half a unit of the error's second digit is a twentieth of it at most; six digits of the value where the error is tiny.
    assert abs(spread - error) <= 0.0501 * error
    assert abs(read_back - value) <= 0.0501 * error + 0.5e-5 * abs(value) + 1e-12
