"""Drake: beads that slide over a static sphere under Coulomb contact, by its discrete solver; no capstan law is fed in.

Offered through the entry point that a third party uses. Beads are added where the straight string is about to touch the rod,
and removed behind it. A bead on a straight part carries no lateral load, so adding or removing it there changes no force; beads
that bear on the rod are moved by Drake alone. Drake's distance constraint pushes as well as it pulls: the rig deactivates that
of a straight part which would be slack, until its ends are as far apart as the string is long.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from looping_pendulum.engines.chain import (
    NO_STOP,
    STRAIGHT_STRING,
    BeadChainSettings,
    BeadCountRule,
    SlipGauge,
    bead_abilities,
    beads_at_release,
    bend_rungs,
    point_on_string,
    polygon_friction,
    polygon_radius,
)
from looping_pendulum.engines.protocol import SAMPLE_INTERVAL, Engine, Profile, TunedEngine
from looping_pendulum.engines.studies import Studies, studies_from_rows
from looping_pendulum.pages.numbers import quantity
from looping_pendulum.reference_ode.cartesian import cartesian_force, release_velocity
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.scenarios.scenario import Scenario

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


LIGHT, HEAVY = 0, 1
"""Indices of the string's two ends."""


class DrakeChainRig:
    """The apparatus in Drake, with a plant for every number of beads, built when it is first needed.

    A Drake plant cannot change once it is finalized, so a bead that is added or removed means another plant.
    """

    def __init__(self, parameters: Parameters, settings: DrakeChainSettings) -> None:
        p, s = parameters, settings
        self._parameters, self._settings = p, s
        self._node_radius = s.node_radius(p.rod_radius)
        self._straight_parts = BeadCountRule(p.rod_radius, s.bend, self._node_radius)
        self._link_length = self._straight_parts.link_length
        self._has_string, self._is_held = p.release is not Release.DROP, p.release is Release.HELD
        self._ends = (LIGHT,) if self._is_held else (LIGHT, HEAVY)
        """Ends of the string whose mass can move."""
        self._masses = (p.light_mass, p.heavy_mass)
        self._gravity = np.array([0.0, p.coefficients["gravity"]])
        self._force = cartesian_force(p)
        self._applied_forces = np.zeros((2, 2))  # forces of the effects on light and heavy mass [N]
        self._taut = [True, True]
        self._extra_length = [0.0, 0.0]  # of a straight part beyond its rest length when it became taut again [m]
        self._models: dict[int, ChainModel] = {}
        self._slip = SlipGauge()
        self._groups = 0
        self._place_chain()

    def advance(self) -> None:
        """Advance by one sample interval, in groups of steps."""
        before = self._mass_velocities()
        for _ in range(self._settings.groups_per_sample):
            if self._has_string:
                for end in (LIGHT, HEAVY):
                    self._update_beads(end)
            self._apply_forces()
            self._model.step(self._settings.steps_per_group)
            self._groups += 1
            self._positions, self._velocities = self._model.positions(), self._model.velocities()
            if self._has_string:
                self._reactivate_taut_parts()
        if self._has_string:
            self._deactivate_pushing_parts(before)

    def read(self) -> tuple[float, ...]:
        """Return positions [m], velocities [m/s], string stretch and slip [m]: `COLUMNS` without the time."""
        x, y = self._positions[:2].tolist()
        vx, vy = self._velocities[:2].tolist()
        heavy_x, heavy_y = self._mass_position(HEAVY).tolist()
        return (x, y, vx, vy, heavy_x, heavy_y, 0.0, float(self._velocities[-1]), *self._read_string())

    def _place_chain(self) -> None:
        """Place the chain along the taut string, with the release's velocities."""
        p, beads, sliding = self._parameters, np.empty((0, 2)), np.empty((0, 2))
        if self._has_string:
            beads, sliding = beads_at_release(p, self._settings.bend, self._node_radius)
        light, heavy = point_on_string(p, 0.0, p.rod_radius), (p.rod_radius, -p.hanging_length)
        row = np.array([light, *beads, heavy])
        self.lengths: list[float] = np.linalg.norm(np.diff(row, axis=0), axis=1).tolist()
        vx, vy, heavy_v = release_velocity(p)
        positions = np.array([*light, *beads.ravel(), heavy[1]])
        self._use_model(len(beads), positions, np.array([vx, vy, *sliding.ravel(), heavy_v]))

    def _use_model(self, beads: int, positions: Array, velocities: Array) -> None:
        """Continue with the plant of ``beads`` beads, in the state of these coordinates [m] and velocities [m/s]."""
        if beads not in self._models:
            self._models[beads] = ChainModel(self._parameters, self._settings, beads)
        self._beads, self._model = beads, self._models[beads]
        self._positions, self._velocities = positions, velocities
        self._model.set_state(positions, velocities)
        if self._has_string:
            for link in range(1, beads):
                self._model.set_link(link, self.lengths[link], True)
            self._update_straight_link(LIGHT)
            self._update_straight_link(HEAVY)

    def _update_straight_link(self, end: int) -> None:
        """Set the length and the activity of the straight link at ``end`` in the plant."""
        link = self._straight_index(end)
        self._model.set_link(link, self.lengths[link] + self._extra_length[end], self._taut[end])

    def _straight_index(self, end: int) -> int:
        """Return the index of the straight link at ``end``."""
        return 0 if end == LIGHT else self._beads

    def _apply_forces(self) -> None:
        """Set the effects' forces on both masses."""
        if self._force is None:
            return
        time = self._groups * self._settings.group_time
        x, y = self._positions[:2].tolist()
        vx, vy = self._velocities[:2].tolist()
        fx, fy, heavy_fy = self._force(time, x, y, vx, vy, float(self._velocities[-1]))
        self._applied_forces[:] = (fx, fy), (0.0, heavy_fy)
        self._model.apply_forces((fx, fy), heavy_fy)

    def _mass_position(self, end: int) -> Array:
        """Return the position [m] of the mass at ``end``."""
        return self._positions[:2] if end == LIGHT else np.array([self._parameters.rod_radius, self._positions[-1]])

    def _mass_velocities(self) -> Array:
        """Return the velocities of both masses [m/s], shape (2, 2)."""
        return np.array([self._velocities[:2], (0.0, self._velocities[-1])])

    def _bead_part(self, row: Array, end: int, index: int) -> Array:
        """Return the x and y components in ``row`` of the bead that is number ``index`` from ``end``."""
        first = 2 + 2 * (index if end == LIGHT else self._beads - 1 - index)
        return row[first : first + 2]

    def _update_beads(self, end: int) -> None:
        """Add or remove a bead on the straight part at ``end``, if one is due."""
        # The beads of a slack part do not lie on the line to its mass
        if not self._taut[end]:
            return
        link = self._straight_index(end)
        mass, outermost, following = (
            self._mass_position(end),
            self._bead_part(self._positions, end, 0),
            self._bead_part(self._positions, end, 1),
        )
        change = self._straight_parts.bead_count_change(mass, outermost, following, self.lengths[link], self._beads)
        if change > 0:
            self._add_bead(end, self._link_length / math.dist(mass, outermost))
        elif change < 0:
            self._remove_bead(end)

    def _add_bead(self, end: int, share: float) -> None:
        """Add a bead on the straight part at ``end``, a fraction ``share`` of the way from the outermost bead to the mass."""
        link, at = self._straight_index(end), 2 if end == LIGHT else 2 + 2 * self._beads
        position, velocity = self._bead_part(self._positions, end, 0), self._bead_part(self._velocities, end, 0)
        position = position + share * (self._mass_position(end) - position)
        velocity = velocity + share * (self._mass_velocities()[end] - velocity)
        rest = self.lengths[link] - self._link_length
        self.lengths[link : link + 1] = [rest, self._link_length] if end == LIGHT else [self._link_length, rest]
        self._use_model(self._beads + 1, np.insert(self._positions, at, position), np.insert(self._velocities, at, velocity))

    def _remove_bead(self, end: int) -> None:
        """Remove the outermost bead at ``end``, so that its link becomes part of the straight string."""
        first = 2 if end == LIGHT else 2 * self._beads
        removed = [first, first + 1]
        joined = slice(0, 2) if end == LIGHT else slice(self._beads - 1, self._beads + 1)
        self.lengths[joined] = [math.fsum(self.lengths[joined])]
        self._use_model(self._beads - 1, np.delete(self._positions, removed), np.delete(self._velocities, removed))

    def _deactivate_pushing_parts(self, before: Array) -> None:
        """Deactivate a straight part that pushed its mass on average over the last sample interval.

        Over a shorter time, the jolts of beads that land would look like a push.

        Parameters
        ----------
        before
            Velocities of both masses a sample interval ago [m/s], shape (2, 2).
        """
        # Acceleration without gravity's part, of which the string's pull and the effects are the causes.
        specific_force = (self._mass_velocities() - before) / SAMPLE_INTERVAL + self._gravity
        pull = np.array(self._masses)[:, np.newaxis] * specific_force - self._applied_forces
        for end in self._ends:
            if (
                self._taut[end]
                and float(pull[end] @ (self._bead_part(self._positions, end, 0) - self._mass_position(end))) < 0.0
            ):
                self._taut[end] = False
                self._update_straight_link(end)

    def _reactivate_taut_parts(self) -> None:
        """Activate a slack straight part again where its ends are as far apart as its string is long."""
        for end in self._ends:
            if not self._taut[end]:
                excess = (
                    math.dist(self._mass_position(end), self._bead_part(self._positions, end, 0))
                    - self.lengths[self._straight_index(end)]
                )
                if excess >= 0.0:
                    # Correcting the excess in one step would give the mass a large velocity, so it remains.
                    self._taut[end], self._extra_length[end] = True, excess
                    self._update_straight_link(end)

    def _read_string(self) -> tuple[float, float]:
        """Return the string's stretch beyond its rest length (negative: it hangs slack) and its slip over the rod [m]."""
        if not self._has_string:
            return math.nan, math.nan
        row = np.vstack([self._positions[:-1].reshape(-1, 2), self._mass_position(HEAVY)])
        stretch = float(np.linalg.norm(np.diff(row, axis=0), axis=1).sum()) - math.fsum(self.lengths)
        return stretch, self._slip.read(row.tolist(), self.lengths)


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


