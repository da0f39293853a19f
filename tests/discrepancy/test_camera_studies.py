"""What a camera in space does to the picture is named, with its value, in blind studies."""

import math

import pytest

from looping_pendulum.discrepancy.identify import identify
from looping_pendulum.discrepancy.result import Verdict
from looping_pendulum.measured.study_io import load
from tests.blind.cases import CASES
from tests.discrepancy.blind_study import TWO_RATIOS, only_candidates, write_study

NAMED = {
    "pixel_aspect": {"foreshortening": 1.03},
    "from_the_side": {
        "foreshortening": math.cos(math.radians(14)),
        "perspective_x": -math.sin(math.radians(14)) / 3,
    },
    "from_afar": {
        "foreshortening": math.cos(math.radians(14)),
        "perspective_x": -math.sin(math.radians(14)) / 30,
    },
    "from_a_corner": {
        "foreshortening": math.cos(math.radians(14)) / math.cos(math.radians(10)),
        "shear": -math.sin(math.radians(14)) * math.tan(math.radians(10)),
    },
    "from_below": {"perspective_y": math.sin(math.radians(3)) / 3},
    "near_scale": {"scale": 3.1 / 3},
    # the rule, too, is seen through the lens
    "wide_lens": {"distortion": -0.3 / 1.5**2, "scale": 1 / (1 - 0.3 / 1.5**2 * 0.25**2)},
}
"""Blind case -> the camera's errors and their values."""


def test_a_picture_wider_than_it_is_high_is_named_foreshortening(tmp_path):
    with only_candidates(["foreshortening", "distortion", "scale"]):
        result = identify(load(write_study(tmp_path, CASES["pixel_aspect"], 0, trials=["ten_a"])))
    assert result.verdict is Verdict.IDENTIFIED
    assert result.names == ("foreshortening",)
    assert abs(result.effects[0].value - 1.03) < 3 * result.effects[0].error


@pytest.mark.accurate
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("case", sorted(NAMED))
def test_what_the_camera_does_is_named_with_its_value(tmp_path, case, seed):
    result = identify(load(write_study(tmp_path, CASES[case], seed, trials=TWO_RATIOS)))
    assert result.verdict is Verdict.IDENTIFIED
    assert set(result.names) == set(NAMED[case])
    assert all(abs(e.value - NAMED[case][e.name]) < 4 * e.error for e in result.effects)
    assert all(e.standardised_rms_after <= 1.2 for e in result.errors if e.held_out)
