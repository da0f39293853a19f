"""The reader of formulas that pupils type over measured points, and the straight line through points.

Python's own arithmetic is the oracle of values, `numpy.polyfit` that of straight lines.
"""

import math

import numpy as np
import pytest

TIMES = [0.1, 0.37, 1.9]
GOOD = {
    "3*t^2": lambda t: 3 * t**2,
    "y = 3 + v*t + a/2*t^2; v = 10; a = 981": lambda t: 3 + 10 * t + 981 / 2 * t**2,
    "0,5t² − 2·t": lambda t: 0.5 * t**2 - 2 * t,
    "2(t + 1)(t - 1)": lambda t: 2 * (t + 1) * (t - 1),
    "-2^2 + 2^-1 + 2^3^2": lambda t: -4 + 0.5 + 512,
    "a*exp(-k*t)*cos(2pi*f*t); a=2; k=f/3; f=4;": lambda t: 2 * math.exp(-4 / 3 * t) * math.cos(2 * math.pi * 4 * t),
    "2e3*t + 2e^t": lambda t: 2000 * t + 2 * math.exp(t),
    "sqrt(abs(t-1)) + ln(t) + log(100) - - atan(t)": lambda t: math.sqrt(abs(t - 1)) + math.log(t) + 2 + math.atan(t),
    "1/(2t) : 4": lambda t: 1 / (2 * t) / 4,
    "√(t)×π": lambda t: math.sqrt(t) * math.pi,
}
BAD = {
    "": ("formulaEmpty", 1, ""),
    "y =": ("formulaEmpty", 4, ""),
    "3*t^": ("formulaNeedsValue", 5, ""),
    "3 + * t": ("formulaNeedsValue", 5, "*"),
    "3 4": ("formulaNeedsEnd", 3, "4"),
    "(t + 1": ("formulaNeedsBracket", 7, ""),
    "t²)": ("formulaNeedsEnd", 3, ")"),
    "4*sin t": ("formulaNeedsCall", 3, "sin"),
    "3*t + at": ("formulaUnknown", 7, "at"),
    "constructor(t)": ("formulaUnknown", 1, "constructor"),
    "3 # t": ("formulaSign", 3, "#"),
    "a*t; a = 2*t": ("formulaConstant", 12, "t"),
    "a*t; 3": ("formulaConstant", 6, "3"),
    "x = t": ("formulaUnknown", 1, "x"),
}


def test_formulas_have_the_values_that_python_gives(node):
    answers = node("formula.mjs", {"formulas": [[typed, TIMES] for typed in GOOD]})["formulas"]
    for (typed, expected), answer in zip(GOOD.items(), answers, strict=True):
        assert answer["values"] == pytest.approx([expected(t) for t in TIMES], rel=1e-12), typed


def test_a_wrong_formula_is_told_where_and_what(node):
    answers = node("formula.mjs", {"formulas": [[typed, []] for typed in BAD]})["formulas"]
    for (typed, (fault, place, found)), answer in zip(BAD.items(), answers, strict=True):
        assert answer == {"fault": fault, "place": place, "found": found}, typed


def test_no_formula_breaks_the_reader(node):
    rng = np.random.default_rng(67)
    signs = list("t12.,+-*/^()=;ae πé\"'`{}[]") + ["sin", "sqrt(", "²"]
    random = ["".join(rng.choice(signs, rng.integers(1, 12))) for _ in range(2000)]
    # The field takes no more than 200 characters
    deep = ["(" * 99 + "t" + ")" * 99, "2^" * 99 + "2", "-" * 199 + "t", "sin(" * 50]
    formulas = [*random, *deep]
    answers = node("formula.mjs", {"formulas": [[typed, [0.5]] for typed in formulas]})["formulas"]
    for typed, answer in zip(formulas, answers, strict=True):
        assert "values" in answer or 1 <= answer["place"] <= len(typed) + 1, typed
    assert sum("values" in answer for answer in answers) > 20


def test_a_straight_line_is_that_of_least_squares(node):
    rng = np.random.default_rng(1)
    t = np.sort(rng.uniform(0.1, 0.9, 25))
    y = 120.0 * t - 9.0 + rng.normal(0.0, 0.3, 25)
    coefficients, covariance = np.polyfit(t, y, 1, cov=True)
    (line,) = node("formula.mjs", {"lines": [np.column_stack([t, y]).tolist()]})["lines"]
    assert [line["slope"], line["intercept"]] == pytest.approx(coefficients, rel=1e-10)
    assert [line["slopeError"], line["interceptError"]] == pytest.approx(np.sqrt(np.diag(covariance)), rel=1e-10)
    assert line["rms"] == pytest.approx(np.sqrt(np.mean((y - np.polyval(coefficients, t)) ** 2)), rel=1e-10)
    assert line["zero"] == pytest.approx(np.sqrt(np.mean(y**2)), rel=1e-12)
