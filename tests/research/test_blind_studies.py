"""Blind studies as the rates of research/rates.md are measured on: the planted law, its size, and one study from end to end."""

import dataclasses
import json
import math
from types import SimpleNamespace

import pytest

from looping_pendulum.reference_ode.effects import EFFECTS, Kinematics
from research import calibration, hidden_laws, known_answer
from tests.blind import Apparatus, Effects
from tests.blind.cases import signature
from tests.blind.simulator import _light_force
from tests.discrepancy.blind_sample import draw, planted_values, scaled

STORED = json.loads(calibration.RESULT.read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", ["magnet", "pull", "thrust"])
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


@pytest.mark.parametrize(
    ("statistic", "limit"),
    [
        ("chi2_over_limit", 1.0),  # of fewer values the limit is wider
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


@pytest.mark.accurate
@pytest.mark.parametrize(("name", "size"), [("wind", 8e-3), ("magnet", 16e-3)])
def test_a_stored_factor_gives_its_size(name, size):
    """Oracle: the simulator, with and without what is hidden."""
    assert signature(scaled(name, size)) == pytest.approx(size, rel=0.05)
