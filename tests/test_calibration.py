"""Benchmarks on blind studies: rates and bounds by hand, seeds, kept results, and one study from end to end."""

import argparse
import dataclasses
import json
import math
from types import SimpleNamespace

import pytest

from benchmarks import blind_sample, calibration, hidden_laws, known_answer, rates_page, rivals
from benchmarks.blind_sample import SIZES, BlindStudy, case_of, draw, planted_values
from benchmarks.calibration import NOTHING, judgement, outcome_of, truth, visibility
from benchmarks.calibration_summary import TARGETS, Target, proportion, summary, with_upper_bound
from benchmarks.rivals import Rival
from looping_pendulum.discrepancy.evidence.prior import VISIBLE
from looping_pendulum.discrepancy.fit import residual
from looping_pendulum.discrepancy.result import NORMAL_95, IdentifiedEffect, RankedExplanation, UnlistedLaw, Verdict
from looping_pendulum.reference_ode.effects import EFFECTS, Kinematics
from tests.blind import Apparatus, Effects
from tests.blind.cases import CASES, UNLISTED, signature
from tests.blind.simulator import _light_force
from tests.discrepancy.expected import DECISIVE, EXPECTED

STORED = json.loads(calibration.RESULT.read_text(encoding="utf-8"))
DRAG, WIND = frozenset({"light_linear_drag"}), frozenset({"wind_speed"})
THRUST, BRAKE = ("light mass", "time"), ("heavy mass", "hanging_length")


def test_upper_bound_of_none_of_n_is_the_root_of_five_per_cent():
    # Oracle: with rate p, none of n happens with probability (1 - p)^n, which is 5 % at the bound.
    assert with_upper_bound(0, 300)["upper_bound"] == pytest.approx(1 - 0.05 ** (1 / 300))
    assert proportion(0, 20)["interval"] == [0.0, pytest.approx(1 - 0.025 ** (1 / 20))]
    assert proportion(20, 20)["interval"] == [pytest.approx(0.025 ** (1 / 20)), 1.0]
    assert proportion(0, 0)["share"] is None
    assert rates_page.bounded(with_upper_bound(0, 0)) == "-"


def outcome(judgement, *, within=(), seconds=1.0, **more):
    estimates = [{"within": w} for w in within]
    return {
        "judgement": judgement,
        "verdict": "identified",
        "law": None,
        "probabilities": [],
        "credible_holds_truth": judgement in ("right", "tied"),
        "estimates": estimates,
        "cpu_seconds": seconds,
        "held_out_error": 1.0,
        "visibility": None,
        **more,
    }


def test_summary_of_made_up_outcomes():
    clean, single = draw("rates", "clean", 4, 0), draw("rates", "single", 3, 0)
    single = [dataclasses.replace(s, size=8e-3, hidden=("wind",)) for s in single]
    statistics = [{"lag1_z": 1.0, "ljung_box_p": 0.5}, {"lag1_z": 2.0, "ljung_box_p": 0.1}]
    outcomes = [
        outcome("right", seconds=1.0, statistics=statistics[0]),
        outcome("none", seconds=2.0),
        outcome("wrong", seconds=3.0, statistics=statistics[1]),
        outcome("right", seconds=4.0),
        outcome("right", within=[True], seconds=5.0, visibility=3.0),
        outcome("tied", within=[False], seconds=6.0, visibility=1.0),
        {"unreachable": "no scale"},
    ]
    result = summary(list(zip([*clean, *single], outcomes, strict=True)))
    assert (result["studies"], result["unreachable"], result["failed"]) == (6, 1, 0)
    assert (result["clean"]["all"]["false_additions"]["count"], result["clean"]["all"]["unexplained"]["count"]) == (1, 1)
    # the kinds of noise alternate: white, wander, outliers, white
    assert result["clean"]["outliers"]["false_additions"]["share"] == 1.0
    assert result["clean"]["wander"]["unexplained"]["share"] == 1.0
    assert result["single"]["by_effect"]["wind"]["0.008"]["named_or_tied"]["count"] == 2
    assert result["single"]["by_size"]["0.008"]["named"]["count"] == 1
    visible = result["single"]["by_visibility"]
    assert {size: row["named_or_tied"]["count"] for size, row in visible.items()} == {"1 to 2": 1, "above 2": 1}
    assert visible["1 to 2"]["named"]["count"] == 0
    assert (result["coverage"]["count"], result["coverage"]["of"]) == (1, 2)
    assert result["single"]["each"][1] == {
        "effect": "wind",
        "size": 8e-3,
        "visibility": 1.0,
        "judgement": "tied",
        "covered": False,
    }
    assert result["two_by_visibility"] == result["unlisted_by_size"] == {}
    assert result["cpu_seconds"]["0.5"] == 3.5
    assert result["cpu_seconds"]["largest"] == 6.0
    assert result["statistics"]["lag1_z"]["extreme"] == 2.0
    # two right ones are no discoveries, as nothing is missing there
    assert (result["false_discoveries"]["count"], result["false_discoveries"]["of"]) == (1, 3)
    assert result["large"]["single"]["of"] == 0
    assert result["statistics"]["ljung_box_p"]["extreme"] == 0.1, "of p values the smallest speaks against noise"


