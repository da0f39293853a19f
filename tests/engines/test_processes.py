"""Processes that the package starts import nothing because it lies in the working folder, and end with what started them."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from looping_pendulum.engines.isolation import run_isolated
from looping_pendulum.runs.trajectory import RunStatus
from looping_pendulum.scenarios.scenario import Scenario
from tests.apparatus import TEN_TO_ONE
from tests.engines.faulty import FaultyEngine, alive

ROOT = Path(__file__).parents[2]
SCENARIO = Scenario(name="s", title="", description="", parameters=TEN_TO_ONE, duration=0.05)
COMMAND = str(Path(sys.executable).with_name("looping-pendulum"))
PLANTED = (
    "mujoco", "pymunk", "pickle", "numpy", "scipy", "wasmtime", "json", "random", "socket", "tempfile", "threading", "typing",
    "multiprocessing", "yaml", "typer", "matplotlib", "xarray", "zarr", "dataclasses", "signal", "looping_pendulum",
)  # fmt: skip
"""Modules that one road or another imports: engines, libraries, the standard library, this package."""

linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks for processes in /proc")


@pytest.fixture
def planted(tmp_path):
    """Return a working folder in which every module, if imported, writes a file."""
    for name in PLANTED:
        trap = (
            f"open({str(tmp_path / name)!r} + '.sprung', 'w').close()\nraise SystemError('imported from the working folder')\n"
        )
        (tmp_path / f"{name}.py").write_text(trap)
    (tmp_path / "short.yaml").write_text(
        "title: Short\nlight: {mass: 10 g}\nheavy: {mass: 100 g}\nrod: {radius: 6.25 mm}\n"
        "release: {angle: 112 deg, free_length: 58 cm}\nduration: 10 ms\n"
    )
    return tmp_path


def sprung(folder):
    return sorted(path.stem for path in folder.glob("*.sprung"))


def run(folder, *arguments):
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"} | {"PYTHONPATH": str(ROOT)}
    return subprocess.run(arguments, cwd=folder, capture_output=True, text=True, timeout=300, env=clean)


@pytest.mark.long
@pytest.mark.parametrize(
    ("begin", "engine"),
    [([COMMAND], "mujoco:capstan"), ([sys.executable, "-m", "looping_pendulum"], "pymunk:chain")],
    ids=["command", "module"],
)
def test_commands_import_nothing_from_the_working_folder(planted, begin, engine):
    """Workers were started with -m and without -P: a mujoco.py beside a scenario was executed."""
    if begin != [COMMAND]:  # Python itself looks for that package, and for what `runpy` needs, in the working folder
        (planted / "looping_pendulum.py").unlink()
    done = run(planted, *begin, "run", "short.yaml", "-e", engine, "--out", "out")
    assert sprung(planted) == []
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.long
def test_an_engine_that_a_script_imports_from_its_folder_travels_and_shadows_nothing(tmp_path):
    (tmp_path / "my_helper.py").write_text("VARIANT = 'none'\n")
    (tmp_path / "my_engine.py").write_text(
        "from my_helper import VARIANT\nfrom tests.engines.faulty import FaultyEngine\n"
        "class Mine(FaultyEngine):\n"
        "    def __init__(self):\n        super().__init__(VARIANT)\n"
        "    def simulate(self, scenario, record=None):\n"
        "        import mujoco\n        print('site-packages' in mujoco.__file__, flush=True)\n"
        "        return super().simulate(scenario, record)\n"
    )
    (tmp_path / "mujoco.py").write_text("")
    (tmp_path / "script.py").write_text(
        "from my_engine import Mine\nfrom looping_pendulum.engines.isolation import run_isolated\n"
        "from tests.engines.test_processes import SCENARIO\n"
        "run = run_isolated(Mine(), SCENARIO)\nprint(run.status.name, run.message, run.output)\n"
    )
    done = run(tmp_path, sys.executable, "script.py")
    assert done.stdout.split("\n")[:1] == ["FINISHED  True"], done.stdout + done.stderr


KILLED = """
from looping_pendulum.engines.isolation import run_all
from tests.engines.faulty import FaultyEngine
from tests.engines.test_processes import SCENARIO
if __name__ == "__main__":
    run_all([FaultyEngine("hang_with_children"), FaultyEngine("hang")], SCENARIO, jobs=2)
"""


def of_session(marker):
    """Return the processes whose environment contains ``marker``."""
    process_ids = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if marker in (folder / "environ").read_bytes() and (folder / "stat").read_text().rsplit(")")[1].split()[0] != "Z":
                process_ids.append(int(folder.name))
        except OSError:
            continue
    return process_ids


def until(condition, seconds=60):
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.05)
    return True


TAKES_SIGNALS = """
import signal
signal.signal(signal.SIGHUP, signal.SIG_DFL)
signal.signal(signal.SIGINT, signal.default_int_handler)
"""
"""Where the tests run under nohup or in the background, these are ignored, and so they are by every process that they start."""


@pytest.mark.long
@linux
@pytest.mark.parametrize("sent", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_nothing_outlives_a_killed_command(tmp_path, sent):
    """A hung engine went on beyond its time limit, its children for ever, and the folders of all stayed."""
    (tmp_path / "script.py").write_text(TAKES_SIGNALS + KILLED)
    marker = f"TMPDIR={tmp_path}".encode()
    started = subprocess.Popen(
        [sys.executable, str(tmp_path / "script.py")], cwd=ROOT, env=os.environ | {"TMPDIR": str(tmp_path)}
    )
    try:
        # The command, two engines, two children
        assert until(lambda: len(of_session(marker)) >= 5, 60)
        started.send_signal(sent)
        started.wait(60)
        assert until(lambda: not of_session(marker), 30), of_session(marker)
        assert until(lambda: not list(tmp_path.glob("looping-pendulum-*")), 10)
    finally:
        for pid in of_session(marker):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)


@linux
def test_what_an_engine_leaves_behind_ends_with_it_even_in_a_session_of_its_own():
    left = run_isolated(FaultyEngine("leaves_child"), SCENARIO)
    assert left.status is RunStatus.FINISHED
    assert not alive(int(left.output.split()[-1]))


@pytest.mark.long
@linux
def test_a_run_leaves_no_folder(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    for fault in ("none", "segfault"):
        assert run_isolated(FaultyEngine(fault), SCENARIO).status in (RunStatus.FINISHED, RunStatus.CRASHED)
        assert list(tmp_path.iterdir()) == []


def test_a_folder_for_temporary_files_that_takes_none_is_a_gap_with_its_reason(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "gone"))
    run = run_isolated(FaultyEngine("none"), SCENARIO)
    assert run.status is RunStatus.CRASHED
    assert "could not start" in run.message
    assert "gone" in run.message
