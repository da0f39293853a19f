"""Newton: a tendon at rest does not slide over a roller with friction, whatever hangs on it, if its compliance is left at zero.

Two masses hang on one string over a fixed roller, half a turn. The heavy one weighs twice what friction could hold, so the
string should slide; weight and acceleration of each mass give the tension on its side. Newton's friction reads the tensions
from the stretch, and a string without compliance has none.

Closed form: 2.90997 = exp(mu theta), ratio of the tensions
Observed: 5.81990 with newton 1.8.0, give or take 0.001
Mended: within 0.1 of the closed form
Default: compliance
"""

import math
from importlib.metadata import version

import numpy as np
import warp as wp

wp.config.enable_backward = False  # compiles in half a minute instead of several
import newton  # noqa: E402

MU, RADIUS, GRAVITY, LIGHT, STEP, STEPS = 0.34, 0.00625, 9.81, 0.01, 1e-4, 1000
LIMIT = 0.1
closed_form = math.exp(MU * math.pi)
MASSES = np.array([LIGHT, 2 * LIGHT * closed_form])

builder = newton.ModelBuilder(up_axis=newton.Axis.Y, gravity=(0, -GRAVITY, 0))
for x, mass in zip((-RADIUS, RADIUS), MASSES, strict=True):
    inertia = wp.mat33(*(1e-6 * mass * np.eye(3)).ravel().tolist())
    builder.add_body(xform=wp.transform(p=wp.vec3(x, -0.5, 0)), mass=mass, inertia=inertia, lock_inertia=True)
guide, kind, span = newton.TendonGuide, newton.TendonGuideType, dict[str, float]()
roller = guide(body=-1, guide_type=kind.ROLLER, radius=RADIUS, orientation=-1, mu=MU, **span)
builder.add_tendon([guide(body=0, guide_type=kind.ANCHOR), roller, guide(body=1, guide_type=kind.ANCHOR, **span)])
model = builder.finalize(device="cpu")
solver = newton.solvers.SolverXPBD(model)
states, control = [model.state(), model.state()], model.control()
with wp.ScopedCapture(device="cpu") as capture:
    for first, second in (states, states[::-1]):
        solver.step(first, second, control, None, STEP)
for _ in range(STEPS // 2):
    wp.capture_launch(capture.graph)
accelerations = states[0].body_qd.numpy()[:, 1] / (STEPS * STEP)
tensions = MASSES * (GRAVITY + accelerations)
observed = float(tensions[1] / tensions[0])

holds = not abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f}, mended within {LIMIT}")
print(f"observed {observed:.5f} with newton {version('newton')}: the claim {'holds' if holds else 'is mended'}")
raise SystemExit(int(holds))