def test_pairs_are_counted_by_visibility_and_unlisted_forces_by_size():
    two = [dataclasses.replace(s, hidden=("wind", "push"), size=8e-3) for s in draw("rates", "two", 3, 0)]
    unlisted = [dataclasses.replace(s, hidden=("magnet",), size=16e-3) for s in draw("rates", "unlisted", 2, 0)]
    outcomes = [
        outcome("right", visibility=4.0),
        outcome("part", visibility=3.0),
        outcome("part", visibility=0.2),
        outcome("tied", verdict="unlisted", law=["light mass", "free_length"]),
        outcome("wrong"),
    ]
    result = summary(list(zip([*two, *unlisted], outcomes, strict=True)))
    visible = result["two_by_visibility"]
    assert list(visible) == ["below 0.5", "above 2"]
    assert (visible["above 2"]["named_or_tied"]["count"], visible["above 2"]["part"]["count"]) == (1, 1)
    assert (visible["below 0.5"]["part"]["count"], visible["below 0.5"]["part"]["of"]) == (1, 1)
    large = result["large"]
    assert (large["unlisted_law_of_found"]["count"], large["unlisted_law_not_excluded"]["count"]) == (0, 1)
    sizes = result["unlisted_by_size"]["0.016"]
    assert (sizes["named_or_tied"]["count"], sizes["wrong"]["count"], sizes["named"]["of"]) == (1, 1, 2)
    assert (result["unlisted_verdict"]["count"], result["unlisted_verdict"]["of"]) == (1, 2)


def test_probabilities_are_compared_with_how_often_they_are_right():
    studies = draw("rates", "single", 3, 0)
    likely, rival, certain = (
        (["wind_speed"], None, 0.9, True),
        (["tilt"], None, 0.1, False),
        ([], ["light mass", "time"], 1.0, False),
    )
    nothing = ([], None, 0.9, False)
    outcomes = [
        outcome("right", visibility=3.0, probabilities=[likely, rival]),
        outcome("none", visibility=1.0, probabilities=[nothing, rival]),  # too small to be asked for
        outcome("wrong", visibility=2.0, probabilities=[certain]),
    ]
    result = summary(list(zip(studies, outcomes, strict=True)))
    stated = {
        name: (row["mean"], row["at_most_one"]["count"], row["at_most_one"]["of"], row["more"]["of"])
        for name, row in result["stated_probabilities"].items()
    }
    assert stated == {"0.05 to 0.2": (0.1, 0, 2, 0), "0.8 to 0.95": (0.9, 1, 1, 0), "0.99 to 1": (1.0, 0, 1, 0)}
    assert (result["credible_holds_truth"]["count"], result["credible_holds_truth"]["of"]) == (1, 2)


def test_the_printed_tables_have_rates_and_probabilities():
    study = dataclasses.replace(draw("rates", "mixed", 1, 0)[0], hidden=("linear_drag", "brake"), size=16e-3)
    said = outcome("law", probabilities=[(["light_linear_drag"], list(THRUST), 0.97, False)])
    measured = {"command": "", "measured_on": "", "summary": summary([(study, said)])}
    lines = rates_page.block(measured).splitlines()
    assert any("the effect beside another force" in line and "1 of 1" in line for line in lines)
    assert any("0.95 to 0.99" in line and "0.97" in line and "0 of 1" in line for line in lines)


