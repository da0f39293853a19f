"""Exudyn: a cable of finite elements over a circle with friction; no law is fed in.

Offered through the entry point that a third party uses.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from looping_pendulum.engines.chain import (
    MASS_COMPENSATION,
    MASS_FRACTION,
    NO_STOP,
    ONE_COEFFICIENT,
    hanging_rest_length,
    point_on_string,
    polygon_friction,
)
from looping_pendulum.engines.protocol import Engine, Profile, SteppedEngine, steps_per_sample
from looping_pendulum.engines.shipped import shipped_abilities
from looping_pendulum.engines.studies import Ladder, Studies, Variation, default_row
from looping_pendulum.errors import EngineError
from looping_pendulum.pages.numbers import quantity
from looping_pendulum.reference_ode.cartesian import CartesianForce, MassesAtRelease, Vector, cartesian_force, masses_at_release
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.runs.trajectory import SAMPLE_INTERVAL
from looping_pendulum.scenarios.scenario import Scenario


@dataclass(frozen=True, kw_only=True)
class CableSettings:
    """Numerical settings of the cable and of Exudyn's implicit solver."""

    time_step: float
    """Longest time step [s]; it must divide the sample interval. A step in which the iterations fail is halved, and again."""
    bend: float
    """Angle that an element spans on the rod [rad]; an element is R times this long."""
    segments: int
    """Number of straight contact segments in an element; each touches the rod with its middle."""
    contact_stiffness: float
    """Stiffness of the contact of a segment with the rod [N/m]."""
    friction_stiffness: float
    """Stiffness of a sticking segment along the rod [N/m]; 0: it does not stick, and creeps if there is a velocity penalty."""
    friction_velocity_penalty: float = 0.0
    """Friction of a segment per sliding speed, until it reaches the friction coefficient's share of the load [N s/m]."""
    axial_stiffness: float
    """Stiffness of the string, EA [N]: force per strain."""
    axial_damping: float
    """Damping of the string [N s]: force per rate of strain."""
    bending_stiffness: float
    """Stiffness of the string against bending, EI [N m^2]."""
    integration: int = 2
    """Exudyn's useReducedOrderIntegration: 0 and 1 are Gauss's rules, 2 mixes Lobatto's with Gauss's."""
    mass_fraction: float = MASS_FRACTION
    """Mass of the string over the light mass."""
    initial_tension: float = 0.1
    """Tension of the string before release [N], without which a string that bends so easily would first buckle."""
    polygon: bool = True
    """Whether the rod's radius and friction are corrected for the polygon of the contact segments."""
    spectral_radius: float = 0.6
    """Factor by which the generalised-alpha method damps oscillations much faster than a step; 1 damps nothing."""
    relative_tolerance: float = 1e-6
    """Decrease of the residual at which Newton's iterations end."""
    contact_tolerance: float = 1e-3
    """Largest change of a contact's force [N] between iterations over the contacts' states, with which a step is accepted."""
    contact_iterations: int = 20
    """Largest number of these iterations in a step."""
    modified_newton: bool = False
    """Whether the Jacobian is kept from step to step until the iterations fail to converge with it."""

    def __post_init__(self) -> None:
        """Raise EngineError where a step does not divide the sample interval."""
        steps_per_sample(self.time_step)


SETTINGS = {
    Profile.QUICK: CableSettings(
        time_step=1e-4,
        bend=0.64,
        segments=4,
        contact_stiffness=1e4,
        friction_stiffness=3e3,
        axial_stiffness=1e3,
        axial_damping=1.0,
        bending_stiffness=1e-8,
    ),
    Profile.ACCURATE: CableSettings(
        time_step=5e-5,
        bend=0.32,
        segments=4,
        contact_stiffness=1e4,
        friction_stiffness=3e3,
        axial_stiffness=2e3,
        axial_damping=2.0,
        bending_stiffness=1e-8,
    ),
}
MIN_TIME_STEP = 1e-8
"""Shortest step that is tried where Newton's iterations fail [s]."""
UNUSED_RADIUS = 0.01
"""Radius of gyration of the masses [m], which the cable pulls at their centres, so that they never turn."""
IN_CONTACT, NO_CONTACT = -1e-6, 0.1
"""Gaps [m] from which the search for contact starts, for segments that lie on the rod at release, and for the others."""
UNDEFINED = -2.0
"""Exudyn's number for a segment of which it is not known yet whether it sticks or slides."""


@dataclass(frozen=True, kw_only=True)
class Mass:
    """A point mass, by the numbers under which Exudyn knows its parts."""

    node: int
    marker: int
    load: int
    weight: float
    """[N]"""


