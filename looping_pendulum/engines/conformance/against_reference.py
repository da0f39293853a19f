"""Checks against the reference: whole runs, the convergence of an engine, and every effect that it declares to support."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from looping_pendulum.engines.conformance.apparatus import (
    LOSSLESS,
    LOSSLESS_DURATION,
    LOSSY,
    REQUIREMENTS,
    Check,
    Requirements,
    lossless_run,
    lossy_run,
    requires,
    run_without_effect,
    scenario,
)
from looping_pendulum.engines.protocol import Engine
from looping_pendulum.engines.studies import Ladder
from looping_pendulum.engines.trajectory import Trajectory
from looping_pendulum.reference_ode.effects import EFFECTS
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.reference_ode.solve import solve_at

TOLERANCE = 1e-10
"""Relative tolerance of a step of the reference."""
EXTRA_TIME = 0.1
"""Time by which the reference runs on after the last sample [s], so that it has that sample."""

PATH_TOLERANCE = 0.01
"""Largest deviation of either mass as a fraction of the path that it has travelled.

The reference itself moves by that much if a mass or the friction changes by 1 to 3 %.
"""
NODE_RIPPLE = 5e-4
"""Deviation allowed in addition [m], because a chain's nodes reach and leave the rod one by one."""

SAFETY = 3.0
"""Roache's safety factor on an error that is estimated from two rungs of a ladder."""
IGNORED_ERROR = 1e-5
"""Deviation that is always allowed, however little refinement changes [m]: a tenth of what a camera resolves."""

EFFECT_TOLERANCE = 0.1
"""Largest relative error of an effect's displacement; a wrong sign, axis, mass or factor of 2 gives at least 0.5.

The engine's own error is the same with and without the effect, so it cancels in the difference.
"""
MIN_DISPLACEMENT = 5e-4
"""Smallest displacement of a mass that the effect must cause in its check [m], so that the check can detect its absence."""


_cached_runs: deque[tuple[Parameters, Array, Array]] = deque(maxlen=64)
"""Parameters, times and positions of the reference's last runs; every engine is compared with the same few."""


def reference_positions(p: Parameters, t: Array) -> Array:
    """Return light x, light y and heavy y of the reference at times ``t`` [s], shape (n, 3) [m]; fewer if it ends sooner."""
    # A search, because parameters and arrays cannot be hashed
    for cached, times, reference in _cached_runs:
        if np.array_equal(times, t) and cached == p:
            return reference
    run = solve_at(p, t, duration=float(t[-1]) + EXTRA_TIME, tolerance=TOLERANCE, integrator="scipy")
    reference = np.column_stack([run.light_position, run.heavy_position[:, 1]])
    reference.flags.writeable = False  # the next caller gets the same array
    _cached_runs.append((p, t.copy(), reference))
    return reference


def positions(run: Trajectory) -> Array:
    """Return light x, light y and heavy y of a run, shape (n, 3) [m]."""
    return np.column_stack([run.light_position, run.heavy_position[:, 1]])


@requires(LOSSLESS)
def follows_the_reference_without_losses(engine: Engine) -> None:
    """Both masses are at the reference's positions, within `PATH_TOLERANCE` and `NODE_RIPPLE`."""
    _assert_follows_reference(lossless_run(engine), LOSSLESS)


@requires(LOSSY)
def follows_the_reference_past_the_halt_and_a_full_turn(engine: Engine) -> None:
    """With friction and drag, too, both masses follow the reference, until long after the halt and with string on string."""
    _assert_follows_reference(lossy_run(engine), LOSSY)


def _assert_follows_reference(run: Trajectory, p: Parameters) -> None:
    reference = reference_positions(p, run.t)
    engine = positions(run)[: len(reference)]
    for mass, columns in (("light", slice(0, 2)), ("heavy", slice(2, 3))):
        deviation = np.linalg.norm(engine[:, columns] - reference[:, columns], axis=1)
        steps = np.linalg.norm(np.diff(reference[:, columns], axis=0), axis=1)
        bound = NODE_RIPPLE + PATH_TOLERANCE * np.concatenate([[0.0], np.cumsum(steps)])
        i = int(np.argmax(deviation - bound))
        assert deviation[i] <= bound[i], (
            f"{mass} mass {1e3 * deviation[i]:.2f} mm off at {run.t[i]:.3f} s, needed {1e3 * bound[i]:.2f} mm"
        )


