"""PyBullet: a joint does not move under a small load, since a motor that nobody asked for holds it.

A mass of 10 g falls on a vertical slide for 0.2 s. Every joint comes with a motor that holds it at rest with a force of its
own, until setJointMotorControl2(body, joint, VELOCITY_CONTROL, force=0) switches it off.

Closed form: 0.19620 m = g t^2 / 2, height of fall
Observed: 0.00000 m with pybullet 3.2.7, give or take 1e-4
Mended: within 0.01 m of the closed form
Default: joint motors
"""

from importlib.metadata import version

import pybullet

GRAVITY, TIME, STEP = 9.81, 0.2, 1e-4
LIMIT = 0.01
closed_form = 0.5 * GRAVITY * TIME**2

pybullet.connect(pybullet.DIRECT)
pybullet.setGravity(0, 0, -GRAVITY)
pybullet.setTimeStep(STEP)
slide = pybullet.createMultiBody(
    baseMass=0,
    linkMasses=[0.01],
    linkCollisionShapeIndices=[-1],
    linkVisualShapeIndices=[-1],
    linkPositions=[[0, 0, 0]],
    linkOrientations=[[0, 0, 0, 1]],
    linkInertialFramePositions=[[0, 0, 0]],
    linkInertialFrameOrientations=[[0, 0, 0, 1]],
    linkParentIndices=[0],
    linkJointTypes=[pybullet.JOINT_PRISMATIC],
    linkJointAxis=[[0, 0, 1]],
)
for _ in range(round(TIME / STEP)):
    pybullet.stepSimulation()
observed = -pybullet.getJointState(slide, 0)[0]

holds = not abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f} m, mended within {LIMIT} m")
print(f"observed {observed:.5f} m with pybullet {version('pybullet')}: the claim {'holds' if holds else 'is mended'}")
raise SystemExit(int(holds))
