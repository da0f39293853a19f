"""Box2D: with the step of its guides a body falls too far, by half a sub-step times its speed.

A mass falls from rest for 0.5 s, in steps of 1/60 s of four sub-steps. It moves with the speed of each sub-step's end; so a run
is ahead by half a sub-step, however long it is.

Closed form: 1226.25000 mm = g t^2 / 2, height of fall
Observed: 1236.46820 mm with pyb2d3 0.11.1, give or take 1e-2
Mended: within 1 mm of the closed form
Default: timeStep
"""

from importlib.metadata import version

import pyb2d3

GRAVITY, TIME, STEP, SUB_STEPS = 9.81, 0.5, 1 / 60, 4
LIMIT = 1
closed_form = 1e3 * GRAVITY * TIME**2 / 2

world = pyb2d3.World(gravity=(0, -GRAVITY))
body = world.create_dynamic_body(position=(0, 0))
body.create_shape(pyb2d3.shape_def(density=1), pyb2d3.circle(radius=0.1))
for _ in range(round(TIME / STEP)):
    world.step(STEP, SUB_STEPS)
observed = -1e3 * body.position[1]

holds = not abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f} mm, mended within {LIMIT} mm")
print(f"observed {observed:.5f} mm with pyb2d3 {version('pyb2d3')}: the claim {'holds' if holds else 'is mended'}")
raise SystemExit(int(holds))
