"""PyBullet: a body falls too slowly in empty space, since linear damping is on by default.

A mass falls from rest for 2 s. Its damping of 0.04 brakes it by 0.04 v (1 + |v|), so with the square of its speed, too, until
changeDynamics(body, -1, linearDamping=0) takes it off.

Closed form: 19.62000 m = g t^2 / 2, height of fall
Observed: 15.64453 m with pybullet 3.2.7, give or take 1e-3
Mended: within 0.1 m of the closed form
Default: linearDamping
"""

from importlib.metadata import version

import pybullet

GRAVITY, TIME, STEP = 9.81, 2.0, 1e-3
LIMIT = 0.1
closed_form = 0.5 * GRAVITY * TIME**2

pybullet.connect(pybullet.DIRECT)
pybullet.setGravity(0, 0, -GRAVITY)
pybullet.setTimeStep(STEP)
body = pybullet.createMultiBody(1.0)
for _ in range(round(TIME / STEP)):
    pybullet.stepSimulation()
observed = -pybullet.getBasePositionAndOrientation(body)[0][2]

holds = not abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f} m, mended within {LIMIT} m")
print(f"observed {observed:.5f} m with pybullet {version('pybullet')}: the claim {'holds' if holds else 'is mended'}")
raise SystemExit(int(holds))
