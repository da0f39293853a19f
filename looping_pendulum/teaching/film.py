"""A film of a comparison for slides: the reference, the engines and the measured points in step, as GIF or MP4."""

from __future__ import annotations

import io
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.animation import FFMpegWriter, FuncAnimation, PillowWriter
from PIL import Image

from looping_pendulum.compare.figures import drawn_runs
from looping_pendulum.compare.result import ComparisonResult
from looping_pendulum.files import OutputError
from looping_pendulum.pages.chart import Chart, ChartAxis, Curve, Panel, reach, tracked_points, with_room
from looping_pendulum.pages.drawing import draw, png, without_mathtext
from looping_pendulum.processes import ReportShare
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.runs.trajectory import Trajectory, finite_length, first_samples

SUFFIXES = (".gif", ".mp4")
"""Kinds of film."""
FRAME_RATE = 25
"""Frames per second of film: GIF counts in hundredths of a second, and players slow down at 2 of them."""
SLOW_MOTION = 4
"""How many times slower than the motion the film is."""
MAX_FRAMES = 500
"""Most frames: a film of 20 s; a longer motion is shown faster."""
SIZE = (7.2, 6.0)
"""Width and height [inches]; at `DPI`, 720 by 600 pixels, both even, as MP4 asks for."""
DPI = 100
GIF_COLOURS = 128
"""Colours of a GIF, the same for all frames, so that nothing flickers."""


def check_film(path: Path) -> None:
    """Refuse a film that could not be written, before the work rather than after it.

    Raises
    ------
    OutputError
        If the name has another ending than `SUFFIXES`, or an MP4 is asked for without ffmpeg.
    """
    if path.suffix.lower() not in SUFFIXES:
        found = repr(path.suffix) if path.suffix else "no ending"
        raise OutputError(f"--film: {path}: found {found}, needed .gif or .mp4; write for example --film demo.gif")
    if path.suffix.lower() == ".mp4" and not FFMpegWriter.isAvailable():
        way_out = f"install ffmpeg, or write a GIF: --film {path.with_suffix('.gif')}"
        raise OutputError(f"--film: {path}: found no program ffmpeg, needed it for an MP4; {way_out}")


def write_film(result: ComparisonResult, path: Path, progress: ReportShare | None = None) -> None:
    """Write the film of a comparison that has its trajectories.

    Raises
    ------
    OutputError
        If the file cannot be of the kind that its name says.
    ValueError
        If ``result`` was read from a file without trajectories.
    """
    check_film(path)
    times, slower = frame_times(result.duration)
    stage = _Stage(result, slower)
    if path.suffix.lower() == ".gif":
        stage.draw(times[-1])  # the last frame has every colour, those of whole paths included
        writer: PillowWriter | FFMpegWriter = _GifWriter(Image.open(io.BytesIO(png(stage.figure))))
    else:
        writer = FFMpegWriter(fps=FRAME_RATE, metadata={"title": result.title})

    def report(frame: int, count: int) -> None:
        if progress is not None:
            progress(f"film, frame {frame + 1} of {count}", (frame + 1) / count)

    film = FuncAnimation(stage.figure, stage.draw, frames=times, init_func=lambda: [], cache_frame_data=False)
    part = path.with_name(f".{path.stem}.part{path.suffix}")  # so that a film that breaks off is not taken for a whole one
    try:
        film.save(part, writer, dpi=DPI, progress_callback=report)
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def frame_times(duration: float) -> tuple[Array, float]:
    """Return the times of the frames [s], from the release to the end, and how many times slower than the motion they play."""
    count = int(min(np.ceil(duration * SLOW_MOTION * FRAME_RATE) + 1, MAX_FRAMES))
    return np.linspace(0.0, duration, count), (count - 1) / FRAME_RATE / duration


class _GifWriter(PillowWriter):
    """Writes a GIF whose frames are reduced to its few colours at once, so that they do not fill the memory."""

    def __init__(self, example: Image.Image) -> None:
        super().__init__(fps=FRAME_RATE)
        self._example = example.convert("RGB").quantize(GIF_COLOURS)

    def grab_frame(self, **settings: Any) -> None:
        """Add what the figure shows now, in the colours of the example."""
        super().grab_frame(**settings)
        frames: list[Image.Image] = self._frames  # type: ignore[attr-defined]
        frame = frames.pop().quantize(palette=self._example, dither=Image.Dither.NONE)
        # The choice of colours tints the ground a little, which a white slide would show
        ground = int(np.asarray(frame)[0, 0])
        colours = frame.getpalette() or []
        colours[3 * ground : 3 * ground + 3] = (255, 255, 255)
        frame.putpalette(colours)
        frames.append(frame)


