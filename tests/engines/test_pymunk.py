"""The pymunk adapter against closed forms, invariants and the reference."""

import functools
import math
from dataclasses import replace

import numpy as np
import pytest

from looping_pendulum.compare.comparison import compare
from looping_pendulum.compare.metrics import RMS_END_TIMES
from looping_pendulum.engines import pymunk as adapter
from looping_pendulum.engines.chain import polygon_radius
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.pymunk import SETTINGS, PymunkChain, engines, velocity_on_string
from looping_pendulum.engines.reference import Reference
from looping_pendulum.engines.static_capstan import chain_capstan_exponent, measure_capstan_exponent
from looping_pendulum.reference_ode.cartesian import masses_at_release
from looping_pendulum.reference_ode.closed_forms import atwood_acceleration
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.reference_ode.solve import solve, solve_at
from looping_pendulum.runs.trajectory import RunStatus
from looping_pendulum.scenarios import loader
from tests.apparatus import NO_DRAG, TEN_TO_ONE, fitted_acceleration, simulated

pytest.importorskip("pymunk")

QUICK = SETTINGS[Profile.QUICK]


@functools.cache
def trial():
    """Return the shipped trial; not loaded where this file is only collected."""
    return loader.load("ten_to_one")


def run(parameters, duration, *, settings=QUICK):
    return simulated(PymunkChain(settings=settings), parameters, duration)


@pytest.fixture(scope="module")
def ten_to_one():
    """Return one run of the shipped trial past its halt at 0.38 s, shared by several tests."""
    return run(trial().parameters, 0.45)


@functools.cache
def first_fifth(settings):
    """Return the first 0.2 s of the same release with other settings."""
    return run(trial().parameters, 0.2, settings=settings)


def test_profiles_have_their_own_settings():
    for profile in Profile:
        assert [(one.variant, one.profile) for one in engines(profile)] == [("chain", profile)]
    assert SETTINGS[Profile.ACCURATE].time_step < SETTINGS[Profile.QUICK].time_step


def test_polygon_winds_up_as_much_string_as_the_circle():
    # Oracle: a closed polygon of n links that wind up R b each has the circle's circumference.
    for n in (8, 20, 40):
        bend = 2 * math.pi / n
        chord = 2 * polygon_radius(0.01, bend) * math.sin(bend / 2)
        assert n * chord == pytest.approx(2 * math.pi * 0.01, rel=1e-12)


@pytest.mark.parametrize("degrees", [225, *(pytest.param(d, marks=pytest.mark.accurate) for d in (135, 180))])
def test_static_capstan(degrees):
    # Oracle: mu theta. Bound: 0.4 % of the exponent; uncorrected corners would show as 1 %, a rod's radius is not in it.
    assert abs(measure_capstan_exponent(PymunkChain(), wrap_angle=math.radians(degrees)).error) < 4e-3


@pytest.mark.parametrize("bend", [0.48, pytest.param(0.32, marks=pytest.mark.accurate)])
def test_static_capstan_without_the_correction_is_that_of_the_corners(bend):
    # Oracle: 2 N artanh(mu tan(b/2)), which is 2.2 % and 1.0 % above mu theta. Bound: 0.2 %.
    engine = PymunkChain().with_settings(bend=bend, polygon_friction=False)
    assert measure_capstan_exponent(engine).exponent == pytest.approx(chain_capstan_exponent(0.34, math.pi, bend), rel=2e-3)


@pytest.mark.accurate  # daily, the chain that leaks every few steps follows the reference to the same bound
def test_leaking_at_every_step_changes_nothing_that_shows(ten_to_one):
    # Oracle: the same engine, told at every step. Bound: a tenth of the project's 0.6 mm for the light mass.
    assert QUICK.leak_interval > 1
    every = first_fifth(replace(QUICK, leak_interval=1))
    together = ten_to_one.light_position[: len(every.t)]
    assert np.linalg.norm(together - every.light_position, axis=1).max() < 0.06e-3


def test_a_leak_interval_that_does_not_divide_the_groups_is_refused():
    with pytest.raises(ValueError, match="leak_interval: found 4"):
        replace(QUICK, leak_interval=4)


@pytest.mark.parametrize("profile", Profile)
def test_studies_change_one_thing_at_a_time(profile):
    engine = PymunkChain(profile=profile)
    for ladder in engine.studies().ladders:
        rungs = [engine.with_settings(**changes) for changes in ladder.changes]
        assert rungs[0].settings == engine.settings  # no rung is coarser than what is used
        for value, rung in zip(ladder.values, rungs, strict=True):
            follows = {"time_step": rung.settings.time_step} if ladder.follows else {}
            assert rung.settings == replace(engine.settings, **{ladder.setting: value} | follows)
            if ladder.follows:  # a joint's stiffness, iterations * bead_mass / time_step^2, stays
                assert value / rung.settings.time_step**2 == pytest.approx(ladder.values[0] / engine.settings.time_step**2)
    for entry in (*engine.studies().defaults, *engine.studies().choices):
        assert engine.with_settings(**entry.changes).settings != engine.settings


