"""What all chains of links between nodes share: the polygon's friction, the state at one moment, the settings."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from looping_pendulum.engines.chain import polygon_friction, polygon_radius
from looping_pendulum.engines.pybullet.settings import WorldSettings
from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release

MEAN_TURN_TO_HALT = math.pi / 2
"""Typical wrap angle beyond the release's, averaged over a looping mass's motion until the halt [rad]."""
MAX_BEND = 1.3
"""Largest bend at a node [rad]: beyond it friction at the corners no longer is that of a circle."""


def typical_wrap_angle(parameters: Parameters) -> float:
    """Return the wrap angle [rad] at which the polygon's mean friction shall be that of a circle; it changes little with it."""
    return parameters.release_angle + (0.0 if parameters.release is Release.VERTICAL else MEAN_TURN_TO_HALT)


def contact_friction(friction: float, bend: float, wrap_angle: float) -> float:
    """Return the contact friction with which a sliding polygon obeys the capstan law, averaged over its ends' positions.

    `polygon_friction` is right for full corners. A corner of angle d makes ln(T2/T1) = 2 artanh(m tan(d/2)), which grows faster
    than d; and the first and last corner on the rod turn by anything from 0 to the full ``bend``, evenly as the string winds.
    So the wrap angle theta is theta / bend - 1 full corners and two such ends, and m solves
    (theta / bend - 1) f(bend) + 2 mean(f) = mu theta.
    """
    from scipy.optimize import brentq  # imported here, as it is slow and every list of engines imports this module

    if friction == 0:
        return 0.0
    points, weights = np.polynomial.legendre.leggauss(16)
    tangents = np.tan(0.25 * bend * (points + 1))
    full = math.tan(bend / 2)

    def exponent(m: float) -> float:
        ends = float(weights @ np.arctanh(m * tangents)) * 2  # the weights add up to 2: both ends
        return (wrap_angle / bend - 1) * 2 * math.atanh(m * full) + ends

    # At 1 / tan(bend / 2) a full corner would hold any tension
    lowest, highest = polygon_friction(friction, bend), (1 - 1e-12) / full
    return float(brentq(lambda m: exponent(m) - friction * wrap_angle, 0.5 * lowest, highest, xtol=1e-15))


@dataclass(frozen=True, kw_only=True)
class ChainState:
    """Positions and velocities of a chain at one moment: its ends and the nodes between, from heavy to light mass."""

    positions: Array
    """Of masses and nodes [m], shape (n, 2)."""
    velocities: Array
    """Of masses and nodes [m/s], shape (n, 2)."""

    @property
    def lengths(self) -> Array:
        """Lengths of the links [m], shape (n - 1,)."""
        return np.asarray(np.hypot(*np.diff(self.positions, axis=0).T))

    @property
    def directions(self) -> Array:
        """Directions of the links, from the x axis [rad], shape (n - 1,)."""
        x, y = np.diff(self.positions, axis=0).T
        return np.asarray(np.arctan2(y, x))

    @property
    def turn_rates(self) -> Array:
        """Angular velocities of the links [rad/s], shape (n - 1,)."""
        (x, y), (vx, vy) = np.diff(self.positions, axis=0).T, np.diff(self.velocities, axis=0).T
        return np.asarray((x * vy - y * vx) / (x * x + y * y))


@dataclass(frozen=True, kw_only=True)
class LinkSettings(WorldSettings):
    """Settings of variants that consist of links between nodes."""

    link_length: float
    """Length of a link that may lie on the rod [m]; longer on a thick rod, see `least_bend`."""
    bead_mass_ratio: float
    """Mass of a node over the light mass. Stable below steps of about sqrt(its mass x link length / tension)."""
    least_bend: float = 0.2
    """Smallest angle between links on the rod [rad]: on a thick rod, which needs no shorter ones, links are longer."""

    def length_on_rod(self, parameters: Parameters) -> float:
        """Return the length of a link on the rod [m].

        Raises
        ------
        EngineError
            If it would bend too far there.
        """
        radius = parameters.rod_radius
        if self.link_length > MAX_BEND * radius:
            raise EngineError(
                f"pybullet: links of {1e3 * self.link_length:.3g} mm cannot wrap a rod of radius {1e3 * radius:.3g} mm; "
                f"shorten link_length to {1e3 * MAX_BEND * radius:.2g} mm or less"
            )
        length = max(self.link_length, self.least_bend * radius)
        if parameters.release is Release.VERTICAL:
            # The wrap angle is constant. Links that divide it reach and leave the rod at the same moments, so that the ripple
            # which a passing node makes in the string's speed is the same at both ends, and the masses do not feel it.
            wound = radius * parameters.release_angle
            length = wound / math.ceil(wound / length)
        return length

    def node_circle(self, parameters: Parameters) -> float:
        """Return the distance of a node on the rod from the rod's centre [m]."""
        radius = parameters.rod_radius
        return float(polygon_radius(radius, self.length_on_rod(parameters) / radius)) if self.polygon else radius

    def friction(self, parameters: Parameters, wrap_angle: float, rod_radius: float) -> float:
        """Return the contact coefficient of nodes on a rod whose sphere has ``rod_radius`` [m].

        Friction acts where a node touches the rod, tension at the node: their lever arms differ by the node's radius.
        """
        p = parameters
        law = p.coefficients["kinetic_friction"]
        if self.polygon:
            law = contact_friction(law, self.length_on_rod(p) / p.rod_radius, wrap_angle)
        return law * self.node_circle(p) / rod_radius