@pytest.mark.parametrize(
    ("hidden", "law", "right"),
    [("brake", BRAKE, True), ("brake", ("light mass", "hanging_length"), False), ("thrust", THRUST, True)],
)
def test_a_law_is_as_planted_if_body_and_coordinate_are(hidden, law, right):
    study = dataclasses.replace(draw("rates", "unlisted", 1, 0)[0], hidden=(hidden,))
    pairs = [(study, outcome("right", verdict="unlisted", law=list(law))), (study, outcome("none", verdict="unexplained"))]
    result = summary(pairs)
    assert (result["unlisted_law"]["count"], result["unlisted_law"]["of"]) == (right, 2)
    assert (result["unlisted_law_of_found"]["count"], result["unlisted_law_of_found"]["of"]) == (right, 1)


def ranked(effects=(), law=None, probability=1.0, credible=True):
    return RankedExplanation(effects=tuple(effects), law=law, probability=probability, log10_odds=0.0, credible=credible)


def effect(name, value=1.9, interval=None):
    return IdentifiedEffect(
        **dict.fromkeys(("kind", "acts_on", "formula", "source", "parameter", "meaning", "unit"), ""),
        depends_on=(), companions=(), name=name, value=value, error=9.0, interval=interval, null_value=0.0,
    )  # fmt: skip


def result_with(*explanations, verdict=Verdict.AMBIGUOUS, smallest_visible=()):
    drag = SimpleNamespace(name="light_drag", value=2e-4, measured=1e-3)
    return SimpleNamespace(
        verdict=verdict,
        names=(),
        explanations=explanations,
        credible=tuple(e for e in explanations if e.credible),
        smallest_visible=smallest_visible,
        before=SimpleNamespace(parameters=[drag]),
        errors=[SimpleNamespace(held_out=True, standardised_rms_after=1.0)],
        correlated_noise=(),
    )


def test_an_outcome_adds_the_probabilities_of_laws_of_one_body_and_coordinate():
    """In which direction a law acts, and by which speed it is multiplied, is left out."""
    drag = effect("light_linear_drag")
    found = (
        ranked([drag], UnlistedLaw(acts_on="light mass", depends_on="time"), 0.5),
        ranked(
            [drag], UnlistedLaw(acts_on="light mass, across the string", depends_on="time", multiplied_by="retreat_speed"), 0.3
        ),
        ranked([effect("wind_speed")], None, 0.18),
        ranked([], None, 0.02, credible=False),
        ranked([effect("tilt")], None, None, credible=False),
    )
    planted = {"light_linear_drag": 2.0}
    said = outcome_of(result_with(*found), planted, (DRAG, THRUST))
    assert (said["judgement"], said["law"], said["credible_holds_truth"]) == ("tied", list(THRUST), True)
    assert said["explanations"] == [[["light_linear_drag"], list(THRUST)], [["wind_speed"], None]]
    assert said["probabilities"] == [
        [["light_linear_drag"], list(THRUST), 0.8, True],
        [["wind_speed"], None, 0.18, False],
        [[], None, 0.02, False],
    ]
    assert [e["planted"] for e in said["estimates"]] == [2.0]
    said = outcome_of(result_with(*found, verdict=Verdict.UNEXPLAINED), planted, (DRAG, THRUST))
    assert (said["judgement"], said["explanations"], said["estimates"]) == ("none", [], [])


def test_visibility_is_that_of_the_effect_that_hides_best():
    named = ranked([effect("wind_speed", interval=(1.9 - 0.1 * NORMAL_95, None))])
    hidden = SimpleNamespace(name="scale", value=0.02, null_value=1.0)
    result = result_with(named, verdict=Verdict.IDENTIFIED, smallest_visible=(hidden,))
    assert visibility(result, {"wind_speed": 2.0}) == pytest.approx(2.0 / (0.1 * VISIBLE))
    assert visibility(result, {"wind_speed": 2.0, "scale": 0.99}) == pytest.approx(0.5)
    assert visibility(result, {"push": 1.0}) is None
    assert visibility(result, {"wind_speed": 2.0, "rod_mobility": 1.0}) is None
    assert visibility(result, {}) is None
    result.before.parameters[0].value = 0.0
    assert visibility(result, {"wind_speed": 2.0}) is None, "wind does nothing without a drag"
    assert visibility(result, {"scale": 0.99}) == pytest.approx(0.5)


