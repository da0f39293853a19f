"""Where, when and why an engine departs, as sentences made of the result's own numbers and of who supplies which physics."""

from __future__ import annotations

from looping_pendulum.compare.result import Departure, Landmarks, SupplyEntry
from looping_pendulum.compare.slides import RESOLUTION
from looping_pendulum.compare.words import EVENT_WORDS, PHYSICS_WORDS
from looping_pendulum.engines.protocol import STATIC_FRICTION, needed_physics
from looping_pendulum.engines.trajectory import RunStatus, Supplier, Trajectory
from looping_pendulum.pages.numbers import quantity
from looping_pendulum.reference_ode.parameters import Parameters, Release

ON_TIME = 1e-5
"""A halt closer to the reference's than this [s] is called on time: stops are located to about that from samples."""

STRETCH_SHARE = 0.5
"""A string stretched by at least this share of the deviation is named as a cause of it."""

REST_PHYSICS = ("stick_slip", STATIC_FRICTION)
"""Physics that matters only once the string has come to rest."""


def story(
    run: Trajectory,
    parameters: Parameters,
    supplies: tuple[SupplyEntry, ...],
    found: tuple[Departure, ...],
    own: Landmarks,
    true: Landmarks,
    not_comparable: str = "",
) -> str:
    """Where, when and why ``run`` departs from the reference, in plain sentences.

    Parameters
    ----------
    own, true
        Landmarks of the run's samples and of the reference's, by the same detector.
    not_comparable
        Why the halts cannot be held against each other; empty: they can.
    """
    if len(run.t) == 0:
        return f"No motion to compare: {run.status.value}."
    missing = missing_physics(supplies, parameters, run.lacks)
    sentences = [_first(found, float(run.t[-1]))]
    if found:
        sentences.append(_where(found[0], parameters))
        sentences.append(_why(found[0], supplies, parameters, missing))
    sentences.append(f"Its halt is not comparable: {not_comparable}." if not_comparable else _halting(own, true, run, missing))
    sentences.append(_rebound(own))
    if STATIC_FRICTION in missing and "friction_law" not in missing:
        sentences.append(_without_static_friction(parameters))
    if not run.status.ok:
        sentences.append(f"The run broke off at {run.t[-1]:.3f} s: {run.status.value}.")
    return " ".join(s for s in sentences if s)


