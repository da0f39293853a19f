"""Write a motion as a file that the program Tracker draws on a video as an external model: one row per frame.

Tracker puts row after row on frame after frame, so the rows have the video's own frame times. Metres; origin at the rod's axis,
x right and y up, as the guide (docs/film.md) has a student set the axes in Tracker.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from looping_pendulum.engines.isolation import run_isolated
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.registry import label, select
from looping_pendulum.errors import EngineError, HarnessError
from looping_pendulum.files import read_file
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.solve import solve
from looping_pendulum.runs.trajectory import Trajectory
from looping_pendulum.scenarios import loader
from looping_pendulum.scenarios.document import one_line, shorten
from looping_pendulum.scenarios.scenario import Scenario

HEADER = ("t", "heavyx", "heavyy", "lightx", "lighty")
"""Columns of the file: time [s] and positions of two points, "heavy" and "light" [m]."""

FRAME_RATE = 240.0
"""Default frame rate, that of many phones' slow motion [frames per second]."""

MAX_START = 86400.0
"""Latest release by the video's clock [s]: a video of one day."""

MAX_FRAMES = 1_000_000
"""Largest number of rows; an hour at `FRAME_RATE` has 864 000 frames."""

MAX_FILE_SIZE = 64 * 1024 * 1024
"""Largest size of a run's file [bytes]; a run has 1000 rows per second, of some 200 bytes each."""

MAX_NUMBER = 1e6
"""Largest number in a run's file [s, m or m/s]: beyond it there is no motion of this apparatus."""

FRAME_ROUNDING = 1e-9
"""Rounding error of a frame number [frames]: a frame this little before the release counts as at it.

The release of a video is a product such as 0.35 s times 240 frames per second, which is not exact.
"""

PositionsAt = Callable[[Array], tuple[Array, Array]]
"""Times since the release [s], shape (n,) -> positions of the heavy and of the light mass [m], each of shape (n, 2)."""


class TrackerError(HarnessError, ValueError):
    """A motion cannot be written for Tracker."""


@dataclass(frozen=True, kw_only=True)
class TrackedMotion:
    """A motion whose positions are known at any time."""

    name: str
    """Name of the scenario and the engine, "ten_to_one, pymunk:chain"."""
    end: float
    """End of the motion, since the release [s]."""
    positions: PositionsAt


@dataclass(frozen=True, kw_only=True)
class Overlay:
    """Positions of a motion at the frames of a video."""

    name: str
    """Name of the motion."""
    first_frame: int
    """Number of the video's frame that the first row belongs to."""
    t: Array
    """Times by the video's clock [s], shape (n,)."""
    heavy: Array
    """Positions of the heavy mass [m], shape (n, 2)."""
    light: Array
    """Positions of the light mass [m], shape (n, 2)."""

    def to_csv(self) -> str:
        """Return the text of the file; numbers have all their digits, so that they read back unchanged."""
        rows = np.column_stack([self.t, self.heavy, self.light]).tolist()
        return "\n".join([",".join(HEADER), *(",".join(map(repr, row)) for row in rows)]) + "\n"


def overlay(motion: TrackedMotion, *, frame_rate: float = FRAME_RATE, start: float = 0.0) -> Overlay:
    """Return the positions of ``motion`` at the frames of a video.

    Parameters
    ----------
    frame_rate
        True frame rate of the video [frames per second].
    start
        Time of the release by the video's clock [s].

    Raises
    ------
    TrackerError
        If frame rate or start are out of range, or no frame falls into the motion.
    """
    if not (math.isfinite(frame_rate) and 0 < frame_rate <= 1e5):
        raise TrackerError(f"--fps: found {frame_rate:g}, needed frames per second above 0; write for example --fps 240")
    if not 0 <= start <= MAX_START:
        allowed = f"the time of the release in the video, 0 s to {MAX_START:.0f} s"
        raise TrackerError(f"--start: found {start:g}, needed {allowed}; write for example --start 0.35")
    first = math.ceil(start * frame_rate - FRAME_ROUNDING)
    last = math.floor((start + motion.end) * frame_rate + FRAME_ROUNDING)
    if last < first:
        raise TrackerError(
            f"--fps: found {frame_rate:g}, at which no frame falls into the {motion.end:g} s of {motion.name}; raise it"
        )
    if last - first >= MAX_FRAMES:
        problem = f"found {frame_rate:g}, at which {motion.name} lasts {last - first + 1} frames"
        raise TrackerError(f"--fps: {problem}, needed at most {MAX_FRAMES}; lower it")
    t = np.arange(first, last + 1) / frame_rate
    # Clipped: `FRAME_ROUNDING` may put the first or last frame just outside the motion
    heavy, light = motion.positions(np.clip(t - start, 0.0, motion.end))
    return Overlay(name=motion.name, first_frame=first, t=t, heavy=heavy, light=light)


