"""The page on the engines' errors is what its stored numbers say."""

from __future__ import annotations

import dataclasses

import pytest

from benchmarks.engine_study import COMMAND, PAGE, SUMMARY, EngineStudy, page, read
from benchmarks.pareto import Point, front
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.registry import ADAPTERS, all_engines, label


@pytest.fixture(scope="module")
def study() -> EngineStudy:
    return read(SUMMARY.read_text(encoding="utf-8"))


def test_the_page_is_what_the_stored_numbers_say(study):
    assert PAGE.read_text(encoding="utf-8") == page(study), f"write it again: {COMMAND} --page"


def test_every_variant_is_in_the_study(study):
    own = {label(engine) for engine in all_engines(Profile.QUICK) if engine.name in ADAPTERS}
    assert own <= {v.label for v in study.convergence.variants}, f"make it again: {COMMAND} --work DIR"


def test_stored_numbers_read_back(study):
    assert read(study.to_json()) == study


def test_points_that_nothing_beats():
    base = Point(variant="a", where="", key="", contact=True, rms=1.0, wall=1.0, cpu=1.0, runs=1, slowest=1.0)
    fast, near, beaten = (dataclasses.replace(base, cpu=seconds, rms=e) for seconds, e in ((0.5, 2.0), (2.0, 0.5), (2.5, 0.6)))
    assert front([beaten, near, base, fast]) == [fast, base, near]
