"""The same maps on a Dask cluster: a real scheduler and real workers, each a process, on this machine's loopback."""

import json
import signal
import socket
import subprocess
import time
from contextlib import ExitStack
from importlib.util import find_spec

import pytest

from looping_pendulum.errors import EngineError
from looping_pendulum.sweep import executors, map_file
from looping_pendulum.sweep.executors import CONNECT_TIME
from tests.sweep.maps import GRID, LONG, contents, program
from tests.sweep.test_runner import run_silently

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
    """Address of a scheduler with two workers, and these two processes; they run the fake solver slowly."""
    with ExitStack() as stack:
        file = tmp_path / "scheduler.json"
        loopback = ("--host", "127.0.0.1", "--no-dashboard")
        started(stack, "distributed.cli.dask_scheduler", *loopback, "--port", 0, "--scheduler-file", file)
        deadline = time.monotonic() + 60
        while not (file.exists() and file.read_text().endswith("}")) and time.monotonic() < deadline:
            time.sleep(0.02)
        address = json.loads(file.read_text())["address"]
        alone = (*loopback, "--nthreads", 1, "--no-nanny", "--local-directory", tmp_path / "dask")
        workers = [started(stack, "distributed.cli.dask_worker", address, *alone, FAKE_SLEEP="0.1") for _ in range(2)]
        yield address, workers


@pytest.mark.accurate  # daily, test_runner.py kills processes of a map at any moment
def test_a_worker_killed_in_the_middle_loses_nothing(cluster, tmp_path):
    address, workers = cluster
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


def test_an_unreachable_cluster_is_one_line_soon(tmp_path, monkeypatch):
    monkeypatch.setattr(executors, "CONNECT_TIME", 1.0)
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
