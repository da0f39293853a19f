"""Box2D: point beads on distance joints over a circle, in units in which Box2D's hidden lengths and rates are small.

Two masses hang on one rope over a rod, half a turn. The heavy one weighs twice what friction could hold, so the rope slides;
weight and acceleration of each mass give the tension on its side. Box2D's lengths and rates are made for crates of a metre: its
metre is 1 cm here, its second 0.1 ms. Corners hold more than a curve, so their coefficient is made smaller.

Closed form: 2.90997 = exp(mu theta), ratio of the tensions
Observed: 2.91475 with pyb2d3 0.11.1, give or take 0.005
Reached: within 0.05 of the closed form
"""

import math
from importlib.metadata import version

import pyb2d3

STEP, CORNERS, SPARE, BEAD, METRE, SECOND = 1e-5, 11, 12, 1e-3, 1e-2, 1e-4
MU, RADIUS, GRAVITY, TIME, LIGHT, LIMIT = 0.34, 0.00625, 9.81, 0.1, 0.01, 0.05
closed_form = math.exp(MU * math.pi)
HEAVY = 2 * LIGHT * closed_form

bend, link = math.pi / CORNERS, math.pi * RADIUS / CORNERS
node_radius = link / (2 * math.sin(bend / 2))  # so that one link winds up as much string as it is long
friction = math.tanh(MU * bend / 2) / math.tan(bend / 2)
world = pyb2d3.World(gravity=(0.0, -GRAVITY / (METRE / SECOND**2)))
world.sleeping_enabled = world.continuous_enabled = False
world.set_contact_tuning(1e6 * SECOND, 10.0, 3.0 / (METRE / SECOND))  # stiff contacts, SI values on the left


def body(mass: float, x: float, y: float, radius: float = 0.0) -> pyb2d3.Body:
    """Add a mass that does not turn, with a circle if it has a radius; without a mass it is fixed."""
    add = world.create_dynamic_body if mass else world.create_static_body
    added = add(position=(x / METRE, y / METRE), fixed_rotation=True)
    if radius:
        alone = pyb2d3.make_filter(group_index=-1 if mass else 0)  # beads do not meet each other
        shape = pyb2d3.shape_def(material=pyb2d3.surface_material(friction=friction, restitution=0.0), filter=alone)
        added.create_shape(shape, pyb2d3.circle(radius=radius / METRE))
    data = pyb2d3.MassData()
    data.mass, data.center, data.rotational_inertia = mass, (0.0, 0.0), 0.0
    added.mass_data = data  # after its shape, which adds a mass of its own
    return added


body(0.0, 0.0, 0.0, node_radius - BEAD)
places = [(node_radius * math.cos(a), node_radius * math.sin(a)) for a in (bend * (i + 0.5) for i in range(CORNERS))]
places += [(-RADIUS, -link * (i + 0.5)) for i in range(SPARE)]  # they will be drawn over the rod
heavy, light = body(HEAVY, RADIUS, -0.2), body(LIGHT, -RADIUS, -0.2)
row = [heavy, *(body(2e-4 * LIGHT, x, y, BEAD) for x, y in places), light]
for a, b in zip(row[:-1], row[1:], strict=True):
    world.create_distance_joint(a, b, length=math.dist(a.position, b.position))
for _ in range(round(TIME / STEP)):
    world.step(STEP / SECOND, 4)
up = METRE / SECOND / TIME
observed = HEAVY * (GRAVITY + heavy.linear_velocity[1] * up) / (LIGHT * (GRAVITY + light.linear_velocity[1] * up))

holds = abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f}, reached within {LIMIT}")
print(f"observed {observed:.5f} with pyb2d3 {version('pyb2d3')}: the recipe {'holds' if holds else 'fails'}")
raise SystemExit(int(not holds))