def error_is_covered_by_refinement(engine: Engine) -> None:
    """The error estimated from an engine's ladders (`studies()`) covers its deviation from the reference.

    The change from the variant's own value to the next finer one gives the error of a first-order method (that of a higher
    order is smaller). The ladders are assumed to act independently, so their errors add up.
    """
    run = lossless_run(engine)
    own = positions(run)
    error = np.zeros(len(own))
    for ladder in usable_ladders(engine):
        ratio, neighbour = _adjacent_rung(engine, ladder)
        other = positions(neighbour.simulate(scenario(LOSSLESS, LOSSLESS_DURATION)))
        assert len(other) == len(own), f"{ladder.setting}: a rung's run ends at {1e-3 * len(other):.3f} s"
        change = np.linalg.norm(other - own, axis=1)
        error += change / abs(1 - ratio)
    deviation = np.linalg.norm(own - reference_positions(LOSSLESS, run.t), axis=1)
    # The largest estimate so far: where the paths of two rungs cross, their difference says nothing about the error
    bound = IGNORED_ERROR + SAFETY * np.maximum.accumulate(error)
    i = int(np.argmax(deviation / bound))
    assert deviation[i] <= bound[i], (
        f"{1e3 * deviation[i]:.4f} mm off at {run.t[i]:.3f} s, where refinement predicts {1e3 * bound[i]:.4f} mm at most"
    )


REQUIREMENTS[error_is_covered_by_refinement] = Requirements(parameters=(LOSSLESS,), ladders=True)


def usable_ladders(engine: Engine) -> list[Ladder]:
    """Return the ladders of at least two rungs whose setting has a positive value in the engine's settings."""
    return [ladder for ladder in engine.studies().ladders if len(ladder.values) > 1 and _own_value(engine, ladder) > 0]


def _own_value(engine: Engine, ladder: Ladder) -> float:
    """Return the engine's value of the ladder's setting; NaN if it has none that is a number."""
    value = getattr(engine.settings, ladder.setting, None)
    return float(value) if isinstance(value, (int, float)) else math.nan


def _adjacent_rung(engine: Engine, ladder: Ladder) -> tuple[float, Engine]:
    """Return the engine of the next finer rung, else of the next coarser one, and its step size relative to the own one."""
    # A setting such as a number of iterations is finer where it is larger.
    grows = ladder.values[-1] > ladder.values[0]
    own = _own_value(engine, ladder)
    ratios = [own / value if grows else value / own for value in ladder.values]
    finer = [i for i, ratio in enumerate(ratios) if ratio < 1 - 1e-9]
    coarser = [i for i, ratio in enumerate(ratios) if ratio > 1 + 1e-9]
    i = finer[0] if finer else coarser[-1]
    return ratios[i], ladder.engines[i]


@dataclass(frozen=True, kw_only=True)
class EffectCase:
    """Two runs that differ only in the coefficients of one effect, chosen so that its influence is visible."""

    coefficients: Mapping[str, float]
    """Coefficients of the effect."""
    common_coefficients: Mapping[str, float] = field(default_factory=dict)
    """Coefficients of both runs."""
    base: Parameters = LOSSLESS
    """Apparatus of both runs."""
    duration: float = 0.06
    """Duration of both runs [s]."""

    @property
    def parameters_without(self) -> Parameters:
        """Return the parameters without the effect."""
        return self.base.replace(**self.common_coefficients)

    @property
    def parameters_with(self) -> Parameters:
        """Return the parameters with the effect."""
        return self.base.replace(**self.common_coefficients, **self.coefficients)


SLIDING_FRICTION: Mapping[str, float] = {"kinetic_friction": 0.2}
SECOND_TURN = LOSSLESS.replace(heavy_mass=0.04, release_angle=math.radians(60), kinetic_friction=0.05)
"""The string lies on itself from 0.334 s on, and slides there."""

HELD = LOSSLESS.replace(release=Release.HELD, release_angle=math.radians(90))
"""A pendulum that is let go where its string is horizontal, so that the pivot's friction never holds it."""

