"""The apparatus as a Drake plant: masses and beads on two prismatic joints each, distance constraints between neighbours."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from looping_pendulum.engines.chain import BeadChainSettings, polygon_friction, polygon_radius
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release

BODY_ORIGIN = np.zeros(3)
"""Point of a body at which its links are attached, in the body's frame [m]."""


@dataclass(frozen=True, kw_only=True)
class DrakeChainSettings(BeadChainSettings):
    """Numerical settings of the bead chain, in SI units."""

    contact_stiffness: float
    """Stiffness of the contact of a bead with the rod [N/m]. Stiffer: beads bounce as they land; softer: they sink in."""
    contact_approximation: str = "similar"
    """Which convex approximation of Coulomb's law Drake solves: "similar", "lagged" or "sap"."""
    contact_dissipation: float = 10.0
    """Hunt and Crossley's dissipation of the same contact [s/m]."""
    stiction_tolerance: float = 1e-4
    """Speed below which friction is regularised, so that a sticking contact creeps [m/s]."""
    rod_shape: str = "sphere"
    """Collision shape, "sphere" or "cylinder"; both have the same section in the plane of motion."""
    polygon: bool = True
    """Whether the rod's radius and coefficient are corrected for the polygon that the links are (`engines.chain`)."""

    def node_radius(self, rod_radius: float) -> float:
        """Return the distance of a bead on the rod from the rod's centre [m]."""
        return float(polygon_radius(rod_radius, self.bend)) if self.polygon else rod_radius

    def contact_friction(self, friction: float) -> float:
        """Return the contacts' coefficient for a string with the coefficient ``friction``."""
        return polygon_friction(friction, self.bend) if self.polygon else friction


SETTINGS = {
    Profile.QUICK: DrakeChainSettings(time_step=2e-5, bend=0.4, bead_mass_ratio=5e-4, contact_stiffness=2e4),
    Profile.ACCURATE: DrakeChainSettings(time_step=1e-5, bend=0.3, bead_mass_ratio=2e-4, contact_stiffness=5e4),
}


