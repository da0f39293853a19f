"""What was asked of `identify` on blind studies, against what the stored rates say, and what the search for outliers costs."""

import dataclasses
import json

import pytest

from benchmarks import calibration
from benchmarks.blind_sample import draw
from benchmarks.calibration_summary import TARGETS, Target, proportion, summary, with_upper_bound
from tests.test_calibration import outcome

STORED = json.loads(calibration.RESULT.read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    "target",
    [
        pytest.param(
            t, id=t.what, marks=pytest.mark.xfail(raises=AssertionError, reason=t.why_not, strict=True) if t.why_not else ()
        )
        for t in TARGETS
    ],
)
def test_what_was_asked_of_the_search(target):
    """Oracle: blind studies of the separate simulator, of a seed of their own."""
    assert target.is_met(STORED["rates"]["summary"])


@pytest.mark.parametrize(
    ("limits", "measured", "met"),
    [
        ({"low": 0.8}, proportion(8, 10), True),
        ({"low": 0.8}, proportion(7, 10), False),
        ({"low": 0.8}, proportion(0, 0), False),
        ({"low": 0.8}, None, False),
        ({"low": 0.93, "high": 0.97}, proportion(98, 100), False),
        ({"high": 1.1}, 1.05, True),
        ({"high": 0.01, "highest_bound": 0.02}, with_upper_bound(1, 300), True),
        ({"high": 0.01, "highest_bound": 0.02}, with_upper_bound(1, 120), False),
        ({"high": 0.01, "highest_bound": 0.02}, proportion(1, 300), False),
    ],
)
def test_a_target_is_met_within_its_limits(limits, measured, met):
    assert Target(what="", asked="", at="set/share", **limits).is_met({"set": {"share": measured}}) is met


def test_targets_are_of_large_effects_and_of_what_is_wrong_alone():
    drawn = draw("rates", "single", 4, 0)
    shape = [(16e-3, 3, 1e-3), (50e-3, 1, 1e-3), (50e-3, 4, 2e-3), (8e-3, 4, 1e-3)]
    studies = [
        dataclasses.replace(s, size=size, trials=trials, noise=noise)
        for s, (size, trials, noise) in zip(drawn, shape, strict=True)
    ]
    said = [("right", "identified"), ("wrong", "unlisted"), ("wrong", "identified"), ("wrong", "identified")]
    outcomes = [outcome(judgement, verdict=verdict) for judgement, verdict in said]
    large = summary(list(zip(studies, outcomes, strict=True)))["large"]
    assert (large["single"]["count"], large["single"]["of"]) == (1, 3)
    assert (large["single_as_recommended"]["count"], large["single_as_recommended"]["of"]) == (1, 1)
    assert (large["single_wrong_alone"]["count"], large["single_wrong_alone"]["of"]) == (1, 3)
    assert large["single_called_unlisted"]["count"] == 1
    assert large["unlisted_held_out_error"] == {}


def test_ways_of_handling_outliers_are_compared_on_the_same_studies():
    studies = draw("rates", "single", 2, 0)
    estimate = [{"error": 1.0}, {"error": 1.2}]
    pairs = [
        (
            calibration.Arm(study=dataclasses.replace(s, noise_kind=kind), finds_outliers=finds),
            {"judgement": "right" if finds else "none", "verdict": "unexplained", "estimates": [estimate[kind == "outliers"]]},
        )
        for s in studies
        for kind in calibration.ARM_NOISE_KINDS
        for finds in (True, False)
    ]
    assert len({arm.name for arm, _ in pairs}) == 8
    rows = calibration.outlier_rows(pairs[:-1])
    assert [(r["points"], r["finds_outliers"], r["named_or_tied"]["count"]) for r in rows] == [
        ("white", True, 1), ("white", False, 0), ("outliers", True, 1), ("outliers", False, 0)
    ]  # fmt: skip
    assert all(r["named_or_tied"]["of"] == 1 for r in rows), "of the second study one way is missing"
    assert [r["standard_error_ratio"] for r in rows] == [1.0, 1.0, 1.2, 1.2]