EFFECT_CASES: dict[str, EffectCase] = {
    "light_drag": EffectCase(coefficients={"light_drag": 0.5}),
    "heavy_drag": EffectCase(coefficients={"heavy_drag": 1.0}),
    "string_drag": EffectCase(coefficients={"string_drag": 1.0}),
    "light_linear_drag": EffectCase(coefficients={"light_linear_drag": 0.2}),
    "heavy_linear_drag": EffectCase(coefficients={"heavy_linear_drag": 1.0}),
    "attitude_drag": EffectCase(coefficients={"attitude_drag": 20.0}, common_coefficients={"light_drag": 0.1}),
    "wind": EffectCase(coefficients={"wind_speed": -4.0}, common_coefficients={"light_drag": 0.02}),
    "side_force": EffectCase(coefficients={"side_force": 0.05}),
    "side_stiffness": EffectCase(coefficients={"side_stiffness": 0.2}),
    "push_across": EffectCase(coefficients={"push_across": 0.5}),
    "push_along": EffectCase(coefficients={"push_along": 0.5}),
    "friction_per_speed": EffectCase(
        coefficients={"friction_per_speed": 1.0}, common_coefficients=SLIDING_FRICTION, duration=0.1
    ),
    "friction_per_wrap": EffectCase(
        coefficients={"friction_per_wrap": 0.3}, common_coefficients=SLIDING_FRICTION, duration=0.1
    ),
    "string_on_string": EffectCase(coefficients={"string_on_string": 0.3}, base=SECOND_TURN, duration=0.45),
    "string_mass": EffectCase(coefficients={"string_density": 0.01}, duration=0.1),
    "string_thickness": EffectCase(coefficients={"string_thickness": 0.004}, base=SECOND_TURN, duration=0.45),
    "heavy_swing": EffectCase(coefficients={"heavy_swing": 0.5}, duration=0.1),
    "out_of_plane": EffectCase(coefficients={"push_sideways": 2.0}, duration=0.1),
    "turning_rod": EffectCase(coefficients={"rod_mobility": 1e3}, common_coefficients=SLIDING_FRICTION, duration=0.1),
    "pivot_friction": EffectCase(coefficients={"pivot_friction": 0.02}, base=HELD),
    "pivot_damping": EffectCase(coefficients={"pivot_damping": 0.02}, base=HELD),
    "light_inertia": EffectCase(coefficients={"light_inertia": 2e-3}, duration=0.1),
    "string_stretch": EffectCase(coefficients={"string_compliance": 0.01, "string_loss_time": 0.005}, duration=0.1),
}
"""Effect -> its case.

Gravity and the capstan law are in every other check; a closure is fitted to data and never written in a file, so it has no
case.
"""


def _effect_check(name: str, case: EffectCase) -> Check:
    """Return the check of one effect, with its name and requirements."""

    def check(engine: Engine) -> None:
        expected, actual = displacement(engine, case)
        size = float(np.linalg.norm(expected))
        error = float(np.linalg.norm(actual - expected))
        actual_text, expected_text = (", ".join(f"{1e3 * value:.2f}" for value in each) for each in (actual, expected))
        assert error <= EFFECT_TOLERANCE * size, (
            f"it moves light x, light y and heavy y by {actual_text} mm, needed {expected_text} mm"
        )

    check.__name__ = check.__qualname__ = f"{name}_acts_as_in_the_reference"
    check.__doc__ = f"{EFFECTS[name].formula}: it moves the masses as in the reference."
    REQUIREMENTS[check] = Requirements(parameters=(case.parameters_with, case.parameters_without))
    return check


def displacement(engine: Engine, case: EffectCase) -> tuple[Array, Array]:
    """Return the displacements of light x, light y and heavy y by an effect [m]: in the reference and in ``engine``."""
    runs = [
        engine.simulate(scenario(case.parameters_with, case.duration)),
        run_without_effect(engine, case.parameters_without, case.duration),
    ]
    for run in runs:
        assert len(run.t) > 1, f"a run of {len(run.t)} samples"
    end = min(float(run.t[-1]) for run in runs)
    # The margin finds the sample at ``end`` despite rounding
    last = [positions(run)[int(np.searchsorted(run.t, end - 1e-9))] for run in runs]
    reference = [reference_positions(p, np.array([end]))[-1] for p in (case.parameters_with, case.parameters_without)]
    return reference[0] - reference[1], last[0] - last[1]


EFFECT_CHECKS: dict[str, Check] = {name: _effect_check(name, case) for name, case in EFFECT_CASES.items()}
"""Effect -> its check."""
