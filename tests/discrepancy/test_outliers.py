"""Tracked points on another object are found and left out; what a model lacks is not taken for them."""

import dataclasses
import json

import numpy as np
import pytest

from looping_pendulum.discrepancy.fit.residual_noise import HALF_WINDOW, find_outliers
from looping_pendulum.discrepancy.identify import identify
from looping_pendulum.discrepancy.report.markdown import identification_markdown
from looping_pendulum.discrepancy.report.writing import write
from looping_pendulum.discrepancy.result import Verdict
from looping_pendulum.measured.study_io import load
from tests.blind.cases import CASES, CLEAN
from tests.compare.conftest import quick_figures  # noqa: F401, a fixture
from tests.discrepancy.blind_study import TWO_RATIOS, WHOLE_LIBRARY, only_candidates, put_on_another_object, write_study
from tests.discrepancy.expected import EXPECTED

FRAMES = 240
RIVALS = ("wind_speed", "clock_offset", "side_force")


def film(rng, misfit=0.0):
    """Return residuals of a second at 240 frames/s, and their noise; a model that lacks something is off by ``misfit`` [m]."""
    t = np.arange(FRAMES) / FRAMES
    sigma = 1e-3 + 2e-4 * np.abs(3 * np.sin(5 * t))
    smooth = misfit * np.stack([t**2, -np.sin(6 * t)], axis=1)
    return smooth + sigma[:, None] * rng.standard_normal((FRAMES, 2)), sigma


@pytest.mark.parametrize("misfit", [0.016, *(pytest.param(m, marks=pytest.mark.accurate) for m in (0.0, 0.1))])
def test_neither_noise_nor_what_a_model_lacks_is_an_outlier(misfit):
    """Oracle: the mixture itself. Outliers are off by 6.4 sigma, which noise exceeds once in exp(18) points: none in 72 000."""
    rng = np.random.default_rng(1)
    assert sum(find_outliers(*film(rng, misfit), 1.0).sum() for _ in range(300)) == 0


@pytest.mark.parametrize("misfit", [0.0, 0.016])
def test_single_points_on_another_object_are_found(misfit):
    rng = np.random.default_rng(2)
    missed = wrong = 0
    for _ in range(50):
        residual, sigma = film(rng, misfit)
        planted = rng.random(FRAMES) < 0.02
        angle = rng.uniform(0, 2 * np.pi, FRAMES)
        residual[planted] += 0.03 * np.stack([np.cos(angle), np.sin(angle)], axis=1)[planted]
        found = find_outliers(residual, sigma, 1.0)
        missed, wrong = missed + np.sum(planted & ~found), wrong + np.sum(found & ~planted)
    assert missed == 0
    assert wrong <= 2  # of 11 800 points beside planted outliers, whose neighbours' median is a little off


@pytest.mark.parametrize("length", [2, 8, 30, 55])
def test_a_block_on_another_object_is_found_whole(length):
    rng = np.random.default_rng(3)
    for start in (10, 60, 150, FRAMES - length - 10):
        residual, sigma = film(rng, 0.016)
        block = np.zeros(FRAMES, dtype=bool)
        block[start : start + length] = True
        residual[block] += [0.03, -0.02] + 0.05 * np.linspace(0, length / FRAMES, length)[:, None]
        np.testing.assert_array_equal(find_outliers(residual, sigma, 1.0), block)


def test_a_jump_that_does_not_come_back_is_not_an_outlier():
    """A camera that was bumped, or a model that misses an event, moves all points that follow."""
    residual, sigma = film(np.random.default_rng(4))
    residual[120:] += 0.03
    assert not find_outliers(residual, sigma, 1.0).any()


def test_the_ends_of_a_film_are_judged_by_a_line_through_what_follows():
    rng = np.random.default_rng(5)
    for i in (0, 1, FRAMES - 1):
        residual, sigma = film(rng)
        residual += 0.2 * np.arange(FRAMES)[:, None] / FRAMES  # drifts by 0.8 mm a frame
        residual[i] += 0.02
        assert np.flatnonzero(find_outliers(residual, sigma, 1.0)).tolist() == [i]


def test_the_ends_of_a_film_of_few_frames_bend_as_what_the_model_lacks():
    """At 15 frames/s a fall whose drag the model lacks is off by metres, and bends over the neighbours of its last point."""
    rng = np.random.default_rng(6)
    t = np.arange(46) / 15
    for _ in range(100):
        residual = (0.3 * t**2 + 0.1 * t**3)[:, None] + 0.05 * rng.standard_normal((46, 1))
        assert not find_outliers(residual, np.full(46, 0.05), 40.0).any()


