"""Tensions of the string from the motion alone."""

from __future__ import annotations

import numpy as np

from looping_pendulum.reference_ode.cartesian import cartesian_force
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.runs.trajectory import Trajectory

AVERAGING_TIME = 0.01
"""Time over which tensions are averaged [s], because an engine's contacts chatter.

A jump of the tension is spread over half of it on either side.
"""


def tension_from_motion(run: Trajectory, parameters: Parameters) -> tuple[Array | None, Array | None]:
    """Return the tension at the light and at the heavy mass [N], averaged over `AVERAGING_TIME`, each of shape (n,).

    A tension that the motion does not determine is None: without a string, at a held mass, with fewer than two samples.
    """
    if parameters.release is Release.DROP or len(run.t) < 2:
        return None, None
    light, heavy = string_impulses(run, parameters)
    return _mean_force(light, run.t), None if parameters.release is Release.HELD else _mean_force(heavy, run.t)


def string_impulses(run: Trajectory, parameters: Parameters) -> tuple[Array, Array]:
    """Return the impulse of the string on the light and on the heavy mass between samples [N s], each of shape (n - 1,).

    They follow from Newton's second law. On the light mass it is the component along the free string, towards the rod. The
    masses are those of the apparatus, even if an adapter shifts a little mass from the light mass to its chain.
    """
    p = parameters
    angle = 0.5 * (run.wrap_angle[1:] + run.wrap_angle[:-1])
    towards_rod = np.stack([np.sin(angle), -np.cos(angle)], axis=1)
    # All forces except the string's: x and y of the light mass, y of the heavy mass
    force = np.tile(-p.coefficients["gravity"] * np.array([0.0, p.light_mass, p.heavy_mass]), (len(run.t), 1))
    effects_force = cartesian_force(p)
    if effects_force is not None:
        rows = zip(run.t, *run.light_position.T, *run.light_velocity.T, run.heavy_velocity[:, 1], strict=True)
        force += [effects_force(*map(float, row)) for row in rows]
    # The trapezoidal rule, as exact as samples of the velocity allow
    other_impulses = 0.5 * (force[1:] + force[:-1]) * np.diff(run.t)[:, None]
    light = p.light_mass * np.diff(run.light_velocity, axis=0) - other_impulses[:, :2]
    return np.sum(light * towards_rod, axis=1), p.heavy_mass * np.diff(run.heavy_velocity[:, 1]) - other_impulses[:, 2]


def _mean_force(impulses: Array, t: Array) -> Array:
    """Return the mean force within half of `AVERAGING_TIME` before and after each sample [N], shape (n,)."""
    # Differences of the running sum are the impulses over any interval
    total = np.concatenate([[0.0], np.cumsum(impulses)])
    half = 0.5 * AVERAGING_TIME * (1 + 1e-6)  # the margin includes samples exactly half of it away, despite rounding
    first, last = np.searchsorted(t, t - half), np.searchsorted(t, t + half, side="right") - 1
    return np.asarray((total[last] - total[first]) / (t[last] - t[first]))
