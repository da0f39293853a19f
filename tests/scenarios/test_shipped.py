"""The scenarios that come with the package."""

import hashlib
import math
import subprocess
import sys
from importlib import resources

import pytest

from looping_pendulum.measured.tables.events import find_data, read_event_table
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios import dump, load, load_text, shipped
from looping_pendulum.scenarios.document import parse
from looping_pendulum.scenarios.quantities import FILE_KEYS

NAMES = [
    "atwood",
    "drop",
    "fat_rod",
    "frictionless",
    "held",
    "static_friction",
    "ten_to_one",
    "two_and_a_half_to_one",
    "two_to_one",
]
FOLDER = resources.files("looping_pendulum.scenarios")


def test_these_are_shipped():
    assert shipped() == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_loads_and_survives_a_round_trip(name):
    scenario = load(name)
    assert scenario.name == name
    assert scenario.title
    assert scenario.description
    assert load_text(dump(scenario), name) == scenario


@pytest.mark.parametrize("name", NAMES)
def test_begins_with_a_comment_for_the_reader(name):
    assert (FOLDER / f"{name}.yaml").read_text(encoding="utf-8").startswith("# ")


@pytest.mark.parametrize("name", NAMES)
def test_says_of_every_number_that_the_paper_does_not_print_how_it_came_about(name):
    explained = {key for entry in load(name).inferred for key in entry.parameters}
    assert {"release.free_length", "release.hanging_length", "rod.radius"} <= explained
    assert load(name).parameters.release is Release.VERTICAL or "release.angle" in explained or name == "two_and_a_half_to_one"


@pytest.mark.parametrize(
    ("name", "release"),
    [("atwood", Release.VERTICAL), ("held", Release.HELD), ("drop", Release.DROP), ("ten_to_one", Release.LOOPING)],
)
def test_releases(name, release):
    assert load(name).parameters.release is release


def test_two_and_a_half_to_one_is_the_papers_example():
    p = load("two_and_a_half_to_one").parameters
    assert (p.heavy_mass, p.light_mass, p.release_angle) == (0.038, 0.0152, pytest.approx(math.radians(75.1), rel=1e-15))


def test_frictionless_has_neither_friction_nor_drag():
    coefficients = dict(load("frictionless").parameters.coefficients)
    assert coefficients.pop("gravity") == 9.81
    assert set(coefficients.values()) == {0.0}


@pytest.mark.parametrize("name", ["ten_to_one", "two_to_one"])
def test_measured_table_is_found_by_its_checksum(name):
    trial = load(name).measured
    assert trial is not None
    path = find_data(trial.file)
    if path is None:
        pytest.skip("the measured data is not part of the project, and no data folder is here")
    table = read_event_table(path, trial.sha256)
    assert "halting_time" in {row.quantity for row in table}
    assert hashlib.sha256(path.read_bytes()).hexdigest() == trial.sha256


def test_no_measured_data_is_in_the_package():
    assert not [entry.name for entry in FOLDER.iterdir() if entry.name.endswith((".csv", ".txt"))]


def test_tolerances_of_ten_to_one_each_give_a_reason():
    tolerances = load("ten_to_one").tolerances
    assert {t.engine for t in tolerances} >= {"mujoco:capstan", "pymunk:chain", "pybullet:chain"}
    assert all(t.reason for t in tolerances)


@pytest.mark.parametrize("module", ["looping_pendulum.scenarios.scenario", "looping_pendulum.scenarios"])
def test_engines_types_import_no_heavy_package(module):
    code = f"import sys, {module}; print(*sorted({{'pydantic', 'pint', 'yaml'}} & set(sys.modules)))"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert out.stdout.strip() == ""


def test_unknown_attribute_is_still_an_error():
    import looping_pendulum.scenarios as package

    with pytest.raises(AttributeError, match="nonsense"):
        _ = package.nonsense


def test_every_parameter_has_its_place_in_a_file():
    text = (FOLDER / "ten_to_one.yaml").read_bytes()
    lines = parse(text, "ten_to_one.yaml").lines
    given = {key for key in FILE_KEYS.values() if tuple(key.split(".")) in lines}
    assert set(FILE_KEYS.values()) - given == {"light.radius", "gravity"}


def test_what_is_printed_of_a_scenario_is_the_trial():
    """Its limits for engines filled some pages."""
    shown = repr(load("ten_to_one"))
    assert "free_length=0.5808" in shown
    assert len(shown) < 1000
