"""Says in plain words what happens in a run, and where, when and why an engine departs from the reference.

The sentences use only the numbers of the result and the record of who supplies which physics.
"""

from __future__ import annotations

from looping_pendulum.compare.deviation import EVENT_DESCRIPTIONS, Departure
from looping_pendulum.engines.protocol import STATIC_FRICTION, physics_of
from looping_pendulum.pages.numbers import quantity
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.runs.events import RESOLUTION, Landmarks
from looping_pendulum.runs.trajectory import LARGEST, RunStatus, Supplier, Supplies, Trajectory

PHYSICS_DESCRIPTIONS = {
    "winding": "the winding",
    "friction_law": "the string's friction on the rod",
    "stick_slip": "sticking and slipping",
    "drag": "the drag",
    "static_friction": "a static friction other than the kinetic one",
}
"""Name of a piece of physics, as in `Abilities.lacks` and `Supplies` -> its description."""
MODEL_ENDS = {
    RunStatus.HEAVY_REACHED_ROD: "the reference's heavy mass reaches the rod and the model ends",
    RunStatus.STRING_LEFT_ROD: "the reference's string leaves the rod and the model ends",
}
"""Status of a run that is compared up to the end of the model -> what the reference does there."""
HALT_ON_TIME = 1e-5
"""Difference of halting times [s] up to which a run halts on time: from samples, stops are located to about that."""
STRETCH_SHARE = 0.5
"""Stretch of the string, as a share of the deviation, from which on it is named as a likely cause."""
REST_PHYSICS = ("stick_slip", STATIC_FRICTION)
"""Names of the physics that acts only once the string has come to rest."""


def story(
    run: Trajectory,
    parameters: Parameters,
    supplies: Supplies,
    departures: tuple[Departure, ...],
    own: Landmarks,
    expected: Landmarks,
    not_comparable: str = "",
    mistake: str = "",
    velocities: str = "",
) -> str:
    """Return plain sentences that say where, when and why ``run`` departs from the reference.

    Parameters
    ----------
    own, expected
        Landmarks of the run's samples and of the reference's, found by the same detector.
    not_comparable
        Why the halting times cannot be compared; empty: they can.
    mistake, velocities
        What is simply wrong with the positions and with the velocities (`simple_mistakes`), as clauses; empty: nothing known.
    """
    if len(run.t) == 0:
        why = f": {run.message}" if run.status is RunStatus.UNSUPPORTED else ""
        what = f"its first sample is no number, or above {LARGEST:g} m" if run.status.ok else run.status.value
        return f"No motion to compare: {what}{why}."
    missing = missing_physics(supplies, parameters, run.lacks)
    sentences = [_when(departures, run)]
    if departures:
        sentences.append(_where(departures[0], parameters))
        sentences.append(_why(departures[0], supplies, parameters, missing, mistake))
    sentences.append(f"{velocities[0].upper()}{velocities[1:]}." if velocities else "")
    sentences.append(halting(own, expected, run, missing, not_comparable))
    sentences.append(_rebound(own))
    # Without any friction law, a missing static friction says nothing more
    if STATIC_FRICTION in missing and "friction_law" not in missing:
        c = parameters.coefficients
        values = f"{c['static_friction']:g} before it slides, {c['kinetic_friction']:g} while it does"
        sentences.append(
            f"It has one friction coefficient where this scenario has two ({values}): its run lacks the static one."
        )
    if not run.status.ok:
        sentences.append(f"The run broke off at {run.t[-1]:.3f} s: {run.status.value}.")
    return " ".join(s for s in sentences if s)


