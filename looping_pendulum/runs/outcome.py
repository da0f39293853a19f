"""How a run of the reference ends, in words: what stands still, what goes on, and until when.

The page says the same by ``live/assets/outcome.js``, in every language that it has; a test holds the two to each other.
"""

from __future__ import annotations

from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.reference_ode.solution import Run, RunEvent
from looping_pendulum.reference_ode.transitions import PHASE_EVENTS, Event, Mode

ENDINGS = {
    Event.LIGHT_REACHES_ROD: "the light mass reaches the rod",
    Event.HEAVY_REACHES_ROD: "the heavy mass is pulled up to the rod",
    Event.UNWRAPPED: "the string comes off the rod",
}
"""Event that ends the model -> what happens then."""
OF_RELEASE = {
    Release.HELD: "The heavy mass is clamped; the light one swings, and its string winds on and off the rod.",
    Release.DROP: "Without a string both fall, slowed only by the air.",
}
"""Release of which nothing else is to be said -> the sentence."""


def outcome(run: Run) -> str:
    """Return one sentence on how a run of the reference ends: whether, when and how far down the heavy mass comes to rest."""
    halt, release = run.halt, run.parameters.release
    if halt is not None:
        return f"The heavy mass halts after {halt.time:.4f} s, {_below_start(run, halt)}."
    if release in OF_RELEASE:
        return OF_RELEASE[release]
    rests = _rests(run)
    is_cut = run.end.event is Event.TIME_UP
    longest = max(((b.time, e.time) for b, e in rests if e is not None), key=lambda rest: rest[1] - rest[0], default=None)
    if rests and rests[-1][1] is None:
        begin = rests[-1][0]
        # Where a rest as long as this one has ended before, this one may end, too
        if is_cut and longest is not None and longest[1] - longest[0] >= run.end_time - begin.time:
            return (
                f"The heavy mass moves in steps: {len(rests)} times the rod holds the string for a while, the last time after "
                f"{begin.time:.3f} s; the run ends after {_plain(run.end_time)} s."
            )
        return _rests_at_end(run, begin)
    ending = f"after {_plain(run.end_time)} s the heavy mass still moves" if is_cut else _ends_after(run)
    if longest is not None:
        first, last = longest
        if first == 0:
            return f"The rod holds the string at first, but not for good: after {last:.3f} s it slides, and {ending}."
        return (
            f"The heavy mass stands still after {first:.3f} s, but not for good: after {last:.3f} s the string slides again, "
            f"and {ending}."
        )
    if is_cut:
        return f"The heavy mass does not halt within {_plain(run.end_time)} s."
    never = "falls without a halt" if release is Release.VERTICAL else "never halts"
    return f"The heavy mass {never}: {_ending(run)} after {run.end_time:.3f} s."


def _rests(run: Run) -> list[tuple[RunEvent, RunEvent | None]]:
    """Return when the rod held the string: the events at which each rest began and ended (None: it lasts to the run's end)."""
    rests: list[tuple[RunEvent, RunEvent | None]] = []
    for event in run.events:
        if event.event in PHASE_EVENTS:
            continue
        is_held, was_held = event.mode_after is Mode.STICKING, bool(rests) and rests[-1][1] is None
        if is_held and not was_held:
            rests.append((event, None))
        if was_held and not is_held and event is not run.end:
            rests[-1] = (rests[-1][0], event)
    return rests


def _rests_at_end(run: Run, begin: RunEvent) -> str:
    """Return the sentence on a string that the rod still holds when the run ends."""
    is_cut, hangs = run.end.event is Event.TIME_UP, run.parameters.release is Release.VERTICAL
    if is_cut and begin.time == 0 and hangs:
        return "Nothing moves: the rod holds the string."
    light = "the light one hangs still, too" if hangs else "the light one swings on"
    until = f"so it is until the end of the run, after {_plain(run.end_time)} s" if is_cut else _ends_after(run)
    if begin.time == 0:
        return f"The rod holds the string: the heavy mass stands still, {light}, and {until}."
    return f"The heavy mass stands still after {begin.time:.3f} s, {_below_start(run, begin)}; {light}, and {until}."


def _below_start(run: Run, event: RunEvent) -> str:
    """Return how far the heavy mass is below its start, or above it, at an event."""
    drop = 100 * float(run.heavy_drop(event.state))
    return f"{abs(drop):.1f} cm {'below' if drop >= 0 else 'above'} its start"


def _ending(run: Run) -> str:
    """Return what ends the model."""
    event = run.end.event
    assert event is not None, "the release is not the end of a run"
    return ENDINGS[event]


def _ends_after(run: Run) -> str:
    """Return when the model ends, and what ends it."""
    return f"after {run.end_time:.3f} s {_ending(run)}"


def _plain(time: float) -> str:
    """Write a limit of the time [s] with as many digits as it has."""
    return f"{time:.3f}".rstrip("0").rstrip(".")
