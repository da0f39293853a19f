"""Write a motion as a file that the program Tracker draws on a video as an external model: one row per frame.

Tracker puts row after row on frame after frame, so the rows have the video's own frame times. Metres; origin at the rod's axis,
x right and y up, as the guide (docs/film.md) has a student set the axes in Tracker.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from looping_pendulum.compare.trajectories import CSV_HEADER
from looping_pendulum.engines.isolation import run_isolated
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.registry import label, select
from looping_pendulum.errors import EngineError, HarnessError, shorten
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.runs.trajectory import LARGEST, Trajectory
from looping_pendulum.scenarios import loader

HEADER = ("t", "heavyx", "heavyy", "lightx", "lighty")
"""Columns of the file: time [s] and positions of two points, "heavy" and "light" [m]."""

MAX_FRAMES = 10_000_000
"""Largest number of a frame, and so of rows: eleven hours at 240 frames per second."""

FRAME_ROUNDING = 1e-9
"""Rounding error of a frame number [frames]: a frame this little before the release counts as at it.

The release of a video is a product such as 0.35 s times 240 frames per second, which is not exact.
"""


def overlay(motion: CubicHermiteSpline, *, frame_rate: float, start: float = 0.0) -> tuple[int, Array]:
    """Return the positions of a motion at the frames of a video.

    Parameters
    ----------
    motion
        Positions of the heavy and of the light mass [m] over the time since the release [s].
    frame_rate
        True frame rate of the video [frames per second].
    start
        Time of the release by the video's clock [s].

    Returns
    -------
    first_frame : int
        Number of the video's frame that the first row belongs to.
    rows : Array
        Columns of the file, `HEADER`, shape (n, 5); times are by the video's clock.

    Raises
    ------
    HarnessError
        If no frame falls into the motion, or a frame has too large a number.
    """
    end = float(motion.x[-1])
    first = math.ceil(start * frame_rate - FRAME_ROUNDING)
    last = math.floor((start + end) * frame_rate + FRAME_ROUNDING)
    if last < first:
        raise HarnessError(f"--fps: found {frame_rate:g}, at which no frame falls into the {end:g} s of the motion; raise it")
    if last > MAX_FRAMES:
        found = f"found {start:g} s and {frame_rate:g} frames per second, so {last:.3g} frames"
        raise HarnessError(f"--start, --fps: {found}, needed at most {MAX_FRAMES}; correct them")
    t = np.arange(first, last + 1) / frame_rate
    # Clipped: `FRAME_ROUNDING` may put the first or last frame just outside the motion
    return first, np.column_stack([t, motion(np.clip(t - start, 0.0, end))])


def tracker_csv(rows: Array) -> str:
    """Return the text of the file; numbers have all their digits, so that they read back unchanged."""
    return "\n".join([",".join(HEADER), *(",".join(map(repr, row)) for row in rows.tolist())]) + "\n"


def find_motion(source: str, engine: str | None = None, profile: Profile = Profile.QUICK) -> CubicHermiteSpline:
    """Return the motion that ``source`` and ``engine`` name.

    Parameters
    ----------
    source
        Name or file of a scenario, which the exact reference or ``engine`` then runs; or a folder that `compare` wrote, of
        which the reference or the run of ``engine`` is taken; or one CSV file of a run.
    engine
        Variant, "mujoco:capstan"; None: the exact reference.

    Raises
    ------
    HarnessError
        If the folder or file has no such run.
    EngineError
        If the engine is unknown, or its run failed.
    """
    path, wanted = Path(source), engine or "reference"
    if path.is_dir():
        return _motion_of_file(_file_of_run(path, wanted))
    if path.suffix.lower() == ".csv" and path.is_file():
        if engine is not None:
            raise HarnessError(f"--engine: found {engine!r} beside the file of one run, needed one of them; leave it out")
        return _motion_of_file(path)
    scenario = loader.load(source)
    chosen = select([wanted], profile)
    if len(chosen) > 1:
        variants = ", ".join(label(each) for each in chosen)
        raise EngineError(f"--engine: found {engine!r}, needed one variant of it: {variants}")
    return motion_of(run_isolated(chosen[0], scenario).raise_if_failed())


def motion_of(run: Trajectory) -> CubicHermiteSpline:
    """Return positions of the heavy and of the light mass over the time, by the positions and velocities of a run."""
    positions = np.hstack([run.heavy_position, run.light_position])
    return CubicHermiteSpline(run.t, positions, np.hstack([run.heavy_velocity, run.light_velocity]))


def _file_of_run(folder: Path, wanted: str) -> Path:
    """Return the file of one run in a folder that `compare` or `run` wrote."""
    inner = folder / "trajectories"
    files = sorted((inner if inner.is_dir() else folder).glob("*.csv"))
    if not files:
        raise HarnessError(
            f"{folder}: found no runs, needed a folder that `looping-pendulum compare` wrote; or name a scenario"
        )
    # As `files.file_stem` writes the label into the file's name
    name = wanted.replace(":", "-")
    matching = [file for file in files if file.stem == name or file.stem.startswith(f"{name}-")]
    if len(matching) != 1:
        which = f"{len(matching)} runs of {wanted!r}" if matching else f"no run of {wanted!r}"
        there = ", ".join(file.stem for file in files)
        raise HarnessError(f"{folder}: found {which}, needed one; there are {there}; choose by --engine")
    return matching[0]


def _motion_of_file(path: Path) -> CubicHermiteSpline:
    """Return the motion in a CSV file of `compare.trajectories.trajectory_csv`."""
    try:
        with path.open(encoding="utf-8") as lines:
            if next(lines, "").strip() != ",".join(CSV_HEADER):
                raise ValueError("other columns")
            columns = np.loadtxt(lines, delimiter=",", usecols=range(9), ndmin=2)
        if not (np.abs(columns) < LARGEST).all():
            raise ValueError("numbers that no motion has")
        # In the order of `CSV_HEADER`: time, then position and velocity of each mass
        t, light, light_velocity, heavy, heavy_velocity = np.split(columns, [1, 3, 5, 7], axis=1)
        return CubicHermiteSpline(t[:, 0], np.hstack([heavy, light]), np.hstack([heavy_velocity, light_velocity]))
    except (OSError, ValueError) as error:
        found = shorten(" ".join(str(error).split()))
        needed = "a file that `looping-pendulum run --out` or `compare` wrote"
        raise HarnessError(f"{path}: found no run ({found}), needed {needed}") from None
