"""A film of a comparison for slides: the reference, the engines and the measured points in step, as GIF or MP4."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.animation import FFMpegWriter
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from PIL import Image

from looping_pendulum.compare.result import ComparisonResult
from looping_pendulum.engines.registry import styles
from looping_pendulum.errors import HarnessError
from looping_pendulum.files import write_atomically
from looping_pendulum.pages.chart import tracked_points
from looping_pendulum.pages.drawing import curve_look, without_mathtext
from looping_pendulum.pages.palette import Style
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


class FilmWritingError(HarnessError, ValueError):
    """A film cannot be written."""


def check_film(path: Path) -> None:
    """Refuse a film that could not be written, before the work rather than after it.

    Raises
    ------
    FilmWritingError
        If the name has another ending than `SUFFIXES`, or an MP4 is asked for without ffmpeg.
    """
    if path.suffix.lower() not in SUFFIXES:
        found = repr(path.suffix) if path.suffix else "no ending"
        raise FilmWritingError(f"--film: {path}: found {found}, needed .gif or .mp4; write for example --film demo.gif")
    if path.suffix.lower() == ".mp4" and not FFMpegWriter.isAvailable():
        way_out = f"install ffmpeg, or write a GIF: --film {path.with_suffix('.gif')}"
        raise FilmWritingError(f"--film: {path}: found no program ffmpeg, needed it for an MP4; {way_out}")


def write_film(result: ComparisonResult, path: Path, progress: ReportShare | None = None) -> None:
    """Write the film of a comparison that has its trajectories.

    Raises
    ------
    FilmWritingError
        If the file cannot be of the kind that its name says.
    ValueError
        If ``result`` was read from a file without trajectories.
    """
    check_film(path)
    stage = _Stage(result)
    times, slower = frame_times(result.duration)

    def drawn() -> Iterator[float]:
        for i, time in enumerate(times):
            stage.draw(float(time), slower)
            yield float(time)
            if progress is not None:
                progress(f"film, frame {i + 1} of {len(times)}", (i + 1) / len(times))

    if path.suffix.lower() == ".gif":
        write_atomically(path, _gif(stage, float(times[-1]), drawn()))
        return
    part = path.with_name(f".{path.stem}.part.mp4")  # so that a film that breaks off is not taken for a whole one
    try:
        writer = FFMpegWriter(fps=FRAME_RATE, metadata={"title": result.title}, extra_args=["-pix_fmt", "yuv420p"])
        with writer.saving(stage.figure, str(part), DPI):
            for _ in drawn():
                writer.grab_frame()
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def frame_times(duration: float) -> tuple[Array, float]:
    """Return the times of the frames [s], from the release to the end, and how many times slower than the motion they play."""
    count = int(min(np.ceil(duration * SLOW_MOTION * FRAME_RATE) + 1, MAX_FRAMES))
    return np.linspace(0.0, duration, count), (count - 1) / FRAME_RATE / duration


def _gif(stage: _Stage, end: float, drawn: Iterator[float]) -> bytes:
    """Return the frames as a GIF; each is reduced to its few colours at once, so that they do not fill the memory."""
    # The last frame has every colour, those of whole paths included
    stage.draw(end, 1.0)
    palette = stage.image().quantize(GIF_COLOURS)
    frames = [stage.image().quantize(palette=palette, dither=Image.Dither.NONE) for _ in drawn]
    # The choice of colours tints the ground a little, which a white slide would show
    ground = int(np.asarray(frames[0])[0, 0])
    colours = palette.getpalette() or []
    colours[3 * ground : 3 * ground + 3] = (255, 255, 255)
    for frame in frames:
        frame.putpalette(colours)
    out = io.BytesIO()
    frames[0].save(out, "GIF", save_all=True, append_images=frames[1:], duration=1000 // FRAME_RATE, loop=0)
    return out.getvalue()


class _Stage:
    """The apparatus at one time, as a figure."""

    def __init__(self, result: ComparisonResult) -> None:
        if result.samples is None:
            raise ValueError("this result was read without its trajectories; make it again with `looping-pendulum compare`")
        p = result.parameters
        self._radius, self._string = p.rod_radius, p.release is not Release.DROP
        look = styles(e.label for e in result.engines)
        whole: list[tuple[str, Trajectory, Style | None]] = [("reference", result.samples.reference, None)]
        whole += [
            (result.short_name(e), a.run, look[e.label])
            for e, a in zip(result.engines, result.samples.aligned, strict=True)
            if len(a.t) > 1
        ]
        self._runs = [(name, first_samples(run, finite_length(run)), style) for name, run, style in whole]
        self._trial = result.trial
        self.figure = Figure(figsize=SIZE, dpi=DPI, layout="constrained")
        self._canvas = FigureCanvasAgg(self.figure)
        self._axes = self.figure.subplots()
        self._axes.set_aspect("equal")
        self._axes.set(xlabel="x [m]", ylabel="y [m]")
        self._axes.grid(True, color="0.93", lw=0.6)
        self._axes.set_axisbelow(True)
        self._axes.add_patch(Circle((0, 0), self._radius, facecolor="0.7", edgecolor="black", lw=0.8, zorder=6))
        self._title = without_mathtext(result.title)
        self._draw_runs()
        places = np.concatenate([np.vstack([run.light_position, run.heavy_position]) for _, run, _ in self._runs])
        low, high = np.nanmin(places, axis=0), np.nanmax(places, axis=0)
        margin = 0.06 * float(np.max(high - low))
        self._axes.set_xlim(low[0] - margin, high[0] + margin)
        self._axes.set_ylim(low[1] - margin, high[1] + margin)
        self.figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=9)
        # Placed once: for every frame it would take most of the time, and nothing but numbers changes
        self.draw(0.0, 1.5)
        self._canvas.draw()  # type: ignore[no-untyped-call]
        self.figure.set_layout_engine("none")

    def _draw_runs(self) -> None:
        self._lines = []
        for name, run, style in self._runs:
            colour, dashes = ("black", (1, 0)) if style is None else (style.colour, style.dashes)
            dashed: dict[str, Any] = {} if dashes == (1, 0) else {"dashes": dashes}
            masses_style: dict[str, Any] = {"marker": "o", "ms": 11, "mfc": "white", "mew": 2.2}
            if style is not None:
                masses_style = {"marker": style.marker, "ms": 7}
            wide = style is None
            (path,) = self._axes.plot([], [], color=colour, alpha=0.5, lw=2.6 if wide else 1.4, zorder=2, **dashed)
            (string,) = self._axes.plot([], [], color=colour, lw=2.0 if wide else 1.1, zorder=3)
            masses_style |= {"ls": "none", "color": colour, "label": without_mathtext(name), "zorder": 4}
            (masses,) = self._axes.plot([], [], **masses_style)
            self._lines.append((run, path, string, masses))
        self._points: list[tuple[Array, Array, Array, Line2D]] = []
        for track in [] if self._trial is None else [c.track for c in self._trial.tracks]:
            mass = track.name.partition(" ")[0]
            x, y = (track.channel(f"{mass}_{axis}") for axis in ("x", "y"))
            if x is not None and y is not None:
                label = None if self._points else "tracked points"
                (rings,) = self._axes.plot([], [], **curve_look(tracked_points([], [])), label=label, zorder=5)
                self._points.append((np.array(track.t), np.array(x), np.array(y), rings))

    def draw(self, time: float, slower: float) -> None:
        """Draw everything at ``time`` [s]."""
        for run, path, string, masses in self._lines:
            shown = int(np.searchsorted(run.t, time, side="right"))
            light, heavy = (_at(run, values, time) for values in (run.light_position, run.heavy_position))
            path.set_data(*run.light_position[:shown].T)
            masses.set_data(*np.column_stack([light, heavy]))
            ended = time > run.t[-1] + 1e-9
            for line in (string, masses):
                line.set_alpha(0.35 if ended else 1.0)
            if self._string:
                angle = np.linspace(0.0, max(float(_at(run, run.wrap_angle, time)), 0.0), 60)
                wound = self._radius * np.column_stack([np.cos(angle), np.sin(angle)])
                string.set_data(*np.vstack([heavy, wound, light]).T)
        for t, x, y, rings in self._points:
            known = t <= time + 1e-9
            rings.set_data(x[known], y[known])
        speed = f"slowed down {slower:.3g} times" if slower > 1 else f"sped up {1 / slower:.3g} times" if slower < 1 else ""
        self._axes.set_title(f"{self._title}\n{time:.3f} s{', ' + speed if speed else ''}", fontsize=11)

    def image(self) -> Image.Image:
        """Return what was drawn last."""
        self._canvas.draw()  # type: ignore[no-untyped-call]
        width, height = self._canvas.get_width_height()
        pixels = self._canvas.buffer_rgba()  # type: ignore[no-untyped-call]
        return Image.frombuffer("RGBA", (width, height), pixels, "raw", "RGBA", 0, 1).convert("RGB")


def _at(run: Trajectory, values: Array, time: float) -> Array:
    """Return values of a run, shape (n,) or (n, 2), at a time; after its end, those of its end."""
    if values.ndim == 1:
        return np.asarray(np.interp(time, run.t, values))
    return np.array([np.interp(time, run.t, column) for column in values.T])
