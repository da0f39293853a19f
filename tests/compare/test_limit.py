"""The fit of a ladder against another solver of the documented least squares, and which rungs have a limit at all."""

import math

import numpy as np
import pytest
from scipy.optimize import least_squares

from looping_pendulum.compare.convergence.limit import deviation, extrapolate, refinement_sizes, rms_norm

H = 0.5 ** np.arange(5)


def numbers(values):
    return [np.array([[float(value)]]) for value in values]


def distance(a, b):
    """Root mean square over the samples of the length of their difference."""
    return math.sqrt(sum(float(np.dot(x - y, x - y)) for x, y in zip(a, b, strict=True)) / len(a))


def solved(h, values, noise):
    """Order, limit, misfit and what is expected of the finest, as the module's first lines say, by Levenberg-Marquardt."""
    away = [distance(v, values[-1]) for v in values[:-1]]
    away.append(away[-1] * min(1.0, away[-1] / away[-2]))
    sigma = [math.hypot(0.1 * d, noise) for d in away]
    shape = values[0].shape
    size = values[0].size

    def left(x):
        order, limit, slope = x[0], x[1 : 1 + size].reshape(shape), x[1 + size :].reshape(shape)
        return np.concatenate([((limit + slope * b**order - v) / s).ravel() for b, v, s in zip(h, values, sigma, strict=True)])

    start = np.concatenate([[1.3], values[-1].ravel(), (values[0] - values[-1]).ravel()])
    x = least_squares(left, start, method="lm", xtol=1e-12, ftol=1e-12, gtol=1e-12).x
    misfit = math.sqrt(np.sum(left(x) ** 2) / len(values[0]) / max(len(h) - 3, 1))
    return x[0], x[1 : 1 + size].reshape(shape), misfit, sigma[-1]


def expected(h, values, noise):
    """Order, its uncertainty, limit and its uncertainty of four rungs or more: leave one out, and Roache's factor."""
    from scipy.stats import t as students_t  # takes a second to import, which every worker would pay

    count = len(h)
    order, limit, misfit, finest = solved(h, values, noise)
    others = [solved(np.delete(h, k), [v for j, v in enumerate(values) if j != k], noise) for k in range(count)]
    factor = students_t.ppf(0.975, count - 2) * math.sqrt((count - 1) / count)
    order_error = factor * math.sqrt(sum((o - order) ** 2 for o, *_ in others))
    limit_error = factor * math.sqrt(sum(distance(a, limit) ** 2 for _, a, *_ in others))
    covered = (0.25 if order_error < order else 2.0) * distance(values[-1], limit)
    return order, order_error, limit, math.hypot(covered, limit_error, misfit * finest, noise)


OFF = np.array([0.04, -0.03, 0.02, -0.015, 0.0])
"""Of its distance from the limit, what a rung is off its power law."""


ROUNDING = 1e-9
"""Standard deviation of runs that are exact but for their rounding."""


def limit_of(h, values, noise=ROUNDING, resolution=0.0):
    return extrapolate(h, values, noise=noise, resolution=resolution)


@pytest.mark.parametrize("order", [0.5, 1.0, 2.0, 4.0])
def test_a_pure_power_law_gives_its_order_and_limit(order):
    limit = limit_of(H, numbers(3 + 0.7 * H**order))
    assert limit.order == pytest.approx(order, abs=1e-4)  # the search for the order stops at 1e-5 of its interval
    assert abs(limit.value - 3).max() <= limit.uncertainty


@pytest.mark.parametrize("order", [1, 2])
def test_higher_terms_stay_within_the_stated_uncertainty(order):
    limit = limit_of(H, numbers(3 + 0.7 * H**order + 0.3 * H ** (order + 1)))
    assert limit.order == pytest.approx(order, abs=0.3)
    assert abs(limit.value - 3).max() <= limit.uncertainty


def test_three_rungs_give_an_order_and_a_cautious_limit():
    limit = limit_of(H[:3], numbers(3 + 0.7 * H[:3] ** 2))
    assert limit.order == pytest.approx(2.0, abs=1e-3)
    assert limit.uncertainty == pytest.approx(2 * 0.7 * H[2] ** 2, rel=1e-2)  # twice the distance of the finest: factor 3


@pytest.mark.parametrize("shape", [(1, 1), (200, 2)])
@pytest.mark.parametrize(
    ("noise", "tries", "fewest"),
    # at 95 %, fewer than 25 of 30 come up once in 300 times, and so do fewer than 52 of 60
    [(0.03, 30, 25), *(pytest.param(noise, 60, 52, marks=pytest.mark.accurate) for noise in (0.003, 0.03, 0.3))],
)
def test_the_true_limit_of_noisy_sequences_is_within_95_percent(shape, noise, tries, fewest):
    """Daily at one noise in 30 tries, which holds the guarantee; at three in 60 with the accurate tests."""
    rng = np.random.default_rng(0)
    slope = rng.normal(size=shape)
    slope /= rms_norm(slope)
    inside = 0
    for _ in range(tries):
        shapes = [rng.normal() * np.cos(np.linspace(0, 4 + rng.normal(), shape[0]))[:, None] for _ in H]
        rough = [
            noise * wave / max(rms_norm(wave), 1e-12) * rng.normal() * np.ones(shape) / np.sqrt(shape[1]) for wave in shapes
        ]
        limit = limit_of(H, [slope * h + r for h, r in zip(H, rough, strict=True)], noise=noise)
        # No limit is no wrong one
        inside += limit is None or rms_norm(limit.value) <= limit.uncertainty
    assert inside >= fewest


