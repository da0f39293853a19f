"""The rig of Exudyn's cable: elements along the whole string, with contact and friction of each on the rod's circle."""

from __future__ import annotations

import math

import numpy as np

from looping_pendulum.engines.chain import MASS_COMPENSATION, SlipGauge, point_on_string, polygon_friction
from looping_pendulum.engines.exudyn.settings import CableSettings
from looping_pendulum.engines.exudyn.system import ExudynSystem
from looping_pendulum.reference_ode.cartesian import release_velocity
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release

IN_CONTACT, NO_CONTACT = -1e-6, 0.1
"""Gaps [m] from which the search for contact starts, for segments that lie on the rod at release, and for the others."""
UNDEFINED = -2.0
"""Exudyn's number for a segment of which it is not known yet whether it sticks or slides."""


class ExudynCableRig:
    """The apparatus with a cable of finite elements."""

    def __init__(self, parameters: Parameters, settings: CableSettings, end_length: float) -> None:
        self._parameters, self._settings = parameters, settings
        self._has_string = parameters.release is not Release.DROP
        taken_off = MASS_COMPENSATION * settings.mass_fraction if self._has_string else 0.0
        self._system = ExudynSystem(
            parameters, settings, light_mass=(1 - taken_off) * parameters.light_mass, end_length=end_length
        )
        if self._has_string:
            self._slip = SlipGauge()
            self._add_string()
        self._system.start()

    def advance(self) -> None:
        """Advance by one sample interval."""
        self._system.advance()

    def read(self) -> tuple[float, ...]:
        """Return positions [m], velocities [m/s], string stretch and slip [m]: `COLUMNS` without the time."""
        return (*self._system.read_masses(), *self._read_string())

    def _add_string(self) -> None:
        """Add nodes and elements along the taut string, with the release's velocities, and pin its ends to the masses."""
        system, mbs, items = self._system, self._system.mbs, self._system.items
        arcs = _node_arcs(self._parameters, self._settings.bend)
        self._lengths = np.diff(arcs)
        self._reference = _coordinates_at_release(self._parameters, arcs)
        velocities = _velocities_at_release(self._parameters, arcs)
        nodes = [
            mbs.AddNode(items.NodePoint2DSlope1(referenceCoordinates=place.tolist(), initialVelocities=velocity.tolist()))
            for place, velocity in zip(self._reference, velocities, strict=True)
        ]
        self._first_node = nodes[0]
        middles = 0.5 * (arcs[1:] + arcs[:-1])
        p = self._parameters
        on_rod = (middles > p.free_length) & (middles < p.free_length + p.rod_radius * p.release_angle)
        for pair, length, touches in zip(zip(nodes[:-1], nodes[1:], strict=True), self._lengths, on_rod, strict=True):
            self._add_element(pair, float(length), touches=bool(touches))
        for node, marker in ((nodes[0], system.light.marker), (nodes[-1], system.heavy_marker)):
            end = mbs.AddMarker(items.MarkerNodePosition(nodeNumber=node))
            mbs.AddObject(items.ObjectJointRevolute2D(markerNumbers=[marker, end]))

    def _add_element(self, nodes: tuple[int, int], length: float, *, touches: bool) -> None:
        """Add an element of ``length`` [m] and its contact with the rod."""
        p, s, mbs, items = self._parameters, self._settings, self._system.mbs, self._system.items
        cable = mbs.AddObject(
            items.ObjectANCFCable2D(
                nodeNumbers=list(nodes),
                length=length,
                massPerLength=s.mass_fraction * p.light_mass / p.string_length,
                axialStiffness=s.axial_stiffness,
                axialDamping=s.axial_damping,
                bendingStiffness=s.bending_stiffness,
                # The unloaded string is straight, and shorter by what the initial tension stretches it
                strainIsRelativeToReference=0.0,
                referenceAxialStrain=-s.initial_tension / s.axial_stiffness,
                useReducedOrderIntegration=s.integration,
            )
        )
        shape = mbs.AddMarker(items.MarkerBodyCable2DShape(bodyNumber=cable, numberOfSegments=s.segments))
        state = [IN_CONTACT if touches else NO_CONTACT] * s.segments + [UNDEFINED] * s.segments + [0.0] * s.segments
        data = mbs.AddNode(items.NodeGenericData(initialCoordinates=state, numberOfDataCoordinates=len(state)))
        friction, bend = p.coefficients["kinetic_friction"], length / s.segments / p.rod_radius
        mbs.AddObject(
            items.ObjectContactFrictionCircleCable2D(
                markerNumbers=[self._system.rod_marker, shape],
                nodeNumber=data,
                numberOfContactSegments=s.segments,
                contactStiffness=s.contact_stiffness,
                frictionStiffness=s.friction_stiffness,
                frictionVelocityPenalty=s.friction_velocity_penalty,
                frictionCoefficient=polygon_friction(friction, bend) if s.polygon else friction,
                # Segments are chords: where their ends lie on the rod, their middles are nearer to its centre
                circleRadius=p.rod_radius * math.cos(bend / 2) if s.polygon else p.rod_radius,
            )
        )

    def _read_string(self) -> tuple[float, float]:
        """Return the string's stretch beyond its length at release and its slip over the rod [m]."""
        if not self._has_string:
            return math.nan, math.nan
        mbs = self._system.mbs
        first = mbs.GetNodeODE2Index(self._first_node)
        moved = mbs.systemData.GetODE2Coordinates()[first : first + self._reference.size]
        nodes = self._reference + np.asarray(moved).reshape(-1, 4)
        places, slopes = nodes[:, :2], nodes[:, 2:]
        lengths = self._lengths
        # Of a cubic with these end points and slopes; Simpson's rule for its length
        middle = 1.5 * np.diff(places, axis=0) / lengths[:, None] - 0.25 * (slopes[1:] + slopes[:-1])
        speeds, middle_speeds = np.linalg.norm(slopes, axis=1), np.linalg.norm(middle, axis=1)
        stretched = lengths * (speeds[:-1] + 4 * middle_speeds + speeds[1:]) / 6
        return float(stretched.sum() - lengths.sum()), self._slip.read(places.tolist(), lengths.tolist())


