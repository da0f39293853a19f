"""Landmarks of runs that are made of one function of time, where every one of them can be worked out by hand."""

import dataclasses
import math

import numpy as np
import pytest

from looping_pendulum.compare.align import SampledReference, reference_landmarks
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.reference import Reference, ReferenceEngine
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.runs.events import (
    RESOLUTIONS,
    Landmarks,
    arrival_time,
    exact_landmarks,
    extrema,
    run_landmarks,
    slip_distance,
)
from looping_pendulum.runs.trajectory import RunStatus, TrajectoryEvent, finite_length, first_samples
from looping_pendulum.scenarios import load
from tests.compare.conftest import HALT, PARAMETERS, drop

DT = 1e-3


def array(*values):
    return np.array(values, dtype=float)


@pytest.fixture
def sliding(make_run):
    """Run whose heavy mass falls as a function of time says; ``fields`` of the run as given."""

    def make(fall, until=1.05, **fields):
        run = make_run(until=until, **fields)
        place = np.column_stack([run.heavy_position[:, 0], -1.0 - fall(run.t)])
        return dataclasses.replace(run, heavy_position=place)

    return make


def coming_back(t, travel=9e-5):
    """Braked to rest at 0.4 s, and back between 0.42 s and 0.43 s: by less than the resolution."""
    top, brake, halt = 1.5, 20.0, 0.4
    since = np.clip(t - (halt - top / brake), 0, top / brake)
    there = top * np.minimum(t, halt - top / brake) + top * since - 0.5 * brake * since**2
    return there - travel * np.clip((t - 0.42) / 0.01, 0, 1) ** 2  # ever faster, until it stands still at once


@pytest.mark.parametrize(
    ("travel", "halt", "uncertainty"),
    [(9e-6, 0.4, 0.0), (9e-5, 0.4, 0.03), (2.1e-4, 0.43, 0.03), (9e-4, 0.43, 0.03), (1.3e-3, 0.43, 0.0)],
)
def test_a_halt_is_uncertain_by_all_that_resolutions_from_10_um_to_1_mm_see(sliding, closed_form, travel, halt, uncertainty):
    """A way back of 0.21 mm gave an uncertainty of 0 beside three halting times."""
    landmarks = run_landmarks(sliding(lambda t: coming_back(t, travel)), closed_form.parameters)
    assert (landmarks.halting_time, landmarks.halting_time_uncertainty) == (
        pytest.approx(halt, abs=1e-6),
        pytest.approx(uncertainty, abs=1e-6),
    )


def test_the_uncertainty_is_the_largest_distance_of_the_times_by_resolution(sliding, closed_form):
    landmarks = run_landmarks(sliding(coming_back), closed_form.parameters)
    assert landmarks.halting_time == pytest.approx(0.4, abs=1e-6)
    assert landmarks.halting_time_uncertainty == pytest.approx(0.03, abs=1e-6)
    assert [each.time for each in landmarks.halting_times] == pytest.approx([0.43, 0.43, 0.4, 0.4, 0.4], abs=1e-6)
    assert [each.resolution for each in landmarks.halting_times] == list(RESOLUTIONS)


def test_where_a_finer_resolution_loses_the_halt_the_uncertainty_is_a_lower_bound(sliding, closed_form):
    cut = run_landmarks(sliding(coming_back, until=0.475), closed_form.parameters)
    assert cut.halting_time == pytest.approx(0.4, abs=1e-6)
    assert (cut.at_least, cut.halting_time_uncertainty) == ("at least ", pytest.approx(0.0, abs=1e-6))
    whole = run_landmarks(sliding(coming_back, until=0.485), closed_form.parameters)
    assert (whole.at_least, whole.halting_time_uncertainty) == ("", pytest.approx(0.03, abs=1e-6))
    assert Landmarks().at_least == ""


def test_a_rebound_has_the_speed_of_either_direction(sliding, closed_form):
    def bouncing(t):
        back = 2.1e-4 * np.clip(t - 0.5, 0, 0.01) / 0.01
        return np.where(t < 0.3, t, 0.3) - back

    landmarks = run_landmarks(sliding(bouncing), closed_form.parameters)
    assert landmarks.rebound.travel == pytest.approx(2.1e-4, abs=1e-9)
    assert landmarks.rebound.speed == pytest.approx(0.021, rel=1e-6)
    assert [each.time for each in landmarks.halting_times] == pytest.approx([0.51, 0.51, 0.51, 0.3, 0.3], abs=1e-6)
    assert landmarks.halting_time == pytest.approx(0.51, abs=1e-6), "0.21 mm is more than the resolution"


