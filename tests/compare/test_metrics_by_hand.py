"""Tube, acceleration and metrics where geometry or a few numbers say what they must be."""

import dataclasses
import math

import numpy as np
import pytest

from looping_pendulum.compare import compare
from looping_pendulum.compare.align import Aligned, align, sample_reference
from looping_pendulum.compare.comparison import judge_tolerance
from looping_pendulum.compare.deviation import Departure, departures, evaluate_tube, growth_rate
from looping_pendulum.compare.metrics import ComparedRun, acceleration_error, drag_acts, fitted_acceleration, metrics, rms_until
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.runs.events import Landmarks, Rebound, run_landmarks
from looping_pendulum.runs.trajectory import TrajectoryEvent
from looping_pendulum.scenarios.metrics import METRICS
from tests.compare.conftest import PARAMETERS


@pytest.fixture
def straight(reference):
    """A reference whose light mass moves along x at 1 m/s."""

    def sample(t, end=1.1):
        run = reference(t, end)
        return dataclasses.replace(run, light_position=np.column_stack([run.t, np.zeros_like(run.t)]))

    return sample


def beside(make_run, ahead, aside, until=0.1):
    """A run that is so far ahead of that reference, and to its side [m]."""
    run = make_run(until=until)
    place = np.column_stack([run.t + ahead, np.full_like(run.t, aside)])
    return dataclasses.replace(run, light_position=place)


@pytest.mark.parametrize(
    ("ahead", "aside", "inside"),
    [
        (0.0, 4.9e-3, True), (0.0, -5.1e-3, False), (4.9e-3, 4.9e-3, True), (-4.9e-3, -4.9e-3, True), (4.9e-3, 5.1e-3, False),
        (9.9e-3, 0.0, True), (10.1e-3, 0.0, False), (-9.9e-3, 0.0, True), (-10.1e-3, 0.0, False),
        (8.5e-3, 3.5e-3, True), (8.6e-3, 3.6e-3, False), (-8.5e-3, 3.5e-3, True), (-8.6e-3, 3.6e-3, False),
    ],
)  # fmt: skip
def test_the_tube_is_a_stadium_of_5_ms_of_path_and_5_mm_around_it(make_run, straight, ahead, aside, inside):
    """Oracle: at 1 m/s the path within 5 ms is 5 mm long to either side; around its ends lie half-discs of 5 mm."""
    run = beside(make_run, ahead, aside)
    tube = evaluate_tube(align(run, straight), straight)
    away = run.t >= 5e-3  # the path begins at the release: before 5 ms there is less of it behind
    count = int(away.sum())
    assert tube.compared == 101
    assert (tube.half_time, tube.half_width) == (5e-3, 5e-3)
    if inside:
        assert tube.fraction >= count / 101
    else:
        assert tube.fraction <= 1 - count / 101


def test_the_tube_between_its_points_is_a_chord(make_run, straight):
    # Across by just less than the half-width: only the chord comes so near between two of its points, 0.5 mm apart.
    for ahead in (0.0, 1e-4, 2.5e-4, 4e-4):
        near = beside(make_run, ahead, 4.9999e-3)
        assert evaluate_tube(align(near, straight), straight).fraction == 1.0


def test_the_first_exit_is_the_first_sample_outside(make_run, straight):
    run = beside(make_run, 0.0, 0.0)
    run.light_position[40:60, 1] = 6e-3
    tube = evaluate_tube(align(run, straight), straight)
    assert tube.first_exit == pytest.approx(0.040)
    assert tube.fraction == pytest.approx(81 / 101)


def test_at_the_ends_of_the_reference_its_path_is_a_point(make_run, straight):
    def short(t):
        return straight(t, end=0.05)

    tube = evaluate_tube(align(beside(make_run, 4.9e-3, 0.0), short), short)
    assert (tube.compared, tube.fraction) == (51, 1.0)
    behind = evaluate_tube(align(beside(make_run, 5.5e-3, 0.0), short), short)
    # Ahead by 5.5 mm: only the last sample of the reference has no more path ahead than itself.
    assert behind.fraction == pytest.approx(50 / 51)
    assert behind.first_exit == pytest.approx(0.050)


def test_the_tubes_chords_begin_at_every_tenth_of_its_half_time(make_run, straight):
    asked = []

    def listening(t):
        asked.extend(t)
        return straight(t)

    run = beside(make_run, 0.0, 0.0)
    evaluate_tube(align(run, straight), listening)
    ticks = np.array(asked) / 5e-4
    np.testing.assert_allclose(ticks, np.round(ticks), atol=1e-6)
    assert set(np.round(ticks)) == set(range(211)), "from the release to 5 ms after the last sample"


