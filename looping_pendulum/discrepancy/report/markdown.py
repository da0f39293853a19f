"""The report in Markdown, from the result alone: templates beside this file say what stands where.

First the verdict in one sentence, with one picture; then what to do next; then the details, and the numbers of all tests last.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

from jinja2 import Environment

from looping_pendulum.discrepancy.candidates import in_words
from looping_pendulum.discrepancy.fit.event_prediction import MISSED_EVENT_ERRORS
from looping_pendulum.discrepancy.next_experiment import MIN_SEPARATION
from looping_pendulum.discrepancy.report import next_steps
from looping_pendulum.discrepancy.result import FittedEffect, Identification, RankedExplanation, Verdict
from looping_pendulum.discrepancy.verdict import BODY_IN_WORDS, UNIT_OF_BODY, limits_in_words
from looping_pendulum.measured.observations import EventObservation
from looping_pendulum.pages.numbers import DISPLAY_UNITS, GAP, number, signed, uncertain, unit_in_words
from looping_pendulum.pages.templates import markdown_templates, sections
from looping_pendulum.reference_ode.effects.types import EffectKind
from looping_pendulum.runs.events import quantity_label

HEADLINES = {
    Verdict.NO_MISSING_EFFECT: "Nothing is missing that these data could show",
    Verdict.IDENTIFIED: "A missing effect was found",
    Verdict.AMBIGUOUS: "Something is missing, and these data allow several explanations",
    Verdict.UNLISTED: "A force that no library lists was found",
    Verdict.UNEXPLAINED: "No explanation that was tried passes its tests",
    Verdict.INTERRUPTED: "Interrupted",
}
PERHAPS_NOTHING = "Something may be missing, and these data allow several explanations"
"""Headline of an ambiguous verdict where one of the explanations is that nothing is missing."""
SIDES = {
    "along": "along the string, towards the rod",
    "across": "across the string, the way it loops",
    "heavy": "on the heavy mass, upward",
    "gradient": "the way in which the coordinate grows",
    "friction": "coefficient of friction",
}
"""Direction of a force (`ForceProfile.side`) -> words."""
MAX_VISIBLE = 10
"""Effects in the table of what these data could show."""


def identification_markdown(result: Identification, picture: str = "") -> str:
    """Return the report; ``picture``: Markdown that stands directly below the verdict."""
    title, verdict, *others = before_figures(result)
    return "\n".join([title, verdict, *([picture] if picture else []), *others, *after_figures(result)])


def before_figures(result: Identification) -> list[str]:
    """Return the sections above the figures, the title and the verdict first."""
    headline = HEADLINES[result.verdict]
    if result.verdict is Verdict.AMBIGUOUS and not all(e.names for e in result.credible):
        headline = PERHAPS_NOTHING
    units = sorted({DISPLAY_UNITS[e.unit].name for e in result.errors if e.unit in DISPLAY_UNITS})
    return _sections(
        "verdict.md.jinja", result, headline=headline, steps=next_steps.steps(result), units=", ".join(units) or GAP
    )


def after_figures(result: Identification) -> list[str]:
    """Return the sections below the figures."""
    models = {"declared model": result.before, **({result.other_model: result.after} if result.has_other_model else {})}
    visible = [v for v in result.smallest_visible if not v.can_hide]
    can_hide = sorted(v.name for v in result.smallest_visible if v.can_hide)
    return _sections("details.md.jinja", result, models=models, visible=visible, can_hide=can_hide)


def _sections(template: str, result: Identification, **context: Any) -> list[str]:
    """Return the sections of a template, each with its heading first."""
    return sections(_templates(), template, result=result, force=result.unlisted, **context)


@cache
def _templates() -> Environment:
    environment = markdown_templates("looping_pendulum.discrepancy.report")
    environment.filters |= {
        "depends_on": _depends_on,
        "degrees": math.degrees,
        "event_label": lambda e: quantity_label(e.quantity, e.index),
        "in_words": lambda names: " and ".join(map(in_words, names.split("+"))),
        "interval": _interval,
        "off_by": off_by,
        "probability": _probability,
        "uncertain": uncertain,
        "unit": lambda unit: unit_in_words(unit) or GAP,
    }
    environment.globals |= {
        "BODY_IN_WORDS": BODY_IN_WORDS,
        "MAX_VISIBLE": MAX_VISIBLE,
        "MIN_SEPARATION": MIN_SEPARATION,
        "MISSED_EVENT_ERRORS": MISSED_EVENT_ERRORS,
        "SIDES": SIDES,
        "UNIT_OF_BODY": UNIT_OF_BODY,
    }
    return environment


def _depends_on(e: FittedEffect) -> str:
    """Say on what the size of an effect depends, and along which axis its force acts: "constant, along x"."""
    c = e.candidate
    words = list(c.depends_on) or (["constant"] if c.kind == EffectKind.FORCE.value else [])
    return ", ".join([*words, *([f"along {c.direction}"] if c.direction else [])]) or GAP


def _interval(e: FittedEffect) -> str:
    # To three digits, the ends of an interval about a ratio of 1 would mostly be 1
    return limits_in_words(*e.interval_95, lambda value: number(value, digits=4)) or GAP


def off_by(event: EventObservation, predicted: float | None) -> str:
    """Return measured less predicted in standard errors, in words."""
    return "does not happen" if predicted is None else signed((event.value - predicted) / event.sigma, digits=2)


def probability_in_words(p: float | None) -> str:
    """Return a probability as a percentage; that of what is counted with another explanation as a gap."""
    if p is None:
        return GAP
    return "over 99.9 %" if p > 0.999 else "below 0.1 %" if p < 1e-3 else f"{100 * p:.1f} %"


def _probability(one: RankedExplanation) -> str:
    return probability_in_words(one.probability) + (" (sampled)" if one.checked else "")
