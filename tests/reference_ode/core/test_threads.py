"""Threads that begin at the same time share the engine, the driver and the models."""

import subprocess
import sys

PROGRAM = """
import sys, threading
sys.setswitchinterval(1e-6)
from looping_pendulum.reference_ode.solve import solve
from looping_pendulum.scenarios import load

parameters = load("ten_to_one").parameters
together = threading.Barrier(8)
times = []

def begin():
    together.wait()
    times.append(solve(parameters).halting_time)

threads = [threading.Thread(target=begin) for _ in range(8)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
print(len(times), len(set(times)))
"""


def test_threads_that_begin_at_the_same_time_share_one_engine():
    """Each made an engine of its own, and wasmtime refused the other's modules: "cross-`Engine` instantiation"."""
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, timeout=60)
    assert done.stdout == "8 1\n", done.stderr
