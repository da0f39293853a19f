"""Residual tests pass on noise and fail on what is planted in it; the noise law is recovered."""

import dataclasses
import math

import numpy as np
import pytest
from scipy import special

from looping_pendulum.discrepancy.fit.data import FRAMES
from looping_pendulum.discrepancy.fit.residual import _lasting_z, _test_group, check_residuals, failures_in_words
from looping_pendulum.discrepancy.fit.residual_noise import refit_with_estimated_noise
from tests.blind.camera import Camera
from tests.blind.cases import CLEAN
from tests.discrepancy.blind_study import fit_declared, write_study


@pytest.fixture(scope="module")
def fit(tmp_path_factory):
    return refit_with_estimated_noise(fit_declared(write_study(tmp_path_factory.mktemp("clean"), CLEAN, 1))[1])


@pytest.mark.long
def test_a_clean_study_passes_all_tests(fit):
    tests = check_residuals(fit)
    assert tests.passes
    assert not failures_in_words(tests.results)
    assert abs(tests.chi2_per_dof - 1) < 4 / np.sqrt(fit.problem.count)  # by differences of neighbours it scatters by 1/sqrt(n)
    assert {t.subject for t in tests.results} >= {"sliding, light along", "not sliding, heavy_y"}


def test_the_noise_law_is_the_cameras(fit):
    camera = Camera()
    for k, data in enumerate(fit.problem.data):
        samples = fit.problem.run(fit.x, k)
        speed = np.interp(data.t, samples.t, np.linalg.norm(samples.light_velocity, axis=1))
        for channel in ("light_x", "light_y"):
            part = data.slices[channel]
            true = camera.noise + camera.blur * speed[part]
            # about 450 differences of two axes: 4 % at the mean speed, twice that at the ends of a straight line
            assert np.abs(data.sigma[part] / true - 1).mean() < 0.12


@pytest.mark.parametrize("size", [0.7, 1.5])
def test_a_slow_wave_below_the_noise_fails(fit, size):
    data = [dataclasses.replace(d, channels=_wavy(d.channels, size * 1e-3)) for d in fit.problem.data]
    tests = check_residuals(dataclasses.replace(fit, problem=fit.problem.with_data(data)))
    assert not tests.passes
    failed = [t for t in tests.results if not t.passes]
    assert any("light" in t.subject for t in failed)
    assert "the residuals still have a pattern" in failures_in_words(failed)


@pytest.mark.parametrize(("size", "passes"), [(0.8, True), (3.0, False)])
def test_a_wave_is_a_misfit_by_its_size_alone_where_a_tracker_states_errors(fit, size, passes):
    """Stated are a fifth more than what scatters, as neighbours share a part of them."""
    data = []
    for d in fit.problem.data:
        stated = [dataclasses.replace(c, stated_error=(c.t, np.ones(len(c.t)))) for c in _wavy(d.channels, size * 1e-3)]
        data.append(dataclasses.replace(d, channels=tuple(stated), sigma=1.2 * d.sigma))
    tests = check_residuals(dataclasses.replace(fit, problem=fit.problem.with_data(data)))
    assert tests.passes == passes
    assert "the residuals still have a pattern" not in failures_in_words(tests.results)


def _wavy(channels, size):
    return tuple(
        dataclasses.replace(c, value=c.value + size * np.sin(40 * c.t)) if c.name.startswith("light") else c for c in channels
    )


@pytest.mark.parametrize("counts", [(20,), (7, 7, 6), (60,), (100, 100, 100), pytest.param((2000,), marks=pytest.mark.long)])
@pytest.mark.parametrize("frames", FRAMES)
def test_the_score_of_white_noise_is_a_standard_one_with_few_values_and_many(counts, frames):
    """Oracle: the Gaussian's tail. By mean and variance alone 1.4 % of groups of twenty exceed 3.5, sixty times as many."""
    rng = np.random.default_rng(4)
    z = np.array([_lasting_z([rng.standard_normal(n) for n in counts], frames) for _ in range(3000)])
    for limit in (1.0, 2.0, 3.0):
        expected = float(special.ndtr(-limit))
        assert np.mean(z > limit) == pytest.approx(expected, abs=4 * math.sqrt(expected / len(z)))


@pytest.mark.long
def test_the_groups_of_a_study_fail_together_in_about_half_a_percent_of_noise():
    """Oracle: what the limit was chosen for, of eight groups of three trials."""
    rng, studies = np.random.default_rng(7), 2500
    failed = sum(
        any(not _test_group("noise", list(rng.standard_normal((3, n)))).passes for n in (40, 40, 40, 40, 90, 90, 90, 90))
        for _ in range(studies)
    )
    assert failed / studies == pytest.approx(5e-3, abs=3 * math.sqrt(5e-3 / studies))


def test_errors_that_last_some_frames_fail_and_those_that_alternate_pass():
    """A study was called unexplained because neighbours differed by more than noise, which nothing that is missing does."""
    rng = np.random.default_rng(1)
    white = list(rng.standard_normal((3, 300)))
    wave = 0.4 * np.sin(2 * np.pi * np.arange(300) / 60)
    assert _test_group("white", white).passes
    assert not _test_group("wave", [z + wave for z in white]).passes
    alternating = [z[1:] - 0.5 * z[:-1] for z in white]  # a correlation of -0.4 at lag 1: z = -12
    assert _test_group("alternating", alternating).value < 0


def test_the_end_of_a_trial_says_nothing_of_the_next_ones_start():
    """Oracle: all pairs within each trial, by hand."""
    parts = list(np.random.default_rng(2).standard_normal((2, 20)))
    weights = np.exp(-np.abs(np.subtract.outer(range(20), range(20))) / 4) * (1 - np.eye(20)) / 2
    score = sum(z @ weights @ z for z in parts) / sum(z @ z for z in parts)
    square, cube = (2 * np.trace(np.linalg.matrix_power(weights, 2)), 8 * np.trace(np.linalg.matrix_power(weights, 3)))
    variance = 2 * square / (40 * 42)
    skewness = 2 * cube / (40 * 42 * 44) / variance**1.5
    root = (1 + score / math.sqrt(variance) * skewness / 2) ** (1 / 3)
    assert _lasting_z(parts, 4.0) == pytest.approx((root - 1 + skewness**2 / 36) * 6 / skewness)


def test_pairs_and_residuals_of_zero_have_a_score():
    """Ten trials with two values in a mode, and a model that is met exactly."""
    assert math.isfinite(_lasting_z(list(np.random.default_rng(3).standard_normal((10, 2))), 4.0))
    assert math.isfinite(_lasting_z([np.zeros(30)], 4.0))
