"""The live page with the runs of a comparison in it, each beside the page's own, in one file that works offline.

Nothing is simulated here: the page's scripts get the runs as plain data.
"""

from __future__ import annotations

import os
import sys
import webbrowser
from pathlib import Path
from typing import Any

import numpy as np

from looping_pendulum.compare.align import Aligned
from looping_pendulum.compare.deviation import EVENT_DESCRIPTIONS, events_to_show
from looping_pendulum.compare.metrics import RMS_END_TIMES
from looping_pendulum.compare.report import name
from looping_pendulum.compare.result import ComparisonResult, EngineResult, ResultSamples
from looping_pendulum.compare.stories import PHYSICS_DESCRIPTIONS, halting
from looping_pendulum.compare.trial import RESIDUAL_UNITS, distance
from looping_pendulum.engines.protocol import physics_of
from looping_pendulum.engines.registry import styles
from looping_pendulum.files import write_atomically
from looping_pendulum.live.write import render as render_live
from looping_pendulum.pages.numbers import number, quantity
from looping_pendulum.pages.report import glossary
from looping_pendulum.reference_ode.geometry import Array, light_position
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.reference_ode.solve import DURATION, solve
from looping_pendulum.reference_ode.transitions import Mode
from looping_pendulum.runs.outcome import outcome
from looping_pendulum.runs.tension import AVERAGING_TIME, tension_from_motion
from looping_pendulum.runs.trajectory import UNKNOWN_MODE, Supplier, Trajectory
from looping_pendulum.scenarios.scenario import Scenario

FILE = "demo.html"
FINE_RATE, COARSE_RATE = 500, 250
"""Drawn positions per second of a run: the first, or the second if the run is long."""
LONG_RUN = 4.0
"""Duration [s] above which a run is drawn at the coarse rate, so that its page stays small."""
POSITION_TOLERANCE = 1e-4
"""Largest error [m] of positions that are computed from free length and wrap angle: a tenth of a millimetre is no pixel."""
KIND_OF_EVENT = {"slip_onset": "slip", "light_reaches_rod": "rod"} | {n: n for n in ("stop", "stick", "slack", "taut", "halt")}
"""Name of a reference's event -> its kind on the timeline; any other is "other". Of an engine's run there is "broke", too."""


def demo_page(result: ComparisonResult) -> str:
    """Return the page of a comparison that has its trajectories.

    Raises
    ------
    ValueError
        If ``result`` was read from a file without them.
    """
    scenario = Scenario(
        name=result.scenario,
        title=result.title,
        description=result.description,
        parameters=result.parameters,
        duration=result.duration,
    )
    return render_live(scenario, engine_runs=page_data(result))


def write(result: ComparisonResult, path: Path) -> None:
    """Write the page to ``path``."""
    write_atomically(path, demo_page(result))


def show(path: Path) -> bool:
    """Open ``path`` in the user's browser; return False if there is no browser with a screen."""
    if sys.platform.startswith("linux") and not any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"))):
        return False  # webbrowser would start a text browser in this terminal, which can show no animation
    return webbrowser.open(path.resolve().as_uri())


def page_data(result: ComparisonResult) -> dict[str, Any]:
    """Return all that the page's scripts read of the runs, as plain types: SI units and radians, one list per quantity and run.

    Raises
    ------
    ValueError
        If ``result`` has no trajectories.
    """
    if result.samples is None:
        raise ValueError("this result was read without its trajectories; make it again with `looping-pendulum compare`")
    rate = FINE_RATE if result.duration <= LONG_RUN else COARSE_RATE
    run_styles = styles(e.label for e in result.engines)
    p = result.parameters
    runs = [_reference_run(result, result.samples, p, rate)]
    for i, (engine, aligned) in enumerate(zip(result.engines, result.samples.aligned, strict=True), start=1):
        style = run_styles[engine.label]
        drawing_style = {"colour": f"var(--run-{style.slot})", "dashes": list(style.dashes), "marker": style.marker}
        runs.append(_engine_run(result, engine, aligned, p, rate) | drawing_style | {"id": f"run{i}"})
    return {
        "scenario": result.scenario,
        "release": p.release.value,
        "duration": result.duration,
        "radius": p.rod_radius,
        "string": p.release is not Release.DROP,
        "rate": rate,
        "runs": runs,
        "modes": _mode_intervals(result.samples.reference),
        "versions": _versions(result),
        "tension_window": AVERAGING_TIME,
        "words": glossary("comparison"),
        "trial": _tracked_points(result, result.samples),
    }


