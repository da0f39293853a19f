"""The wheel, as a user gets it: it has every file that the package reads, and its commands run from it alone."""

import os
import subprocess
import sys
import tomllib
import venv
import zipfile
from email.parser import HeaderParser
from pathlib import Path

import pytest

from looping_pendulum import __version__

PROJECT = Path(__file__).parents[1]
PACKAGE = "looping_pendulum"
BUILD = "import sys; from hatchling.build import build_wheel; build_wheel(sys.argv[1])"
"""Hatchling by its own interface, since pip would download it anew into an environment for the build."""
REQUIRED = frozenset(
    {
        *("scenarios/ten_to_one.yaml", "sweep/maps/quick.yaml", "engines/pymunk/engine.json"),
        *(
            "pages/assets/base.html",
            "pages/assets/tables.js",
            "demonstrations/assets/demonstrations.html",
            "demonstrations/04_polygon.py",
        ),
        *("teaching/example/study.yaml", "teaching/example/trials/first.csv", "teaching/example/README.md", "py.typed"),
        *(
            "live/model.js",
            "live/run.js",
            "live/core.js",
            "live/assets/live.html",
            "live/assets/trial/reader.js",
            "live/assets/engine_runs/motion.js",
        ),
    }
)
"""Files that are no modules, one of each sort: what the test of all files compares with must itself not be empty."""
WHERE = """
from importlib.metadata import entry_points
import looping_pendulum
from looping_pendulum.processes import import_path
print(looping_pendulum.__file__)
print(import_path()[0])
print(sum(point.name == "drake" for point in entry_points(group="looping_pendulum.engines")))
"""


def done(*arguments, folder, **variables):
    """What a command printed, after it has succeeded."""
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONSAFEPATH")}
    process = subprocess.run(
        [str(each) for each in arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=900,
        env=environment | {"COLUMNS": "200"} | variables,
    )
    assert process.returncode == 0, f"{arguments}: {process.stdout[-2000:]} {process.stderr[-3000:]}"
    return process.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    pytest.importorskip("hatchling", reason="hatchling is not installed: pip install hatchling")
    folder = tmp_path_factory.mktemp("dist")
    done(sys.executable, "-c", BUILD, folder, folder=PROJECT)
    (path,) = folder.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def site(wheel, tmp_path_factory):
    """A folder that holds the installed wheel and nothing else; dependencies come from the environment that runs the tests."""
    folder = tmp_path_factory.mktemp("site")
    install = ("-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--no-compile", "--disable-pip-version-check")
    done(sys.executable, *install, "--target", folder, wheel, folder=folder)
    return folder


@pytest.fixture
def command(site, tmp_path):
    """Run Python in an empty folder, with the wheel before the editable install, and without that empty folder (-P)."""
    return lambda *arguments: done(sys.executable, "-P", *arguments, folder=tmp_path, PYTHONPATH=str(site))


def test_the_wheel_has_every_file_of_the_package_and_no_other(wheel):
    here = {p.relative_to(PROJECT / PACKAGE).as_posix() for p in (PROJECT / PACKAGE).rglob("*") if p.is_file()}
    here = {name for name in here if "__pycache__" not in name and not name.endswith("MUJOCO_LOG.TXT")}
    assert here >= REQUIRED
    packed = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    assert packed == {f"{PACKAGE}/{name}" for name in here}


def test_the_wheel_says_what_the_project_says(wheel):
    about = f"{PACKAGE}-{__version__}.dist-info"
    files = zipfile.ZipFile(wheel)
    metadata = HeaderParser().parsestr(files.read(f"{about}/METADATA").decode())
    assert (metadata["Name"], metadata["Version"]) == ("looping-pendulum", __version__)
    assert metadata["License-Expression"] == "MIT"
    assert f"{about}/licenses/LICENSE" in files.namelist()
    points = files.read(f"{about}/entry_points.txt").decode()
    scripts = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["scripts"]
    assert f"looping-pendulum = {scripts['looping-pendulum']}\n" in points
    assert "[pytest11]" in points


@pytest.mark.long
def test_what_runs_is_the_wheel_and_so_it_is_in_the_processes_that_it_starts(command, site):
    module, first, drakes = command("-c", WHERE).splitlines()
    assert Path(module).is_relative_to(site)
    assert Path(first) == site
    assert drakes == "1"  # the checkout, which is installed too, must not offer its engines a second time


@pytest.mark.long
def test_its_commands_run_from_an_empty_folder(command, tmp_path):
    command("-m", PACKAGE, "init", "mine")
    assert (tmp_path / "mine" / "trials" / "second.csv").is_file()
    # The cheapest run of an engine in a process of its own, judged by the tolerances in a packed scenario.
    assert "pass" in command("-m", PACKAGE, "check", "atwood", "--engine", "mujoco:capstan")


@pytest.mark.accurate
def test_in_a_bare_environment_pip_finds_all_that_it_needs(wheel, tmp_path):
    """With the network: nothing but what the wheel itself names is there."""
    venv.create(tmp_path / "bare", with_pip=True)
    python = tmp_path / "bare" / ("Scripts" if os.name == "nt" else "bin") / "python"
    done(python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", wheel, folder=tmp_path)
    module = done(python, "-P", "-c", f"import {PACKAGE}; print({PACKAGE}.__file__)", folder=tmp_path)
    assert Path(module.strip()).is_relative_to(tmp_path / "bare")
    assert "halt" in done(python, "-P", "-m", PACKAGE, "run", "ten_to_one", folder=tmp_path)
    done(python, "-P", "-m", PACKAGE, "compare", "atwood", "--out", "report", folder=tmp_path)
    assert (tmp_path / "report" / "report.html").is_file()