@pytest.mark.long
def test_string_keeps_its_length(ten_to_one):
    # Oracle: the constraint. A chain of n links acts as a spring iterations * bead_mass / (n dt^2), held at its length against
    # the leak by the error correction: stretch = leak / error_rate * T / K. n = 2 * 3 free links and the wound ones, up to
    # wrap / b. The light mass pulls hardest, M1 v^2 / l. Factor 3: a bead that joins starts without a warm-start impulse.
    p = trial().parameters
    wrap = np.nanmax(ten_to_one.wrap_angle)
    links = 6 + wrap / QUICK.bend
    stiffness = QUICK.iterations * QUICK.bead_mass_ratio * p.light_mass / (links * QUICK.time_step**2)
    ratio = math.exp(p.coefficients["kinetic_friction"] * wrap)
    tension = max(p.light_mass * np.sum(ten_to_one.light_velocity**2, axis=1) / ten_to_one.free_length)
    bound = 3 * QUICK.impulse_leak / QUICK.error_rate * tension * ratio / stiffness
    assert bound < 2e-3  # or the test would say nothing
    assert np.abs(ten_to_one.string_stretch).max() < bound


def test_light_mass_stays_on_the_taut_string(ten_to_one):
    # Oracle: l + R theta + h = L, from the masses' positions alone: what the chain says of itself does not enter. Bound: the
    # stretch it admits, and the offset of a straight string that leaves the polygon at R cos(b/2) to R, not at R: R b^2 / 8.
    p = trial().parameters
    path = ten_to_one.free_length + p.rod_radius * ten_to_one.wrap_angle - ten_to_one.heavy_position[:, 1]
    bound = np.abs(ten_to_one.string_stretch) + p.rod_radius * QUICK.bend**2 / 8
    assert np.all(np.abs(path - p.string_length) <= bound + 1e-4)  # 1e-4: contact slop and bounce of a few slops


def test_ten_to_one_follows_the_reference_to_the_halt(ten_to_one):
    # Oracle: the reference. Bounds: the project's for this engine's accurate profile; the quick one keeps them too.
    until = ten_to_one.t <= 0.35 + 1e-9
    exact = solve_at(trial().parameters, ten_to_one.t, duration=0.6)
    distance = np.linalg.norm(ten_to_one.light_position - exact.light_position, axis=1)
    assert math.sqrt(np.mean(distance[until] ** 2)) < 0.6e-3
    assert ten_to_one.heavy_drop[-1] == pytest.approx(-exact.heavy_position[-1, 1] + exact.heavy_position[0, 1], abs=1e-3)
    moving = np.flatnonzero(np.abs(ten_to_one.heavy_velocity[:, 1]) > 0.02)[-1]
    assert ten_to_one.t[moving] == pytest.approx(solve(trial().parameters).halting_time, abs=8e-3)


def test_ten_to_one_keeps_the_tolerances_that_can_be_judged_soon_after_the_halt(ten_to_one):
    # The shipped limits, judged as tests/test_tolerances.py judges them; there the whole trial is run with the accurate ones.
    soon = [
        t
        for t in trial().tolerances
        if (t.engine, t.profile) == ("pymunk:chain", "quick") and RMS_END_TIMES.get(t.metric, 0.0) <= ten_to_one.t[-1]
    ]
    assert {t.metric for t in soon} == {"rms_0.35s", "drop_error", "halting_time_error"}
    scenario = replace(trial(), tolerances=tuple(soon), duration=0.45)
    judged = compare(scenario, Reference(scenario), [ten_to_one])
    assert len(judged.tolerances) == len(soon)
    assert judged.within_tolerance, judged.tolerances


def test_halted_string_sticks(ten_to_one):
    # Oracle: sticking is rest. Bound: the dead band in which a heavy mass counts as at rest, from 10 ms after the halt; and no
    # creep of more than 1 mm/s, a hundredth of the speed that gravity would give it in that time.
    rest = ten_to_one.t > 0.40
    assert np.abs(ten_to_one.heavy_velocity[rest, 1]).max() < 0.02
    creep = np.polyfit(ten_to_one.t[rest], ten_to_one.heavy_drop[rest], 1)[0]
    assert abs(creep) < 1e-3


def test_drop_with_drag_follows_the_reference():
    # Oracle: the reference, whose fall is the closed form. Bound: half a step late, g t dt / 2, and half a group of steps early
    # for the drag that is given at its start.
    p = TEN_TO_ONE.replace(release=Release.DROP, light_drag=0.05)
    fallen = run(p, 0.3)
    exact = solve_at(p, fallen.t)
    bound = 9.81 * fallen.t * QUICK.time_step * (1 + QUICK.steps_per_group) / 2 + 1e-9
    assert np.all(np.linalg.norm(fallen.light_position - exact.light_position, axis=1) <= bound)


