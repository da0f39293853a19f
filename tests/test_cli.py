"""The command line as a user meets it: exit status, one-line errors, what is written."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from unittest import mock

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from looping_pendulum.cli.main import GROUPS, app
from looping_pendulum.compare.result import ComparisonResult
from looping_pendulum.engines import Profile, registry
from looping_pendulum.files import write_atomically
from looping_pendulum.scenarios import loader
from tests.command_line import can_be_interrupted, here
from tests.compare.conftest import quick_figures  # noqa: F401, a fixture
from tests.engines.faulty import adapter_of

REFERENCE = "reference"
"""An engine whose process starts quickly."""


def command(*arguments):
    """Run a command in a process of its own; most tests take `here`, which imports nothing again."""
    return subprocess.run(
        [sys.executable, "-m", "looping_pendulum", *arguments],
        capture_output=True,
        text=True,
        timeout=120,
        env=os.environ | {"COLUMNS": "200"},
    )


def one_line_error(done):
    assert done.returncode == 2, done.stderr
    lines = [line for line in done.stderr.splitlines() if line.strip()]
    assert len(lines) == 1, done.stderr
    assert "Traceback" not in done.stderr
    return lines[0]


HELPED = """
import contextlib, io, json, sys
from looping_pendulum.cli.main import GROUPS, app
heavy = {"numpy", "scipy", "rich", "pint", "matplotlib"}
imported = sorted((heavy | {"pydantic"}) & set(sys.modules))  # pydantic: typer's own, for a command's options
help_texts = {}
for name in sys.argv[1:]:
    with contextlib.redirect_stdout(io.StringIO()) as out:
        app([name, "--help"], standalone_mode=False)
    help_texts[name] = out.getvalue()
