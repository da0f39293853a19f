"""The string's pull from the motion, against closed forms and against the reference's own tensions."""

import dataclasses
import math

import numpy as np
import pytest

from looping_pendulum.engines.protocol import SAMPLE_INTERVAL, Profile
from looping_pendulum.engines.reference import Reference
from looping_pendulum.engines.registry import select
from looping_pendulum.engines.tension import AVERAGING_TIME, tension_from_motion
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios import load

HALF = 0.5 * AVERAGING_TIME + SAMPLE_INTERVAL


def shortened(name, duration, **coefficients):
    scenario = load(name)
    p = scenario.parameters
    return dataclasses.replace(
        scenario,
        duration=duration,
        parameters=dataclasses.replace(p, coefficients=p.coefficients | coefficients),
    )


def simulated(engine, scenario):
    (chosen,) = select([engine], Profile.QUICK)
    return chosen.simulate(scenario).raise_if_failed()


@pytest.mark.parametrize("name", ["ten_to_one", "two_to_one"])
def test_the_references_own_motion_gives_its_tensions_but_where_they_jump(name):
    """Oracle: the reference's exact tensions; wind and drags act, too."""
    scenario = shortened(name, 0.6, wind_speed=0.5, light_linear_drag=0.002)
    t = np.arange(601) * SAMPLE_INTERVAL
    reference = Reference(scenario)(t)
    events = np.array([0.0, *(event.time for event in reference.events), t[-1]])
    smooth = np.min(np.abs(t[:, None] - events), axis=1) > HALF
    assert np.sum(smooth) > 400
    pulls = tension_from_motion(reference, scenario.parameters)
    for pull, exact in zip(pulls, (reference.light_tension, reference.heavy_tension), strict=True):
        assert np.max(np.abs(pull - exact)[smooth] / np.max(exact)) < 2e-3


def test_an_engines_own_friction_holds_the_capstan_ratio():
    """Oracle: exp(mu pi) over half a turn, from a chain that is fed no law."""
    scenario = shortened("atwood", 0.2)
    run = simulated("pymunk:chain", scenario)
    light, heavy = (np.mean(pull[50:-50]) for pull in tension_from_motion(run, scenario.parameters))
    assert heavy / light == pytest.approx(math.exp(0.34 * math.pi), rel=0.01)


def test_a_rod_without_friction_has_one_tension():
    """Oracle: Newton's second law of a massless string."""
    scenario = shortened("frictionless", 0.3)
    run = simulated("mujoco:capstan", scenario)
    light, heavy = tension_from_motion(run, scenario.parameters)
    assert np.max(np.abs(light - heavy)[20:-20]) < 0.005 * np.max(heavy)


def test_what_the_motion_cannot_tell_is_none():
    held = load("held")
    assert held.parameters.release is Release.HELD
    run = Reference(held)(np.arange(301) * SAMPLE_INTERVAL)
    light, heavy = tension_from_motion(run, held.parameters)
    assert light is not None
    assert heavy is None
    drop = load("drop")
    assert tension_from_motion(Reference(drop)(np.arange(301) * SAMPLE_INTERVAL), drop.parameters) == (None, None)
    assert tension_from_motion(Reference(held)(np.zeros(1)), held.parameters) == (None, None)