def find_motion(source: str, engine: str | None = None, profile: Profile = Profile.QUICK) -> TrackedMotion:
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
    TrackerError
        If the folder or file has no such run.
    EngineError
        If the engine is unknown, or its run failed.
    """
    path = Path(source)
    if path.is_dir():
        return _motion_of_file(_file_of_run(path, engine))
    if path.suffix.lower() == ".csv" and path.is_file():
        if engine is not None:
            raise TrackerError(f"--engine: found {engine!r} beside the file of one run, needed one of them; leave it out")
        return _motion_of_file(path)
    scenario = loader.load(source)
    if engine is None or engine == "reference":
        return reference_motion(scenario)
    chosen = select([engine], profile)
    if len(chosen) > 1:
        variants = ", ".join(label(each) for each in chosen)
        raise EngineError(f"--engine: found {engine!r}, needed one variant of it: {variants}")
    return trajectory_motion(run_isolated(chosen[0], scenario).raise_if_failed())


def reference_motion(scenario: Scenario) -> TrackedMotion:
    """Return the motion of the exact reference, which is known at any time."""
    solution = solve(scenario)

    def positions(t: Array) -> tuple[Array, Array]:
        samples = solution.sample(t)
        return samples.heavy_position, samples.light_position

    end = min(solution.end_time, scenario.duration)
    return TrackedMotion(name=f"{scenario.name}, exact reference", end=end, positions=positions)


def trajectory_motion(run: Trajectory) -> TrackedMotion:
    """Return the motion of an engine's run: cubic Hermite interpolation of its positions and velocities."""
    masses = ((run.heavy_position, run.heavy_velocity), (run.light_position, run.light_velocity))
    return _interpolated_motion(f"{run.scenario}, {run.label}", run.t, *masses)


def _interpolated_motion(name: str, t: Array, heavy: tuple[Array, Array], light: tuple[Array, Array]) -> TrackedMotion:
    from scipy.interpolate import CubicHermiteSpline

    if len(t) < 2:
        raise TrackerError(f"{name}: found {len(t)} samples, needed two or more")
    splines = [CubicHermiteSpline(t, *mass) for mass in (heavy, light)]
    return TrackedMotion(name=name, end=float(t[-1]), positions=lambda at: (splines[0](at), splines[1](at)))


def _file_of_run(folder: Path, engine: str | None) -> Path:
    """Return the file of one run in a folder that `compare` or `run` wrote."""
    inner = folder / "trajectories"
    files = sorted((inner if inner.is_dir() else folder).glob("*.csv"))
    if not files:
        raise TrackerError(
            f"{folder}: found no runs, needed a folder that `looping-pendulum compare` wrote; or name a scenario"
        )
    # As `files.file_stem` writes the label into the file's name
    wanted = "reference" if engine is None else engine.replace(":", "-")
    stems = {file.stem: file for file in files}
    matching = [stem for stem in stems if stem == wanted or stem.startswith(f"{wanted}-")]
    if len(matching) != 1:
        which = f"{len(matching)} runs of {wanted!r}" if matching else f"no run of {wanted!r}"
        raise TrackerError(f"{folder}: found {which}, needed one; there are {', '.join(stems)}; choose by --engine")
    return stems[matching[0]]


def _motion_of_file(path: Path) -> TrackedMotion:
    """Return the motion in a CSV file of `compare.trajectories.trajectory_csv`."""
    names = ("t", "heavy_x", "heavy_y", "heavy_vx", "heavy_vy", "light_x", "light_y", "light_vx", "light_vy")
    try:
        raw = read_file(path, MAX_FILE_SIZE)
        lines = raw.decode("utf-8-sig").splitlines() or [""]
    except OSError as error:
        raise TrackerError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise TrackerError(f"{path}:{line}: found the byte 0x{raw[error.start]:02x}, needed UTF-8 text") from None
    header = [cell.partition(" [")[0].strip() for cell in lines[0].split(",")]
    missing_columns = [name for name in names if name not in header]
    if missing_columns or len(raw) > MAX_FILE_SIZE:
        found = f"no column {missing_columns[0]!r}" if missing_columns else f"more than {MAX_FILE_SIZE // 1024**2} MiB"
        raise TrackerError(f"{path}: found {found}, needed a file of one run that `looping-pendulum run --out` wrote")
    if not any(map(str.strip, lines[1:])):
        raise TrackerError(f"{path}: found no samples, needed two or more")
    try:
        columns = np.loadtxt(lines[1:], delimiter=",", comments=None, usecols=[header.index(name) for name in names], ndmin=2)
    except ValueError as error:
        message = f"{path}: found a row without all its numbers ({shorten(str(error))}), needed times, places and velocities"
        raise TrackerError(one_line(message)) from None
    # The first row of numbers stands on line 2
    for row, number in zip(*np.nonzero(~(np.abs(columns) <= MAX_NUMBER)), strict=True):
        found = f"found {columns[row, number]:g}"
        raise TrackerError(f"{path}:{row + 2}: {found}, needed numbers up to {MAX_NUMBER:g} in size")
    t, heavy, heavy_v, light, light_v = np.split(columns, [1, 3, 5, 7], axis=1)
    for row in np.flatnonzero(np.diff(t[:, 0]) <= 0) + 1:
        raise TrackerError(f"{path}:{row + 2}: found {t[row, 0]:g} s after {t[row - 1, 0]:g} s, needed times that grow")
    return _interpolated_motion(path.stem, t[:, 0], (heavy, heavy_v), (light, light_v))
