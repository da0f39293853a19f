"""Blind studies as the rates of research/rates.md are measured on: the planted law, its size, and one study from end to end."""

import math
from types import SimpleNamespace

import pytest

from looping_pendulum.reference_ode.effects import EFFECTS, Kinematics
from research import calibration, hidden_laws, known_answer, rates_page
from research.calibration_summary import summary
from tests.blind import Apparatus, Effects
from tests.blind.cases import CASES, signature
from tests.blind.simulator import _light_force
from tests.discrepancy.blind_sample import BlindStudy, planted_values, scaled, write_files
from tests.discrepancy.blind_study import TWO_RATIOS, write_study


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


@pytest.mark.long
@pytest.mark.parametrize(("name", "seed"), [("side_force", 0), ("magnet", 3)])
def test_a_fit_that_begins_at_the_planted_value_shows_it(tmp_path, name, seed):
    """Oracle: the separate simulator; a law is known in a process of its own."""
    study = BlindStudy(hidden=(name,), size=16e-3, noise=1e-3, trials=3, seed=seed)
    path = write_study(tmp_path, CASES[name], seed, trials=TWO_RATIOS)
    known = known_answer.known_answer(study, path)
    assert known_answer.log_odds(known) > 50


@pytest.mark.accurate
@pytest.mark.parametrize("name", ["brake", "rough_patch", "friction_per_turn"])
def test_a_fit_that_knows_the_law_finds_it(tmp_path, name):
    """Oracle: the separate simulator, in which the law acts on the heavy mass or on the string."""
    study = BlindStudy(hidden=(name,), size=50e-3, noise=1e-3, trials=3, seed=90002)
    known = known_answer.known_answer(study, write_files(study, tmp_path))
    assert known_answer.log_odds(known) > 50


@pytest.mark.parametrize(("whole", "odds", "shown"), [(10.0, 1.0, {"a", "b"}), (8.0, -1.0, {"a"})])
def test_what_the_data_show_is_the_most_probable_part_of_what_is_hidden(whole, odds, shown):
    known = {"log_posteriors": [[[], 0.0], [["a"], 9.0], [["b"], 1.0], [["a", "b"], whole]]}
    assert known_answer.log_odds(known) == odds
    assert known_answer.shown_parts(known) == shown


def test_of_a_fit_that_failed_nothing_is_known():
    failed = {"failed": "the model cannot run"}
    assert (known_answer.log_odds(failed), known_answer.shown_parts(failed)) == (None, None)


@pytest.mark.accurate
def test_one_study_from_end_to_end():
    study = BlindStudy(hidden=("wind",), size=16e-3, noise=1e-3, trials=3, seed=90003, kind="single")
    name, said = calibration.solve(study)
    assert name == study.name
    assert said["judgement"] == "right"
    assert said["estimates"][0]["planted"] == pytest.approx(planted_values(study)["wind_speed"])
    assert said["held_out_error"] < 1.2
    assert said["cpu_seconds"] > 0
    assert said["log_odds"] > known_answer.SHOWN
    result = summary([(study, said)])
    assert result["hidden"]["one"]["named_of_shown"]["count"] == 1
    assert "one effect, of the studies that show it: named, or tied | at least 99 % | 1 of 1" in rates_page.page(
        {"command": "", "measured_on": ""} | result
    )


@pytest.mark.accurate
@pytest.mark.parametrize(("name", "size"), [("wind", 8e-3), ("magnet", 16e-3)])
def test_a_stored_factor_gives_its_size(name, size):
    """Oracle: the simulator, with and without what is hidden."""
    assert signature(scaled(name, size)) == pytest.approx(size, rel=0.05)