@pytest.mark.parametrize(("static", "power"), [(0.34, 3), (0.5, 2)])
def test_a_string_that_sticks_since_the_release_slips_but_has_not_stopped(sliding, closed_form, static, power):
    """Where static and sliding friction are one, the force that accelerates it begins from nothing: a cube of the time."""
    parameters = closed_form.parameters.replace(kinetic_friction=0.34, static_friction=static)
    landmarks = run_landmarks(sliding(lambda t: 5 * np.maximum(t - 0.2, 0) ** power), parameters)
    assert landmarks.stops == ()
    assert landmarks.slip_onsets == (pytest.approx(0.2, abs=1e-6),)
    assert landmarks.halting_time is None
    assert landmarks.rebound is None


def test_stops_have_the_height_at_their_time(sliding, closed_form):
    def swinging(t):
        return 0.2 * np.sin(5 * t)  # it turns at pi / 10 and 3 pi / 10

    landmarks = run_landmarks(sliding(swinging), closed_form.parameters)
    assert [stop.time for stop in landmarks.stops] == pytest.approx([math.pi / 10, 3 * math.pi / 10], abs=1e-4)
    assert [stop.height_change for stop in landmarks.stops] == pytest.approx([-0.2, 0.2], abs=1e-5)


@pytest.mark.parametrize("release", [Release.HELD, Release.DROP])
def test_a_mass_that_cannot_stop_has_no_stops(make_run, closed_form, release):
    run = make_run(status=RunStatus.LIGHT_REACHED_ROD)
    landmarks = run_landmarks(run, closed_form.parameters.replace(release=release))
    assert (landmarks.stops, landmarks.halting_time, landmarks.halting_times) == ((), None, ())
    assert landmarks.light_reaches_rod == arrival(run)
    assert len(landmarks.x1_extrema) > 0


def test_the_engines_own_slip_is_read_where_it_has_one(make_run):
    run = make_run()
    own = np.linspace(0, 1, len(run.t))
    np.testing.assert_array_equal(slip_distance(dataclasses.replace(run, string_slip=own), 7), own[:7])
    np.testing.assert_array_equal(slip_distance(run, 7), run.heavy_drop[:7])
    gone = own.copy()
    gone[7:] = np.nan
    np.testing.assert_array_equal(slip_distance(dataclasses.replace(run, string_slip=gone), 7), own[:7])
    np.testing.assert_array_equal(slip_distance(dataclasses.replace(run, string_slip=gone), 8), run.heavy_drop[:8])


@pytest.mark.parametrize("column", ["light_position", "heavy_position", "heavy_velocity"])
def test_samples_count_up_to_the_first_that_is_no_number(make_run, column):
    run = make_run()
    getattr(run, column)[[300, 500], 1] = (np.inf, np.nan)
    assert finite_length(run) == 300
    short = first_samples(run, 300)
    assert {len(short.t), len(short.free_length), len(short.mode), len(short.light_position)} == {300}
    assert finite_length(short) == 300
    assert first_samples(run, len(run.t)) is run


# ---- extrema


def test_an_extremum_is_the_apex_of_a_parabola_also_between_uneven_samples():
    t = array(0.0, 0.1, 0.15, 0.3, 0.4, 0.6)
    (extremum,) = extrema(t, 2.0 - 10 * (t - 0.22) ** 2)
    assert (extremum.time, extremum.value) == (pytest.approx(0.22), pytest.approx(2.0))


def test_a_flat_top_is_an_extremum_at_its_first_sample():
    t = array(0, 1, 2, 3, 4, 5)
    (extremum,) = extrema(t, array(0, 1, 1, 1, 1, 0))
    assert 1.0 <= extremum.time <= 2.0
    assert extremum.value == pytest.approx(1.0, abs=0.13)


@pytest.mark.parametrize(("height", "count"), [(0.9e-3, 0), (1.1e-3, 1)])
def test_an_extremum_turns_back_by_more_than_a_millimetre(height, count):
    t = np.arange(201) * DT
    assert len(extrema(t, t + 0.0 + height * np.cos(0 * t) - 2 * np.maximum(t - 0.2 + height, 0))) == count


# ---- the reference


def events(*pairs):
    return tuple(TrajectoryEvent(name=name, time=time) for name, time in pairs)


