"""Random states of every mode and effect, with their forces as vectors, for `test_newton`."""

import math

import numpy as np
import pytest

from looping_pendulum.reference_ode.effects.library import REST_SPEED
from looping_pendulum.reference_ode.equations import Equations
from looping_pendulum.reference_ode.state import Signs, State, extra_variables
from looping_pendulum.reference_ode.transitions import Mode
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
