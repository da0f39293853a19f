"""MuJoCo: beads on links over a cylinder, whose own contact friction obeys the capstan law, once its defaults are changed.

Two masses hang on one rope over a rod, half a turn. The heavy one weighs twice what friction could hold, so the rope slides;
weight and acceleration of each mass give the tension on its side. An elliptic cone with a large impratio, contacts with a short
time constant, and short steps do it; corners hold more than a curve, so their coefficient is made smaller.

Closed form: 2.90997 = exp(mu theta), ratio of the tensions
Observed: 2.90534 with mujoco 4.0.0, give or take 0.005
Reached: within 0.05 of the closed form
"""

import math

import mujoco

STEP, CORNERS, SPARE, BEAD = 1e-5, 11, 12, 1e-3
MU, RADIUS, GRAVITY, TIME, LIGHT = 0.34, 0.00625, 9.81, 0.1, 0.01
LIMIT = 0.05
closed_form = math.exp(MU * math.pi)
HEAVY = 2 * LIGHT * closed_form

bend = math.pi / CORNERS
link = RADIUS * bend
node_radius = link / (2 * math.sin(bend / 2))  # so that one link winds up as much string as it is long
friction = math.tanh(MU * bend / 2) / math.tan(bend / 2)
angles = [bend * (i + 0.5) for i in range(CORNERS)]
places = [(node_radius * math.cos(angle), node_radius * math.sin(angle)) for angle in angles]
places += [(-RADIUS, -link * (i + 0.5)) for i in range(SPARE)]  # they will be drawn over the rod
row = [(RADIUS, -0.2), *places, (-RADIUS, -0.2)]
last = len(row) - 1
soft = f'"{10 * STEP} 1"'
bodies = "".join(
    f'<body pos="{x} 0 {z}"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/><site name="s{i}"/>'
    f'<inertial pos="0 0 0" mass="{mass}" diaginertia="1e-6 1e-6 1e-6"/><geom name="g{i}" size="{BEAD}"/></body>'
    for i, ((x, z), mass) in enumerate(zip(row, [HEAVY, *[2e-4 * LIGHT] * (last - 1), LIGHT], strict=True))
)
links = "".join(f'<spatial name="t{i}"><site site="s{i}"/><site site="s{i + 1}"/></spatial>' for i in range(last))
rigid = "".join(f'<tendon tendon1="t{i}" solref={soft} solimp="0.9999 0.9999"/>' for i in range(last))
pairs = "".join(
    f'<pair geom1="rod" geom2="g{i}" friction="{friction} {friction} 0 0 0" solref={soft} solimp="0.99 0.9999 5e-4"/>'
    for i in range(1, last)
)
model = mujoco.MjModel.from_xml_string(f"""
<mujoco><compiler inertiafromgeom="false"/><default><geom contype="0" conaffinity="0"/></default>
  <option timestep="{STEP}" integrator="implicitfast" cone="elliptic" impratio="100" jacobian="sparse" iterations="20"
    tolerance="1e-10" gravity="0 0 -{GRAVITY}"/>
  <worldbody><geom name="rod" type="cylinder" size="{node_radius - BEAD} 0.05" euler="90 0 0"/>{bodies}</worldbody>
  <tendon>{links}</tendon><equality>{rigid}</equality><contact>{pairs}</contact></mujoco>""")
data = mujoco.MjData(model)
mujoco.mj_step(model, data, round(TIME / STEP))
heavy_mass_speed, light_mass_speed = data.qvel[1], data.qvel[-1]
observed = HEAVY * (GRAVITY + heavy_mass_speed / TIME) / (LIGHT * (GRAVITY + light_mass_speed / TIME))

holds = abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f}, reached within {LIMIT}")
print(f"observed {observed:.5f} with mujoco {mujoco.__version__}: the recipe {'holds' if holds else 'fails'}")
raise SystemExit(int(not holds))