class ExudynCableRig:
    """The apparatus in Exudyn: the two masses, the rod's centre, the solver, and a cable of finite elements.

    Parameters
    ----------
    end_length
        Free length [m] at which a run ends.
    """

    def __init__(self, parameters: Parameters, settings: CableSettings, end_length: float) -> None:
        import exudyn
        from exudyn import itemInterface

        p = parameters
        self.exudyn, self.items, self._parameters, self._settings = exudyn, itemInterface, p, settings
        self._container = exudyn.SystemContainer()
        self.mbs = self._container.AddSystem()
        self._force: CartesianForce | None = cartesian_force(p)
        self._has_string = p.release is not Release.DROP
        taken_off = MASS_COMPENSATION * settings.mass_fraction if self._has_string else 0.0
        self._gravity = p.coefficients["gravity"]
        self._samples = 0
        self._end_distance, self._has_ended = math.hypot(end_length, p.rod_radius), False
        self._at_release = masses_at_release(p)
        ground = self.mbs.AddObject(itemInterface.ObjectGround())
        self.rod_marker = self.mbs.AddMarker(itemInterface.MarkerBodyRigid(bodyNumber=ground))
        start = self._at_release
        self.light = self._add_mass(start.light_position, start.light_velocity, (1 - taken_off) * p.light_mass)
        self.heavy: Mass | None = None
        if p.release is Release.HELD:
            self.heavy_marker = self.mbs.AddMarker(
                itemInterface.MarkerBodyRigid(bodyNumber=ground, localPosition=[*start.heavy_position, 0.0])
            )
        else:
            self.heavy = self._add_mass(start.heavy_position, start.heavy_velocity, p.heavy_mass)
            self.heavy_marker = self.heavy.marker

        if self._has_string:
            self._add_string()
        self._start()

    def _start(self) -> None:
        """Assemble the system and start the solver, at the moment of release."""
        s, exudyn = self._settings, self.exudyn
        self.mbs.Assemble()
        self._simulation = exudyn.SimulationSettings()
        self._simulation.solution.file.write = False
        self._simulation.solution.sensors.active = False
        self._simulation.linearSolver.solverType = exudyn.LinearSolverType.EigenSparse
        integration = self._simulation.timeIntegration
        # Samples share one solver, so that accelerations are continued from one to the next; see `advance`
        integration.numberOfSteps, integration.endTime = round(SAMPLE_INTERVAL / s.time_step), SAMPLE_INTERVAL
        integration.verboseMode, integration.stepInformation = 0, 0
        integration.minimumStepSize = MIN_TIME_STEP
        integration.adaptiveStepRecoverySteps = 2
        integration.generalizedAlpha.spectralRadius = s.spectral_radius
        integration.discontinuous.iterationTolerance = s.contact_tolerance
        integration.discontinuous.maxIterations = s.contact_iterations
        integration.newton.useModifiedNewton = s.modified_newton
        integration.newton.relativeTolerance = s.relative_tolerance
        self.mbs.SetPreStepUserFunction(self._prepare_step)
        self._solver = exudyn.MainSolverImplicitSecondOrder()
        if not self._solver.InitializeSolver(self.mbs, self._simulation):
            raise EngineError("exudyn: the solver could not be started")

    def advance(self) -> None:
        """Advance by one sample interval, or until the light mass reaches the rod."""
        self._samples += 1
        # A solver ends its steps a little before or after, by rounding; a remainder must not become a step of its own
        self._solver.it.endTime = self._samples * SAMPLE_INTERVAL - 1e-3 * self._settings.time_step
        if not self._solver.SolveSteps(self.mbs, self._simulation) and not self._has_ended:
            raise EngineError(
                f"exudyn: found no solution at {self.mbs.systemData.GetTime():.6f} s with steps down to {MIN_TIME_STEP:g} s, "
                "needed one; shorten the time step"
            )

    def read(self) -> tuple[float, ...]:
        """Return positions [m], velocities [m/s], string stretch and slip [m]: `COLUMNS` without the time."""
        masses = self._read_masses()
        return (*masses, *(self._read_string(masses) if self._has_string else (math.nan, math.nan)))

    def _read_masses(self) -> tuple[float, ...]:
        """Return positions [m] and velocities [m/s] of both masses, the light one's first."""
        heavy = (*self._at_release.heavy_position, 0.0, 0.0) if self.heavy is None else self._read(self.heavy)
        return (*self._read(self.light), *heavy)

    def _add_mass(self, position: Sequence[float], velocity: Vector, mass: float) -> Mass:
        items, mbs = self.items, self.mbs
        # A rigid body that nothing turns, as the cable's ends are pinned to markers of rigid bodies
        node = mbs.AddNode(items.NodeRigidBody2D(referenceCoordinates=[*position, 0.0], initialVelocities=[*velocity, 0.0]))
        mbs.AddObject(items.ObjectRigidBody2D(mass=mass, inertia=mass * UNUSED_RADIUS**2, nodeNumber=node))
        marker, weight = mbs.AddMarker(items.MarkerNodeRigid(nodeNumber=node)), mass * self._gravity
        load = mbs.AddLoad(items.LoadForceVector(markerNumber=marker, loadVector=[0.0, -weight, 0.0]))
        return Mass(node=node, marker=marker, load=load, weight=weight)

    def _read(self, mass: Mass) -> tuple[float, ...]:
        variable = self.exudyn.OutputVariableType
        x, y, _ = self.mbs.GetNodeOutput(mass.node, variable.Position)
        vx, vy, _ = self.mbs.GetNodeOutput(mass.node, variable.Velocity)
        return float(x), float(y), float(vx), float(vy)

    def _prepare_step(self, mbs: Any, time: float) -> bool:
        """Set the effects' forces on the masses; Exudyn calls it before each step, and stops where this returns False."""
        masses = self._read_masses()
        # Nearer to the rod than that, the cable bends by a turn within a segment
        self._has_ended = self._has_string and math.hypot(masses[0], masses[1]) <= self._end_distance
        if self._has_ended:
            return False
        if self._force is not None:
            x, y, vx, vy, _, _, _, heavy_vy = masses
            fx, fy, heavy_fy = self._force(time, x, y, vx, vy, heavy_vy)
            mbs.SetLoadParameter(self.light.load, "loadVector", [fx, fy - self.light.weight, 0.0])
            if self.heavy is not None:
                mbs.SetLoadParameter(self.heavy.load, "loadVector", [0.0, heavy_fy - self.heavy.weight, 0.0])
        return True

    def _add_string(self) -> None:
        """Add nodes and elements along the string, and pin its ends to the masses."""
        mbs, items = self.mbs, self.items
        arcs = _node_arcs(self._parameters, self._settings.bend)
        self._lengths = np.diff(arcs)
        self._reference = _coordinates_at_release(self._parameters, arcs)
        velocities = _velocities_at_release(self._parameters, self._at_release, arcs)
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
        for node, marker in ((nodes[0], self.light.marker), (nodes[-1], self.heavy_marker)):
            end = mbs.AddMarker(items.MarkerNodePosition(nodeNumber=node))
            mbs.AddObject(items.ObjectJointRevolute2D(markerNumbers=[marker, end]))

    def _add_element(self, nodes: tuple[int, int], length: float, *, touches: bool) -> None:
        """Add an element of ``length`` [m] and its contact with the rod."""
        p, s, mbs, items = self._parameters, self._settings, self.mbs, self.items
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
                markerNumbers=[self.rod_marker, shape],
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

    def _read_string(self, masses: tuple[float, ...]) -> Vector:
        first = self.mbs.GetNodeODE2Index(self._first_node)
        moved = self.mbs.systemData.GetODE2Coordinates()[first : first + self._reference.size]
        nodes = self._reference + np.asarray(moved).reshape(-1, 4)
        places, slopes = nodes[:, :2], nodes[:, 2:]
        lengths = self._lengths
        # Of a cubic with these end points and slopes; Simpson's rule for its length
        middle = 1.5 * np.diff(places, axis=0) / lengths[:, None] - 0.25 * (slopes[1:] + slopes[:-1])
        speeds, middle_speeds = np.linalg.norm(slopes, axis=1), np.linalg.norm(middle, axis=1)
        stretched = lengths * (speeds[:-1] + 4 * middle_speeds + speeds[1:]) / 6
        return float(stretched.sum() - lengths.sum()), hanging_rest_length(places.tolist(), lengths.tolist())


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


