"""The parts of the batch: Taylor series of expressions, and the search for the first fall of polynomials."""

import math

import numpy as np
import pytest

hy = pytest.importorskip("heyoka")

from looping_pendulum.reference_ode.batch.compiled import CompiledFunction  # noqa: E402
from looping_pendulum.reference_ode.batch.roots import first_falling_roots  # noqa: E402
from looping_pendulum.reference_ode.batch.series import SeriesAlgebra  # noqa: E402


def test_series_of_the_elementary_functions():
    """Oracle: known series of functions of 0.5 + s, s the variable."""
    algebra = SeriesAlgebra()
    x = algebra.variable(hy.expression("x"), lambda: algebra.series(1.0))
    cases = {
        "exp": (algebra.exp(x), [math.exp(0.5) / math.factorial(n) for n in range(6)]),
        "sin": (algebra.sin(x), [math.sin(0.5 + n * math.pi / 2) / math.factorial(n) for n in range(6)]),
        "cos": (algebra.cos(x), [math.cos(0.5 + n * math.pi / 2) / math.factorial(n) for n in range(6)]),
        "1/x": (1.0 / x, [(-1.0) ** n / 0.5 ** (n + 1) for n in range(6)]),
        "sqrt(x^3)": (algebra.sqrt(x * x * x), [_binomial(1.5, n) * 0.5 ** (1.5 - n) for n in range(6)]),
        "(3 - x) x / 2": ((3.0 - x) * x / 2.0, [0.625, 1.0, -0.5, 0.0, 0.0, 0.0]),
        "-x + 1": (-x + 1.0, [0.5, -1.0, 0.0, 0.0, 0.0, 0.0]),
    }
    for name, (series, expected) in cases.items():
        terms = [hy.expression(0.0) + series[n] for n in range(6)]
        actual = hy.cfunc(terms, [hy.expression("x")])(np.array([0.5]))
        np.testing.assert_allclose(actual, expected, rtol=1e-13, atol=1e-15, err_msg=name)


def _binomial(a, n):
    return math.prod((a - k) / (k + 1) for k in range(n))


def test_a_compiled_function_gives_each_column_the_same_wherever_it_stands():
    x, y = hy.make_vars("x", "y")
    function = CompiledFunction([hy.exp(x) * hy.sin(y) + 1.0 / y, hy.log(x) - y], [x, y])
    data = np.random.default_rng(0).uniform(0.1, 3.0, (2, 19))
    whole = function(data)
    np.testing.assert_allclose(whole, [np.exp(data[0]) * np.sin(data[1]) + 1 / data[1], np.log(data[0]) - data[1]], rtol=1e-14)
    for i in range(19):
        np.testing.assert_array_equal(function(data[:, i : i + 1])[:, 0], whole[:, i])


def test_equal_operations_are_made_once():
    algebra = SeriesAlgebra()
    x = algebra.variable(hy.expression("x"), lambda: algebra.series(1.0))
    y = algebra.variable(hy.expression("y"), lambda: algebra.series(1.0))
    assert x * y is y * x
    assert algebra.sin(x + y) is algebra.sin(y + x)


def test_first_falling_roots_are_those_of_a_fine_grid():
    """Oracle: signs on a grid of 2e-5, and the polynomial's own value at the root."""
    rng = np.random.default_rng(0)
    degree, n = 16, 400
    polynomials = rng.normal(size=(degree + 1, n)) * np.exp(-1.0 * np.arange(degree + 1))[:, None]
    actual = first_falling_roots(polynomials)
    grid = np.linspace(0, 1, 50_001)
    for i in range(n):
        signs = np.polyval(polynomials[::-1, i], grid) > 0
        falls = np.flatnonzero(signs[:-1] & ~signs[1:])
        if falls.size:
            assert abs(actual[i] - grid[falls[0]]) < 4e-5
            assert abs(np.polyval(polynomials[::-1, i], actual[i])) < 1e-14
        else:
            assert np.isinf(actual[i])


def test_a_close_pair_of_roots_is_not_missed():
    """(x - 0.3)(x - 0.3 - d) falls at 0.3, rises d later; a touch from above, or a rise, is no fall."""
    gaps = np.array([1e-2, 1e-4, 1e-6])
    pairs = np.array([0.3 * (0.3 + gaps), -(0.6 + gaps), np.ones(3)])
    np.testing.assert_allclose(first_falling_roots(pairs), 0.3, rtol=0, atol=1e-9)
    never = np.array([[0.09 + 1e-9, -0.6, 1.0], [-0.3, 1.0, 0.0], [1.0, 0.0, 0.0]]).T
    assert np.all(np.isinf(first_falling_roots(never)))


def test_a_function_that_starts_at_zero_falls_only_later():
    """x (0.5 - x) starts at exactly 0, rises and falls at 0.5."""
    assert first_falling_roots(np.array([[0.0], [0.5], [-1.0]]))[0] == pytest.approx(0.5, abs=1e-15)
