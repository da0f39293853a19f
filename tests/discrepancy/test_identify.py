"""The whole loop on blind data: what was hidden is named with its value, clean data stay clean, files are as promised."""

import contextlib
import dataclasses
import json
import math
import shutil
import time

import jsonschema
import numpy as np
import pytest
from typer.testing import CliRunner

from looping_pendulum.cli import main as cli
from looping_pendulum.discrepancy.evidence.explain import explain
from looping_pendulum.discrepancy.evidence.search import Search
from looping_pendulum.discrepancy.fit.calibration import calibrate
from looping_pendulum.discrepancy.fit.problem import OutOfTime, time_limits
from looping_pendulum.discrepancy.fit.residual import check_held_out
from looping_pendulum.discrepancy.identify import LEAST_RESERVED, OutOfTimeError, identify
from looping_pendulum.discrepancy.inputs import read_inputs
from looping_pendulum.discrepancy.report.writing import write
from looping_pendulum.discrepancy.result import SCHEMA_ID, SCHEMA_VERSION, Identification, Verdict, json_schema
from looping_pendulum.discrepancy.verdict import verdict_by_evidence
from looping_pendulum.measured.study_io import load
from looping_pendulum.scenarios import loader
from tests.blind.cases import CASES, CLEAN, CLEAN_VARIED, with_signature
from tests.compare.conftest import quick_figures  # noqa: F401, a fixture
from tests.discrepancy.blind_study import TWO_RATIOS, WHOLE_LIBRARY, only_candidates, write_study
from tests.discrepancy.expected import EXPECTED, parts_of
from tests.discrepancy.test_likelihood import cost_rise

INDISTINGUISHABLE = {"wrong_gravity", "clock_ratio"}
"""With drag that grows with the square of the speed and friction by the capstan law, gravity only sets the clock."""


def identified(folder, case, seed, **options):
    return identify(load(write_study(folder, CASES[case], seed, **options)))


@pytest.mark.long
@pytest.mark.parametrize("case", [pytest.param(CLEAN, marks=pytest.mark.accurate), CLEAN_VARIED], ids=lambda case: case.name)
def test_nothing_is_added_to_clean_data(tmp_path, case):
    """Daily the harder of the two, with the whole library; of the other, test_events.py has the events with it.

    All four trials of twenty seeds are in `test_null_control`.
    """
    result = identify(load(write_study(tmp_path, case, 5, trials=TWO_RATIOS)))
    assert result.verdict is Verdict.NO_MISSING_EFFECT
    assert not result.effects
    assert all(e.standardised_rms_before == e.standardised_rms_after for e in result.errors)


def assert_named_with_its_value(result, case):
    name, planted = EXPECTED[case]
    assert result.verdict is Verdict.IDENTIFIED
    assert result.names == (name,)
    assert abs(result.effects[0].value - planted) < 3 * result.effects[0].error
    assert all(e.standardised_rms_after <= 1.2 for e in result.errors if e.held_out)
    assert result.explanations[0].probability > 0.95


@pytest.mark.accurate
@pytest.mark.parametrize("case", ["string_thickness", "linear_drag", "side_force", "scale"])
def test_what_was_hidden_is_named_with_its_value(tmp_path, case):
    """Daily with linear drag in three trials, and with the scale in one, in the tests below."""
    assert_named_with_its_value(identified(tmp_path, case, 1), case)


@pytest.mark.accurate  # daily, the listed drag that has its formula is named in the test below
def test_a_declared_term_left_out_is_found(tmp_path):
    result = identified(tmp_path, "clean", 3, undeclared=["light_drag"], trials=TWO_RATIOS)
    assert result.names == ("light_drag",)
    assert abs(result.effects[0].value - 1e-3) < 3 * result.effects[0].error


@pytest.mark.long
@pytest.mark.parametrize(
    "library",
    [
        pytest.param(("scale", "wrong_gravity", "side_stiffness", "clock_offset"), id="rivals"),
        pytest.param(WHOLE_LIBRARY, id="whole_library", marks=pytest.mark.accurate),
    ],
)
def test_one_trial_alone_is_judged_on_its_own_blocks(tmp_path, library):
    """Daily beside those that come nearest of the whole library; linear drag is named from all of it daily, in a test below."""
    with only_candidates(library):
        result = identified(tmp_path, "scale", 1, trials=["ten_a"])
    assert result.names == ("scale",)
    assert result.judged_on == "held-out blocks of time"
    assert abs(result.effects[0].value - EXPECTED["scale"][1]) < 3 * result.effects[0].error