def _node_arcs(p: Parameters, bend: float) -> Array:
    """Return the nodes' positions along the string, from the light mass [m], with nodes where it meets the rod at release."""
    arcs = [np.zeros(1)]
    for part in (p.free_length, p.rod_radius * p.release_angle, p.hanging_length):
        elements = max(round(part / (bend * p.rod_radius)), 1)
        arcs.append(arcs[-1][-1] + part * np.arange(1, elements + 1) / elements)
    return np.concatenate(arcs)


def _coordinates_at_release(p: Parameters, arcs: Array) -> Array:
    """Return position and slope of the nodes of the taut string, shape (n, 4); slopes point towards the heavy mass."""
    angles = _angles(p, arcs)
    places = np.array([point_on_string(p, arc, p.rod_radius) for arc in arcs])
    return np.column_stack([places, np.sin(angles), -np.cos(angles)])


def _velocities_at_release(p: Parameters, arcs: Array) -> Array:
    """Return the rates of these coordinates, shape (n, 4): the string slides over the rod, and is straight beside it."""
    vx, vy, heavy_vy = release_velocity(p)
    angles = _angles(p, arcs)
    rates = -heavy_vy * np.column_stack(
        [np.sin(angles), -np.cos(angles), -np.cos(angles) / p.rod_radius, -np.sin(angles) / p.rod_radius]
    )
    rates[arcs > p.free_length + p.rod_radius * p.release_angle, 2:] = 0.0
    free = arcs < p.free_length
    at_rod = rates[~free][0, :2]
    rate = (at_rod - (vx, vy)) / p.free_length
    rates[free] = np.column_stack([np.array([vx, vy]) + arcs[free, None] * rate, np.tile(rate, (int(free.sum()), 1))])
    return rates


def _angles(p: Parameters, arcs: Array) -> Array:
    """Return the angle on the rod at which the string's direction is that of each point [rad]."""
    return np.clip(p.release_angle - (arcs - p.free_length) / p.rod_radius, 0.0, p.release_angle)
