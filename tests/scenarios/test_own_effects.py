"""The key ``own_effects`` of scenarios, ``candidates`` of studies: read, written, refused with one line that names the key."""

import pytest

from looping_pendulum.errors import ScenarioError
from looping_pendulum.measured import study_io
from looping_pendulum.reference_ode.effects.own import DIRECTIONS
from looping_pendulum.scenarios import dump, json_schema, load_text
from looping_pendulum.scenarios.own_effects import OWN_FORCE

from .test_errors import GOOD

STUDY = """title: A study
apparatus: {light: {mass: 10 g}, heavy: {mass: 100 g}, rod: {radius: 6 mm}}
effects: {gravity: 9.81 m/s^2, EFFECT}
trials: [{file: a.csv, release: {angle: 112 deg, free_length: 58 cm}}]
"""
BRAKE = {
    "name": "brake",
    "unit": "kg/s",
    "bounds": "[0 kg/s, 1 kg/s]",
    "direction": "heavy_vertical",
    "formula": "-brake * heavy_speed",
}


def block(key="own_effects", **changes):
    b = BRAKE | changes
    return (
        f"{key}:\n  {b['name']}:\n    unit: {b['unit']}\n    bounds: {b['bounds']}\n"
        f"    force: {{{b['direction']}: {b['formula']}}}\n"
    )


def study(effect="light_drag: free", **changes):
    return study_io.load_text(STUDY.replace("EFFECT", effect) + block("candidates", **changes), "my.yaml")


@pytest.mark.parametrize(
    ("changes", "key", "message"),
    [
        ({"name": "wind"}, "wind", "found the name 'wind', which something else has already"),
        ({"unit": "mN"}, "brake.unit", "found 'mN', needed an SI unit without a prefix"),
        ({"unit": "kg per s"}, "brake.unit", "found 'kg per s', needed an SI unit"),
        ({"bounds": "[0 m, 1 m]"}, "brake.bounds", "expected a linear drag coefficient (mass per time), got '0 m'"),
        ({"bounds": "[1 kg/s, 2 kg/s]"}, "brake.bounds", "needed a lowest and a highest value with 0 among them"),
        ({"bounds": "1 kg/s"}, "brake.bounds", "expected a lowest and a highest value, got '1 kg/s'"),
        ({"formula": "brake * heavy_sped"}, "brake.force.heavy_vertical", "did you mean 'heavy_speed'?"),
        ({"formula": "abs(brake)"}, "brake.force.heavy_vertical", "found 'abs(brake)', needed numbers, names"),
        ({"formula": "1 + brake"}, "brake.force", "does not vanish where brake is 0"),
        ({"direction": "heavy_vertica"}, "brake.force.heavy_vertica", "did you mean 'heavy_vertical'?"),
    ],
)
def test_a_faulty_effect_is_refused_with_its_key(changes, key, message):
    in_file = {
        "own_effects": lambda: load_text(GOOD + block(**changes), "my.yaml"),
        "candidates": lambda: study(**changes),
    }
    for group, read in in_file.items():
        with pytest.raises((ScenarioError, study_io.StudyError)) as caught:
            read()
        text = str(caught.value)
        assert text.startswith("my.yaml:")
        assert f" {group}.{key}: " in text
        assert message in text
        assert "\n" not in text


def test_a_faulty_effect_is_named_before_its_coefficient_which_nobody_knows_then():
    with pytest.raises(ScenarioError, match=r"own_effects.brake.unit: found 'mN'"):
        load_text(GOOD + block(unit="mN") + "effects: {brake: 0.1 kg/s}\n", "my.yaml")
    with pytest.raises(study_io.StudyError, match=r"candidates.brake.unit: found 'mN'"):
        study("brake: free from 0.1 kg/s", unit="mN")


def test_a_study_refuses_the_name_of_a_camera_parameter():
    with pytest.raises(study_io.StudyError, match="candidates.scale: found the name 'scale', which a camera's parameter has"):
        study(name="scale", formula="-scale * heavy_speed")


def test_a_study_with_the_key_of_a_scenario_is_told_its_own():
    text = STUDY.replace("EFFECT", "light_drag: free") + block()
    with pytest.raises(study_io.StudyError, match="own_effects: found an unknown key, .*; write it as 'candidates'"):
        study_io.load_text(text, "my.yaml")


def test_a_scenario_with_its_own_effect_is_written_and_read_again():
    text = GOOD + block() + "effects: {brake: 0.1 kg/s}\ninferred:\n- {parameters: [effects.brake], how: felt}\n"
    scenario = load_text(text, "my")
    assert scenario.parameters.coefficients["brake"] == 0.1
    assert load_text(dump(scenario), "my") == scenario
    with pytest.raises(ScenarioError, match=r"effects.brake: expected a linear drag .* from 0 to 1 kg/s, got '2 kg/s'"):
        load_text(text.replace("0.1 kg/s", "2 kg/s"), "my.yaml")
    with pytest.raises(ScenarioError, match="effects.brake: found an unknown key"):
        load_text(GOOD + "effects: {brake: 0.1 kg/s}\n", "my.yaml")


@pytest.mark.parametrize("unit", ["1", "1/rad", "N*s/m", "N / m^2"])
def test_units_are_written_as_they_are_read(unit):
    low, high = ("0", "1") if unit == "1" else (f"0 {unit}", f"1 {unit}")
    scenario = load_text(GOOD + block(unit=unit, bounds=f"[{low}, {high}]"), "my")
    assert load_text(dump(scenario), "my") == scenario


def test_a_study_may_declare_its_own_effect_and_is_written_and_read_again():
    undeclared, declared = study(), study("brake: free from 0.1 kg/s")
    assert set(undeclared.effects) == {"gravity", "light_drag"}
    assert set(declared.effects) == {"gravity", "brake"}
    assert declared.effects["brake"].value == 0.1
    assert {p.name for p in declared.free_parameters()} >= {"brake"}
    for each in (undeclared, declared):
        assert study_io.load_text(study_io.dump(each), "my.yaml") == each


def test_an_effect_on_the_heavy_mass_is_not_fitted_where_that_is_clamped():
    held = STUDY.replace("EFFECT", "brake: free").replace("release: {", "release: {kind: held, ")
    assert "brake" not in {p.name for p in study_io.load_text(held + block("candidates"), "my.yaml").free_parameters()}


def test_editors_know_every_direction():
    assert tuple(OWN_FORCE.keys) == DIRECTIONS
    assert set(json_schema()["properties"]["own_effects"]["additionalProperties"]["properties"]["force"]["properties"]) == set(
        DIRECTIONS
    )
