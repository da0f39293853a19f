"""pymunk: point beads on pins over a circle, only where the rope bends, with the friction that a polygon needs.

Two masses hang on one rope over a rod, half a turn. The heavy one weighs twice what friction could hold, so the rope slides;
weight and acceleration of each mass give the tension on its side. Few, light beads and short steps keep Chipmunk's joints
stiff; beads of infinite moment slide and do not roll; corners hold more than a curve, so their coefficient is made smaller.

Closed form: 2.90997 = exp(mu theta), ratio of the tensions
Observed: 2.91807 with pymunk 7.3.1, give or take 0.005
Reached: within 0.05 of the closed form
"""

import math

import pymunk

STEP, CORNERS, SPARE, BEAD, SLOP = 1e-5, 11, 12, 1e-3, 1e-5
MU, RADIUS, GRAVITY, TIME, LIGHT = 0.34, 0.00625, 9.81, 0.1, 0.01
LIMIT = 0.05
closed_form = math.exp(MU * math.pi)
HEAVY = 2 * LIGHT * closed_form

bend = math.pi / CORNERS
link = RADIUS * bend
node_radius = link / (2 * math.sin(bend / 2))  # so that one link winds up as much string as it is long
space = pymunk.Space()
space.gravity, space.iterations, space.collision_slop = (0, -GRAVITY), 20, SLOP  # the default slop is 0.1 m
rod = pymunk.Circle(space.static_body, node_radius - BEAD + SLOP)
rod.friction = math.tanh(MU * bend / 2) / math.tan(bend / 2)
space.add(rod)


def body(mass: float, x: float, y: float) -> pymunk.Body:
    """Add a mass that does not turn."""
    added = pymunk.Body(mass, math.inf)
    added.position = x, y
    space.add(added)
    return added


angles = [bend * (i + 0.5) for i in range(CORNERS)]
beads = [body(2e-4 * LIGHT, node_radius * math.cos(angle), node_radius * math.sin(angle)) for angle in angles]
beads += [body(2e-4 * LIGHT, -RADIUS, -link * (i + 0.5)) for i in range(SPARE)]  # they will be drawn over the rod
for bead in beads:
    shape = pymunk.Circle(bead, BEAD)
    shape.friction, shape.filter = 1.0, pymunk.ShapeFilter(group=1)  # Chipmunk multiplies coefficients; no bead meets another
    space.add(shape)
heavy, light = body(HEAVY, RADIUS, -0.2), body(LIGHT, -RADIUS, -0.2)
row = [heavy, *beads, light]
space.add(*(pymunk.PinJoint(a, b) for a, b in zip(row[:-1], row[1:], strict=True)))
for _ in range(round(TIME / STEP)):
    space.step(STEP)
observed = HEAVY * (GRAVITY + heavy.velocity.y / TIME) / (LIGHT * (GRAVITY + light.velocity.y / TIME))

holds = abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f}, reached within {LIMIT}")
print(f"observed {observed:.5f} with pymunk {pymunk.version}: the recipe {'holds' if holds else 'fails'}")
raise SystemExit(int(not holds))
