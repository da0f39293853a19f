"""Studies of the MuJoCo variants: ladders of refinement, MuJoCo's defaults one at a time, the adapter's choices."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from looping_pendulum.engines.protocol import SAMPLE_INTERVAL, Engine
from looping_pendulum.engines.studies import AdapterChoice, HiddenDefault, Ladder, WithSettings, ladder
from looping_pendulum.pages.numbers import quantity

DEFAULT_TIME_CONSTANT = 0.02
"""Default time constant of MuJoCo's constraints [s]: the first number of `solref` and `solreffriction`."""
TENDON_STEPS = (1e-3, 5e-4, 2e-4, 1e-4, 5e-5, 2e-5)
"""Time steps of the tendon variants [s]."""
BEAD_STEPS = (2e-5, 1e-5, 5e-6, 2.5e-6, 1.25e-6)
"""Time steps of the bead chain [s]."""
TIME_CONSTANTS = (20.0, 10.0, 5.0, 2.0)
"""Time constants of constraints, in time steps; MuJoCo raises those below 2 to 2."""
BENDS = (0.4, 0.32, 0.28, 0.24, 0.2)
"""Angles between neighbouring links on the rod [rad]."""
BEAD_MASSES = (8e-4, 4e-4, 2e-4, 1e-4, 5e-5)
"""Masses of a bead over the light mass."""


def step_ladder(
    with_settings: WithSettings, steps: Iterable[float], time_constants: tuple[str, ...], steps_stiff: int = 2
) -> Ladder:
    """Return a ladder of time steps, along which the settings ``time_constants`` stay ``steps_stiff`` steps."""
    rungs = ({"time_step": dt} | {name: steps_stiff * dt for name in time_constants} for dt in steps)
    follows = f"the constraints' time constants stay {steps_stiff} steps" if time_constants else ""
    return ladder(with_settings, "time_step", "s", rungs, follows)


def softness_ladder(with_settings: WithSettings, setting: str, time_step: float) -> Ladder:
    """Return a ladder of a constraint's time constant at one time step."""
    return ladder(with_settings, setting, "s", ({setting: n * time_step} for n in TIME_CONSTANTS))


def time_constant_default(with_settings: WithSettings, setting: str, ours: float, name: str, effect: str) -> HiddenDefault:
    """Return MuJoCo's default time constant for one kind of constraint as a hidden default."""
    return HiddenDefault(
        setting=name,
        default=quantity(DEFAULT_TIME_CONSTANT, "s", 3),
        ours=quantity(ours, "s", 3),
        effect=effect,
        engine=with_settings(**{setting: DEFAULT_TIME_CONSTANT}),
    )


def string_defaults(with_settings: WithSettings, settings: Any) -> tuple[HiddenDefault, ...]:
    """Return MuJoCo's defaults that matter in every variant whose string is one constraint."""
    s = settings
    return (
        time_constant_default(
            with_settings,
            "string_time_constant",
            s.string_time_constant,
            "solref",
            "how fast a stretched string returns to its length",
        ),
        HiddenDefault(
            setting="solimp",
            default="0.9 to 0.95 within 1 mm",
            ours=f"{s.least_impedance:g} to {s.impedance:g}",
            effect="share of a constraint that is enforced; the rest gives way",
            engine=with_settings(least_impedance=0.9, impedance=0.95),
        ),
        *solver_defaults(with_settings, s),
    )


def solver_defaults(with_settings: WithSettings, settings: Any, **with_long_step: Any) -> tuple[HiddenDefault, ...]:
    """Return MuJoCo's defaults of step, integrator and solver.

    ``with_long_step`` are settings that must change together with the longer default step.
    """
    s = settings
    long_step = {"time_step": SAMPLE_INTERVAL} | with_long_step
    rows = (
        (
            "timestep",
            "2 ms (run at 1 ms, where samples fall)",
            quantity(s.time_step, "s", 3),
            "length of a step",
            long_step,
        ),
        ("integrator", "Euler", s.integrator, "how a step is taken", {"integrator": "Euler"}),
        ("jacobian", "auto", s.jacobian, "sparse or dense algebra: dense below 60 degrees of freedom", {"jacobian": "auto"}),
        ("iterations", "100", f"{s.solver_iterations}", "of the solver, at most", {"solver_iterations": 100}),
        ("tolerance", "1e-8", f"{s.solver_tolerance:g}", "where the solver stops early", {"solver_tolerance": 1e-8}),
    )
    return tuple(
        HiddenDefault(setting=name, default=default, ours=ours, effect=effect, engine=with_settings(**changes))
        for name, default, ours, effect, changes in rows
    )


def choice(what: str, ours: str, instead: str, engine: Engine) -> AdapterChoice:
    """Return an `AdapterChoice`."""
    return AdapterChoice(what=what, ours=ours, instead=instead, engine=engine)
