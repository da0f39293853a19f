"""Box2D: joints are springs of at most 60 Hz, so that light links stretch under a heavy load.

A mass hangs on eight distance joints of 0.1 m, joined by beads of a hundredth of its mass, in steps of 1/60 s. pyb2d3 has no
call for the joints' frequency; a unit of time of 10 ms instead of 1 s makes it 6 kHz.

Closed form: 0.80000 m = N L, length of the chain
Observed: 0.88892 m with pyb2d3 0.11.1, give or take 0.01
Mended: within 0.01 m of the closed form
Default: jointHertz
"""

import math
from importlib.metadata import version

import pyb2d3

LINKS, LENGTH, MASS, RADIUS, TIME = 8, 0.1, 1.0, 0.02, 2
TIME_UNIT = 1
LIMIT = 0.01
closed_form = LINKS * LENGTH

world = pyb2d3.World(gravity=(0, -9.81 * TIME_UNIT**2))
last = world.create_static_body(position=(0, 0))
for k in range(1, LINKS + 1):
    bead = world.create_dynamic_body(position=(0, -k * LENGTH))
    mass = MASS if k == LINKS else MASS / 100
    bead.create_shape(pyb2d3.shape_def(density=mass / (math.pi * RADIUS**2)), pyb2d3.circle(radius=RADIUS))
    world.create_distance_joint(last, bead, length=LENGTH)
    last = bead
for _ in range(round(TIME * 60)):
    world.step(1 / 60 / TIME_UNIT, 4)
observed = -last.position[1]

holds = not abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f} m, mended within {LIMIT} m")
print(f"observed {observed:.5f} m with pyb2d3 {version('pyb2d3')}: the claim {'holds' if holds else 'is mended'}")
raise SystemExit(int(holds))
