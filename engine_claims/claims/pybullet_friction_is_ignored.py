"""PyBullet: friction that changeDynamics is given together with a damping is ignored, without a warning.

A box is the link of a multibody, and one call asks for a coefficient of 0.2 and no damping. It slides over a plane whose
coefficient is 1 (the two multiply) until it stops, and its way gives the coefficient. Two separate calls cure it.

Closed form: 0.20000 = v^2 / (2 g s), coefficient of friction
Observed: 0.50193 with pybullet 3.2.7, give or take 5e-3
Mended: within 0.02 of the closed form
Default: friction given together with damping
"""

from importlib.metadata import version

import pybullet

MU, SPEED, GRAVITY, STEP = 0.2, 1.0, 9.81, 1e-3
LIMIT = 0.02
closed_form = MU

pybullet.connect(pybullet.DIRECT)
pybullet.setGravity(0, 0, -GRAVITY)
pybullet.setTimeStep(STEP)
plane = pybullet.createMultiBody(0, pybullet.createCollisionShape(pybullet.GEOM_PLANE))
pybullet.changeDynamics(plane, -1, lateralFriction=1.0)
box = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=[0.1, 0.1, 0.02])
slide = pybullet.createMultiBody(
    baseMass=0,
    basePosition=[0, 0, 0.02],
    linkMasses=[1e-3, 1.0],
    linkCollisionShapeIndices=[-1, box],
    linkVisualShapeIndices=[-1, -1],
    linkPositions=[[0, 0, 0]] * 2,
    linkOrientations=[[0, 0, 0, 1]] * 2,
    linkInertialFramePositions=[[0, 0, 0]] * 2,
    linkInertialFrameOrientations=[[0, 0, 0, 1]] * 2,
    linkParentIndices=[0, 1],
    linkJointTypes=[pybullet.JOINT_PRISMATIC] * 2,
    linkJointAxis=[[1, 0, 0], [0, 0, 1]],
)
pybullet.changeDynamics(slide, 1, lateralFriction=MU, linearDamping=0, angularDamping=0)
for joint in (0, 1):
    pybullet.setJointMotorControl2(slide, joint, pybullet.VELOCITY_CONTROL, force=0)
pybullet.resetJointState(slide, 0, 0, SPEED)
for _ in range(1500):
    pybullet.stepSimulation()
observed = SPEED**2 / (2 * GRAVITY * pybullet.getJointState(slide, 0)[0])

holds = not abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f}, mended within {LIMIT}")
print(f"observed {observed:.5f} with pybullet {version('pybullet')}: the claim {'holds' if holds else 'is mended'}")
raise SystemExit(int(holds))
