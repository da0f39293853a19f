"""The worked example of docs/write-an-engine.md: its code is taken from the page, installed and held against the suite."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from looping_pendulum.engines.conformance import CHECKS, left_out
from looping_pendulum.engines.protocol import Engine, Profile

PAGE = Path(__file__).parents[2] / "docs" / "write-an-engine.md"


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    """The example, installed into a folder as pip would: a module and the entry point of its pyproject.toml."""
    import tomllib

    folder = tmp_path_factory.mktemp("site")
    project = tomllib.loads(blocks("toml")[0])["project"]
    (folder / "looping_spring.py").write_text(blocks("python")[0], encoding="utf-8")
    info = folder / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n")
    points = [f"[{group}]\n" + "".join(f"{k} = {v}\n" for k, v in p.items()) for group, p in project["entry-points"].items()]
    (info / "entry_points.txt").write_text("".join(points))
    return folder


@pytest.fixture
def engine(package, monkeypatch):
    monkeypatch.syspath_prepend(str(package))
    import looping_spring

    (made,) = looping_spring.engines(Profile.QUICK)
    return made


def command(package, *arguments):
    path = os.pathsep.join([str(package), os.getcwd()])
    return subprocess.run(
        [sys.executable, "-m", "looping_pendulum", *arguments],
        capture_output=True,
        text=True,
        timeout=240,
        env=os.environ | {"COLUMNS": "200", "PYTHONPATH": path},
    )


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_the_example_passes_every_check(engine, check):
    assert isinstance(engine, Engine)
    assert not left_out(check, engine)
    check(engine)


def test_the_command_examines_it_and_the_list_says_where_it_is_from(package):
    done = command(package, "conformance", "spring")
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("  pass ") == len(CHECKS)
    done = command(package, "engines")
    assert "spring:euler" in done.stdout
    assert "of the package looping-spring" in re.sub(r"\s+", " ", done.stdout)
    assert done.stderr == ""


def test_compare_runs_it_beside_the_others(package, tmp_path):
    done = command(package, "compare", "ten_to_one", "-e", "spring", "-e", "reference:scipy", "--out", str(tmp_path))
    assert done.returncode == 0, done.stdout + done.stderr
    assert "spring:euler" in (tmp_path / "report.md").read_text()
    assert "looping-spring 0.1" in (tmp_path / "report.md").read_text()


def test_the_pages_test_snippet_runs(package, tmp_path):
    (tmp_path / "test_spring.py").write_text(blocks("python")[1])
    path = os.pathsep.join([str(package), os.getcwd()])
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-k", "heavy or rest or supplies", str(tmp_path)],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": path},
    )
    assert done.returncode == 0, done.stdout
    assert "passed" in done.stdout
