"""The string's pull on either mass, from the motion alone: what weight, drag and the other forces leave unexplained of it."""

from __future__ import annotations

import numpy as np

from looping_pendulum.engines.protocol import SAMPLE_INTERVAL
from looping_pendulum.engines.trajectory import Trajectory
from looping_pendulum.reference_ode.cartesian import cartesian_force
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release

WINDOW = 11
"""Samples over which velocities are differentiated: an engine's contacts chatter, and a jump is spread over 5 ms on either
side."""


def tension_from_motion(run: Trajectory, parameters: Parameters) -> tuple[Array | None, Array | None]:
    """Pull of the string on the light and on the heavy mass [N], each of shape (n,), by Newton's second law.

    On the light mass it is the part along the free string, from the rod's tangent point to the mass. The apparatus' own masses
    are taken, also where an adapter shifts a little mass from the light mass to its chain.

    Returns
    -------
    None in place of a pull that the motion cannot tell: no string, a held mass, a run shorter than the window, samples that
    are not one `SAMPLE_INTERVAL` apart.
    """
    p = parameters
    evenly = bool(np.all(np.abs(np.diff(run.t) - SAMPLE_INTERVAL) < 1e-6 * SAMPLE_INTERVAL))
    if p.release is Release.DROP or len(run.t) < WINDOW or not evenly:
        return None, None
    weight = np.array([0.0, -p.coefficients["gravity"]])
    force = _other_forces(run, p)
    towards_rod = np.stack([np.sin(run.wrap_angle), -np.cos(run.wrap_angle)], axis=1)
    light = p.light_mass * (_derivative(run.light_velocity) - weight) - force[:, :2]
    light_pull = np.sum(light * towards_rod, axis=1)
    if p.release is Release.HELD:
        return light_pull, None
    return light_pull, p.heavy_mass * (_derivative(run.heavy_velocity)[:, 1] - weight[1]) - force[:, 2]


def _derivative(velocity: Array) -> Array:
    from scipy.signal import savgol_filter

    return np.asarray(savgol_filter(velocity, WINDOW, polyorder=2, deriv=1, delta=SAMPLE_INTERVAL, axis=0))


def _other_forces(run: Trajectory, p: Parameters) -> Array:
    """Forces beside gravity and the string: x and y of the light mass, y of the heavy one [N], shape (n, 3)."""
    force = cartesian_force(p)
    if force is None:
        return np.zeros((len(run.t), 3))
    rows = zip(run.t, *run.light_position.T, *run.light_velocity.T, run.heavy_velocity[:, 1], strict=True)
    return np.array([force(*map(float, row)) for row in rows])