class _Stage:
    """The apparatus at one time, as a figure."""

    def __init__(self, result: ComparisonResult, slower: float) -> None:
        if result.samples is None:
            raise ValueError("this result was read without its trajectories; make it again with `looping-pendulum compare`")
        p = result.parameters
        self._radius, self._string = p.rod_radius, p.release is not Release.DROP
        self._title = without_mathtext(result.title)
        self._speed = f"slowed down {slower:.3g} times" if slower >= 1 else f"sped up {1 / slower:.3g} times"
        self._runs: list[Trajectory] = []
        curves = []
        for name, run, style in drawn_runs(result, result.samples):
            self._runs.append(first_samples(run, finite_length(run)))
            if style is None:
                path: dict[str, Any] = {"width": 2.6}
                masses: dict[str, Any] = {"marker": "o", "size": 11, "hollow": True}
            else:
                path = {"width": 1.4, "colour": style.colour, "dashes": style.dashes}
                masses = {"marker": style.marker, "size": 7, "colour": style.colour}
            string = {"width": 2.0} if style is None else {"width": 1.1, "colour": style.colour}
            curves += [Curve(label=label, x=[], y=[], **look) for label, look in (("", path), ("", string), (name, masses))]
        self._points: list[tuple[Array, Array, Array]] = []
        for track in [] if result.trial is None else [comparison.track for comparison in result.trial.tracks]:
            mass = track.name.partition(" ")[0]
            x, y = (track.channel(f"{mass}_{axis}") for axis in ("x", "y"))
            if x is not None and y is not None:
                curves.append(replace(tracked_points([], []), in_legend=not self._points))
                self._points.append((np.array(track.t), np.array(x), np.array(y)))
        places = np.vstack([position for run in self._runs for position in (run.light_position, run.heavy_position)])
        x_limits, y_limits = with_room(*(reach([column]) for column in places.T))
        panel = Panel(curves=curves, y=ChartAxis(label="y [m]", limits=y_limits), disc=self._radius, to_scale=True)
        self.figure = draw(
            Chart(
                id="film",
                caption="",
                subject=result.scenario,
                title="",
                x=ChartAxis(label="x [m]", limits=x_limits),
                panels=[panel],
                size=SIZE,
            )
        )
        self.figure.set_dpi(DPI)

    def draw(self, time: float) -> list[Any]:
        """Draw everything at ``time`` [s]."""
        (axes,) = self.figure.axes
        lines = iter(axes.lines)
        for run in self._runs:
            path, string, masses = next(lines), next(lines), next(lines)
            shown = int(np.searchsorted(run.t, time, side="right"))
            light, heavy = (_at(run, values, time) for values in (run.light_position, run.heavy_position))
            path.set_data(*run.light_position[:shown].T)
            path.set_alpha(0.5)
            masses.set_data(*np.column_stack([light, heavy]))
            ended = time > run.t[-1] + 1e-9
            for line in (string, masses):
                line.set_alpha(0.35 if ended else 1.0)
            if self._string:
                angle = np.linspace(0.0, max(float(_at(run, run.wrap_angle, time)), 0.0), 60)
                wound = self._radius * np.column_stack([np.cos(angle), np.sin(angle)])
                string.set_data(*np.vstack([heavy, wound, light]).T)
        for (t, x, y), rings in zip(self._points, lines, strict=True):
            known = t <= time + 1e-9
            rings.set_data(x[known], y[known])
        axes.set_title(f"{self._title}\n{time:.3f} s, {self._speed}", fontsize=11)
        return []


def _at(run: Trajectory, values: Array, time: float) -> Array:
    """Return values of a run, shape (n,) or (n, 2), at a time; after its end, those of its end."""
    if values.ndim == 1:
        return np.asarray(np.interp(time, run.t, values))
    return np.array([np.interp(time, run.t, column) for column in values.T])
