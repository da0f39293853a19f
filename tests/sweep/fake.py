"""A solver that costs nothing, in a module of its own so that it travels to processes; and a program that maps with it."""

from __future__ import annotations

import argparse
import os
import resource
import signal
import time

import numpy as np

from looping_pendulum.sweep import cells, map_file, runner
from looping_pendulum.sweep.fields import FIELDS, end_code


def solve(task):
    """Numbers that tell one run from every other; every fifth run does not halt. Takes $FAKE_SLEEP s."""
    time.sleep(float(os.environ.get("FAKE_SLEEP", "0")))
    total = sum(np.cos(1e3 * column) for column in task.columns.values())
    values = {field.name: np.full(len(total), 0, dtype=field.dtype) for field in FIELDS}
    for field in FIELDS:
        if field.dtype == "float64":
            values[field.name] = np.asarray(total * len(field.name))
    values["stops"] = np.asarray(100 * abs(total), dtype=np.int32)
    values["sequence"] = np.asarray(total).view(np.uint64).copy()
    without = values["stops"] % 5 == 0
    values["halting_time"][without] = np.nan
    values["end"] = np.where(without, end_code("unwrapped"), end_code("light_reaches_rod")).astype(np.int8)
    return cells.Result(index=task.index, values=values, versions=cells.versions(task.engine, task.profile))


def die_at_last(task):
    """Kill the own process at a late chunk."""
    if task.index == 14:
        os.kill(os.getpid(), signal.SIGKILL)
    return solve(task)


def main():
    """Map with the fake solver; print the largest memory held [KiB]."""
    parser = argparse.ArgumentParser()
    parser.add_argument("map")
    parser.add_argument("out")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--cluster")
    given = parser.parse_args()
    outcome = runner.run_map(
        map_file.load(given.map), given.out, jobs=given.jobs, cluster=given.cluster, figures=False, solve=solve
    )
    print(outcome.done, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)


if __name__ == "__main__":
    main()