def test_sets_have_other_seeds_and_fewer_studies_are_the_first_of_more():
    rates, thresholds = (draw(name, "single", 115, 0) for name in ("rates", "thresholds"))
    assert not {s.seed for s in rates} & {s.seed for s in thresholds}
    assert draw("rates", "single", 10, 0) == rates[:10]
    assert {(s.hidden[0], s.size) for s in rates} == {(name, size) for name in EXPECTED for size in SIZES}


def test_noise_is_not_scaled_with_what_is_hidden(monkeypatch):
    monkeypatch.setattr(blind_sample, "scaled", lambda name, size: CASES[name].scaled(2.0))  # the simulator would take seconds
    study = dataclasses.replace(draw("rates", "single", 1, 0)[0], hidden=("scale",), size=8e-3, noise=2e-3)
    camera = case_of(study).camera()
    assert camera.noise == pytest.approx(2e-3)
    assert planted_values(study)["scale"] == pytest.approx(camera.scale)


@pytest.mark.parametrize(
    ("named", "right", "word"),
    [
        ([], NOTHING, "none"),
        ([NOTHING], NOTHING, "right"),
        ([(DRAG, None)], NOTHING, "wrong"),
        ([(DRAG, None)], (DRAG, None), "right"),
        ([(DRAG, None), (WIND, None)], (DRAG, None), "tied"),
        ([(WIND, None), NOTHING], (DRAG, None), "none"),
        ([(WIND, None)], (DRAG, None), "wrong"),
        ([(DRAG | WIND, None)], (DRAG, None), "wrong"),
        ([(DRAG, None)], (DRAG | WIND, None), "part"),
        ([(DRAG, None), (frozenset(), THRUST)], (DRAG, None), "tied"),
        ([(frozenset(), THRUST)], (frozenset(), THRUST), "right"),
        ([(frozenset(), BRAKE)], (frozenset(), THRUST), "law"),
        ([(DRAG, None)], (frozenset(), THRUST), "wrong"),
        ([(frozenset(), BRAKE)], (DRAG, None), "wrong"),
        ([(DRAG, BRAKE)], (DRAG, THRUST), "law"),
        ([(DRAG, None)], (DRAG, THRUST), "part"),
        ([(frozenset(), THRUST), (DRAG, THRUST)], (DRAG, THRUST), "tied"),
    ],
)
def test_a_set_of_explanations_is_judged_by_the_planted_one(named, right, word):
    assert judgement(named, right) == word


def test_the_truth_of_a_mixed_study_is_its_effect_and_its_law():
    study = dataclasses.replace(draw("rates", "mixed", 1, 0)[0], hidden=("linear_drag", "brake"), size=16e-3)
    assert truth(study) == (DRAG, BRAKE)
    assert set(planted_values(study)) == DRAG


def test_a_rival_that_sees_something_in_clean_data_gives_a_false_alarm():
    alarm = Rival(names=(), departs=True, held_out_error=1.0)
    assert rivals.judgement(alarm, set(), "clean") == "wrong"
    assert rivals.judgement(alarm, {"a"}, "single") == "none"
    assert rivals.judgement(dataclasses.replace(alarm, names=("a",)), {"a"}, "single") == "right"
    assert rivals.judgement(dataclasses.replace(alarm, names=("a",)), {"a"}, "mixed") == "part", "no law is named"
    assert rivals.judgement(dataclasses.replace(alarm, names=("a", "b")), {"a"}, "single") == "wrong"


def test_studies_that_are_lost_to_another_method_are_listed():
    studies = draw("rates", "single", 2, 0)
    ours = [outcome("none", verdict="unexplained"), outcome("tied", verdict="ambiguous")]
    theirs = [outcome("right"), outcome("right")]
    pairs = {"identify": list(zip(studies, ours, strict=True)), "other": list(zip(studies, theirs, strict=True))}
    (loss,) = rivals.lost_studies(pairs)
    assert (loss["study"], loss["right"]) == (studies[0].name, ["other"])


