"""Box2D: no distance joint is shorter than 0.005 length units, 5 mm in SI units.

A mass hangs on a joint of 2 mm, that is given as such. A unit of length of 10 mm instead of 1 m allows joints from 0.05 mm on.

Closed form: 2.00000 mm = L, length of the joint
Observed: 5.06902 mm with pyb2d3 0.11.1, give or take 0.01
Mended: within 0.2 mm of the closed form
Default: lengthUnitsPerMeter
"""

from importlib.metadata import version

import pyb2d3

LENGTH, LENGTH_UNIT = 2e-3, 1
LIMIT = 0.2
closed_form = 1e3 * LENGTH

world = pyb2d3.World(gravity=(0, -9.81 / LENGTH_UNIT))
nail = world.create_static_body(position=(0, 0))
body = world.create_dynamic_body(position=(0, -LENGTH / LENGTH_UNIT))
body.create_shape(pyb2d3.shape_def(density=1), pyb2d3.circle(radius=0.1))
world.create_distance_joint(nail, body, length=LENGTH / LENGTH_UNIT)
for _ in range(120):
    world.step(1 / 60, 4)
observed = -1e3 * LENGTH_UNIT * body.position[1]

holds = not abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f} mm, mended within {LIMIT} mm")
print(f"observed {observed:.5f} mm with pyb2d3 {version('pyb2d3')}: the claim {'holds' if holds else 'is mended'}")
raise SystemExit(int(holds))
