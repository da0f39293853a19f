"""One suite for every engine, the reference included."""

from __future__ import annotations

import pytest

from looping_pendulum.engines.conformance import CHECKS, CheckOutcome, Remembering, examine, left_out
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.registry import all_engines, label, missing_packages
from tests.engines.faulty import FaultyEngine

CHAINS = frozenset(
    {
        *("mujoco:beads", "pymunk:chain", "pymunk:beads", "pymunk:segments", "pymunk:defaults"),
        *("pybullet:chain", "pybullet:remade", "pybullet:point_to_point", "pybullet:defaults", "drake:chain"),
    }
)
"""Variants that take 5 to 80 s of a processor for a second: daily, they run what the checks of `DAILY_FOR_CHAINS` share.

Their friction and halts are judged daily by the scenarios' tolerances (tests/test_tolerances.py), their falls, swings and
static friction by their own files of tests, effects by test_effects_reach_engines.py.
"""
DAILY_FOR_CHAINS = frozenset(
    {
        *("makes_nothing_heavy", "samples_every_millisecond_from_rest", "velocity_is_the_rate_of_position", "is_deterministic"),
        *("says_who_supplies_what", "string_keeps_its_length", "heavy_mass_falls_straight_down"),
        *("release_has_the_exact_acceleration", "energy_is_kept_without_losses", "follows_the_reference_without_losses"),
    }
)


def cases():
    """(engine, check) for every variant; what a variant is known to fail is a strict expected failure."""
    for engine in map(Remembering, all_engines(Profile.QUICK)):
        for check in CHECKS:
            reason = engine.abilities.known_failures.get(check.__name__)
            marks = [pytest.mark.xfail(reason=reason, raises=AssertionError, strict=True)] if reason else []
            if label(engine) in CHAINS and check.__name__ not in DAILY_FOR_CHAINS:
                marks.append(pytest.mark.accurate)
            yield pytest.param(engine, check, id=f"{label(engine)}-{check.__name__}", marks=marks)


def test_what_is_not_run_daily_is_of_variants_and_checks_that_exist():
    assert {label(engine) for engine in all_engines(Profile.QUICK)} >= CHAINS
    assert {check.__name__ for check in CHECKS} >= DAILY_FOR_CHAINS


def test_known_failures_are_of_checks_that_exist():
    names = {check.__name__ for check in CHECKS}
    assert all(set(engine.abilities.known_failures) <= names for engine in all_engines(Profile.QUICK))


@pytest.mark.parametrize(("engine", "check"), list(cases()))
def test_conformance(engine, check):
    missing = missing_packages(engine)
    if missing:
        pytest.skip(f"{missing[0]} is not installed")
    reason = left_out(check, engine)
    if reason:
        pytest.skip(reason)
    check(engine)


def test_examining_an_engine_says_what_failed_and_goes_on():
    found = {result.check: result for result in examine(FaultyEngine("nan"), time_limit=60)}
    assert list(found) == [check.__name__ for check in CHECKS]
    assert found["makes_nothing_heavy"].outcome is CheckOutcome.PASSED
    assert found["drop_is_free_fall"].outcome is CheckOutcome.LEFT_OUT
    assert "'drop'" in found["drop_is_free_fall"].why
    for name in ("samples_every_millisecond_from_rest", "string_keeps_its_length"):
        assert found[name].outcome is CheckOutcome.FAILED
        assert "not a number" in found[name].why


def test_an_engine_that_crashes_fails_its_checks_and_no_more():
    found = list(examine(FaultyEngine("segfault"), checks=CHECKS[:2]))
    assert [result.outcome.value for result in found] == ["pass", "fail"]
    assert "SIGSEGV" in found[1].why


def test_without_a_friction_law_the_capstan_check_is_left_out():
    laws = {label(e): left_out(CHECKS[6], e) for e in all_engines(Profile.QUICK)}
    assert CHECKS[6].__name__ == "vertical_release_obeys_the_capstan_law"
    assert laws["mujoco:documented"] == "nobody supplies its friction law"
    assert laws["reference:scipy"] == ""