@pytest.mark.parametrize("frames", [10, 15, 30])
def test_a_swing_whose_period_the_model_misses_has_no_outliers(frames):
    """The residual then swings as far as the bob, 100 times its noise, over a period of 1.3 s."""
    rng = np.random.default_rng(7)
    t = np.arange(20 * frames) / frames
    residual = (0.5 * np.sin(4.8 * t) * np.sin(0.15 * t))[:, None] + 5e-3 * rng.standard_normal((len(t), 1))
    assert not find_outliers(residual, np.full(len(t), 5e-3), 2.0).any()
    residual[100] += 1.5
    assert np.flatnonzero(find_outliers(residual, np.full(len(t), 5e-3), 2.0)).tolist() == [100]


def test_too_few_points_have_no_outliers():
    assert not find_outliers(np.full((2 * HALF_WINDOW, 2), [0.0, 1.0]), np.ones(2 * HALF_WINDOW), 1.0).any()


def studied(folder, case, seed, library=RIVALS, **planted):
    """Identify a blind study of three trials whose light mass is tracked wrongly now and then; return that and the times."""
    path = write_study(folder, case, seed, trials=TWO_RATIOS)
    times = {name: put_on_another_object(folder / f"{name}.csv", seed=seed, **planted) for name in TWO_RATIOS}
    with only_candidates(library):
        return identify(load(path)), times


def listed_times(result, trial):
    return sum(o.count for o in result.outliers if o.trial == trial)


@pytest.mark.long
@pytest.mark.usefixtures("quick_figures")
@pytest.mark.parametrize(
    ("seed", "planted", "library"),
    [
        (1, {"share": 0.02}, RIVALS),
        *(
            pytest.param(seed, planted, WHOLE_LIBRARY, marks=pytest.mark.accurate)
            for seed, planted in (
                *((seed, {"share": 0.02}) for seed in (1, 2, 3)),
                (3, {"block": 30}),
            )
        ),
        pytest.param(
            *(1, {"share": 0.02, "block": 30}, WHOLE_LIBRARY),
            marks=[
                pytest.mark.accurate,
                pytest.mark.xfail(reason="the first look takes a block of wrong points beside others for lost pictures"),
            ],
        ),
    ],
)
def test_nothing_is_missing_where_only_points_are_wrong(tmp_path, seed, planted, library):
    """Without outliers these studies ended unexplained, at 1.2 to 1.8 times the noise."""
    result, times = studied(tmp_path, CLEAN, seed, library, **planted)
    assert result.verdict is Verdict.NO_MISSING_EFFECT, result.sentence
    for trial, planted in times.items():
        assert listed_times(result, trial) == len(planted)
    # What was left out is not in the errors either: the noise of two coordinates, 1 mm at rest and more where they are blurred
    assert all(e.rms_after < 2.5e-3 for e in result.errors), [e.rms_after for e in result.errors]
    total = sum(map(len, times.values()))
    assert f"{total} of " in " ".join(result.notes)
    assert "left out" in " ".join(result.notes)
    assert "## Outliers" in identification_markdown(result)
    assert max(o.largest_distance for o in result.outliers) == pytest.approx(0.03, abs=6e-3)  # its noise: 1 mm, blur 2 mm
    report = write(result, tmp_path / "out")
    assert "## Outliers" in report.read_text(encoding="utf-8")
    tree = json.loads((tmp_path / "out" / "verdict.json").read_text(encoding="utf-8"))
    assert sum(o["count"] for o in tree["outliers"]) == total


@pytest.mark.accurate  # daily, outliers alone are found and nothing else
@pytest.mark.parametrize(
    "case", ["linear_drag", *(pytest.param(c, marks=pytest.mark.accurate) for c in ("side_force", "scale"))]
)
def test_an_effect_is_named_behind_outliers_with_the_same_value_and_error(tmp_path, case):
    """Power with and without planted outliers: the value agrees within a half of its error, the error within a tenth."""
    name, planted = EXPECTED[case]
    (tmp_path / "planted").mkdir()
    (tmp_path / "clean").mkdir()
    behind, _ = studied(tmp_path / "planted", CASES[case], 1, (name, "wind_speed"), share=0.02)
    with only_candidates((name, "wind_speed")):
        alone = identify(load(write_study(tmp_path / "clean", CASES[case], 1, trials=TWO_RATIOS)))
    for result in (behind, alone):
        assert result.verdict is Verdict.IDENTIFIED, result.sentence
        assert result.names == (name,)
        assert abs(result.effects[0].value - planted) < 3 * result.effects[0].error
    a, b = behind.effects[0], alone.effects[0]
    assert abs(a.value - b.value) < 0.5 * b.error
    assert a.error == pytest.approx(b.error, rel=0.1)
    assert not alone.outliers


@pytest.mark.long
def test_no_point_of_a_clean_film_is_left_out(tmp_path):
    with only_candidates(RIVALS):
        result = identify(load(write_study(tmp_path, CLEAN, 3, trials=TWO_RATIOS)))
    assert result.outliers == ()
    assert "left out" not in " ".join(result.notes)
    assert "## Outliers" not in identification_markdown(result)
    assert "## Outliers" in identification_markdown(dataclasses.replace(result, outliers=studied_outliers()))


def studied_outliers():
    from tests.pages.made_up import identification

    return identification("x").outliers
