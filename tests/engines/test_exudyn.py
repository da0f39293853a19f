"""Exudyn's cable against closed forms, invariants and the reference. Exudyn is optional."""

import importlib.util
import math

import numpy as np
import pytest

from looping_pendulum.engines.exudyn import (
    SETTINGS,
    ExudynCable,
    _coordinates_at_release,
    _node_arcs,
    _velocities_at_release,
)
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.static_capstan import measure_capstan_exponent
from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.cartesian import masses_at_release
from looping_pendulum.reference_ode.closed_forms import atwood_acceleration
from looping_pendulum.reference_ode.solve import solve, solve_at
from tests.apparatus import NO_DRAG, TEN_TO_ONE, distances, fitted_acceleration, simulated

HERE = importlib.util.find_spec("exudyn") is not None
needs_exudyn = pytest.mark.skipif(not HERE, reason="exudyn is not installed")

SHORT = TEN_TO_ONE.replace(release="vertical", free_length=0.05, **NO_DRAG)
"""So little string that a run of the cable takes a second."""
QUARTER = TEN_TO_ONE.replace(free_length=TEN_TO_ONE.free_length / 4)
"""The trial on a quarter of its string: it halts at 0.18 s."""


def test_a_step_that_does_not_divide_a_sample_is_refused():
    with pytest.raises(EngineError, match="time_step: found 0.0003 s, which does not divide the sample interval"):
        ExudynCable().with_settings(time_step=3e-4)


@pytest.mark.parametrize("push", [{"push_along": 0.3}, {"push_across": 0.3}])
def test_a_push_at_release_moves_the_string_without_stretching_it(push):
    # Oracle: the constraint. A string of unit slopes s keeps its length where the slopes' rates have no part along them, and
    # along each straight part the slope is constant, so that neighbours' velocities differ by its rate times their distance.
    p = TEN_TO_ONE.replace(**push)
    arcs = _node_arcs(p, 0.64)
    slopes, rates = _coordinates_at_release(p, arcs)[:, 2:], _velocities_at_release(p, masses_at_release(p), arcs)
    np.testing.assert_allclose(np.linalg.norm(slopes, axis=1), 1.0, rtol=1e-12)
    np.testing.assert_allclose(np.sum(slopes * rates[:, 2:], axis=1), 0.0, atol=1e-12)
    free = arcs <= p.free_length + 1e-12
    np.testing.assert_allclose(
        np.diff(rates[free, :2], axis=0), np.diff(arcs[free])[:, None] * rates[free][:-1, 2:], atol=1e-12
    )
    assert np.abs(rates).max() > 0.1


@needs_exudyn
@pytest.mark.parametrize(("share", "holds"), [(0.95, True), (1.05, False)])
def test_static_capstan(share, holds):
    # Oracle: the capstan ratio e^{mu pi}. 5 % less is held: the segments' springs give way by mu N / k = 20 um, and the string
    # stretches by as much per newton. 5 % more slides, with at least half of the exact acceleration.
    p = SHORT.replace(heavy_mass=share * SHORT.light_mass * math.exp(0.34 * math.pi))
    drop = simulated(ExudynCable(), p, 0.05).heavy_drop
    assert (abs(drop[-1] - drop[25]) < 1e-5) if holds else (drop[-1] > 0.5 * 0.5 * atwood_acceleration(p) * 0.05**2)


@needs_exudyn
def test_without_a_penalty_there_is_no_friction():
    # Oracle: Atwood's machine without friction, which a friction coefficient of 0.34 leaves as it is with Exudyn's defaults.
    # Bound: 1 % of the acceleration, of which the string's stretch of some 10 um in 2 mm makes half.
    fallen = simulated(ExudynCable(), SHORT, 0.02, friction_stiffness=0.0)
    assert fitted_acceleration(fallen) == pytest.approx(atwood_acceleration(SHORT.replace(kinetic_friction=0.0)), rel=1e-2)


@pytest.mark.long
@needs_exudyn
def test_the_cable_follows_the_reference_while_it_begins_to_slide():
    # Oracle: the reference. Bound: a quarter of 0.6 mm, that of other chains over the whole string.
    begun = simulated(ExudynCable(), QUARTER, 0.04)
    assert distances(begun, QUARTER).max() < 0.15e-3
    assert np.nanmax(np.abs(begun.string_stretch)) < 0.1e-3


@needs_exudyn
@pytest.mark.accurate
def test_the_cable_follows_the_reference_to_the_halt():
    # Oracle: the reference. Bounds: about twice what was measured, 0.17 mm to the halt's time less a tenth, 0.5 mm in the drop,
    # by which the string is longer that holds the light mass's pull, and 2 ms, two samples, in the halt.
    halt = solve(QUARTER).halting_time
    halted = simulated(ExudynCable(), QUARTER, round(halt + 0.025, 3))
    until = halted.t <= 0.91 * halt
    assert math.sqrt(np.mean(distances(halted, QUARTER)[until] ** 2)) < 0.35e-3
    exact = solve_at(QUARTER, halted.t[-1:], duration=halted.t[-1] + 0.01)
    assert halted.heavy_drop[-1] == pytest.approx(-QUARTER.hanging_length - exact.heavy_position[-1, 1], abs=1e-3)
    speed = halted.heavy_velocity[:, 1]
    assert halted.t[np.flatnonzero((speed > -1e-3) & (halted.t > 0.05))[0]] == pytest.approx(halt, abs=2e-3)


@needs_exudyn
@pytest.mark.accurate
def test_contacts_that_are_not_iterated_to_the_end_brake_too_much():
    # Oracle: the exact drop. With Exudyn's default tolerance of 1 N a segment that comes into contact may hold with any force
    # below that for a step; with the adapter's it lags by less than a tenth.
    careless = simulated(ExudynCable(), QUARTER, 0.12, contact_tolerance=1.0, contact_iterations=5)
    exact = solve_at(QUARTER, careless.t[-1:], duration=0.13)
    assert careless.heavy_drop[-1] - (-QUARTER.hanging_length - exact.heavy_position[-1, 1]) < -0.5e-3


@needs_exudyn
@pytest.mark.accurate
@pytest.mark.xfail(
    raises=AssertionError,
    strict=True,
    reason="measured 2.7 % too little at 90 and 1.8 % at 180 degrees; elements half as long bring a third of it back",
)
@pytest.mark.parametrize("degrees", [90, 180])
def test_tension_ratio_obeys_the_capstan_law_to_a_percent(degrees):
    # Oracle: exp(mu theta), measured through the protocol alone. Bound: 1 %, of which 0.1 % is the measurement's own.
    assert abs(measure_capstan_exponent(ExudynCable(), wrap_angle=math.radians(degrees), duration=0.1).error) < 0.01


@needs_exudyn
@pytest.mark.accurate
def test_tension_ratio_obeys_the_capstan_law_nearly():
    # Oracle: exp(mu theta). Bound: 3 %, of which 1.8 % were measured, with elements of 0.64 rad; without friction it is 100 %.
    assert abs(measure_capstan_exponent(ExudynCable(), duration=0.1).error) < 0.03


def test_profiles_refine():
    quick, accurate = SETTINGS[Profile.QUICK], SETTINGS[Profile.ACCURATE]
    assert accurate.time_step < quick.time_step
    assert accurate.bend < quick.bend