def _tracked_points(result: ComparisonResult, samples: ResultSamples) -> dict[str, Any] | None:
    """Return the tracked points of the measured trial: for the stage by mass, for the panels by quantity; None without any."""
    if result.trial is None or not result.trial.tracks:
        return None
    stage: dict[str, Any] = {}
    panels: dict[str, Any] = {}
    for comparison in result.trial.tracks:
        track = comparison.track
        t, mass = _rounded(np.array(track.t), 5), track.name.partition(" ")[0]
        coordinates = {axis: track.channel(f"{mass}_{axis}") for axis in ("x", "y")}
        if coordinates["y"] is not None and (mass == "heavy" or coordinates["x"] is not None):
            known = {axis: _rounded(np.array(values), 5) for axis, values in coordinates.items() if values is not None}
            stage[mass] = {"t": t} | known
        angle = track.channel("wrap_angle")
        if angle is not None:
            panels["angle"] = {"t": t, "v": _rounded(np.array(angle), 5)}
        if track.name == "light mass":
            panels["distance"] = {"t": t, "v": _rounded(distance(track, samples.reference), 6)}
    drops = result.trial.heavy_drops(samples.reference)
    if drops is not None:
        panels["drop"] = {"t": _rounded(drops[0], 5), "v": _rounded(drops[1], 6)}
    return {"name": result.trial.name, "stage": stage, "panels": panels}


def _residual_words(result: ComparisonResult, index: int | None) -> str:
    """Return how far the measured points are from a run: from the engine of that index, or None: from the reference."""
    parts = []
    for comparison in () if result.trial is None else result.trial.tracks:
        residual = comparison.reference if index is None else comparison.engines[index]
        if residual.rms is not None:
            unit = RESIDUAL_UNITS[comparison.track.unit]
            rms = number(residual.rms, unit.per_si_unit)
            parts.append(f"{comparison.track.name} {rms} {unit.name}")
    return f"RMS distance of the measured points: {', '.join(parts)}." if parts else ""


def _reference_run(result: ComparisonResult, samples: ResultSamples, p: Parameters, rate: int) -> dict[str, Any]:
    end = result.reference.end_time
    events = [
        {"kind": KIND_OF_EVENT.get(event, "other"), "t": time, "words": EVENT_DESCRIPTIONS[event], "name": event}
        for event, time in events_to_show(result.reference.events)
        if time <= result.duration
    ]
    exact = solve(p, duration=max(DURATION, result.duration))
    return {
        "id": "reference",
        "name": "reference",
        "colour": "var(--reference)",
        "dashes": [1, 0],
        "marker": "o",
        "events": events,
        "end": end,
        "gap": "",
        "caption": f"The exact model, solved far more finely than any engine. {outcome(exact)}",
        "detail": _residual_words(result, None),
        "story": "",
    } | _sampled_motion(samples.reference, None, p, rate)


def _engine_run(result: ComparisonResult, engine: EngineResult, aligned: Aligned, p: Parameters, rate: int) -> dict[str, Any]:
    gap = ""
    if not len(aligned.t):
        message_lines = engine.message.strip().splitlines()
        gap = engine.status_sentence + (f" ({message_lines[-1][:200]})" if message_lines else "")
    return {
        "name": result.short_name(engine),
        "events": _timeline_events(engine, gap),
        "end": engine.end_time,
        "gap": gap,
        "caption": _caption(result, engine, aligned.run),
        "detail": f"{_detail(engine, p)} {_residual_words(result, result.engines.index(engine))}".strip(),
        "story": engine.story,
        "title": name(engine),
    } | _sampled_motion(aligned.run, aligned.distance, p, rate)


def _timeline_events(engine: EngineResult, gap: str) -> list[dict[str, Any]]:
    """Return the events of an engine's run, from its landmarks, in order of time."""
    landmarks = engine.landmarks
    halt, end = landmarks.halting_time, landmarks.light_reaches_rod
    events = [("stop", stop.time, EVENT_DESCRIPTIONS["stop"]) for stop in landmarks.stops if stop.time != halt]
    events += [("slip", time, EVENT_DESCRIPTIONS["slip_onset"]) for time in landmarks.slip_onsets]
    events += [] if halt is None else [("halt", halt, EVENT_DESCRIPTIONS["halt"])]
    events += [] if end is None else [("rod", end, EVENT_DESCRIPTIONS["light_reaches_rod"])]
    if not engine.ok and not gap and engine.end_time is not None:
        events.append(("broke", engine.end_time, engine.status_sentence))
    return [{"kind": kind, "t": time, "words": words} for kind, time, words in sorted(events, key=lambda event: event[1])]


def _caption(result: ComparisonResult, engine: EngineResult, run: Trajectory) -> str:
    """Return one line about a run for everyone: who supplies the friction, and when it halts."""
    if not engine.samples:
        return f"Nothing to show. {_friction(engine, result.parameters)}"
    parts = [
        "" if engine.ok else f"Not shown to the end: {engine.status_sentence}.",
        _friction(engine, result.parameters),
        halting(engine.landmarks, result.reference.sampled, run, engine.lacks, engine.not_comparable),
    ]
    return " ".join(part for part in parts if part)


