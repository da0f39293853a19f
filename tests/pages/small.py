"""A cheap comparison that pages are made of: the reference, two engines, one that breaks off and one that is missing."""

import dataclasses
from functools import cache

import numpy as np

from looping_pendulum.compare import ComparisonResult, compare
from looping_pendulum.compare.comparison import with_trial
from looping_pendulum.compare.run_cache import run_key
from looping_pendulum.compare.trial import MeasuredTrack, MeasuredTrial
from looping_pendulum.engines.isolation import run_isolated
from looping_pendulum.engines.protocol import Engine, Profile
from looping_pendulum.engines.reference import Reference
from looping_pendulum.engines.registry import select
from looping_pendulum.runs.trajectory import Trajectory
from looping_pendulum.scenarios import load
from looping_pendulum.scenarios.scenario import Scenario
from tests.engines.faulty import FaultyEngine

HOSTILE = "\"'><img src=x onerror=alert(1)></script><script>alert(1)</script><!-- & `"
"""What a page must show as it is."""

THICKNESS = 2e-3
"""Of a string, in a scenario that the live page's model cannot follow [m]."""

LABELS = ("mujoco:documented", "mujoco:capstan", "faulty:stretches", "faulty:absent")


def engines() -> list[Engine]:
    return [
        *select(["mujoco:documented", "mujoco:capstan"], Profile.QUICK),
        FaultyEngine("stretches"),
        FaultyEngine("absent", packages=("no_such_package",)),
    ]


@cache
def runs() -> tuple[Trajectory, ...]:
    scenario = load("two_to_one")
    *present, absent = engines()
    return (*(engine.simulate(scenario) for engine in present), run_isolated(absent, scenario))


def compared(scenario: Scenario) -> ComparisonResult:
    result = compare(scenario, Reference(scenario), runs())
    return dataclasses.replace(result, run_keys=tuple(run_key(engine, scenario) for engine in engines()))


@cache
def small_result() -> ComparisonResult:
    """Stops, a stick, a slip and a halt; an engine that never halts."""
    return compared(load("two_to_one"))


def with_points(result: ComparisonResult, name: str = "mine", offset: float = 0.02) -> ComparisonResult:
    """The result beside points of the reference's own masses every 4 ms, the light one ``offset`` [m] too far right."""
    assert result.samples is not None
    run, every = result.samples.reference, slice(None, 1000, 4)
    tracks = tuple(
        MeasuredTrack(
            name=f"{mass} mass",
            channels=(f"{mass}_x", f"{mass}_y"),
            unit="m",
            t=tuple(run.t[every].tolist()),
            values=(tuple((places[every, 0] + shift).tolist()), tuple(places[every, 1].tolist())),
            level_unknown=mass == "heavy",
        )
        for mass, places, shift in (("light", run.light_position, offset), ("heavy", run.heavy_position, 0.0))
    )
    return with_trial(result, MeasuredTrial(name=name, source=f"{name}.csv", tracks=tracks, notes=(name,)))


def twin_result(scenario: Scenario) -> ComparisonResult:
    """A comparison whose engine is the reference in other clothes."""
    reference = Reference(scenario)
    run = reference(np.arange(round(scenario.duration * 1000) + 1) / 1000)
    return compare(scenario, reference, [dataclasses.replace(run, engine="twin", profile="quick")])


@cache
def thick_result() -> ComparisonResult:
    """A scenario with an effect that the live page's model lacks."""
    parameters = load("two_to_one").parameters.replace(string_thickness=THICKNESS)
    return twin_result(dataclasses.replace(load("two_to_one"), name="thick", title="Thick", parameters=parameters))


@cache
def hostile_result() -> ComparisonResult:
    """The same with hostile text wherever a scenario or an engine has a say."""
    scenario = dataclasses.replace(load("two_to_one"), name=HOSTILE, title=HOSTILE, description=HOSTILE)
    result = compared(scenario)
    assert result.samples is not None
    first, *others = result.engines
    aligned = result.samples.aligned[0]
    result = with_points(result, HOSTILE)
    renamed = dataclasses.replace(aligned, run=dataclasses.replace(aligned.run, variant=HOSTILE))
    return dataclasses.replace(
        result,
        engines=(dataclasses.replace(first, variant=HOSTILE, message=HOSTILE), *others),
        samples=dataclasses.replace(result.samples, aligned=(renamed, *result.samples.aligned[1:])),
    )
