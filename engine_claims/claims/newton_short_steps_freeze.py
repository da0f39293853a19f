"""Newton: with short steps a body at rest does not fall: whatever is slower than 1e-4 m/s after a step is stopped.

A body falls for 0.02 s in steps of 0.01 ms. Gravity makes it faster by 9.81e-5 m/s in a step; the position-based solver (XPBD)
sets speeds below 1e-4 to zero, at every step and whatever the unit of length, so that it stays where it is.

Closed form: 1.96200 mm = g t^2 / 2, height of fall
Observed: 0.00196 mm with newton 1.8.0, give or take 0.01
Mended: within 0.1 mm of the closed form
Default: length unit
"""

from importlib.metadata import version

import numpy as np
import warp as wp

wp.config.enable_backward = False  # compiles in half a minute instead of several
import newton  # noqa: E402

GRAVITY, STEP, STEPS = 9.81, 1e-5, 2000
UNIT = 1.0  # of length [m]
LIMIT = 0.1
closed_form = 1e3 * GRAVITY * (STEPS * STEP) ** 2 / 2

builder = newton.ModelBuilder(up_axis=newton.Axis.Y, gravity=(0, -GRAVITY / UNIT, 0))
inertia = wp.mat33(*(1e-3 * np.eye(3)).ravel().tolist())
body = builder.add_body(xform=wp.transform(p=wp.vec3(0, 0, 0)), mass=1.0, inertia=inertia, lock_inertia=True)
model = builder.finalize(device="cpu")
solver = newton.solvers.SolverXPBD(model)
states, control = [model.state(), model.state()], model.control()
with wp.ScopedCapture(device="cpu") as capture:
    for first, second in (states, states[::-1]):
        solver.step(first, second, control, None, STEP)
for _ in range(STEPS // 2):
    wp.capture_launch(capture.graph)
observed = -1e3 * UNIT * float(states[0].body_q.numpy()[body, 1])

holds = not abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f} mm, mended within {LIMIT} mm")
print(f"observed {observed:.5f} mm with newton {version('newton')}: the claim {'holds' if holds else 'is mended'}")
raise SystemExit(int(holds))
