"""PyBullet: a body in empty space spins ever more slowly, since angular damping is on by default.

A sphere spins at 10 rad/s for 2 s, and nothing touches it. Its damping of 0.04 brakes it by 0.04 w (1 + |w|), so with the
square of its angular speed, too, until changeDynamics(body, -1, angularDamping=0) takes it off.

Closed form: 10.00000 rad/s, angular speed, which must stay
Observed: 5.21798 rad/s with pybullet 3.2.7, give or take 1e-3
Mended: within 0.05 rad/s of the closed form
Default: angularDamping
"""

from importlib.metadata import version

import pybullet

SPIN, TIME, STEP = 10.0, 2.0, 1e-3
LIMIT = 0.05
closed_form = SPIN

pybullet.connect(pybullet.DIRECT)
pybullet.setTimeStep(STEP)
body = pybullet.createMultiBody(1.0, pybullet.createCollisionShape(pybullet.GEOM_SPHERE, radius=0.1))
pybullet.resetBaseVelocity(body, angularVelocity=[0, 0, SPIN])
for _ in range(round(TIME / STEP)):
    pybullet.stepSimulation()
observed = pybullet.getBaseVelocity(body)[1][2]

holds = not abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f} rad/s, mended within {LIMIT} rad/s")
print(f"observed {observed:.5f} rad/s with pybullet {version('pybullet')}: the claim {'holds' if holds else 'is mended'}")
raise SystemExit(int(holds))
