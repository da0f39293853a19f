"""Studies of the Drake chain: ladders of refinement, Drake's defaults one at a time, and the adapter's choices."""

from __future__ import annotations

from typing import Any

from looping_pendulum.engines.drake.chain_model import DrakeChainSettings
from looping_pendulum.engines.protocol import SAMPLE_INTERVAL
from looping_pendulum.engines.studies import AdapterChoice, HiddenDefault, Ladder, Studies, WithSettings, ladder
from looping_pendulum.pages.numbers import quantity

TIME_STEPS = (5e-5, 2e-5, 1e-5, 5e-6)
"""Time steps of the ladder [s]."""
BENDS = (0.5, 0.4, 0.3, 0.24)
"""Angles between neighbouring links on the rod, of the ladder [rad]."""
BEAD_MASS_RATIOS = (2e-3, 1e-3, 5e-4, 2e-4)
"""Masses of a bead over the light mass, of the ladder."""
CONTACT_STIFFNESSES = (1e4, 2e4, 5e4, 1e5, 2e5)
"""Contact stiffnesses of the ladder [N/m]."""
STICTION_TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5)
"""Stiction tolerances of the ladder [m/s]."""


def chain_studies(settings: DrakeChainSettings, with_settings: WithSettings) -> Studies:
    """Return ladders, defaults and choices of the chain with ``settings``."""
    return Studies(
        ladders=_ladders(settings, with_settings),
        defaults=_defaults(settings, with_settings),
        choices=_choices(settings, with_settings),
    )


def _ladders(s: DrakeChainSettings, with_settings: WithSettings) -> tuple[Ladder, ...]:
    density = s.bead_mass_ratio / s.bend
    bends = ({"bend": bend, "bead_mass_ratio": density * bend} for bend in BENDS)
    follows = "a bead's mass, so that the string's mass per length stays"
    return (
        ladder(with_settings, "time_step", "s", ({"time_step": dt} for dt in TIME_STEPS)),
        ladder(with_settings, "bend", "rad", bends, follows),
        ladder(with_settings, "bead_mass_ratio", "", ({"bead_mass_ratio": ratio} for ratio in BEAD_MASS_RATIOS)),
        ladder(with_settings, "contact_stiffness", "N/m", ({"contact_stiffness": k} for k in CONTACT_STIFFNESSES)),
        ladder(with_settings, "stiction_tolerance", "m/s", ({"stiction_tolerance": v} for v in STICTION_TOLERANCES)),
    )


def _defaults(s: DrakeChainSettings, with_settings: WithSettings) -> tuple[HiddenDefault, ...]:
    rows: tuple[tuple[str, str, str, str, dict[str, Any]], ...] = (
        (
            "time_step",
            "1 ms",
            quantity(s.time_step, "s", 3),
            "length of a step",
            {"time_step": SAMPLE_INTERVAL, "steps_per_group": 1},
        ),
        (
            "discrete_contact_approximation",
            "lagged",
            s.contact_approximation,
            "which convex problem stands for Coulomb's law; lagged takes the friction's bound from the step before",
            {"contact_approximation": "lagged"},
        ),
        (
            "point_stiffness",
            "5e5 N/m (1e6 of either body, in a row)",
            f"{s.contact_stiffness:g} N/m",
            "how far a bead sinks in",
            {"contact_stiffness": 5e5},
        ),
        (
            "hunt_crossley_dissipation",
            "50 s/m",
            f"{s.contact_dissipation:g} s/m",
            "how fast a bead that sinks in or comes off is braked",
            {"contact_dissipation": 50.0},
        ),
    )
    return tuple(
        HiddenDefault(setting=name, default=default, ours=ours, effect=effect, engine=with_settings(**changes))
        for name, default, ours, effect, changes in rows
    )


def _choices(s: DrakeChainSettings, with_settings: WithSettings) -> tuple[AdapterChoice, ...]:
    rows: tuple[tuple[str, str, str, dict[str, Any]], ...] = (
        ("convex approximation of Coulomb's law", s.contact_approximation, "sap", {"contact_approximation": "sap"}),
        ("rod", f"a {s.rod_shape}", "a cylinder", {"rod_shape": "cylinder"}),
        ("radius and coefficient", "corrected for the polygon", "the circle's own", {"polygon": False}),
        ("bead radius", quantity(s.bead_radius, "m", 3), "0.5 mm", {"bead_radius": 5e-4}),
        ("steps between two updates of drag and beads", f"{s.steps_per_group}", "1", {"steps_per_group": 1}),
    )
    return tuple(
        AdapterChoice(what=what, ours=ours, instead=instead, engine=with_settings(**changes))
        for what, ours, instead, changes in rows
    )
