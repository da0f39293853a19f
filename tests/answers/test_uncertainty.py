import math

import numpy as np

from scripts.answers_parts.uncertainty import uncertain, uncertain_fractions, uncertainty_exponent

EPS = 10.0 ** -np.arange(1.0, 7.6, 0.5)


def inside_a_circle(x):
    return (np.hypot(*(x - 0.5).T) < 0.3).astype(int)


def gap_of_the_cantor_set(x):
    """Parity of the step at which the middle third that holds x is taken out."""
    y, out, done = x[:, 0].copy(), np.zeros(len(x), dtype=int), np.zeros(len(x), dtype=bool)
    for step in range(33):
        y = 3 * y
        third = np.floor(y)
        middle = (third == 1) & ~done
        out[middle] = 1 + step % 2
        done |= middle
        y -= third
    return out


def exponent_of(outcome, dimension, replicates=6):
    rows = uncertain_fractions(outcome, dimension, EPS, count=600, replicates=replicates, seed=1)
    return uncertainty_exponent(EPS, rows), rows.mean(axis=0)


def test_a_smooth_boundary_has_exponent_one():
    exponent, fractions = exponent_of(inside_a_circle, 2)
    assert abs(exponent.value - 1) < 4 * exponent.standard_error + 0.005
    assert exponent.standard_error < 0.02
    # neighbours along the axes reach a boundary of length s from both sides: 2 eps times its mean of max(|cos|, |sin|)
    expected = 2 * EPS[-1] * 0.3 * 2 * math.pi * (2 * math.sqrt(2) / math.pi)
    assert abs(fractions[-1] / expected - 1) < 0.2


def test_the_cantor_set_has_the_exponent_that_its_dimension_leaves():
    """1 - ln 2 / ln 3 = 0.369; its neighbours' outcomes agree by chance now and then, which leaves a percent."""
    exponent, _ = exponent_of(gap_of_the_cantor_set, 1)
    assert abs(exponent.value - (1 - math.log(2) / math.log(3))) < 4 * exponent.standard_error + 0.005


def test_fractions_are_those_of_plain_counting_where_counting_can_see_them():
    rng = np.random.default_rng(7)
    starts = rng.random((40_000, 2))
    followed = uncertain_fractions(inside_a_circle, 2, EPS, count=600, replicates=6, seed=2).mean(axis=0)
    for eps, fraction in zip(EPS[:3], followed[:3], strict=True):
        counted = uncertain(inside_a_circle, starts, eps)
        error = math.hypot(counted.std() / math.sqrt(len(starts)), fraction * math.sqrt(3 / 3600 / max(fraction, 0.01)))
        assert abs(fraction - counted.mean()) < 4 * error


def test_nothing_uncertain_ends_the_search():
    fractions = uncertain_fractions(lambda x: np.zeros(len(x)), 1, EPS, count=50, replicates=2, seed=0)
    np.testing.assert_array_equal(fractions, 0.0)