def of_events(named):
    """Return the landmarks of a run that stands 0.1 m lower, turned by 2 rad and 0.3 m long, a second later."""

    def state_at(t):
        return tuple(np.multiply(t, per_second) for per_second in (0.1, 2.0, 0.3))

    return exact_landmarks(named, state_at, x1_extrema=(), y1_extrema=())


def test_the_references_moments_are_its_events():
    found = of_events(
        events(
            ("stick", 0.0), ("stop", 0.2), ("stop", 0.4), ("stick", 0.4), ("slip_onset", 0.5), ("slip_onset", 0.7),
            ("slack", 0.8),
            ("stick", 0.9), ("halt", 0.9), ("light_reaches_rod", 1.3), ("light_reaches_rod", 1.4),
        )
    )  # fmt: skip
    assert [(stop.time, stop.height_change) for stop in found.stops] == [
        (t, pytest.approx(-0.1 * t, rel=1e-12)) for t in (0.2, 0.4, 0.9)
    ]
    assert found.slip_onsets == (0.5, 0.7)
    assert (found.halting_time, found.light_reaches_rod) == (0.9, 1.3)
    at_halt = (found.drop_at_halt, found.wrap_angle_at_halt, found.free_length_at_halt)
    assert at_halt == pytest.approx((0.09, 1.8, 0.27), rel=1e-12)
    nothing = of_events(())
    assert nothing == Landmarks()


def test_each_stop_of_the_reference_has_its_own_height(reference, times):
    def also(t):
        return dataclasses.replace(reference(t), events=events(("stop", 0.1), ("stop", 0.2), ("halt", HALT)))

    landmarks = reference_landmarks(also, times)
    wanted = drop(array(0.1, 0.2, HALT))[0]
    assert [stop.time for stop in landmarks.stops] == [0.1, 0.2, HALT]
    assert [-stop.height_change for stop in landmarks.stops] == pytest.approx(list(wanted), rel=1e-9)
    assert landmarks.drop_at_halt == pytest.approx(wanted[2], rel=1e-9)
    assert landmarks.halting_confirmed

    def never(t):
        return dataclasses.replace(reference(t), events=events(("stop", 0.1)))

    landmarks = reference_landmarks(never, times)
    assert [-stop.height_change for stop in landmarks.stops] == pytest.approx([wanted[0]], rel=1e-9)
    assert (landmarks.halting_time, landmarks.drop_at_halt, landmarks.wrap_angle_at_halt, landmarks.free_length_at_halt) == (
        None,
    ) * 4
    assert not landmarks.halting_confirmed
    assert reference_landmarks(lambda t: dataclasses.replace(reference(t), events=()), times).stops == ()


def arrival(run):
    """Where a straight line through the last two squares of the free length reaches that at the rod."""
    slope, at_end = np.polyfit(run.t[-2:] - run.t[-1], run.free_length[-2:] ** 2 - PARAMETERS.end_length**2, 1)
    return pytest.approx(run.t[-1] - at_end / slope, rel=1e-9)


@pytest.mark.parametrize("name", ["fat_rod", "static_friction", "ten_to_one", "two_and_a_half_to_one", "two_to_one", "atwood"])
def test_the_arrival_at_the_rod_is_one_time_from_events_and_from_samples(name):
    """A report had 1.1039 s by the reference's events, and 1.1030 s, the last sample, from its samples."""
    scenario = load(name)
    reference = Reference(scenario)
    exact = reference_landmarks(reference, np.arange(3) * 1e-3).light_reaches_rod
    sampled = SampledReference(reference, scenario.parameters)
    assert sampled.landmarks_beside().light_reaches_rod == pytest.approx(exact, abs=2e-6)
    engines_run = first_samples(
        sampled.run, int(np.argmax(sampled.run.free_length < 4e-3)) or len(sampled.run.t)
    )  # as engines end
    assert run_landmarks(engines_run, scenario.parameters).light_reaches_rod == pytest.approx(exact, abs=1e-5)


def test_a_free_length_that_does_not_fall_ends_with_the_run(closed_form):
    for lengths in ([5e-3, 5e-3], [5e-3, 6e-3], [5e-3, closed_form.parameters.end_length]):
        assert arrival_time(np.array([1.0, 1.001]), np.array(lengths), closed_form.parameters) == 1.001


