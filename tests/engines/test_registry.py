"""Adapters of other packages: a broken one is one clear line and stops none of the others."""

import importlib.util
import subprocess
import sys
import tomllib
import warnings
from importlib import import_module
from pathlib import Path

import pytest

from looping_pendulum.engines import registry
from looping_pendulum.engines.isolation import run_isolated
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.registry import (
    ENTRY_POINTS,
    AdapterWarning,
    all_engines,
    engine,
    how_to_get,
    label,
    load_engines,
    main_engines,
    missing_packages,
    select,
)
from looping_pendulum.errors import EngineError
from looping_pendulum.runs.trajectory import RunStatus
from looping_pendulum.scenarios.scenario import Scenario
from tests.apparatus import TEN_TO_ONE
from tests.command_line import here
from tests.engines.faulty import FaultyEngine

GOOD = """
from tests.engines.faulty import FaultyEngine

class Good(FaultyEngine):
    name = "good"

def engines(profile):
    return [Good("none")]
"""
BROKEN = {
    "raises": ("raise ValueError('no\\nlicence')\n", "ValueError: no licence"),
    "exits": ("import sys\nsys.exit(3)\n", "SystemExit: 3"),
    "empty": ("\n", "has no attribute 'engines'"),
    "lists_nothing_known": (
        "def engines(profile):\n    return [object()]\n",
        "gave object without name, variant, profile, abilities, settings, simulate, with_settings, studies",
    ),
    "calls_itself_else": (GOOD, "gave one called 'good'; needed the entry point's name, 'calls_itself_else'"),
    "doubles": (
        GOOD.replace('"good"', '"doubles"').replace("[Good", "2 * [Good"),
        "gave two of one name among doubles:none, doubles:none",
    ),
    "settled": (
        GOOD.replace('"good"', '"settled"') + "    # never reached\n" + "class Odd(Good):\n    pass\n"
        "def engines(profile):\n    odd = Odd('none')\n    odd.settings = {}\n    return [odd]\n",
        "settled:none: settings are dict, needed a frozen dataclass",
    ),
    "pymunk": (GOOD.replace('"good"', '"pymunk"'), "the name 'pymunk' is taken"),
}


def test_another_packages_engine_is_one_of_the_main_engines(offer):
    offer(good=GOOD)
    assert "good:none" in [label(engine) for engine in main_engines(Profile.QUICK)]
    assert [label(engine) for engine in select(["good"], Profile.QUICK)] == ["good:none"]
    assert registry.adapter_packages()["good"] == "elsewhere"


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_adapter_is_one_line_and_stops_no_other(offer, name):
    before = [label(engine) for engine in all_engines(Profile.QUICK)]
    source, why = BROKEN[name]
    offer(**{name: source, "good": GOOD})
    with pytest.warns(AdapterWarning) as caught:
        engines = all_engines(Profile.QUICK)
    assert sorted(map(label, engines)) == sorted([*before, "good:none"])
    (message,) = {str(warning.message) for warning in caught}
    assert message.startswith(f"engine {name!r} is left out: adapter adapter_{name} of the package elsewhere: ")
    assert why in message
    assert message.endswith("; fix or uninstall that package")
    assert "\n" not in message
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert [label(engine) for engine in select(["good"], Profile.QUICK)] == ["good:none"]  # not asked for: not spoken of
        if name != "pymunk":
            with pytest.raises(EngineError, match=f"--engine: engine '{name}' is left out"):
                select([f"{name}:x"], Profile.QUICK)
    with pytest.warns(AdapterWarning):
        select(["all"], Profile.QUICK)


def test_a_module_that_is_not_there_is_a_broken_adapter(offer):
    offer(nowhere=None)
    faults = load_engines(Profile.QUICK)[1]
    assert "ModuleNotFoundError: No module named 'adapter_nowhere'" in faults["nowhere"]


def test_on_the_command_line_a_broken_adapter_is_a_warning_and_a_gap_in_the_list(offer, tmp_path):
    offer(raises=BROKEN["raises"][0])
    line = "engine 'raises' is left out: adapter adapter_raises of the package elsewhere: ValueError: no licence"
    done = here("engines")
    assert done.returncode == 0
    assert "broken" in done.stdout
    assert line in done.stdout
    done = here("engines", "--support")
    assert done.returncode == 0
    assert [text for text in done.stderr.splitlines() if text] == [f"warning: {line}; fix or uninstall that package"]
    done = here("compare", "drop", "-e", "raises", "--out", str(tmp_path / "out"))
    assert done.returncode == 2
    assert [text for text in done.stderr.splitlines() if text] == [f"error: --engine: {line}; fix or uninstall that package"]


