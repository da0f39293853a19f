"""From runs to errors and from errors to sentences: every number is chosen, and every part is another one."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest

from looping_pendulum.compare.convergence.ladder import SequenceFinding
from looping_pendulum.compare.convergence.result import DROP, HALT, PATH_END_TIMES, QUANTITIES, ErrorCause, SequenceKind
from looping_pendulum.compare.convergence.study import (
    NUMBER_FLOOR,
    PATH_FLOOR,
    LadderResult,
    MeasuredRun,
    ReferenceTarget,
    change,
    changed_starts,
    convergence_verdict,
    correction,
    cut_to_watched,
    error_split,
    evaluate_ladder,
    evaluate_variant,
    floors,
    measure_run,
    plan_variant,
    reference_target,
    refined_further_by,
    verdict_sentence,
    with_missing_halts,
)
from looping_pendulum.compare.run_cache import EndedRun
from looping_pendulum.engines.studies import AdapterChoice, HiddenDefault, Ladder, Studies
from looping_pendulum.errors import EngineError
from looping_pendulum.runs.trajectory import RunStatus
from tests.compare.delayed import STEPS, DelayedEngine

EARLY, LATE = PATH_END_TIMES


def shifted(goal, halt=0.0, drop=0.0):
    known = {HALT: (halt, goal.numbers[HALT]), DROP: (drop, goal.numbers[DROP])}
    numbers = {name: None if off is None else value + off for name, (off, value) in known.items()}
    return dataclasses.replace(goal, numbers=numbers)


# ---- how well a number can be read off


def test_floors_are_the_worst_reading_of_the_references_own_halt(goal):
    """Oracle: numbers that are off by a chosen amount. Bound: the drop between two samples bends by 40 m/s^2 (1 ms)^2 / 8."""
    bend = 5e-6
    smallest = floors(shifted(goal, halt=1e-4, drop=-2e-4))
    assert smallest[HALT] == pytest.approx(1e-4, abs=1e-8)
    assert smallest[DROP] == pytest.approx(2e-4, abs=2 * bend)
    exact = floors(goal)
    assert exact[HALT] == NUMBER_FLOOR
    assert NUMBER_FLOOR < exact[DROP] <= bend * 1.1
    assert [smallest[name] for name in PATH_END_TIMES] == [PATH_FLOOR, PATH_FLOOR]


def test_a_number_that_only_one_side_has_keeps_the_least_floor(goal):
    assert floors(shifted(goal, halt=None, drop=None)) == floors(goal) | {HALT: NUMBER_FLOOR, DROP: NUMBER_FLOOR}
    short = dataclasses.replace(goal, scenario=dataclasses.replace(goal.scenario, duration=0.3))
    assert floors(short)[HALT] == floors(short)[DROP] == NUMBER_FLOOR, "cut before it halts"


def test_the_reference_is_read_at_eight_phases_of_a_sample_interval(goal):
    asked = []

    def listening(t):
        asked.append(np.array(t))
        return goal.reference(t)

    floors(dataclasses.replace(goal, reference=listening))
    readings = [t for t in asked if len(t) > 1]
    assert [t[0] for t in readings] == pytest.approx([k * 1.25e-4 for k in range(8)])
    assert {len(t) for t in readings} == {1050}
    assert max(t.max() for t in readings) < goal.scenario.duration
    assert all(np.allclose(np.diff(t), 1e-3) for t in readings)


def test_what_fell_before_the_first_sample_belongs_to_the_drop(goal):
    """Oracle: a heavy mass that leaves with 1 m/s: in 7/8 ms it falls 0.9 mm, far above what a reading errs by."""

    def fast(t):
        run = goal.reference(t)
        fallen = np.minimum(t, 0.3) + np.clip(t - 0.3, 0, 0.025) - 20 * np.clip(t - 0.3, 0, 0.025) ** 2
        place = np.column_stack([run.heavy_position[:, 0], -1.0 - fallen])
        return dataclasses.replace(run, heavy_position=place)

    known = ReferenceTarget(scenario=goal.scenario, reference=fast, numbers={HALT: 0.325, DROP: 0.3125})
    smallest = floors(known)
    assert smallest[DROP] <= 6e-6
    assert smallest[HALT] <= 1e-6


def test_a_target_has_the_halt_that_its_samples_give(goal, closed_form):
    made = reference_target(goal.scenario, goal.reference)
    assert made.numbers[HALT] == pytest.approx(closed_form.halt, abs=1e-8)
    assert made.numbers[DROP] == pytest.approx(closed_form.drop, abs=5e-6)


# ---- one run


@pytest.mark.parametrize(
    ("done", "status", "why"),
    [
        (None, "NOT_RUN", "not run"),
        (EndedRun(run=None, seconds=None), "NOT_RUN", "not run"),
        (EndedRun(run=None, seconds=None, expected=123.4), "SKIPPED", "left out: expected 120 s"),
    ],
)
def test_a_run_that_was_not_made_has_no_errors_and_says_why(goal, done, status, why):
    measured_run = measure_run("key", done, goal)
    assert (measured_run.summary.key, measured_run.summary.ok) == ("key", False)
    assert (measured_run.summary.status, measured_run.summary.why, measured_run.summary.ok) == (status, why, False)
    assert measured_run.errors == dict.fromkeys(QUANTITIES)
    assert measured_run.summary.rms == dict.fromkeys(PATH_END_TIMES)


def test_the_errors_of_a_late_run_are_later_minus_the_reference(goal, make_run, closed_form):
    run = make_run(delay=3e-3, shift=(3e-3, 4e-3))
    run.string_stretch[7] = -2e-3
    run.string_stretch[8] = np.nan
    measured_run = measure_run("key", EndedRun(run=run, seconds=1.0), goal)
    s = measured_run.summary
    assert s.halting_time_error == pytest.approx(3e-3, abs=1e-6)
    assert s.halting_time == pytest.approx(closed_form.halt + 3e-3, abs=1e-6)
    assert s.drop_error == pytest.approx(0.0, abs=1e-5)
    assert s.drop_at_halt == pytest.approx(closed_form.drop, abs=1e-5)
    assert s.string_stretch == 2e-3
    assert (s.status, s.ok, s.why) == ("FINISHED", True, RunStatus.FINISHED.value)
    assert float(measured_run.errors[HALT][0, 0]) == s.halting_time_error
    assert {name: len(measured_run.errors[name]) for name in PATH_END_TIMES} == {EARLY: 351, LATE: 701}
    assert measured_run.summary.ok
    still = measure_run("key", EndedRun(run=make_run(shift=(3e-3, 4e-3)), seconds=1.0), goal)
    assert still.summary.rms == {name: pytest.approx(5e-3, rel=1e-9) for name in PATH_END_TIMES}
    np.testing.assert_allclose(still.errors[LATE], np.tile([3e-3, 4e-3], (701, 1)))


def test_a_run_that_broke_off_has_no_halt_and_its_last_words(goal, make_run):
    crashed = make_run(until=0.5, status=RunStatus.CRASHED, message="first\nlast words\n")
    measured_run = measure_run("key", EndedRun(run=crashed, seconds=1.0), goal)
    assert measured_run.summary.why == f"{RunStatus.CRASHED.value}: last words"
    assert (measured_run.summary.ok, measured_run.summary.status) == (False, "CRASHED")
    assert (measured_run.errors[HALT], measured_run.errors[DROP], measured_run.summary.halting_time) == (None, None, None)
    assert measured_run.errors[LATE] is None
    assert len(measured_run.errors[EARLY]) == 351
    crashed.string_stretch[:] = np.nan
    assert measure_run("key", EndedRun(run=crashed, seconds=1.0), goal).summary.string_stretch is None


def test_where_the_reference_does_not_halt_a_halt_has_no_error(goal, make_run):
    measured_run = measure_run("key", EndedRun(run=make_run(), seconds=1.0), shifted(goal, halt=None, drop=None))
    assert measured_run.summary.halting_time is not None
    assert (measured_run.summary.halting_time_error, measured_run.summary.drop_error, measured_run.errors[HALT]) == (
        None,
        None,
        None,
    )


def errors(early=None, late=None, halt=None, drop=None):
    scalars = {HALT: halt, DROP: drop}
    numbers = {name: None if value is None else np.array([[float(value)]]) for name, value in scalars.items()}
    paths = {EARLY: early, LATE: late}
    return {name: None if value is None else np.tile([value, 0.0], (3, 1)) for name, value in paths.items()} | numbers


def measured(key="x", ended=True, **values):
    return MeasuredRun(errors=errors(**values), summary=SimpleNamespace(key=key, ok=ended))


def test_a_path_moves_by_a_distance_and_a_number_with_its_sign():
    of, to = errors(early=2e-3, halt=5e-3), errors(early=-1e-3, halt=2e-3)
    assert change(EARLY, of, to) == pytest.approx(3e-3)
    assert change(HALT, of, to) == pytest.approx(-3e-3)
    assert change(DROP, of, to) is None
    assert change(HALT, errors(), to) is None
    assert change(HALT, to, errors()) is None


# ---- what to say of a ladder


FINDING = SequenceFinding(kind=SequenceKind.CONVERGES, used=4, order=1.0, limit=np.array([[1e-3]]), uncertainty=1e-4)


@pytest.mark.parametrize(
    ("halts", "kind", "why"),
    [
        ((1, 2, 3), SequenceKind.CONVERGES, ""),
        ((1, None, 3), SequenceKind.SCATTERS, "no halt at 1 of 3 rungs"),
        ((None, None, 3), SequenceKind.SCATTERS, "no halt at 2 of 3 rungs"),
        ((None, None, None), SequenceKind.NEVER, "no halt at any of 3 rungs"),
        ((), SequenceKind.CONVERGES, ""),
    ],
)
def test_a_halt_that_rungs_lack_is_no_convergence(halts, kind, why):
    rungs = [measured(halt=halt) for halt in halts]
    finding = with_missing_halts(HALT, rungs, FINDING)
    assert (finding.kind, finding.why) == (kind, why)
    assert (finding.limit is None) is (kind is not SequenceKind.CONVERGES)
    assert with_missing_halts(LATE, rungs, FINDING) is FINDING, "of a path that is no matter"
    broken = [*rungs, measured(ended=False)]
    assert with_missing_halts(HALT, broken, FINDING).why == why, "one that broke off does not count"


@pytest.mark.parametrize(
    ("changed", "distance", "said"),
    [
        ({"order": 1.2345, "order_uncertainty": 0.0567}, 5e-5,
         "converges, order 1.23 ± 0.057, to a limit 0.05 ± 0.1 ms from the reference"),
        ({"order": 1.2345}, -2.46e-3,
         "converges, order 1.23, to a limit 2.5 ± 0.1 ms from the reference, "
         "which it does not reach with the other settings as they are"),
        ({"order": 1.0}, 1e-4, "converges, order 1, to a limit 0.1 ± 0.1 ms from the reference"),
        ({"kind": SequenceKind.SETTLED}, 0.0, "no longer changes over the last 4 rungs, "
         "at a value 0 ± 0.1 ms from the reference"),
        ({"kind": SequenceKind.SCATTERS, "why": "it jumps", "scatter": 1.234e-3}, 0.0,
         "does not converge: it jumps; the finest rungs scatter by ± 1.2 ms about a mean 0 ± 0.1 ms from the reference"),
        ({"kind": SequenceKind.WITHIN_SPREAD, "why": "small", "scatter": 1e-3}, 0.0,
         "converges no further than its spread: small; "
         "the finest rungs scatter by ± 1 ms about a mean 0 ± 0.1 ms from the reference"),
        ({"kind": SequenceKind.UNKNOWN, "why": "two rungs"}, None, "not known: two rungs"),
        ({"kind": SequenceKind.UNKNOWN, "why": "two rungs", "uncertainty": None}, 1.0, "not known: two rungs"),
    ],
)  # fmt: skip
def test_the_sentence_of_a_verdict(changed, distance, said):
    made = dataclasses.replace(FINDING, **({"order": None} | changed))
    assert verdict_sentence("s", made, distance) == said
    assert verdict_sentence("m", made, distance) == said.replace(" ms", " mm")


def test_a_verdict_has_the_limit_of_a_number_and_the_distance_of_a_path(goal, closed_form):
    number = convergence_verdict(HALT, dataclasses.replace(FINDING, limit=np.array([[-2e-3]])), 5, goal)
    assert number.limit == pytest.approx(closed_form.halt - 2e-3)
    assert (number.limit_error, number.unit, number.rungs, number.used) == (pytest.approx(-2e-3), "s", 5, 4)
    path = convergence_verdict(EARLY, dataclasses.replace(FINDING, limit=np.tile([3e-3, -4e-3], (7, 1))), 5, goal)
    assert (path.limit, path.limit_error, path.unit) == (None, pytest.approx(5e-3), "m")
    assert path.uncertainty == 1e-4
    none = convergence_verdict(HALT, dataclasses.replace(FINDING, limit=None), 5, goal)
    assert (none.limit, none.limit_error, none.uncertainty) == (None, None, None)


# ---- ladders that act on one another


def settings(**values):
    return SimpleNamespace(settings=SimpleNamespace(**values))


def ladder(setting, values, **taken):
    """A ladder of ``setting``; ``taken``: other settings that it takes along, their values rung by rung."""
    engines = [settings(**{setting: v, **{name: x[k] for name, x in taken.items()}}) for k, v in enumerate(values)]
    made = Ladder(setting=setting, unit="", values=tuple(values), engines=tuple(engines))
    return LadderResult(ladder=made, rungs=(), findings={}, own=None)


def test_the_finest_value_of_a_setting_is_where_its_ladder_takes_it():
    one = ladder("dt", (4, 2, 1), sweeps=(10, 20, 40), fixed=(7, 7, 7), words=("a", "b", "c"))
    assert (one.finest("dt"), one.finest("sweeps")) == (1.0, 40.0)
    assert (one.finest("fixed"), one.finest("words"), one.finest("nothing")) == (None, None, None)
    assert ladder("dt", ()).finest("dt") is None


@pytest.mark.parametrize(
    ("values", "taken", "inside"),
    [
        ((4, 2, 1), (4, 2, 1), True),
        ((4, 2, 1), (4, 2, 0.5), True),
        ((4, 2, 1), (4, 3, 2), False),
        ((10, 20, 40), (10, 20, 40), True),
        ((10, 20, 40), (10, 20, 80), True),
        ((10, 20, 40), (10, 20, 30), False),
        ((4, 2, 1), (3, 3, 3), False),
    ],
)
def test_a_ladder_is_refined_further_by_one_that_takes_its_setting_as_far(values, taken, inside):
    small, large = ladder("a", values), ladder("b", (9, 8, 7), a=taken)
    for both in ([small, large], [large, small]):
        assert refined_further_by(small, both) == ("b" if inside else "")
        assert not refined_further_by(large, both)
    assert not refined_further_by(small, [small])


def test_of_two_that_take_each_other_along_the_first_counts():
    one, other = ladder("a", (4, 2, 1), b=(4, 2, 1)), ladder("b", (4, 2, 1), a=(4, 2, 1))
    assert [refined_further_by(c, [one, other]) for c in (one, other)] == ["", "a"]
    assert [refined_further_by(c, [other, one]) for c in (one, other)] == ["b", ""]


def climbed(values, halts, limit, own=None, keys=None, kind=SequenceKind.CONVERGES, uncertainty=1e-5, setting="a"):
    rungs = tuple(measured(key=key, halt=halt) for key, halt in zip(keys or "pqrs", halts, strict=False))
    finding = SequenceFinding(kind=kind, limit=None if limit is None else np.array([[limit]]), uncertainty=uncertainty)
    made = Ladder(setting=setting, unit="", values=values, engines=tuple(settings(**{setting: v}) for v in values))
    return LadderResult(ladder=made, rungs=rungs, findings=dict.fromkeys(QUANTITIES, finding), own=own)


def test_a_correction_leads_from_the_variants_own_value_to_the_limit():
    own = measured(key="own", halt=5e-3)
    steps = ((4.0, 2.0, 1.0), (4e-3, 3e-3, 2e-3))
    assert float(correction(HALT, climbed(*steps, 1e-3), own).change[0, 0]) == pytest.approx(-4e-3)
    # Its own value among the rungs, but another run (another rule for all else): from that rung.
    at_two = correction(HALT, climbed(*steps, 1e-3, own=2.0), own)
    assert float(at_two.change[0, 0]) == pytest.approx(-2e-3)
    assert float(correction(HALT, climbed(*steps, 1e-3, own=3.0), own).change[0, 0]) == pytest.approx(-4e-3)
    assert float(correction(HALT, climbed(*steps, 1e-3, own=2.0, keys=("p", "own", "r")), own).change[0, 0]) == pytest.approx(
        -4e-3
    )
    assert (at_two.uncertainty, at_two.converges) == (1e-5, True)
    assert float(correction(HALT, climbed(*steps, 1e-3, own=2.0 * (1 + 1e-12)), own).change[0, 0]) == pytest.approx(-2e-3)


def test_without_a_limit_or_a_start_there_is_no_correction():
    own, steps = measured(key="own", halt=5e-3), ((4.0, 2.0, 1.0), (4e-3, None, 2e-3))
    assert correction(HALT, climbed(*steps, None), own) is None
    assert correction(HALT, climbed(*steps, 1e-3, uncertainty=None), own) is None
    assert correction(HALT, climbed(*steps, 1e-3), measured(key="own")) is None
    assert correction(HALT, climbed(*steps, 1e-3, own=2.0), own) is None, "the rung at its own value does not halt"
    kinds = {kind: correction(HALT, climbed(*steps, 1e-3, kind=kind), own).converges for kind in SequenceKind}
    assert {kind for kind, converges in kinds.items() if converges} == {SequenceKind.CONVERGES, SequenceKind.SETTLED}


def test_an_error_is_split_by_every_ladder_that_is_not_contained():
    own = measured(key="own", halt=5e-3)
    steps = ((4.0, 2.0, 1.0), (4e-3, 3e-3, 2e-3))
    ladders = [climbed(*steps, 3e-3), climbed(*steps, 4e-3, setting="b"), climbed(*steps, None, setting="c")]
    choices = {"x: y": measured(halt=6e-3), "none": measured()}
    split = error_split(HALT, own, ladders, choices, 1e-5, 2e-5)
    assert (split.quantity, split.unit, split.without_limit) == (HALT, "s", ("c",))
    assert split.error == pytest.approx(5e-3)
    assert split.numerics == pytest.approx(3e-3), "2 ms of the one and 1 ms of the other"
    assert split.model == pytest.approx(2e-3)
    assert split.numerics_uncertainty == pytest.approx(math.sqrt(2e-5**2 + 2e-5**2 + 2 * 1e-5**2))
    assert (split.choice, split.choice_of) == (pytest.approx(1e-3), "x: y")
    assert split.causes == (ErrorCause.NOT_CONVERGED, ErrorCause.MODEL)
    assert error_split(DROP, own, ladders, choices, 1e-5, 2e-5) is None


def test_a_rung_without_the_quantity_is_left_out_of_its_ladder():
    # Of four rungs the second broke off: the others still halve their error with their step, up to rounding.
    engine = DelayedEngine()
    steps = engine.studies().ladders[0]
    rungs = tuple(
        measured(key=str(k), halt=None if k == 1 else 10 * step, ended=k != 1) for k, step in enumerate(STEPS)
    )  # fmt: skip
    ladder_result = evaluate_ladder(steps, rungs, engine, dict.fromkeys(QUANTITIES), dict.fromkeys(QUANTITIES, 1e-9))
    assert ladder_result.findings[HALT].kind is SequenceKind.CONVERGES
    assert ladder_result.findings[HALT].order == pytest.approx(1.0, abs=1e-3)
    assert ladder_result.own == 4e-4
    assert ladder_result.findings[DROP].kind is SequenceKind.NEVER
    named = dataclasses.replace(steps, setting="no_such")
    assert evaluate_ladder(named, rungs, engine, dict.fromkeys(QUANTITIES), dict.fromkeys(QUANTITIES, 1e-9)).own is None


# ---- the plan of a convergence study, and the evaluation of a whole variant


# ---- the plan of a study


def test_starts_are_changed_by_a_hundredth_of_a_degree_and_a_tenth_of_a_millimetre(scenario):
    p = scenario.parameters
    starts = {what: where.parameters for what, where in changed_starts(scenario)}
    assert list(starts) == [
        "release angle +0.01 deg", "release angle -0.01 deg", "free length +0.1 mm", "free length -0.1 mm",
        "hanging length +0.1 mm", "hanging length -0.1 mm",
    ]  # fmt: skip
    for (what, moved), sign in zip(starts.items(), (1, -1) * 3, strict=True):
        name = "_".join(what.split()[:2])
        size = math.radians(0.01) if name == "release_angle" else 1e-4
        assert getattr(moved, name) - getattr(p, name) == pytest.approx(sign * size, rel=1e-6)
        others = {"release_angle", "free_length"} - {name}
        assert all(getattr(moved, other) == getattr(p, other) for other in others)


@pytest.mark.parametrize(("until", "duration"), [(0.4, 0.4), (0.40049, 0.4), (2.0, 1.05)])
def test_a_study_is_watched_as_long_as_asked_and_no_longer_than_the_scenario(scenario, until, duration):
    assert cut_to_watched(scenario, until).duration == duration


def test_the_plan_runs_first_what_tells_the_cost_of_others(scenario):
    engine = DelayedEngine(other_offset=1e-3)
    starts = changed_starts(scenario)
    made = plan_variant(engine, scenario, starts)
    tasks = made.tasks()
    assert tasks[0] is made.own
    assert [task.what for task in tasks] == [
        "delayed:exact at its own settings",
        *(f"delayed:exact time_step {step:g}" for step in STEPS),
        *(f"delayed:exact {what}" for what, _ in starts),
        "delayed:exact when it starts",
        "delayed:exact default step",
    ]
    assert {task.like for task in tasks} == {made.own.key}
    ((_, rungs),) = made.ladders
    assert [rung.size for rung in rungs] == list(STEPS)
    assert rungs[2].coarser == ((rungs[0].key, STEPS[0]), (rungs[1].key, STEPS[1]))
    assert rungs[1].key == made.own.key, "the rung at its own value is no run of its own"


def test_coarse_rungs_of_every_ladder_come_before_fine_ones(scenario):
    engine = DelayedEngine()
    steps = engine.studies().ladders[0]
    orders = (1, 2, 4)
    other = Ladder(setting="order", unit="", values=orders, engines=tuple(engine.changed(order=x) for x in orders))
    engine.studies = lambda: Studies(ladders=(steps, other))
    rungs = [task for task in plan_variant(engine, scenario, []).tasks() if task.what.split()[-1][0].isdigit()]
    assert [len(task.coarser) for task in rungs] == [0, 0, 1, 1, 2, 2, 3]
    assert [rung.size for rung in plan_variant(engine, scenario, []).ladders[1][1]] == [1.0, 0.5, 0.25]


def test_a_ladder_out_of_order_says_where_to_put_it_in_order(scenario):
    said = (
        "delayed:exact: ladder of time_step: found values .* neither rise nor fall.* put them in order in the adapter's studies"
    )
    with pytest.raises(EngineError, match=said):
        plan_variant(DelayedEngine(steps=(1e-3, 4e-3, 2e-3)), scenario, [])


# ---- a whole variant, its runs made of the closed form


LATENESS = {8e-4: 8e-3, 4e-4: 4e-3, 2e-4: 2e-3, 1e-4: 1e-3}
"""Time step [s] -> delay of its run [s]: of first order, with the reference as its limit."""


@pytest.fixture
def study(goal, scenario, make_run):
    engine = DelayedEngine(other_offset=1e-3)
    starts = changed_starts(scenario)[:2]
    made = plan_variant(engine, scenario, starts)

    def late(seconds):
        return EndedRun(run=make_run(delay=seconds), seconds=1.0)

    done = {task.key: late(LATENESS[task.engine.settings.time_step]) for _, rungs in made.ladders for task in rungs}
    done |= {task.key: late(4e-3 + sign * 1e-3) for (_, task), sign in zip(made.starts, (1, -1), strict=True)}
    done |= {task.key: late(6e-3) for _, task in made.choices}
    return evaluate_variant(made, done, goal, {what: goal for what, _ in starts}, floors(goal)), made


def test_every_part_of_a_study_is_of_its_own_runs(study):
    variant_study, made = study
    assert variant_study.own.halting_time_error == pytest.approx(4e-3, abs=1e-6)
    (ladder_,) = variant_study.ladders
    assert (ladder_.setting, ladder_.unit, ladder_.own) == ("time_step", "s", 4e-4)
    assert [rung.value for rung in ladder_.rungs] == list(STEPS)
    assert [rung.run.halting_time_error for rung in ladder_.rungs] == pytest.approx(list(LATENESS.values()), abs=1e-6)
    assert [rung.to_finest[HALT] for rung in ladder_.rungs] == pytest.approx([7e-3, 3e-3, 1e-3, 0.0], abs=2e-6)
    assert [rung.to_limit[HALT] for rung in ladder_.rungs] == pytest.approx([8e-3, 4e-3, 2e-3, 1e-3], abs=1e-5)
    verdicts = {one.quantity: one for one in ladder_.verdicts}
    assert verdicts[HALT].order == pytest.approx(1.0, abs=1e-2)
    assert {one.rungs for one in ladder_.verdicts} == {4}
    # Own and two changed starts: 4, 5 and 3 ms.
    assert variant_study.spread[HALT] == pytest.approx(1e-3, abs=2e-6)
    assert [one.what for one in variant_study.starts] == ["release angle +0.01 deg", "release angle -0.01 deg"]
    (choice,) = variant_study.choices
    assert (choice.what, choice.ours, choice.other, choice.effect) == ("when it starts", "now", "then", "")
    assert choice.change[HALT] == pytest.approx(2e-3, abs=2e-6)
    (default,) = variant_study.defaults
    assert (default.what, default.ours, default.other, default.effect) == ("step", "0.4 ms", "0.8 ms", "lateness")
    assert default.change[HALT] == pytest.approx(4e-3, abs=2e-6)
    splits = {one.quantity: one for one in variant_study.splits}
    assert list(splits) == list(QUANTITIES)
    assert splits[HALT].numerics == pytest.approx(4e-3, abs=1e-5)
    assert splits[HALT].choice_of == "when it starts: then"
    assert variant_study.provenance.versions == {"pymunk": "7.3"}
    assert variant_study.provenance.settings["time_step"] == 4e-4
    assert variant_study.label == "delayed:exact"


def test_a_study_that_was_interrupted_has_what_there_is(goal, scenario):
    made = plan_variant(DelayedEngine(), scenario, [])
    variant_study = evaluate_variant(made, {}, goal, {}, floors(goal))
    assert variant_study.own.status == "NOT_RUN"
    assert variant_study.splits == ()
    assert variant_study.provenance.versions == {}
    assert {one.kind for one in variant_study.ladders[0].verdicts} == {SequenceKind.UNKNOWN}
    assert {rung.to_finest[HALT] for rung in variant_study.ladders[0].rungs} == {None}
    assert variant_study.spread == dict.fromkeys(QUANTITIES)


def test_what_a_variant_offers_is_run_as_it_says(scenario):
    engine = DelayedEngine()
    other = engine.changed(offset=5e-3)
    engine.studies = lambda: Studies(
        choices=(AdapterChoice(what="c", ours="o", instead="i", engine=other),),
        defaults=(HiddenDefault(setting="d", default="0", ours="1", effect="e", engine=other),),
    )
    made = plan_variant(engine, scenario, [])
    assert made.choices[0][1].engine is made.defaults[0][1].engine is other
    assert (made.ladders, made.starts) == ((), ())
