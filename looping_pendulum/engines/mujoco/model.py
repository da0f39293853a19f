"""What the MuJoCo variants share: compiling a model, MuJoCo's warnings of a breakdown, and rows of their studies."""

from __future__ import annotations

from typing import Any

from looping_pendulum.engines.studies import Ladder, Variation, default_row
from looping_pendulum.pages.numbers import quantity
from looping_pendulum.runs.trajectory import SAMPLE_INTERVAL

DEFAULT_TIME_CONSTANT = 0.02
"""Default time constant of MuJoCo's constraints [s]: the first number of `solref` and `solreffriction`."""
AUTORESET = ' autoreset="disable"'
"""Attribute of our models' `flag` that older releases refuse.

Without it MuJoCo goes on from the first state after a breakdown, with a mere warning, which the rigs read.
"""


def compile_model(mujoco: Any, xml: str) -> Any:
    """Return the compiled model of ``xml``; for older releases (`research.releases`) without `AUTORESET`.

    Raises
    ------
    ValueError
        What MuJoCo finds wrong with it.
    """
    try:
        return mujoco.MjModel.from_xml_string(xml)
    except ValueError as error:
        if "attribute: 'autoreset'" not in str(error):
            raise
    return mujoco.MjModel.from_xml_string(xml.replace(AUTORESET, ""))


def breakdown_warnings(mujoco: Any, data: Any) -> list[Any]:
    """Return MuJoCo's warnings of a breakdown: it only counts them, and the numbers that follow look like motion."""
    kinds = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
    return [data.warning[int(kind)] for kind in kinds]


def softness_rungs(setting: str, time_step: float) -> Ladder:
    """Return a ladder of a constraint's time constant at one time step, down to the 2 steps to which MuJoCo raises it."""
    return Ladder(setting, "s", [n * time_step for n in (20.0, 10.0, 5.0, 2.0)])


def time_constant_default(settings: Any, setting: str, name: str, effect: str) -> Variation:
    """Return MuJoCo's default time constant for one kind of constraint as a hidden default."""
    return default_row(settings, setting, DEFAULT_TIME_CONSTANT, name, effect, unit="s")


def solver_defaults(settings: Any, **with_long_step: Any) -> tuple[Variation, ...]:
    """Return MuJoCo's defaults of step, integrator and solver.

    ``with_long_step`` are settings that must change together with the longer default step.
    """
    s = settings
    return (
        Variation(
            "timestep",
            quantity(s.time_step, "s", 3),
            "2 ms (run at 1 ms, where samples fall)",
            {"time_step": SAMPLE_INTERVAL} | with_long_step,
            "length of a step",
        ),
        default_row(s, "integrator", "Euler", "integrator", "how a step is taken"),
        default_row(s, "jacobian", "auto", "jacobian", "sparse or dense algebra: dense below 60 degrees of freedom"),
        default_row(s, "solver_iterations", 100, "iterations", "of the solver, at most"),
        default_row(s, "solver_tolerance", 1e-8, "tolerance", "where the solver stops early"),
    )
