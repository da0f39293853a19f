"""One suite for every engine, the reference included."""

import functools

import numpy as np
import pytest

from looping_pendulum.engines.conformance import (
    CHECKS,
    EFFECT_CASES,
    EFFECT_CHECKS,
    CachedEngine,
    CheckOutcome,
    reference_positions,
    run_checks,
    scenario,
    skip_reason,
)
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.registry import all_engines, label, missing_packages
from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.effects import EFFECTS
from tests.apparatus import TEN_TO_ONE
from tests.engines.faulty import FaultyEngine

BY_NAME = {check.__name__: check for check in CHECKS}
CHAINS = frozenset(
    {
        *("mujoco:beads", "pymunk:chain", "pybullet:chain", "pybullet:defaults", "drake:chain"),
        *("box2d:chain", "rapier:chain", "exudyn:cable", "newton:tendon"),
    }
)
"""Variants that take 5 to 80 s of processor time per simulated second, or to compile; daily, only `DAILY_FOR_CHAINS`.

Their friction and halts are judged daily by the scenarios' tolerances (tests/test_tolerances.py), their falls, swings and
static friction by their own files of tests, effects by test_coefficients_reach_engines.py.
"""
DAILY_FOR_CHAINS = frozenset(
    {
        *("can_be_pickled", "samples_every_millisecond_from_rest", "velocity_is_the_rate_of_position", "is_deterministic"),
        *("provenance_is_complete", "string_keeps_its_length", "heavy_mass_falls_straight_down"),
        *("release_has_the_exact_acceleration", "energy_is_kept_without_losses", "follows_the_reference_without_losses"),
        "push_across_acts_as_in_the_reference",
    }
)
HELD_ELSEWHERE = frozenset(
    {
        *(("pybullet:chain", check) for check in ("is_deterministic", "push_across_acts_as_in_the_reference")),
    }
)
"""Checks of `DAILY_FOR_CHAINS` that take long; they run with the accurate ones, as an engine's own tests hold the same daily.

In `test_pybullet.py` a run is made twice on a shorter string, and every node's velocity after a push is compared with the taut
string's; that a chain moves on from there as it should is for the other checks.
"""
NEVER_DAILY = frozenset({"drake:chain", "box2d:chain", "rapier:chain", "exudyn:cable", "newton:tendon"})
"""Optional engines; daily, tests of their own run their chains past the halt.

Newton has no daily runs: it compiles itself first, for half a minute of processor time.
"""


DAILY_CHAINS = sorted(CHAINS - NEVER_DAILY)
"""Chains whose daily checks are one test per chain, because two workers of pytest-xdist would repeat their shared runs."""


def daily_for(name, check):
    """Return whether the chain ``name`` is examined by ``check`` every day."""
    return check.__name__ in DAILY_FOR_CHAINS and (name, check.__name__) not in HELD_ELSEWHERE


def cases():
    """Yield (engine, check) for every variant; a known failure is a strict expected failure."""
    for engine in all_engines(Profile.QUICK):
        name = label(engine)
        for check in CHECKS:
            if name in DAILY_CHAINS and daily_for(name, check):
                continue
            reason = engine.abilities.known_failures.get(check.__name__)
            marks = [pytest.mark.xfail(reason=reason, raises=(AssertionError, EngineError), strict=True)] if reason else []
            if name in CHAINS:
                marks.append(pytest.mark.accurate)
            if not (missing_packages(engine) or skip_reason(check, engine)):
                yield pytest.param(name, check, id=f"{name}-{check.__name__}", marks=marks)


@functools.cache
def cached_engine(name):
    """Return the variant ``name``, whose checks share their runs."""
    (engine,) = (engine for engine in all_engines(Profile.QUICK) if label(engine) == name)
    return CachedEngine(engine)


def test_what_is_not_run_daily_is_of_variants_and_checks_that_exist():
    assert {label(engine) for engine in all_engines(Profile.QUICK)} >= CHAINS
    assert {check.__name__ for check in CHECKS} >= DAILY_FOR_CHAINS
    assert {name for name, _ in HELD_ELSEWHERE} <= set(DAILY_CHAINS)
    assert {check for _, check in HELD_ELSEWHERE} <= DAILY_FOR_CHAINS


def test_known_failures_are_of_checks_that_exist():
    for engine in all_engines(Profile.QUICK):
        known = engine.abilities.known_failures
        assert set(known) <= set(BY_NAME), label(engine)
        assert not any(skip_reason(BY_NAME[name], engine) for name in known), (
            f"{label(engine)}: a known failure of a check that does not apply to it"
        )


@pytest.mark.parametrize(("name", "check"), list(cases()))
def test_conformance(name, check):
    check(cached_engine(name))