def known(delta_bic, *explanations):
    return {"delta_bic": delta_bic, "delta_bic_of_explanations": list(explanations)}


@pytest.mark.parametrize(
    ("outcome", "shown"),
    [
        (known({"wind_speed": DECISIVE}), True),
        (known({"wind_speed": DECISIVE - 0.1}), False),
        (known({"wind_speed": 1000.0, "tilt": 5.0}), False),
        (known({"known_magnet": 100.0}, 89.0), True),
        (known({"known_magnet": 100.0}, 50.0, 91.0), False),
    ],
    ids=["decisive", "too little", "one of two hides", "better than what was named", "a listed effect does as well"],
)
def test_data_show_what_a_fit_that_knows_it_tells_from_all_else(outcome, shown):
    assert known_answer.is_shown(outcome) is shown


def test_of_what_a_fit_that_knows_it_shows_the_named_are_counted():
    studies = [s for s in draw("rates", "single", 80, 0) if s.size == 50e-3][:4]
    rows = [
        (studies[0], "right", known({"a": 50.0})),
        (studies[1], "none", known({"a": 50.0})),
        (studies[2], "none", known({"a": 1.0})),
        (studies[3], "right", {"failed": "no fit"}),
    ]
    result = known_answer.summary(rows)
    assert result["failed"] == 1
    shares = {name: (share["count"], share["of"]) for name, share in result["single"]["all"].items()}
    assert shares == {"shown": (2, 3), "shown_and_named": (1, 2), "not_shown_but_named": (0, 1)}
    assert result["single"]["0.05"] == result["single"]["all"]


@pytest.mark.parametrize("name", ["magnet", "thrust"])
def test_a_law_that_a_fit_is_given_is_that_of_the_simulator(name):
    """Oracle: the separate simulator's force, in its own Cartesian coordinates."""
    length, angle, along, across, time = 0.31, 2.2, 0.4, -1.7, 0.33
    r = Apparatus().rod_radius
    sine, cosine = math.sin(angle), math.cos(angle)
    x, y = r * cosine - length * sine, r * sine + length * cosine
    towards, normal = (sine, -cosine), (-cosine, -sine)
    velocity = [-along * a + across * b for a, b in zip(towards, normal, strict=True)]
    none, some = (
        _light_force(Apparatus(), e)(time, x, y, *velocity, 0.0, *towards, *normal, length)
        for e in (Effects(), Effects(**{name: 0.02}))
    )
    planted = [b - a for a, b in zip(none, some, strict=True)][:2]
    k = Kinematics(time, length, angle, along, across, abs(across), math.hypot(along, across), along, abs(along))
    law = next(e for e in hidden_laws.effects() if e.name == f"known_{name}")
    found = law.force_on_light_mass(math, k, SimpleNamespace(rod_radius=r, **{f"known_{name}": 0.02}))
    assert found == pytest.approx(
        [sum(f * e for f, e in zip(planted, unit, strict=True)) for unit in (towards, normal)], rel=1e-6
    )
    assert f"known_{name}" not in EFFECTS, "the library that is tested must not know it"


@pytest.mark.accurate
@pytest.mark.parametrize("name", ["brake", "rough_patch"])
def test_a_fit_that_knows_the_law_finds_it(name):
    """Oracle: the separate simulator, in which the law acts on the heavy mass or on the string."""
    first = draw("rates", "unlisted", 1, 0)[0]
    study = dataclasses.replace(first, hidden=(name,), size=50e-3, noise=1e-3, trials=3)
    _, outcome = known_answer.solve(known_answer.KnownAnswer(study=study, explanations=()))
    assert known_answer.is_shown(outcome)
    assert outcome["delta_bic"][f"known_{name}"] > 100


def test_finished_tasks_are_kept_and_ctrl_c_loses_none(tmp_path):
    studies, asked = draw("rates", "clean", 3, 0), []

    def solve(study: BlindStudy):
        asked.append(study.index)
        if study.index == 2 and len(asked) < 4:
            raise KeyboardInterrupt
        return study.name, {"index": study.index}

    outcomes, interrupted = calibration.run(studies, solve, tmp_path)
    assert interrupted
    assert len(outcomes) == 2
    changed = [dataclasses.replace(studies[0], noise=1.0), *studies[1:]]
    outcomes, interrupted = calibration.run(changed, solve, tmp_path)
    assert not interrupted
    assert list(outcomes) == [s.name for s in studies]
    assert asked == [0, 1, 2, 0, 2], "only what is missing, and what is no longer the same study"


