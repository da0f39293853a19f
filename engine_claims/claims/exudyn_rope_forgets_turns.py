"""Exudyn: a rope of a reeving system that is wound round its sheave by more than a turn is a turn too short, without a warning.

The rope hangs down h on one side of a sheave of radius R, is wound on by theta and leaves as a straight part l. Exudyn takes
the wound part from 0 to one turn, so that at theta = 420 degrees it measures R times 60 degrees.

Closed form: 0.37581 m = h + R theta + l, length of the rope
Observed: 0.33654 m with exudyn 1.13.6, give or take 1e-5
Mended: within 0.0001 m of the closed form
"""

import math
from importlib.metadata import version

import exudyn
from exudyn import itemInterface as items

RADIUS, HANGING, FREE, ANGLE = 6.25e-3, 0.03, 0.3, math.radians(420)
LIMIT = 1e-4
closed_form = HANGING + RADIUS * ANGLE + FREE

container = exudyn.SystemContainer()
system = container.AddSystem()
ground = system.AddObject(items.ObjectGround())
place = [RADIUS * math.cos(ANGLE) - FREE * math.sin(ANGLE), RADIUS * math.sin(ANGLE) + FREE * math.cos(ANGLE), 0.0]
ends = [place, [0.0, 0.0, 0.0], [RADIUS, -HANGING, 0.0]]
rope = system.AddObject(
    items.ObjectConnectorReevingSystemSprings(
        markerNumbers=[system.AddMarker(items.MarkerBodyRigid(bodyNumber=ground, localPosition=end)) for end in ends],
        stiffnessPerLength=1e4,
        referenceLength=closed_form,
        sheavesAxes=exudyn.Vector3DList([[0.0, 0.0, -1.0]] * 3),
        sheavesRadii=[0.0, RADIUS, 0.0],
    )
)
system.Assemble()
observed = system.GetObjectOutput(rope, exudyn.OutputVariableType.Distance)

holds = not abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f} m, mended within {LIMIT} m")
print(f"observed {observed:.5f} m with exudyn {version('exudyn')}: the claim {'holds' if holds else 'is mended'}")
raise SystemExit(int(holds))
