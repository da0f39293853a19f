"""Say what to do next, by verdict."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from looping_pendulum.discrepancy.candidates import APPARATUS, in_words
from looping_pendulum.discrepancy.formulas import Unlisted
from looping_pendulum.discrepancy.result import FittedEffect, Identification, Verdict
from looping_pendulum.measured.observations import UNITS
from looping_pendulum.pages.numbers import amount, number, quantity, uncertain, unit_in_words
from looping_pendulum.runs.events import quantity_label
from looping_pendulum.scenarios.quantities import QUANTITIES

EXAMPLES = 3
"""Effects that are named as examples of what could hide."""
WORST_MISFITS = 3
"""Times that are named at which a model is farthest off."""
MIN_MISFIT = 2.0
"""Smallest misfit that is named [units of noise]."""
PEOPLES_UNITS = {"m": ("mm", 1e3), "kg": ("g", 1e3)}
"""SI unit -> the unit in which an apparatus is measured, and how many of them it is."""
RUN = "looping-pendulum run repaired.yaml"
COMPARE = "looping-pendulum compare repaired.yaml --engine mujoco:capstan --out compared"
LOOK_FOR = {
    "time": "what happens at that time: a bump, a draught, a hand, a mark that was set late",
    "free_length": "what the mass passes at that length of string: a magnet, an edge, something that it touches, a draught",
    "hanging_length": "what the heavy mass passes at that height: an edge, a guide, something that it touches",
    "horizontal_position": "what acts at that place: a magnet, a draught, something that the mass touches",
    "height": "what acts at that height: a magnet, a draught, something that the mass touches",
    "distance": "what attracts or repels from that point: a magnet, a charge, something that the mass touches",
    "slip_speed": "a friction of string on rod that depends on how fast the string slides",
    "normal_load": "a friction of string on rod that depends on how hard the string presses",
    "wrap_angle": "what the string does at that angle: a groove or a seam of the rod, turns that lie on each other",
    "retreat_speed": "a drag or a friction that depends on how fast the string is drawn in",
    "across_speed": "a drag that depends on how fast the mass moves, the spin of the mass, or a wrong scale of the film",
}
"""Coordinate of an unlisted force -> what may cause it."""


def _after_no_missing_effect(result: Identification) -> list[str]:
    visible = [v for v in result.smallest_visible if not v.can_hide][:EXAMPLES]
    examples = ", ".join(f"{in_words(v.name)} below {v.in_words}" for v in visible)
    hidden = [f"Remember what could still hide: {examples}. *What these data could show* lists more."] if examples else []
    return [
        *hidden,
        "To see smaller effects, make the errors smaller: film nearer or with more pixels, use a shorter exposure, and set the "
        "marks with care. About four times as many trials halve what can hide.",
        "Change what the effect would depend on: another mass ratio, release angle or length of string. Two effects that do "
        "the same in one trial seldom do so in another.",
    ]


def _after_identified(result: Identification) -> list[str]:
    names = " and ".join(in_words(e.name) for e in result.effects)
    wrong = [e for e in result.effects if e.candidate.kind == "wrong value"]
    physics = [e for e in result.effects if e.candidate.acts_on != "camera"]
    forces = [e for e in physics if e not in wrong]
    if wrong:
        first = " ".join(map(_measure_again, wrong))
    elif physics:
        first = f"Ask whether it makes sense: what in your apparatus could be {names}? Remove or change it, and film again."
    else:
        first = (
            f"Look at the film: {names} is an error of the picture or of its clock. Correct it in the tracker, or film again."
        )
    use = f"Use the repaired model, `repaired.yaml` beside this report: `{RUN}`, or `{COMPARE}`."
    lines = ", ".join(f"`{e.name}: free`" for e in forces)
    last = f"Test it: film one more trial, add {lines} under `effects` of the study, and run `looping-pendulum identify` again."
    if not forces:
        last = "Film one more trial, hold it out, and run `looping-pendulum identify` again with the corrected value."
    return [first, *([use] if physics else []), last]


def _measure_again(effect: FittedEffect) -> str:
    """Return which values to measure again, with the one that the data ask for and the stated one."""
    parameter = effect.candidate.parameter
    si_unit = QUANTITIES[parameter].kind.unit if parameter in APPARATUS else effect.candidate.unit
    unit, per_unit = PEOPLES_UNITS.get(si_unit, (unit_in_words(si_unit), 1.0))
    said = []
    for wrong in effect.wrong_values:
        stated, asked = wrong.stated, wrong.asked
        error = f" +/- {number(100 * stated.sigma / abs(stated.value))} %" if stated.sigma and stated.value else ""
        right = uncertain(asked.value * per_unit, (asked.sigma or 0.0) * per_unit)
        said.append(f"the data ask for {right} {unit}, stated {number(stated.value * per_unit)} {unit}{error}")
    what = in_words(effect.name).removeprefix("a wrong value of ")
    if not said:
        return f"Measure again {what}."
    ratio = " Only the ratio of the masses shows, so weigh the heavy ones, too."
    return f"Measure again {what}: {'; '.join(said)}.{ratio if parameter == 'light_mass' else ''}"


def _after_ambiguous(result: Identification) -> list[str]:
    experiments = result.next_experiments
    rest = "Add it to the study as a further trial, and run `looping-pendulum identify` again."
    listed = [e for e in result.credible if not e.law]
    if result.unlisted is not None and len(listed) == 1:
        of_force = "tells the unlisted force from the listed effects"
        if not listed[0].effects:
            of_force = "shows whether the unlisted force acts"
        return [f"Film what {of_force}: {_where(result.unlisted)}", rest]
    if not experiments:
        return ["Measure one of the explanations directly: no trial within the study's limits could be simulated.", rest]
    best = experiments[0]
    how = f"release `{best.release}` at {number(math.degrees(best.release_angle))} deg"
    if best.mass_ratio is not None:
        how += f", with a heavy mass of {number(best.mass_ratio)} times the light one"
    if best.separated_pairs:
        what = "the explanations by"
        if best.separated_pairs < best.pairs:
            what = f"{best.separated_pairs} of {best.pairs} pairs of explanations by at least"
        return [f"Film this trial: {how}. It separates {what} {amount(best.distance)} times the noise.", rest]
    return [
        "Measure one of the explanations directly, for example with a scale, a rule or a clock: no trial within the study's "
        "limits separates them.",
        f"If you cannot, the trial that comes nearest to it is: {how}.",
    ]


def _after_unlisted(result: Identification) -> list[str]:
    force = result.unlisted
    assert force is not None
    return [
        f"Measure more of it: {_where(force)}",
        f"Look for {LOOK_FOR.get(force.law.coordinate, 'what changes with this coordinate')}.",
        "If you have an idea, write it as a candidate of your own (`candidates` in the study), and run `looping-pendulum "
        "identify` again: a formula with a reason is worth more than a curve that fits.",
    ]


def _where(force: Unlisted) -> str:
    """Return in which trials more of the force would be seen, to the end of the sentence."""
    name = force.law.coordinate.replace("_", " ")
    ranges = [(p.significant_from, p.significant_to) for p in force.profiles]
    lows = [low for low, _ in ranges if low is not None]
    highs = [high for _, high in ranges if high is not None]
    if not lows:
        return f"trials in which the {name} takes other values."
    low, high = (quantity(s, force.unit) for s in (min(lows), max(highs)))
    if force.law.coordinate == "time":
        return f"film the same release again. Does it act again between {low} and {high}, where it is clearly not zero?"
    return (
        f"trials in which the {name} is often between {low} and {high}, where the force is clearly not zero, and some in which "
        "it is not."
    )


def _after_unexplained(result: Identification) -> list[str]:
    worst = misfits(result)
    outliers = "those that are left out are listed under *Outliers*; " if result.outliers else ""
    steps = [f"Look at the film where the model is farthest off: {'; '.join(worst)}."] if worst else []
    return [
        *steps,
        f"Check single wrong points first: {outliers}a mark on another object or in the wrong frame is worth a correction.",
        "Then the scale: was the rule in the plane of the motion, and is its length right?",
        "Then the clock: is the frame rate true, and are there doubled or missing frames?",
        "Then the release: is the mark of the start on the frame in which the masses are let go?",
        "If all of these are right, the errors that the study states may be too small, or something acts that nobody listed.",
    ]


def misfits(result: Identification) -> list[str]:
    """Return where the nearest model is farthest off: trial, quantity, time and size."""
    found = []
    for p in result.trial_figures:
        d, sizes = p.data, np.abs(np.nan_to_num(p.residuals["after"]))
        for channel, part in d.slices.items():
            i = part.start + int(np.argmax(sizes[part]))
            off = quantity(abs(float(d.value[i] - p.predicted["after"][i])), UNITS[channel])
            found.append((float(sizes[i]), f"trial {d.trial.name} at {number(float(d.t[i]))} s ({channel} off by {off})"))
    for e in result.events:
        label = f"trial {e.trial}, {quantity_label(e.event.quantity, e.event.index)}"
        if e.after is None:
            found.append((math.inf, f"{label} (does not happen in the model)"))
        else:
            distance = abs(e.event.value - e.after)
            found.append((distance / e.event.sigma, f"{label} (off by {quantity(distance, e.event.unit)})"))
    largest = sorted((f for f in found if f[0] > MIN_MISFIT), key=lambda f: -f[0])
    return [text for _, text in largest[:WORST_MISFITS]]


def _after_interrupted(result: Identification) -> list[str]:
    return [
        "Run the same command again and let it end, with a longer `--time-limit` if it had one: what is below is incomplete, "
        "and another explanation may be better.",
    ]


STEPS: dict[Verdict, Callable[[Identification], list[str]]] = {
    Verdict.NO_MISSING_EFFECT: _after_no_missing_effect,
    Verdict.IDENTIFIED: _after_identified,
    Verdict.AMBIGUOUS: _after_ambiguous,
    Verdict.UNLISTED: _after_unlisted,
    Verdict.UNEXPLAINED: _after_unexplained,
    Verdict.INTERRUPTED: _after_interrupted,
}
"""Verdict -> what to do after it."""


def steps(result: Identification) -> list[str]:
    """Return what to do next, in sentences."""
    return STEPS[result.verdict](result)