def test_work_folder_is_asked_for():
    with pytest.raises(SystemExit, match="--work: found no folder, needed one"):
        calibration.work_folder(argparse.Namespace(work=None, share=1.0, jobs=1))


def test_sets_are_stored_side_by_side(tmp_path):
    file = tmp_path / "calibration.json"
    calibration.store(file, "rates", {"x": 1 / 3})
    calibration.store(file, "thresholds", {"x": 2})
    assert json.loads(file.read_text(encoding="utf-8")) == {"rates": {"x": 0.3333}, "thresholds": {"x": 2}}


@pytest.mark.parametrize(
    ("statistic", "limit"),
    [
        ("chi2_over_limit", 1.0),  # of fewer values the limit is wider
        ("lag1_z", residual.MAX_LAG1_Z),
        ("ljung_box_p", residual.MIN_LJUNG_BOX_P),
        ("runs_z", residual.MIN_RUNS_Z),
    ],
)
def test_a_limit_lets_99_of_100_clean_studies_pass(statistic, limit):
    """Oracle: what the test's statistic reached in studies of their own, with which no rate is measured."""
    assert STORED["thresholds"]["command"] != STORED["rates"]["command"]
    reached = STORED["thresholds"]["summary"]["statistics"][statistic]
    assert reached["of"] >= 80
    is_lower_limit = reached["extreme"] < reached["0.5"]
    assert limit < reached["0.99"] if is_lower_limit else limit > reached["0.99"]


@pytest.mark.accurate
def test_one_study_from_end_to_end():
    study = dataclasses.replace(draw("rates", "single", 1, 0)[0], hidden=("wind",), size=16e-3, noise=1e-3, trials=3)
    name, said = calibration.solve(study)
    assert name == study.name
    assert said["judgement"] == "right"
    assert said["estimates"][0]["planted"] == pytest.approx(planted_values(study)["wind_speed"])
    assert said["held_out_error"] < 1.2
    assert said["cpu_seconds"] > 0


@pytest.mark.accurate
def test_what_a_companion_can_hide_has_no_visibility():
    """A rod that turns, whose bearing rubs, was called 21 times its smallest visible size, and was lost in noise."""
    (study,) = (s for s in draw("rates", "single", 9, 3) if s.hidden == ("rod_mobility",))
    _, outcome = calibration.solve(study)
    assert outcome["judgement"] == "right"
    assert outcome["visibility"] is None, "such a rod has no smallest visible size"


def test_each_study_with_one_effect_is_a_marker_in_the_row_of_its_effect():
    cases = [("wind", 3.0, "right"), ("scale", 1e6, "wrong"), ("wind", 0.5, "none"), ("push", None, "none")]
    studies = [
        {"effect": name, "size": 8e-3, "visibility": visibility, "judgement": judgement}
        for name, visibility, judgement in cases
    ]
    (axes,) = rates_page.figure(studies).axes
    assert [label.get_text() for label in axes.get_yticklabels()] == ["wind", "scale"]
    drawn = {line.get_label(): line.get_xdata() for line in axes.get_lines()}
    assert list(drawn["named (1)"]) == [3.0]
    assert list(drawn["another is named (1)"]) == [rates_page.LARGEST]
    assert list(drawn["nothing is named (1)"]) == [0.5], "of one without a smallest visible size nothing is drawn"


def test_every_size_of_every_case_has_its_factor_stored():
    wanted = {blind_sample._key(CASES[name], size) for name in (*EXPECTED, *(c.name for c in UNLISTED)) for size in SIZES}
    assert blind_sample.stored_factors().keys() == wanted, "run: python -m benchmarks.blind_sample"


@pytest.mark.accurate
@pytest.mark.parametrize(("name", "size"), [("wind", 8e-3), ("magnet", 16e-3)])
def test_a_stored_factor_gives_its_size(name, size):
    """Oracle: the simulator, with and without what is hidden."""
    assert signature(blind_sample.scaled(name, size)) == pytest.approx(size, rel=0.05)