@pytest.mark.accurate  # daily it follows the reference, which keeps it
def test_held_pendulum_keeps_its_energy():
    # Oracle: the clamped string does no work. Bound: a symplectic Euler energy is off by dt v . g / 2, and every bead that
    # lands on the rod loses what it had, its speed the light mass's times its share of the free length, FAR_LINKS at most.
    p = TEN_TO_ONE.replace(release=Release.HELD, **NO_DRAG)
    held = run(p, 0.8)
    kinetic = 0.5 * np.sum(held.light_velocity**2, axis=1)
    energy = kinetic + 9.81 * (held.light_position[:, 1] - held.light_position[0, 1])
    stepping = 0.5 * QUICK.time_step * 9.81 * math.sqrt(2 * kinetic.max())
    share = adapter.REMOVE_BEYOND_LINKS * QUICK.bend * p.rod_radius / held.free_length.min()
    landing = 2 * np.ptp(held.wrap_angle) / QUICK.bend * QUICK.bead_mass_ratio * share**2 * kinetic.max()  # 2: there and back
    assert np.abs(energy).max() < stepping + landing
    assert np.ptp(held.heavy_position, axis=0).max() == 0.0


@pytest.mark.accurate  # daily, test_tolerances.py winds the string of a fat rod
@pytest.mark.parametrize(("rod_radius", "free_length"), [(0.00625, 0.2), (0.0125, 0.58)])
def test_winding_many_turns_ends_at_the_rod(rod_radius, free_length):
    # Oracle: the reference's end, after two turns. Bound: a sample, and the time in which the light mass winds up two links at
    # the end; beads are no longer added when the straight string is shorter than that. On the way the trial's limit on the
    # light mass's deviation up to 1 s, where its string is as nearly wound up, as much smaller as this string is shorter.
    p = TEN_TO_ONE.replace(rod_radius=rod_radius, free_length=free_length)
    exact = solve(p)
    wound = run(p, 0.8)
    assert wound.status is RunStatus.LIGHT_REACHED_ROD
    assert wound.wrap_angle[-1] > 4 * math.pi
    last_links = 2 * QUICK.bend * p.rod_radius
    bound = 1e-3 + last_links * wound.free_length[-1] / (p.rod_radius * np.linalg.norm(wound.light_velocity[-1]))
    assert wound.t[-1] == pytest.approx(exact.end_time, abs=bound)
    on_the_way = wound.t < exact.end_time - bound
    place = solve_at(p, wound.t[on_the_way], duration=1.0).light_position
    distance = np.linalg.norm(wound.light_position[on_the_way] - place, axis=1)
    (limit,) = (t.limit for t in trial().tolerances if (t.engine, t.profile, t.metric) == ("pymunk:chain", "quick", "rms_1.0s"))
    assert math.sqrt(np.mean(distance**2)) < limit * free_length / trial().parameters.free_length


def test_without_the_private_call_it_still_runs_and_says_so(monkeypatch):
    monkeypatch.setattr(adapter, "private_library", lambda: None)
    p = TEN_TO_ONE.replace(release=Release.VERTICAL, free_length=0.4, **NO_DRAG)
    public = run(p, 0.1)
    assert public.provenance.settings["leaky_warm_start"] is False
    # Oracle: the Atwood machine again. Bound: 1 %, the conformance suite's; an undamped chain is softer and rings.
    assert fitted_acceleration(public) == pytest.approx(atwood_acceleration(p), rel=1e-2)


def test_with_the_private_call_provenance_says_so(ten_to_one):
    assert ten_to_one.provenance.settings["leaky_warm_start"] is True
    assert ten_to_one.provenance.settings["bend"] == QUICK.bend


@pytest.mark.accurate  # daily, the trial, whose steps are grouped, follows the reference
def test_groups_of_steps_change_nothing_that_shows():
    # Oracle: the same engine with the drag given every step. Bound: a tenth of the project's 0.6 mm for the light mass.
    grouped, every = (first_fifth(replace(QUICK, steps_per_group=n, leak_interval=1)) for n in (50, 1))
    assert np.linalg.norm(grouped.light_position - every.light_position, axis=1).max() < 0.06e-3


@pytest.mark.parametrize("push", [{"push_along": 0.3}, {"push_across": 0.5}])
def test_velocity_along_the_string_is_consistent_with_its_length(push):
    # Oracle: an unstretched string: material velocities along it are everywhere the heavy mass's speed. Bound: rounding.
    p = TEN_TO_ONE.replace(**push)
    masses = masses_at_release(p)
    heavy_vy = masses.heavy_velocity[1]
    for arc in np.linspace(0, p.string_length, 30):
        vx, vy = velocity_on_string(p, masses, float(arc))
        wound = min(max(arc - p.free_length, 0.0), p.rod_radius * p.release_angle)
        angle = p.release_angle - wound / p.rod_radius
        assert -vx * math.sin(angle) + vy * math.cos(angle) == pytest.approx(heavy_vy, abs=1e-12)


def test_halfway_along_the_free_string_moves_half_as_fast_across():
    # Oracle: a straight string about its tangent point at rest.
    p = TEN_TO_ONE.replace(push_across=0.5)
    masses = masses_at_release(p)
    half = velocity_on_string(p, masses, p.free_length / 2)
    assert half == pytest.approx(tuple(v / 2 for v in masses.light_velocity), rel=1e-12)
