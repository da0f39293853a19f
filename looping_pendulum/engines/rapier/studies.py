"""Studies of the Rapier chain: ladders of refinement, Rapier's defaults one at a time, and the adapter's choices."""

from __future__ import annotations

from typing import Any

from looping_pendulum.engines.protocol import SAMPLE_INTERVAL
from looping_pendulum.engines.rapier.settings import RapierChainSettings
from looping_pendulum.engines.studies import AdapterChoice, HiddenDefault, Ladder, Studies, WithSettings, ladder
from looping_pendulum.pages.numbers import quantity

TIME_STEPS = (4e-5, 2e-5, 1e-5, 5e-6)
"""Time steps of the ladder [s]."""
ITERATIONS = (8, 16, 32, 64)
"""Numbers of iterations of the ladder."""
BENDS = (0.4, 0.28, 0.2, 0.14)
"""Angles between neighbouring links on the rod, of the ladder [rad]."""
BEAD_MASS_RATIOS = (4e-4, 2e-4, 1e-4, 5e-5)
"""Masses of a bead over the light mass, of the ladder."""


def chain_studies(settings: RapierChainSettings, with_settings: WithSettings) -> Studies:
    """Return ladders, defaults and choices of the chain with ``settings``."""
    return Studies(
        ladders=_ladders(settings, with_settings),
        defaults=_defaults(settings, with_settings),
        choices=_choices(settings, with_settings),
    )


def _ladders(s: RapierChainSettings, with_settings: WithSettings) -> tuple[Ladder, ...]:
    density = s.bead_mass_ratio / s.bend
    bends = ({"bend": bend, "bead_mass_ratio": density * bend} for bend in BENDS)
    return (
        ladder(with_settings, "time_step", "s", ({"time_step": step} for step in TIME_STEPS)),
        ladder(with_settings, "iterations", "", ({"iterations": count} for count in ITERATIONS)),
        ladder(with_settings, "bend", "rad", bends, "a bead's mass, so that the string's mass per length stays"),
        ladder(with_settings, "bead_mass_ratio", "", ({"bead_mass_ratio": ratio} for ratio in BEAD_MASS_RATIOS)),
    )


def _defaults(s: RapierChainSettings, with_settings: WithSettings) -> tuple[HiddenDefault, ...]:
    rows: tuple[tuple[str, str, str, str, dict[str, Any]], ...] = (
        (
            "dt",
            "1/60 s; 1 ms, the sample interval, is as long as a step may be here",
            quantity(s.time_step, "s", 3),
            "length of a step, during which a contact keeps its direction",
            {"time_step": SAMPLE_INTERVAL, "steps_per_group": 1},
        ),
        (
            "num_internal_pgs_iterations",
            "1",
            f"{s.iterations}",
            "how often joints and contacts are solved in a sub-step; joints begin each time without a force",
            {"iterations": 1},
        ),
        (
            "num_solver_iterations",
            "4",
            f"{s.sub_steps}",
            "number of sub-steps in a step",
            {"sub_steps": 4},
        ),
        (
            "static_contact_softness",
            "60 Hz",
            f"{1e-6 * s.contact_hertz:g} MHz, as for joints",
            "how stiff contacts with fixed bodies are",
            {"contact_hertz": 60.0},
        ),
        (
            "friction_in_bias_pass",
            "off",
            "on",
            "whether friction is solved before places move, too; without it a held string creeps twice as far",
            {"friction_in_bias_pass": False},
        ),
        (
            "contact_recycling",
            "on",
            "off",
            "a contact keeps its direction until its bodies have moved by 0.05 length units",
            {"contact_recycling": True},
        ),
        (
            "can_sleep",
            "on",
            "off",
            "bodies below 0.05 length units per second are stopped after 0.5 s",
            {"sleeping": True},
        ),
    )
    return tuple(
        HiddenDefault(setting=name, default=default, ours=ours, effect=effect, engine=with_settings(**changes))
        for name, default, ours, effect, changes in rows
    )


def _choices(s: RapierChainSettings, with_settings: WithSettings) -> tuple[AdapterChoice, ...]:
    rows: tuple[tuple[str, str, str, dict[str, Any]], ...] = (
        ("bead mass", f"{s.bead_mass_ratio:g} M1", "double", {"bead_mass_ratio": 2 * s.bead_mass_ratio}),
        ("plane of motion", "kept, as nothing pushes out of it", "axis z locked", {"locked_plane": True}),
        ("contact friction", "corrected for the corners", "mu itself", {"polygon_friction": False}),
        ("circle of the beads", "corrected for the corners", "R itself", {"polygon_radius": False}),
        ("bead radius", quantity(s.bead_radius, "m", 3), "0.5 mm", {"bead_radius": 5e-4}),
        ("contact frequency", f"{1e-6 * s.contact_hertz:g} MHz", "10 kHz", {"contact_hertz": 1e4}),
        ("steps between two updates of drag and beads", f"{s.steps_per_group}", "1", {"steps_per_group": 1}),
    )
    return tuple(
        AdapterChoice(what=what, ours=ours, instead=instead, engine=with_settings(**changes))
        for what, ours, instead, changes in rows
    )