@pytest.mark.long
def test_a_law_of_one_trial_alone_is_judged_on_its_blocks(tmp_path):
    """It was refused, as no held-out trial confirms it, and what resembles it was named."""
    with only_candidates(["friction_per_wrap"]):
        result = identified(tmp_path, "thrust", 1, trials=["ten_a"])
    assert result.verdict is Verdict.UNLISTED, result.sentence
    assert result.judged_on == "held-out blocks of time"
    assert any("All this comes from one trial" in note for note in result.notes)


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(("wrong_gravity", "clock_ratio", "clock_offset", "side_stiffness"), id="rivals"),
        pytest.param(WHOLE_LIBRARY, id="whole_library", marks=pytest.mark.accurate),
    ],
)
def ambiguous(tmp_path_factory, request):
    """One trial and a held-out one, on any planet: more do not tell gravity from the clock either (`test_blind_matrix`).

    Daily beside the two that come next of the whole library.
    """
    with only_candidates(request.param):
        return identified(tmp_path_factory.mktemp("frame_rate"), "frame_rate", 0, trials=["ten_a", "eight"], anywhere=True)


@pytest.mark.accurate  # daily, the tie that it breaks, in the tests of `ambiguous`
def test_gravity_on_earth_decides_for_the_clock(tmp_path):
    """On any planet these data are ambiguous, as the tests of `ambiguous` show."""
    with only_candidates(("wrong_gravity", "clock_ratio", "side_stiffness")):
        result = identified(tmp_path, "frame_rate", 0, trials=["ten_a", "eight"])
    assert_named_with_its_value(result, "frame_rate")
    assert "(wrong_gravity) was ruled out, as gravity on Earth is 9.764 to 9.834 m/s^2" in result.notes[0]


@pytest.mark.long
def test_what_cannot_be_told_apart_is_tied_and_an_experiment_is_named(ambiguous):
    assert ambiguous.verdict is Verdict.AMBIGUOUS
    assert {e.name for tie in ambiguous.ties for e in tie} >= INDISTINGUISHABLE
    assert ambiguous.next_experiments
    best, second = ambiguous.explanations[:2]
    assert best.log10_odds - second.log10_odds < 1


@pytest.mark.long
def test_files_are_as_promised_and_the_same_again(tmp_path, ambiguous):
    report = write(ambiguous, tmp_path / "a").read_text(encoding="utf-8")
    write(ambiguous, tmp_path / "b")
    for file in (p for p in (tmp_path / "a").rglob("*") if p.is_file()):
        assert file.read_bytes() == (tmp_path / "b" / file.relative_to(tmp_path / "a")).read_bytes()
    assert "(`ambiguous`)" in report
    assert all((tmp_path / "a" / part.split(")")[0]).exists() for part in report.split("](")[1:])
    tree = json.loads((tmp_path / "a" / "verdict.json").read_text(encoding="utf-8"))
    assert tree["schema"] == {"id": SCHEMA_ID, "version": SCHEMA_VERSION}
    fields = {f.name for f in dataclasses.fields(Identification) if f.compare}
    assert set(tree) == fields | {"schema"}
    jsonschema.validate(tree, json_schema())
    scenario = loader.load(tmp_path / "a" / "repaired.yaml")
    assert scenario.parameters.coefficients["kinetic_friction"] == pytest.approx(0.34, rel=0.02)


@pytest.mark.accurate  # daily, effects are named behind outliers (test_outliers.py) and in real data (test_real_data.py)
def test_two_trials_leave_only_its_form_open(tmp_path):
    """A drag in proportion to the speed, or another force by the speed: three trials tell them apart."""
    result = identified(tmp_path, "linear_drag", 1, trials=TWO_RATIOS)
    first, *others = [e for e in result.explanations if e.credible]
    assert first.names == ("light_linear_drag",)
    assert first.effects[0].value == pytest.approx(EXPECTED["linear_drag"][1], abs=3 * first.effects[0].error)
    assert {parts_of(e) for e in others} == {(frozenset(), ("light mass", "across_speed"))}


