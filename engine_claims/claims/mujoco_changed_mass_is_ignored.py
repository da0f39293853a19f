"""MuJoCo: a mass that is changed at run time is ignored, without a warning, until mj_setConst is called.

A force of 1 N pulls a body that was compiled with 1 kg and whose model.body_mass is then set to 2 kg. A body that the compiler
takes for simple keeps the inertia that it was compiled with; one with simple="false" takes the new mass at once.

Closed form: 0.50000 m/s^2 = F / m, acceleration
Observed: 1.00000 m/s^2 with mujoco 4.0.0, give or take 1e-5
Mended: within 0.01 m/s^2 of the closed form
Default: body simple
"""

import mujoco

FORCE, COMPILED_MASS, MASS = 1.0, 1.0, 2.0
LIMIT = 0.01
closed_form = FORCE / MASS

model = mujoco.MjModel.from_xml_string(f"""
<mujoco>
  <worldbody>
    <body>
      <joint type="slide" axis="1 0 0"/>
      <inertial pos="0 0 0" mass="{COMPILED_MASS}" diaginertia="1e-6 1e-6 1e-6"/>
    </body>
  </worldbody>
</mujoco>""")
model.body_mass[1] = MASS
data = mujoco.MjData(model)
data.qfrc_applied[0] = FORCE
mujoco.mj_forward(model, data)
observed = float(data.qacc[0])

holds = not abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f} m/s^2, mended within {LIMIT} m/s^2")
print(f"observed {observed:.5f} m/s^2 with mujoco {mujoco.__version__}: the claim {'holds' if holds else 'is mended'}")
raise SystemExit(int(holds))
