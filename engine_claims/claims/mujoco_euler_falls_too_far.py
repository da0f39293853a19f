"""MuJoCo: with the default step and integrator a body falls too far, by half a step times its speed.

A mass falls from rest for 0.1 s. The default integrator, Euler's semi-implicit one, moves it with the speed of the end of each
step of 2 ms; so a run is ahead by half a step, however long it is.

Closed form: 49.05000 mm = g t^2 / 2, height of fall
Observed: 50.03100 mm with mujoco 4.0.0, give or take 1e-3
Mended: within 0.1 mm of the closed form
Default: timestep, integrator
"""

import mujoco

GRAVITY, TIME = 9.81, 0.1
LIMIT = 0.1
closed_form = 1e3 * 0.5 * GRAVITY * TIME**2

model = mujoco.MjModel.from_xml_string(f"""
<mujoco>
  <option gravity="0 0 -{GRAVITY}"/>
  <worldbody>
    <body>
      <joint type="slide" axis="0 0 -1"/>
      <inertial pos="0 0 0" mass="0.1" diaginertia="1e-6 1e-6 1e-6"/>
    </body>
  </worldbody>
</mujoco>""")
data = mujoco.MjData(model)
for _ in range(round(TIME / model.opt.timestep)):
    mujoco.mj_step(model, data)
observed = 1e3 * float(data.qpos[0])

holds = not abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f} mm, mended within {LIMIT} mm")
print(f"observed {observed:.5f} mm with mujoco {mujoco.__version__}: the claim {'holds' if holds else 'is mended'}")
raise SystemExit(int(holds))
