"""The tolerances that stand in the shipped scenarios, over every engine: the same judgement as `looping-pendulum check`."""

import functools

import pytest

from looping_pendulum.compare.comparison import compare
from looping_pendulum.compare.harness import compare_engines
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.reference import Reference
from looping_pendulum.engines.registry import expand_tolerances, label, missing_packages, select
from looping_pendulum.scenarios import loader

LONG = {
    *(
        (name, "pybullet:chain")
        for name in ("ten_to_one", "drop", "atwood", "frictionless", "held", "fat_rod", "static_friction")
    ),
    *((name, "pybullet:chain") for name in ("two_to_one", "two_and_a_half_to_one")),
    *((name, "pymunk:chain") for name in ("held", "frictionless", "two_to_one", "two_and_a_half_to_one")),
    *((name, "mujoco:beads") for name in ("ten_to_one", "held", "frictionless", "static_friction")),
    *((name, "mujoco:beads") for name in ("two_to_one", "two_and_a_half_to_one")),
    ("static_friction", "pymunk:chain"),
    *(("ten_to_one", variant) for variant in ("pybullet:defaults", "pymunk:chain")),
    *(("ten_to_one", f"{engine}:chain") for engine in ("box2d", "rapier")),
    ("ten_to_one", "exudyn:cable"),
}
"""Quick by name, and up to a minute and a half each: with the accurate ones.

What they hold is held daily by the same variant in a shorter run, or by another chain in the same scenario: free fall, a swing
from a hand, Atwood's machine, the sliding part of ten_to_one and the beads' way to its halt in tests/engines
(`test_pybullet.py`, `test_bead_chains.py`, ...), a loop without friction in `test_conformance.py` there, static friction by
`test_coefficients_reach_engines.py` there, the fat rod by `pymunk:chain` and `mujoco:beads` here; 2:1 and 2.5:1 by the tendons
alone. 10:1 is held to its limits by `pymunk:chain` until after the halt in `test_pymunk.py` there; to the rod it winds on the
fat rod, here.
"""


def cases(profile: Profile):
    """(scenario, engine) for every engine that a shipped scenario has tolerances for."""
    params = []
    for name in loader.shipped():
        engines = sorted({t.engine for t in loader.load(name).tolerances if t.profile == profile.value})
        for engine in engines:
            marks = [pytest.mark.accurate] if (name, engine) in LONG else []
            params.append(pytest.param(name, engine, id=f"{name}-{engine}", marks=marks))
    return params


def installed(name: str, profile: Profile):
    """The variant ``name``; the test is skipped where its package is not there."""
    (chosen,) = select([name], profile)
    missing = missing_packages(chosen)
    if missing:
        pytest.skip(f"{missing[0]} is not installed")
    return chosen


def keeps_its_tolerances(result):
    judged = [f"{t.metric}: {t.value} (limit {t.limit}): {t.outcome.value}. {t.explanation}" for t in result.tolerances]
    assert judged, "no tolerance was judged"
    assert result.within_tolerance, "\n".join([result.engines[0].status_sentence, *judged])


@functools.cache
def quick_scenario(name: str):
    """A shipped scenario and its reference, which all engines are held against."""
    scenario = expand_tolerances(loader.load(name), Profile.QUICK)
    return scenario, Reference(scenario)


def judged_in_this_process(name: str, engine):
    """What `compare_engines` gives, without a process for the run: what those take care of has tests of its own."""
    scenario, reference = quick_scenario(name)
    return compare(scenario, reference, [engine.simulate(scenario)])


@pytest.mark.parametrize(("name", "engine"), cases(Profile.QUICK))
def test_quick_profile(name, engine):
    keeps_its_tolerances(judged_in_this_process(name, installed(engine, Profile.QUICK)))


@pytest.mark.long
def test_a_run_in_this_process_is_judged_as_compare_engines_does():
    engine = installed("mujoco:capstan", Profile.QUICK)
    there = compare_engines(loader.load("ten_to_one"), engines=["mujoco:capstan"], profile=Profile.QUICK)
    here = judged_in_this_process("ten_to_one", engine)
    assert here.tolerances == there.tolerances
    assert len(there.tolerances) > 3


@pytest.mark.accurate
@pytest.mark.parametrize(("name", "engine"), cases(Profile.ACCURATE))
def test_accurate_profile(name, engine):
    chosen = installed(engine, Profile.ACCURATE)
    keeps_its_tolerances(compare_engines(loader.load(name), engines=[label(chosen)], profile=Profile.ACCURATE, time_limit=1800))


def test_every_engine_has_a_quick_tolerance_in_every_scenario_that_it_can_run():
    from looping_pendulum.engines.registry import main_engines

    for name in loader.shipped():
        scenario = loader.load(name)
        judged = {t.engine for t in scenario.tolerances if t.profile == "quick"}
        able = {label(e) for e in main_engines(Profile.QUICK) if scenario.parameters.release in e.abilities.releases}
        assert able <= judged, f"{name}: no quick tolerance for {sorted(able - judged)}"
