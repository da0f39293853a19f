"""Quantities: exact both ways, and of the right dimension or refused."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from looping_pendulum.scenarios import units
from looping_pendulum.scenarios.units import COMMON, EXAMPLES, QUANTITY_NOUNS, QuantityKind, RangeError, UnitError, show, to_si

UNITS = ["", "m", "kg", "s", "rad", "kg/m", "kg/m**2", "m/s**2", "N/m"]


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("6.25 mm", "m", 0.00625),
        ("6.25mm", "m", 0.00625),
        (" 6.25  mm ", "m", 0.00625),
        ("58.2 cm", "m", 0.582),
        ("10 g", "kg", 0.01),
        ("112.5 deg", "rad", math.radians(112.5)),
        ("112.5°", "rad", math.radians(112.5)),
        ("0.5 turn", "rad", math.pi),
        ("9.81 m/s^2", "m/s**2", 9.81),
        ("9.81 m/s²", "m/s**2", 9.81),
        ("9.81 m s^-2", "m/s**2", 9.81),
        ("4 cm^2", "m**2", 4e-4),
        ("3.4e-4 kg/m", "kg/m", 3.4e-4),
        (".5 in", "m", 0.0127),
        ("5 oz", "kg", 0.141747615625),
        ("0.3 %", "", 0.003),
        ("0.34", "", 0.34),
        ("5 1/s", "1/s", 5.0),
        ("10 µm", "m", 1e-5),
        ("10 μm", "m", 1e-5),
        ("−5 °", "rad", math.radians(-5)),
    ],
)
def test_reads_as_python_would_write_it(text, unit, value):
    assert to_si(text, unit) == value


@pytest.mark.parametrize(
    "text",
    [
        "",
        "m",
        "6.25",
        "10 g",
        "6.25 mm mm",
        "6.25 mm^",
        "6.25 MM",
        "6 25 mm",
        "nan m",
        "inf m",
        "1e999 m",
        "1_0 m",
        "0x10 m",
        "1:30 m",
        "1/2 m",
    ]
    + [
        "1 m**99",
        "1 m^9^9",
        "2 2 m",
        "1 __class__",
        "1 m; import os",
        "1 nan",
        "1 / *",
        "1 NaN",
        "1 m*nan",
        "9**9**9 m",
        "٣ m",
        "1 B",
        "1 m" + " m^1" * 60,
        "9" * 500 + " m",
    ],
)
def test_refuses_what_is_no_length(text):
    with pytest.raises(UnitError):
        to_si(text, "m")


@pytest.mark.parametrize(("text", "unit"), [("1", "rad"), ("1 rad", ""), ("1 deg", "1/s"), ("1 Hz", "rad/s")])
def test_an_angle_is_no_plain_number(text, unit):
    with pytest.raises(UnitError):
        to_si(text, unit)


@given(st.floats(allow_nan=False, allow_infinity=False), st.sampled_from(UNITS))
def test_what_is_shown_reads_back_exactly(value, unit):
    assert to_si(show(value, unit), unit) == value


@given(st.integers(1, 10**6), st.integers(-6, 3))
def test_decimal_millimetres_are_rounded_once(digits, exponent):
    assert to_si(f"{digits}e{exponent} mm", "m") == float(f"{digits}e{exponent - 3}")


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.00625, "m", "6.25 mm"),
        (0.582, "m", "58.2 cm"),
        (1.5, "m", "1.5 m"),
        (0.1, "kg", "100 g"),
        (math.radians(112.5), "rad", "112.5 deg"),
    ]
    + [(9.81, "m/s**2", "9.81 m/s^2"), (0.008, "s", "8 ms"), (1.05, "s", "1.05 s"), (0.341, "", "0.341")],
)
def test_shows_what_a_person_would_write(value, unit, text):
    assert show(value, unit) == text


@pytest.mark.parametrize("unit", sorted(QUANTITY_NOUNS))
def test_each_kind_has_an_example_that_it_reads(unit):
    kind = QuantityKind(unit=unit)
    assert kind.parse(kind.example_text) > 0
    assert set(EXAMPLES) <= set(QUANTITY_NOUNS)


@pytest.mark.parametrize(("written", "unit"), COMMON)
def test_what_is_known_without_pint_is_what_pint_says(written, unit, monkeypatch):
    monkeypatch.setattr(units, "COMMON", {})
    assert units.factor.__wrapped__(written, unit) == COMMON[written, unit]


def test_bounds_are_kept_and_named():
    kind = QuantityKind(unit="m", low=0.0, high=1.0, exclusive_low=True)
    assert kind.requirement == "a length above 0 up to 1 m"
    assert kind.parse("100 cm") == 1.0
    for text in ("0 m", "1.01 m"):
        with pytest.raises(RangeError):
            kind.parse(text)
