"""What can be varied of each PyBullet variant: ladders of refinement, PyBullet's defaults one at a time."""

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
from looping_pendulum.engines.studies import AdapterChoice, Adjusted, HiddenDefault, Ladder, ladder
from looping_pendulum.pages.numbers import quantity

Row = tuple[str, str, str, str, dict[str, Any]]
"""PyBullet's name, its value, ours, what it does, and the changes that set it."""

REFINEMENTS = (4, 2, 1, 0.5)
"""Of a step, over the settings' own."""
LINK_LENGTHS = (4e-3, 3.5e-3, 3e-3, 2.5e-3, 2e-3)
"""[m]"""
ITERATIONS = (5, 10, 20, 40, 80)
BEAD_MASSES = (2e-3, 1e-3, 5e-4, 2.5e-4)


def step_ladder(adjusted: Adjusted, time_step: float) -> Ladder:
    """Make a ladder of time steps."""
    steps = (min(round(SAMPLE_INTERVAL / time_step / n), round(SAMPLE_INTERVAL / 1e-6)) for n in REFINEMENTS)
    return ladder(adjusted, "time_step", "s", ({"time_step": SAMPLE_INTERVAL / count} for count in steps))


def link_ladder(adjusted: Adjusted, settings: Any) -> Ladder:
    """Make a ladder of link lengths, along which the string's mass per length stays."""
    density = settings.bead_mass_ratio / settings.link_length
    rungs = ({"link_length": h, "bead_mass_ratio": density * h} for h in LINK_LENGTHS)
    return ladder(adjusted, "link_length", "m", rungs, "a node's mass, so that the string's mass per length stays")


def iteration_ladder(adjusted: Adjusted, ours: int) -> Ladder:
    """Make a ladder of the solver's sweeps, the settings' own among them."""
    counts = sorted({*ITERATIONS, ours})
    return ladder(adjusted, "solver_iterations", "", ({"solver_iterations": n} for n in counts))


def world_defaults(adjusted: Adjusted, settings: WorldSettings) -> tuple[HiddenDefault, ...]:
    """PyBullet's defaults that every variant meets."""
    s = settings
    rows: tuple[Row, ...] = (
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
    return _different(adjusted, settings, rows)


def multibody_defaults(adjusted: Adjusted, settings: WorldSettings) -> tuple[HiddenDefault, ...]:
    """PyBullet's defaults that only multibodies meet."""
    rows: tuple[Row, ...] = (
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
    return _different(adjusted, settings, rows)


def _different(adjusted: Adjusted, settings: WorldSettings, rows: tuple[Row, ...]) -> tuple[HiddenDefault, ...]:
    """Those of ``rows`` in which PyBullet's default is not the settings' own."""
    return tuple(
        HiddenDefault(setting=name, default=default, ours=ours, effect=effect, engine=adjusted(**changes))
        for name, default, ours, effect, changes in rows
        if any(getattr(settings, field) != value for field, value in changes.items())
    )


def choice(what: str, ours: str, instead: str, engine: Engine) -> AdapterChoice:
    """Something that could be decided otherwise."""
    return AdapterChoice(what=what, ours=ours, instead=instead, engine=engine)


def common_choices(adjusted: Adjusted, settings: WorldSettings) -> tuple[AdapterChoice, ...]:
    """Return what an adapter of a chain decides: corrections for corners, the contact, how often forces are updated."""
    s = settings
    return (
        choice("radius and coefficient", "corrected for the corners", "the circle's own", adjusted(polygon=False)),
        choice("node radius", quantity(s.node_radius, "m", 3), "1 mm", adjusted(node_radius=1e-3)),
        choice("steps between two updates of the forces", f"{s.force_interval}", "1", adjusted(force_interval=1)),
        choice(
            "share of a penetration taken back in a step",
            f"{s.contact_error_reduction:g}",
            "0.02",
            adjusted(contact_error_reduction=0.02),
        ),
    )
