"""Drake: a box creeps down a slope on which friction should hold it, at a share of the stiction tolerance.

The slope's gradient is 0.2 and the friction coefficient 0.4. Below the stiction tolerance, 1 mm/s by default, friction grows in
proportion to the speed, and so holds nothing at rest.

Closed form: 0.00000 mm, way of a box that is held, in 1 s
Observed: 0.80350 mm with drake 1.51.1, give or take 0.02
Mended: within 0.02 mm of the closed form
Study: drake:chain
"""

import math
from importlib.metadata import version

from pydrake.geometry import AddContactMaterial, Box, ProximityProperties
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlant, CoulombFriction, MultibodyPlantConfig
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

GRADIENT, FRICTION, GRAVITY = 0.2, 0.4, 9.81
LIMIT = 0.02
closed_form = 0.0

builder = DiagramBuilder()
plant, _ = AddMultibodyPlant(MultibodyPlantConfig(time_step=1e-3), builder)
slope = math.atan(GRADIENT)
plant.mutable_gravity_field().set_gravity_vector([GRAVITY * math.sin(slope), 0, -GRAVITY * math.cos(slope)])
surface = ProximityProperties()
AddContactMaterial(friction=CoulombFriction(FRICTION, FRICTION), properties=surface)
plant.RegisterCollisionGeometry(plant.world_body(), RigidTransform([0, 0, -0.1]), Box(1, 1, 0.2), "slope", surface)
box = plant.AddRigidBody("box", SpatialInertia.SolidBoxWithMass(0.1, 0.1, 0.1, 0.02))
plant.RegisterCollisionGeometry(box, RigidTransform(), Box(0.1, 0.1, 0.02), "box", surface)
plant.Finalize()
diagram = builder.Build()
simulator = Simulator(diagram)
context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
plant.SetFreeBodyPose(context, box, RigidTransform([0, 0, 0.01]))
simulator.AdvanceTo(1.0)  # it settles into the soft contact
start = plant.EvalBodyPoseInWorld(context, box).translation()[0]
simulator.AdvanceTo(2.0)
observed = 1e3 * (plant.EvalBodyPoseInWorld(context, box).translation()[0] - start)

holds = not abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f} mm, mended within {LIMIT} mm")
print(f"observed {observed:.5f} mm with drake {version('drake')}: the claim {'holds' if holds else 'is mended'}")
raise SystemExit(int(holds))
