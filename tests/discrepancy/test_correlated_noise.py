"""Errors of tracked points that last longer than a frame: their size is estimated, and no missing effect is made of them."""

import numpy as np
import pytest

from looping_pendulum.discrepancy.fit.data import CorrelatedNoise, Whitening
from looping_pendulum.discrepancy.identify import identify
from looping_pendulum.discrepancy.report.markdown import identification_markdown
from looping_pendulum.discrepancy.result import Verdict
from looping_pendulum.measured.study_io import load
from tests.blind.cases import CASES, CLEAN
from tests.discrepancy.blind_sample import BlindStudy, write_files
from tests.discrepancy.blind_study import TWO_RATIOS, WHOLE_LIBRARY, let_the_tracker_wander, only_candidates, write_study

AMPLITUDE, FRAMES = 5e-4, 10
"""Half a millimetre, for some ten frames at a time: beside white noise of a millimetre."""


def study_with_wander(folder, case, seed):
    path = write_study(folder, case, seed, trials=TWO_RATIOS)
    for i, file in enumerate(sorted(folder.glob("*.csv"))):
        let_the_tracker_wander(file, amplitude=AMPLITUDE, frames=FRAMES, seed=10 * seed + i)
    return load(path)


@pytest.mark.parametrize("gaps", [False, True])
def test_whitening_is_a_root_of_the_inverse_covariance(gaps):
    """Oracle: the covariance matrix, written out; points that are left out (infinite errors) are not in it."""
    rng = np.random.default_rng(0)
    t = np.sort(rng.uniform(0, 1, 60))
    sigma = 1e-3 * (1 + rng.random(60))
    if gaps:
        sigma[[0, 7, 8, 9, 59]] = np.inf
    noise = CorrelatedNoise(amplitude=5e-4, correlation_time=0.04)
    whitening = Whitening(t, sigma, noise)
    y = rng.standard_normal((60, 3))
    kept = np.isfinite(sigma)
    lag = np.abs(t[kept][:, None] - t[kept])
    covariance = np.diag(sigma[kept] ** 2) + noise.amplitude**2 * np.exp(-lag / noise.correlation_time)
    z = whitening(y)
    assert z.T @ z == pytest.approx(y[kept].T @ np.linalg.solve(covariance, y[kept]), rel=1e-10)
    assert whitening.log_determinant == pytest.approx(np.linalg.slogdet(covariance)[1], rel=1e-12)
    np.testing.assert_allclose(whitening(y[:, 0]), z[:, 0], rtol=1e-12)


def test_differences_of_neighbours_keep_their_size():
    """Oracle: the variance of half the squared difference of neighbours, white + s^2 (1 - exp(-step / tau))."""
    noise = CorrelatedNoise(amplitude=5e-4, correlation_time=0.04)
    white = noise.white_sigma(np.array([1e-3]), 1 / 240)
    assert white**2 + 5e-4**2 * (1 - np.exp(-1 / 240 / 0.04)) == pytest.approx(1e-6)


@pytest.mark.long
def test_a_tracker_that_wanders_too_little_to_be_noticed_is_no_effect(tmp_path):
    """By white noise alone a foreshortening decreased the Bayesian information criterion by 15, though nothing was hidden."""
    study = BlindStudy(hidden=(), size=None, noise=2e-3, noise_kind="wander", trials=1, seed=476403104)
    result = identify(load(write_files(study, tmp_path)))
    assert any(not e.names for e in result.credible)


@pytest.mark.long
def test_a_right_effect_of_little_evidence_stays(tmp_path):
    """A wrong scale that moves the light mass by a millimetre, hardly less probable beside a tracker that may wander."""
    study = BlindStudy(hidden=("scale",), size=1e-3, noise=5e-4, trials=2, seed=1596938784)
    with only_candidates(["scale"]):
        result = identify(load(write_files(study, tmp_path)))
    assert result.names == ("scale",)


@pytest.mark.long
@pytest.mark.parametrize(
    ("seed", "library"),
    [
        (2, ("wind_speed", "scale", "side_force")),
        *(pytest.param(s, WHOLE_LIBRARY, marks=pytest.mark.accurate) for s in (1, 2, 3)),
    ],
)
def test_nothing_is_missing_where_the_tracker_wanders(tmp_path, seed, library):
    with only_candidates(library):
        result = identify(study_with_wander(tmp_path, CLEAN, seed))
    assert result.verdict is Verdict.NO_MISSING_EFFECT
    assert set(result.correlated_noise) <= {"light", "heavy"}
    assert all(2e-4 < e.amplitude < 1e-3 for e in result.correlated_noise.values())
    assert any("as when a tracker wanders over its mark" in note for note in result.notes)
    report = identification_markdown(result)
    assert "## Errors that last longer than a frame" in report
    assert "## What these data could show" in report
    assert {v.name for v in result.smallest_visible} >= set(library or ())


@pytest.mark.accurate
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_an_effect_is_named_though_the_tracker_wanders(tmp_path, seed):
    result = identify(study_with_wander(tmp_path, CASES["linear_drag"], seed))
    explanations = [{e.name for e in tie} for tie in result.ties] or [set(result.names)]
    assert any("light_linear_drag" in names for names in explanations), result.sentence
