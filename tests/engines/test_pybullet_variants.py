"""PyBullet's variants for studies: the chain in maximal coordinates, the defaults, and the declared studies of all."""

from __future__ import annotations

import math

import numpy as np
import pytest

from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.pybullet import engines
from looping_pendulum.engines.pybullet.chain import PybulletChain
from looping_pendulum.engines.pybullet.defaults import PybulletDefaults
from looping_pendulum.engines.pybullet.point_to_point import PybulletPointToPoint
from looping_pendulum.reference_ode.solve import solve_at
from looping_pendulum.scenarios.scenario import Scenario
from tests.apparatus import TEN_TO_ONE

pytest.importorskip("pybullet")


def scenario(duration: float, **changes: object) -> Scenario:
    return Scenario(name="test", title="", description="", parameters=TEN_TO_ONE.replace(**changes), duration=duration)


def farthest(engine, case: Scenario) -> float:
    """Largest distance of the light mass from the reference's [m]."""
    run = engine.simulate(case).raise_if_failed()
    exact = solve_at(case.parameters, run.t, duration=case.duration)
    return float(np.linalg.norm(run.light_position[: len(exact.t)] - exact.light_position, axis=1).max())


def test_pinned_bodies_follow_the_reference_as_near_as_their_string_keeps_its_length() -> None:
    case = scenario(0.06, rod_radius=0.03, free_length=0.25)
    coarse = PybulletPointToPoint()
    fine = coarse.with_settings(time_step=coarse.settings.time_step / 2.5)
    stretches = [np.abs(engine.simulate(case).string_stretch).max() for engine in (coarse, fine)]
    assert stretches[1] < 0.5 * stretches[0]  # the pins' give falls with the step, faster than in proportion
    assert farthest(fine, case) < 2 * stretches[1] + 2 * fine.settings.link_length**2 / (8 * 0.03)


@pytest.mark.xfail(strict=True, reason="joint motors, on by default, hold every hinge: the string is a stiff wire")
def test_defaults_follow_the_reference() -> None:
    assert farthest(PybulletDefaults(), scenario(0.15)) < 5e-3


@pytest.mark.parametrize("profile", Profile)
def test_studies_vary_what_they_say(profile: Profile) -> None:
    for engine in engines(profile):
        studies = engine.studies()
        for ladder in studies.ladders:
            for value, rung in zip(ladder.values, ladder.engines, strict=True):
                assert getattr(rung.settings, ladder.setting) == pytest.approx(value)
            assert len(set(ladder.values)) == len(ladder.values)
        for varied in (*studies.defaults, *studies.choices):
            assert varied.engine.settings != engine.settings, varied


def test_every_time_step_of_a_ladder_divides_the_sample_interval() -> None:
    for engine in (PybulletChain(), PybulletPointToPoint()):
        steps = engine.studies().ladders[0].values
        assert all(math.isclose(round(1e-3 / dt) * dt, 1e-3) for dt in steps)
        assert list(steps) == sorted(steps, reverse=True)


def test_friction_that_is_given_together_with_damping_is_ignored() -> None:
    """The trap itself: PyBullet keeps its default of 0.5 for the link."""
    import pybullet

    case = scenario(0.01)
    found = []
    for together in (False, True):
        rig = PybulletChain().with_settings(friction_with_damping=together).build(case)
        found.append(pybullet.getDynamicsInfo(rig._body, 2, physicsClientId=rig._world.client)[1])
    assert found[0] < 0.45
    assert found[1] == 0.5
