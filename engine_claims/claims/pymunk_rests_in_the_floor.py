"""pymunk: by default a body stays as deep as it falls into another, up to 0.1 units of length: 10 cm, if units are metres.

A ball of 0.25 m radius falls by 0.5 m onto a floor, in steps of 1/60 s. Chipmunk's collision_slop of 0.1 units, made for
pixels, is the overlap of which nothing is taken back.

Closed form: 0.25000 m = r, height of the centre of a ball that lies on the floor
Observed: 0.23225 m with pymunk 7.3.1, give or take 1e-4
Mended: within 0.01 m of the closed form
Default: collision_slop
"""

import pymunk

RADIUS = 0.25
LIMIT = 0.01
closed_form = RADIUS

space = pymunk.Space()
space.gravity = 0, -9.81
ball = pymunk.Body(1, pymunk.moment_for_circle(1, 0, RADIUS))
ball.position = 0, RADIUS + 0.5
floor = pymunk.Segment(space.static_body, (-1, 0), (1, 0), 0)
space.add(ball, pymunk.Circle(ball, RADIUS), floor)
for _ in range(300):
    space.step(1 / 60)
observed = ball.position.y

holds = not abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f} m, mended within {LIMIT} m")
print(f"observed {observed:.5f} m with pymunk {pymunk.version}: the claim {'holds' if holds else 'is mended'}")
raise SystemExit(int(holds))
