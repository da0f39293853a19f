"""Names the simple mistake of a run: a unit, a sign, an axis or velocities, where one of them alone makes the run fit.

At the release the state is known exactly, and shortly after it the motion is. A run that departs is therefore compared with a
few changed copies of that: what it would give if its output had another unit or axis, or its input another sign. The copy that
fits is named; a departure that comes later or needs more than one change has no name here.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from looping_pendulum.compare.align import Aligned
from looping_pendulum.pages.numbers import number, quantity
from looping_pendulum.reference_ode.closed_forms import release_acceleration
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.runs.trajectory import LARGEST, SAME_TIME, Trajectory

FIRST_TIME = 0.03
"""Time after the release [s] whose samples are looked at: at a constant acceleration, a heavy mass falls by some 4 mm in it."""
MAX_MISFIT = 0.03
"""Largest misfit of a changed copy that is named, as a fraction of its size; a unit or a sign changes far more.

A constant acceleration is off by (g / l) t^2 / 12 of the motion, 0.1 % in `FIRST_TIME`.
"""
MIN_GAIN = 5.0
"""The exact motion must fit worse by this factor."""
MAX_VELOCITY_MISFIT = 0.1
"""Largest misfit of velocities to the slopes of the positions; the runs of this package's engines have up to 0.007."""
MAX_START_ERROR = 5e-4
"""Largest distance from the place of the release [m] that is not named: half of the smallest departure that is recorded."""
MIN_SAMPLES = 5
"""Fewest samples to be judged."""
MASSES = MappingProxyType({"heavy": slice(2, 4), "light": slice(0, 2)})
"""Mass -> columns of its x and y in positions of both."""

UNITS = MappingProxyType({1e3: "mm", 1e2: "cm", 1e-3: "km"})
"""Factor -> unit in which lengths are so many times as large as in metres."""

POSITION_CHANGES: Mapping[str, Array] = MappingProxyType(
    {
        f"its positions are {factor:g} times the exact ones at the release: they are in {unit}, and should be in metres": (
            factor * np.eye(4)
        )
        for factor, unit in UNITS.items()
    }
    | {
        "its heights have the wrong sign at the release: its y axis points down, and should point up": np.diag([1, -1, 1, -1]),
        "its x has the wrong sign at the release: its x axis points left, and should point right": np.diag([-1, 1, -1, 1]),
        "its axes are exchanged at the release: x should point right, and y up": np.eye(4)[[1, 0, 3, 2]],
        "its masses are exchanged at the release: the light one should come first": np.eye(4)[[2, 3, 0, 1]],
    }
)
"""What is wrong -> the matrix that makes such positions (light x and y, heavy x and y) of the exact ones, shape (4, 4)."""


def simple_mistake(aligned: Aligned, parameters: Parameters) -> str:
    """Return what is simply wrong with the positions of a run, as a clause; '' if nothing that is known here.

    Parameters
    ----------
    aligned
        A run that departs from the reference.
    """
    first = aligned.t <= FIRST_TIME
    run, exact = _positions(aligned.run)[first], _positions(aligned.reference)[first]
    known = np.isfinite(exact).all(axis=1)
    run, exact, t = run[known], exact[known], aligned.t[first][known]
    if len(t) < MIN_SAMPLES or t[0] > SAME_TIME:
        return ""
    changed = {words: exact[:1] @ matrix.T for words, matrix in POSITION_CHANGES.items()}
    if words := _best(changed, run[:1], exact[:1]):
        return words
    moved, should = run - run[0], exact - exact[0]
    off = {mass: float(np.hypot(*(run[0] - exact[0])[xy])) for mass, xy in MASSES.items()}
    begin = [f"its {mass} mass begins {quantity(size, 'm')}" for mass, size in off.items() if size > MAX_START_ERROR]
    if begin and _misfit(moved, should) <= MAX_MISFIT:
        return f"{' and '.join(begin)} from where it is released, and moves from there as it should"
    for mass, xy in MASSES.items():
        expected = float(np.hypot(*should[:, xy].T).max())
        if np.hypot(*moved[:, xy].T).max() < MAX_MISFIT * expected:
            moves = f"{quantity(expected, 'm')} in {quantity(t[-1], 's')}"
            return f"its {mass} mass stays at its release, where the exact one moves by {moves}"
    return _best(_changed_motions(t, parameters), moved, should)


def velocity_mistake(run: Trajectory) -> str:
    """Return what is wrong with a run's velocities, which must be the slopes of its positions, as a clause; '' if nothing."""
    if len(run.t) < MIN_SAMPLES:
        return ""
    given = np.hstack([run.light_velocity, run.heavy_velocity])
    slopes = np.gradient(_positions(run), run.t, axis=0)
    if not (np.abs(given) <= LARGEST).all():
        return f"its velocities are no numbers, or above {LARGEST:g} m/s"
    if _misfit(given, slopes) <= MAX_VELOCITY_MISFIT:
        return ""
    changed = {f"its velocities are in {unit}/s, and should be in m/s": factor * slopes for factor, unit in UNITS.items()}
    changed |= {"its velocities have the wrong sign": -slopes, "its velocities are zero": 0.0 * slopes}
    share = number(100 * _misfit(given, slopes), digits=2)
    return _best(changed, given, slopes) or f"its velocities differ from the slopes of its positions, by {share} % of them"


def _positions(run: Trajectory) -> Array:
    """Return positions of the light and of the heavy mass side by side [m], shape (n, 4)."""
    return np.hstack([run.light_position, run.heavy_position])


def _changed_motions(t: Array, parameters: Parameters) -> dict[str, Array]:
    """Return what is wrong -> the displacements since the release [m], shape (n, 4), that such a run has."""
    c, motions = parameters.coefficients, {}
    if parameters.release is not Release.HELD:
        motions["gravity acts upward: its sign is wrong"] = (0.0, c["gravity"], 0.0, c["gravity"])
    friction = c["kinetic_friction"]
    if parameters.release in (Release.LOOPING, Release.VERTICAL) and friction > 0:
        for words, changed in (
            ("the string's friction drives it in place of braking it: its sign is wrong", -friction),
            ("it moves as without the string's friction", 0.0),
        ):
            light_x, light_y, heavy_y = release_acceleration(parameters, changed)
            motions[words] = (light_x, light_y, 0.0, heavy_y)
    return {words: 0.5 * t[:, None] ** 2 * np.array(acceleration) for words, acceleration in motions.items()}


def _best(changed: Mapping[str, Array], run: Array, exact: Array) -> str:
    """Return the key of the copy that fits ``run`` best, if it fits well and the exact motion does not; else ''."""
    misfits = {words: _misfit(run, copy) for words, copy in changed.items()}
    words = min(misfits, key=lambda each: misfits[each], default="")
    if not words or not misfits[words] <= MAX_MISFIT or _misfit(run, exact) < MIN_GAIN * misfits[words]:
        return ""
    return words if _misfit(run, exact) > MAX_MISFIT else ""


def _misfit(run: Array, copy: Array) -> float:
    """Return the size of the difference as a fraction of the size of ``copy``, or of that of ``run`` where this is zero."""
    size = np.linalg.norm(copy) or np.linalg.norm(run) or 1.0
    return float(np.linalg.norm(run - copy) / size)
