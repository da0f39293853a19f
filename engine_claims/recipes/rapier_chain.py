"""Rapier: point beads on ropes over a cylinder, with contacts that are stiff and computed anew in every step.

Two masses hang on one rope over a rod, half a turn. The heavy one weighs twice what friction could hold, so the rope slides;
weight and acceleration of each mass give the tension on its side. Joints start each step without a force, so each step solves
them many times; no axis is locked, or friction is lost; corners hold more than a curve, so their coefficient is made smaller.

Closed form: 2.90997 = exp(mu theta), ratio of the tensions
Observed: 2.91075 with rapier3d 0.36.1, give or take 0.01
Reached: within 0.05 of the closed form
"""

import math
from importlib.metadata import version

import rapier3d

STEP, ITERATIONS, CORNERS, SPARE, BEAD = 1e-5, 32, 11, 12, 1e-3
MU, RADIUS, GRAVITY, TIME, LIGHT, LIMIT = 0.34, 0.00625, 9.81, 0.1, 0.01, 0.05
closed_form = math.exp(MU * math.pi)
HEAVY = 2 * LIGHT * closed_form
bend, link = math.pi / CORNERS, math.pi * RADIUS / CORNERS
node_radius = link / (2 * math.sin(bend / 2))  # so that one link winds up as much string as it is long
friction = math.tanh(MU * bend / 2) / math.tan(bend / 2)
world = rapier3d.PhysicsWorld(gravity=(0, -GRAVITY, 0))
solver = world.integration_parameters
solver.dt, solver.num_solver_iterations, solver.num_internal_pgs_iterations = STEP, 1, ITERATIONS
solver.contact_recycling = False
solver.static_contact_softness = rapier3d.SpringCoefficients(natural_frequency=1e6)


def shape(collider: rapier3d.Collider, member: int, touches: int) -> rapier3d.Collider:
    """Give a shape friction and no mass; beads (group 1) touch only the rod (group 2)."""
    groups = rapier3d.InteractionGroups(rapier3d.Group(member), rapier3d.Group(touches))
    return collider.density(0).friction(friction).collision_groups(groups)


def body(mass: float, x: float, y: float, shapes: list[rapier3d.Collider]) -> rapier3d.RigidBodyHandle:
    """Add a mass that does not turn, and return its handle."""
    added = rapier3d.RigidBody.dynamic().translation((x, y, 0)).additional_mass(mass)
    return world.add_body(added.can_sleep(False).enabled_rotations((False, False, False)), shapes)


rod = rapier3d.Collider.cylinder(RADIUS, node_radius - BEAD).rotation((math.pi / 2, 0, 0))  # along z, not y
world.add_body(rapier3d.RigidBody.fixed(), [shape(rod, 2, 1)])
arch = [(node_radius * math.cos(a), node_radius * math.sin(a)) for a in (bend * (i + 0.5) for i in range(CORNERS))]
spare = [(-RADIUS, -link * (i + 0.5)) for i in range(SPARE)]  # they will be drawn over the rod
beads = [body(1e-4 * LIGHT, *place, [shape(rapier3d.Collider.ball(BEAD), 1, 2)]) for place in arch + spare]
row = [body(HEAVY, RADIUS, -0.2, []), *beads, body(LIGHT, -RADIUS, -0.2, [])]
places = [(RADIUS, -0.2), *arch, *spare, (-RADIUS, -0.2)]
for i in range(1, len(row)):
    world.impulse_joints.insert(row[i - 1], row[i], rapier3d.RopeJoint(math.dist(*places[i - 1 : i + 1])))
for _ in range(round(TIME / STEP)):
    world.step()
heavy, light = (GRAVITY + world.rigid_bodies[row[i]].linvel.y / TIME for i in (0, -1))
observed = HEAVY * heavy / (LIGHT * light)
holds = abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f}, reached within {LIMIT}")
print(f"observed {observed:.5f} with rapier3d {version('rapier3d')}: the recipe {'holds' if holds else 'fails'}")
raise SystemExit(int(not holds))
