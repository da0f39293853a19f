"""Drake: beads that slide over a static sphere under Coulomb contact, by its discrete solver; no capstan law is fed in.

Offered through the entry point that a third party uses. Drake's distance constraint pushes as well as it pulls: the world
deactivates that of a straight part which would be slack, until its ends are as far apart as the string is long.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from looping_pendulum.engines.bead_rig import HEAVY, LIGHT, OUTERMOST, Forces, RebuiltRig
from looping_pendulum.engines.chain import (
    NO_STOP,
    STRAIGHT_STRING,
    BeadChainSettings,
    bead_abilities,
    bead_choices,
    bend_rungs,
)
from looping_pendulum.engines.protocol import Engine, Profile, SteppedEngine
from looping_pendulum.engines.studies import Ladder, Studies, Variation, default_row
from looping_pendulum.pages.numbers import quantity
from looping_pendulum.reference_ode.cartesian import Vector
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.runs.trajectory import SAMPLE_INTERVAL

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
        self._is_held = p.release is Release.HELD
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
        pose = RigidTransform([p.rod_radius, 0.0, -p.hanging_length])
        self._plant.WeldFrames(self._plant.world_body().body_frame(), body.body_frame(), pose)
        return body

    def set_state(self, positions: list[float], velocities: list[float]) -> None:
        """Set coordinates [m] and velocities [m/s]."""
        self._plant.SetPositions(self._context, positions)
        self._plant.SetVelocities(self._context, velocities)

    def state(self) -> tuple[list[float], list[float]]:
        """Return the coordinates [m] and velocities [m/s]."""
        return self._plant.GetPositions(self._context).tolist(), self._plant.GetVelocities(self._context).tolist()

    def set_link(self, index: int, length: float, taut: bool) -> None:
        """Set the length [m] of link ``index``, and whether it acts: one that is not ``taut`` exerts no force."""
        a, b = self._bodies[index : index + 2]
        rigid = self._link_parameters(a.index(), BODY_ORIGIN, b.index(), BODY_ORIGIN, length, math.inf, 0.0)
        self._plant.SetDistanceConstraintParams(self._context, self._links[index], rigid)
        self._plant.SetConstraintActiveStatus(self._context, self._links[index], taut)

    def apply_forces(self, forces: Forces) -> None:
        """Set the forces on the masses, from the next step on."""
        values = np.zeros(self._plant.num_velocities())
        values[:2], heavy = forces
        if not self._is_held:
            values[-1] = heavy
        self._port.FixValue(self._context, values)

    def step(self, count: int) -> None:
        """Take ``count`` steps."""
        for _ in range(count):
            self._diagram.CalcForcedDiscreteVariableUpdate(self._root, self._next)
            self._root.SetDiscreteState(self._next)


class DrakeRig(RebuiltRig):
    """The apparatus in Drake, with a plant for every number of beads, as a plant cannot change once it is finalized."""

    _model: ChainModel

    def _create_world(self) -> None:
        self._ends = (LIGHT,) if self._is_held else (LIGHT, HEAVY)
        """Ends of the string whose mass can move."""
        self._taut = {LIGHT: True, HEAVY: True}
        self._extra_length = {LIGHT: 0.0, HEAVY: 0.0}  # of a straight part beyond its rest length when it became taut [m]

    def _place(self, positions: Sequence[Vector], velocities: Sequence[Vector]) -> None:
        super()._place(positions, velocities)
        self._last_velocities = {end: self._velocity(end) for end in self._ends}

    def _step(self, count: int, forces: Forces | None) -> None:
        super()._step(count, forces)
        if not self._has_string:
            return
        self._reactivate_taut_parts()
        if (self._groups + 1) % self._settings.groups_per_sample == 0:
            self._deactivate_pushing_parts(forces)

    def _is_slack(self, end: int) -> bool:
        return not self._taut[end]

    def _build_model(self, beads: int) -> ChainModel:
        return ChainModel(self._parameters, self._settings, beads)

    def _start_model(self) -> None:
        self._model.set_state(*map(self._flat, self._rows[:2]))
        for link, length in enumerate(self._lengths[1:-1], start=1):
            self._model.set_link(link, length, True)
        if self._has_string:
            self._update_straight_link(LIGHT)
            self._update_straight_link(HEAVY)

    def _coordinates(self) -> Sequence[list[float]]:
        return self._model.state()

    def _advance_model(self, count: int, forces: Forces | None) -> None:
        if forces is not None:
            self._model.apply_forces(forces)
        self._model.step(count)

    def _update_straight_link(self, end: int) -> None:
        """Set the length and the activity of the straight link at ``end`` in the plant."""
        link = 0 if end == LIGHT else len(self._lengths) - 1
        self._model.set_link(link, self._lengths[end] + self._extra_length[end], self._taut[end])

    def _deactivate_pushing_parts(self, forces: Forces | None) -> None:
        """Deactivate a straight part that pushed its mass on average over the last sample interval, with ``forces`` at its end.

        Over a shorter time, the jolts of beads that land would look like a push.
        """
        p = self._parameters
        light_force, heavy_force = forces or ((0.0, 0.0), 0.0)
        for end, mass, applied in ((LIGHT, p.light_mass, light_force), (HEAVY, p.heavy_mass, (0.0, heavy_force))):
            if end not in self._ends:
                continue
            velocity = self._velocity(end)
            # Acceleration without gravity's part, of which the string's pull and the effects are the causes
            specific_force = np.subtract(velocity, self._last_velocities[end]) / SAMPLE_INTERVAL
            specific_force += (0.0, p.coefficients["gravity"])
            pull = mass * specific_force - applied
            self._last_velocities[end] = velocity
            towards_bead = np.subtract(self._position(OUTERMOST[end]), self._position(end))
            if self._taut[end] and float(pull @ towards_bead) < 0.0:
                self._taut[end] = False
                self._update_straight_link(end)

    def _reactivate_taut_parts(self) -> None:
        """Activate a slack straight part again where its ends are as far apart as its string is long."""
        for end in self._ends:
            if not self._taut[end]:
                excess = math.dist(self._position(end), self._position(OUTERMOST[end])) - self._lengths[end]
                if excess >= 0.0:
                    # Correcting the excess in one step would give the mass a large velocity, so it remains.
                    self._taut[end], self._extra_length[end] = True, excess
                    self._update_straight_link(end)


_LIMITS = (
    "one Coulomb coefficient only: Drake's discrete solver ignores the static one, so where static_friction differs from "
    "kinetic_friction, the kinetic one acts in both",
    "friction that is regularised creeps, below the stiction tolerance",
    STRAIGHT_STRING,
    "Drake's distance constraint pushes too: the adapter switches a straight part off where it would, up to 1 ms late, and a "
    "string that becomes taut again stays as much longer as it was when it was caught",
    "a slack straight part passes through the rod: one that turns further while it is slack is caught late",
    "beads bounce where the light mass pulls little: the string's way over the rod is longer for some milliseconds",
    NO_STOP,
)


class DrakeChain(SteppedEngine):
    """A chain of beads over a static sphere."""

    name = "drake"
    distribution = "drake"
    settings_by_profile = SETTINGS
    variant = "chain"
    rig = DrakeRig
    settings: DrakeChainSettings
    abilities = bead_abilities(
        "drake:chain",
        rod="static sphere",
        stick_slip="friction is regularised below the stiction tolerance",
        packages=("pydrake",),
        summary="Beads on distance constraints over a static sphere, one constraint for each straight part of the string.",
        limits=_LIMITS,
        bead_mass_ratio=SETTINGS[Profile.QUICK].bead_mass_ratio,
        main=False,
    )

    def studies(self) -> Studies:
        """Return ladders of step, links, mass and contact, Drake's defaults, and the adapter's choices."""
        s = self.settings
        return Studies(
            ladders=(
                Ladder("time_step", "s", (5e-5, 2e-5, 1e-5, 5e-6)),
                bend_rungs(s, (0.5, 0.4, 0.3, 0.24)),
                Ladder("bead_mass_ratio", "", (2e-3, 1e-3, 5e-4, 2e-4)),
                Ladder("contact_stiffness", "N/m", (1e4, 2e4, 5e4, 1e5, 2e5)),
                Ladder("stiction_tolerance", "m/s", (1e-2, 1e-3, 1e-4, 1e-5)),
            ),
            defaults=(
                Variation(
                    "time_step",
                    quantity(s.time_step, "s", 3),
                    "1 ms",
                    {"time_step": SAMPLE_INTERVAL, "steps_per_group": 1},
                    "length of a step",
                ),
                default_row(
                    s,
                    "contact_approximation",
                    "lagged",
                    "discrete_contact_approximation",
                    "which convex problem stands for Coulomb's law; lagged takes the friction's bound from the step before",
                ),
                default_row(s, "contact_stiffness", 5e5, "point_stiffness", "how far a bead sinks in", "N/m"),
                default_row(s, "contact_dissipation", 50.0, "hunt_crossley_dissipation", "how much a bead is braked", "s/m"),
            ),
            choices=(
                Variation(
                    "convex approximation of Coulomb's law", s.contact_approximation, "sap", {"contact_approximation": "sap"}
                ),
                Variation("rod", f"a {s.rod_shape}", "a cylinder", {"rod_shape": "cylinder"}),
                *bead_choices(s),
            ),
        )


def engines(profile: Profile) -> list[Engine]:
    """Return every variant of this engine with the settings of ``profile``."""
    return [DrakeChain(profile=profile)]
