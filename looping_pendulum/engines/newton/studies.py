"""Studies of Newton's tendon: ladders of step and compliance, Newton's defaults one at a time, and the adapter's choices."""

from __future__ import annotations

from typing import Any

from looping_pendulum.engines.newton.settings import NewtonTendonSettings
from looping_pendulum.engines.studies import AdapterChoice, HiddenDefault, Ladder, Studies, WithSettings, ladder
from looping_pendulum.pages.numbers import quantity

TIME_STEPS = (1e-4, 5e-5, 2e-5, 1e-5, 4e-6)
"""Time steps of the ladder [s]."""
COMPLIANCES = (1e-3, 1e-4, 5e-5, 1e-5, 1e-6)
"""Compliances of the ladder, from a soft string to a stiff one [m/N]."""


def tendon_studies(settings: NewtonTendonSettings, with_settings: WithSettings) -> Studies:
    """Return ladders, defaults and choices of the tendon with ``settings``."""
    return Studies(
        ladders=_ladders(with_settings),
        defaults=_defaults(settings, with_settings),
        choices=_choices(settings, with_settings),
    )


def _ladders(with_settings: WithSettings) -> tuple[Ladder, ...]:
    return (
        ladder(with_settings, "time_step", "s", ({"time_step": dt} for dt in TIME_STEPS)),
        ladder(with_settings, "compliance", "m/N", ({"compliance": value} for value in COMPLIANCES)),
    )


def _defaults(s: NewtonTendonSettings, with_settings: WithSettings) -> tuple[HiddenDefault, ...]:
    rows: tuple[tuple[str, str, str, str, dict[str, Any]], ...] = (
        (
            "compliance",
            "0: the string cannot stretch",
            quantity(s.compliance, "m/N", 3),
            "the stretch from which the friction reads the tensions",
            {"compliance": 0.0},
        ),
        (
            "length unit",
            "none; metres are usual",
            quantity(s.length_unit, "m", 3),
            "a mass that is slower than 1e-4 units per second is stopped, at every step",
            {"length_unit": 1.0},
        ),
        ("iterations", "2", f"{s.iterations}", "corrections of the string's length per step", {"iterations": 2}),
        (
            "joint_linear_relaxation",
            "0.7",
            f"{s.relaxation:g}",
            "share of a correction that is made, of the string's length, too",
            {"relaxation": 0.7},
        ),
    )
    return tuple(
        HiddenDefault(setting=name, default=default, ours=ours, effect=effect, engine=with_settings(**changes))
        for name, default, ours, effect, changes in rows
    )


def _choices(s: NewtonTendonSettings, with_settings: WithSettings) -> tuple[AdapterChoice, ...]:
    rows: tuple[tuple[str, str, str, dict[str, Any]], ...] = (
        ("damping", quantity(s.damping, "N s/m", 3), "none", {"damping": 0.0}),
        ("length unit", quantity(s.length_unit, "m", 3), "1 cm", {"length_unit": 1e-2}),
        ("tolerance of the friction", f"{s.settle_tolerance:g}", "1e-05", {"settle_tolerance": 1e-5}),
        ("steps between two updates of drag", f"{s.steps_per_group}", "2", {"steps_per_group": 2}),
    )
    return tuple(
        AdapterChoice(what=what, ours=ours, instead=instead, engine=with_settings(**changes))
        for what, ours, instead, changes in rows
    )
