"""The command that makes maps: what it prints and writes, and how it ends when it is interrupted."""

import json
import re
import signal
import socket
import subprocess
import time
from contextlib import ExitStack
from functools import partial
from importlib.util import find_spec

import pytest
from typer.testing import CliRunner

from looping_pendulum.cli.main import app
from looping_pendulum.errors import EngineError
from looping_pendulum.sweep import dask_cluster, map_file, open_map, run_map, runner
from looping_pendulum.sweep.cells import ENDINGS
from looping_pendulum.sweep.dask_cluster import CONNECT_TIME
from looping_pendulum.sweep.store import MapStore
from tests.command_line import can_be_interrupted
from tests.sweep import fake
from tests.sweep.maps import GRID, LONG, SAMPLE, chunk_files, contents, program
from tests.sweep.test_runner import run_silently


def test_the_command_says_after_ctrl_c_how_to_go_on(tmp_path, monkeypatch):
    written = []

    def write(store, region, values):
        if len(written) == 4:
            raise KeyboardInterrupt
        written.append(region)
        put(store, region, values)

    put = MapStore.write
    monkeypatch.setattr(MapStore, "write", write)
    monkeypatch.setattr(runner, "run_map", partial(run_map, solve=fake.solve))
    (tmp_path / "map.yaml").write_text(GRID)
    arguments = ["map", str(tmp_path / "map.yaml"), "--out", str(tmp_path / "out"), "--jobs", "1"]
    done = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert done.exit_code == 130
    assert re.search(r"interrupted: 48 of 72 runs are kept in .*out; the same command continues from there", done.stderr)


@pytest.mark.accurate
def test_the_exact_solver_gives_the_same_bytes_in_every_process(tmp_path):
    (tmp_path / "map.yaml").write_text(LONG.replace("chunk: 12", "chunk: 1000").replace("1e-6", "1e-9"))
    for out in ("one", "two"):
        arguments = ("map", tmp_path / "map.yaml", "--out", tmp_path / out, "--jobs", 1)
        done = subprocess.run(**program("looping_pendulum", *arguments), capture_output=True, text=True, timeout=200)
        assert done.returncode == 0, done.stderr
    assert contents(tmp_path / "one") == contents(tmp_path / "two")


@pytest.mark.accurate
def test_ctrl_c_at_the_command_line(tmp_path):
    (tmp_path / "map.yaml").write_text(LONG.replace("1e-6", "1e-12").replace("count: 12", "count: 400"))
    arguments = ("map", tmp_path / "map.yaml", "--out", tmp_path / "out", "--jobs", 2)
    process = subprocess.Popen(
        **program("looping_pendulum", *arguments), stderr=subprocess.PIPE, text=True, preexec_fn=can_be_interrupted
    )
    while process.poll() is None and len(chunk_files(tmp_path / "out")) < 2:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130, said
    assert said.startswith("6000 runs (15 x 400: release_angle, mass_ratio) in ")
    assert "Traceback" not in said
    kept = re.search(r"interrupted: (\d+) of 6000 runs are kept in .*; the same command continues from there", said)
    assert int(kept[1]) >= 12


def test_the_size_of_a_sample_names_what_varies(tmp_path):
    (tmp_path / "map.yaml").write_text(SAMPLE)
    done = CliRunner().invoke(app, ["map", str(tmp_path / "map.yaml"), "--out", str(tmp_path / "out"), "--no-figures"])
    assert done.stderr.startswith("100 runs (100: release_angle, rod_radius) in ")


def test_the_command_maps_and_reports(tmp_path):
    text = GRID.replace("count: 6", "count: 3").replace(
        "mass_ratio: {from: 1, to: 12, count: 12}", "static_friction: [0.3, 0.5]"
    )
    (tmp_path / "map.yaml").write_text(text)
    arguments = ["map", str(tmp_path / "map.yaml"), "--out", str(tmp_path / "out"), "--no-figures", "--jobs", "1"]
    done = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert done.exit_code == 0
    assert done.stderr.startswith("6 runs (3 x 2: release_angle, static_friction) in 1 chunks, at most")
    assert re.search(r"6 of 6 runs, .* runs/s", done.stderr)
    assert re.search(r"^6 runs: 3 \(50 %\) halt", done.stdout)
    ends = open_map(tmp_path / "out")["end"].isel(static_friction=0)  # static friction below the kinetic one
    assert [ENDINGS[code] for code in ends.values] == ["impossible"] * 3
    assert "does not halt; impossible parameters, not run | 3 |" in (tmp_path / "out" / "map.md").read_text()
    assert not list((tmp_path / "out").glob("*.png"))
    again = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert "6 of 6 runs are stored already" in again.stderr