def test_scatter_has_no_limit():
    rng = np.random.default_rng(1)
    limits = [limit_of(H, numbers(rng.normal(size=5)), noise=0.1) for _ in range(200)]
    # five numbers without rule fall by a power of h, or each change to less than half, in a few of a hundred cases
    assert sum(limit is None for limit in limits) >= 180


@pytest.mark.parametrize("values", [(1.0, 0.5, 0.7, 0.4, 0.6), (1.0, 0.99, 0.95, 0.8, 0.2), (1.0, 0.9, 0.8, 0.7, 0.59)])
def test_changes_to_and_fro_or_ever_larger_ones_have_no_limit(values):
    assert limit_of(H, numbers(values)) is None


@pytest.mark.parametrize("noise", [ROUNDING, 1e-3, 6e-3])
@pytest.mark.parametrize("order", [1.0, 2.0])
@pytest.mark.parametrize("rungs", [4, 5])
def test_order_and_limit_are_the_least_squares_and_what_leaving_one_out_says(order, noise, rungs):
    h = H[:rungs]
    values = numbers(3 + 0.7 * h**order * (1 + OFF[:rungs]))
    limit = limit_of(h, values, noise=noise)
    wanted_order, _, wanted, uncertainty = expected(h, values, noise)
    # The search for the order stops at 1e-5 of its interval, and its error goes into the others.
    assert limit.order == pytest.approx(wanted_order, abs=1e-4)
    np.testing.assert_allclose(limit.value, wanted, atol=2e-5)
    assert limit.uncertainty == pytest.approx(uncertainty, rel=2e-3, abs=2e-5)


def test_a_path_has_one_order_for_all_its_samples():
    slope = np.array([[1.0, 0.5], [-0.3, 0.2], [0.4, -0.7]])
    rough = np.array([[0.2, -1.0], [0.6, 0.1], [-0.5, 0.3]])
    values = [slope * h**1.5 + 0.5 * off * rough * h**1.5 for h, off in zip(H, OFF, strict=True)]
    limit = limit_of(H, values)
    order, _, wanted, uncertainty = expected(H, values, ROUNDING)
    assert limit.order == pytest.approx(order, abs=1e-4)
    np.testing.assert_allclose(limit.value, wanted, atol=1e-5)
    assert limit.value.shape == (3, 2)
    assert limit.uncertainty == pytest.approx(uncertainty, rel=5e-3)


def test_an_order_that_is_worse_known_than_itself_costs_the_cautious_factor():
    # Bound below: the cautious factor alone is twice the distance of the finest rung from the limit.
    values = numbers(3 + 0.7 * H[:4] * (1 + np.array([0.12, -0.1, 0.1, 0.0])))
    limit = limit_of(H[:4], values, noise=0.05)
    wanted = expected(H[:4], values, 0.05)
    assert wanted[1] > wanted[0], "the example is of such an order"
    assert limit.uncertainty == pytest.approx(wanted[3], rel=5e-3)
    assert limit.uncertainty >= 2 * abs(float((limit.value - values[-1])[0, 0]))


@pytest.mark.parametrize(("scale", "fits"), [(0.97, True), (1.03, False)])
def test_a_fit_that_leaves_more_than_thrice_what_is_expected_is_none(scale, fits):
    """Oracle: the misfit of the other solver, which four rungs leave; fewer of four are not taken."""
    h, off = H[:4], np.array([0.0, 1.0, -0.5, 0.0])
    noise = 5e-4

    def rough(size):
        return numbers(3 + 0.7 * h + size * off)

    low, high = 1e-2, 0.1
    for _ in range(12):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if solved(h, rough(middle), noise)[2] < 3.0 else (low, middle)
    limit = limit_of(h, rough(scale * low), noise=noise)
    assert (limit is not None and limit.order is not None) is fits


@pytest.mark.parametrize(("order", "known"), [(0.1, True), (7.4, True), (0.02, False), (12.0, False)])
def test_orders_at_the_ends_of_what_is_tried_are_none(order, known):
    h = np.array([1.0, 0.8, 0.64, 0.512, 0.4096])
    limit = limit_of(h, numbers(3 + 0.7 * h**order))
    if known:
        assert limit.order == pytest.approx(order, abs=1e-3)
    elif order > 8:
        assert limit.order is None, "each change is far less than half of the one before, but by no power that is tried"
        assert limit.uncertainty >= abs(limit.value[0, 0] - 3)
    else:
        assert limit is None