json.dump([help_texts, imported + sorted(heavy & set(sys.modules))], sys.stdout)
"""


def test_the_help_has_a_whole_line_for_each_command():
    lines = CliRunner(env={"COLUMNS": "80"}).invoke(app, ["--help"]).stdout.splitlines()
    for group in GROUPS.values():
        for name, what in group.items():
            assert [line for line in lines if line.split() == [name, *what.split()]], name


def test_help_teaches_and_imports_nothing_heavy():
    done = command("--help")
    assert done.returncode == 0
    assert "looping-pendulum compare ten_to_one" in done.stdout
    names = sorted(typer.main.get_command(app).commands)
    assert len(names) > 10
    done = subprocess.run([sys.executable, "-c", HELPED, *names], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    help_texts, heavy = json.loads(done.stdout)
    assert heavy == []
    assert list(help_texts) == names
    for name in names:
        assert len(help_texts[name]) > 200, name


def test_engines_says_who_supplies_what_and_what_is_missing():
    done = here("engines")
    assert done.returncode == 0
    for name in ("mujoco:documented", "mujoco:capstan", "pymunk:chain", "pybullet:chain", "reference"):
        assert name in done.stdout
    assert "nobody" in done.stdout


def test_run_without_an_engine_runs_the_reference_and_writes_csv(tmp_path):
    done = here("run", "two_to_one", "--out", str(tmp_path))
    assert done.returncode == 0, done.stderr
    assert "halt" in done.stdout
    (path,) = tmp_path.glob("*.csv")
    assert "[m]" in path.read_text().splitlines()[0]
    assert "light_reaches_rod, after the scenario's end at 1.05 s" in done.stdout, "an event beside a run that ended before it"


def test_a_run_that_ends_before_its_scenario_says_so():
    assert "ran until the light mass reached the rod; the scenario lasts 1.05 s" in here("run", "fat_rod").stdout


def test_unknown_scenario_and_engine_are_one_line_each_with_a_way_out():
    assert "ten_to_one" in one_line_error(command("run", "ten_to_on"))
    assert "did you mean 'pymunk'" in one_line_error(here("compare", "ten_to_one", "-e", "pymnk"))
    for engine in ("pymunk", "mujoco:capstan"):
        assert f"found an engine, needed a scenario; write for example: ten_to_one --engine {engine}" in one_line_error(
            here("converge", engine)
        )


def test_an_output_folder_that_is_a_file_is_one_line(tmp_path):
    taken = tmp_path / "report"
    taken.write_text("mine")
    line = one_line_error(here("compare", "drop", "-e", REFERENCE, "--out", str(taken)))
    assert str(taken) in line
    assert taken.read_text() == "mine"


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    """What `compare` leaves of the drop."""
    folder = tmp_path_factory.mktemp("compared")
    done = here("compare", "drop", "-e", REFERENCE, "--out", str(folder))
    assert done.returncode == 0, done.stderr
    return folder


def test_compare_writes_the_whole_report(compared):
    assert {p.name for p in compared.iterdir()} >= {"report.md", "result.json", "figures", "trajectories"}
    result = ComparisonResult.from_json((compared / "result.json").read_text())
    assert result.scenario == "drop"
    report = (compared / "report.md").read_text()
    for figure in (compared / "figures").iterdir():
        assert f"figures/{figure.name}" in report


@pytest.mark.long
@pytest.mark.usefixtures("quick_figures")  # how figures are drawn is for the report above
def test_a_baseline_lists_what_changed_and_leaves_the_exit_status(compared, tmp_path):
    old, new = tmp_path / "old", tmp_path / "new"
    shutil.copytree(compared, old)
    done = here("compare", "drop", "-e", REFERENCE, "--out", str(new), "--baseline", str(old))
    assert done.returncode == 0, done.stderr
    assert f"Nothing changed since {old}" in done.stdout
    tree = json.loads((old / "result.json").read_text())
    tree["engines"][0]["metrics"]["tube_fraction"] = 0.5
    (old / "result.json").write_text(json.dumps(tree))
    done = here("compare", "drop", "-e", REFERENCE, "--out", str(new), "--baseline", str(old / "result.json"))
    assert done.returncode == 0, done.stderr
    assert f"1 change since {old}/result.json" in done.stdout
    assert "metrics: tube_fraction" in done.stdout
    assert "+100 %" in done.stdout
    (change,) = json.loads((new / "changes.json").read_text())["changes"]
    assert (change["what"], change["before"], change["after"]) == ("metrics: tube_fraction", 0.5, 1.0)
    assert "## Changes since the baseline" in (new / "report.md").read_text()
    done = here("compare", "drop", "-e", REFERENCE, "--out", str(new), "--baseline", str(old), "--baseline-threshold", "2")
    assert "metrics:" not in done.stdout
    line = one_line_error(here("compare", "held", "--baseline", str(old)))
    assert "found a result of 'drop', needed one of 'held'" in line
    assert "No such file" in one_line_error(here("compare", "drop", "--baseline", str(tmp_path / "nowhere.json")))


@pytest.mark.long
def test_a_memory_limit_has_a_unit_and_stops_a_run(offer):
    assert "write for example '2 GiB'" in here("run", "drop", "--memory-limit", "2").stderr
    offer(faulty=adapter_of("FaultyEngine('memory')"))
    done = here("run", "two_to_one", "-e", "faulty", "--memory-limit", "300 MiB")
    assert done.returncode == 1, done.stderr
    assert "stopped by its memory limit; raise --memory-limit" in " ".join(done.stdout.split())


@pytest.mark.long
def test_outside_tolerance_is_exit_status_one(tmp_path):
    text = loader.source_text("drop")
    start = text.index("tolerances:") if "tolerances:" in text else len(text)
    strict = text[:start] + (
        "tolerances:\n  reference:\n    quick:\n      tube_fraction: {limit: 1.5, reason: cannot be kept}\n"
    )
    path = tmp_path / "strict.yaml"
    path.write_text(strict)
    done = here("check", str(path), "-e", "reference")
    assert done.returncode == 1, done.stdout + done.stderr
    assert "fail" in done.stdout
    assert "at least 150 %" in done.stdout, "a limit with its unit"


def limited(folder, tolerances):
    """Path of the shipped drop with other tolerances."""
    text = loader.source_text("drop")
    path = folder / "mine.yaml"
    path.write_text(text[: text.index("tolerances:")] + tolerances)
    return str(path)


LIMIT = "tolerances: {%s: {quick: {tube_fraction: {limit: 0.5, reason: easily kept}}}}\n"


def test_a_check_that_judges_nothing_is_exit_status_two(tmp_path, offer):
    offer(faulty=adapter_of("FaultyEngine('missing', packages=('no_such_package',), releases=Release)"))
    path = limited(tmp_path, LIMIT % "'faulty:missing'")
    done = here("check", path)
    assert done.returncode == 2
    assert "not run" in done.stdout  # the gap stays visible
    assert "nothing was judged of mine: faulty:missing: the engine is not installed" in done.stderr
    assert "nothing was judged of mine: no tolerances for profile accurate: it has them for profile quick" in one_line_error(
        here("check", path, "-p", "accurate")
    )
    assert "nothing was judged: no scenario has tolerances" in one_line_error(here("check", path, "-e", "pymunk"))
    assert "add some under `tolerances:`" in one_line_error(here("check", limited(tmp_path, "")))


def test_an_unknown_engine_in_a_tolerance_or_option_is_an_error(tmp_path):
    path = limited(tmp_path, LIMIT % "'pymunk:chian'")
    message = "mine: tolerances: no engine is called 'pymunk:chian'; did you mean 'pymunk:chain'?"
    assert message in one_line_error(here("check", path))
    assert message in one_line_error(here("compare", path, "-e", "reference", "--out", str(tmp_path / "report")))
    assert "--engine: no engine is called 'pymnk'" in one_line_error(here("check", "drop", "-e", "pymnk"))


@pytest.mark.long
def test_a_tolerance_under_an_engines_name_is_judged_of_its_main_variants(tmp_path):
    pytest.importorskip("mujoco")
    done = here("check", limited(tmp_path, LIMIT % "mujoco"))
    assert done.returncode == 0, done.stderr
    main = [engine for engine in registry.main_engines(Profile.QUICK) if engine.name == "mujoco"]
    assert done.stdout.count("pass") == len(main) >= 2, done.stdout


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
def test_interrupt_keeps_what_was_computed(tmp_path):
    arguments = [sys.executable, "-m", "looping_pendulum", "compare", "held", "-e", "pymunk", "--out", str(tmp_path)]
    pytest.importorskip("pymunk")
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    environment = os.environ | {"TMPDIR": str(scratch)}
    process = subprocess.Popen(
        arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment, preexec_fn=can_be_interrupted
    )
    deadline = time.monotonic() + 180
    while not any(path.stat().st_size for path in scratch.glob("*/samples.bin")) and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=180)
    assert process.returncode == 130, stderr
    assert "Traceback" not in stderr
    assert "interrupted by the user" in (tmp_path / "report.md").read_text()


@pytest.mark.long
@pytest.mark.usefixtures("quick_figures")
def test_the_page_appears_with_the_first_engine_and_a_complete_one_is_kept(tmp_path, offer):
    """One after the other, so that one ends while the other has yet to start; both pages are read as they are written."""
    offer(faulty=adapter_of("FaultyEngine('none')"))
    arguments = ["compare", "ten_to_one", "-e", "faulty", "-e", REFERENCE, "--jobs", "1", "--out", str(tmp_path / "out")]
    page, pages = tmp_path / "out" / "report.html", []

    def keep(path, content):
        write_atomically(path, content)
        if path == page:
            pages.append(path.read_text())

    with mock.patch("looping_pendulum.compare.write_atomically", keep):
        first, again = here(*arguments), here(*arguments)
    assert len(pages) == 3
    assert [f"{REFERENCE}. This page is about the others" in one for one in pages] == [True, False, False]
    assert "report.html has the engines that have ended" in first.stderr
    assert "have ended" not in again.stderr  # a complete report is there, and would be lost with an interrupt


@pytest.mark.long
@pytest.mark.usefixtures("quick_figures")
def test_marks_stand_beside_the_runs_and_mistakes_in_them_are_one_line(tmp_path):
    """A free fall that begins 0.1 s into the clip, measured from the ground; oracle: g t^2 / 2 less the planted 20 mm."""
    t = np.arange(0, 60) / 120
    height = 30 - 0.5 * 9.81 * np.maximum(t - 0.1, 0) ** 2 - 0.02 * (t > 0.4)
    marks = tmp_path / "fall.csv"
    marks.write_text("time,height\n" + "".join(f"{a},{b}\n" for a, b in zip(t.tolist(), height.tolist(), strict=True)))
    scenario = tmp_path / "vacuum.yaml"
    light = "light: {mass: 10 g}\nheavy: {mass: 100 g}\nrod: {radius: 6 mm}\nduration: 0.5 s\ngravity: 9.81 m/s^2\n"
    scenario.write_text(f"title: V\ndescription: V\n{light}release: {{kind: drop, angle: 90 deg, free_length: 50 cm}}\n")
    arguments = ["compare", str(scenario), "-e", REFERENCE, "--out", str(tmp_path / "out"), "--marks", str(marks)]
    done = here(*arguments, "--marks-set", "camera.clock_offset=-0.1 s")
    assert done.returncode == 0, done.stderr
    result = ComparisonResult.from_json((tmp_path / "out" / "result.json").read_text())
    (heavy,) = result.trial.tracks
    late = np.sum(t > 0.4)
    assert heavy.reference.rms == pytest.approx(0.02 * np.sqrt(late / heavy.reference.compared), abs=1e-5)
    assert heavy.engines[0].rms == pytest.approx(heavy.reference.rms, abs=1e-6)
    assert "heavy mass: RMS residual [mm]" in done.stdout
    assert (tmp_path / "out" / "residuals.csv").exists()
    assert "## Against the measured trial" in (tmp_path / "out" / "report.md").read_text()
    assert "--marks-set: found it without --marks" in one_line_error(here(*arguments[:-2], "--marks-set", "mirrored=true"))
    assert "nowhere.csv: cannot be read" in one_line_error(here(*arguments[:-1], str(tmp_path / "nowhere.csv")))
