"""Measure what the adapters cost in addition to the bare engine: `python -m benchmarks.engine_overhead`.

One rig runs as it does in a comparison: steps, forces, the adapter's own work, reading back. Another runs the same, but takes
every second sample interval with nothing but the engine's own step call. Over those intervals the ratio of the two is the
adapter's overhead; bodies and contacts are the same in both.
"""

from __future__ import annotations

import argparse
import functools
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from looping_pendulum.engines.protocol import SAMPLE_INTERVAL, Profile, Rig
from looping_pendulum.engines.registry import label, missing_packages, select
from looping_pendulum.scenarios import load

LIMIT = 0.10
"""Largest cost of an adapter, as a share of the bare engine's."""
SAMPLES = 300
"""The fall of ten to one, up to shortly before the halt, where most beads come and go."""
REPEATS, MIN_TIME = 5, 30.0
"""Least number of repeats, and seconds below which more are made: what is short is what other programs disturb most."""

BareLoop = Callable[[], None]
"""Function that advances the engine by one sample interval with its step call alone."""


def bare_pymunk(rig: Any) -> BareLoop:
    """Chipmunk's `cpSpaceStep` on the rig's own space, without pymunk's wrapper."""
    from pymunk._chipmunk import lib

    space, settings, step = rig._space._space, rig._settings, lib.cpSpaceStep
    count, time_step = settings.steps_per_sample, settings.time_step

    def loop() -> None:
        for _ in range(count):
            step(space, time_step)

    return loop


def bare_pybullet(rig: Any) -> BareLoop:
    """PyBullet's `stepSimulation` on the rig's own server."""
    world = rig._world
    step, client, count = world.api.stepSimulation, world.client, world.steps

    def loop() -> None:
        for _ in range(count):
            step(physicsClientId=client)

    return loop


def bare_mujoco(rig: Any) -> BareLoop:
    """MuJoCo's `mj_step` on the rig's own model, one call for the whole interval."""
    settings = rig._settings
    count = settings.groups_per_sample * settings.steps_per_group

    def loop() -> None:
        rig._mujoco.mj_step(rig._current.model, rig._current.data, count)

    return loop


BARE_LOOPS: dict[str, Callable[[Any], BareLoop]] = {
    "mujoco:beads": bare_mujoco,
    "pybullet:chain": bare_pybullet,
    "pymunk:chain": bare_pymunk,
}
"""Variant -> function that makes the bare loop of one of its rigs."""


def overhead(make: Callable[[], Rig], bare_of: Callable[[Any], BareLoop]) -> tuple[float, float]:
    """Return the CPU seconds of every second of `SAMPLES` intervals with the adapter, and of the same intervals without it.

    Each interval counts with its least of all repeats, which are the same: so that other load on the machine does not count.
    """
    least = np.full((SAMPLES, 2), np.inf)
    started, repeats = time.perf_counter(), 0
    while repeats < REPEATS or time.perf_counter() - started < MIN_TIME:
        repeats += 1
        rig = make()
        for sample in range(SAMPLES):
            least[sample, 0] = min(least[sample, 0], _seconds(lambda rig=rig: (rig.advance(), rig.read())))
        rig = make()
        bare = bare_of(rig)
        for sample in range(1, SAMPLES, 2):
            rig.advance()
            least[sample, 1] = min(least[sample, 1], _seconds(bare))
    whole, alone = least[1::2].sum(axis=0)
    return float(whole), float(alone)


def _seconds(task: Callable[[], object]) -> float:
    started = time.process_time()
    task()
    return time.process_time() - started


def benchmark(names: list[str], profile: Profile) -> None:
    """Print a Markdown table of the engines that have a bare loop here."""
    scenario = load("ten_to_one")
    print(f"\n## Adapters over the bare engine, ten_to_one, {profile.value} profile\n")
    print("| variant | CPU s per simulated s | bare | overhead | at most 10 % |\n|---|---|---|---|---|")
    for engine in select(names, profile):
        if missing_packages(engine):
            print(f"| {label(engine)} | not installed | | | |")
            continue
        whole, bare = overhead(functools.partial(engine.build, scenario), BARE_LOOPS[label(engine)])  # type: ignore[attr-defined]
        seconds = SAMPLE_INTERVAL * (SAMPLES // 2)
        share = whole / bare - 1
        verdict = "met" if share <= LIMIT else "not met"
        print(
            f"| {label(engine)} | {whole / seconds:.1f} | {bare / seconds:.1f} | {100 * share:.1f} % | {verdict} |", flush=True
        )


def main() -> None:
    """Run for the engines that were asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("engines", nargs="*", default=sorted(BARE_LOOPS))
    parser.add_argument("--profile", choices=[p.value for p in Profile], default=Profile.QUICK.value)
    options = parser.parse_args()
    benchmark(options.engines, Profile(options.profile))


if __name__ == "__main__":
    main()
