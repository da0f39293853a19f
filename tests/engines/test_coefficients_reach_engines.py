"""Every coefficient of the paper's model acts in every variant as in the reference, or the variant declares that it does not.

Forces are examined by `engines.conformance`; here are gravity and the two friction coefficients, which each engine
supplies in a way of its own.
"""

import math

import numpy as np
import pytest

from looping_pendulum.engines.conformance import EFFECT_CASES
from looping_pendulum.engines.protocol import STATIC_FRICTION, Profile
from looping_pendulum.engines.registry import all_engines, label, missing_packages
from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.effects import EFFECTS
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.reference_ode.solve import solve_at
from looping_pendulum.scenarios.scenario import Scenario
from tests.apparatus import TEN_TO_ONE

CHEAP = frozenset({"mujoco:frictionloss", "mujoco:effective_mass", "mujoco:drum"})
"""Variants that are examined daily though they are not main ones."""
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
    "pymunk:defaults": "its string stretches by more than any coefficient moves the masses",
    "pybullet:defaults": "joint motors, on by default, hold every hinge: the string does not run over the rod",
}
"""Variants that show what an engine's defaults do -> why no coefficient acts in them as it should; strict expected failures."""

LACK = {"gravity": "gravity", "kinetic_friction": "friction_law", STATIC_FRICTION: STATIC_FRICTION}


HOLDS_ANYWAY = frozenset({("pybullet:defaults", STATIC_FRICTION), ("pymunk:defaults", STATIC_FRICTION)})
"""Cases that such a variant passes for a reason of its own: it lacks what it declares to lack."""


def variants():
    for engine in all_engines(Profile.QUICK):
        if engine.name != "reference":
            daily = engine.abilities.main or label(engine) in CHEAP
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
    run = solve_at(parameters, np.array([0.0, DURATION]), duration=DURATION + 0.01, tolerance=1e-9, integrator="scipy")
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
    assert base == set(CASES) | {name for case in EFFECT_CASES.values() for name in case.coefficients} & base


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
