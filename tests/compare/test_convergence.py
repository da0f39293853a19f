"""Sequences of known order and limit."""

import numpy as np
import pytest

from looping_pendulum.compare.convergence.ladder import (
    Correction,
    classify_sequence,
    refinement_sizes,
    rms_norm,
    split_error,
)
from looping_pendulum.compare.convergence.result import DROP, ErrorCause, SequenceKind

H = 0.5 ** np.arange(5)


def number(value: float) -> np.ndarray:
    return np.array([[float(value)]])


def numbers(values) -> list[np.ndarray]:
    return [number(value) for value in values]


@pytest.mark.parametrize("order", [0.5, 1.0, 2.0, 4.0])
def test_a_pure_power_law_gives_its_order_and_limit(order):
    finding = classify_sequence(H, numbers(3 + 0.7 * H**order))
    assert finding.kind is SequenceKind.CONVERGES
    assert finding.used == 5
    assert finding.order == pytest.approx(order, abs=1e-4)  # the search for the order stops at 1e-5 of its interval
    assert abs(finding.limit - 3).max() <= finding.uncertainty


@pytest.mark.parametrize("order", [1, 2])
def test_higher_terms_stay_within_the_stated_uncertainty(order):
    finding = classify_sequence(H, numbers(3 + 0.7 * H**order + 0.3 * H ** (order + 1)))
    assert finding.kind is SequenceKind.CONVERGES
    assert abs(finding.order - order) <= finding.order_uncertainty
    assert abs(finding.limit - 3).max() <= finding.uncertainty


def test_three_rungs_give_an_order_without_an_uncertainty_and_a_cautious_limit():
    finding = classify_sequence(H[:3], numbers(3 + 0.7 * H[:3] ** 2))
    assert finding.order == pytest.approx(2.0, abs=1e-3)
    assert finding.order_uncertainty is None
    assert finding.uncertainty == pytest.approx(2 * 0.7 * H[2] ** 2, rel=1e-2)  # twice the distance of the finest: factor 3


def test_iterations_that_grow_are_sizes_that_fall():
    assert np.allclose(refinement_sizes((10, 20, 40)), (0.1, 0.05, 0.025))
    with pytest.raises(ValueError, match="neither rise nor fall"):
        refinement_sizes((1.0, 2.0, 1.5))


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
    inside = orders = 0
    for _ in range(tries):
        shapes = [rng.normal() * np.cos(np.linspace(0, 4 + rng.normal(), shape[0]))[:, None] for _ in H]
        rough = [
            noise * wave / max(rms_norm(wave), 1e-12) * rng.normal() * np.ones(shape) / np.sqrt(shape[1]) for wave in shapes
        ]
        finding = classify_sequence(H, [slope * h + r for h, r in zip(H, rough, strict=True)], spread=noise)
        inside += rms_norm(finding.limit) <= finding.uncertainty
        orders += (
            finding.order is None or finding.order_uncertainty is None or abs(finding.order - 1) <= finding.order_uncertainty
        )
    assert inside >= fewest
    assert orders >= fewest


def test_scatter_is_not_called_convergence():
    rng = np.random.default_rng(1)
    kinds = [classify_sequence(H, numbers(rng.normal(size=5)), spread=0.1).kind for _ in range(100)]
    # five numbers without rule fall one way, ever less, and by a power of h in a few of a hundred cases
    assert sum(kind is SequenceKind.SCATTERS for kind in kinds) >= 95


def test_scatter_no_larger_than_that_of_the_start_is_distinguished():
    rng = np.random.default_rng(2)
    values = rng.normal(size=5)
    finding = classify_sequence(H, numbers(values), spread=1.0)
    assert finding.kind is SequenceKind.WITHIN_SPREAD
    assert finding.scatter == pytest.approx(np.std(values[-4:], ddof=1))
    assert finding.limit == pytest.approx(np.mean(values[-4:]))