class DrakeChain(TunedEngine):
    """A chain of beads over a static sphere."""

    name = "drake"
    distribution = "drake"
    variant = "chain"
    settings_by_profile = SETTINGS
    settings: DrakeChainSettings
    abilities = bead_abilities(
        "drake:chain",
        quick_cost=25.0,
        rod="static sphere",
        stick_slip="friction is regularised below the stiction tolerance",
        packages=("pydrake",),
        summary="Beads on distance constraints over a static sphere, one constraint for each straight part of the string.",
        limits=_LIMITS,
        bead_mass_ratio=SETTINGS[Profile.QUICK].bead_mass_ratio,
        main=False,
    )

    def build(self, scenario: Scenario) -> DrakeChainRig:
        """Build the scenario's apparatus at the moment of release."""
        return DrakeChainRig(scenario.parameters, self.settings)

    def studies(self) -> Studies:
        """Return ladders of step, links, mass and contact, Drake's defaults, and the adapter's choices."""
        s = self.settings
        return studies_from_rows(
            self,
            ladders=(
                ("time_step", "s", (5e-5, 2e-5, 1e-5, 5e-6)),
                bend_rungs(s, (0.5, 0.4, 0.3, 0.24)),
                ("bead_mass_ratio", "", (2e-3, 1e-3, 5e-4, 2e-4)),
                ("contact_stiffness", "N/m", (1e4, 2e4, 5e4, 1e5, 2e5)),
                ("stiction_tolerance", "m/s", (1e-2, 1e-3, 1e-4, 1e-5)),
            ),
            defaults=(
                (
                    "time_step",
                    "1 ms",
                    quantity(s.time_step, "s", 3),
                    "length of a step",
                    {"time_step": SAMPLE_INTERVAL, "steps_per_group": 1},
                ),
                (
                    "discrete_contact_approximation",
                    "lagged",
                    s.contact_approximation,
                    "which convex problem stands for Coulomb's law; lagged takes the friction's bound from the step before",
                    {"contact_approximation": "lagged"},
                ),
                (
                    "point_stiffness",
                    "5e5 N/m (1e6 of either body, in a row)",
                    f"{s.contact_stiffness:g} N/m",
                    "how far a bead sinks in",
                    {"contact_stiffness": 5e5},
                ),
                (
                    "hunt_crossley_dissipation",
                    "50 s/m",
                    f"{s.contact_dissipation:g} s/m",
                    "how fast a bead that sinks in or comes off is braked",
                    {"contact_dissipation": 50.0},
                ),
            ),
            choices=(
                ("convex approximation of Coulomb's law", s.contact_approximation, "sap", {"contact_approximation": "sap"}),
                ("rod", f"a {s.rod_shape}", "a cylinder", {"rod_shape": "cylinder"}),
                ("radius and coefficient", "corrected for the polygon", "the circle's own", {"polygon": False}),
                ("bead radius", quantity(s.bead_radius, "m", 3), "0.5 mm", {"bead_radius": 5e-4}),
                ("steps between two updates of drag and beads", f"{s.steps_per_group}", "1", {"steps_per_group": 1}),
            ),
        )


def engines(profile: Profile) -> list[Engine]:
    """Return every variant of this engine with the settings of ``profile``."""
    return [DrakeChain(profile=profile)]
