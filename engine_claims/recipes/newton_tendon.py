"""Newton: its own capstan tendon over a fixed roller, up to half a turn, with a compliance, short steps and millimetres.

Two masses hang on one rope over a rod, half a turn. The heavy one weighs twice what friction could hold, so the rope slides;
weight and acceleration of each mass give the tension on its side. Newton's friction reads the tensions from the stretch, which
damping keeps from oscillating; beyond half a turn it is wrong. The first run compiles for half a minute.

Closed form: 2.90997 = exp(mu theta), ratio of the tensions
Observed: 2.90107 with newton 1.8.0, give or take 0.005
Reached: within 0.05 of the closed form
"""

import math
from importlib.metadata import version

import numpy as np
import warp as wp

wp.config.enable_backward = False  # compiles in half a minute instead of several
import newton  # noqa: E402

STEP, COMPLIANCE, DAMPING, UNIT = 1e-5, 1e-4, 2.0, 1e-3  # s, m/N, N s/m, m; what is slower than 1e-4 units a second stops
MU, RADIUS, GRAVITY, TIME, LIGHT, LIMIT = 0.34, 0.00625, 9.81, 0.2, 0.01, 0.05
closed_form = math.exp(MU * math.pi)
MASSES = np.array([LIGHT, 2 * LIGHT * closed_form])

builder = newton.ModelBuilder(up_axis=newton.Axis.Y, gravity=(0, -GRAVITY / UNIT, 0))
for x, mass in zip((-RADIUS, RADIUS), MASSES, strict=True):
    inertia = wp.mat33(*(1e-6 * mass / UNIT**2 * np.eye(3)).ravel().tolist())  # nothing turns it, but 0 would be replaced
    builder.add_body(xform=wp.transform(p=wp.vec3(x / UNIT, -0.2 / UNIT, 0)), mass=mass, inertia=inertia, lock_inertia=True)
guide, kind, span = newton.TendonGuide, newton.TendonGuideType, {"compliance": COMPLIANCE, "damping": DAMPING}
roller = guide(body=-1, guide_type=kind.ROLLER, radius=RADIUS / UNIT, orientation=-1, mu=MU, **span)
builder.add_tendon([guide(body=0, guide_type=kind.ANCHOR), roller, guide(body=1, guide_type=kind.ANCHOR, **span)])
model = builder.finalize(device="cpu")
solver = newton.solvers.SolverXPBD(model, iterations=1, joint_linear_relaxation=1.0, tendon_settle_tol=1e-3)
states, control = [model.state(), model.state()], model.control()
with wp.ScopedCapture(device="cpu") as capture:  # a recorded pair of steps runs much faster
    for first, second in (states, states[::-1]):
        solver.step(first, second, control, None, STEP)
for _ in range(round(TIME / STEP / 2)):
    wp.capture_launch(capture.graph)
accelerations = states[0].body_qd.numpy()[:, 1] * UNIT / TIME
tensions = MASSES * (GRAVITY + accelerations)
observed = float(tensions[1] / tensions[0])

holds = abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f}, reached within {LIMIT}")
print(f"observed {observed:.5f} with newton {version('newton')}: the recipe {'holds' if holds else 'fails'}")
raise SystemExit(int(not holds))
