"""Every closed form against Newton's laws solved anew, and against runs."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from looping_pendulum.reference_ode import closed_forms
from looping_pendulum.reference_ode.geometry import light_position
from looping_pendulum.reference_ode.solve import solve
from looping_pendulum.reference_ode.transitions import Event
from tests.apparatus import TEN_TO_ONE, TWO_TO_ONE, WITHOUT_LOSSES

STICKY = TEN_TO_ONE.replace(static_friction=0.5, light_drag=0.0, heavy_drag=0.0, string_drag=0.0)
"""Static and kinetic friction differ, so that neither can stand in for the other."""


@pytest.mark.parametrize("heavy_mass", [0.1, 0.06, 0.5])
@pytest.mark.parametrize("gravity", [9.81, 1.6])
def test_atwood_acceleration_solves_newtons_laws(heavy_mass, gravity):
    # Oracle: M1 a = T1 - M1 g, M2 a = M2 g - T2, T2 = T1 exp(mu pi), as linear equations for a, T1 and T2.
    p = STICKY.replace(release="vertical", heavy_mass=heavy_mass, gravity=gravity)
    m1, m2, ratio = p.light_mass, p.heavy_mass, math.exp(0.34 * math.pi)
    a, _, _ = np.linalg.solve([[m1, -1, 0], [m2, 0, 1], [0, -ratio, 1]], [-m1 * gravity, m2 * gravity, 0])
    assert closed_forms.atwood_acceleration(p) == pytest.approx(a, rel=1e-12)


@pytest.mark.parametrize(("times_the_edge", "moves"), [(1 - 1e-9, False), (1 + 1e-9, True)])
def test_the_static_friction_decides_whether_an_atwood_machine_moves(times_the_edge, moves):
    edge = STICKY.light_mass * math.exp(0.5 * math.pi)
    p = STICKY.replace(release="vertical", heavy_mass=edge * times_the_edge)
    assert (closed_forms.atwood_acceleration(p) > 0) is moves


def test_free_fall_without_drag_is_galileos():
    # Oracle: by hand, in units of g / 2: squares of the time.
    fallen = closed_forms.free_fall(np.array([0.0, 1.0, 2.0, 3.0]), mass=0.01, drag=0.0, gravity=9.81)
    np.testing.assert_allclose(fallen, 4.905 * np.array([0, 1, 4, 9]), rtol=1e-14)


@pytest.mark.parametrize(("mass", "drag"), [(0.01, 2e-3), (0.1, 2e-3), (2.0, 0.5)])
def test_free_fall_with_drag_is_its_differential_equation_integrated(mass, drag):
    t = np.linspace(0, 3, 31)
    exact = solve_ivp(lambda _, y: [y[1], 9.81 - drag / mass * y[1] ** 2], (0, 3), [0, 0], "DOP853", t, rtol=1e-12, atol=1e-12)
    fallen = closed_forms.free_fall(t, mass=mass, drag=drag, gravity=9.81)
    np.testing.assert_allclose(fallen, exact.y[0], rtol=0, atol=1e-9)  # a thousand times the tolerance of a step


def test_free_fall_of_almost_no_drag_is_the_one_without():
    # The first term that drag adds is gamma g^2 t^4 / (12 M), here 8e-8 m; ln cosh(x) - x^2 / 2 is rounded at 1e-16 M / gamma.
    t = np.linspace(0, 1, 11)
    thin, none = (closed_forms.free_fall(t, mass=1.0, drag=drag, gravity=9.81) for drag in (1e-8, 0.0))
    np.testing.assert_allclose(none - thin, 1e-8 * 9.81**2 * t**4 / 12, rtol=0, atol=5e-8)
    assert np.abs(none - thin).max() < 2e-7


def test_the_spiral_is_the_place_of_a_light_mass_on_a_string_of_fixed_length():
    halt = {"halt_length": 0.4, "halt_angle": 3.0, "rod_radius": 0.02}
    angle = np.linspace(3.0, 20.0, 200)
    rho, psi = closed_forms.spiral(angle, **halt)
    x, y = light_position(np, 0.4 - 0.02 * (angle - 3.0), angle, 0.02)
    np.testing.assert_allclose(rho * np.cos(psi), x, rtol=0, atol=1e-14)
    np.testing.assert_allclose(rho * np.sin(psi), y, rtol=0, atol=1e-14)


def test_what_winds_without_gravity_and_drag_keeps_its_speed():
    # With w = l theta' constant and l' = -R theta', l^2 falls as 2 R w t, to 0 at l0^2 / (2 R w).
    p = TEN_TO_ONE.replace(release="held", push_across=2.0, **WITHOUT_LOSSES | {"gravity": 0.0})
    run = solve(p, duration=20)
    t = np.linspace(0, run.end_time, 50)
    state = run.sample(t).state
    end = p.free_length**2 / (2 * p.rod_radius * 2.0)
    assert run.end_time == pytest.approx(end * (1 - (p.end_length / p.free_length) ** 2), abs=1e-9)
    # Begun at any halt: here a second later in time
    halt = {"halt_length": p.free_length, "halt_time": 1.0, "end_time": end + 1.0}
    length = closed_forms.halted_free_length(t + 1.0, **halt)
    np.testing.assert_allclose(length, state.free_length, rtol=0, atol=1e-9)
    wound = (p.free_length - length) / p.rod_radius
    np.testing.assert_allclose(wound, state.wrap_angle - p.release_angle, rtol=0, atol=1e-7)


@pytest.mark.parametrize(
    ("degrees", "radius", "length", "gravity"),
    [(112, 0.00625, 0.58, 9.81), (101, 0.05, 0.58, 9.81), (150, 0.1, 0.3, 1.6), (172, 0.3, 0.4, 9.81)],
)
def test_the_held_period_is_that_of_a_run(degrees, radius, length, gravity):
    # On the last, thick rod the string would be wound up before a full turn.
    p = TEN_TO_ONE.replace(release="held", rod_radius=radius, free_length=length, release_angle=math.radians(degrees))
    p = p.replace(**WITHOUT_LOSSES, gravity=gravity)
    run = solve(p, duration=6, tolerance=1e-11)
    turns = [e.time for e in run.events if e.event is Event.ACROSS_REVERSES]
    assert closed_forms.held_period(p) == pytest.approx(turns[1], abs=1e-8)


@pytest.mark.parametrize(("degrees", "taken"), [(80, False), (91, False), (92, True), (179, True), (180, False), (200, False)])
def test_a_held_period_needs_a_string_that_stays_taut(degrees, taken):
    # A release at 91 deg is so high that on the other side, on a shorter string, the mass would come above the horizontal:
    # there the period was taken for one of a taut string, and differed from a run's by 0.1 %.
    p = TEN_TO_ONE.replace(release="held", release_angle=math.radians(degrees))
    if taken:
        assert closed_forms.held_period(p) > 0
    else:
        with pytest.raises(ValueError, match="release between 90 and 180 deg, below the rod"):
            closed_forms.held_period(p)


@pytest.mark.parametrize("degrees", [95, 112, 160])
@pytest.mark.parametrize("p", [STICKY, TWO_TO_ONE.replace(gravity=1.6)])
def test_release_acceleration_solves_newtons_laws(p, degrees):
    # Oracle: five linear equations, in x and y, for the light mass's acceleration, the heavy one's and the two tensions:
    # M1 a1 = T1 e1 - M1 g y, M2 a2 = T2 - M2 g, T2 = T1 exp(mu theta), and a string of fixed length, a1 . e1 = -a2.
    p = p.replace(release_angle=math.radians(degrees))
    m1, m2, g = p.light_mass, p.heavy_mass, p.coefficients["gravity"]
    ex, ey = math.sin(p.release_angle), -math.cos(p.release_angle)
    ratio = math.exp(p.coefficients["kinetic_friction"] * p.release_angle)
    laws = [
        [m1, 0, 0, -ex, 0],
        [0, m1, 0, -ey, 0],
        [0, 0, m2, 0, -1],
        [0, 0, 0, -ratio, 1],
        [ex, ey, 1, 0, 0],
    ]
    expected = np.linalg.solve(laws, [0, -m1 * g, -m2 * g, 0, 0])[:3]
    np.testing.assert_allclose(closed_forms.release_acceleration(p), expected, rtol=1e-12)


def test_release_acceleration_is_that_of_a_run():
    p = STICKY.replace(light_drag=1e-3)
    t = np.array([0.0, 1e-3])
    samples = solve(p, duration=2e-3).sample(t)
    x, y = 2 * (samples.light_position[1] - samples.light_position[0]) / t[1] ** 2
    heavy = 2 * (samples.heavy_position[1, 1] - samples.heavy_position[0, 1]) / t[1] ** 2
    # the next term of the motion is of order (g / l) t^2, 2e-5 of the first
    np.testing.assert_allclose((x, y, heavy), closed_forms.release_acceleration(p), rtol=1e-4)


@pytest.mark.parametrize(("times_the_edge", "slides"), [(1 - 1e-9, False), (1 + 1e-9, True)])
def test_a_string_that_the_rod_holds_has_no_release_acceleration(times_the_edge, slides):
    # Oracle: the capstan law for the light mass's weight along its string, M1 g sin(112 deg - 90 deg)
    edge = STICKY.light_mass * math.sin(math.radians(22)) * math.exp(0.5 * math.radians(112))
    p = STICKY.replace(heavy_mass=edge * times_the_edge)
    if slides:
        assert closed_forms.release_acceleration(p)[2] < 0
    else:
        with pytest.raises(ValueError, match="needs a heavier heavy mass"):
            closed_forms.release_acceleration(p)