def test_a_package_inside_one_that_is_missing_is_missing():
    assert missing_packages(FaultyEngine("none", packages=("no_such.part", "numpy"))) == ("no_such.part",)


# ---- adapters that take the road of a third party's and are a gap without their package, and what holds of every adapter


PROJECT = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
OPTIONAL = {"drake": "pydrake", "box2d": "pyb2d3", "rapier": "rapier3d", "exudyn": "exudyn", "newton": "newton"}
"""Engine -> name of its package in Python."""
NOT_WITH_THE_TESTS = {"newton"}
"""Engines that are not installed for the tests: Newton and Warp take 400 MB, and only the accurate tests run them."""


@pytest.mark.parametrize("engine", OPTIONAL)
def test_it_takes_the_third_partys_road(engine):
    """Oracle: pyproject.toml. Nothing but the entry point knows its adapter."""
    wanted, *_ = PROJECT["optional-dependencies"][engine]
    assert PROJECT["entry-points"][ENTRY_POINTS][engine] == f"looping_pendulum.engines.{engine}"
    assert engine in NOT_WITH_THE_TESTS or any(need.startswith(wanted) for need in PROJECT["optional-dependencies"]["test"])
    assert not any(need.startswith(wanted.partition(">")[0]) for need in PROJECT["dependencies"])


@pytest.mark.parametrize("engine", OPTIONAL)
def test_without_it_a_run_is_a_gap_that_says_how_to_get_it(engine):
    package, (wanted, *_) = OPTIONAL[engine], PROJECT["optional-dependencies"][engine]
    if importlib.util.find_spec(package):
        pytest.skip(f"{package} is installed")
    scenario = Scenario(name="test", title="", description="", parameters=TEN_TO_ONE, duration=0.01)
    one = import_module(f"looping_pendulum.engines.{engine}").engines(Profile.QUICK)[0]
    trajectory = run_isolated(one, scenario, time_limit=60)
    assert trajectory.status is RunStatus.MISSING
    assert f'pip install "{wanted}"' in trajectory.message
    assert trajectory.message == f"get it: {how_to_get(package, anywhere=True)}"


PACKAGES = {name: name for name in ("mujoco", "pymunk", "pybullet")} | OPTIONAL


@pytest.mark.parametrize("engine", PACKAGES)
def test_making_the_adapter_and_its_studies_does_not_import_it(engine):
    code = (
        f"import sys; from looping_pendulum.engines.{engine} import engines\n"
        "for profile in ('quick', 'accurate'):\n    for one in engines(profile): one.studies()\n"
        f"sys.exit({PACKAGES[engine]!r} in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False, timeout=60).returncode == 0


@pytest.mark.parametrize("engine", PACKAGES)
def test_studies_vary_what_they_say(engine):
    for profile in Profile:
        for one in import_module(f"looping_pendulum.engines.{engine}").engines(profile):
            studies = one.studies()
            for ladder in studies.ladders:
                rungs = [one.with_settings(**changes) for changes in ladder.changes]
                assert [getattr(rung.settings, ladder.setting) for rung in rungs] == pytest.approx(list(ladder.values))
                assert len(set(ladder.values)) == len(ladder.values)
            for entry in (*studies.defaults, *studies.choices):
                assert one.with_settings(**entry.changes).settings != one.settings


def test_one_engine_is_had_by_its_name_with_settings_of_ones_own():
    assert label(engine("mujoco:documented", profile="accurate")) == "mujoco:documented"
    assert label(engine("pybullet")) in {label(one) for one in main_engines(Profile.QUICK)}
    assert engine("reference").name == "reference"
    assert engine("mujoco:capstan", time_step=1e-4).settings.time_step == 1e-4
    assert engine("reference", tolerance=1e-6).settings.tolerance == 1e-6


@pytest.mark.parametrize(
    ("name", "settings", "message"),
    [
        ("mujocko", {}, "no engine is called 'mujocko'"),
        ("all", {}, "found several variants of 'all', needed one of box2d:"),
        ("mujoco:capstan", {"timestep": 1}, "mujoco:capstan: found no setting 'timestep', needed one of time_step, "),
        ("reference", {"time_step": 1}, "reference: found no setting 'time_step', needed one of tolerance"),
    ],
)
def test_an_engine_that_cannot_be_had_says_why(name, settings, message):
    with pytest.raises(EngineError, match=message):
        engine(name, **settings)
