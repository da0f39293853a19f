"""Box2D: by default a body slower than 0.05 m/s is stopped after half a second.

A ball moves freely at 0.04 m/s, without gravity. It falls asleep; world.sleeping_enabled = False keeps it awake.

Closed form: 0.08000 m = v t, way in 2 s
Observed: 0.02000 m with pyb2d3 0.11.1, give or take 1e-3
Mended: within 1e-3 m of the closed form
Default: enableSleep
"""

from importlib.metadata import version

import pyb2d3

SPEED, TIME = 0.04, 2
LIMIT = 1e-3
closed_form = SPEED * TIME

world = pyb2d3.World(gravity=(0, 0))
body = world.create_dynamic_body(position=(0, 0), linear_velocity=(SPEED, 0))
body.create_shape(pyb2d3.shape_def(density=1), pyb2d3.circle(radius=0.1))
for _ in range(round(TIME * 60)):
    world.step(1 / 60, 4)
observed = body.position[0]

holds = not abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f} m, mended within {LIMIT} m")
print(f"observed {observed:.5f} m with pyb2d3 {version('pyb2d3')}: the claim {'holds' if holds else 'is mended'}")
raise SystemExit(int(holds))