def _detail(engine: EngineResult, p: Parameters) -> str:
    """Return what those ask who know engines: how the friction is supplied, how far the path is, what the run lacks."""
    law = engine.provenance.supplies.friction_law
    how = f"Friction: {law.how}." if "friction_law" in physics_of(p) else ""
    return " ".join(part for part in (how, _path(engine), _lacks(engine)) if part)


def _friction(engine: EngineResult, p: Parameters) -> str:
    if "friction_law" not in physics_of(p):
        return "Friction plays no part here."
    who = {
        Supplier.ENGINE: "Friction by the engine itself",
        Supplier.ADAPTER: "Friction fed in by our adapter",
        Supplier.NOBODY: "No friction on the rod",
    }
    return f"{who[engine.provenance.supplies.friction_law.by]}."


def _path(engine: EngineResult) -> str:
    """Return the mean distance of its path from the reference's until the halt, or else until the latest time that is known."""
    metric = next((metric for metric in ("rms_halt", *reversed(RMS_END_TIMES)) if engine.metrics.get(metric) is not None), None)
    if metric is None:
        return ""
    until = "the halt" if metric == "rms_halt" else f"{RMS_END_TIMES[metric]:g} s"
    return f"RMS distance of its path until {until}: {quantity(engine.metrics[metric], 'm')}."


def _lacks(engine: EngineResult) -> str:
    missing = [PHYSICS_DESCRIPTIONS[what] for what in engine.lacks]
    return f"Lacks {' and '.join(missing)}." if missing else "No physics is declared missing."


def _sampled_motion(run: Trajectory, distance: Array | None, p: Parameters, rate: int) -> dict[str, Any]:
    """Return lists of the motion at ``rate`` per second from the release to the run's end; unknown values are None.

    Positions are left out where free length and wrap angle give them, and the page's scripts compute them.
    """
    if not len(run.t):
        return {"count": 0}
    # The margin keeps the last position where rounding puts the run's end just before it
    t = np.arange(int(run.t[-1] * rate + 1e-6) + 1) / rate

    def at(values: Array) -> Array:
        return np.interp(t, run.t, values)

    x, y, free_length, wrap_angle = *map(at, run.light_position.T), at(run.free_length), at(run.wrap_angle)
    # Rounded, to a micrometre here, because the page holds every digit as text
    motion: dict[str, Any] = {"count": len(t), "drop": _rounded(at(run.heavy_drop), 6)}
    heavy_x, heavy_y = run.heavy_position.T
    motion["heavy"] = [round(float(heavy_x[0]), 6), round(float(heavy_y[0]), 6)]
    # Nearly always it falls straight down, so that one x serves for all times
    if np.ptp(heavy_x) > POSITION_TOLERANCE:
        motion["heavy_x"] = _rounded(at(heavy_x), 5)
    if p.release is not Release.DROP:
        motion |= {"length": _rounded(free_length, 6), "angle": _rounded(wrap_angle, 5)}
    error = np.hypot(*(np.array(light_position(np, free_length, wrap_angle, p.rod_radius)) - (x, y)))
    if np.isnan(error).any() or error.max() > POSITION_TOLERANCE:
        motion |= {"x": _rounded(x, 6), "y": _rounded(y, 6)}
    light, heavy = run.light_tension, run.heavy_tension
    if light is None and heavy is None:
        light, heavy = tension_from_motion(run, p)
    for key, tension in (("light_tension", light), ("heavy_tension", heavy)):
        if tension is not None and not np.isnan(tension).all():
            motion[key] = _rounded(at(tension), 5)
    if distance is not None:
        motion["distance"] = _rounded(at(distance), 8)
    return motion


def _rounded(values: Array, decimals: int) -> list[float | None]:
    return [round(v, decimals) if np.isfinite(v) else None for v in values.tolist()]


def _mode_intervals(reference: Trajectory) -> list[dict[str, Any]]:
    """Return the time intervals of the reference's modes: each one's start [s] and the mode's name."""
    names = {mode.value: mode.name.lower() for mode in Mode} | {UNKNOWN_MODE: "unknown"}
    starts = [0, *(np.flatnonzero(np.diff(reference.mode)) + 1).tolist()]
    return [{"from": float(reference.t[i]), "mode": names[int(reference.mode[i])]} for i in starts]


def _versions(result: ComparisonResult) -> list[str]:
    """Return for the reference and for each engine who made the run, with which versions."""
    made = [("reference", result.reference.provenance), *((name(engine), engine.provenance) for engine in result.engines)]
    return [", ".join([who, *(f"{package} {v}" for package, v in provenance.versions.items())]) for who, provenance in made]
