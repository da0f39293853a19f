"""Engines that are optional: their adapters take the road of a third party's, and are a gap without their package."""

import importlib.util
import subprocess
import sys
import tomllib
from importlib import import_module
from pathlib import Path

import pytest

from looping_pendulum.engines.isolation import run_isolated
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.registry import ADAPTERS, ENTRY_POINTS, how_to_get
from looping_pendulum.engines.trajectory import RunStatus
from looping_pendulum.scenarios.scenario import Scenario
from tests.apparatus import TEN_TO_ONE

PROJECT = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
OPTIONAL = {
    "drake": ("pydrake", "drake>=1.51"),
    "box2d": ("pyb2d3", "pyb2d3>=0.11.1"),
    "rapier": ("rapier3d", "rapier3d>=0.36.1"),
    "exudyn": ("exudyn", "exudyn>=1.13.6"),
    "newton": ("newton", "newton>=1.8"),
}
"""Engine -> name of its package in Python, and what pip is asked for."""
NOT_WITH_THE_TESTS = {"newton"}
"""Engines that are not installed for the tests: Newton and Warp take 400 MB, and only the accurate tests run them."""


@pytest.mark.parametrize("engine", OPTIONAL)
def test_it_takes_the_third_partys_road(engine):
    """Oracle: pyproject.toml. Nothing but the entry point knows its adapter."""
    _, wanted = OPTIONAL[engine]
    assert PROJECT["entry-points"][ENTRY_POINTS][engine] == f"looping_pendulum.engines.{engine}"
    assert wanted in PROJECT["optional-dependencies"][engine]
    assert engine in NOT_WITH_THE_TESTS or any(need.startswith(wanted) for need in PROJECT["optional-dependencies"]["test"])
    assert not any(need.startswith(wanted.partition(">")[0]) for need in PROJECT["dependencies"])
    assert engine not in ADAPTERS


@pytest.mark.parametrize("engine", OPTIONAL)
def test_making_the_adapter_does_not_import_it(engine):
    package, _ = OPTIONAL[engine]
    code = (
        f"import sys; from looping_pendulum.engines.{engine} import engines; "
        f"engines('quick')[0].studies(); sys.exit({package!r} in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False, timeout=60).returncode == 0


@pytest.mark.parametrize("engine", OPTIONAL)
def test_without_it_a_run_is_a_gap_that_says_how_to_get_it(engine):
    package, wanted = OPTIONAL[engine]
    if importlib.util.find_spec(package):
        pytest.skip(f"{package} is installed")
    scenario = Scenario(name="test", title="", description="", parameters=TEN_TO_ONE, duration=0.01)
    one = import_module(f"looping_pendulum.engines.{engine}").engines(Profile.QUICK)[0]
    trajectory = run_isolated(one, scenario, time_limit=60)
    assert trajectory.status is RunStatus.MISSING
    assert f'pip install "{wanted}"' in trajectory.message
    assert trajectory.message == f"get it: {how_to_get(package, anywhere=True)}"


@pytest.mark.parametrize("engine", OPTIONAL)
def test_studies_vary_one_thing_at_a_time(engine):
    for one in import_module(f"looping_pendulum.engines.{engine}").engines(Profile.QUICK):
        studies = one.studies()
        for ladder in studies.ladders:
            assert [getattr(each.settings, ladder.setting) for each in ladder.engines] == list(ladder.values)
            assert getattr(one.settings, ladder.setting) in ladder.values
        assert all(each.engine.settings != one.settings for each in (*studies.defaults, *studies.choices))
