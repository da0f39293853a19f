"""Newton: a tendon wound round a roller by more than half a turn loses friction, the more the further it is wound.

Two masses pull on the ends of one string, wound by 270 degrees, with forces that make it slide; force and acceleration of each
give the tension on its side. Newton takes the angle that is at most half a turn, so that 270 degrees count as 90; it prints an
error at each step and goes on.

Closed form: 4.96400 = exp(mu theta), ratio of the tensions
Observed: 1.70587 with newton 1.8.0, give or take 0.01
Mended: within 0.2 of the closed form
"""

import math
from importlib.metadata import version

import numpy as np
import warp as wp

wp.config.enable_backward = False  # compiles in half a minute instead of several
import newton  # noqa: E402

MU, WRAP, RADIUS, FREE, MASS, STEP, STEPS = 0.34, 1.5 * math.pi, 6.25, 300.0, 0.01, 1e-5, 1000  # lengths in mm
LIMIT = 0.2
closed_form = math.exp(MU * WRAP)
PULLS = np.array([200, 400 * closed_form])  # kg mm/s^2
AWAY = np.array([[-math.sin(WRAP), math.cos(WRAP)], [0, -1]])  # of the string, from the rod

builder = newton.ModelBuilder(up_axis=newton.Axis.Y, gravity=(0, 0, 0))
for out, way in zip(([math.cos(WRAP), math.sin(WRAP)], [1, 0]), AWAY, strict=True):
    place = RADIUS * np.array(out) + FREE * way
    inertia = wp.mat33(*(MASS * np.eye(3)).ravel().tolist())
    builder.add_body(xform=wp.transform(p=wp.vec3(*place, 0)), mass=MASS, inertia=inertia, lock_inertia=True)
guide, kind, span = newton.TendonGuide, newton.TendonGuideType, {"compliance": 1e-4, "damping": 2.0}
roller = guide(body=-1, guide_type=kind.ROLLER, radius=RADIUS, orientation=-1, mu=MU, **span)
builder.add_tendon([guide(body=0, guide_type=kind.ANCHOR), roller, guide(body=1, guide_type=kind.ANCHOR, **span)])
model = builder.finalize(device="cpu")
solver = newton.solvers.SolverXPBD(model, iterations=1, joint_linear_relaxation=1.0)
states, control = [model.state(), model.state()], model.control()
for state in states:
    state.body_f.assign(np.hstack([PULLS[:, None] * AWAY, np.zeros((2, 4))]))
with wp.ScopedCapture(device="cpu") as capture:
    for first, second in (states, states[::-1]):
        solver.step(first, second, control, None, STEP)
for _ in range(STEPS // 2):
    wp.capture_launch(capture.graph)
speeds = (states[0].body_qd.numpy()[:, :2] * AWAY).sum(axis=1)
tensions = PULLS - MASS * speeds / (STEPS * STEP)
observed = float(tensions[1] / tensions[0])

holds = not abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f}, mended within {LIMIT}")
print(f"observed {observed:.5f} with newton {version('newton')}: the claim {'holds' if holds else 'is mended'}")
raise SystemExit(int(holds))
