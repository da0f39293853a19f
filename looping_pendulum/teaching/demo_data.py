"""What the demonstration page draws, taken from a comparison's result and its trajectories; nothing is simulated here."""

from __future__ import annotations

from typing import Any

import numpy as np

from looping_pendulum.compare.align import Aligned
from looping_pendulum.compare.landmarks import STRINGLESS
from looping_pendulum.compare.report import name
from looping_pendulum.compare.result import ComparisonResult, EngineResult, Landmarks, ResultSamples, SupplyEntry
from looping_pendulum.compare.words import EVENT_WORDS, PHYSICS_WORDS, mode_words, told_events
from looping_pendulum.engines.protocol import needed_physics
from looping_pendulum.engines.tension import tension_from_motion
from looping_pendulum.engines.trajectory import UNKNOWN_MODE, Supplier, Trajectory
from looping_pendulum.pages.numbers import quantity
from looping_pendulum.pages.palette import styles
from looping_pendulum.reference_ode.geometry import Array, light_position
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.reference_ode.transitions import Mode

FINE, COARSE = 500, 250
"""Drawn positions per second: the finer one unless the run is long."""
LONG = 4.0
"""A run longer than this [s] is drawn with the coarser rate, so that its page stays light."""
SAME_PLACE = 1e-4
"""Places [m] that the string's length and angle must give to be drawn from them: a tenth of a millimetre is no pixel."""

EVENT_KINDS = {
    "stop": ("stop", "the heavy mass's speed is zero for an instant"),
    "stick": ("stick", "the rod begins to hold the string; the heavy mass rests"),
    "slip": ("slip", "the string breaks away; a resting heavy mass moves again"),
    "slack": ("slack", "the string loses its tension; the masses fly freely"),
    "taut": ("taut", "the string pulls again"),
    "halt": ("halt", "the heavy mass is at rest for good"),
    "rod": ("at the rod", "the light mass has reached the rod"),
    "broke": ("broke off", "the run ended before its time"),
    "other": ("event", "something else that the reference reports"),
}
"""Kind of mark -> (short name, meaning)."""
KIND_OF_EVENT = {"slip_onset": "slip", "light_reaches_rod": "rod"} | {n: n for n in ("stop", "stick", "slack", "taut", "halt")}


def page_data(result: ComparisonResult) -> dict[str, Any]:
    """Everything that the page's scripts need, as plain data: SI and radians, one list per quantity and run.

    Raises
    ------
    ValueError
        If ``result`` has no trajectories.
    """
    if result.samples is None:
        raise ValueError("this result was read without its trajectories; make it again with `looping-pendulum compare`")
    rate = FINE if result.duration <= LONG else COARSE
    look = styles(e.label for e in result.engines)
    p = Parameters(**result.parameters)
    runs = [_reference(result, result.samples, p, rate)]
    for i, (engine, aligned) in enumerate(zip(result.engines, result.samples.aligned, strict=True), start=1):
        style = look[engine.label]
        drawn = {"colour": f"var(--run-{style.slot})", "dashes": list(style.dashes), "marker": style.marker}
        runs.append(_engine(result, engine, aligned, p, rate) | drawn | {"id": f"run{i}"})
    return {
        "scenario": result.scenario,
        "duration": result.duration,
        "radius": p.rod_radius,
        "string": p.release is not Release.DROP,
        "rate": rate,
        "runs": runs,
        "modes": _modes(result.samples.reference),
        "kinds": {kind: words[0] for kind, words in EVENT_KINDS.items()},
    }


def _reference(result: ComparisonResult, samples: ResultSamples, p: Parameters, rate: int) -> dict[str, Any]:
    end = result.reference.end_time
    events = [
        {"kind": KIND_OF_EVENT.get(event, "other"), "t": time, "words": EVENT_WORDS[event]}
        for event, time in told_events(result.reference.events)
        if time <= result.duration
    ]
    halt = result.reference.landmarks.halting_time
    halts = "" if p.release in STRINGLESS else "It never halts." if halt is None else f"It halts at {halt:.4f} s."
    return {
        "id": "reference",
        "name": "reference",
        "colour": "var(--reference)",
        "dashes": [1, 0],
        "marker": "o",
        "events": events,
        "end": end,
        "gap": "",
        "caption": f"The exact model, solved far more finely than any engine. {halts}".strip(),
        "story": "",
    } | _tracks(samples.reference, None, p, rate)


def _engine(result: ComparisonResult, engine: EngineResult, aligned: Aligned, p: Parameters, rate: int) -> dict[str, Any]:
    gap = ""
    if not len(aligned.t):
        said = engine.message.strip().splitlines()
        gap = engine.status_sentence + (f" ({said[-1][:200]})" if said else "")
    return {
        "name": result.short_name(engine),
        "events": _marks(engine, gap),
        "end": engine.end_time,
        "gap": gap,
        "caption": caption(result, engine, p),
        "story": engine.story,
        "title": name(engine),
    } | _tracks(aligned.run, aligned.distance, p, rate)


