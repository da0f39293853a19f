"""MuJoCo: a tendon slides over a cylinder without friction, whatever friction the cylinder has.

Two masses hang on one string over a fixed cylinder, half a turn. The heavy one weighs twice what friction could hold, so the
string slides; weight and acceleration of each mass give the tension on its side, and the capstan law their ratio.

Closed form: 2.90997 = exp(mu theta), ratio of the tensions
Observed: 1.00000 with mujoco 4.0.0, give or take 1e-3
Mended: within 0.2 of the closed form
"""

import math

import mujoco

MU, RADIUS, GRAVITY, TIME = 0.34, 0.00625, 9.81, 0.1
LIMIT = 0.2
closed_form = math.exp(MU * math.pi)
LIGHT = 0.01
HEAVY = 2 * LIGHT * closed_form

model = mujoco.MjModel.from_xml_string(f"""
<mujoco>
  <option timestep="1e-4" integrator="implicitfast" gravity="0 0 -{GRAVITY}"/>
  <worldbody>
    <geom name="rod" type="cylinder" size="{RADIUS} 0.05" euler="90 0 0" friction="{MU} 0 0" contype="0" conaffinity="0"/>
    <site name="top" pos="0 0 {2 * RADIUS}"/>
    <body pos="-{RADIUS} 0 -0.5">
      <joint type="slide" axis="0 0 1"/>
      <inertial pos="0 0 0" mass="{LIGHT}" diaginertia="1e-6 1e-6 1e-6"/>
      <site name="light"/>
    </body>
    <body pos="{RADIUS} 0 -0.5">
      <joint type="slide" axis="0 0 1"/>
      <inertial pos="0 0 0" mass="{HEAVY}" diaginertia="1e-6 1e-6 1e-6"/>
      <site name="heavy"/>
    </body>
  </worldbody>
  <tendon>
    <spatial limited="true" range="0 {1 + math.pi * RADIUS}" solreflimit="2e-4 1" solimplimit="0.9999 0.9999">
      <site site="heavy"/><geom geom="rod" sidesite="top"/><site site="light"/>
    </spatial>
  </tendon>
</mujoco>""")
data = mujoco.MjData(model)
while data.time < TIME - 1e-9:
    mujoco.mj_step(model, data)
light_acceleration, heavy_acceleration = data.qvel / data.time
observed = HEAVY * (GRAVITY + heavy_acceleration) / (LIGHT * (GRAVITY + light_acceleration))

holds = not abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f}, mended within {LIMIT}")
print(f"observed {observed:.5f} with mujoco {mujoco.__version__}: the claim {'holds' if holds else 'is mended'}")
raise SystemExit(int(holds))
