"""pymunk: rigid segments on pivots along the whole rope, with slide joints over many links that keep it from stretching.

Two masses hang on one rope over a rod, half a turn. The heavy one weighs twice what friction could hold, so the rope slides;
weight and acceleration of each mass give the tension on its side. A segment touches the rod in its middle and the rope bends at
its ends: so its coefficient is larger than the string's, where that of beads is smaller.

Closed form: 2.90997 = exp(mu theta), ratio of the tensions
Observed: 2.89830 with pymunk 7.3.1, give or take 0.005
Reached: within 0.05 of the closed form
"""

import math

import pymunk

STEP, LINK, SLOP, MASS = 1e-5, 2.5e-3, 1e-5, 1e-6
MU, RADIUS, GRAVITY, TIME, LIGHT, LIMIT = 0.34, 0.00625, 9.81, 0.1, 0.01, 0.05
closed_form = math.exp(MU * math.pi)
HEAVY = 2 * LIGHT * closed_form

bend = LINK / RADIUS
touch = RADIUS * (bend / 2) / math.tan(bend / 2)  # distance of the segments' middle lines on the rod from its centre
space = pymunk.Space()
space.gravity, space.iterations, space.collision_slop = (0, -GRAVITY), 10, SLOP  # the default slop is 0.1 m
rod = pymunk.Circle(space.static_body, touch + SLOP)
rod.friction = math.sinh(MU * bend) / math.sin(bend)
space.add(rod)

count = round(math.pi / bend)  # the joints on the rod, from its right side to its left, lie on a circle around it
joints = [(math.hypot(touch, LINK / 2), math.pi / 2 + bend * (i - count / 2)) for i in range(count + 1)]
arch = [(r * math.cos(a), r * math.sin(a)) for r, a in joints]
down = [LINK * i for i in range(1, 31)]
nodes = [*((arch[0][0], arch[0][1] - d) for d in reversed(down)), *arch, *((arch[-1][0], arch[-1][1] - d) for d in down)]
heavy, light = pymunk.Body(HEAVY, math.inf), pymunk.Body(LIGHT, math.inf)
heavy.position, light.position = nodes[0], nodes[-1]
space.add(heavy, light)
ends = [(heavy, (0.0, 0.0))]
for (x, y), (to_x, to_y) in zip(nodes[:-1], nodes[1:], strict=True):
    segment = pymunk.Body(MASS, MASS * LINK**2 / 12)
    segment.position, segment.angle = ((x + to_x) / 2, (y + to_y) / 2), math.atan2(to_y - y, to_x - x)
    shape = pymunk.Segment(segment, (-LINK / 2, 0), (LINK / 2, 0), 0.0)
    shape.friction, shape.filter = 1.0, pymunk.ShapeFilter(group=1)  # Chipmunk multiplies coefficients; no link meets another
    space.add(segment, shape, pymunk.PivotJoint(ends[-1][0], segment, ends[-1][1], (-LINK / 2, 0)))
    ends.append((segment, (LINK / 2, 0.0)))
space.add(pymunk.PivotJoint(ends[-1][0], light, ends[-1][1], (0, 0)))
for span in (2, 4, 8, 16, 32):
    for (a, on_a), (b, on_b) in zip(ends[::span], ends[span::span], strict=False):
        space.add(pymunk.SlideJoint(a, b, on_a, on_b, 0, span * LINK))
for _ in range(round(TIME / STEP)):
    space.step(STEP)
observed = HEAVY * (GRAVITY + heavy.velocity.y / TIME) / (LIGHT * (GRAVITY + light.velocity.y / TIME))

holds = abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f}, reached within {LIMIT}")
print(f"observed {observed:.5f} with pymunk {pymunk.version}: the recipe {'holds' if holds else 'fails'}")
raise SystemExit(int(not holds))
