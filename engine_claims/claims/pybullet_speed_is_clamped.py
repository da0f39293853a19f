"""PyBullet: no joint moves faster than 100 m/s or rad/s, without a warning.

A mass starts on a slide at 150 m/s, without gravity, motor and damping. changeDynamics(body, -1, maxJointVelocity=...) raises
the limit; a short string that winds up reaches it.

Closed form: 15.00000 m = v t, way in 0.1 s
Observed: 10.00000 m with pybullet 3.2.7, give or take 0.01
Mended: within 0.1 m of the closed form
Default: maxJointVelocity
"""

from importlib.metadata import version

import pybullet

SPEED, TIME, STEP = 150.0, 0.1, 1e-3
LIMIT = 0.1
closed_form = SPEED * TIME

pybullet.connect(pybullet.DIRECT)
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
pybullet.changeDynamics(slide, -1, linearDamping=0, angularDamping=0)
pybullet.changeDynamics(slide, 0, jointDamping=0)
pybullet.setJointMotorControl2(slide, 0, pybullet.VELOCITY_CONTROL, force=0)
pybullet.resetJointState(slide, 0, 0, SPEED)
for _ in range(round(TIME / STEP)):
    pybullet.stepSimulation()
observed = pybullet.getJointState(slide, 0)[0]

holds = not abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f} m, mended within {LIMIT} m")
print(f"observed {observed:.5f} m with pybullet {version('pybullet')}: the claim {'holds' if holds else 'is mended'}")
raise SystemExit(int(holds))
