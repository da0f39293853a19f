"""The string's pull from the motion, against closed forms and the reference's own tensions, and the static capstan test."""

import dataclasses
import math
from dataclasses import replace

import numpy as np
import pytest

from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.reference import Reference
from looping_pendulum.engines.registry import select
from looping_pendulum.engines.static_capstan import chain_capstan_exponent, measure_capstan_exponent
from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.runs.tension import AVERAGING_TIME, tension_from_motion
from looping_pendulum.runs.trajectory import SAMPLE_INTERVAL
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


@pytest.mark.long
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


# ---- the static capstan test: the reference, whose law is exact, must show that law, whatever the trial's numbers are


@pytest.fixture(scope="module")
def reference_engine():
    (engine,) = select(["reference"], Profile.QUICK)
    return engine


@pytest.mark.parametrize("degrees", [90, 135, 225, 270])
def test_the_reference_shows_the_capstan_law_at_any_angle(reference_engine, degrees):
    # Oracle: mu theta. Bound: half the square of mu times the angle's spread, which is at most half of its range.
    point = measure_capstan_exponent(reference_engine, wrap_angle=math.radians(degrees))
    spread = abs(point.wrap_angle - math.radians(degrees))
    assert abs(point.exponent - point.ideal) < 0.5 * (0.34 * spread) ** 2 + 1e-6


@pytest.mark.parametrize(("friction", "overload", "duration"), [(0.34, 2.0, 0.15), (0.1, 1.1, 0.05), (0.6, 3.0, 0.1)])
def test_over_half_a_turn_it_is_exact(reference_engine, friction, overload, duration):
    # Oracle: the Atwood machine, whose wrap angle does not change. Bound: the reference's own tolerance.
    point = measure_capstan_exponent(reference_engine, friction=friction, overload=overload, duration=duration)
    assert point.wrap_angle == pytest.approx(math.pi, abs=1e-9)
    assert point.exponent == pytest.approx(friction * math.pi, abs=1e-8)
    assert point.error == pytest.approx(0.0, abs=1e-7)


def test_a_wrap_angle_that_lets_the_string_go_slack_is_refused(reference_engine):
    with pytest.raises(EngineError, match="found a wrap angle of 45 deg, needed one from 85 to 275 deg"):
        measure_capstan_exponent(reference_engine, wrap_angle=math.radians(45))


def test_a_string_that_does_not_slide_is_no_measurement(reference_engine):
    # Rounding once left a drop of 9e-15 m on one processor, and 0 or less on others: `slid > 0` took that for a slide.
    with pytest.raises(EngineError, match="did not slide .* needed a slide of 1.1 mm; raise overload above 0.9"):
        measure_capstan_exponent(reference_engine, overload=0.9)


class Creeping:
    """The reference with a heavy mass that sinks linearly, as a stuck string creeps by rounding or soft contacts."""

    def __init__(self, reference_engine, drop):
        self.reference_engine, self.drop = reference_engine, drop

    def simulate(self, scenario):
        run = self.reference_engine.simulate(scenario)
        place, speed = run.heavy_position.copy(), run.heavy_velocity.copy()
        place[:, 1] -= self.drop * run.t / run.t[-1]
        speed[:, 1] -= self.drop / run.t[-1]
        return replace(run, heavy_position=place, heavy_velocity=speed)


@pytest.mark.parametrize("drop", [-1e-14, 1e-16, 1e-14, 1e-9, 3e-4])
def test_what_rounding_or_creep_moves_a_stuck_string_is_no_slide(reference_engine, drop):
    # 0.3 mm in 0.15 s is what the softest chain of the engines here creeps.
    with pytest.raises(EngineError, match="did not slide"):
        measure_capstan_exponent(Creeping(reference_engine, drop), overload=0.9)


def test_a_string_that_slides_as_little_as_may_be_is_measured(reference_engine):
    # Oracle: the Atwood machine, a / g = (overload - 1) / (overload + 1) = 0.0119, just above `MIN_SLIDE_FRACTION`.
    point = measure_capstan_exponent(reference_engine, overload=1.024)
    assert point.slide_length == pytest.approx(0.0119 * 0.5 * 9.81 * 0.15**2, rel=5e-3)
    assert point.error == pytest.approx(0.0, abs=1e-7)


def test_a_chain_of_many_corners_is_a_string():
    # Oracle: 2 N artanh(mu tan(theta / 2N)) tends to mu theta from above, as the square of the corner.
    excess = [chain_capstan_exponent(0.34, math.pi, bend) / (0.34 * math.pi) - 1 for bend in (0.4, 0.2, 0.1)]
    assert excess[0] / excess[1] == pytest.approx(4, rel=0.05)
    assert excess[1] / excess[2] == pytest.approx(4, rel=0.02)
    assert 0 < excess[2] < 1e-3
