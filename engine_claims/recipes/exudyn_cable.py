"""Exudyn: an elastic cable of ANCF elements over a circle, with a friction stiffness and a small tolerance of contact forces.

Two masses hang on one rope over a rod, half a turn. The heavy one weighs twice what friction could hold, so the rope slides;
weight and acceleration of each mass give the tension on its side. Segments of an element touch with their middles: the circle
is made smaller, and the coefficient, too: corners hold more than a curve.

Closed form: 2.90997 = exp(mu theta), ratio of the tensions
Observed: 2.88784 with exudyn 1.13.6, give or take 0.01
Reached: within 0.05 of the closed form
"""

import math
from importlib.metadata import version

import exudyn
from exudyn import itemInterface as items

STEP, ON_ROD, HANGING, SEGMENTS, STIFF, STICK = 1e-4, 10, 6, 4, 1e4, 1e4
MU, RADIUS, GRAVITY, TIME, LIGHT, LIMIT = 0.34, 0.00625, 9.81, 0.08, 0.01, 0.05
closed_form = math.exp(MU * math.pi)
HEAVY = 2 * LIGHT * closed_form
length, bend = math.pi * RADIUS / ON_ROD, math.pi / ON_ROD / SEGMENTS
thread = {"massPerLength": 2.5e-4, "axialStiffness": 1e3, "axialDamping": 1.0, "bendingStiffness": 1e-8}
thread |= {"strainIsRelativeToReference": 0.0, "referenceAxialStrain": -1e-4, "useReducedOrderIntegration": 2}  # slightly taut
contact = {"contactStiffness": STIFF, "frictionStiffness": STICK, "circleRadius": RADIUS * math.cos(bend / 2)}
contact |= {"frictionCoefficient": math.tanh(MU * bend / 2) / math.tan(bend / 2), "numberOfContactSegments": SEGMENTS}
mbs = exudyn.SystemContainer().AddSystem()
rod = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=mbs.AddObject(items.ObjectGround())))
turn = [(math.cos(math.pi * i / ON_ROD), math.sin(math.pi * i / ON_ROD)) for i in range(ON_ROD + 1)]
places = [[RADIUS, -length * i, 0, 1] for i in range(HANGING, 0, -1)]  # position and direction
places += [[RADIUS * x, RADIUS * y, -y, x] for x, y in turn]
places += [[-RADIUS, -length * i, 0, -1] for i in range(1, HANGING + 1)]
nodes = [mbs.AddNode(items.NodePoint2DSlope1(referenceCoordinates=place)) for place in places]
for i in range(len(nodes) - 1):
    cable = mbs.AddObject(items.ObjectANCFCable2D(nodeNumbers=nodes[i : i + 2], length=length, **thread))
    gaps = [-1e-6 if HANGING <= i < HANGING + ON_ROD else 0.1] * SEGMENTS
    state = {"initialCoordinates": gaps + [-2.0] * SEGMENTS + [0.0] * SEGMENTS}  # -2: sticks or slides, unknown
    data = mbs.AddNode(items.NodeGenericData(numberOfDataCoordinates=3 * SEGMENTS, **state))
    shape = mbs.AddMarker(items.MarkerBodyCable2DShape(bodyNumber=cable, numberOfSegments=SEGMENTS))
    mbs.AddObject(items.ObjectContactFrictionCircleCable2D(markerNumbers=[rod, shape], nodeNumber=data, **contact))
for i, mass in ((0, HEAVY), (-1, LIGHT)):
    point = mbs.AddNode(items.NodePoint2D(referenceCoordinates=places[i][:2]))
    mbs.AddObject(items.ObjectMassPoint2D(nodeNumber=point, mass=mass))
    ends = [mbs.AddMarker(items.MarkerNodePosition(nodeNumber=node)) for node in (point, nodes[i])]
    mbs.AddObject(items.ObjectJointRevolute2D(markerNumbers=ends))
    mbs.AddLoad(items.LoadForceVector(markerNumber=ends[0], loadVector=[0, -mass * GRAVITY, 0]))
mbs.Assemble()
settings = exudyn.SimulationSettings()
settings.solution.file.write, integration = False, settings.timeIntegration
integration.endTime, integration.numberOfSteps, integration.newton.useModifiedNewton = TIME, round(TIME / STEP), False
integration.generalizedAlpha.spectralRadius = 0.6
integration.discontinuous.iterationTolerance, integration.discontinuous.maxIterations = 1e-3, 20  # the default is 1 N
mbs.SolveDynamic(settings)
heavy, light = (mbs.GetNodeOutput(nodes[i], exudyn.OutputVariableType.Velocity)[1] / TIME for i in (0, -1))
observed = HEAVY * (GRAVITY + heavy) / (LIGHT * (GRAVITY + light))
holds = abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f}, reached within {LIMIT}")
print(f"observed {observed:.5f} with exudyn {version('exudyn')}: the recipe {'holds' if holds else 'fails'}")
raise SystemExit(int(not holds))