def _velocities_at_release(p: Parameters, masses: MassesAtRelease, arcs: Array) -> Array:
    """Return the rates of these coordinates, shape (n, 4): the string slides over the rod, and is straight beside it."""
    angles = _angles(p, arcs)
    rates = -masses.heavy_velocity[1] * np.column_stack(
        [np.sin(angles), -np.cos(angles), -np.cos(angles) / p.rod_radius, -np.sin(angles) / p.rod_radius]
    )
    rates[arcs > p.free_length + p.rod_radius * p.release_angle, 2:] = 0.0
    free = arcs < p.free_length
    at_rod = rates[~free][0, :2]
    rate = (at_rod - masses.light_velocity) / p.free_length
    rates[free] = np.column_stack(
        [np.array(masses.light_velocity) + arcs[free, None] * rate, np.tile(rate, (int(free.sum()), 1))]
    )
    return rates


def _angles(p: Parameters, arcs: Array) -> Array:
    """Return the angle on the rod at which the string's direction is that of each point [rad]."""
    return np.clip(p.release_angle - (arcs - p.free_length) / p.rod_radius, 0.0, p.release_angle)


VELOCITY_PENALTY = 1.0
"""Friction per sliding speed without sticking [N s/m], with which a segment that carries 50 mN creeps at 17 mm/s."""


