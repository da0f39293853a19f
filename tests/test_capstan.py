"""The capstan law for a tendon of any MuJoCo model, on models that are not this package's own."""

import math

import numpy as np
import pytest

from looping_pendulum.capstan import CapstanError, CapstanTendon
from looping_pendulum.reference_ode.geometry import light_position
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solve import solve

mujoco = pytest.importorskip("mujoco")

GRAVITY, MU, RADIUS = 9.81, 0.25, 0.04
CART, LOAD = 2.0, 0.5
STEP = 2e-4
STRING = 'limited="true" range="0 {length}" solreflimit="4e-4 1" solimplimit="0.9999 0.9999"'
SPRING = 'stiffness="2e4" damping="20" springlength="0 {length}"'
LENGTH = 0.46 + math.pi / 2 * RADIUS + 0.5 - 1e-9  # shorter by a nanometre, or rounding decides whether it is taut at first


def quarter_turn(string=STRING, side_first=True, cart="", actuator='<motor joint="cart"/>'):
    """A cart of 2 kg on a level track pulls a load of 0.5 kg up over a quarter of a rod of 40 mm, by a motor."""
    ends = ("load", "cart") if side_first else ("cart", "load")
    mark = f"-0.1 0 {RADIUS}" if side_first else f"{RADIUS} 0 -0.1"
    return mujoco.MjModel.from_xml_string(f"""
    <mujoco>
      <option timestep="{STEP}" integrator="implicitfast" jacobian="dense" tolerance="1e-12" gravity="0 0 -{GRAVITY}"/>
      <worldbody>
        <geom name="rod" type="cylinder" size="{RADIUS} 0.1" euler="90 0 0" contype="0" conaffinity="0"/>
        <site name="above" pos="0.1 0 0.1"/><site name="mark" pos="{mark}"/>
        <body pos="-0.5 0 {RADIUS}"><joint name="cart" type="slide" axis="-1 0 0" {cart}/><site name="cart"/>
          <inertial pos="0 0 0" mass="{CART}" diaginertia="1e-3 1e-3 1e-3"/></body>
        <body pos="{RADIUS} 0 -0.46"><joint name="load" type="slide" axis="0 0 1"/><site name="load"/>
          <inertial pos="0 0 0" mass="{LOAD}" diaginertia="1e-3 1e-3 1e-3"/></body>
      </worldbody>
      <tendon>
        <spatial name="rope" {string.format(length=LENGTH)}>
          <site site="load"/><geom geom="rod" sidesite="above"/><site site="cart"/></spatial>
        <spatial name="side" solreffriction="4e-4 1" solimpfriction="0.9999 0.9999">
          <site site="{ends[0]}"/><geom geom="rod" sidesite="above"/><site site="mark"/></spatial>
      </tendon>
      <actuator>{actuator}</actuator>
    </mujoco>""")


def run(model, motor, duration, friction=MU):
    """Return the data after ``duration`` [s] with the motor's force [N], a number or a function of time, and the capstan."""
    data = mujoco.MjData(model)
    capstan = CapstanTendon(model, data, tendon="rope", side="side", friction=friction)
    while data.time < duration - 1e-9:
        if model.nu:
            data.ctrl[0] = motor(data.time) if callable(motor) else motor
        capstan.prepare()
        mujoco.mj_step(model, data)
    return data, capstan


RATIO = math.exp(MU * math.pi / 2)
WEIGHT = LOAD * GRAVITY


DURATION = 0.05


@pytest.mark.parametrize("side_first", [True, False], ids=["load", "cart"])
@pytest.mark.parametrize(
    ("motor", "ratio"),
    [
        (1.5 * WEIGHT * RATIO, RATIO),
        (1.05 * WEIGHT * RATIO, RATIO),
        (0.95 * WEIGHT * RATIO, None),
        (WEIGHT, None),
        (1.05 * WEIGHT / RATIO, None),
        (0.9 * WEIGHT / RATIO, 1 / RATIO),
        (0.0, 1 / RATIO),
    ],
    ids=["up fast", "up", "held above", "balanced", "held below", "down", "free"],
)
def test_a_motor_lifts_holds_or_lowers_a_load_as_the_capstan_law_says(motor, ratio, side_first):
    # F - T1 = M a on the cart's side and T2 - m g = m a on the load's; T1 = ratio T2, or the string is at rest
    acceleration = 0.0 if ratio is None else (motor - ratio * WEIGHT) / (CART + ratio * LOAD)
    data, capstan = run(quarter_turn(side_first=side_first), motor, DURATION)
    # The constraints' softness: the first steps, in which the string tightens by 1 nm, and a creep of 1e-6 m/s
    assert data.qvel == pytest.approx(acceleration * DURATION, abs=2e-4 * abs(acceleration) + 2e-6)
    assert data.qpos == pytest.approx(0.5 * acceleration * DURATION**2, abs=STEP * abs(acceleration) * DURATION + 1e-7)
    assert capstan.wrap_angle == pytest.approx(math.pi / 2, abs=1e-9)
    side, other = capstan.tensions
    on_cart, on_load = (other, side) if side_first else (side, other)
    assert on_load == pytest.approx(LOAD * (GRAVITY + acceleration), rel=1e-3)
    if ratio is not None:
        assert on_cart / on_load == pytest.approx(ratio, rel=1e-9)


