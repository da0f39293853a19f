"""The command line as a user meets it: exit status, one-line errors, what is written."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time

import pytest

from looping_pendulum.compare.result import ComparisonResult


def command(*arguments, cwd=None, timeout=120):
    return subprocess.run(
        [sys.executable, "-m", "looping_pendulum", *arguments],
        capture_output=True,
        text=True,
        cwd=cwd,
        timeout=timeout,
        env=os.environ | {"COLUMNS": "200", "PYTHONPATH": os.getcwd()},
    )


def one_line_error(done):
    assert done.returncode == 2, done.stderr
    lines = [line for line in done.stderr.splitlines() if line.strip()]
    assert len(lines) == 1, done.stderr
    assert "Traceback" not in done.stderr
    return lines[0]


def test_help_teaches_and_imports_nothing_heavy():
    done = command("--help")
    assert done.returncode == 0
    assert "looping-pendulum compare ten_to_one" in done.stdout
    heavy = "{'numpy', 'scipy', 'rich', 'pydantic', 'pint', 'matplotlib'} & set(sys.modules)"
    program = f"import sys, looping_pendulum.cli; print({heavy})"
    assert subprocess.run([sys.executable, "-c", program], capture_output=True, text=True).stdout.strip() == "set()"


@pytest.mark.parametrize("name", ["scenarios", "engines", "run", "compare", "check"])
def test_every_command_has_help(name):
    done = command(name, "--help")
    assert done.returncode == 0
    assert len(done.stdout) > 200


def test_scenarios_lists_prints_and_describes():
    assert "ten_to_one" in command("scenarios").stdout
    assert "6" in command("scenarios", "ten_to_one").stdout
    assert json.loads(command("scenarios", "--schema").stdout)["type"] == "object"


def test_engines_says_who_supplies_what_and_what_is_missing():
    done = command("engines")
    assert done.returncode == 0
    for name in ("mujoco:documented", "mujoco:capstan", "pymunk:chain", "pybullet:chain", "reference:scipy"):
        assert name in done.stdout
    assert "nobody" in done.stdout


def test_run_without_an_engine_runs_the_reference_and_writes_csv(tmp_path):
    done = command("run", "two_to_one", "--out", str(tmp_path))
    assert done.returncode == 0, done.stderr
    assert "halt" in done.stdout
    (path,) = tmp_path.glob("*.csv")
    assert "[m]" in path.read_text().splitlines()[0]


def test_unknown_scenario_and_engine_are_one_line_each_with_a_way_out():
    assert "ten_to_one" in one_line_error(command("run", "ten_to_on"))
    assert "did you mean 'pymunk'" in one_line_error(command("compare", "ten_to_one", "-e", "pymnk"))


def test_an_output_folder_that_is_a_file_is_one_line(tmp_path):
    taken = tmp_path / "report"
    taken.write_text("mine")
    line = one_line_error(command("compare", "drop", "-e", "reference:scipy", "--out", str(taken)))
    assert str(taken) in line
    assert taken.read_text() == "mine"


def test_compare_writes_the_whole_report(tmp_path):
    done = command("compare", "drop", "-e", "reference:scipy", "--out", str(tmp_path))
    assert done.returncode == 0, done.stderr
    assert {p.name for p in tmp_path.iterdir()} >= {"report.md", "result.json", "figures", "trajectories"}
    result = ComparisonResult.from_json((tmp_path / "result.json").read_text())
    assert result.scenario == "drop"
    report = (tmp_path / "report.md").read_text()
    for figure in (tmp_path / "figures").iterdir():
        assert f"figures/{figure.name}" in report


def test_outside_tolerance_is_exit_status_one(tmp_path):
    text = command("scenarios", "drop").stdout
    start = text.index("tolerances:") if "tolerances:" in text else len(text)
    strict = text[:start] + (
        "tolerances:\n  reference:scipy:\n    quick:\n      tube_fraction: {limit: 1.5, reason: cannot be kept}\n"
    )
    path = tmp_path / "strict.yaml"
    path.write_text(strict)
    done = command("check", str(path), "-e", "reference")
    assert done.returncode == 1, done.stdout + done.stderr
    assert "fail" in done.stdout


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
def test_interrupt_keeps_what_was_computed(tmp_path):
    arguments = [sys.executable, "-m", "looping_pendulum", "compare", "held", "-e", "pymunk", "--out", str(tmp_path)]
    pytest.importorskip("pymunk")
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    environment = os.environ | {"TMPDIR": str(scratch)}
    process = subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)
    deadline = time.monotonic() + 60
    while not any(path.stat().st_size for path in scratch.glob("*/samples.bin")) and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=60)
    assert process.returncode == 130, stderr
    assert "Traceback" not in stderr
    assert "interrupted by the user" in (tmp_path / "report.md").read_text()