def test_a_size_that_nothing_gives_is_refused(monkeypatch):
    monkeypatch.setattr(blind_sample, "stored_factors", lambda: {blind_sample._key(CASES["wind"], 7.0): NO_FACTOR})
    with pytest.raises(ValueError, match="no scale found"):
        blind_sample.scaled("wind", 7.0)


NO_FACTOR = {"factor": None, "reason": "wind: no scale found that moves the light mass by 7 m"}


# ---- what was asked of `identify` on blind studies, against what the stored rates say, and what the search for outliers costs


@pytest.mark.parametrize(
    "target",
    [
        pytest.param(
            t, id=t.what, marks=pytest.mark.xfail(raises=AssertionError, reason=t.why_not, strict=True) if t.why_not else ()
        )
        for t in TARGETS
    ],
)
def test_what_was_asked_of_the_search(target):
    """Oracle: blind studies of the separate simulator, of a seed of their own."""
    assert target.is_met(STORED["rates"]["summary"])


@pytest.mark.parametrize(
    ("limits", "measured", "met"),
    [
        ({"low": 0.8}, proportion(8, 10), True),
        ({"low": 0.8}, proportion(7, 10), False),
        ({"low": 0.8}, proportion(0, 0), False),
        ({"low": 0.8}, None, False),
        ({"low": 0.93, "high": 0.97}, proportion(98, 100), False),
        ({"high": 1.1}, 1.05, True),
        ({"high": 0.01, "highest_bound": 0.02}, with_upper_bound(1, 300), True),
        ({"high": 0.01, "highest_bound": 0.02}, with_upper_bound(1, 120), False),
        ({"high": 0.01, "highest_bound": 0.02}, proportion(1, 300), False),
    ],
)
def test_a_target_is_met_within_its_limits(limits, measured, met):
    assert Target(what="", asked="", at="set/share", **limits).is_met({"set": {"share": measured}}) is met


def test_targets_are_of_large_effects_and_of_what_is_wrong_alone():
    drawn = draw("rates", "single", 4, 0)
    shape = [(16e-3, 3, 1e-3), (50e-3, 1, 1e-3), (50e-3, 4, 2e-3), (8e-3, 4, 1e-3)]
    studies = [
        dataclasses.replace(s, size=size, trials=trials, noise=noise)
        for s, (size, trials, noise) in zip(drawn, shape, strict=True)
    ]
    said = [("right", "identified"), ("wrong", "unlisted"), ("wrong", "identified"), ("wrong", "identified")]
    outcomes = [outcome(judgement, verdict=verdict) for judgement, verdict in said]
    large = summary(list(zip(studies, outcomes, strict=True)))["large"]
    assert (large["single"]["count"], large["single"]["of"]) == (1, 3)
    assert (large["single_as_recommended"]["count"], large["single_as_recommended"]["of"]) == (1, 1)
    assert (large["single_wrong_alone"]["count"], large["single_wrong_alone"]["of"]) == (1, 3)
    assert large["single_called_unlisted"]["count"] == 1
    assert large["unlisted_held_out_error"] == {}


def test_ways_of_handling_outliers_are_compared_on_the_same_studies():
    studies = draw("rates", "single", 2, 0)
    estimate = [{"error": 1.0}, {"error": 1.2}]
    pairs = [
        (
            calibration.Arm(study=dataclasses.replace(s, noise_kind=kind), finds_outliers=finds),
            {"judgement": "right" if finds else "none", "verdict": "unexplained", "estimates": [estimate[kind == "outliers"]]},
        )
        for s in studies
        for kind in calibration.ARM_NOISE_KINDS
        for finds in (True, False)
    ]
    assert len({arm.name for arm, _ in pairs}) == 8
    rows = calibration.outlier_rows(pairs[:-1])
    assert [(r["points"], r["finds_outliers"], r["named_or_tied"]["count"]) for r in rows] == [
        ("white", True, 1), ("white", False, 0), ("outliers", True, 1), ("outliers", False, 0)
    ]  # fmt: skip
    assert all(r["named_or_tied"]["of"] == 1 for r in rows), "of the second study one way is missing"
    assert [r["standard_error_ratio"] for r in rows] == [1.0, 1.0, 1.2, 1.2]