def missing_physics(supplies: Supplies, parameters: Parameters, lacks: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Return the physics that the scenario has and the run did not: what nobody supplies, and what ``lacks`` names."""
    scenario_physics = physics_of(parameters)
    nobody = (what for what, supply in vars(supplies).items() if supply.by is Supplier.NOBODY)
    return tuple(dict.fromkeys([*(what for what in nobody if what in scenario_physics), *lacks]))


def _when(departures: tuple[Departure, ...], run: Trajectory) -> str:
    if not departures:
        where = MODEL_ENDS.get(run.status, "the comparison ends")
        return f"Stays within 1 mm of the reference up to {run.t[-1]:.3f} s, where {where}."
    first = departures[0]
    text = f"First deviates by more than {first.threshold * 1e3:.0f} mm at {first.time:.3f} s, while {first.mode}"
    if first.after != "release":
        words = EVENT_DESCRIPTIONS.get(first.after, first.after.replace("_", " "))
        text += f", {(first.time - first.after_time) * 1e3:.0f} ms after {words}"
    if len(departures) > 1:
        text += f"; by more than {departures[-1].threshold * 1e3:.0f} mm at {departures[-1].time:.3f} s"
    return text + "."


def _where(first: Departure, parameters: Parameters) -> str:
    if parameters.release is Release.DROP:
        side = "higher" if first.heavy > 0 else "lower"
        return f"At that time its heavy mass is {quantity(abs(first.heavy), 'm')} {side} than the reference's."
    out = "further out" if first.along > 0 else "further in"
    ahead = "ahead" if first.across > 0 else "behind"
    up = "higher" if first.heavy > 0 else "lower"
    along, across, heavy = (quantity(abs(d), "m") for d in (first.along, first.across, first.heavy))
    return (
        f"At that time its light mass is {along} {out} along the string and {across} {ahead} across it, "
        f"and its heavy mass is {heavy} {up} than the reference's."
    )


def _why(first: Departure, supplies: Supplies, parameters: Parameters, missing: tuple[str, ...], mistake: str = "") -> str:
    causes = []
    # A string that has slid ever since its release has not needed to stick yet.
    acting = [m for m in missing if m not in REST_PHYSICS or first.after != "release"]
    if acting:
        causes.append(f"{_unmodelled(acting)}, which this scenario has")
    elif mistake:
        causes.append(mistake)
    if not mistake and first.stretch is not None and first.stretch >= STRETCH_SHARE * first.threshold:
        causes.append(f"its string had stretched by up to {quantity(first.stretch, 'm')} by then")
    if causes:
        return f"Likely cause: {'; '.join(causes)}."
    text = "All the physics that had acted by then is modelled" if missing else "All the physics of the scenario is modelled"
    scenario_physics = physics_of(parameters)
    by = {who: [what for what, supply in vars(supplies).items() if supply.by is who] for who in Supplier}
    parts = []
    for who in (Supplier.ENGINE, Supplier.ADAPTER):
        supplied = [PHYSICS_DESCRIPTIONS[what] for what in by[who] if what in scenario_physics]
        if supplied:
            parts.append(f"by the {who.value}: {_listed(supplied)}")
    text += f" ({'; '.join(parts)})" if parts else ""
    if first.stretch is not None:
        stretch = f"had stretched by no more than {quantity(first.stretch, 'm')}" if first.stretch else "did not stretch"
        text += f", and its string {stretch}"
    return f"{text}. Suspect its time step, its solver or a coefficient." if parts else f"{text}."


def _unmodelled(missing: list[str]) -> str:
    return f"neither the engine nor the adapter models {_listed([PHYSICS_DESCRIPTIONS[m] for m in missing], 'or')}"


def halting(own: Landmarks, expected: Landmarks, run: Trajectory, missing: tuple[str, ...], not_comparable: str = "") -> str:
    """Return a sentence on how a run with samples halts, beside the reference; empty: neither does; arguments as of `story`."""
    if not_comparable:
        return f"Its halt is not comparable: {not_comparable}."
    end = float(run.t[-1])
    if expected.halting_time is None:
        if own.halting_time is None:
            return ""
        rest = f"Its heavy mass comes to rest at {own.halting_time:.3f} s"
        return f"{rest}; the reference's {'does not before its end' if run.status in MODEL_ENDS else 'never does'}."
    if own.halting_time is None:
        if end < expected.halting_time:
            early = f"before the reference's heavy mass halts ({expected.halting_time:.3f} s)"
            reached = own.light_reaches_rod
            return "" if reached is None else f"Its light mass reaches the rod at {reached:.3f} s, {early}."
        stops = [f"{stop.time:.3f} s" for stop in own.stops[:3]]
        turned = f"; it stops at {_listed(stops)} and moves on" if stops else ""
        # Only these can bring a string to rest
        missing_for_halt = [m for m in missing if m in ("friction_law", "stick_slip")]
        why = f": {_unmodelled(missing_for_halt)}" if missing_for_halt else ""
        by = f" to within {quantity(RESOLUTION, 'm')}" if not missing_for_halt else ""
        return f"Its heavy mass does not halt{by} (the reference's halts at {expected.halting_time:.3f} s){turned}{why}."
    late = own.halting_time - expected.halting_time
    text = (
        f"Halts {quantity(abs(late), 's')} {'late' if late > 0 else 'early'}" if abs(late) > HALT_ON_TIME else "Halts on time"
    )
    if not own.halting_confirmed and run.status is not RunStatus.LIGHT_REACHED_ROD:
        text += f" (at rest until the run ends at {end:.3f} s)"
    unsure = own.halting_time_uncertainty
    if unsure is not None and (own.at_least or unsure > HALT_ON_TIME):
        text += f", uncertain by {own.at_least}{quantity(unsure, 's')}, by what counts as rest"
    return text + "."


def _rebound(own: Landmarks) -> str:
    if own.rebound is None or own.rebound.travel <= RESOLUTION:
        return ""
    speed, travel = own.rebound.speed, own.rebound.travel
    return f"After its first rest it still moves by {quantity(travel, 'm')}, at up to {quantity(speed, 'm/s')}."


def _listed(words: list[str], conjunction: str = "and") -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {conjunction} {words[-1]}"
