"""The plan of a convergence study, and the evaluation of a whole variant."""

import math

import pytest

from looping_pendulum.compare.convergence.result import HALT, QUANTITIES, SequenceKind
from looping_pendulum.compare.convergence.study import (
    changed_starts,
    cut_to_watched,
    evaluate_variant,
    floors,
    plan_variant,
)
from looping_pendulum.compare.run_cache import EndedRun
from looping_pendulum.engines.studies import AdapterChoice, HiddenDefault, Ladder, Studies
from looping_pendulum.errors import EngineError
from tests.compare.delayed import STEPS, DelayedEngine

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
