"""Newton's second law at random states of every mode and effect, in x, y and z, against the lines that the integrators run.

The accelerations are differences of the velocities along the rates that the equations give; the forces are written here anew,
as vectors. Bounds: central differences over 1e-6 s err by 1e-12 of the third derivative and by rounding over 1e-6, 1e-9.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from looping_pendulum.reference_ode.effects.properties import REST_SPEED
from looping_pendulum.reference_ode.equations import Equations
from looping_pendulum.reference_ode.state import Signs, State, extra_variables, string_path
from looping_pendulum.reference_ode.transitions import Event, Mode
from tests.apparatus import TEN_TO_ONE

H = 1e-6
"""Step of the finite differences [s]."""
CLOSE = 1e-6
"""Tolerance, as a fraction of the largest force or speed in the comparison."""
TURN = 2 * math.pi
USUAL = {"kinetic_friction": 0.2, "static_friction": 0.3, "light_drag": 0.02, "heavy_drag": 0.03, "string_drag": 0.05}
EFFECT_SETS = {
    "base": {},
    "air": {"light_linear_drag": 0.02, "heavy_linear_drag": 0.4, "attitude_drag": 1.7, "wind_speed": 1.3},
    "side": {"side_force": 0.04, "side_stiffness": 0.3},
    "string laws": {"friction_per_speed": 0.2, "friction_per_wrap": 0.03, "string_on_string": 0.1},
    "heavy string": {"string_density": 0.02},
    "thick string": {"string_thickness": 2e-3},
    "swing": {"heavy_swing": 0.3, "heavy_linear_drag": 0.3},
    "sideways": {"push_sideways": 0.5, "wind_speed": 0.8, "attitude_drag": 0.7},
    "turning rod": {"rod_mobility": 12.0, "bearing_friction": 0.15, "friction_per_speed": 0.2},
    "stretch": {"string_compliance": 2e-3, "string_loss_time": 3e-3},
}
RIGID = set(EFFECT_SETS) - {"stretch"}
EFFECT_SETS["all of a rigid string"] = {n: v for name in RIGID for n, v in EFFECT_SETS[name].items()}
EFFECT_SETS["all on a fixed rod"] = {
    n: v for name in EFFECT_SETS if name != "all of a rigid string" for n, v in EFFECT_SETS[name].items()
} | {"rod_mobility": 0.0, "string_thickness": 0.0, "push_sideways": 0.0}
TAUT = (Mode.SLIDING_DOWN, Mode.SLIDING_UP, Mode.STICKING, Mode.ROLLING, Mode.CLAMPED)
WITHOUT_STRING = ("base", "air", "side")
MODES = [mode for mode in Mode if mode is not Mode.ENDED]
CASES = [
    (mode, name)
    for mode in MODES
    for name, values in EFFECT_SETS.items()
    if (mode is not Mode.ROLLING or values.get("rod_mobility")) and (mode is not Mode.FALLING or name in WITHOUT_STRING)
]


def of(*modes: Mode):
    """Parametrize over every set of effects in these modes."""
    cases = [case for case in CASES if case[0] in modes]
    return pytest.mark.parametrize(("mode", "name"), cases, ids=lambda x: x.name.lower() if isinstance(x, Mode) else x)


EVERY = of(*MODES)


class Instant:
    """A random state of a mode, with its rates and tensions."""

    def __init__(self, mode: Mode, name: str, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.mode, given = mode, EFFECT_SETS[name]
        release = "drop" if mode is Mode.FALLING else "looping"
        self.parameters = TEN_TO_ONE.replace(release=release, rod_radius=0.03, hanging_length=0.7, **USUAL | given)
        self.effects, self.p = self.parameters.effects, self.parameters.values()
        own = extra_variables(self.effects)
        self.overlap = float(seed % 2)
        angle = rng.uniform(6.5, 8.0) if self.overlap else rng.uniform(1.0, 6.0)
        slide = {Mode.SLIDING_UP: 1.0, Mode.SLIDING_DOWN: -1.0}.get(mode, 1.0)
        u, w, free = rng.normal(0, 1), rng.normal(0, 2), rng.uniform(0.2, 0.5)
        sideways = {"sideways": rng.normal(0, 0.2), "sideways_speed": rng.normal(0, 0.5)} if "sideways" in own else {}
        tilt = {"heavy_tilt": rng.normal(0, 0.4), "heavy_across_speed": rng.normal(0, 1)} if "heavy_tilt" in own else {}
        stretch = {"light_stretch": rng.uniform(1e-3, 3e-3), "heavy_stretch": rng.uniform(1e-3, 3e-3)}
        stretch = stretch if "light_stretch" in own else {}
        rod = {"rod_speed": rng.normal(0, 0.5)} if "rod_speed" in own else {}
        slack = rng.uniform(0.01, 0.05) if mode.slack and mode is not Mode.FALLING else 0.0
        y = State(free, angle, u, w, 0.0, slack, **sideways, **tilt, **rod, **stretch)
        path = free + self.p.rod_radius * angle
        if "string_thickness" in given and given["string_thickness"] and self.overlap:
            path += given["string_thickness"] / TURN * (0.5 * (angle - TURN) ** 2 + 1.0)
        whole = math.hypot(path, y.sideways)
        grows = (path * u + y.sideways * y.sideways_speed) / whole
        heavy = grows if mode.string_moves else rng.normal(0, 1) if mode in (Mode.SLACK, Mode.FALLING) or stretch else 0.0
        if stretch and mode is Mode.CLAMPED:
            heavy = 0.0
        if not stretch and not mode.string_moves and not mode.slack:  # held: the path does not grow
            u = -y.sideways * y.sideways_speed / path
            grows = 0.0
        if mode.sliding and not stretch:  # as fast as it must slide, the way it does
            relative = slide * rng.uniform(0.2, 1.5)
            heavy = relative + y.rod_speed
            u, grows = (heavy * whole - y.sideways * y.sideways_speed) / path, heavy
        if mode in (Mode.STICKING, Mode.CLAMPED, Mode.CLAMPED_SLACK):
            y = y._replace(rod_speed=0.0)
        if mode is Mode.ROLLING:
            y = y._replace(rod_speed=heavy)
        self.y = y._replace(retreat_speed=u, heavy_speed=heavy)
        self.path, self.whole, self.grows = path, whole, grows
        rod_sign = float(np.sign(self.y.rod_speed))
        across, heavily = math.copysign(1.0, w), math.copysign(1.0, heavy)
        self.signs = Signs(slide, across, heavily, 1.0, self.overlap, rod=rod_sign, rod_phase=1.0)
        self.rates = Equations(math, self.p, self.effects).rates(mode, 0.3, self.y, self.signs)
        self.t1, self.t2 = Equations(math, self.p, self.effects).tensions(mode, 0.3, self.y, self.signs)

    def moved(self, h: float) -> State:
        return State(*(a + h * b for a, b in zip(self.y, self.rates, strict=True)))

    def slope(self, function) -> np.ndarray:
        """Derivative by time of a function of the state."""
        return (np.asarray(function(self.moved(H))) - np.asarray(function(self.moved(-H)))) / (2 * H)

    @property
    def spiral(self) -> tuple[float, float]:
        """Growth of the wound radius per radian, where string lies on string, and the angle beyond the first turn."""
        return (self.overlap * self.p.string_thickness / TURN, self.y.wrap_angle - TURN)

    def light_mass_position(self, y: State) -> np.ndarray:
        """From the support function h of what is wound: h n + (h' + l) a, n = (cos, sin), a = (-sin, cos) of theta."""
        growth = self.spiral[0]
        n = np.array([math.cos(y.wrap_angle), math.sin(y.wrap_angle), 0.0])
        a = np.array([-n[1], n[0], 0.0])
        h = self.p.rod_radius + growth * (y.wrap_angle - TURN)
        return h * n + (growth + y.free_length) * a + np.array([0.0, 0.0, y.sideways])

    @staticmethod
    def light_velocity(y: State) -> np.ndarray:
        n = np.array([math.cos(y.wrap_angle), math.sin(y.wrap_angle), 0.0])
        return y.retreat_speed * np.array([-n[1], n[0], 0.0]) - y.across_speed * n + np.array([0.0, 0.0, y.sideways_speed])

    @staticmethod
    def heavy_velocity(y: State) -> np.ndarray:
        down = np.array([math.sin(y.heavy_tilt), -math.cos(y.heavy_tilt)])
        return -y.heavy_speed * down + y.heavy_across_speed * np.array([-down[1], down[0]])

    @property
    def directions(self) -> tuple[np.ndarray, np.ndarray]:
        """Along the string's plane part, away from the rod, and the paper's t1."""
        c, s = math.cos(self.y.wrap_angle), math.sin(self.y.wrap_angle)
        return np.array([-s, c, 0.0]), np.array([-c, -s, 0.0])

    def force_on_light(self) -> np.ndarray:
        """Every force but the string's pull and its inertia [N]."""
        p, y = self.p, self.y
        away, t1 = self.directions
        v = self.light_velocity(y)

        def drag(through_air: np.ndarray) -> np.ndarray:
            speed = np.linalg.norm(through_air)
            slant = (through_air @ away / speed) ** 2
            return -(p.light_linear_drag + p.light_drag * (1 + p.attitude_drag * slant) * speed) * through_air

        sagging = p.string_density * y.free_length / 2  # half of the free string's weight
        if self.mode is Mode.FALLING:
            sagging = 0.0
        force = np.array([0.0, -(p.light_mass + sagging) * p.gravity, 0.0]) + drag(v - np.array([p.wind_speed, 0.0, 0.0]))
        if self.mode is not Mode.FALLING:
            force = force - p.string_drag * y.free_length * abs(y.across_speed) * y.across_speed * t1
        x = p.rod_radius * math.cos(y.wrap_angle) - y.free_length * math.sin(y.wrap_angle)
        return force + np.array([p.side_force + p.side_stiffness * x, 0.0, 0.0])

    def force_on_heavy(self) -> np.ndarray:
        p, v = self.p, self.heavy_velocity(self.y)
        rounded = {"heavy_tilt", "light_stretch"} & extra_variables(self.effects) or (self.p.rod_mobility and self.mode.sliding)
        speed = math.hypot(*v, REST_SPEED if rounded else 0.0)
        weight = np.array([0.0, -p.heavy_mass * p.gravity])
        if self.mode is not Mode.FALLING:
            weight = weight + np.array([0.0, -p.string_density * p.gravity * self.hanging])
        return weight - (p.heavy_drag * speed + p.heavy_linear_drag) * v

    @property
    def hanging(self) -> float:
        return self.p.string_length - self.whole - self.y.slack

    def capstan(self, friction: float, per_speed: float) -> float:
        """Exponent for a coefficient of friction."""
        p, contact = self.p, self.y.wrap_angle - self.y.heavy_tilt
        slip_speed = abs(self.y.heavy_speed - self.y.rod_speed)
        if "light_stretch" in extra_variables(self.effects):  # by the heavy mass's speed, whose size is rounded off at rest
            slip_speed = math.hypot(self.y.heavy_speed, REST_SPEED)
        twice = p.string_on_string * (self.y.wrap_angle - TURN) * self.overlap
        return friction * contact * (1 + per_speed * slip_speed + p.friction_per_wrap * contact) + twice


def instants(mode: Mode, name: str) -> list[Instant]:
    return [Instant(mode, name, seed) for seed in range(4)]


def assert_close(actual, expected, scale: float) -> None:
    np.testing.assert_allclose(actual, expected, rtol=0, atol=CLOSE * scale)


@EVERY
def test_speeds_are_the_derivatives_of_places(mode, name):
    for i in instants(mode, name):
        assert_close(i.slope(i.light_mass_position), i.light_velocity(i.y), 5.0)
        growing = i.slope(lambda y, i=i: string_path(math, y, i.overlap, i.p, i.effects))
        assert_close(growing, i.grows if not mode.slack else growing, 5.0)
        assert_close(i.rates.slack, i.y.heavy_speed - growing, 5.0)


@EVERY
def test_the_light_mass_obeys_newton(mode, name):
    for i in instants(mode, name):
        away, t1 = i.directions
        acceleration = i.slope(i.light_velocity)
        pull = -i.t1 / i.whole * (i.path * away + i.y.sideways * np.array([0.0, 0.0, 1.0]))
        force = i.force_on_light() + pull
        string = 0.0 if mode is Mode.FALLING else i.p.string_density * i.y.free_length
        scale = np.abs(force).max() + 1.0
        assert_close((i.p.light_mass + string / 2) * (acceleration @ away), force @ away, scale)
        assert_close((i.p.light_mass + string / 3) * (acceleration @ t1), force @ t1, scale)
        assert_close(i.p.light_mass * acceleration[2], force[2], scale)


@EVERY
def test_the_heavy_mass_obeys_newton(mode, name):
    for i in instants(mode, name):
        if mode in (Mode.CLAMPED, Mode.CLAMPED_SLACK):
            assert i.rates.heavy_speed == 0
            assert i.rates.heavy_tilt == i.rates.heavy_across_speed == 0
            continue
        down = np.array([math.sin(i.y.heavy_tilt), -math.cos(i.y.heavy_tilt)])
        force = i.force_on_heavy() - i.t2 * down
        if mode is Mode.STICKING and "light_stretch" not in extra_variables(i.effects):
            # what it does not swing it rests: the rod's hold makes up whatever is left along the string
            assert i.rates.heavy_speed == 0
            if "heavy_tilt" not in extra_variables(i.effects):
                assert i.t2 == pytest.approx(-i.force_on_heavy()[1], rel=1e-12)
                continue
        string = 0.0 if mode is Mode.FALLING else i.p.string_density * i.hanging
        left = (i.p.heavy_mass + string) * i.slope(i.heavy_velocity)
        assert_close(left, force, np.abs(force).max() + 1.0)
        turning = i.rates.heavy_tilt * (i.hanging + i.p.rod_radius * i.y.heavy_tilt)
        assert_close(turning, i.y.heavy_across_speed, 1.0)


@EVERY
def test_the_strings_law(mode, name):
    """No pull without a taut string; the capstan law where it slides; a fixed length where it does not stretch."""
    for i in instants(mode, name):
        if mode.slack:
            assert i.t1 == i.t2 == 0
            assert i.rates.rod_speed * i.signs.rod <= 0
            continue
        if mode.sliding:
            exponent = i.capstan(i.p.kinetic_friction, i.p.friction_per_speed)
            assert i.t2 / i.t1 == pytest.approx(math.exp(-i.signs.slide * exponent), rel=1e-9)
        stretch = "light_stretch" in extra_variables(i.effects)
        if not stretch:
            continue
        # Two springs with dampers, the stiffness of each by its share of the unstretched string
        share = (i.whole - i.y.light_stretch) / i.p.string_length
        tau, compliance = i.p.string_loss_time, i.p.string_compliance
        assert i.t1 == pytest.approx((i.y.light_stretch + tau * i.rates.light_stretch) / (compliance * share), rel=1e-9)
        assert i.t2 == pytest.approx((i.y.heavy_stretch + tau * i.rates.heavy_stretch) / (compliance * (1 - share)), rel=1e-9)
        assert i.rates.light_stretch + i.rates.heavy_stretch == pytest.approx(i.grows - i.y.heavy_speed, rel=1e-9)
        if not mode.sliding:
            assert i.rates.light_stretch == pytest.approx(i.grows, rel=1e-12)


@of(*TAUT)
def test_a_string_that_does_not_stretch_keeps_its_length(mode, name):
    for i in instants(mode, name):
        if "light_stretch" in extra_variables(i.effects):
            return

        # The second derivative of the path to the light mass, along the rates, is the heavy mass's acceleration
        def grows(y, i=i):
            speed = Instant.light_velocity(y)
            away = np.array([-math.sin(y.wrap_angle), math.cos(y.wrap_angle), 0.0])
            path = string_path(math, y._replace(sideways=0.0), i.overlap, i.p, i.effects)
            return (path * (speed @ away) + y.sideways * speed[2]) / math.hypot(path, y.sideways)

        assert_close(i.slope(grows), i.rates.heavy_speed, 100.0)


ROD = [case for case in CASES if EFFECT_SETS[case[1]].get("rod_mobility")]


@pytest.mark.parametrize(("mode", "name"), ROD)
def test_the_rod_obeys_newton(mode, name):
    for i in instants(mode, name):
        if mode in (Mode.STICKING, Mode.CLAMPED, Mode.CLAMPED_SLACK):
            assert i.rates.rod_speed == 0
            continue
        bearing = i.p.bearing_friction * math.copysign(1.0, i.y.rod_speed)
        assert i.rates.rod_speed == pytest.approx(i.p.rod_mobility * (i.t1 - i.t2 - bearing), rel=1e-9)
        held = Equations(math, i.p, i.effects).rates(mode, 0.3, i.y, i.signs._replace(rod=0.0))
        if mode is not Mode.ROLLING:
            assert held.rod_speed == 0


@EVERY
def test_what_an_effect_alone_moves_rests_without_it(mode, name):
    for i in instants(mode, name):
        absent = set(State._fields[6:]) - extra_variables(i.effects)
        assert {getattr(i.rates, n) for n in absent} <= {0.0}


# Events


def events(i: Instant, y: State | None = None, **signs: float) -> dict[Event, float]:
    return Equations(math, i.p, i.effects).event_functions(i.mode, 0.3, i.y if y is None else y, i.signs._replace(**signs))


@EVERY
def test_events_of_places_happen_there(mode, name):
    for i in instants(mode, name):
        actual = events(i)
        assert actual[Event.LIGHT_REACHES_ROD] == pytest.approx(i.y.free_length - i.parameters.end_length, rel=1e-12)
        assert actual[Event.ACROSS_REVERSES] == pytest.approx(abs(i.y.across_speed), rel=1e-12)
        if mode is Mode.FALLING:
            assert len(actual) == 2
            continue
        assert actual[Event.UNWRAPPED] == i.y.wrap_angle
        overlaps = any(effect.winding or effect.name == "string_on_string" for effect in i.effects)
        assert (Event.FIRST_TURN in actual) is overlaps
        if overlaps:
            assert actual[Event.FIRST_TURN] == pytest.approx(abs(i.y.wrap_angle - TURN), rel=1e-12)
        assert (Event.HEAVY_REACHES_ROD in actual) is (mode.string_moves or mode is Mode.SLACK)
        if mode.string_moves or mode is Mode.SLACK:
            assert actual[Event.HEAVY_REACHES_ROD] == pytest.approx(i.hanging, rel=1e-9)


@of(Mode.SLIDING_DOWN, Mode.SLIDING_UP)
def test_a_slide_ends_where_its_speed_or_its_tension_vanishes(mode, name):
    for i in instants(mode, name):
        actual, slide = events(i), i.signs.slide
        if "light_stretch" in extra_variables(i.effects):
            passing = i.grows - i.rates.light_stretch
            assert actual[Event.STOP] == pytest.approx(slide * passing, abs=1e-9)
            tau, whole = i.p.string_loss_time, i.y.light_stretch + i.y.heavy_stretch
            assert actual[Event.LOSES_TENSION] == pytest.approx(whole + tau * (i.grows - i.y.heavy_speed), rel=1e-9)
            continue
        relative = i.y.heavy_speed - i.y.rod_speed
        assert actual[Event.STOP] == pytest.approx(slide * relative, rel=1e-9)
        # phase 0 waits until that speed falls: its derivative, times an inertia without a rod
        ratio = math.exp(-slide * i.capstan(i.p.kinetic_friction, i.p.friction_per_speed))
        heavy = i.p.heavy_mass + i.p.string_density * i.hanging
        light = 1 / (
            (i.path / i.whole) ** 2 / (i.p.light_mass + i.p.string_density * i.y.free_length / 2)
            + (i.y.sideways / i.whole) ** 2 / i.p.light_mass
        )
        turns = "rod_speed" in extra_variables(i.effects)
        inertia = 1.0 if turns else heavy + light * ratio
        slows = slide * (i.rates.heavy_speed - (i.rates.rod_speed if turns else 0.0)) * inertia
        assert events(i, phase=0.0)[Event.STOP] == pytest.approx(slows, rel=1e-9)
        assert actual[Event.LOSES_TENSION] == pytest.approx(i.t1 * (heavy + light * ratio), rel=1e-7)
        if turns:
            assert actual[Event.ROD_CHANGES] == pytest.approx(abs(i.y.rod_speed), rel=1e-9)
            slowing = events(i, rod_phase=0.0)[Event.ROD_CHANGES]
            assert slowing == pytest.approx(i.signs.rod * i.rates.rod_speed, rel=1e-9)
            resting = i.y._replace(rod_speed=0.0)
            t1, t2 = Equations(math, i.p, i.effects).tensions(mode, 0.3, resting, i.signs._replace(rod=0.0))
            held = events(i, resting, rod=0.0)[Event.ROD_CHANGES]
            assert held == pytest.approx(i.p.bearing_friction - slide * (t1 - t2), rel=1e-9)


@of(Mode.STICKING, Mode.ROLLING)
def test_a_hold_ends_at_the_edge_of_the_friction_cone(mode, name):
    for i in instants(mode, name):
        actual, hold = events(i), math.exp(i.capstan(i.p.static_friction, 0.0))
        assert actual[Event.SLIP_ONSET_DOWN] == pytest.approx(i.t1 * hold - i.t2, rel=1e-9)
        assert actual[Event.SLIP_ONSET_UP] == pytest.approx(i.t2 * hold - i.t1, rel=1e-9)
        margins = Equations(math, i.p, i.effects).holding_margins(mode, 0.3, i.y, i.signs)
        assert margins == (actual[Event.SLIP_ONSET_DOWN], actual[Event.SLIP_ONSET_UP])
        turns = "rod_speed" in extra_variables(i.effects)
        assert (Event.ROD_YIELDS_UP in actual) is (turns and mode is Mode.STICKING)
        if mode is Mode.ROLLING:
            assert actual[Event.ROD_STOPS] == pytest.approx(abs(i.y.rod_speed), rel=1e-12)
            slowing = events(i, rod_phase=0.0)[Event.ROD_STOPS]
            assert slowing == pytest.approx(i.signs.rod * i.rates.rod_speed, rel=1e-9)
        elif turns:
            assert actual[Event.ROD_YIELDS_UP] == pytest.approx(i.p.bearing_friction - (i.t1 - i.t2), rel=1e-9)
            assert actual[Event.ROD_YIELDS_DOWN] == pytest.approx(i.p.bearing_friction + (i.t1 - i.t2), rel=1e-9)


@of(Mode.CLAMPED)
def test_a_clamped_string_loses_its_tension_at_none(mode, name):
    for i in instants(mode, name):
        assert events(i)[Event.LOSES_TENSION] == pytest.approx(i.t1, rel=1e-12)


@of(Mode.SLACK, Mode.CLAMPED_SLACK)
def test_a_slack_string_closes_before_it_is_taut(mode, name):
    """The event function of phase 0 is the derivative, along the motion, of that of phase 1."""
    for i in instants(mode, name):
        actual = events(i)
        stretch = "light_stretch" in extra_variables(i.effects)
        if not stretch:
            assert actual[Event.TAUT] == i.y.slack
        else:  # the stretch, and the loss time times its rate, of the whole string
            rate = i.slope(lambda y, i=i: string_path(math, y, i.overlap, i.p, i.effects)) - i.y.heavy_speed
            expected = -(i.y.light_stretch + i.y.heavy_stretch + i.p.string_loss_time * rate)
            assert_close(actual[Event.TAUT], expected, 1.0)
        closing = (events(i, i.moved(H))[Event.TAUT] - events(i, i.moved(-H))[Event.TAUT]) / (2 * H)
        assert_close(events(i, phase=0.0)[Event.TAUT], closing, 5.0)
        if mode is Mode.SLACK:
            assert actual[Event.HEAVY_REVERSES] == abs(i.y.heavy_speed)
            if "rod_speed" in extra_variables(i.effects):
                assert actual[Event.ROD_CHANGES] == pytest.approx(abs(i.y.rod_speed), rel=1e-12)
                assert events(i, i.y._replace(rod_speed=0.0), rod=0.0)[Event.ROD_CHANGES] == 1.0  # nothing turns it
