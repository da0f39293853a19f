"""Exudyn's multibody system with its implicit solver: masses, forces and time steps as both variants need them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from looping_pendulum.engines.exudyn.settings import SolverSettings
from looping_pendulum.engines.protocol import SAMPLE_INTERVAL
from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.cartesian import CartesianForce, cartesian_force, release_velocity
from looping_pendulum.reference_ode.geometry import light_position
from looping_pendulum.reference_ode.parameters import Parameters, Release

Vector = tuple[float, float]
"""x and y components, in the unit of the quantity."""
MIN_TIME_STEP = 1e-8
"""Shortest step that is tried where Newton's iterations fail [s]."""
UNUSED_RADIUS = 0.01
"""Radius of gyration of the masses [m], which strings pull at their centres, so that they never turn."""


@dataclass(frozen=True, kw_only=True)
class Mass:
    """A point mass, by the numbers under which Exudyn knows its parts."""

    node: int
    marker: int
    load: int
    weight: float
    """[N]"""


class ExudynSystem:
    """The two masses, the rod's centre, and the solver; a variant adds the string before `start`."""

    def __init__(self, parameters: Parameters, settings: SolverSettings, *, light_mass: float, end_length: float) -> None:
        import exudyn
        from exudyn import itemInterface

        p = parameters
        self.exudyn, self.items, self._settings = exudyn, itemInterface, settings
        self._container = exudyn.SystemContainer()
        self.mbs = self._container.AddSystem()
        self._force: CartesianForce | None = cartesian_force(p)
        self._has_string = p.release is not Release.DROP
        self._gravity = p.coefficients["gravity"]
        self._samples = 0
        self._end_distance, self._has_ended = math.hypot(end_length, p.rod_radius), False
        vx, vy, heavy_vy = release_velocity(p)
        ground = self.mbs.AddObject(itemInterface.ObjectGround())
        self.rod_marker = self.mbs.AddMarker(itemInterface.MarkerBodyRigid(bodyNumber=ground))
        self._light_position = light_position(math, p.free_length, p.release_angle, p.rod_radius)
        self._heavy_position = (p.rod_radius, -p.hanging_length)
        self.light = self._add_mass(self._light_position, (vx, vy), light_mass)
        self.heavy: Mass | None = None
        if p.release is Release.HELD:
            self.heavy_marker = self.mbs.AddMarker(
                itemInterface.MarkerBodyRigid(bodyNumber=ground, localPosition=[*self._heavy_position, 0.0])
            )
        else:
            self.heavy = self._add_mass(self._heavy_position, (0.0, heavy_vy), p.heavy_mass)
            self.heavy_marker = self.heavy.marker

    def start(self, before_step: Callable[[tuple[float, ...]], None] | None = None) -> None:
        """Assemble the system and start the solver, at the moment of release.

        ``before_step`` is called before each step with what `read_masses` returns.
        """
        self._before_step = before_step
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

    def read_masses(self) -> tuple[float, ...]:
        """Return positions [m] and velocities [m/s] of both masses, the light one's first."""
        heavy = (*self._heavy_position, 0.0, 0.0) if self.heavy is None else self._read(self.heavy)
        return (*self._read(self.light), *heavy)

    def _add_mass(self, position: Sequence[float], velocity: Vector, mass: float) -> Mass:
        items, mbs = self.items, self.mbs
        # A rigid body that nothing turns, because a reeving system takes no point masses
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
        masses = self.read_masses()
        # Nearer to the rod than that, a reeving system finds no tangent, and a cable bends by a turn within a segment
        self._has_ended = self._has_string and math.hypot(masses[0], masses[1]) <= self._end_distance
        if self._has_ended:
            return False
        if self._before_step is not None:
            self._before_step(masses)
        if self._force is not None:
            x, y, vx, vy, _, _, _, heavy_vy = masses
            fx, fy, heavy_fy = self._force(time, x, y, vx, vy, heavy_vy)
            mbs.SetLoadParameter(self.light.load, "loadVector", [fx, fy - self.light.weight, 0.0])
            if self.heavy is not None:
                mbs.SetLoadParameter(self.heavy.load, "loadVector", [0.0, heavy_fy - self.heavy.weight, 0.0])
        return True