@pytest.mark.parametrize(("good", "known"), [(6, True), (5, True), (4, False)])
def test_of_ten_rungs_at_least_the_finest_five_must_follow_one_law(good, known):
    h = 0.7 ** np.arange(10)
    values = 3 + 0.7 * h
    values[: 10 - good] = 9.0 - 2.0 * (-1.0) ** np.arange(10 - good)
    assert (limit_of(h, numbers(values)) is not None) is known


def test_three_of_four_are_not_enough():
    values = 3 + 0.7 * H**1
    values[0] = 3.1
    assert limit_of(H[:4], numbers(values[:4])) is None
    assert limit_of(H[1:4], numbers(values[1:4])).order == pytest.approx(1.0, abs=1e-3)


def test_a_last_rung_of_size_zero_is_the_limit_itself():
    h = np.array([1.0, 0.5, 0.25, 0.125, 0.0])
    limit = limit_of(h, numbers(3 + 0.7 * h))
    assert limit.order == pytest.approx(1.0, abs=1e-3)
    assert float(limit.value[0, 0]) == pytest.approx(3.0, abs=1e-6)


def test_rungs_far_apart_are_one_power_law_to_the_last():
    h = 8.0 ** -np.arange(7)
    assert limit_of(h, numbers(3 + 0.7 * h**0.5)).order == pytest.approx(0.5, abs=1e-3)


@pytest.mark.parametrize(("share", "significant"), [(0.98, False), (1.02, True)])
def test_a_power_law_must_change_more_than_two_runs_of_a_noise_do(share, significant):
    # Two runs differ by the root of two times the noise; twice that counts as seen.
    values = 3 + 0.7 * H
    seen = (values[0] - values[-1]) / (2 * math.sqrt(2))
    assert (limit_of(H, numbers(values), noise=seen / share).order is not None) is significant


FRICTION = (4.58e-3, -1.42e-3, 2.98e-5, -9.11e-7)
"""Halting errors [s] of mujoco:capstan along its friction_time_constant: 10, 5, 2.5 and 1 ms."""


@pytest.mark.parametrize(
    ("values", "known"),
    [
        (FRICTION, True),
        (FRICTION[1:], False),  # two changes may shrink by chance
        ((4.58e-3, -1.42e-3, 1.6e-3, 0.0), False),  # 1.6 is more than half of 3.02
    ],
)
def test_rungs_that_close_in_by_no_one_power_have_a_limit(values, known):
    """They were said to scatter by 2.6 ms, where the finest is 0.9 us from the reference."""
    limit = limit_of(np.array([10, 5, 2.5, 1.0])[-len(values) :], numbers(values), noise=1e-6)
    assert (limit is not None) is known
    if known:
        assert (limit.order, limit.value[0, 0]) == (None, values[-1])
        assert limit.uncertainty == pytest.approx(math.hypot(3 * (values[2] - values[3]), 2 * math.sqrt(2) * 1e-6))


@pytest.mark.parametrize(
    ("noise", "resolution", "known"),
    [(ROUNDING, 0.25, True), (ROUNDING, 0.24, False), (0.09, 0.0, True), (0.088, 0.0, False)],
)
def test_the_finest_three_agree_up_to_the_resolution_or_what_noise_explains(noise, resolution, known):
    """Oracle: the third finest rung is 0.25 off, 2 sqrt 2 times 0.0884."""
    limit = limit_of(H, numbers([2.6, 2.0, 2.25, 1.9, 2.0]), noise=noise, resolution=resolution)
    assert (limit is not None) is known
    if known:
        assert limit.value[0, 0] == 2.0
        assert limit.uncertainty == pytest.approx(math.hypot(0.25, 2 * math.sqrt(2) * noise))


@pytest.mark.parametrize("count", [0, 1, 2])
def test_fewer_than_three_rungs_have_no_limit(count):
    assert limit_of(H[:count], numbers(H[:count]), resolution=9.0) is None


def test_the_deviation_is_that_of_a_sample_and_needs_three():
    assert deviation(numbers((1, 2))) is None
    assert deviation(numbers((1, 2, 6))) == pytest.approx(math.sqrt(7))
    path = [np.array([[3.0, 4.0], [0.0, 0.0]]) * k for k in (-1, 0, 1)]
    assert deviation(path) == pytest.approx(math.sqrt(12.5)), "5 m at one of two samples: the root of 25 / 2"
    assert rms_norm(path[2]) == pytest.approx(math.sqrt(12.5))


@pytest.mark.parametrize("bad", [(0.0, 1.0, 2.0), (-1.0, 1.0), (1.0, 1.0), (3.0, 2.0, 2.0), (1.0, 2.0, 2.0)])
def test_what_neither_rises_nor_falls_is_no_ladder(bad):
    with pytest.raises(ValueError, match="neither rise nor fall"):
        refinement_sizes(bad)
    assert list(refinement_sizes((2.0, 1.0, 0.0))) == [2.0, 1.0, 0.0]
    assert np.allclose(refinement_sizes((10, 20, 40)), (0.1, 0.05, 0.025)), "iterations that grow are sizes that fall"
