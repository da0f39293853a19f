"""A file of the user's own is never overwritten without --force, by any command that is told or chooses a file's name."""

from pathlib import Path

import pytest
import typer

from looping_pendulum.cli.main import app
from tests.command_line import here

MINE = "an hour of my work\n"
TABLE = "t [s],light_x [m],light_y [m],heavy_x [m],heavy_y [m]\n" + "".join(
    f"{i / 100},{-0.5 + i / 500},{-0.2 - i / 400},0.006,{-0.05 - 4.5 * (i / 100) ** 2}\n" for i in range(30)
)
NAMED = {
    "mine.yaml": ("new", "scenario", "mine"),
    "my_study.yaml": ("new", "study", "table.csv"),
    "ten-to-one-tracker.csv": ("tracker", "ten_to_one"),
    "overlay.csv": ("tracker", "ten_to_one", "--out", "overlay.csv"),
    "live.html": ("live", "--no-open"),
    "page.html": ("live", "--no-open", "--out", "page.html"),
    "plain.csv": ("look", "table.csv", "--write", "plain.csv"),
}
"""File -> a command that writes it."""
IN_FOLDERS = {
    "thesis/report.md": ("compare", "ten_to_one", "--engine", "mujoco:capstan", "--out", "thesis"),
    "thesis/convergence.md": ("converge", "ten_to_one", "--engine", "mujoco:capstan", "--out", "thesis"),
    "thesis/map.md": ("map", "quick", "--out", "thesis"),
    "thesis/repaired.yaml": ("identify", "study.yaml", "--out", "thesis"),
}
"""The same for commands that write a report into a folder, where --force is not needed: there are other folders."""
STUDY = """title: x
apparatus:
  light: {mass: 10 g}
  rod: {radius: 6 mm}
trials:
  - file: table.csv
    heavy: {mass: 100 g}
    release: {kind: looping, angle: 110 deg, free_length: 54 cm}
"""
WITHOUT_NAMES = {"run", "check", "engines", "conformance", "scenarios", "track", "init", "demonstrations", "demo"}
"""Commands that name their files by engines, that print only, or that tests of their own hold to it (track, init)."""


@pytest.fixture
def own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("table.csv").write_text(TABLE)
    Path("study.yaml").write_text(STUDY)
    Path("thesis").mkdir()

    def write(name):
        Path(name).write_text(MINE)
        return Path(name)

    return write


@pytest.mark.parametrize("name", NAMED)
def test_a_named_file_is_left_as_it_is_without_force(own, name):
    path, command = own(name), NAMED[name]
    done = here(*command)
    assert done.returncode == 2
    assert path.read_text() == MINE
    assert f"{name}: found a file, which is left as it is; name another, or add --force to overwrite this one" in done.stderr
    assert here(*command, "--force").returncode == 0
    assert path.read_text() != MINE


@pytest.mark.parametrize("name", IN_FOLDERS)
def test_a_folder_with_a_users_own_file_is_no_place_for_a_report(own, name):
    path = own(name)
    done = here(*IN_FOLDERS[name])
    assert done.returncode == 2
    assert path.read_text() == MINE
    if name == "thesis/map.md":  # a map's folder has nothing else in it
        assert done.stderr.endswith(
            "found other files (map.md), needed an empty folder or one of this map; choose another with --out\n"
        )
    else:
        assert f"--out: {path}: found a file, but no " in done.stderr
        assert done.stderr.endswith("it is left as it is; choose another folder\n")


def test_no_command_is_left_out():
    held = {command[0] for command in (*NAMED.values(), *IN_FOLDERS.values())}
    assert held | WITHOUT_NAMES == set(typer.main.get_command(app).commands)
