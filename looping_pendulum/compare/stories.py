"""Where, when and why an engine departs, as sentences made of the result's own numbers and of who supplies which physics."""

from __future__ import annotations

from looping_pendulum.compare.result import Departure, Landmarks, SupplyEntry
from looping_pendulum.compare.words import EVENT_WORDS, PHYSICS_WORDS
from looping_pendulum.engines.trajectory import RunStatus, Supplier, Trajectory
from looping_pendulum.reference_ode.parameters import Parameters, Release

ON_TIME = 1e-5
"""A halt closer to the truth's than this [s] is called on time: stops are located to about that from samples."""

STRETCH_SHARE = 0.5
"""A string stretched by at least this share of the deviation is named as a cause of it."""


def story(
    run: Trajectory,
    parameters: Parameters,
    supplies: tuple[SupplyEntry, ...],
    found: tuple[Departure, ...],
    own: Landmarks,
    true: Landmarks,
) -> str:
    """Where, when and why ``run`` departs from the truth, in plain sentences."""
    if len(run.t) == 0:
        return f"No motion to compare: {run.status.value}."
    sentences = [_first(found, float(run.t[-1]))]
    if found:
        sentences.append(_where(found[0], parameters))
        sentences.append(_why(found[0], supplies, parameters))
    sentences.append(_halting(own, true, run, missing_physics(supplies, parameters)))
    if not run.status.ok:
        sentences.append(f"The run broke off at {run.t[-1]:.3f} s: {run.status.value}.")
    return " ".join(s for s in sentences if s)


def missing_physics(supplies: tuple[SupplyEntry, ...], parameters: Parameters) -> tuple[str, ...]:
    """Physics that the scenario has and nobody supplies."""
    needed = needed_physics(parameters)
    return tuple(s.what for s in supplies if s.by == Supplier.NOBODY.value and s.what in needed)


def needed_physics(parameters: Parameters) -> tuple[str, ...]:
    """Pieces of physics, of those that a trajectory says who supplies, that this scenario has at all."""
    c = parameters.coefficients
    needed: list[str] = []
    if parameters.release is not Release.DROP:
        needed.append("winding")
    if parameters.release in (Release.LOOPING, Release.VERTICAL) and c["kinetic_friction"] > 0:
        needed += ["friction law", "stick slip"]
    if any(value > 0 for name, value in c.items() if name.endswith("_drag")):
        needed.append("drag")
    return tuple(needed)


def _first(found: tuple[Departure, ...], end: float) -> str:
    if not found:
        return f"Stays within 1 mm of the truth up to {end:.3f} s, where the comparison ends."
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
        return f"There its heavy mass is {_mm(first.heavy)} {'higher' if first.heavy > 0 else 'lower'}."
    out = "further out" if first.along > 0 else "further in"
    ahead = "ahead" if first.across > 0 else "behind"
    up = "higher" if first.heavy > 0 else "lower"
    text = f"There its light mass is {_mm(first.along)} {out} along the string and {_mm(first.across)} {ahead} across it"
    return f"{text}, its heavy mass {_mm(first.heavy)} {up}."


def _why(first: Departure, supplies: tuple[SupplyEntry, ...], parameters: Parameters) -> str:
    causes = []
    missing = [m for m in missing_physics(supplies, parameters) if m != "stick slip" or first.after != "release"]
    if missing:  # a string that has slid ever since its release has not needed to stick yet
        causes.append(f"nobody supplies {_listed([PHYSICS_WORDS[m] for m in missing])}, which this scenario has")
    if first.stretch is not None and first.stretch >= STRETCH_SHARE * first.threshold:
        causes.append(f"its string had stretched by up to {_mm(first.stretch)} by then")
    if causes:
        return f"Likely why: {' and '.join(causes)}."
    text = "No physics is declared missing"
    if first.stretch is not None:
        text += (
            f" and its string had stretched by no more than {_mm(first.stretch)}"
            if first.stretch
            else " nor did its string stretch"
        )
    needed = needed_physics(parameters)
    own = [PHYSICS_WORDS[s.what] for s in supplies if s.by == Supplier.ENGINE.value and s.what in needed]
    fed = [PHYSICS_WORDS[s.what] for s in supplies if s.by == Supplier.ADAPTER.value and s.what in needed]
    parts = [f"{_listed(own)} by the engine itself"] if own else []
    parts += [f"{_listed(fed)} fed in by the adapter"] if fed else []
    return f"{text} ({'; '.join(parts)}): suspect its time step, its solver or a coefficient." if parts else f"{text}."


def _halting(own: Landmarks, true: Landmarks, run: Trajectory, missing: tuple[str, ...]) -> str:
    end = float(run.t[-1])
    if true.halting_time is None:
        if own.halting_time is None:
            return ""
        return f"Its heavy mass comes to rest at {own.halting_time:.3f} s; the truth's never does."
    if own.halting_time is None:
        if end < true.halting_time:
            early = f"before the truth's heavy mass halts ({true.halting_time:.3f} s)"
            return f"Its light mass reaches the rod at {end:.3f} s, {early}." if own.light_reaches_rod is not None else ""
        later = [s.time for s in own.stops]
        turned = f"; it stops at {_listed([f'{t:.3f} s' for t in later[:3]])} and moves on" if later else ""
        needed = [PHYSICS_WORDS[m] for m in missing if m in ("friction law", "stick slip")]
        why = f": nobody supplies {_listed(needed)}" if needed else ""
        return f"Its heavy mass does not halt (the truth's halts at {true.halting_time:.3f} s){turned}{why}."
    late = own.halting_time - true.halting_time
    text = f"Halts {abs(late) * 1e3:.2g} ms {'late' if late > 0 else 'early'}" if abs(late) > ON_TIME else "Halts on time"
    if not own.halting_confirmed and run.status is not RunStatus.LIGHT_REACHED_ROD:
        text += f" (seen at rest until the run's end at {end:.3f} s)"
    return text + "."


def _mm(metres: float) -> str:
    size = abs(metres) * 1e3
    return f"{size:.2g} mm" if size < 100 else f"{size:.0f} mm"


def _listed(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
