"""The demonstrations: each script's claims hold, and a false one is noticed."""

import re
import subprocess
import sys

import pytest
from typer.testing import CliRunner

from looping_pendulum.cli.main import app
from looping_pendulum.demonstrations import runner
from looping_pendulum.demonstrations.runner import demonstrations, find_demonstrations, run_demonstration
from looping_pendulum.errors import HarnessError


def test_all_claims_hold_and_each_has_its_picture(tmp_path):
    runs = [run_demonstration(one, tmp_path) for one in demonstrations()]
    assert len(runs) == 9
    assert {run.demonstration.name: run.false_claim for run in runs if run.false_claim} == {}
    for run in runs:
        assert run.picture.startswith("data:image/png;base64,")
        assert run.caption
        assert list(run.demonstration.words) == ["Question", "Guess", "Experiment", "Change it"]
        assert run.demonstration.source.count("\nassert ") >= 3


def test_a_script_runs_alone(tmp_path):
    script = find_demonstrations(["8"])[0].script
    done = subprocess.run([sys.executable, script], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stderr == ""
    assert done.stdout.startswith("static / kinetic = 1.0: falls 43.5 cm at most")
    assert (tmp_path / "08_static_friction.png").exists()


def test_a_false_claim_is_noticed(tmp_path, monkeypatch):
    script, claim = find_demonstrations(["static_friction"])[0].script, "assert max(stops) - min(stops) < 1e-6"
    false = claim.replace("<", ">")
    text = script.read_text(encoding="utf-8")
    assert claim in text
    scripts = tmp_path / "scripts"
    scripts.mkdir()
    (scripts / script.name).write_text(text.replace(claim, false), encoding="utf-8")
    monkeypatch.setattr(runner, "SCRIPTS", scripts)
    done = CliRunner().invoke(app, ["demonstrations", "--out", str(tmp_path / "out")])
    assert done.exit_code == 1
    assert f"08_static_friction: not borne out by this run: {false}" in done.output
    page = (tmp_path / "out" / "index.html").read_text(encoding="utf-8")
    assert page.count("Not borne out by this run") == 1
    assert page.count("<img") == 1, "what the numbers show is still there to be seen"


def test_the_command_leaves_scripts_and_keeps_what_was_changed(tmp_path):
    (tmp_path / "04_polygon.py").write_text("mine = True\n")
    done = CliRunner().invoke(app, ["demonstrations", "04", "static_friction", "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    assert "Half the link, a quarter of the error" in done.output
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "04_polygon.png", "04_polygon.py", "08_static_friction.png", "08_static_friction.py", "index.html",
    ]  # fmt: skip
    assert (tmp_path / "04_polygon.py").read_text() == "mine = True\n"
    assert (tmp_path / "08_static_friction.py").read_text() == find_demonstrations(["8"])[0].source
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert not re.search(r'(src|href)="(?!data:|#)', page)


def test_they_are_listed_and_an_unknown_name_is_refused():
    done = CliRunner().invoke(app, ["demonstrations", "--list"])
    assert done.output.splitlines()[3] == "04_polygon               A polygon is not a circle"
    with pytest.raises(HarnessError, match="no demonstration 'polygone', needed one of 01_friction_on_the_rod, "):
        find_demonstrations(["polygone"])