def test_beside_a_run_that_reached_the_rod_the_reference_ends_with_as_much_string(reference, closed_form, make_run):
    sampled = SampledReference(reference, closed_form.parameters)
    assert sampled.run.status is RunStatus.LIGHT_REACHED_ROD
    assert sampled.landmarks_beside().light_reaches_rod == arrival(sampled.run)
    reached = make_run(until=1.0, status=RunStatus.LIGHT_REACHED_ROD)
    assert sampled.landmarks_beside(reached).light_reaches_rod == arrival(reached)
    assert sampled.landmarks_beside(make_run(until=1.0)).light_reaches_rod == arrival(sampled.run), (
        "one that was cut is seen no further"
    )
    longer = dataclasses.replace(reached, free_length=reached.free_length - 1.0)
    assert sampled.landmarks_beside(longer).light_reaches_rod == arrival(sampled.run), "the reference never has so little"


def test_the_reference_can_be_cut_at_any_time(reference, closed_form):
    sampled = SampledReference(reference, closed_form.parameters)
    assert sampled.landmarks_until(HALT + 0.052).halting_time == pytest.approx(HALT, abs=1e-6)
    assert sampled.landmarks_until(HALT + 0.048).halting_time is None
    assert sampled.landmarks_until(1.05).light_reaches_rod is None, "where it was cut it has not reached the rod"
    assert sampled.landmarks_until(0.002).halting_times != ()
    assert sampled.landmarks_until(0.001).halting_times == ()


def test_a_reference_that_does_not_reach_the_rod_runs_to_its_end(reference, closed_form):
    def never(t):
        return dataclasses.replace(reference(t), events=events(("halt", HALT)))

    sampled = SampledReference(never, closed_form.parameters)
    assert sampled.run.status is RunStatus.FINISHED
    assert sampled.landmarks_beside().light_reaches_rod is None
    assert sampled.landmarks_beside().halting_time == pytest.approx(HALT, abs=1e-6)


def test_landmarks_of_the_closed_form(closed_form, make_run):
    for status, confirmed in ((RunStatus.FINISHED, False), (RunStatus.LIGHT_REACHED_ROD, True)):
        landmarks = run_landmarks(make_run(status=status), closed_form.parameters)
        assert landmarks.halting_time == pytest.approx(closed_form.halt, abs=1e-9)
        assert landmarks.halting_confirmed is confirmed
        assert landmarks.drop_at_halt == pytest.approx(closed_form.drop, abs=5e-6)  # b dt^2 / 8, between samples
        assert landmarks.wrap_angle_at_halt == pytest.approx(closed_form.wrap_angle, abs=1e-4)
        assert landmarks.free_length_at_halt == pytest.approx(closed_form.free_length, abs=5e-6)


def test_extrema_of_a_cosine():
    t, rate = np.arange(1100) * DT, 9.0
    turns = extrema(t, 0.2 * np.cos(rate * t + 0.5))
    expected = [(k * math.pi - 0.5) / rate for k in (1, 2, 3)]
    assert [e.time for e in turns] == [pytest.approx(e, abs=1e-6) for e in expected]  # the parabola misses by order dt^3 rate^2
    assert [e.value for e in turns] == [pytest.approx(v, abs=1e-8) for v in (-0.2, 0.2, -0.2)]


def test_the_references_samples_give_the_references_events(scenario):
    """Two to one: a reversal, a stick, a break-away and the halt, read off samples at 1 kHz."""
    coefficients = {"kinetic_friction": 0.265, "light_drag": 6e-4, "heavy_drag": 6e-4, "string_drag": 5.9e-3}
    parameters = scenario.parameters.replace(
        light_mass=0.05, rod_radius=0.007, free_length=0.584, release_angle=math.radians(68), **coefficients
    )
    two = dataclasses.replace(scenario, parameters=parameters, duration=1.2)
    exact = reference_landmarks(Reference(two), np.arange(1201) * DT)
    landmarks = run_landmarks(ReferenceEngine(Profile.QUICK).simulate(two), parameters)
    assert len(landmarks.stops) == len(exact.stops) == 3
    for own, true in zip(landmarks.stops, exact.stops, strict=True):
        assert own.time == pytest.approx(true.time, abs=5e-4)  # the speed's curvature over the last two samples
    assert landmarks.halting_time == pytest.approx(exact.halting_time, abs=1e-4)
    assert len(landmarks.slip_onsets) == len(exact.slip_onsets) == 1
    assert landmarks.slip_onsets[0] == pytest.approx(exact.slip_onsets[0], abs=4e-3)  # the power law's next term
    assert [e.time for e in landmarks.x1_extrema] == [pytest.approx(e.time, abs=1e-6) for e in exact.x1_extrema]