@pytest.mark.parametrize("name", DAILY_CHAINS)
def test_conformance_of_a_chain(name):
    shared = cached_engine(name)
    if missing_packages(shared.engine):
        pytest.skip(f"{missing_packages(shared.engine)[0]} is not installed")
    known, wrong, passed = shared.abilities.known_failures, [], 0
    for check in CHECKS:
        if not daily_for(name, check) or skip_reason(check, shared):
            continue
        try:
            check(shared)
        except AssertionError as error:
            if check.__name__ not in known:
                wrong.append(f"{check.__name__}: {error}")
        else:
            passed += 1
            if check.__name__ in known:
                wrong.append(f"{check.__name__}: passes, declared to fail: {known[check.__name__]}")
    assert not wrong, "\n".join(wrong)
    assert passed, "no check applied"


def test_every_effect_of_the_library_has_a_check():
    # Gravity and the capstan law act in all other checks; a closure is found from data, and has no case to set.
    assert set(EFFECT_CHECKS) == set(EFFECT_CASES) == set(EFFECTS) - {"gravity", "capstan", "closure"}


@pytest.mark.parametrize("effect", EFFECT_CASES)
def test_an_effects_case_shows_it(effect):
    case = EFFECT_CASES[effect]
    ends = [reference_positions(p, np.array([case.duration]))[-1] for p in (case.parameters_with, case.parameters_without)]
    assert np.linalg.norm(ends[0] - ends[1]) > 5e-4, "so that the check can detect its absence"
    assert EFFECTS[effect] in case.parameters_with.effects
    assert EFFECTS[effect] not in case.parameters_without.effects or EFFECTS[effect].in_base_model


def test_every_effect_that_an_engine_declares_is_checked():
    for engine in all_engines(Profile.QUICK):
        asked = {name for name, check in EFFECT_CHECKS.items() if not skip_reason(check, engine)}
        taken = {name for name in EFFECT_CHECKS if EFFECTS[name].in_base_model or engine.abilities.reaches(EFFECTS[name])}
        assert asked == taken, label(engine)


def test_run_checks_reports_failures_and_continues():
    some = [BY_NAME[name] for name in ("can_be_pickled", "samples_every_millisecond_from_rest", "drop_is_free_fall")]
    some.append(BY_NAME["string_keeps_its_length"])
    results = {result.check: result for result in run_checks(FaultyEngine("nan"), time_limit=60, checks=some)}
    assert list(results) == [check.__name__ for check in some]
    assert results["can_be_pickled"].outcome is CheckOutcome.PASSED
    assert results["drop_is_free_fall"].outcome is CheckOutcome.LEFT_OUT
    assert "'drop'" in results["drop_is_free_fall"].why
    for name in ("samples_every_millisecond_from_rest", "string_keeps_its_length"):
        assert results[name].outcome is CheckOutcome.FAILED
        assert "not a number" in results[name].why


def test_an_engine_that_crashes_fails_its_checks_and_no_more():
    results = list(run_checks(FaultyEngine("segfault"), checks=CHECKS[:2]))
    assert [result.outcome.value for result in results] == ["pass", "fail"]
    assert "SIGSEGV" in results[1].why


def test_what_an_engine_declares_that_it_lacks_is_left_out():
    capstan, static = (
        BY_NAME[name]
        for name in ("vertical_release_obeys_the_capstan_law", "static_friction_holds_what_kinetic_friction_would_not")
    )
    engines = {label(engine): engine for engine in all_engines(Profile.QUICK)}
    assert skip_reason(capstan, engines["mujoco:documented"]) == "nobody supplies its friction law"
    assert skip_reason(static, engines["mujoco:beads"]) == "it declares no static friction of its own"
    for name in ("reference", "mujoco:capstan"):
        assert skip_reason(capstan, engines[name]) == skip_reason(static, engines[name]) == ""


def test_runs_are_shared_but_for_those_that_are_made_again():
    engine = FaultyEngine("none")
    shared = CachedEngine(engine)
    same = scenario(TEN_TO_ONE, 0.005)
    assert shared.simulate(same) is shared.simulate(scenario(TEN_TO_ONE, 0.005))
    assert shared.simulate_uncached(same) is not shared.simulate(same)


def test_a_run_that_fails_is_not_waited_for_twice():
    class Failing(FaultyEngine):
        runs = 0

        def simulate(self, scenario, record=None):
            self.runs += 1
            raise ValueError("no rod today")

    engine = Failing("none")
    shared = CachedEngine(engine)
    for _ in range(2):
        with pytest.raises(ValueError, match="no rod today"):
            shared.simulate(scenario(TEN_TO_ONE, 0.005))
    assert engine.runs == 1
