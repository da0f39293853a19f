"""Drake: beads on distance constraints over a sphere, with steps of 20 us and a stiction tolerance of 0.1 mm/s.

Two masses hang on one rope over a rod, half a turn. The heavy one weighs twice what friction could hold, so the rope slides;
weight and acceleration of each mass give the tension on its side. Below the stiction tolerance friction is regularised, so it
must be small beside the rope's speed; corners hold more than a curve, so their coefficient is made smaller.

Closed form: 2.90997 = exp(mu theta), ratio of the tensions
Observed: 2.90238 with drake 1.51.1, give or take 0.005
Reached: within 0.05 of the closed form
"""

import math
from importlib.metadata import version

from pydrake import geometry
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlant, CoulombFriction, MultibodyPlantConfig
from pydrake.multibody.tree import PrismaticJoint, SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

STEP, CORNERS, SPARE, BEAD, STIFFNESS = 2e-5, 8, 9, 1e-3, 2e4
MU, RADIUS, GRAVITY, TIME, LIGHT, LIMIT = 0.34, 0.00625, 9.81, 0.1, 0.01, 0.05
closed_form = math.exp(MU * math.pi)
HEAVY = 2 * LIGHT * closed_form
bend, link = math.pi / CORNERS, math.pi * RADIUS / CORNERS
node_radius = link / (2 * math.sin(bend / 2))  # so that one link winds up as much string as it is long
friction = math.tanh(MU * bend / 2) / math.tan(bend / 2)
arch = [(node_radius * math.cos(a), node_radius * math.sin(a)) for a in (bend * (i + 0.5) for i in range(CORNERS))]
places = [(RADIUS, -0.2), *arch, *((-RADIUS, -link * (i + 0.5)) for i in range(SPARE)), (-RADIUS, -0.2)]
builder = DiagramBuilder()
plant, scene = AddMultibodyPlant(MultibodyPlantConfig(time_step=STEP, stiction_tolerance=1e-4), builder)
plant.mutable_gravity_field().set_gravity_vector([0, 0, -GRAVITY])
surface = geometry.ProximityProperties()
geometry.AddContactMaterial(10, 2 * STIFFNESS, CoulombFriction(friction, friction), surface)  # dissipation 10 s/m
plant.RegisterCollisionGeometry(plant.world_body(), RigidTransform(), geometry.Sphere(node_radius - BEAD), "rod", surface)
row, beads = [], geometry.GeometrySet()
for i, mass in enumerate([HEAVY, *[5e-4 * LIGHT] * (len(places) - 2), LIGHT]):
    slide = plant.AddRigidBody(f"slide{i}", SpatialInertia.Zero())
    row.append(plant.AddRigidBody(f"body{i}", SpatialInertia.SolidSphereWithMass(mass, BEAD)))
    across = plant.AddJoint(PrismaticJoint(f"x{i}", plant.world_frame(), slide.body_frame(), [1, 0, 0]))
    up = plant.AddJoint(PrismaticJoint(f"z{i}", slide.body_frame(), row[i].body_frame(), [0, 0, 1]))
    across.set_default_translation(places[i][0])
    up.set_default_translation(places[i][1])
    if 0 < i < len(places) - 1:
        beads.Add(plant.RegisterCollisionGeometry(row[i], RigidTransform(), geometry.Sphere(BEAD), f"bead{i}", surface))
    if i:
        plant.AddDistanceConstraint(row[i - 1], [0, 0, 0], row[i], [0, 0, 0], math.dist(*places[i - 1 : i + 1]))
scene.collision_filter_manager().Apply(geometry.CollisionFilterDeclaration().ExcludeWithin(beads))
plant.Finalize()
simulator = Simulator(builder.Build())
simulator.AdvanceTo(TIME)
speeds = plant.GetVelocities(plant.GetMyContextFromRoot(simulator.get_context()))
observed = HEAVY * (GRAVITY + speeds[1] / TIME) / (LIGHT * (GRAVITY + speeds[-1] / TIME))

holds = abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f}, reached within {LIMIT}")
print(f"observed {observed:.5f} with drake {version('drake')}: the recipe {'holds' if holds else 'fails'}")
raise SystemExit(int(not holds))
