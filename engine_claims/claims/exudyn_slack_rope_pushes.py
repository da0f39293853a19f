"""Exudyn: a slack rope of a reeving system pushes, with up to 0.1 N by default.

A body falls from its hook on a rope that is ten times as long as the fall begins below it. Until the rope is taut, it should
fall freely; Exudyn bounds the rope's push by regularizationForce, whose default is a tenth of this body's weight.

Closed form: 196.20000 mm = g t^2 / 2, height of fall
Observed: 216.20 mm with exudyn 1.13.6, give or take 1e-2
Mended: within 0.1 mm of the closed form
Default: regularizationForce
"""

from importlib.metadata import version

import exudyn
from exudyn import itemInterface as items

MASS, GRAVITY, DURATION, STEPS = 0.1, 9.81, 0.2, 2000
LIMIT = 0.1
closed_form = 1e3 * 0.5 * GRAVITY * DURATION**2

container = exudyn.SystemContainer()
system = container.AddSystem()
ground = system.AddObject(items.ObjectGround())
hook = system.AddMarker(items.MarkerBodyRigid(bodyNumber=ground))
node = system.AddNode(items.NodeRigidBody2D(referenceCoordinates=[0.0, -0.1, 0.0]))
system.AddObject(items.ObjectRigidBody2D(mass=MASS, inertia=1e-5, nodeNumber=node))
body = system.AddMarker(items.MarkerNodeRigid(nodeNumber=node))
system.AddLoad(items.LoadForceVector(markerNumber=body, loadVector=[0.0, -MASS * GRAVITY, 0.0]))
system.AddObject(
    items.ObjectConnectorReevingSystemSprings(
        markerNumbers=[hook, body],
        stiffnessPerLength=1e4,
        referenceLength=1.0,
        sheavesAxes=exudyn.Vector3DList([[0.0, 0.0, 1.0]] * 2),
        sheavesRadii=[0.0, 0.0],
    )
)
system.Assemble()
settings = exudyn.SimulationSettings()
settings.solution.file.write = False
settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = DURATION, STEPS
system.SolveDynamic(settings)
observed = -1e3 * system.GetNodeOutput(node, exudyn.OutputVariableType.Displacement)[1]

holds = not abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f} mm, mended within {LIMIT} mm")
print(f"observed {observed:.5f} mm with exudyn {version('exudyn')}: the claim {'holds' if holds else 'is mended'}")
raise SystemExit(int(holds))
