"""From runs to errors and from errors to sentences: every number is chosen, and every part is another one."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest

from looping_pendulum.compare.convergence.limit import Limit
from looping_pendulum.compare.convergence.result import DROP, HALT, PATH_END_TIMES, QUANTITIES, Verdict
from looping_pendulum.compare.convergence.study import (
    LEAST_NOISE,
    MeasuredLadder,
    MeasuredRun,
    change,
    changed_starts,
    cut_to_watched,
    evaluate_variant,
    measure_run,
    plan_variant,
    reference_target,
    refined_further_by,
)
from looping_pendulum.compare.convergence.verdict import ladder_verdict, variant_verdict, verdict_of
from looping_pendulum.engines.studies import Ladder, Studies, Variation
from looping_pendulum.errors import EngineError
from looping_pendulum.runs.trajectory import RunStatus
from tests.compare.delayed import STEPS, DelayedEngine

EARLY, LATE = PATH_END_TIMES


def shifted(goal, halt=0.0, drop=0.0):
    known = {HALT: (halt, goal.numbers[HALT]), DROP: (drop, goal.numbers[DROP])}
    numbers = {name: None if off is None else value + off for name, (off, value) in known.items()}
    return dataclasses.replace(goal, numbers=numbers)


def test_a_target_has_the_halt_that_its_samples_give(goal, closed_form):
    made = reference_target(goal.scenario, goal.reference)
    assert made.numbers[HALT] == pytest.approx(closed_form.halt, abs=1e-8)
    assert made.numbers[DROP] == pytest.approx(closed_form.drop, abs=5e-6)


# ---- one run


def test_a_run_that_was_not_made_has_no_errors_and_says_why(goal):
    run = measure_run("key", None, goal)
    assert (run.summary.key, run.summary.ok, run.summary.status) == ("key", False, "NOT_RUN")
    assert run.summary.why == "not run: a coarser rung reached the time limit, or the study was interrupted"
    assert run.errors == {}
    assert run.summary.errors == dict.fromkeys(QUANTITIES)


def test_the_errors_of_a_late_run_are_later_minus_the_reference(goal, make_run, closed_form):
    run = measure_run("key", make_run(delay=3e-3, shift=(3e-3, 4e-3)), goal)
    s = run.summary
    assert s.errors[HALT] == pytest.approx(3e-3, abs=1e-6)
    assert s.halting_time == pytest.approx(closed_form.halt + 3e-3, abs=1e-6)
    assert s.errors[DROP] == pytest.approx(0.0, abs=1e-5)
    assert (s.status, s.ok, s.why) == ("FINISHED", True, RunStatus.FINISHED.value)
    assert float(run.errors[HALT][0, 0]) == s.errors[HALT]
    assert {name: len(run.errors[name]) for name in PATH_END_TIMES} == {EARLY: 351, LATE: 701}
    still = measure_run("key", make_run(shift=(3e-3, 4e-3)), goal)
    assert {name: still.summary.errors[name] for name in PATH_END_TIMES} == dict.fromkeys(PATH_END_TIMES, pytest.approx(5e-3))
    np.testing.assert_allclose(still.errors[LATE], np.tile([3e-3, 4e-3], (701, 1)))


def test_a_run_that_broke_off_has_no_halt_and_its_last_words(goal, make_run):
    run = measure_run("key", make_run(until=0.5, status=RunStatus.CRASHED, message="first\nlast words\n"), goal)
    assert run.summary.why == f"{RunStatus.CRASHED.value}: last words"
    assert (run.summary.ok, run.summary.status, run.summary.halting_time) == (False, "CRASHED", None)
    assert {name: len(error) for name, error in run.errors.items()} == {EARLY: 351}


def test_where_the_reference_does_not_halt_a_halt_has_no_error(goal, make_run):
    run = measure_run("key", make_run(), shifted(goal, halt=None, drop=None))
    assert run.summary.halting_time is not None
    assert (run.summary.errors[HALT], run.summary.errors[DROP]) == (None, None)
    assert run.errors.keys() == PATH_END_TIMES.keys()


def errors(early=None, late=None, halt=None, drop=None):
    numbers = {HALT: halt, DROP: drop}
    made = {name: np.array([[float(value)]]) for name, value in numbers.items() if value is not None}
    paths = {EARLY: early, LATE: late}
    return made | {name: np.tile([value, 0.0], (3, 1)) for name, value in paths.items() if value is not None}


def measured(key="x", ended=True, **values):
    return MeasuredRun(errors=errors(**values), summary=SimpleNamespace(key=key, ok=ended))


def test_a_path_moves_by_a_distance_and_a_number_with_its_sign():
    of, to = errors(early=2e-3, halt=5e-3), errors(early=-1e-3, halt=2e-3)
    assert change(EARLY, of, to) == pytest.approx(3e-3)
    assert change(HALT, of, to) == pytest.approx(-3e-3)
    assert change(DROP, of, to) is None
    assert change(HALT, errors(), to) is None
    assert change(HALT, to, errors()) is None


# ---- what a limit means


@pytest.mark.parametrize(
    ("to_limit", "limit_error", "uncertainty", "verdict"),
    [
        (1.0, 1.0, 1.0, Verdict.CONVERGED),
        (1.1, 1.0, 1.0, Verdict.NOT_CONVERGED),
        (1.0, 1.0, 1.1, Verdict.NOT_CONVERGED),
        (0.0, 1.1, 1.0, Verdict.ANOTHER_LIMIT),
        (9.0, 2.1, 2.0, Verdict.ANOTHER_LIMIT),
        (0.0, 2.0, 2.0, Verdict.NOT_CONVERGED),
        (0.0, 0.9, 0.1, Verdict.CONVERGED),
    ],
)
def test_the_three_verdicts_at_a_resolution_of_one(to_limit, limit_error, uncertainty, verdict):
    assert verdict_of(to_limit, limit_error, uncertainty, 1.0) is verdict


def number(value):
    return np.array([[value]])


STEPS_LADDER = Ladder("step", "s", (4e-3, 2e-3, 1e-3))


@pytest.mark.parametrize(
    ("halts", "limit", "said"),
    [
        ((4e-4, 8e-5, 5e-5), (5e-5, 2e-5, 1.234),
         "converged: its limit (order 1.2) is 0.05 ± 0.02 ms from the reference; 2 ms is fine enough"),
        ((4e-4, 8e-5, 5e-5), (5e-5, 2e-5, None),
         "converged: its limit is 0.05 ± 0.02 ms from the reference; 2 ms is fine enough"),
        ((9e-3, 7e-3, 6e-3), (-5e-3, 1e-3, None),
         "another limit: its limit is 5 ± 1 ms from the reference; "
         "refine the other settings, or look for the cause in the model"),
        ((9e-3, 5e-3, 3e-3), (1e-3, 2e-3, None),
         "not converged: its limit is 1 ± 2 ms from the reference, 2 ms from the finest rung; add finer rungs"),
        ((9e-3, 3e-3, 3e-3), (3e-3, 4e-3, None),
         "not converged: its limit is 3 ± 4 ms from the reference, as well as the noise of single runs lets it be known; "
         "average several starts"),
        ((9e-3, -1e-3, 3e-3), None,
         "not converged: the finest rung is 6 ms and 4 ms from those before it; add finer rungs, or refine other settings too"),
        ((9e-3, None, 3e-3), None, "not converged: 2 of 3 rungs have a value; see the remarks of the others"),
    ],
)  # fmt: skip
def test_the_sentence_of_a_ladder_says_what_to_do(halts, limit, said):
    errors = [None if halt is None else number(halt) for halt in halts]
    made = None if limit is None else Limit(value=number(limit[0]), uncertainty=limit[1], order=limit[2])
    verdict = ladder_verdict(HALT, STEPS_LADDER, errors, made, (number(-3e-3), None))
    assert verdict.sentence == said
    assert verdict.refinement == pytest.approx(3e-3)
    assert (verdict.limit_error, verdict.uncertainty) == (None, None) if limit is None else limit[:2]
    assert verdict.sentence.startswith(f"{verdict.verdict}: ")


def test_a_path_has_a_limit_at_a_distance():
    path = np.tile([3e-3, -4e-3], (7, 1))
    verdict = ladder_verdict(EARLY, STEPS_LADDER, [path] * 3, Limit(value=path, uncertainty=1e-3), None)
    assert (verdict.verdict, verdict.refinement) == (Verdict.ANOTHER_LIMIT, None)
    assert verdict.limit_error == pytest.approx(5e-3)
    assert "5 ± 1 mm" in verdict.sentence


# ---- what all ladders of a variant say together


@pytest.mark.parametrize(
    ("own", "refinements", "choices", "noise", "said"),
    [
        (5e-5, {"a": (-3e-5, 1e-5)}, {}, 1e-6,
         "converged: all ladders together lead to 0.02 ± 0.01 ms from the reference; "
         "its own settings are fine enough for 0.1 ms"),
        (5e-3, {"a": (-1e-3, 1e-5), "b": (-2e-3, 1e-5)}, {"x: y": 1e-3}, 1e-6,
         "another limit: all ladders together lead to 2 ± 0.014 ms from the reference; "
         "take a variant with another model"),
        (5e-3, {"a": (-1e-3, 1e-5), "b": (-2e-3, 1e-5)}, {"u: v": None, "x: y": -2.1e-3}, 1e-6,
         "another limit: all ladders together lead to 2 ± 0.014 ms from the reference; try the other choice, x: y"),
        (5e-3, {"a": (-1e-3, 1e-5), "b": (-4e-3, 3e-3)}, {}, 1e-6,
         "not converged: all ladders together lead to 0 ± 3 ms from the reference; refine b further, which changes it by 4 ms"),
        (1e-3, {"a": (-1e-3, 1e-3)}, {}, 1e-3,
         "not converged: all ladders together lead to 0 ± 2.2 ms from the reference; "
         "small changes of the start move it by as much: average several starts"),
        (5e-3, {"a": (-1e-3, 1e-5), "b": (-4e-3, None)}, {}, 1e-6,
         "not converged: no limit along b; refine b further, which changes it by 4 ms"),
        (5e-3, {"a": (0.0, None)}, {}, 1e-6, "not converged: no limit along a; see its rungs"),
        (5e-3, {}, {}, 1e-6,
         "not converged: the adapter offers no ladder with a value (studies(), in docs/write-an-engine.md)"),
        (None, {}, {}, 1e-6,
         "not converged: its run at its own settings broke off or never halts; take another profile or variant"),
    ],
)  # fmt: skip
def test_the_sentence_of_a_variant_says_what_to_do(own, refinements, choices, noise, said):
    made = {setting: (number(change), half_width) for setting, (change, half_width) in refinements.items()}
    verdict = variant_verdict(HALT, None if own is None else number(own), made, choices, noise)
    assert verdict.sentence == said
    assert verdict.refinement == max((abs(change) for change, _ in refinements.values()), default=None)


def test_the_changes_of_all_ladders_add_up_to_one_limit():
    made = {"a": (number(-1e-3), 3e-5), "b": (number(-2e-3), 4e-5)}
    verdict = variant_verdict(HALT, number(5e-3), made, {}, 6e-5)
    assert verdict.limit_error == pytest.approx(2e-3)
    assert verdict.uncertainty == pytest.approx(math.hypot(3e-5, 4e-5, 2 * 6e-5))


# ---- ladders that act on one another


def ladder(setting, values, **taken):
    """A ladder of ``setting``; ``taken``: other settings that it takes along, their values rung by rung."""
    return Ladder(setting, "", [{setting: v, **{name: x[k] for name, x in taken.items()}} for k, v in enumerate(values)])


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
        ((4, 2, 1), ("coarse", "fine", "finest"), False),
    ],
)
def test_a_ladder_is_refined_further_by_one_that_takes_its_setting_as_far(values, taken, inside):
    small, large = ladder("a", values), ladder("b", (9, 8, 7), a=taken)
    assert [refined_further_by(k, [small, large]) for k in (0, 1)] == ["b" if inside else "", ""]
    assert [refined_further_by(k, [large, small]) for k in (0, 1)] == ["", "b" if inside else ""]
    assert not refined_further_by(0, [small])
    assert not refined_further_by(0, [small, ladder("b", ())])


def test_of_two_that_take_each_other_along_the_first_counts():
    one, other = ladder("a", (4, 2, 1), b=(4, 2, 1)), ladder("b", (4, 2, 1), a=(4, 2, 1))
    assert [refined_further_by(k, [one, other]) for k in (0, 1)] == ["", "a"]
    assert [refined_further_by(k, [other, one]) for k in (0, 1)] == ["", "b"]


def measured_ladder(halts, own=None, ended=None):
    rungs = tuple(measured(halt=halt, ended=good) for halt, good in zip(halts, ended or [True] * len(halts), strict=True))
    values = tuple(8.0 / 2**k for k in range(len(halts)))
    made = Ladder("a", "", values)
    return MeasuredLadder(ladder=made, own=own, refined_further_by="", rungs=rungs, noise=LEAST_NOISE)


HALVING = (9e-3, 5e-3, 3e-3, 2e-3)
"""Halting errors [s] that halve with the setting, down to 1 ms."""


def test_a_refinement_leads_from_the_variants_own_value_to_the_limit():
    own = errors(halt=6e-3)
    (change_,), half_width = measured_ladder(HALVING).refinement(HALT, own)
    assert float(change_[0]) == pytest.approx(-5e-3, abs=1e-6)
    assert half_width == pytest.approx(0.25e-3, rel=0.01), "a quarter of the finest rung's distance from the limit"
    # Its own value among the rungs, which may be another run (another rule for all else): from that rung.
    assert float(measured_ladder(HALVING, own=4.0 * (1 + 1e-12)).refinement(HALT, own)[0][0, 0]) == pytest.approx(
        -4e-3, abs=1e-6
    )
    assert float(measured_ladder(HALVING, own=3.0).refinement(HALT, own)[0][0, 0]) == pytest.approx(-5e-3, abs=1e-6)


def test_without_a_limit_a_refinement_leads_to_the_finest_rung():
    change_, half_width = measured_ladder((9e-3, 1e-3, 8e-3, 2e-3)).refinement(HALT, errors(halt=6e-3))
    assert (float(change_[0, 0]), half_width) == (pytest.approx(-4e-3), None)
    assert measured_ladder(HALVING).refinement(HALT, errors(early=1.0)) is None
    assert measured_ladder((None,) * 3).refinement(HALT, errors(halt=6e-3)) is None
    assert measured_ladder((9e-3, None, 3e-3), own=4.0).refinement(HALT, errors(halt=6e-3)) is None


def test_a_halt_that_some_rungs_lack_has_no_limit():
    """A value that comes and goes with the setting has none, however well the others agree; one that broke off may lack it."""
    halts = (17e-3, None, *HALVING)
    assert measured_ladder(halts).limit(HALT) is None
    limit = measured_ladder(halts, ended=(True, False, True, True, True, True)).limit(HALT)
    assert limit.value[0, 0] != pytest.approx(0.0)


def test_a_rung_without_the_quantity_is_left_out_of_its_ladder():
    # Of five rungs the second broke off: the others still halve their error with their step, up to rounding.
    ladder_ = measured_ladder((17e-3, None, 5e-3, 3e-3, 2e-3), ended=(True, False, True, True, True))
    limit = ladder_.limit(HALT)
    assert limit.order == pytest.approx(1.0, abs=1e-3)
    study = ladder_.study(errors(halt=3e-3))
    assert [rung.to_limit[HALT] for rung in study.rungs] == [
        pytest.approx(16e-3, abs=1e-6), None, pytest.approx(4e-3, abs=1e-6),
        pytest.approx(2e-3, abs=1e-6), pytest.approx(1e-3, abs=1e-6),
    ]  # fmt: skip
    verdicts = {one.quantity: one for one in study.verdicts}
    assert list(verdicts) == list(QUANTITIES)
    assert verdicts[HALT].verdict is Verdict.ANOTHER_LIMIT
    assert "0 of 5 rungs have a value" in verdicts[DROP].sentence


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


def test_the_plan_runs_coarse_rungs_before_fine_ones(scenario):
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
    ((_, rungs),) = made.ladders
    assert rungs[2].coarser == (rungs[0].key, rungs[1].key)
    assert rungs[1].key == made.own.key, "the rung at its own value is no run of its own"


def test_coarse_rungs_of_every_ladder_come_before_fine_ones(scenario):
    engine = DelayedEngine()
    steps = engine.studies().ladders[0]
    orders = (1, 2, 4)
    other = Ladder("order", "", orders)
    engine.studies = lambda: Studies(ladders=(steps, other))
    rungs = [task for task in plan_variant(engine, scenario, []).tasks() if task.what.split()[-1][0].isdigit()]
    assert [len(task.coarser) for task in rungs] == [0, 0, 1, 1, 2, 2, 3]


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

    runs = {task.key: make_run(delay=LATENESS[task.engine.settings.time_step]) for _, rungs in made.ladders for task in rungs}
    runs |= {task.key: make_run(delay=4e-3 + sign * 1e-3) for (_, task), sign in zip(made.starts, (1, -1), strict=True)}
    runs |= {task.key: make_run(delay=6e-3) for _, task in made.choices}
    return evaluate_variant(made, runs, goal, {what: goal for what, _ in starts})


def test_every_part_of_a_study_is_of_its_own_runs(study):
    assert study.own.errors[HALT] == pytest.approx(4e-3, abs=1e-6)
    (ladder_,) = study.ladders
    assert (ladder_.setting, ladder_.unit, ladder_.own) == ("time_step", "s", 4e-4)
    assert [rung.value for rung in ladder_.rungs] == list(STEPS)
    assert [rung.run.errors[HALT] for rung in ladder_.rungs] == pytest.approx(list(LATENESS.values()), abs=1e-6)
    assert {one.quantity: one.refinement for one in ladder_.verdicts}[HALT] == pytest.approx(4e-3, abs=1e-5)
    # Own and two changed starts: 4, 5 and 3 ms
    assert study.spread[HALT] == pytest.approx(1e-3, abs=2e-6)
    assert [rung.to_limit[HALT] for rung in ladder_.rungs] == pytest.approx([8e-3, 4e-3, 2e-3, 1e-3], abs=1e-5)
    (choice,) = study.choices
    assert (choice.what, choice.ours, choice.other, choice.effect) == ("when it starts", "now", "then", "")
    assert choice.change[HALT] == pytest.approx(2e-3, abs=2e-6)
    assert study.choice(HALT) == abs(choice.change[HALT])
    (default,) = study.defaults
    assert (default.what, default.ours, default.other, default.effect) == ("step", "0.4 ms", "0.8 ms", "lateness")
    assert default.change[HALT] == pytest.approx(4e-3, abs=2e-6)
    verdicts = {one.quantity: one for one in study.verdicts}
    assert list(verdicts) == list(QUANTITIES)
    assert verdicts[HALT].verdict is Verdict.NOT_CONVERGED, "noise of 1 ms"
    assert study.provenance.versions == {"pymunk": "7.3"}
    assert study.provenance.settings["time_step"] == 4e-4
    assert study.label == "delayed:exact"
    assert (len(study.ladders[0].rungs), len(study.choices), len(study.defaults)) == (4, 1, 1)


def test_a_study_that_was_interrupted_has_what_there_is(goal, scenario):
    study = evaluate_variant(plan_variant(DelayedEngine(), scenario, []), {}, goal, {})
    assert study.own.status == "NOT_RUN"
    assert study.provenance.versions == {}
    assert {one.verdict for one in (*study.verdicts, *study.ladders[0].verdicts)} == {Verdict.NOT_CONVERGED}
    assert {rung.to_limit[HALT] for rung in study.ladders[0].rungs} == {None}
    assert study.spread == dict.fromkeys(QUANTITIES)


def test_what_the_reference_does_not_have_is_not_judged(goal, scenario):
    short = dataclasses.replace(shifted(goal, halt=None), scenario=dataclasses.replace(scenario, duration=0.5))
    study = evaluate_variant(plan_variant(DelayedEngine(), short.scenario, []), {}, short, {})
    assert [one.quantity for one in study.verdicts] == [EARLY, DROP]


def test_what_a_variant_offers_is_run_as_it_says(scenario):
    engine = DelayedEngine()
    other = {"offset": 5e-3}
    engine.studies = lambda: Studies(
        choices=(Variation("c", "o", "i", other),), defaults=(Variation("d", "1", "0", other, "e"),)
    )
    made = plan_variant(engine, scenario, [])
    assert made.choices[0][1].engine.settings == made.defaults[0][1].engine.settings == DelayedEngine(**other).settings
    assert (made.ladders, made.starts) == ((), ())