@pytest.mark.parametrize(
    ("values", "why"),
    [
        ((1.0, 0.5, 0.7, 0.4, 0.6), "opposite directions"),
        ((1.0, 0.99, 0.95, 0.8, 0.2), "more than the one before"),
        ((1.0, 0.9, 0.8, 0.7, 0.59), "more than the one before"),
    ],
)
def test_what_is_no_convergence_says_why(values, why):
    finding = classify_sequence(H, numbers(values))
    assert finding.kind is SequenceKind.SCATTERS
    assert why in finding.why
    assert finding.order is None


def test_a_coarse_rung_outside_the_power_law_is_left_out():
    h = 0.5 ** np.arange(6)
    values = 3 + 0.7 * h**2
    values[0] = 2.5
    finding = classify_sequence(h, numbers(values))
    assert finding.used == 5
    assert finding.order == pytest.approx(2.0, abs=1e-3)


def test_rungs_that_agree_to_the_floor_have_settled():
    finding = classify_sequence(H, numbers(3 + np.array([1e-2, 1e-9, 2e-9, 0, 1e-9])), floor=1e-6)
    assert (finding.kind, finding.used, finding.uncertainty) == (SequenceKind.SETTLED, 4, 1e-6)
    before = classify_sequence(H, numbers(3 + np.array([1.6e-3, 1e-4, 6.25e-6, 0, 0])), floor=1e-6)
    assert before.kind is SequenceKind.CONVERGES
    assert before.order == pytest.approx(4.0, abs=0.1)
    assert before.limit == number(3)


def test_two_rungs_that_agree_by_chance_have_not_settled():
    finding = classify_sequence(H, numbers((1.0, 0.4, 0.9, 0.7, 0.7)), floor=1e-6)
    assert finding.kind is SequenceKind.SCATTERS


def test_two_rungs_tell_nothing():
    assert classify_sequence(H[:2], numbers((1, 2))).kind is SequenceKind.UNKNOWN


def correction(change: float, uncertainty: float = 0.01, *, converges: bool = True) -> Correction:
    return Correction(ladder="step", change=number(change), uncertainty=uncertainty, converges=converges)


@pytest.mark.parametrize(
    ("own", "corrections", "choices", "causes"),
    [
        (0.5, [correction(-0.5)], {}, (ErrorCause.NOT_CONVERGED,)),
        (0.5, [correction(0.001)], {}, (ErrorCause.MODEL,)),
        (0.5, [correction(-0.3)], {}, (ErrorCause.NOT_CONVERGED, ErrorCause.MODEL)),
        (0.5, [correction(0.001)], {"start": 0.1}, (ErrorCause.MODEL,)),
        (0.5, [correction(0.001)], {"start": -0.6}, (ErrorCause.CHOICE,)),
        (0.5, [correction(-0.3), correction(-0.2)], {}, (ErrorCause.NOT_CONVERGED,)),
        (0.01, [correction(-0.01)], {"start": 0.3}, (ErrorCause.NOTHING,)),
        (0.01, [correction(-0.005, 0.3, converges=False)], {}, (ErrorCause.NOT_CONVERGED,)),
        (0.5, [], {}, (ErrorCause.UNKNOWN,)),
    ],
)
def test_an_error_is_split(own, corrections, choices, causes):
    others = {what: number(own + change) for what, change in choices.items()}
    split = split_error(number(own), number(0), corrections=corrections, choices=others, spread=0.01, quantity=DROP)
    assert split.causes == causes
    assert split.error == pytest.approx(own)


def test_a_spread_as_large_as_the_difference_hides_a_model():
    seen = split_error(number(0.5), number(0), corrections=[correction(0.0)], choices={}, spread=0.3, quantity=DROP)
    assert seen.causes == (ErrorCause.NOTHING,)
    assert seen.model_uncertainty == pytest.approx(0.6, rel=1e-2)
