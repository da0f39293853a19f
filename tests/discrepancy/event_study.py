"""Studies of event tables: the paper's two trials, and tables made from the blind simulator's motions."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from looping_pendulum.measured.tables.events import find_data
from tests.blind import Apparatus, Effects, cases
from tests.blind.cases import Case
from tests.blind.simulator import Motion, simulate
from tests.discrepancy.blind_study import write_study

Array = NDArray[np.float64]

PAPER = {
    "ten": {
        "file": "paper/trial_10to1.csv",
        "light": {"mass": "10 g +/- 0.05 g"},
        # neither the angle nor the length is printed: starts are those of the shipped scenarios
        "release": {"kind": "looping", "angle": "free from 113 deg", "free_length": "free from 58 cm"},
    },
    "two": {
        "file": "paper/trial_2to1.csv",
        "light": {"mass": "50 g +/- 0.25 g"},
        "release": {"kind": "looping", "angle": "free from 67.5 deg", "free_length": "free from 58 cm"},
    },
}
"""Keys of a study file for each trial, as the paper prints them; masses to 0.5 %."""


def write_paper_study(
    folder: Path, *, train: Sequence[str], held_out: Sequence[str] = (), friction: str = "free from 0.3"
) -> Path:
    """Write a study of the paper's own tables, measured column as data."""
    trials = []
    for name in (*train, *held_out):
        known = PAPER[name]
        path = find_data(str(known["file"]))
        assert path is not None
        (folder / f"{name}.csv").write_bytes(path.read_bytes())
        trials.append({**known, "name": name, "file": f"{name}.csv", "held_out": name in held_out})
    study = {
        "title": "The paper's event tables",
        "apparatus": {"heavy": {"mass": "100 g +/- 0.5 g"}, "rod": {"radius": "6.25 mm +/- 0.15 mm"}},
        "effects": {"capstan": friction, "light_drag": "free", "heavy_drag": "free", "string_drag": "free"},
        "trials": trials,
    }
    path = folder / "study.yaml"
    path.write_text(yaml.safe_dump(study, sort_keys=False), encoding="utf-8")
    return path


TIME_NOISE, LENGTH_NOISE = 1.5e-3, 2e-3
"""Standard errors of the blind tables [s], [m]: an eye that reads a 240 fps video between its frames, and a ruler beside it."""
FILMED = 1.1
"""Length of the film [s]: it contains the halts of all trials, and most trials to their end."""
SMALLEST_TURN = 5e-3
"""Smallest change between two extrema that is written into a table [m]; nobody would notice a smaller one."""
SHORTEST_REST = 0.1
"""Shortest rest up to the end of the film that counts as the halt [s]."""


def write_blind_study(folder: Path, case: Case, seed: int, *, tracks_of: Sequence[str] = (), **options: Any) -> Path:
    """Write the study of a blind case with event tables in place of its tracks, or beside them in the trials ``tracks_of``."""
    path = write_study(folder, case, seed, **options)
    study = yaml.safe_load(path.read_text(encoding="utf-8"))
    names = tuple(trial["name"] for trial in study["trials"])
    cases.write_files("tables", folder, case, seed, names, lambda to: simulate_tables(to, case, seed, names))
    for trial in study["trials"]:
        table = f"{trial['name']}_events.csv"
        if trial["name"] in tracks_of:
            trial["events"] = table
        else:
            trial["file"] = table
            del trial["tracks"], trial["camera"]
    path.write_text(yaml.safe_dump(study, sort_keys=False), encoding="utf-8")
    return path


def simulate_tables(folder: Path, case: Case, seed: int, names: Sequence[str]) -> None:
    """Write the table of each of these trials as the simulator makes it now."""
    named = {t.name: t for t in cases.TRIALS}
    rng = np.random.default_rng([seed, zlib.crc32(case.name.encode()), 7])
    for name in names:
        motion = _moved(case.true(named[name], seed), case.hidden())
        (folder / f"{name}_events.csv").write_text(event_table(motion, rng), encoding="utf-8")


@lru_cache(maxsize=8)
def _moved(apparatus: Apparatus, effects: Effects) -> Motion:
    return simulate(apparatus, effects, duration=FILMED)


def event_table(motion: Motion, rng: np.random.Generator) -> str:
    """Return the table of a motion's extrema, stops and halt, with noise, as text."""
    lines = ["quantity,index,value,sigma,unit"]

    def add(quantity: str, index: int, value: float, sigma: float, unit: str) -> None:
        lines.append(f"{quantity},{index},{value + sigma * rng.standard_normal():.6f},{sigma},{unit}")

    for name, axis in (("x1_extremum", 0), ("y1_extremum", 1)):
        for i, time in enumerate(extrema(motion, axis), start=1):
            add(name, i, time, TIME_NOISE, "s")
    heights = motion.heavy[:, 1] - motion.heavy[0, 1]
    times, halts = stops(motion)
    for i, time in enumerate(times, start=1):
        add("stop_time", i, time, TIME_NOISE, "s")
        add("height_change_at_stop", i, float(np.interp(time, motion.t, heights)), LENGTH_NOISE, "m")
    if halts:
        lines[-2] = lines[-2].replace(f"stop_time,{len(times)}", "halting_time,1")
        lines[-1] = lines[-1].replace(f"height_change_at_stop,{len(times)}", "height_change_at_halt,1")
    return "\n".join(lines) + "\n"


def extrema(motion: Motion, axis: int) -> list[float]:
    """Return the times [s] of the extrema of a coordinate of the light mass, by the sign of its velocity."""
    velocity, position = motion.light_velocity[1:, axis], motion.light[1:, axis]
    times: list[float] = []
    last = position[0]
    for i in np.flatnonzero(velocity[:-1] * velocity[1:] < 0):
        if abs(position[i] - last) > SMALLEST_TURN:
            times.append(_zero(motion.t[1:], velocity, i))
            last = position[i]
    return times


def stops(motion: Motion) -> tuple[list[float], bool]:
    """Return the times [s] at which the heavy mass stops or turns, and whether it stays at rest after the last one."""
    velocity = motion.heavy_velocity[:, 1]
    moving = np.abs(velocity) > 5e-3
    times: list[float] = []
    start = int(np.argmax(moving))
    while start < len(velocity) - 1:
        sign = np.sign(velocity[start])
        after = np.flatnonzero(velocity[start:] * sign <= 1e-6)
        if not len(after):
            break
        stop = start + int(after[0])
        times.append(float(motion.t[stop]))
        again = np.flatnonzero(moving[stop:])
        if not len(again):
            return times, bool(motion.t[-1] - motion.t[stop] > SHORTEST_REST)
        start = stop + int(again[0])
    return times, False


def _zero(t: Array, velocity: Array, i: int) -> float:
    return float(t[i] + (t[i + 1] - t[i]) * velocity[i] / (velocity[i] - velocity[i + 1]))
