"""Exudyn: a cable creeps over a circle on which friction should hold it, if it has a velocity penalty but no stiffness.

The cable is pulled along with half of what friction can hold. frictionVelocityPenalty is force per speed, so that it holds the
cable at the speed mu m g / (2 penalty), here 14.7 mm/s; frictionStiffness, 0 by default, would hold it by a spring.

Closed form: 0.00000 mm, way of a cable that is held, in 1 s
Observed: 14.575 mm with exudyn 1.13.6, give or take 1e-2
Mended: within 0.1 mm of the closed form
Default: frictionStiffness
"""

from importlib.metadata import version

import exudyn
from exudyn import itemInterface as items

LENGTH, RADIUS, MASS, GRAVITY, FRICTION, PENALTY = 0.02, 100.0, 0.1, 9.81, 0.3, 10.0
DURATION, STEPS = 1.0, 2000
LIMIT = 0.1
closed_form = 0.0

container = exudyn.SystemContainer()
system = container.AddSystem()
ground = system.AddObject(items.ObjectGround())
circle = system.AddMarker(items.MarkerBodyRigid(bodyNumber=ground, localPosition=[0.5 * LENGTH, -RADIUS, 0.0]))
ends = [system.AddNode(items.NodePoint2DSlope1(referenceCoordinates=[x, 0.0, 1.0, 0.0])) for x in (0.0, LENGTH)]
cable = system.AddObject(
    items.ObjectANCFCable2D(
        nodeNumbers=ends, length=LENGTH, massPerLength=MASS / LENGTH, axialStiffness=1e4, bendingStiffness=10.0
    )
)
body = system.AddMarker(items.MarkerBodyMass(bodyNumber=cable))
system.AddLoad(items.LoadMassProportional(markerNumber=body, loadVector=[0.5 * FRICTION * GRAVITY, -GRAVITY, 0.0]))
state = system.AddNode(items.NodeGenericData(initialCoordinates=[0.1, -2.0, 0.0], numberOfDataCoordinates=3))
shape = system.AddMarker(items.MarkerBodyCable2DShape(bodyNumber=cable, numberOfSegments=1))
contact = dict(
    contactStiffness=1e4,
    contactDamping=50.0,
    frictionCoefficient=FRICTION,
    circleRadius=RADIUS,
    frictionVelocityPenalty=PENALTY,
)
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
observed = 1e3 * system.GetNodeOutput(ends[0], exudyn.OutputVariableType.Displacement)[0]

holds = not abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f} mm, mended within {LIMIT} mm")
print(f"observed {observed:.5f} mm with exudyn {version('exudyn')}: the claim {'holds' if holds else 'is mended'}")
raise SystemExit(int(holds))