@pytest.mark.long
def test_interrupted_it_leaves_what_it_has(tmp_path):
    def interrupt(what, share):
        if what.startswith("looking"):
            raise KeyboardInterrupt

    with only_candidates(["scale", "tilt"]):  # what is interrupted is the first look beside nothing
        result = identify(load(write_study(tmp_path, CASES["scale"], 1, trials=["ten_a"])), progress=interrupt)
    assert result.verdict is Verdict.INTERRUPTED
    assert result.before.failed_tests or result.correlated_noise  # which stands for what is missing
    assert write(result, tmp_path / "out").exists()


@pytest.mark.long
def test_an_interrupt_while_models_are_judged_costs_nothing_that_was_found(tmp_path, monkeypatch):
    asked = []

    def interrupted_once(*args, **options):
        asked.append(args)
        if len(asked) == 1:
            raise KeyboardInterrupt
        return check_held_out(*args, **options)

    monkeypatch.setattr("looping_pendulum.discrepancy.evidence.explain.check_held_out", interrupted_once)
    with only_candidates(["scale"]):
        result = identify(load(write_study(tmp_path, CASES["scale"], 1, trials=["ten_a"])))
    assert result.verdict is Verdict.INTERRUPTED
    assert result.explanations[0].names == ("scale",)


@pytest.mark.long
def test_a_search_that_is_out_of_time_leaves_what_it_has(tmp_path):
    def is_over_at_the_second_step(what):
        if what != "calibrating":
            steps.append(what)
        if len(steps) == 1:
            out_of_time.enter_context(time_limits(stop=-math.inf))

    steps = []
    with only_candidates(["scale", "tilt"]), contextlib.ExitStack() as out_of_time:
        inputs = read_inputs(load(write_study(tmp_path, CASES["scale"], 1, trials=["ten_a"])))
        found, _ = explain(inputs, report=is_over_at_the_second_step)
    assert verdict_by_evidence(found) is Verdict.INTERRUPTED
    assert steps == ["looking beside nothing"]
    assert set(found.search.fitted) == {frozenset()}, "what is out of time is the first fit of a candidate"


@pytest.mark.long
def test_judging_and_details_end_with_the_time_limit(tmp_path, monkeypatch):
    """A limit of 6 min ended after 9 min 49 s: it was asked between the fits of the search, and by nothing after that.

    The clock stands until the search begins, and then shows that its time is over; from there on it counts this
    process's own time, as other work on the machine would take a share of nobody knows what size of the real one.
    """
    study = load(write_study(tmp_path, CASES["side_force"], 1))
    time_limit, search_is_over = 20.0, []

    def clock():
        return time_limit - LEAST_RESERVED + time.process_time() - search_is_over[0] if search_is_over else 0.0

    def progress(what, share):
        if what.startswith("fitting") and not search_is_over:
            search_is_over.append(time.process_time())

    monkeypatch.setattr(time, "monotonic", clock)
    result = identify(study, time_limit=time_limit, progress=progress)
    assert result.verdict is Verdict.INTERRUPTED
    assert clock() < time_limit
    assert all(effect.interval is None for explanation in result.explanations for effect in explanation.effects)


def test_fits_settle_where_they_are_and_runs_end_when_time_is_over(tmp_path):
    with only_candidates(["scale"]):
        problem = read_inputs(load(write_study(tmp_path, CLEAN, 5, trials=["ten_a"]))).problem()
    with time_limits(settle=-math.inf):
        settled = calibrate(problem)
    assert np.array_equal(settled.x, problem.prior_mean)
    with time_limits(stop=-math.inf):
        for run in (problem.residuals, problem.jacobian, calibrate):
            with pytest.raises(OutOfTime):
                run(problem.prior_mean if run is not calibrate else problem)
    assert calibrate(problem).cost < settled.cost


def test_the_noise_before_is_kept_where_time_ends_as_all_is_fitted_again(tmp_path):
    """Else the fits with another noise, without the declared model's, would be all that is left."""
    with only_candidates(["scale"]):
        inputs = read_inputs(load(write_study(tmp_path, CLEAN, 5, trials=["ten_a"])))
    search = Search(calibrate(inputs.problem()), inputs.library)
    before = dict(search.fitted)
    with time_limits(stop=-math.inf), pytest.raises(OutOfTime):
        search._with_noise_of(search.best)
    assert search.fitted == before


