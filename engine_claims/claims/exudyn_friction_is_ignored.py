"""Exudyn: a cable's friction on a circle is ignored, without a warning, unless a friction stiffness or penalty is given.

A cable with the friction coefficient 0.3 slides on top of a large circle, from the speed v; mu follows from the time t after
which it has the speed v'. frictionStiffness and frictionVelocityPenalty are 0 by default, and then there is no friction.

Closed form: 0.30000 = (v - v') / (g t), coefficient of friction
Observed: -0.00100 with exudyn 1.13.6, give or take 1e-3
Mended: within 0.01 of the closed form
Default: frictionStiffness
"""

from importlib.metadata import version

import exudyn
from exudyn import itemInterface as items

LENGTH, RADIUS, MASS, GRAVITY, SPEED = 0.02, 100.0, 0.1, 9.81, 1.0
DURATION, STEPS = 0.2, 2000
LIMIT = 0.01
closed_form = FRICTION = 0.3

container = exudyn.SystemContainer()
system = container.AddSystem()
ground = system.AddObject(items.ObjectGround())
circle = system.AddMarker(items.MarkerBodyRigid(bodyNumber=ground, localPosition=[0.5 * LENGTH, -RADIUS, 0.0]))
ends = [
    system.AddNode(items.NodePoint2DSlope1(referenceCoordinates=[x, 0.0, 1.0, 0.0], initialVelocities=[SPEED, 0.0, 0.0, 0.0]))
    for x in (0.0, LENGTH)
]
cable = system.AddObject(
    items.ObjectANCFCable2D(
        nodeNumbers=ends, length=LENGTH, massPerLength=MASS / LENGTH, axialStiffness=1e4, bendingStiffness=10.0
    )
)
body = system.AddMarker(items.MarkerBodyMass(bodyNumber=cable))
system.AddLoad(items.LoadMassProportional(markerNumber=body, loadVector=[0.0, -GRAVITY, 0.0]))
state = system.AddNode(items.NodeGenericData(initialCoordinates=[0.1, -2.0, 0.0], numberOfDataCoordinates=3))
shape = system.AddMarker(items.MarkerBodyCable2DShape(bodyNumber=cable, numberOfSegments=1))
contact = dict(contactStiffness=1e4, contactDamping=50.0, frictionCoefficient=FRICTION, circleRadius=RADIUS)
system.AddObject(
    items.ObjectContactFrictionCircleCable2D(
        markerNumbers=[circle, shape], nodeNumber=state, numberOfContactSegments=1, **contact
    )
)
system.Assemble()
settings = exudyn.SimulationSettings()
settings.solution.file.write = False
settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = DURATION, STEPS
system.SolveDynamic(settings)
speed = system.GetNodeOutput(ends[0], exudyn.OutputVariableType.Velocity)[0]
observed = (SPEED - speed) / (GRAVITY * DURATION)

holds = not abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f}, mended within {LIMIT}")
print(f"observed {observed:.5f} with exudyn {version('exudyn')}: the claim {'holds' if holds else 'is mended'}")
raise SystemExit(int(holds))