def test_an_elastic_string_has_the_ratio_too():
    data, capstan = run(quarter_turn(SPRING), 1.5 * WEIGHT * RATIO, DURATION)
    on_load, on_cart = capstan.tensions
    assert data.qvel[1] > 0.01
    assert data.efc_type.tolist() == [mujoco.mjtConstraint.mjCNSTR_FRICTION_TENDON.value]  # no limit holds it
    assert on_cart / on_load == pytest.approx(RATIO, rel=1e-9)


def test_a_winch_pulls_the_load_by_less_than_its_own_force():
    pull = 2 * WEIGHT * RATIO
    data, _ = run(quarter_turn('limited="false"', actuator='<motor tendon="rope"/>'), -pull, DURATION)
    assert data.qvel[1] == pytest.approx((pull / RATIO / LOAD - GRAVITY) * DURATION, rel=1e-6)
    assert data.qvel[0] == pytest.approx(-pull / CART * DURATION, rel=1e-6)


def test_without_friction_the_string_slides_freely():
    data, capstan = run(quarter_turn(), 0.0, DURATION, friction=0.0)
    assert data.qvel == pytest.approx(-WEIGHT / (CART + LOAD) * DURATION, rel=2e-4)
    assert capstan.tensions[0] == pytest.approx(capstan.tensions[1], rel=1e-9)


def test_a_slack_string_has_no_friction():
    data, capstan = run(quarter_turn(), -3 * CART * GRAVITY, 2 * STEP)  # the motor pushes the cart after the load
    assert capstan.tensions == pytest.approx((0.0, 0.0), abs=1e-9)
    assert data.qvel[1] == pytest.approx(-GRAVITY * 2 * STEP, rel=1e-9)


def test_a_light_mass_that_winds_up_moves_as_in_the_reference():
    # Two masses, another rod and friction than in the scenarios; the wrap angle grows from 100 deg on
    p = Parameters(
        light_mass=0.05,
        heavy_mass=0.3,
        rod_radius=0.02,
        free_length=0.5,
        release_angle=math.radians(100),
        hanging_length=0.1,
        coefficients={"kinetic_friction": 0.4},
    )
    x, z = light_position(math, p.free_length, p.release_angle, p.rod_radius)
    model = mujoco.MjModel.from_xml_string(f"""
    <mujoco>
      <option timestep="{STEP}" integrator="implicitfast" jacobian="dense" tolerance="1e-12" gravity="0 0 -{GRAVITY}"/>
      <worldbody>
        <geom name="rod" type="cylinder" size="0.02 0.1" euler="90 0 0" contype="0" conaffinity="0"/>
        <site name="above" pos="0 0 0.04"/><site name="mark" pos="0 0 0.02"/>
        <body pos="{x} 0 {z}"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/><site name="light"/>
          <inertial pos="0 0 0" mass="0.05" diaginertia="1e-3 1e-3 1e-3"/></body>
        <body pos="0.02 0 -0.1"><joint type="slide" axis="0 0 1"/><site name="heavy"/>
          <inertial pos="0 0 0" mass="0.3" diaginertia="1e-3 1e-3 1e-3"/></body>
      </worldbody>
      <tendon>
        <spatial name="rope" {STRING.format(length=p.string_length - 1e-9)}>
          <site site="heavy"/><geom geom="rod" sidesite="above"/><site site="light"/></spatial>
        <spatial name="side" solreffriction="4e-4 1" solimpfriction="0.9999 0.9999">
          <site site="heavy"/><geom geom="rod" sidesite="above"/><site site="mark"/></spatial>
      </tendon>
    </mujoco>""")
    data = mujoco.MjData(model)
    capstan = CapstanTendon(model, data, tendon="rope", side="side", friction=0.4)
    duration = 0.2
    for _ in range(round(duration / STEP)):
        capstan.prepare()
        mujoco.mj_step(model, data)
    exact = solve(p).sample(np.array([duration]))
    light, heavy = exact.light_position[0], exact.heavy_position[0]
    # Half a step of fall, g t dt / 2, and what MuJoCo leaves out of a turning string
    assert np.array([x, z]) + data.qpos[:2] == pytest.approx(light, abs=2 * GRAVITY * duration * STEP)
    assert -0.1 + data.qpos[2] == pytest.approx(heavy[1], abs=GRAVITY * duration * STEP)
    assert capstan.wrap_angle > math.radians(105)


@pytest.mark.parametrize(
    ("names", "friction", "message"),
    [
        (("rope", "no"), 0.2, "found no 'no' in the model; choose of rope, side"),
        (("rope", "side"), -0.1, "friction: found -0.1"),
    ],
)
def test_what_is_missing_is_named(names, friction, message):
    model = quarter_turn()
    with pytest.raises(CapstanError, match=message):
        CapstanTendon(model, mujoco.MjData(model), tendon=names[0], side=names[1], friction=friction)


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ('<site site="load"/><site site="cart"/>', "found nothing that it wraps"),
        (
            '<site site="load"/><geom geom="rod"/><site site="mark"/>'
            '<pulley divisor="2"/><site site="mark"/><site site="cart"/>',
            "found a pulley",
        ),
    ],
)
def test_a_string_that_the_law_does_not_fit_is_refused(path, message):
    xml = f"""<mujoco><worldbody><geom name="rod" type="cylinder" size="0.1 0.1"/><site name="mark" pos="1 0 1"/>
      <body pos="1 0 0"><freejoint/><geom size="0.1"/><site name="load"/></body><site name="cart" pos="-1 0 0"/></worldbody>
      <tendon><spatial name="rope">{path}</spatial></tendon></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    with pytest.raises(CapstanError, match=message):
        CapstanTendon(model, mujoco.MjData(model), tendon="rope", side="rope", friction=0.2)
