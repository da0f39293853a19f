"""Every coefficient of the paper's model acts in every variant as in the reference, or the variant declares that it does not.

Forces are examined by `engines.conformance`; here are gravity and the two friction coefficients, which each engine
supplies in a way of its own.
"""

import dataclasses
import math

import numpy as np
import pytest

from looping_pendulum.engines.conformance import EFFECT_CASES
from looping_pendulum.engines.protocol import STATIC_FRICTION, Profile
from looping_pendulum.engines.registry import all_engines, label, main_engines, missing_packages
from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.effects import EFFECTS, EffectKind
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.reference_ode.solve import solve_at
from looping_pendulum.runs.trajectory import RunStatus
from looping_pendulum.scenarios.scenario import Scenario
from tests.apparatus import TEN_TO_ONE

CHEAP = "mujoco:frictionloss"
"""A variant that is examined daily though it is not a main one."""
DURATION = 0.042
"""[s]; long enough for each coefficient to move the heavy mass by 2.5 mm, ten times a chain's ripple."""
WITHIN = 0.2
"""Share of a coefficient's displacement by which a variant may miss it; one that ignores it misses all of it."""
HANGING = TEN_TO_ONE.replace(
    release=Release.VERTICAL,
    heavy_mass=4 * TEN_TO_ONE.light_mass,
    free_length=0.3,
    kinetic_friction=0.25,
    static_friction=0.25,
    light_drag=0.0,
    heavy_drag=0.0,
    string_drag=0.0,
)
"""Two masses hang over half the rod's turn, at 4:1: held by a friction above ln 4 / pi = 0.44, sliding below.

The string is half the trial's, as every link costs time; the same stretch is too large a share of one shorter still, and would
end the run of an engine's defaults.
"""
LOSSLESS = {"kinetic_friction": 0.0, "static_friction": 0.0}
CASES = {
    "gravity": (LOSSLESS, LOSSLESS | {"gravity": 20.0}),
    "kinetic_friction": (LOSSLESS, {}),
    STATIC_FRICTION: ({}, {"static_friction": 0.5}),
}
"""Coefficient -> two changes of `HANGING` between which it acts."""
BROKEN = {
    "pybullet:defaults": "joint motors, on by default, hold every hinge: the string does not run over the rod",
}
"""Variants that show what an engine's defaults do -> why no coefficient acts in them as it should; strict expected failures."""

LACK = {"gravity": "gravity", "kinetic_friction": "friction_law", STATIC_FRICTION: STATIC_FRICTION}


HOLDS_ANYWAY = frozenset({("pybullet:defaults", STATIC_FRICTION)})
"""Cases that such a variant passes for a reason of its own: it lacks what it declares to lack."""


def variants():
    for engine in all_engines(Profile.QUICK):
        if engine.name != "reference":
            daily = engine.abilities.main or label(engine) == CHEAP
            for name in CASES:
                marks = [] if daily else [pytest.mark.accurate]
                if label(engine) in BROKEN and (label(engine), name) not in HOLDS_ANYWAY:
                    marks.append(
                        pytest.mark.xfail(reason=BROKEN[label(engine)], strict=True, raises=(AssertionError, EngineError))
                    )
                yield pytest.param(engine, name, id=f"{label(engine)}-{name}", marks=marks)


def dropped(engine, parameters):
    """Return how far the heavy mass has fallen at the end [m]."""
    case = Scenario(name="coefficient", title="", description="", parameters=parameters, duration=DURATION)
    return float(engine.simulate(case).raise_if_failed().heavy_drop[-1])


def reference_dropped(parameters):
    run = solve_at(parameters, np.array([0.0, DURATION]), duration=DURATION + 0.01, tolerance=1e-9)
    return float(run.heavy_position[0, 1] - run.heavy_position[-1, 1])


@pytest.fixture(scope="module")
def drops():
    """Return a cached function: variant and change of `HANGING` -> drop of the heavy mass."""
    drops = {}

    def drop(engine, change):
        key = (label(engine), tuple(sorted(change.items())))
        if key not in drops:
            drops[key] = dropped(engine, HANGING.replace(**change))
        return drops[key]

    return drop


def test_every_coefficient_of_the_papers_model_is_examined_somewhere():
    base = {c.name for effect in EFFECTS.values() if effect.in_base_model for c in effect.coefficients}
    of_effects = {
        name
        for case in EFFECT_CASES.values()
        for name, _ in case.parameters_with.coefficients.items() - case.parameters_without.coefficients.items()
    }
    assert base == set(CASES) | of_effects & base


def test_the_case_is_what_it_says():
    assert math.log(4) / math.pi == pytest.approx(0.4413, abs=1e-4)
    assert abs(reference_dropped(HANGING.replace(static_friction=0.5))) < 1e-12
    sliding, smooth = reference_dropped(HANGING), reference_dropped(HANGING.replace(**LOSSLESS))
    assert min(sliding, smooth - sliding) > 2.5e-3


