"""Drake: a distance constraint, the obvious string, pushes as well as pulls.

A mass starts at rest 0.5 m above the point to which a string of 0.5 m ties it. A string would go slack and let it fall; Drake's
distance constraint is a rod, and carries the mass. (Drake has no constraint that only pulls.)

Closed form: 0.19620 m = g t^2 / 2, height of fall in 0.2 s
Observed: 0.00000 m with drake 1.51.1, give or take 1e-4
Mended: within 0.01 m of the closed form
"""

from importlib.metadata import version

from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import PrismaticJoint, SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

GRAVITY, TIME, LENGTH = 9.81, 0.2, 0.5
LIMIT = 0.01
closed_form = 0.5 * GRAVITY * TIME**2

builder = DiagramBuilder()
config = MultibodyPlantConfig(time_step=1e-4, discrete_contact_approximation="similar")
plant, _ = AddMultibodyPlant(config, builder)
plant.mutable_gravity_field().set_gravity_vector([0, 0, -GRAVITY])
hook = plant.AddRigidBody("hook", SpatialInertia.SolidSphereWithMass(1.0, 0.01))
plant.WeldFrames(plant.world_frame(), hook.body_frame(), RigidTransform())  # 1.51.1 crashes on a constraint to the world
mass = plant.AddRigidBody("mass", SpatialInertia.SolidSphereWithMass(0.01, 0.01))
slide = plant.AddJoint(PrismaticJoint("slide", plant.world_frame(), mass.body_frame(), [0, 0, 1]))
plant.AddDistanceConstraint(hook, [0, 0, 0], mass, [0, 0, 0], LENGTH)
plant.Finalize()
diagram = builder.Build()
simulator = Simulator(diagram)
context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
slide.set_translation(context, LENGTH)
simulator.AdvanceTo(TIME)
observed = LENGTH - slide.get_translation(context)

holds = not abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f} m, mended within {LIMIT} m")
print(f"observed {observed:.5f} m with drake {version('drake')}: the claim {'holds' if holds else 'is mended'}")
raise SystemExit(int(holds))
