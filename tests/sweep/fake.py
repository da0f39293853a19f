"""A solver that costs nothing, in a module of its own so that it travels to a cluster; and a program that maps with it."""

import argparse
import os
import resource
import signal
import time
from itertools import zip_longest

import numpy as np
from zarr.storage import LocalStore

from looping_pendulum.sweep import map_file, runner
from looping_pendulum.sweep.cells import ENDINGS, FIELDS
from tests.sweep.maps import field_files


def solve(plan, region, **limits):
    """Numbers that tell one run from every other; every fifth run does not halt. Takes $FAKE_SLEEP s."""
    time.sleep(float(os.environ.get("FAKE_SLEEP", "0")))
    total = sum(np.cos(1e3 * column) for column in plan.columns(region).values())
    values = {
        name: total * len(name) if field.kind is np.float64 else np.zeros(len(total), dtype=field.kind)
        for name, field in FIELDS.items()
    }
    values["stops"] = np.asarray(100 * abs(total), dtype=np.int32)
    values["sequence"] = np.asarray(total).view(np.uint64).copy()
    without = values["stops"] % 5 == 0
    values["halting_time"][without] = np.nan
    values["end"] = np.where(without, ENDINGS.index("unwrapped"), ENDINGS.index("light_reaches_rod")).astype(np.int8)
    return values


def kill_at(folder, files):
    """Have this process killed where it would write the next file, once there are so many of the fields'."""
    put = LocalStore.set

    async def put_unless_killed(self, *given, **also):
        if len(field_files(folder)) >= files:
            os.kill(os.getpid(), signal.SIGKILL)
        await put(self, *given, **also)

    LocalStore.set = put_unless_killed


def main():
    """Map with the fake solver; print how many runs are done, and the largest memory held [KiB].

    Of several pairs of a map and a folder, each is mapped by a copy of this process, one after another: what such a copy
    does, or that it is killed, leaves the next as it was, and none has to import anything. How many files of fields it
    left is printed after it.
    """
    parser = argparse.ArgumentParser()
    parser.add_argument("paths", nargs="+", help="map and folder, once or several times")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--killed-at", nargs="*", type=int, default=[], help="files of fields at which each copy is killed")
    given = parser.parse_args()
    pairs = list(zip(given.paths[::2], given.paths[1::2], strict=True))
    plans = [(map_file.load(name), out) for name, out in pairs]
    for (plan, out), files in zip_longest(plans, given.killed_at):
        copy = os.fork() if len(pairs) > 1 else 0
        if copy:
            os.waitpid(copy, 0)
            print(len(field_files(out)), flush=True)
            continue
        if files is not None:
            kill_at(out, files)
        outcome = runner.run_map(plan, out, jobs=given.jobs, figures=False, solve=solve)
        print(outcome.runs_now, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, flush=True)
        if len(pairs) > 1:
            os._exit(0)


if __name__ == "__main__":
    main()
