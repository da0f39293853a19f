"""Studies of the Box2D chain: ladders of refinement, Box2D's defaults one at a time, and the adapter's choices."""

from __future__ import annotations

from typing import Any

from looping_pendulum.engines.box2d.settings import Box2dChainSettings
from looping_pendulum.engines.protocol import SAMPLE_INTERVAL
from looping_pendulum.engines.studies import AdapterChoice, HiddenDefault, Ladder, Studies, WithSettings, ladder
from looping_pendulum.pages.numbers import quantity

TIME_STEPS = (4e-5, 2e-5, 1e-5, 5e-6)
"""Time steps of the ladder [s]."""
SUB_STEPS = (2, 4, 8, 16)
"""Numbers of sub-steps of the ladder."""
BENDS = (0.4, 0.28, 0.2, 0.14)
"""Angles between neighbouring links on the rod, of the ladder [rad]."""
BEAD_MASS_RATIOS = (8e-4, 4e-4, 2e-4, 1e-4)
"""Masses of a bead over the light mass, of the ladder."""


def chain_studies(settings: Box2dChainSettings, with_settings: WithSettings) -> Studies:
    """Return ladders, defaults and choices of the chain with ``settings``."""
    return Studies(
        ladders=_ladders(settings, with_settings),
        defaults=_defaults(settings, with_settings),
        choices=_choices(settings, with_settings),
    )


def _ladders(s: Box2dChainSettings, with_settings: WithSettings) -> tuple[Ladder, ...]:
    sub_step = s.time_step / s.sub_steps
    steps = ({"time_step": dt, "sub_steps": max(round(dt / sub_step), 1)} for dt in TIME_STEPS)
    density = s.bead_mass_ratio / s.bend
    bends = ({"bend": bend, "bead_mass_ratio": density * bend} for bend in BENDS)
    return (
        ladder(with_settings, "time_step", "s", steps, "the number of sub-steps, so that their length stays"),
        ladder(with_settings, "sub_steps", "", ({"sub_steps": count} for count in SUB_STEPS)),
        ladder(with_settings, "bend", "rad", bends, "a bead's mass, so that the string's mass per length stays"),
        ladder(with_settings, "bead_mass_ratio", "", ({"bead_mass_ratio": ratio} for ratio in BEAD_MASS_RATIOS)),
    )


def _defaults(s: Box2dChainSettings, with_settings: WithSettings) -> tuple[HiddenDefault, ...]:
    rows: tuple[tuple[str, str, str, str, dict[str, Any]], ...] = (
        (
            "timeStep",
            "none; 1 ms is finer than the 1/60 s of its guides",
            quantity(s.time_step, "s", 3),
            "length of a step, during which a contact keeps its direction",
            {"time_step": SAMPLE_INTERVAL, "steps_per_group": 1},
        ),
        (
            "jointHertz",
            "60 Hz",
            f"{60e-3 / s.time_unit:g} kHz, by units of {quantity(s.time_unit, 's', 3)}; an eighth of the sub-steps' if less",
            "how stiff joints are; pyb2d3 gives no access to it",
            {"time_unit": 1.0},
        ),
        (
            "contactHertz",
            "30 Hz",
            "a quarter of the sub-steps' frequency",
            "how stiff contacts are",
            {"contact_hertz": 30.0},
        ),
        (
            "lengthUnitsPerMeter",
            "1: no joint is shorter than 5 mm",
            f"units of {quantity(s.length_unit, 'm', 3)}",
            "the length of which the shortest joint is 0.005",
            {"length_unit": 1.0},
        ),
        (
            "enableSleep",
            "on",
            "off",
            "bodies below 0.05 length units per time unit are stopped after 0.5 time units",
            {"sleeping": True},
        ),
        (
            "enableContinuous",
            "on",
            "off",
            "beads that would pass into the rod within a step are stopped at its surface",
            {"continuous": True},
        ),
    )
    return tuple(
        HiddenDefault(setting=name, default=default, ours=ours, effect=effect, engine=with_settings(**changes))
        for name, default, ours, effect, changes in rows
    )


def _choices(s: Box2dChainSettings, with_settings: WithSettings) -> tuple[AdapterChoice, ...]:
    rows: tuple[tuple[str, str, str, dict[str, Any]], ...] = (
        ("bead mass", f"{s.bead_mass_ratio:g} M1", "half", {"bead_mass_ratio": s.bead_mass_ratio / 2}),
        ("length unit", quantity(s.length_unit, "m", 3), "1 mm", {"length_unit": 1e-3}),
        ("contact friction", "corrected for the corners", "mu itself", {"polygon_friction": False}),
        ("circle of the beads", "corrected for the corners", "R itself", {"polygon_radius": False}),
        ("bead radius", quantity(s.bead_radius, "m", 3), "0.5 mm", {"bead_radius": 5e-4}),
        ("contact damping ratio", f"{s.contact_damping_ratio:g}", "1", {"contact_damping_ratio": 1.0}),
        ("steps between two updates of drag and beads", f"{s.steps_per_group}", "1", {"steps_per_group": 1}),
    )
    return tuple(
        AdapterChoice(what=what, ours=ours, instead=instead, engine=with_settings(**changes))
        for what, ours, instead, changes in rows
    )
