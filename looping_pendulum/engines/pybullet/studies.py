"""Studies of the PyBullet variants: ladders of refinement, PyBullet's defaults one at a time, and the adapter's choices."""

from __future__ import annotations

from typing import Any

from looping_pendulum.engines.protocol import SAMPLE_INTERVAL, Engine
from looping_pendulum.engines.pybullet.settings import (
    DEFAULT_DAMPING,
    DEFAULT_ITERATIONS,
    DEFAULT_NEIGHBOUR_MARGIN,
    DEFAULT_SPEED_LIMIT,
    LARGEST_STEP,
    RodShape,
    WorldSettings,
)
from looping_pendulum.engines.studies import AdapterChoice, HiddenDefault, Ladder, WithSettings, ladder
from looping_pendulum.pages.numbers import quantity

DefaultRow = tuple[str, str, str, str, dict[str, Any]]
"""PyBullet's name of a setting, its default, our value, what it does, and the changes of settings that restore the default."""

STEP_FACTORS = (4, 2, 1, 0.5)
"""Steps of the ladder, over the settings' own step."""
LINK_LENGTHS = (4e-3, 3.5e-3, 3e-3, 2.5e-3, 2e-3)
"""Link lengths of the ladder [m]."""
ITERATIONS = (5, 10, 20, 40, 80)
"""Solver iterations of the ladder."""
BEAD_MASS_RATIOS = (2e-3, 1e-3, 5e-4, 2.5e-4)
"""Masses of a node over the light mass, of the ladder."""


def step_ladder(with_settings: WithSettings, time_step: float) -> Ladder:
    """Return a ladder of time steps."""
    # Whole numbers of steps per sample, and no step below 1 us
    steps = (min(round(SAMPLE_INTERVAL / time_step / n), round(SAMPLE_INTERVAL / 1e-6)) for n in STEP_FACTORS)
    return ladder(with_settings, "time_step", "s", ({"time_step": SAMPLE_INTERVAL / count} for count in steps))


def link_ladder(with_settings: WithSettings, settings: Any) -> Ladder:
    """Return a ladder of link lengths along which the string's mass per length is constant."""
    density = settings.bead_mass_ratio / settings.link_length
    rungs = ({"link_length": h, "bead_mass_ratio": density * h} for h in LINK_LENGTHS)
    return ladder(with_settings, "link_length", "m", rungs, "a node's mass, so that the string's mass per length stays")


def iteration_ladder(with_settings: WithSettings, ours: int) -> Ladder:
    """Return a ladder of solver iterations that includes the settings' own number."""
    counts = sorted({*ITERATIONS, ours})
    return ladder(with_settings, "solver_iterations", "", ({"solver_iterations": n} for n in counts))


def world_defaults(with_settings: WithSettings, settings: WorldSettings) -> tuple[HiddenDefault, ...]:
    """Return PyBullet's defaults that concern every variant and differ from ``settings``."""
    s = settings
    rows: tuple[DefaultRow, ...] = (
        (
            "fixedTimeStep",
            "1/240 s (run at 1 ms, where samples fall)",
            quantity(s.time_step, "s", 3),
            "length of a step",
            {"time_step": LARGEST_STEP},
        ),
        (
            "numSolverIterations",
            f"{DEFAULT_ITERATIONS}",
            f"{s.solver_iterations}",
            "sweeps of the solver",
            {"solver_iterations": DEFAULT_ITERATIONS},
        ),
        (
            "linearDamping",
            f"{DEFAULT_DAMPING:g} /s",
            f"{s.linear_damping:g}",
            "share of a velocity lost per second",
            {"linear_damping": DEFAULT_DAMPING},
        ),
        (
            "angularDamping",
            f"{DEFAULT_DAMPING:g} /s",
            f"{s.angular_damping:g}",
            "share of an angular velocity lost per second",
            {"angular_damping": DEFAULT_DAMPING},
        ),
        (
            "contactBreakingThreshold",
            f"{1e3 * DEFAULT_NEIGHBOUR_MARGIN:g} mm",
            f"{1e3 * s.neighbour_margin:g} mm",
            "how large the boxes are that find neighbours; the sweep's order with them",
            {"neighbour_margin": DEFAULT_NEIGHBOUR_MARGIN},
        ),
        (
            "rod",
            "GEOM_CYLINDER, the obvious shape",
            "GEOM_SPHERE",
            "which collision algorithm finds the contacts",
            {"rod": RodShape.CYLINDER},
        ),
    )
    return _changed_defaults(with_settings, settings, rows)


def multibody_defaults(with_settings: WithSettings, settings: WorldSettings) -> tuple[HiddenDefault, ...]:
    """Return PyBullet's defaults that concern multibodies only and differ from ``settings``."""
    rows: tuple[DefaultRow, ...] = (
        (
            "maxJointVelocity",
            f"{DEFAULT_SPEED_LIMIT:g} m/s or rad/s",
            f"{settings.speed_limit:g}",
            "clamp of every joint's speed",
            {"speed_limit": DEFAULT_SPEED_LIMIT},
        ),
        ("joint motors", "on, holding every joint at rest", "off", "friction in every hinge", {"joint_motors": True}),
        (
            "friction given together with damping",
            "ignored: 0.5 stays",
            "given apart",
            "the contact coefficient",
            {"friction_with_damping": True},
        ),
    )
    return _changed_defaults(with_settings, settings, rows)


def _changed_defaults(
    with_settings: WithSettings, settings: WorldSettings, rows: tuple[DefaultRow, ...]
) -> tuple[HiddenDefault, ...]:
    """Return the defaults among ``rows`` that differ from the settings' own values."""
    return tuple(
        HiddenDefault(setting=name, default=default, ours=ours, effect=effect, engine=with_settings(**changes))
        for name, default, ours, effect, changes in rows
        if any(getattr(settings, field) != value for field, value in changes.items())
    )


def choice(what: str, ours: str, instead: str, engine: Engine) -> AdapterChoice:
    """Return a choice of the adapter, with the engine that takes the alternative ``instead``."""
    return AdapterChoice(what=what, ours=ours, instead=instead, engine=engine)


def common_choices(with_settings: WithSettings, settings: WorldSettings) -> tuple[AdapterChoice, ...]:
    """Return what an adapter of a chain decides: corrections for corners, the contact, how often forces are updated."""
    s = settings
    return (
        choice("radius and coefficient", "corrected for the corners", "the circle's own", with_settings(polygon=False)),
        choice("node radius", quantity(s.node_radius, "m", 3), "1 mm", with_settings(node_radius=1e-3)),
        choice("steps between two updates of the forces", f"{s.force_interval}", "1", with_settings(force_interval=1)),
        choice(
            "share of a penetration taken back in a step",
            f"{s.contact_error_reduction:g}",
            "0.02",
            with_settings(contact_error_reduction=0.02),
        ),
    )
