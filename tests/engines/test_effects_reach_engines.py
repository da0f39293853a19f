"""Forces of time and pushes at release reach every engine; that each effect acts in it is for `engines.conformance`."""

import dataclasses
import math

import numpy as np
import pytest

from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.registry import all_engines, label, main_engines, missing_packages
from looping_pendulum.reference_ode.effects import EffectKind
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.reference_ode.solve import solve_at
from looping_pendulum.scenarios.scenario import Scenario
from tests.apparatus import TEN_TO_ONE

DURATION = 0.06
"""[s]; long enough for every effect below to move a mass by far more than `WITHIN` of what the engine errs by."""
WITHIN = 0.1
"""Share of an effect's displacement by which an engine may miss it: a wrong sign, axis, mass or factor of 2 misses by half."""
LEAST = 5e-4
"""[m] by which an effect must move a mass, so that there is something to miss."""
PUSHES = {"push_across": {"push_across": 0.5}, "push_along": {"push_along": 0.5}}
"""Effect -> coefficients with which it shows."""
WITHOUT = TEN_TO_ONE.replace(free_length=0.2, kinetic_friction=0.0, light_drag=0.0, heavy_drag=0.0, string_drag=0.0)
"""Without friction, so that engines that have none are examined too; a short string, as every link costs time."""


def main_variants():
    return main_engines(Profile.QUICK)


def scenario(parameters):
    return Scenario(name="effect", title="", description="", parameters=parameters, duration=DURATION)


def reference(parameters, t):
    return solve_at(parameters, t, duration=DURATION + 0.01, tolerance=1e-9, integrator="scipy")


def places(run, i=-1):
    """Return light mass x and y, heavy mass y, in sample ``i`` [m]."""
    return np.array([*run.light_position[i], run.heavy_position[i, 1]])


@pytest.fixture(scope="module")
def undisturbed():
    """Return a cached function: engine -> its run without any effect for half of `DURATION`."""
    runs = {}

    def run(engine, parameters):
        key = (label(engine), parameters.coefficients["light_drag"])
        if key not in runs:
            runs[key] = engine.simulate(dataclasses.replace(scenario(parameters), duration=DURATION / 2)).raise_if_failed()
        return runs[key]

    return run


LATE_PULSE = {
    "closure_of_time": 1.0, "closure_by_constant": 1.0, "closure_scale": 200.0, "closure_start": 0.0, "closure_across_3": 0.5,
}  # fmt: skip
"""A thrust of 0.5 N across the string, 15 ms after release and 5 ms wide: at release there is a ninetieth of it."""


def engines_with_forces_of_time():
    return [e for e in main_variants() if EffectKind.CLOSURE in e.abilities.effect_kinds]


@pytest.mark.parametrize("engine", [pytest.param(e, id=label(e)) for e in engines_with_forces_of_time()])
def test_a_force_that_is_a_function_of_time_acts_at_its_time(engine, undisturbed):
    # Oracle: the difference that the pulse makes in the reference. An engine that asks for the force at time 0 for ever feels a
    # ninetieth of it; one whose clock is off by the pulse's width moves the mass for a third longer or shorter.
    if missing_packages(engine):
        pytest.skip(f"{missing_packages(engine)[0]} is not installed")
    pushed = WITHOUT.replace(**LATE_PULSE)
    run = engine.simulate(dataclasses.replace(scenario(pushed), duration=DURATION / 2)).raise_if_failed()
    plain = undisturbed(engine, WITHOUT)
    last = len(run.t) - 1
    assert plain.t[last] == pytest.approx(run.t[last], abs=1e-12)
    expected = places(reference(pushed, run.t[-1:])) - places(reference(WITHOUT, run.t[-1:]))
    assert np.linalg.norm(expected) > LEAST, "the case is too weak to show anything"
    assert np.linalg.norm(places(run) - places(plain, last) - expected) <= WITHIN * np.linalg.norm(expected)


@pytest.mark.parametrize("effect", ["push_across", "push_along"])
def test_a_push_is_there_from_the_first_sample(effect):
    for engine in main_variants():
        if EffectKind.RELEASE in engine.abilities.effect_kinds and not missing_packages(engine):
            p = WITHOUT.replace(**PUSHES[effect])
            run = engine.simulate(dataclasses.replace(scenario(p), duration=0.002))
            exact = reference(p, np.zeros(1))
            within = 1e-12 + ripple(engine, p) * float(np.linalg.norm(exact.light_velocity[0]))
            np.testing.assert_allclose(run.light_velocity[0], exact.light_velocity[0], rtol=0, atol=within)
            np.testing.assert_allclose(run.heavy_velocity[0], exact.heavy_velocity[0], rtol=0, atol=within)


def ripple(engine, parameters):
    """Return the relative difference in speed of a rigid chain over a polygon's corner and a string over the circle."""
    if label(engine) != "pybullet:chain":  # its links are there from the start, and no exact string speed is possible for them
        return 0.0
    return 1 - math.cos(engine.settings.link_length / (2 * parameters.rod_radius))


def test_pushes_are_refused_where_a_release_does_not_reach_the_engine():
    for engine in all_engines(Profile.QUICK):
        p = WITHOUT.replace(push_across=0.1)
        reaches = EffectKind.RELEASE in engine.abilities.effect_kinds
        assert ("push_across" in engine.abilities.unsupported(p)) is not reaches


def test_an_effect_with_variables_of_its_own_needs_an_engine_with_properties():
    for engine in all_engines(Profile.QUICK):
        p = WITHOUT.replace(heavy_swing=0.1)
        assert ("heavy_swing" in engine.abilities.unsupported(p)) is (EffectKind.PROPERTY not in engine.abilities.effect_kinds)


def test_a_dropped_mass_is_pushed_too():
    for engine in main_variants():
        if EffectKind.RELEASE in engine.abilities.effect_kinds and not missing_packages(engine):
            p = WITHOUT.replace(release=Release.DROP, push_across=0.5)
            run = engine.simulate(scenario(p))
            exact = reference(p, run.t)
            np.testing.assert_allclose(run.light_velocity, exact.light_velocity, rtol=0, atol=9.81e-3)  # a step's worth