def test_a_search_ends_with_its_time_limit(tmp_path):
    """Before anything is fitted there is nothing to report."""
    study = load(write_study(tmp_path, CLEAN, 5, trials=["ten_a"]))
    with pytest.raises(OutOfTimeError, match=r"^--time-limit: found no fit of the declared model within 1e-09 s; check"):
        identify(study, time_limit=1e-9)


@pytest.mark.usefixtures("quick_figures")
def test_command_line(tmp_path):
    path = write_study(tmp_path, CLEAN, 5, trials=["ten_a"])
    for out in ("out", "again"):
        with only_candidates(["light_linear_drag", "static_friction", "scale"]):
            done = CliRunner().invoke(cli.app, ["identify", str(path), "--out", str(tmp_path / out), "--seed", "3"])
        assert done.exit_code == 0, done.output
        assert "no_missing_effect" in done.output
    for file in ("report.md", "report.html", "verdict.json", "repaired.yaml"):
        assert (tmp_path / "out" / file).read_bytes() == (tmp_path / "again" / file).read_bytes()


@pytest.mark.accurate
@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("case", [CLEAN, CLEAN_VARIED], ids=lambda case: case.name)
def test_null_control(tmp_path, case, seed):
    assert not identify(load(write_study(tmp_path, case, seed))).effects


@pytest.mark.long
def test_what_does_not_predict_the_held_out_trial_is_not_said_to_explain(tmp_path):
    """A side force acts on all trials but the held-out one."""
    path = write_study(tmp_path, CASES["side_force"], 1, trials=TWO_RATIOS)
    without = write_study(tmp_path / "without", CLEAN, 1, trials=TWO_RATIOS)
    shutil.copy(without.with_name("eight.csv"), path.with_name("eight.csv"))
    result = identify(load(path))
    assert result.verdict is Verdict.UNEXPLAINED
    assert not result.effects
    (reason,) = result.after.failed_tests
    assert (
        reason == "with what the other trials say of it, the held-out trial eight is less probable than by the declared model"
    )
    assert reason in result.sentence
    assert "Added to what was declared: nothing." in loader.load_text(result.scenario, "repaired").description
    assert "looks like noise" not in result.sentence


def right_effect(result, case):
    """The planted effect as the result tells it, alone or as one of those that are tied; None: it is not among them."""
    explanations = result.ties or (result.effects,)
    return next((tie[0] for tie in explanations if [e.name for e in tie] == [EXPECTED[case][0]]), None)


def standard_errors_off(study, effect, planted):
    """Distance to the planted value; beyond three standard errors by the rise of the cost, which tells it of curved models."""
    off = abs(effect.value - planted) / effect.error
    if off < 3:
        return off
    found, _ = explain(read_inputs(study))
    fit = next(found.fit(e) for e in found.ranked if e.key == {effect.name})
    return math.sqrt(max(cost_rise(fit, effect.name, planted), 0.0))


@pytest.mark.accurate
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("case", sorted(EXPECTED))
def test_blind_matrix(tmp_path, case, seed):
    study = load(write_study(tmp_path, CASES[case], seed, trials=TWO_RATIOS))
    result = identify(study)
    right = right_effect(result, case)
    assert right is not None, f"{result.verdict}: {result.names}"
    assert all(e.standardised_rms_after <= 1.2 for e in result.errors if e.held_out)
    assert standard_errors_off(study, right, EXPECTED[case][1]) < 3


TWO_AT_ONCE = {
    "drag_and_thickness": {"light_linear_drag", "string_thickness"},
    "speed_and_side_force": {"friction_per_speed", "side_force"},
}


@pytest.mark.accurate
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("case", sorted(TWO_AT_ONCE))
def test_two_effects_at_once_are_named_or_tied(tmp_path, case, seed):
    result = identified(tmp_path, case, seed)
    assert TWO_AT_ONCE[case] in [{e.name for e in tie} for tie in result.ties or (result.effects,)]


@pytest.mark.accurate
def test_half_of_what_moves_the_light_mass_by_3_mm_is_named(tmp_path):
    is_named = {}
    for case in sorted(EXPECTED):
        small = with_signature(CASES[case], 3e-3)
        result = identify(load(write_study(tmp_path / case, small, 1, trials=TWO_RATIOS)))
        is_named[case] = right_effect(result, case) is not None
    assert sum(is_named.values()) >= len(is_named) / 2, is_named