@pytest.mark.parametrize(("times", "known"), [((0.1, 2.0), [True, False]), ((2.0, 3.0), [False, False]), ((-1.0,), [False])])
def test_times_of_which_the_reference_has_one_or_none(reference, times, known):
    got = sample_reference(reference, np.array(times))
    assert list(np.isfinite(got.heavy_position[:, 1])) == known
    assert list(np.isfinite(got.light_position).all(axis=1)) == known
    assert got.mode.shape == (len(times),)


@pytest.mark.parametrize(
    ("t", "fallen", "acceleration"),
    [((0, 1, 2), (0, 1, 4), 2.0), ((0, 1, 2), (0, 1, 5), 42 / 17), ((0, 1, 2), (3, 1, 4), 2.0), ((0,), (0,), None),
     ((0, 1), (0, math.nan), None), ((), (), None)],
)  # fmt: skip
def test_the_acceleration_is_of_least_squares_through_rest(t, fallen, acceleration):
    """Oracle: the sum of d t^2 over half of that of t^4."""
    assert fitted_acceleration(np.array(t, dtype=float), np.array(fallen, dtype=float)) == (
        None if acceleration is None else pytest.approx(acceleration)
    )


@pytest.mark.parametrize(("samples", "known"), [(2, False), (3, True)])
def test_an_acceleration_needs_three_samples_beside_the_reference(make_run, reference, closed_form, samples, known):
    vertical = closed_form.parameters.replace(release=Release.VERTICAL)
    aligned = align(make_run(until=1e-3 * (samples - 1)), reference)
    assert (acceleration_error(aligned, vertical) is not None) is known
    gone = make_run()
    gone.heavy_position[samples:] = np.nan
    assert (acceleration_error(align(gone, reference), vertical) is not None) is known


def test_drag_is_what_makes_no_acceleration_constant(closed_form):
    assert not drag_acts(closed_form.parameters)
    assert drag_acts(closed_form.parameters.replace(light_drag=1e-4))
    assert not drag_acts(closed_form.parameters.replace(kinetic_friction=0.5)), "friction is no force of the air"


def test_with_drag_an_engine_that_falls_faster_than_the_reference_has_a_positive_error(closed_form, reference, make_run):
    parameters = closed_form.parameters.replace(release=Release.VERTICAL, heavy_drag=1e-3)
    run = make_run()
    height = run.heavy_position[:, 1]
    faster = np.column_stack([run.heavy_position[:, 0], height[0] + 1.02 * (height - height[0])])
    aligned = align(dataclasses.replace(run, heavy_position=faster), reference)
    assert acceleration_error(aligned, parameters) == pytest.approx(0.02, abs=1e-9)


@pytest.mark.parametrize(("until", "known"), [(0.35 - 0.9e-6, True), (0.35 - 1.1e-6, False)])
def test_a_run_that_ends_within_a_microsecond_of_a_mark_has_reached_it(make_run, reference, times, until, known):
    run = make_run(until=0.35)
    moved = dataclasses.replace(run, t=np.append(run.t[:-1], until))
    aligned = Aligned(run=moved, reference=sample_reference(reference, run.t))
    assert (rms_until(aligned, 0.35) is not None) is known


def test_the_rms_takes_every_sample_up_to_the_mark_and_none_beyond(make_run, reference):
    run = make_run()
    run.light_position[351:] += 1.0
    assert rms_until(align(run, reference), 0.35) == pytest.approx(0.0, abs=1e-12)
    run.light_position[350] += (3.0, 4.0)
    assert rms_until(align(run, reference), 0.35) == pytest.approx(5 / math.sqrt(351), rel=1e-9)


def test_without_a_string_a_departure_is_neither_along_nor_across(make_run, reference):
    run = make_run(shift=(2e-3, 0.0))
    bare = dataclasses.replace(run, free_length=np.full_like(run.t, np.nan), wrap_angle=np.full_like(run.t, np.nan))
    bare = dataclasses.replace(bare, string_stretch=np.full_like(run.t, np.nan))
    (departure,) = departures(align(bare, reference), ())
    assert (departure.along, departure.across, departure.stretch, departure.time) == (0.0, 0.0, None, 0.0)


def test_a_departure_is_after_the_last_event_up_to_it(make_run, reference):
    run = make_run()
    run.light_position[400:] += (2e-3, 0.0)
    names = [("slack", 0.1), ("taut", 0.4), ("unwrapped", 0.401), ("stop", 0.2)]
    (departure,) = departures(align(run, reference), tuple(TrajectoryEvent(name=name, time=time) for name, time in names))
    assert (departure.after, departure.after_time, departure.time) == ("taut", 0.4, pytest.approx(0.4))
    run.string_stretch[400] = -3e-3
    run.string_stretch[401] = 9e-3
    (departure,) = departures(align(run, reference), (), np.abs(run.string_stretch))
    assert departure.stretch == 3e-3, "what it stretches later is no cause"


def gone(threshold, time):
    return Departure(threshold=threshold, time=time, mode="", after="release", after_time=0.0, along=0.0, across=0.0, heavy=0.0)


