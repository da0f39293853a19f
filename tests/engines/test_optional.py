"""Adapters that take the road of a third party's and are a gap without their package, and what holds of every adapter."""

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


PACKAGES = {name: name for name in ("mujoco", "pymunk", "pybullet")} | {
    name: package for name, (package, _) in OPTIONAL.items()
}


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
                assert [getattr(rung.settings, ladder.setting) for rung in ladder.engines] == pytest.approx(list(ladder.values))
                assert len(set(ladder.values)) == len(ladder.values)
            for other in (entry.engine for entry in (*studies.defaults, *studies.choices)):
                assert other.variant == one.variant
                # The quick drum's step is as near to MuJoCo's default as samples allow
                assert vars(other) != vars(one) or (one.variant, profile) == ("drum", Profile.QUICK)
