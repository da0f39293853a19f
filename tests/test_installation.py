"""Hints about missing packages: the printed command is run as it stands, in environments made by different programs."""

import os
import shutil
import subprocess
import sys
import venv
import zipfile
from importlib.machinery import PathFinder
from pathlib import Path

import pytest

from looping_pendulum import installation
from looping_pendulum.engines.registry import how_to_get
from looping_pendulum.installation import install_command
from tests.docs_commands import PROJECT

PACKAGE = "lp_test_package"
"""Name of a package that is made for these tests; pip finds it in a folder, not in the network."""


def make_wheel(folder: Path) -> None:
    """Write the smallest wheel that pip accepts."""
    about = f"{PACKAGE}-1.0.dist-info"
    with zipfile.ZipFile(folder / f"{PACKAGE}-1.0-py3-none-any.whl", "w") as wheel:
        wheel.writestr(f"{PACKAGE}.py", "")
        wheel.writestr(f"{about}/METADATA", f"Metadata-Version: 2.1\nName: {PACKAGE}\nVersion: 1.0\n")
        wheel.writestr(f"{about}/WHEEL", "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
        wheel.writestr(f"{about}/RECORD", "")


@pytest.fixture
def environment(tmp_path):
    """Return a function that makes an environment with this package and some others, and returns its Python."""
    make_wheel(tmp_path)

    def make(name: str, *packages: str) -> Path:
        venv.create(tmp_path / name, symlinks=os.name != "nt")
        for package in packages:  # copied, since installing would take seconds
            source = Path(PathFinder.find_spec(package).origin).parent
            shutil.copytree(source, tmp_path / f"{name} packages" / package)
        (site,) = (tmp_path / name).glob("Lib/site-packages" if os.name == "nt" else "lib/*/site-packages")
        (site / "some.pth").write_text(f"{tmp_path / name} packages\n{PROJECT}\n", encoding="utf-8")
        return tmp_path / name / ("Scripts/python.exe" if os.name == "nt" else "bin/python")

    return make


def run_in(folder: Path, command: list[str] | str) -> str:
    """Run a command, in a shell that has activated nothing if it is a line of text, and return what it prints."""
    variables = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    return subprocess.run(
        command,
        cwd=folder,
        shell=isinstance(command, str),
        check=True,
        timeout=60,
        stdout=subprocess.PIPE,
        text=True,
        env=variables,
    ).stdout.strip()


PRINT = f"from looping_pendulum.installation import install_command; print(install_command({PACKAGE!r}))"


@pytest.mark.long
@pytest.mark.parametrize(("name", "inside"), [("env", True), ("an environment", False)], ids=["env below", "blank, elsewhere"])
def test_the_printed_command_installs_into_the_environment_that_printed_it(environment, tmp_path, name, inside):
    """Oracle: pip itself."""
    folder = tmp_path if inside else tmp_path.parent
    python = environment(name, "packaging", "pip")
    line = run_in(folder, [python, "-c", PRINT])
    assert line.startswith(name) is inside
    run_in(folder, f'{line} --quiet --no-index --find-links "{tmp_path}"')
    run_in(folder, [python, "-c", f"import {PACKAGE}"])


def test_without_pip_in_the_environment_uv_installs(environment, tmp_path):
    """Oracle: uv itself, whose environments have no pip."""
    uv = shutil.which("uv", path=str(Path(sys.executable).parent)) or shutil.which("uv")
    python = environment("env", "packaging")
    line = run_in(tmp_path.parent, [python, "-c", PRINT])
    assert line.startswith("uv pip install --python ")
    if uv is None:
        pytest.skip("uv is not installed")
    run_in(tmp_path.parent, f'"{uv}"{line.removeprefix("uv")} --quiet --offline --no-index --find-links "{tmp_path}"')
    run_in(tmp_path, [python, "-c", f"import {PACKAGE}"])


def test_in_an_environment_of_pipx_pipx_injects(tmp_path, monkeypatch):
    (tmp_path / "pipx_metadata.json").touch()
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    assert install_command("sympy") == 'pipx inject looping-pendulum "sympy>=1.13"'


def test_the_versions_are_those_of_the_project_and_shells_take_them_as_they_stand(monkeypatch):
    monkeypatch.setattr(installation, "requires", lambda _: ["drake>=1.51; extra == 'drake'", "dask[distributed]>=2025.1"])
    assert install_command("Drake", "dask", anywhere=True) == 'pip install "drake>=1.51" "dask[distributed]>=2025.1"'
    assert install_command("no_such_package", anywhere=True) == "pip install no_such_package"


def test_sources_that_nobody_installed_have_hints_without_versions(monkeypatch):
    monkeypatch.setattr(installation, "DISTRIBUTION", "no-such-distribution")
    assert install_command("drake", anywhere=True) == "pip install drake"


@pytest.mark.parametrize("package", ["mujoco", "pymunk", "pybullet", "pydrake", "wasmtime"])
def test_every_engines_hint_asks_pip_for_a_package_of_this_project(package):
    hint = how_to_get(package)
    assert sys.executable.removeprefix(str(Path.cwd())).lstrip("/\\") in hint or "uv pip" in hint or "pipx" in hint
    assert ">=" in hint, "the name is none of those in pyproject.toml"


def test_a_hint_for_other_machines_names_no_folder_of_this_one():
    assert str(Path(sys.prefix)) not in how_to_get("pydrake", anywhere=True)


@pytest.mark.parametrize(
    ("word", "line"), [(r"C:\env\python.exe", r"C:\env\python.exe"), (r"C:\my env\python.exe", r'& "C:\my env\python.exe"')]
)
def test_powershell_runs_a_path_with_blanks(word, line, monkeypatch):
    monkeypatch.setattr(installation.os, "name", "nt")
    assert installation.quoted(word) == line
