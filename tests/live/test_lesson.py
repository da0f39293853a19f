"""The lesson's steps over the model: each right answer is the reference's, and no other one is called right."""

import math

import numpy as np
import pytest

from looping_pendulum.reference_ode.parameters import NUMBERS, Parameters, Release
from looping_pendulum.reference_ode.solve import solve

SCATTER = 2e-3
"""Standard deviation of a made-up coordinate [m]."""
SLIDER_STEP = 0.05
"""Of the slider of M1's air drag [g/m]."""


@pytest.fixture(scope="module")
def ask(node):
    """Ask the lesson's steps one thing, or a list of things at once."""

    def asked(*questions):
        return node("lesson.mjs", list(questions))

    return asked


def reference(settings):
    """Return the reference's run of the page's settings."""
    settings = dict(settings)
    release = Release(settings.pop("release"))
    if release is Release.VERTICAL:
        settings.pop("release_angle")
    numbers = {name: settings.pop(name) for name in NUMBERS if name in settings}
    return solve(Parameters(release=release, **numbers, coefficients=settings), duration=5.0)


def judged(ask, name, answers, changes=None):
    questions = [{"ask": "judge", "name": name, "said": said, "changes": changes or {}} for said in answers]
    return dict(zip(answers, ask(*questions), strict=True))


def assert_only_right(outcomes, answer):
    assert {said: outcome["right"] for said, outcome in outcomes.items()} == {said: said == answer for said in outcomes}
    assert {outcome["found"] for outcome in outcomes.values()} == {answer}
    for outcome in outcomes.values():
        assert 0 < outcome["seenAt"] <= outcome["end"]


def drop(run, t):
    start, later = run.sample([0.0, t]).heavy_position[:, 1]
    return start - later


def test_there_are_seven_steps_and_each_choice_has_two_to_four_answers(ask):
    [steps] = ask({"ask": "steps"})
    assert [step["name"] for step in steps] == ["atwood", "frictionless", "friction", "lowest", "static", "drag", "trial"]
    assert all(2 <= len(step["options"]) <= 4 for step in steps if step["name"] not in ("atwood", "lowest"))


def test_atwood_without_friction_has_its_closed_form(ask):
    outcomes = judged(ask, "atwood", ["4.905", "4.7", "5.1", "9.81", "3.27", "0.5"])
    exact = 9.81 * (3 - 1) / (3 + 1)
    assert {said: outcome["right"] for said, outcome in outcomes.items()} == {
        said: abs(float(said) / exact - 1) < 0.05 for said in outcomes
    }
    assert all(outcome["found"] == pytest.approx(exact, abs=0.005 + 1e-9) for outcome in outcomes.values())
    assert outcomes["9.81"]["values"]["expected"] == pytest.approx(exact, abs=0.005 + 1e-9)
    # With friction on the rod the run says another number, and so the step does
    slower = judged(ask, "atwood", ["4.905"], {"static_friction": 0.2, "kinetic_friction": 0.2})["4.905"]
    grip = math.exp(0.2 * math.pi)
    assert slower["found"] == pytest.approx(9.81 * (3 - grip) / (3 + grip), abs=0.005 + 1e-9)
    assert not slower["right"]


def test_without_friction_it_turns_round_and_with_friction_it_halts(ask):
    answers = ["falls", "halts", "turns"]
    outcomes = judged(ask, "frictionless", answers)
    assert_only_right(outcomes, "turns")
    run = reference(outcomes["turns"]["settings"])
    assert run.halt is None
    values = outcomes["turns"]["values"]
    assert values["time"] == pytest.approx(run.stops[0], abs=0.005 + 1e-9)
    assert values["drop"] == pytest.approx(100 * drop(run, run.stops[0]), abs=0.5 + 1e-9)
    assert values["count"] == len(run.stops)
    assert_only_right(judged(ask, "frictionless", answers, {"kinetic_friction": 0.34}), "halts")
    # M2 that is pulled up from the start never falls, nor turns round before it is at the rod
    pushed = {"gravity": 1, "mass_ratio": 1, "push_across": 3}
    assert_only_right(judged(ask, "frictionless", answers, pushed), "falls")


@pytest.mark.long
def test_what_the_rod_holds_is_multiplied_by_each_half_turn(ask):
    answers = ["same", "more", "times"]
    outcomes = judged(ask, "friction", answers)
    assert_only_right(outcomes, "times")
    values, run = outcomes["times"]["values"], reference(outcomes["times"]["settings"])
    assert values["factor"] == pytest.approx(math.exp(0.34 * math.pi), abs=0.005 + 1e-9)
    assert values["time"] == pytest.approx(run.halting_time, abs=0.005 + 1e-9)
    at_halt = run.sample([run.halting_time + 1e-6])
    assert values["bound"] == pytest.approx(math.exp(0.34 * at_halt.state.wrap_angle[0]), abs=0.05 + 1e-3)
    pulls = sorted(tension[0] for tension in at_halt.tensions)
    assert values["needed"] == pytest.approx(pulls[1] / pulls[0], abs=0.05 + 1e-3)
    assert_only_right(judged(ask, "friction", answers, {"static_friction": 0, "kinetic_friction": 0}), "same")