class ChainModel:
    """One plant with a fixed number of beads, and its state.

    Coordinates are x and y of the light mass and of every bead, then y of the heavy mass.
    """

    def __init__(self, parameters: Parameters, settings: DrakeChainSettings, beads: int) -> None:
        from pydrake.multibody.plant import AddMultibodyPlant, DistanceConstraintParams, MultibodyPlantConfig
        from pydrake.systems.framework import DiagramBuilder

        p, s = parameters, settings
        builder = DiagramBuilder()
        config = MultibodyPlantConfig(
            time_step=s.time_step,
            discrete_contact_approximation=s.contact_approximation,
            stiction_tolerance=s.stiction_tolerance,
            contact_model="point",
            use_sampled_output_ports=False,
        )
        self._plant: Any
        self._plant, scene = AddMultibodyPlant(config, builder)
        self._plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -p.coefficients["gravity"]])
        self._link_parameters = DistanceConstraintParams
        self._is_held, self._held_height = p.release is Release.HELD, -p.hanging_length
        self._bodies = self._add_bodies(p, s, beads, scene)
        self._links: list[Any] = []
        if p.release is not Release.DROP:
            pairs = zip(self._bodies[:-1], self._bodies[1:], strict=True)
            # 1.0 stands for the length, which the rig sets (`set_link`)
            self._links = [self._plant.AddDistanceConstraint(a, BODY_ORIGIN, b, BODY_ORIGIN, 1.0) for a, b in pairs]
        self._plant.Finalize()
        self._diagram = builder.Build()
        self._root = self._diagram.CreateDefaultContext()
        self._context = self._plant.GetMyMutableContextFromRoot(self._root)
        # Memory for the state after a step, which every step uses again
        self._next = self._diagram.AllocateDiscreteVariables()
        self._port = self._plant.get_applied_generalized_force_input_port()

    def _add_bodies(self, p: Parameters, s: DrakeChainSettings, beads: int, scene: Any) -> list[Any]:
        """Add light mass, beads and heavy mass, and the rod with its contacts; return the bodies in the string's order."""
        from pydrake.geometry import (
            AddContactMaterial,
            CollisionFilterDeclaration,
            Cylinder,
            GeometrySet,
            ProximityProperties,
            Sphere,
        )
        from pydrake.math import RigidTransform, RotationMatrix
        from pydrake.multibody.plant import CoulombFriction

        friction = s.contact_friction(p.coefficients["kinetic_friction"])
        surface = ProximityProperties()  # of bead and rod alike: Drake's mean of two equal coefficients is their own
        AddContactMaterial(
            dissipation=s.contact_dissipation,
            point_stiffness=2 * s.contact_stiffness,  # Drake takes two equal stiffnesses in series: half of one
            friction=CoulombFriction(friction, friction),
            properties=surface,
        )
        radius = s.node_radius(p.rod_radius) - s.bead_radius
        rod = Sphere(radius) if s.rod_shape == "sphere" else Cylinder(radius, 0.1)
        # Drake's cylinder lies along z, the rod along y; a sphere does not care
        pose = RigidTransform(RotationMatrix.MakeXRotation(math.pi / 2), BODY_ORIGIN)
        spheres = GeometrySet()
        self._plant.RegisterCollisionGeometry(self._plant.world_body(), pose, rod, "rod", surface)
        bodies = [self._add_body("light", p.light_mass, "xy")]
        for i in range(beads):
            bodies.append(self._add_body(f"bead{i}", s.bead_mass_ratio * p.light_mass, "xy"))
            sphere = Sphere(s.bead_radius)
            spheres.Add(self._plant.RegisterCollisionGeometry(bodies[-1], RigidTransform(), sphere, f"sphere{i}", surface))
        bodies.append(self._add_held(p) if self._is_held else self._add_body("heavy", p.heavy_mass, "y", x=p.rod_radius))
        scene.collision_filter_manager().Apply(CollisionFilterDeclaration().ExcludeWithin(spheres))
        return bodies

    def _add_body(self, name: str, mass: float, axes: str, x: float = 0.0) -> Any:
        """Add a body that moves along ``axes``; our y is Drake's z."""
        from pydrake.math import RigidTransform
        from pydrake.multibody.tree import FixedOffsetFrame, PrismaticJoint, SpatialInertia

        base = self._plant.world_body().body_frame()
        parent = self._plant.AddFrame(FixedOffsetFrame(f"{name}_base", base, RigidTransform([x, 0.0, 0.0])))
        for axis in axes:
            last = axis == axes[-1]
            # Only the body behind the last slide has the mass. The radius of 1 cm has no influence, as no joint lets a body
            # rotate.
            inertia = SpatialInertia.SolidSphereWithMass(mass, 1e-2) if last else SpatialInertia.Zero()
            body = self._plant.AddRigidBody(name if last else f"{name}_slide", inertia)
            along = [1.0, 0.0, 0.0] if axis == "x" else [0.0, 0.0, 1.0]
            self._plant.AddJoint(PrismaticJoint(f"{name}_{axis}", parent, body.body_frame(), along))
            parent = body.body_frame()
        return body

    def _add_held(self, p: Parameters) -> Any:
        """Add a heavy mass that is held, as a body that is welded to the world.

        Drake 1.51.1 segfaults on a distance constraint to the world body itself, and with a locked joint beside a contact.
        """
        from pydrake.math import RigidTransform
        from pydrake.multibody.tree import SpatialInertia

        body = self._plant.AddRigidBody("heavy", SpatialInertia.SolidSphereWithMass(p.heavy_mass, 1e-2))
        pose = RigidTransform([p.rod_radius, 0.0, self._held_height])
        self._plant.WeldFrames(self._plant.world_body().body_frame(), body.body_frame(), pose)
        return body

    def set_state(self, positions: Array, velocities: Array) -> None:
        """Set coordinates [m] and velocities [m/s], shape (2 beads + 3,)."""
        free = self._plant.num_velocities()
        self._plant.SetPositions(self._context, positions[:free])
        self._plant.SetVelocities(self._context, velocities[:free])

    def positions(self) -> Array:
        """Return the coordinates [m], shape (2 beads + 3,)."""
        positions = self._plant.GetPositions(self._context)
        return np.append(positions, self._held_height) if self._is_held else np.array(positions)

    def velocities(self) -> Array:
        """Return the velocities [m/s], shape (2 beads + 3,)."""
        velocities = self._plant.GetVelocities(self._context)
        return np.append(velocities, 0.0) if self._is_held else np.array(velocities)

    def set_link(self, index: int, length: float, taut: bool) -> None:
        """Set the length [m] of link ``index``, and whether it acts: one that is not ``taut`` exerts no force."""
        a, b = self._bodies[index : index + 2]
        rigid = self._link_parameters(a.index(), BODY_ORIGIN, b.index(), BODY_ORIGIN, length, math.inf, 0.0)
        self._plant.SetDistanceConstraintParams(self._context, self._links[index], rigid)
        self._plant.SetConstraintActiveStatus(self._context, self._links[index], taut)

    def apply_forces(self, light: Sequence[float], heavy: float) -> None:
        """Set the forces [N] on the light mass, (x, y), and on the heavy one, y, from the next step on."""
        forces = np.zeros(self._plant.num_velocities())
        forces[:2] = light
        if not self._is_held:
            forces[-1] = heavy
        self._port.FixValue(self._context, forces)

    def step(self, count: int) -> None:
        """Take ``count`` steps."""
        for _ in range(count):
            self._diagram.CalcForcedDiscreteVariableUpdate(self._root, self._next)
            self._root.SetDiscreteState(self._next)