def test_the_command_lists_maps_and_refuses_a_typo(tmp_path):
    assert "angle_and_ratio" in CliRunner().invoke(app, ["map"]).stdout
    assert "title:" in CliRunner().invoke(app, ["map", "quick", "--print"]).stdout
    (tmp_path / "huge.yaml").write_text(GRID.replace("count: 6", "count: 15000").replace("count: 12", "count: 12000"))
    done = CliRunner().invoke(app, ["map", str(tmp_path / "huge.yaml"), "--out", str(tmp_path / "out")])
    assert "found 180000000 runs" in str(done.exception)
    assert not (tmp_path / "out").exists()


# ---- the same maps on a Dask cluster: a real scheduler and real workers, each a process, on this machine's loopback


# Looked for and not imported: that takes most of a second, and every worker of pytest collects this file.
pytestmark = pytest.mark.skipif(find_spec("distributed") is None, reason="distributed is not installed")


def started(stack, *arguments, **also):
    """Start a program that is killed with the test."""
    process = subprocess.Popen(**program(*arguments, **also), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    stack.callback(process.wait)
    stack.callback(process.kill)
    return process


@pytest.fixture
def cluster(tmp_path):
    """Address of a scheduler with two workers, and these three processes; they run the fake solver slowly."""
    with ExitStack() as stack:
        file = tmp_path / "scheduler.json"
        loopback = ("--host", "127.0.0.1", "--no-dashboard")
        scheduler = started(stack, "distributed.cli.dask_scheduler", *loopback, "--port", 0, "--scheduler-file", file)
        deadline = time.monotonic() + 60
        while not (file.exists() and file.read_text().endswith("}")) and time.monotonic() < deadline:
            time.sleep(0.02)
        address = json.loads(file.read_text())["address"]
        alone = (*loopback, "--nthreads", 1, "--no-nanny", "--local-directory", tmp_path / "dask")
        workers = [started(stack, "distributed.cli.dask_worker", address, *alone, FAKE_SLEEP="0.1") for _ in range(2)]
        yield address, scheduler, workers


@pytest.mark.accurate  # daily, test_runner.py kills processes of a map at any moment
def test_a_worker_killed_in_the_middle_loses_nothing(cluster, tmp_path):
    address, _, workers = cluster
    plan, left = map_file.load_text(LONG), []

    def kill(done, runs):
        if done >= 4 * 12 and not left:
            workers[0].send_signal(signal.SIGKILL)
            left.append(runs - done)

    assert run_silently(plan, tmp_path / "out", cluster=address, progress=kill).complete
    assert left[0] > 3 * 12  # it had work to do when it was killed
    assert workers[0].wait() == -signal.SIGKILL
    assert workers[1].poll() is None
    run_silently(plan, tmp_path / "here")
    assert contents(tmp_path / "out") == contents(tmp_path / "here")


@pytest.mark.accurate
def test_a_scheduler_that_goes_away_is_one_line_and_loses_nothing(cluster, tmp_path, capfd):
    """Dask's log had two tracebacks of it."""
    address, scheduler, _ = cluster
    plan = map_file.load_text(LONG)

    def kill(done, runs):
        if done >= 4 * 12:
            scheduler.kill()

    with pytest.raises(EngineError, match=f"--cluster: {address}: its scheduler no longer answers; what is finished is kept"):
        run_silently(plan, tmp_path / "out", cluster=address, progress=kill)
    assert "Traceback" not in capfd.readouterr().err
    outcome = run_silently(plan, tmp_path / "out")
    assert outcome.complete
    assert outcome.runs_before >= 4 * 12


@pytest.mark.long
def test_an_unreachable_cluster_is_one_line_soon(tmp_path, monkeypatch):
    monkeypatch.setattr(dask_cluster, "CONNECT_TIME", 1.0)
    plan = map_file.load_text(GRID)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))  # not listening: nobody answers there
        address = f"tcp://127.0.0.1:{taken.getsockname()[1]}"
        before = time.monotonic()
        with pytest.raises(
            EngineError, match=f"--cluster: {address}: found no scheduler that answers .*`dask scheduler`"
        ) as caught:
            run_silently(plan, tmp_path, cluster=address)
        took = time.monotonic() - before
    assert "\n" not in str(caught.value)
    assert took < 3 * CONNECT_TIME
    assert run_silently(plan, tmp_path).complete