class ExudynCable(SteppedEngine):
    """A cable of finite elements over a circle."""

    name = "exudyn"
    distribution = "exudyn"
    variant = "cable"
    settings_by_profile = SETTINGS
    settings: CableSettings
    abilities = shipped_abilities(
        "exudyn:cable",
        winding="contact of the cable's segments with a circle",
        friction_law="Coulomb friction between segments and circle, its coefficient solved for their corners",
        stick_slip="the same contact: a sticking segment is held by a spring",
        summary="An elastic cable of ANCF elements with mass along the whole string, over a circle with friction.",
        limits=(
            ONE_COEFFICIENT,
            "the string stretches like a soft thread, by a millimetre or two at ten_to_one where it catches the light mass",
            "a slack string buckles: then Newton's iterations need short steps, or fail",
            NO_STOP,
        ),
        additions=(
            "the string weighs 1 % of the light mass; 0.4 % is taken off that",
            "the string is slightly taut before its release, lest it buckle",
        ),
        main=False,
    )

    def build(self, scenario: Scenario) -> ExudynCableRig:
        """Build the scenario's apparatus at the moment of release."""
        return ExudynCableRig(scenario.parameters, self.settings, self.end_length(scenario))

    def studies(self) -> Studies:
        """Return ladders of step, elements, stiffnesses and mass, Exudyn's defaults, and the adapter's choices."""
        s = self.settings
        segment, damping_time = s.bend / s.segments, s.axial_damping / s.axial_stiffness
        bends = [{"bend": bend, "segments": max(round(bend / segment), 1)} for bend in (0.64, 0.45, 0.32, 0.22)]
        axial = [{"axial_stiffness": ea, "axial_damping": damping_time * ea} for ea in (2.5e2, 5e2, 1e3, 2e3)]
        return Studies(
            ladders=(
                Ladder("time_step", "s", (5e-4, 2e-4, 1e-4, 5e-5)),
                Ladder("bend", "rad", bends, "the number of segments of an element, so that their length stays about"),
                Ladder("contact_stiffness", "N/m", (2.5e3, 5e3, 1e4, 2e4)),
                Ladder("friction_stiffness", "N/m", (7.5e2, 1.5e3, 3e3, 6e3)),
                Ladder("axial_stiffness", "N", axial, "the string's damping, so that its damping time stays"),
            ),
            defaults=(
                default_row(s, "spectral_radius", 0.9, "spectralRadius", "how little fast oscillations are damped"),
                default_row(
                    s,
                    "modified_newton",
                    True,
                    "useModifiedNewton",
                    "the Jacobian is kept from step to step, which contacts that open and close make wrong",
                ),
                default_row(
                    s,
                    "contact_tolerance",
                    1.0,
                    "discontinuous.iterationTolerance",
                    "the error of a contact's force that a step is accepted with: one that begins to slide is held too hard",
                    unit="N",
                ),
                default_row(
                    s,
                    "integration",
                    0,
                    "useReducedOrderIntegration",
                    "elements that bend must stretch, so that they resist bending round the rod",
                ),
                Variation(
                    "frictionStiffness",
                    quantity(s.friction_stiffness, "N/m", 3),
                    "0; without a velocity penalty, 0 by default too, there is no friction",
                    {"friction_stiffness": 0.0, "friction_velocity_penalty": VELOCITY_PENALTY},
                    f"nothing sticks; with a velocity penalty of {VELOCITY_PENALTY:g} N s/m it creeps",
                ),
            ),
            choices=(
                Variation(
                    "bending stiffness",
                    quantity(s.bending_stiffness, "N m^2", 3),
                    "double",
                    {"bending_stiffness": 2 * s.bending_stiffness},
                ),
                Variation("string mass", f"{100 * s.mass_fraction:g} % of M1", "half", {"mass_fraction": s.mass_fraction / 2}),
                Variation(
                    "initial tension", quantity(s.initial_tension, "N", 3), "half", {"initial_tension": s.initial_tension / 2}
                ),
                Variation("axial damping", quantity(s.axial_damping, "N s", 3), "half", {"axial_damping": s.axial_damping / 2}),
                Variation("rod's radius and friction", "corrected for the segments", "as they are", {"polygon": False}),
            ),
        )


def engines(profile: Profile) -> list[Engine]:
    """Return every variant of this engine with the settings of ``profile``."""
    return [ExudynCable(profile=profile)]