def test_the_lowest_ratio_is_where_the_reference_ceases_to_halt(ask):
    [found, settings] = ask({"ask": "lowest"}, {"ask": "settings", "name": "lowest"})
    lowest = found["lowest"]

    def halts(ratio):
        return reference(settings | {"heavy_mass": ratio * settings["light_mass"]}).halt is not None

    assert halts(lowest)
    assert not halts(lowest - 0.01)
    assert all(halts(ratio) for ratio in np.arange(lowest, 10.0, 0.1))
    assert found["runs"] < 60  # each some milliseconds


@pytest.mark.long
def test_a_ratio_is_the_lowest_within_a_step_of_the_slider(ask):
    [found] = ask({"ask": "lowest"})
    lowest = found["lowest"]
    first = math.ceil(10 * lowest) / 10
    expected = {first: "lowest", first + 0.2: "high", 10: "high", first - 0.1: "never", 2.5: "never", 1.7: "gap"}
    answers = ask(*({"ask": "place", "ratio": ratio, "lowest": lowest} for ratio in expected))
    assert [answer["place"] for answer in answers] == list(expected.values())
    assert all(answer["isOfStep"] for answer in answers)
    assert ask({"ask": "isOfStep", "changes": {"free_length": 70}}) == [False]
    guesses = {lowest: True, 1.04 * lowest: True, 1.1 * lowest: False, 10: False, 1: False}
    assert ask(*({"ask": "guess", "said": str(said), "lowest": lowest} for said in guesses)) == list(guesses.values())


@pytest.mark.long
def test_a_larger_friction_at_rest_halts_it_earlier(ask):
    answers = ["earlier", "same", "later"]
    outcomes = judged(ask, "static", answers)
    assert_only_right(outcomes, "earlier")
    outcome = outcomes["earlier"]
    for key, settings in (("time", outcome["settings"]), ("before", outcome["other"])):
        assert outcome["values"][key] == pytest.approx(reference(settings).halting_time, abs=5e-4 + 1e-9)
    assert_only_right(judged(ask, "static", answers, {"static_friction": 0.2}), "same")
    assert_only_right(judged(ask, "static", answers, {"static_friction": 0.2, "mass_ratio": 2.8}), "later")


@pytest.mark.long
def test_a_larger_drag_lets_it_fall_further(ask):
    answers = ["deeper", "same", "higher"]
    outcomes = judged(ask, "drag", answers)
    assert_only_right(outcomes, "deeper")
    outcome = outcomes["deeper"]
    for key, settings in (("run", outcome["settings"]), ("film", outcome["other"])):
        run = reference(settings)
        assert outcome["values"][key] == pytest.approx(100 * drop(run, run.halting_time), abs=0.05 + 1e-9)
    hidden = outcome["other"]["light_drag"] / 1e-3
    assert_only_right(judged(ask, "drag", answers, {"light_drag": hidden}), "same")
    assert_only_right(judged(ask, "drag", answers, {"light_drag": 5}), "higher")


@pytest.mark.parametrize("seed", range(1, 9))
def test_only_the_hidden_drag_fits_a_film(ask, seed):
    offsets = (-0.2, -2 * SLIDER_STEP, 0.0, 2 * SLIDER_STEP, 0.2)
    answers = ask(*({"ask": "film", "seed": seed, "off": off} for off in offsets))
    assert [answer["fits"] for answer in answers] == [False, False, True, False, False]
    drag = answers[2]["drag"]
    assert 1 <= drag <= 3
    assert drag / SLIDER_STEP == pytest.approx(round(drag / SLIDER_STEP), abs=1e-9)
    # Of a hundred points the root mean square scatters by 5 %
    assert answers[2]["distance"] == pytest.approx(math.sqrt(2 * math.log(2)) * SCATTER, rel=0.2), (
        "the median of Rayleigh's distribution"
    )
    assert not answers[2]["ofStep"]["fits"]


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_a_made_up_trial_is_fitted_and_its_wind_is_seen(ask, seed):
    first, again = ask({"ask": "trial", "seed": seed}, {"ask": "trial", "seed": seed})
    assert first["csv"] == again["csv"]
    assert first["converged"]
    assert (first["wind"] > 0) == (seed % 2 == 1)
    assert (first["tests"]["pattern"] or first["tests"]["larger"]) == (first["wind"] > 0)
    if not first["wind"]:
        fitted = {p["name"]: (p["value"], p["error"]) for p in first["parameters"]}
        for name in ("kinetic_friction", "light_drag", "release_angle", "free_length"):
            number, error = fitted[name]
            assert abs(number - first["hidden"][name]) < 4 * error


def test_what_is_left_after_a_fit_is_what_was_said_or_not(ask):
    cases = [(said, noise) for said in ("noise", "more") for noise in (True, False)]
    answers = ask(*({"ask": "trialJudged", "said": said, "isNoise": noise} for said, noise in cases))
    assert [answer["right"] for answer in answers] == [(said == "noise") == noise for said, noise in cases]
    assert {answer["values"]["after"] for answer in answers} == {2}  # in millimetres
