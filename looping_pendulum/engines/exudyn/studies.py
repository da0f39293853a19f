"""Studies of Exudyn's variants: ladders of refinement, Exudyn's defaults one at a time, and the adapter's choices."""

from __future__ import annotations

from typing import Any

from looping_pendulum.engines.exudyn.settings import CableSettings, ReevingSettings
from looping_pendulum.engines.studies import AdapterChoice, HiddenDefault, Ladder, Studies, WithSettings, ladder
from looping_pendulum.pages.numbers import quantity

CABLE_TIME_STEPS = (5e-4, 2e-4, 1e-4, 5e-5)
"""Time steps of the cable's ladder [s]."""
BENDS = (0.64, 0.45, 0.32, 0.22)
"""Angles that an element spans on the rod, of the ladder [rad]."""
CONTACT_STIFFNESSES = (2.5e3, 5e3, 1e4, 2e4)
"""Stiffnesses of the contact of a segment, of the ladder [N/m]."""
FRICTION_STIFFNESSES = (7.5e2, 1.5e3, 3e3, 6e3)
"""Stiffnesses of a sticking segment, of the ladder [N/m]."""
AXIAL_STIFFNESSES = (2.5e2, 5e2, 1e3, 2e3)
"""Stiffnesses of the string, of the ladder [N]."""
VELOCITY_PENALTY = 1.0
"""Friction per sliding speed without sticking [N s/m], with which a segment that carries 50 mN creeps at 17 mm/s."""
REEVING_TIME_STEPS = (5e-4, 2e-4, 1e-4, 5e-5)
"""Time steps of the rope's ladder [s]."""
ROPE_STIFFNESSES = (2.5e3, 5e3, 1e4, 2e4)
"""Stiffnesses of the rope, of the ladder [N]."""
PUSH = 0.1
"""Exudyn's default of the force with which a slack rope may push [N]."""


def cable_studies(settings: CableSettings, with_settings: WithSettings) -> Studies:
    """Return ladders, defaults and choices of the cable with ``settings``."""
    s = settings
    return Studies(
        ladders=_cable_ladders(s, with_settings),
        defaults=_defaults(
            with_settings,
            (
                "spectralRadius",
                "0.9",
                f"{s.spectral_radius:g}",
                "how little fast oscillations are damped",
                {"spectral_radius": 0.9},
            ),
            (
                "useModifiedNewton",
                "on",
                "off",
                "the Jacobian is kept from step to step, which contacts that open and close make wrong",
                {"modified_newton": True},
            ),
            (
                "discontinuous.iterationTolerance",
                "1 N",
                quantity(s.contact_tolerance, "N", 3),
                "the error of a contact's force that a step is accepted with: one that begins to slide is held too hard",
                {"contact_tolerance": 1.0},
            ),
            (
                "useReducedOrderIntegration",
                "0",
                f"{s.integration}",
                "elements that bend must stretch, so that they resist bending round the rod",
                {"integration": 0},
            ),
            (
                "frictionStiffness",
                "0; without a velocity penalty, 0 by default too, there is no friction",
                quantity(s.friction_stiffness, "N/m", 3),
                f"nothing sticks; with a velocity penalty of {VELOCITY_PENALTY:g} N s/m it creeps",
                {"friction_stiffness": 0.0, "friction_velocity_penalty": VELOCITY_PENALTY},
            ),
        ),
        choices=_choices(
            with_settings,
            (
                "bending stiffness",
                quantity(s.bending_stiffness, "N m^2", 3),
                "double",
                {"bending_stiffness": 2 * s.bending_stiffness},
            ),
            ("string mass", f"{100 * s.mass_fraction:g} % of M1", "half", {"mass_fraction": s.mass_fraction / 2}),
            ("initial tension", quantity(s.initial_tension, "N", 3), "half", {"initial_tension": s.initial_tension / 2}),
            ("axial damping", quantity(s.axial_damping, "N s", 3), "half", {"axial_damping": s.axial_damping / 2}),
            ("rod's radius and friction", "corrected for the segments", "as they are", {"polygon": False}),
        ),
    )


def reeving_studies(settings: ReevingSettings, with_settings: WithSettings) -> Studies:
    """Return ladders, defaults and choices of the reeving system with ``settings``."""
    s = settings
    steps = ({"time_step": dt} for dt in REEVING_TIME_STEPS)
    stiffnesses = ({"axial_stiffness": ea} for ea in ROPE_STIFFNESSES)
    return Studies(
        ladders=(ladder(with_settings, "time_step", "s", steps), ladder(with_settings, "axial_stiffness", "N", stiffnesses)),
        defaults=_defaults(
            with_settings,
            (
                "spectralRadius",
                "0.9",
                f"{s.spectral_radius:g}",
                "how little fast oscillations are damped",
                {"spectral_radius": 0.9},
            ),
            (
                "regularizationForce",
                quantity(PUSH, "N", 3),
                quantity(s.push_force, "N", 3),
                "the force with which a slack rope pushes",
                {"push_force": PUSH},
            ),
        ),
        choices=_choices(
            with_settings,
            ("rope damping", quantity(s.axial_damping, "N s", 3), "half", {"axial_damping": s.axial_damping / 2}),
        ),
    )


def _cable_ladders(s: CableSettings, with_settings: WithSettings) -> tuple[Ladder, ...]:
    segment = s.bend / s.segments
    bends = ({"bend": bend, "segments": max(round(bend / segment), 1)} for bend in BENDS)
    contacts = ({"contact_stiffness": k} for k in CONTACT_STIFFNESSES)
    frictions = ({"friction_stiffness": k} for k in FRICTION_STIFFNESSES)
    damping_time = s.axial_damping / s.axial_stiffness
    axial = ({"axial_stiffness": ea, "axial_damping": damping_time * ea} for ea in AXIAL_STIFFNESSES)
    return (
        ladder(with_settings, "time_step", "s", ({"time_step": dt} for dt in CABLE_TIME_STEPS)),
        ladder(with_settings, "bend", "rad", bends, "the number of segments of an element, so that their length stays about"),
        ladder(with_settings, "contact_stiffness", "N/m", contacts),
        ladder(with_settings, "friction_stiffness", "N/m", frictions),
        ladder(with_settings, "axial_stiffness", "N", axial, "the string's damping, so that its damping time stays"),
    )


def _defaults(with_settings: WithSettings, *rows: tuple[str, str, str, str, dict[str, Any]]) -> tuple[HiddenDefault, ...]:
    return tuple(
        HiddenDefault(setting=name, default=default, ours=ours, effect=effect, engine=with_settings(**changes))
        for name, default, ours, effect, changes in rows
    )


def _choices(with_settings: WithSettings, *rows: tuple[str, str, str, dict[str, Any]]) -> tuple[AdapterChoice, ...]:
    return tuple(
        AdapterChoice(what=what, ours=ours, instead=instead, engine=with_settings(**changes))
        for what, ours, instead, changes in rows
    )