def missing_physics(supplies: tuple[SupplyEntry, ...], parameters: Parameters, lacks: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Physics that the scenario has and the run went without: what nobody supplies, and what ``lacks`` names."""
    needed = needed_physics(parameters)
    nobody = (s.what.replace(" ", "_") for s in supplies if s.by == Supplier.NOBODY.value)
    return tuple(dict.fromkeys([*(what for what in nobody if what in needed), *lacks]))


def _without_static_friction(parameters: Parameters) -> str:
    c = parameters.coefficients
    values = f"{c['static_friction']:g} before it slides, {c['kinetic_friction']:g} while it does"
    return f"It has one friction coefficient where this scenario has two ({values}): the static one is missing from its run."


def _first(found: tuple[Departure, ...], end: float) -> str:
    if not found:
        return f"Stays within 1 mm of the reference up to {end:.3f} s, where the comparison ends."
    first = found[0]
    text = f"Leaves the {first.threshold * 1e3:.0f} mm band at {first.time:.3f} s, while {first.mode}"
    if first.after != "release":
        words = EVENT_WORDS.get(first.after, first.after.replace("_", " "))
        text += f", {(first.time - first.after_time) * 1e3:.0f} ms after {words}"
    if len(found) > 1:
        text += f"; passes {found[-1].threshold * 1e3:.0f} mm at {found[-1].time:.3f} s"
    return text + "."


def _where(first: Departure, parameters: Parameters) -> str:
    if parameters.release is Release.DROP:
        return f"There its heavy mass is {quantity(abs(first.heavy), 'm')} {'higher' if first.heavy > 0 else 'lower'}."
    out = "further out" if first.along > 0 else "further in"
    ahead = "ahead" if first.across > 0 else "behind"
    up = "higher" if first.heavy > 0 else "lower"
    along, across, heavy = (quantity(abs(d), "m") for d in (first.along, first.across, first.heavy))
    return (
        f"There its light mass is {along} {out} along the string and {across} {ahead} across it, its heavy mass {heavy} {up}."
    )


def _why(first: Departure, supplies: tuple[SupplyEntry, ...], parameters: Parameters, missing: tuple[str, ...]) -> str:
    causes = []
    # a string that has slid ever since its release has not needed to stick yet
    acting = [m for m in missing if m not in REST_PHYSICS or first.after != "release"]
    if acting:
        causes.append(f"nobody supplies {_listed([PHYSICS_WORDS[m] for m in acting])}, which this scenario has")
    if first.stretch is not None and first.stretch >= STRETCH_SHARE * first.threshold:
        causes.append(f"its string had stretched by up to {quantity(first.stretch, 'm')} by then")
    if causes:
        return f"Likely why: {' and '.join(causes)}."
    text = "All the physics that has acted by then is there" if missing else "All the physics of the scenario is there"
    if first.stretch is not None:
        stretch = f"had stretched by no more than {quantity(first.stretch, 'm')}" if first.stretch else "did not stretch"
        text += f", and its string {stretch}"
    needed = needed_physics(parameters)
    by = {who: [s.what.replace(" ", "_") for s in supplies if s.by == who.value] for who in Supplier}
    own, fed = ([PHYSICS_WORDS[w] for w in by[who] if w in needed] for who in (Supplier.ENGINE, Supplier.ADAPTER))
    parts = [f"{_listed(own)} by the engine itself"] if own else []
    parts += [f"{_listed(fed)} fed in by the adapter"] if fed else []
    return f"{text} ({'; '.join(parts)}): suspect its time step, its solver or a coefficient." if parts else f"{text}."


def _halting(own: Landmarks, true: Landmarks, run: Trajectory, missing: tuple[str, ...]) -> str:
    end = float(run.t[-1])
    if true.halting_time is None:
        if own.halting_time is None:
            return ""
        return f"Its heavy mass comes to rest at {own.halting_time:.3f} s; the reference's never does."
    if own.halting_time is None:
        if end < true.halting_time:
            early = f"before the reference's heavy mass halts ({true.halting_time:.3f} s)"
            return f"Its light mass reaches the rod at {end:.3f} s, {early}." if own.light_reaches_rod is not None else ""
        later = [s.time for s in own.stops]
        turned = f"; it stops at {_listed([f'{t:.3f} s' for t in later[:3]])} and moves on" if later else ""
        needed = [PHYSICS_WORDS[m] for m in missing if m in ("friction_law", "stick_slip")]
        why = f": nobody supplies {_listed(needed)}" if needed else ""
        by = f" to within {quantity(RESOLUTION, 'm')}" if not needed else ""
        return f"Its heavy mass does not halt{by} (the reference's halts at {true.halting_time:.3f} s){turned}{why}."
    late = own.halting_time - true.halting_time
    text = f"Halts {quantity(abs(late), 's')} {'late' if late > 0 else 'early'}" if abs(late) > ON_TIME else "Halts on time"
    if not own.halting_confirmed and run.status is not RunStatus.LIGHT_REACHED_ROD:
        text += f" (seen at rest until the run's end at {end:.3f} s)"
    return text + "."


def _rebound(own: Landmarks) -> str:
    if own.rebound is None or own.rebound.travel <= RESOLUTION:
        return ""
    speed, travel = own.rebound.speed, own.rebound.travel
    return f"After its first rest it still moves by {quantity(travel, 'm')}, at up to {quantity(speed, 'm/s')}."


def _listed(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
