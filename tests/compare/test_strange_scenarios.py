"""Scenarios of a stranger, run by engines: every halt that is reported stands, or the report says why none is.

The engine is MuJoCo's tendon with the capstan bound fed in, whose path agrees with the reference to microns in most of them, so
that what the report says of its halt is the comparison's doing, not its own.
"""

from collections import Counter

import pytest

from looping_pendulum.compare import compare
from looping_pendulum.compare.landmarks import SampledReference
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.reference import Reference
from looping_pendulum.engines.registry import missing_packages, select
from looping_pendulum.engines.string_motion import RESOLUTION, halting_time, slip_distance
from looping_pendulum.engines.trajectory import RunStatus, finite_length
from tests.compare.test_like_with_like import random_scenario

CLOSE = 1e-5
"""A run whose heavy mass stays this near to the reference's [m] has the reference's motion, as far as a halt is concerned."""
HALF_A_SAMPLE = 5e-4
"""[s]"""


def halt_outcome(seed: int) -> str:
    """What the report says of an engine's halt on one random scenario, held against how well its path agrees."""
    (engine,) = select(["mujoco:capstan"], Profile.QUICK)
    scenario = random_scenario(seed)
    run = engine.simulate(scenario)
    reference = Reference(scenario)
    result = compare(scenario, reference, [run])
    engine_result, sampled = result.engines[0], result.reference.sampled
    if engine_result.not_comparable:
        assert engine_result.metrics["halting_time_error"] is None
        assert not engine_result.landmarks.halting_confirmed
        return "not comparable"
    aligned = result.samples.aligned[0]
    known = aligned.heavy_deviation[aligned.t <= min(reference.solution.end_time, aligned.t[-1])]
    if not len(known) or abs(known).max() > CLOSE:
        return "path off"
    late = engine_result.metrics["halting_time_error"]
    uncertainties = [moved_by_a_quarter(one) for one in (aligned.run, SampledReference(reference, scenario.parameters).run)]
    if None in (engine_result.landmarks.halting_time, sampled.halting_time):
        # Neither has one, or the motion that decides lies at the resolution or in the last sample before the rod.
        assert engine_result.landmarks.halting_time is sampled.halting_time is None or "at the rod" in edge(
            engine_result, sampled
        ), seed
        return "none"
    if None in uncertainties:
        return "at the resolution"
    assert abs(late) <= HALF_A_SAMPLE + sum(uncertainties), f"seed {seed}: {1e3 * late:.3f} ms, uncertain by {uncertainties}"
    return "right"


def moved_by_a_quarter(run) -> float | None:
    """How far the halting time moves if the resolution is a quarter larger or smaller; None: one of these gives no halt."""
    slip, ended = slip_distance(run, finite_length(run)), run.status is RunStatus.LIGHT_REACHED_ROD
    t = run.t[: len(slip)]
    halt, *others = (halting_time(t, slip, factor * RESOLUTION, ended=ended) for factor in (1, 0.8, 1.25))
    return None if None in others or halt is None else max(abs(time - halt) for time in others)


def edge(engine_result, sampled) -> str:
    """Where one side halts and the other does not: only within the last moments before the light mass reaches the rod."""
    time = engine_result.landmarks.halting_time if sampled.halting_time is None else sampled.halting_time
    ends = (engine_result.end_time, sampled.light_reaches_rod)
    return "at the rod" if None not in ends and min(ends) - time < 0.03 else f"halt at {time}, ends {ends}"


def examine(seeds: range) -> Counter:
    if missing_packages(select(["mujoco:capstan"], Profile.QUICK)[0]):
        pytest.skip("mujoco is not installed")
    return Counter(halt_outcome(seed) for seed in seeds)


def test_halts_of_random_scenarios_are_reported_as_they_are():
    said = examine(range(1000, 1008))
    assert said["right"] >= 2, said


@pytest.mark.accurate
def test_60_halts_of_random_scenarios_are_reported_as_they_are():
    said = examine(range(1000, 1060))
    assert said["right"] >= 20, said
    assert said["not comparable"] >= 3, said
    print(said)