@pytest.mark.parametrize(("engine", "coefficient"), list(variants()))
def test_a_coefficient_acts_or_is_declared_lacking(engine, coefficient, drops):
    if missing_packages(engine):
        pytest.skip(f"{missing_packages(engine)[0]} is not installed")
    before, after = CASES[coefficient]
    lacks = engine.abilities.lacks(HANGING.replace(**after))
    expected = reference_dropped(HANGING.replace(**after)) - reference_dropped(HANGING.replace(**before))
    actual = drops(engine, after) - drops(engine, before)
    if LACK[coefficient] in lacks:
        # What is declared lacking does lack: the declaration is no excuse for an effect that is half there.
        assert abs(actual) < WITHIN * abs(expected), f"moves by {1e3 * actual:.2f} mm, reference {1e3 * expected:.2f} mm"
    else:
        assert abs(actual - expected) < WITHIN * abs(expected), f"{1e3 * actual:.2f} mm, reference {1e3 * expected:.2f} mm"


def test_an_engine_that_supplies_friction_and_says_no_more_is_taken_to_have_one_coefficient():
    for engine in all_engines(Profile.QUICK):
        two = HANGING.replace(static_friction=0.5)
        assert STATIC_FRICTION not in engine.abilities.lacks(HANGING)
        law = "law of the string on the rod" in {kind.value for kind in engine.abilities.effect_kinds}
        assert (STATIC_FRICTION in engine.abilities.lacks(two)) is not (law or engine.abilities.static_friction)


# ---- forces of time and pushes at release reach every engine; that each effect acts in it is for `engines.conformance`


EFFECT_TIME = 0.06
"""[s]; long enough for every effect below to move a mass by far more than `EFFECT_WITHIN` of what the engine errs by."""
EFFECT_WITHIN = 0.1
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
    return Scenario(name="effect", title="", description="", parameters=parameters, duration=EFFECT_TIME)


def reference(parameters, t):
    return solve_at(parameters, t, duration=EFFECT_TIME + 0.01, tolerance=1e-9)


def places(run, i=-1):
    """Return light mass x and y, heavy mass y, in sample ``i`` [m]."""
    return np.array([*run.light_position[i], run.heavy_position[i, 1]])


@pytest.fixture(scope="module")
def undisturbed():
    """Return a cached function: engine -> its run without any effect for half of `EFFECT_TIME`."""
    runs = {}

    def run(engine, parameters):
        key = (label(engine), parameters.coefficients["light_drag"])
        if key not in runs:
            runs[key] = engine.simulate(dataclasses.replace(scenario(parameters), duration=EFFECT_TIME / 2)).raise_if_failed()
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
    run = engine.simulate(dataclasses.replace(scenario(pushed), duration=EFFECT_TIME / 2)).raise_if_failed()
    plain = undisturbed(engine, WITHOUT)
    last = len(run.t) - 1
    assert plain.t[last] == pytest.approx(run.t[last], abs=1e-12)
    expected = places(reference(pushed, run.t[-1:])) - places(reference(WITHOUT, run.t[-1:]))
    assert np.linalg.norm(expected) > LEAST, "the case is too weak to show anything"
    assert np.linalg.norm(places(run) - places(plain, last) - expected) <= EFFECT_WITHIN * np.linalg.norm(expected)


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


THIN_ROD = 5e-4
"""[m]; no string of beads or links can be laid over it."""


@pytest.mark.parametrize("engine", all_engines(Profile.QUICK), ids=label)
def test_a_rod_that_is_too_thin_is_refused_with_the_smallest_radius(engine):
    smallest = engine.abilities.min_rod_radius
    assert engine.abilities.unsupported(TEN_TO_ONE.replace(rod_radius=smallest or THIN_ROD)) == ""
    assert engine.abilities.unsupported(TEN_TO_ONE.replace(rod_radius=THIN_ROD, release=Release.DROP)) == ""
    if smallest:
        why = f"a rod of 0.5 mm radius, it needs {1e3 * smallest:g} mm or more"
        assert engine.abilities.unsupported(TEN_TO_ONE.replace(rod_radius=THIN_ROD)) == why
        assert f"a rod of less than {1e3 * smallest:g} mm of radius is refused" in engine.abilities.limits


@pytest.mark.parametrize("engine", main_variants(), ids=label)
def test_the_thinnest_rod_that_is_not_refused_is_wound(engine):
    if missing_packages(engine):
        pytest.skip("its package is not installed")
    p = TEN_TO_ONE.replace(rod_radius=engine.abilities.min_rod_radius or THIN_ROD)
    # A chain that slips through the rod of pymunk:chain does so at 0.5 s
    run = engine.simulate(Scenario(name="thin", title="", description="", parameters=p, duration=0.6))
    assert run.status is RunStatus.FINISHED