def _marks(engine: EngineResult, gap: str) -> list[dict[str, Any]]:
    """Moments of an engine's run, from its landmarks, in the order of time."""
    own = engine.landmarks
    halt, end = own.halting_time, own.light_reaches_rod
    marks = [("stop", stop.time, EVENT_WORDS["stop"]) for stop in own.stops if stop.time != halt]
    marks += [("slip", time, EVENT_WORDS["slip_onset"]) for time in own.slip_onsets]
    marks += [] if halt is None else [("halt", halt, EVENT_WORDS["halt"])]
    marks += [] if end is None else [("rod", end, EVENT_WORDS["light_reaches_rod"])]
    if not engine.ok and not gap and engine.end_time is not None:
        marks.append(("broke", engine.end_time, engine.status_sentence))
    return [{"kind": kind, "t": time, "words": words} for kind, time, words in sorted(marks, key=lambda m: m[1])]


def caption(result: ComparisonResult, engine: EngineResult, p: Parameters) -> str:
    """Return one honest line on a run: who supplies the friction, when it halts, what it lacks."""
    supplies = engine.provenance.supplies
    parts = [_friction(supplies, p), _halting(engine, result.reference.sampled), _lacks(engine)]
    if not engine.ok:
        parts.insert(0, f"Not shown to the end: {engine.status_sentence}." if engine.samples else "Nothing to show.")
    return " ".join(part for part in parts if part)


def _friction(supplies: tuple[SupplyEntry, ...], p: Parameters) -> str:
    if "friction_law" not in needed_physics(p):
        return "Friction plays no part here."
    entry = next((s for s in supplies if s.what == "friction law"), None)
    if entry is None:
        return "It does not say who supplies the friction."
    who = {
        Supplier.ENGINE.value: "Friction by the engine itself",
        Supplier.ADAPTER.value: "Friction fed in by our adapter",
        Supplier.NOBODY.value: "No friction on the rod",
    }
    return f"{who[entry.by]}: {entry.how}."


def _halting(engine: EngineResult, true: Landmarks) -> str:
    own = engine.landmarks.halting_time
    if engine.not_comparable:
        return f"Its halt is not comparable: {engine.not_comparable}."
    late = engine.metrics["halting_time_error"]
    if late is not None:
        return f"Halts at {own:.4f} s, {quantity(abs(late), 's')} {'after' if late > 0 else 'before'} the reference."
    if own is not None:
        return f"Comes to rest at {own:.4f} s; the reference never does."
    if true.halting_time is None or engine.end_time is None:
        return ""
    if engine.end_time < true.halting_time:
        return f"Its run ends at {engine.end_time:.3f} s, before the reference halts."
    return f"Does not halt by {engine.end_time:.2f} s."


def _lacks(engine: EngineResult) -> str:
    missing = [PHYSICS_WORDS[what] for what in engine.lacks]
    return f"Lacks {' and '.join(missing)}." if missing else "No physics is declared missing."


def _tracks(run: Trajectory, distance: Array | None, p: Parameters, rate: int) -> dict[str, Any]:
    """Lists at ``rate`` per second from the release to the run's end; unknown values are None."""
    if not len(run.t):
        return {"count": 0}
    t = np.arange(int(run.t[-1] * rate + 1e-6) + 1) / rate

    def at(values: Array) -> Array:
        return np.interp(t, run.t, values)

    x, y, free_length, wrap_angle = *map(at, run.light_position.T), at(run.free_length), at(run.wrap_angle)
    tracks: dict[str, Any] = {"count": len(t), "drop": _rounded(at(run.heavy_drop), 6)}
    heavy_x, heavy_y = run.heavy_position.T
    tracks["heavy"] = [round(float(heavy_x[0]), 6), round(float(heavy_y[0]), 6)]
    if np.ptp(heavy_x) > SAME_PLACE:
        tracks["heavy_x"] = _rounded(at(heavy_x), 5)
    if p.release is not Release.DROP:
        tracks |= {"length": _rounded(free_length, 6), "angle": _rounded(wrap_angle, 5)}
    off = np.hypot(*(np.array(light_position(np, free_length, wrap_angle, p.rod_radius)) - (x, y)))
    if np.isnan(off).any() or off.max() > SAME_PLACE:
        tracks |= {"x": _rounded(x, 6), "y": _rounded(y, 6)}
    light, heavy = run.light_tension, run.heavy_tension
    if light is None and heavy is None:
        light, heavy = tension_from_motion(run, p)
    for key, tension in (("light_tension", light), ("heavy_tension", heavy)):
        if tension is not None and not np.isnan(tension).all():
            tracks[key] = _rounded(at(tension), 5)
    if distance is not None:
        tracks["distance"] = _rounded(at(distance), 8)
    return tracks


def _rounded(values: Array, decimals: int) -> list[float | None]:
    return [round(v, decimals) if np.isfinite(v) else None for v in values.tolist()]


def _modes(reference: Trajectory) -> list[dict[str, Any]]:
    """What the reference does, as stretches of time [s]."""
    changes = np.flatnonzero(np.diff(reference.mode)) + 1
    starts = [0, *changes.tolist()]
    return [
        {"from": float(reference.t[i]), "words": mode_words(int(reference.mode[i])), "moves": _moves(int(reference.mode[i]))}
        for i in starts
    ]


def _moves(mode: int) -> str:
    """Kind of stretch, for its pattern on the timeline."""
    if mode == UNKNOWN_MODE:
        return "unknown"
    known = Mode(mode)
    if known.sliding:
        return "down" if known is Mode.SLIDING_DOWN else "up"
    if known is Mode.FALLING:
        return "free"
    return "slack" if known.slack else "stick"