def test_growth_needs_two_departures_at_two_times():
    assert growth_rate((gone(1e-3, 0.5), gone(1e-2, 0.7))) == pytest.approx(math.log(10) / 0.2)
    assert growth_rate((gone(1e-3, 0.5),)) is None
    assert growth_rate((gone(1e-3, 0.5), gone(1e-2, 0.5))) is None
    assert growth_rate(()) is None


def said(make_run, reference, own, true, comparable=True):
    aligned = align(make_run(), reference)
    tube = evaluate_tube(aligned, reference)
    return metrics(
        ComparedRun(
            aligned=aligned,
            parameters=PARAMETERS,
            landmarks=own,
            reference_landmarks=true,
            tube=tube,
            comparable=comparable,
            stretch=np.zeros(len(aligned.t)),
        )
    )


AT = Landmarks(halting_time=0.4, drop_at_halt=0.3, wrap_angle_at_halt=5.0, free_length_at_halt=0.2)


def test_errors_at_the_halt_are_own_less_true(make_run, reference):
    rebound = Rebound(travel=2e-3, speed=1.0)
    own = Landmarks(
        halting_time=0.41, drop_at_halt=0.32, wrap_angle_at_halt=5.3, free_length_at_halt=0.24, rebound=rebound
    )  # fmt: skip
    values = said(make_run, reference, own, AT)
    names = ("halting_time_error", "drop_error", "wrap_angle_error", "free_length_error")
    assert [values[name] for name in names] == pytest.approx([0.01, 0.02, 0.3, 0.04])
    assert values["rebound"] == 2e-3
    assert said(make_run, reference, AT, AT)["rebound"] is None
    for pair in ((own, Landmarks()), (Landmarks(), AT)):
        assert [said(make_run, reference, *pair)[name] for name in names] == [None] * 4
    assert [said(make_run, reference, own, AT, comparable=False)[name] for name in names] == [None] * 4
    nowhere = dataclasses.replace(own, wrap_angle_at_halt=math.nan, drop_at_halt=None)
    values = said(make_run, reference, nowhere, AT)
    assert (values["wrap_angle_error"], values["drop_error"]) == (None, None)
    assert values["halting_time_error"] == pytest.approx(0.01)


def test_a_run_that_ends_in_nonsense_is_judged_up_to_there(scenario, reference, make_run, closed_form):
    run = make_run()
    run.string_stretch[:] = 1e-4
    run.light_position[500:] = np.nan
    run.string_stretch[600] = 5.0
    (engine,) = compare(scenario, reference, [run]).engines
    assert engine.metrics["simulated_time"] == pytest.approx(0.499)
    assert engine.metrics["string_stretch"] == 1e-4
    assert engine.samples == 1051
    assert run_landmarks(run, closed_form.parameters).halting_time == pytest.approx(closed_form.halt, abs=1e-6)
    none = make_run()
    none.light_position[:] = np.nan
    (engine,) = compare(scenario, reference, [none]).engines
    assert (engine.metrics["simulated_time"], engine.metrics["string_stretch"], engine.end_time) == (None, None, None)


# ---- tolerances


@pytest.mark.parametrize(
    ("metric", "value", "kept"),
    [("drop_error", 1.0, True), ("drop_error", -1.0, True), ("drop_error", 1.01, False), ("tube_fraction", 1.0, True),
     ("tube_fraction", 0.99, False), ("simulated_time", 1.01, True)],
)  # fmt: skip
def test_just_the_limit_is_kept(metric, value, kept):
    assert METRICS[metric].is_within(value, 1.0) is kept


def test_a_limit_is_for_one_engine_in_one_profile(scenario, reference, make_run, limit):
    others = [
        limit("drop_error", 1.0, engine="pymunk:other"),
        dataclasses.replace(limit("drop_error", 1.0), profile="accurate"),
    ]
    few = dataclasses.replace(scenario, tolerances=tuple(others))
    assert compare(few, reference, [make_run()]).tolerances == ()
    more = dataclasses.replace(scenario, tolerances=(*others, limit("drop_error", 2.0)))
    (judged,) = compare(more, reference, [make_run()]).tolerances
    assert judged.limit == 2.0


def test_a_missing_value_says_why(scenario, reference, make_run, limit):
    (engine,) = compare(scenario, reference, [make_run()]).engines
    blank = dataclasses.replace(engine, metrics=dict.fromkeys(engine.metrics))
    one = limit("drop_error", 1.0)
    why = [
        judge_tolerance(one, dataclasses.replace(blank, **fields)).explanation
        for fields in ({"ok": False, "not_comparable": "short"}, {"not_comparable": "short"}, {}, {"available": False})
    ]
    assert why[:2] == [f"no value: {engine.status_sentence}", "no value: short"]
    assert why[2].startswith("no value: the run or the reference ends before the time at which the metric is taken, or")
    assert why[3] == engine.status_sentence
