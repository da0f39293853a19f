"""An apparatus in Cartesian coordinates, made to produce data that the package's own equations did not produce.

Nothing here is imported from the package. Where the reference eliminates the string and switches between modes, this one keeps
it: a stiff, damped, unilateral string in two parts, one on either side of the place where it leaves the rod towards the heavy
mass, and one number ``passed`` for the string that has gone over to the light side. The rod lets string through only while
the tensions lie outside the friction cone, and then at the rate that puts them back onto its edge::

    T1 = k1 (p1 - L1 - s) + c1 (p1' - s'),   T2 = k2 (p2 - L2 + s) + c2 (p2' + s'),   T2 = T1 exp(-+ exponent) while s' != 0

with p the paths from that place to each mass. So sliding either way, sticking, slack and the pull that ends it are one set of
ordinary differential equations with a continuous right side, integrated by RK4 in fixed steps (shortened near the rod).

Origin: the centre of the rod, x right, y up, z along the rod. SI units.

Accuracy: the string's stiffness sets the distance to a rigid string (order 1/k, see the tests), not the step.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from math import atan2, exp, hypot, pi, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tests.blind import Apparatus, Effects

Array = NDArray[np.float64]

STEP_AT_ROD = 0.04
"""Largest angle of the light mass about the string's tangent point in a step [rad]."""


@dataclass(frozen=True, kw_only=True)
class Numerics:
    """How closely the string stands for a rigid one, and the step."""

    stiffness: float = 4e6
    """Of each part of the string where nothing says that it stretches [N/m]: 1 N then stretches it by 0.25 um."""
    loss_time: float = 1e-4
    """Damping over stiffness of such a string [s]: critical for 10 g."""
    step: float = 5e-5
    """[s]; the string's frequency with 10 g is 2e4 rad/s, and RK4 is stable up to 2.8 over that."""


DEFAULT = Numerics()


@dataclass(frozen=True, kw_only=True)
class Motion:
    """What happened, at every step. Arrays of shape (n,) or (n, 3)."""

    apparatus: Apparatus
    numerics: Numerics
    t: Array
    light: Array
    heavy: Array
    light_velocity: Array
    heavy_velocity: Array
    wrap_angle: Array
    light_tension: Array
    heavy_tension: Array
    stretch: Array
    """Of the part at the light mass and of the part at the heavy one [m], shape (n, 2)."""
    ended: bool
    """Whether the light mass reached the rod (or the heavy one did) before the time was up."""

    def at(self, t: Array) -> tuple[Array, Array]:
        """Positions (x, y) of the light and the heavy mass at times ``t`` [s], by cubic Hermite interpolation."""
        step = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.t) - 2)
        width = (self.t[step + 1] - self.t[step])[:, None]
        z = (t - self.t[step])[:, None] / width
        left, right = (1 + 2 * z) * (1 - z) ** 2, z * z * (3 - 2 * z)
        rise, fall = z * (1 - z) ** 2 * width, -z * z * (1 - z) * width

        def between(place: Array, speed: Array) -> Array:
            return (left * place[step] + right * place[step + 1] + rise * speed[step] + fall * speed[step + 1])[:, :2]

        return between(self.light, self.light_velocity), between(self.heavy, self.heavy_velocity)

    def energy(self) -> Array:
        """Kinetic, potential and elastic energy without any injected effect [J], shape (n,)."""
        a = self.apparatus
        moving = a.light_mass * (self.light_velocity**2).sum(axis=1) + a.heavy_mass * (self.heavy_velocity**2).sum(axis=1)
        height = a.gravity * (a.light_mass * self.light[:, 1] + a.heavy_mass * self.heavy[:, 1])
        return moving / 2 + height + self.numerics.stiffness * (np.maximum(self.stretch, 0) ** 2).sum(axis=1) / 2


State = list[float]
"""x, y, z of the light mass, x, y of the heavy one, string passed to the light side; x, y, z and x, y velocities; speed of the
rod's surface towards the light side."""


@dataclass
class _Contact:
    """What the string does on the rod, held during a step."""

    wrap_angle: float
    slip: int = 0
    """Direction in which the string slips: -1 towards the heavy mass, 0 none, 1 towards the light one."""
    rod: int = 0
    """Direction in which the rod turns."""


class _Instant(NamedTuple):
    """Rates of the state and what else the step control needs."""

    rates: State
    wrap_angle: float
    free_length: float
    light_tension: float
    heavy_tension: float
    holding_ratio: float
    stretch: tuple[float, float]

    @property
    def margin(self) -> float:
        """How far the rod is from letting a resting string slip [N]; negative: it slips."""
        down = self.holding_ratio * self.light_tension - self.heavy_tension
        return min(down, self.holding_ratio * self.heavy_tension - self.light_tension)


def simulate(
    apparatus: Apparatus, effects: Effects | None = None, *, duration: float = 1.1, numerics: Numerics = DEFAULT
) -> Motion:
    """Let go, and follow the masses until ``duration`` [s] or until one of them reaches the rod.

    Raises
    ------
    ValueError
        If the rod turns too easily for the step: then its coupling to the string's dampers is unstable.
    """
    e = effects if effects is not None else Effects()
    if 2 * e.rod_mobility * numerics.stiffness * numerics.loss_time * numerics.step > 2.5:
        raise ValueError(f"rod_mobility: found {e.rod_mobility:g}, too large for these numerics; shorten the step")
    state, rates, contact = _released(apparatus, e, numerics)
    end_length = sqrt(e.light_radius**2 + 2 * e.light_radius * apparatus.rod_radius) or apparatus.rod_radius / 3
    t, now, rows, ended = 0.0, rates(0.0, state, contact), [], False
    while True:
        if _settle(contact, state, now, e):
            now = rates(t, state, contact)
        rows.append((t, *state, now.wrap_angle, now.light_tension, now.heavy_tension, *now.stretch))
        ended = apparatus.release != "drop" and (now.free_length <= end_length or state[4] >= 0)
        if ended or t >= duration - 1e-12:
            break
        speed = hypot(state[6], state[7])
        h = min(numerics.step, STEP_AT_ROD * now.free_length / max(speed, 1e-3), duration - t)
        following = _runge_kutta(rates, t, state, now, contact, h)
        then = rates(t + h, following, contact)
        if e.static_excess > 0 and contact.slip == 0 and then.margin < 0 < now.margin:
            h *= max(now.margin / (now.margin - then.margin), 1e-3)  # land on the break-away, to second order
            following = _runge_kutta(rates, t, state, now, contact, h)
            then = rates(t + h, following, contact)
            contact.slip = -1 if then.heavy_tension > then.light_tension else 1
            then = rates(t + h, following, contact)
        t, state, now = t + h, following, then
        contact.wrap_angle = now.wrap_angle
    return _motion(apparatus, numerics, np.array(rows), ended)


def _motion(apparatus: Apparatus, numerics: Numerics, rows: Array, ended: bool) -> Motion:
    flat = np.zeros(len(rows))
    return Motion(
        apparatus=apparatus,
        numerics=numerics,
        t=rows[:, 0],
        light=rows[:, 1:4],
        heavy=np.stack([rows[:, 4], rows[:, 5], flat], axis=1),
        light_velocity=rows[:, 7:10],
        heavy_velocity=np.stack([rows[:, 10], rows[:, 11], flat], axis=1),
        wrap_angle=rows[:, 13],
        light_tension=rows[:, 14],
        heavy_tension=rows[:, 15],
        stretch=rows[:, 16:18],
        ended=ended,
    )


Rates = Callable[[float, State, _Contact], _Instant]


def _runge_kutta(rates: Rates, t: float, y: State, now: _Instant, contact: _Contact, h: float) -> State:
    half = h / 2
    k1 = now.rates
    k2 = rates(t + half, [a + half * b for a, b in zip(y, k1, strict=True)], contact).rates
    k3 = rates(t + half, [a + half * b for a, b in zip(y, k2, strict=True)], contact).rates
    k4 = rates(t + h, [a + h * b for a, b in zip(y, k3, strict=True)], contact).rates
    sixth = h / 6
    return [a + sixth * (b + 2 * (c + d) + f) for a, b, c, d, f in zip(y, k1, k2, k3, k4, strict=True)]


def _settle(contact: _Contact, state: State, now: _Instant, e: Effects) -> bool:
    """Update what is held during a step; say whether anything changed."""
    before = (contact.slip, contact.rod)
    if e.static_excess > 0:
        passing = now.rates[5] - state[11]
        if contact.slip != 0 and passing * contact.slip <= 0:
            contact.slip = 0
        elif contact.slip == 0 and now.margin < 0:
            contact.slip = -1 if now.heavy_tension > now.light_tension else 1
    if e.rod_mobility > 0:
        pull = now.light_tension - now.heavy_tension
        if contact.rod != 0 and state[11] * contact.rod < 0:
            state[11], contact.rod = 0.0, 0
        if contact.rod == 0 and abs(pull) > e.bearing_friction:
            contact.rod = 1 if pull > 0 else -1
    return before != (contact.slip, contact.rod)


def _released(a: Apparatus, e: Effects, numerics: Numerics) -> tuple[State, Rates, _Contact]:
    """State at release, its equations of motion, and the contact.

    Just before, the heavy mass hangs at rest and the hand that holds the light one has let the string come to the verge of
    sliding; this sets the string's first stretch and nothing else.
    """
    angle = pi if a.release == "vertical" else a.release_angle
    normal, away = (math.cos(angle), math.sin(angle)), (-math.sin(angle), math.cos(angle))
    radius, slope, wound = _profile(angle, a.rod_radius, e.string_thickness)
    x, y = (radius * n + (a.free_length + slope) * w for n, w in zip(normal, away, strict=True))
    swing = e.heavy_swing
    hx = a.rod_radius * math.cos(swing) + a.hanging_length * math.sin(swing)
    hy = a.rod_radius * math.sin(swing) - a.hanging_length * math.cos(swing)
    velocity = [-e.push * normal[0], -e.push * normal[1], e.sideways_push, 0.0, 0.0]
    paths = (a.free_length + slope + wound, a.hanging_length - a.rod_radius * swing)
    state = [x, y, 0.0, hx, hy, 0.0, *velocity, 0.0]
    return state, _equations(a, e, paths, numerics), _Contact(angle)


def _profile(angle: float, radius: float, thickness: float) -> tuple[float, float, float]:
    """Support function h of the wound rod at normal angle ``angle``, its slope h', and the integral of h from 0."""
    turned = angle - 2 * pi
    if thickness == 0 or turned <= 0:
        return radius, 0.0, radius * angle
    slope = thickness / (2 * pi)
    return radius + slope * turned, slope, radius * angle + slope * turned * turned / 2


def _equations(a: Apparatus, e: Effects, paths: tuple[float, float], numerics: Numerics) -> Rates:
    """Return the right side as a function of time, state and contact; ``paths`` are the string's at release."""
    m1, m2, radius, g = a.light_mass, a.heavy_mass, a.rod_radius, a.gravity
    dropped, held, swings, lateral = a.release == "drop", a.release == "held", e.heavy_swing != 0, e.sideways_push != 0
    base_compliance, tau = 1 / numerics.stiffness, e.string_loss_time or numerics.loss_time
    whole = sum(paths)
    spin = 0.4 * m1 * e.light_radius**2
    light_force = _light_force(a, e)
    # What follows runs some 10^5 times a run: names of its own are found twice as fast as attributes.
    friction, heavy_drag, thickness, density = a.friction, a.heavy_drag, e.string_thickness, e.string_density
    per_speed, per_wrap, on_string = e.friction_per_speed, e.friction_per_wrap, e.string_on_string
    per_turn = e.friction_per_turn
    static_excess, compliance, mobility, bearing = e.static_excess, e.compliance, e.rod_mobility, e.bearing_friction
    turn, static = 2 * pi, e.static_excess > 0
    brake, patch = e.brake, e.rough_patch
    both_stiff = numerics.stiffness, numerics.stiffness

    def parts(passed: float) -> tuple[float, float]:
        """Stiffness of the light and of the heavy part [N/m]."""
        if compliance == 0:
            return both_stiff
        share = (paths[0] + passed) / whole
        return 1 / (base_compliance + compliance * share), 1 / (base_compliance + compliance * (1 - share))

    def exponent(wrap: float, speed: float) -> float:
        """ln of the ratio of tensions on the edge of the friction cone."""
        if wrap <= 0:
            return 0.0
        value = friction * wrap * (1 + per_speed * speed + per_wrap * wrap)
        if patch:
            value += friction * wrap * patch * _between(wrap, e.patch_from, e.patch_to, e.patch_edge)
        if per_turn and wrap > pi:
            value += friction * wrap * per_turn * (wrap - pi) / turn
        if wrap > turn:
            value += on_string * (wrap - turn)
        return min(value, 80.0)

    first_k1, first_k2 = parts(0.0)
    hanging = (m2 + e.string_density * a.hanging_length) * g
    first_ratio = exp(-exponent(pi if a.release == "vertical" else a.release_angle, 0.0))
    natural1, natural2 = paths[0] - hanging * first_ratio / first_k1, paths[1] - hanging / first_k2

    def tensions(e1: float, e2: float, v1: float, v2: float, s: float, cone: float, slip: int) -> tuple[float, float, float]:
        """T1, T2 [N] and the speed at which string passes over the rod's surface [m/s].

        ``e`` are stretches, ``v`` their rates if none passed.
        """
        k1, k2 = parts(s)
        c1, c2 = (tau * k1 if e1 > 0 else 0.0), (tau * k2 if e2 > 0 else 0.0)
        t1 = k1 * e1 + c1 * v1 if e1 > 0 else 0.0
        t2 = k2 * e2 + c2 * v2 if e2 > 0 else 0.0
        passing = 0.0
        if not held and not (slip == 0 and static):
            if t2 > cone * t1 and c2 > 0 and (slip <= 0 or not static):
                passing = (cone * t1 - t2) / (c2 + cone * c1)
            elif t1 > cone * t2 and c1 > 0 and (slip >= 0 or not static):
                passing = (t1 - cone * t2) / (c1 + cone * c2)
        return max(t1 - c1 * passing, 0.0), max(t2 + c2 * passing, 0.0), passing

    def rates(t: float, state: State, contact: _Contact) -> _Instant:
        x, y, z, hx, hy, passed, vx, vy, vz, hvx, hvy, surface = state
        square = x * x + y * y
        free = sqrt(max(square - radius * radius, 1e-12))
        nx, ny = (radius * x + free * y) / square, (radius * y - free * x) / square  # the rod's normal where the string leaves
        wrap = atan2(ny, nx)
        wrap += turn * round((contact.wrap_angle - wrap) / turn)
        path = free + radius * wrap
        if thickness != 0 and wrap > turn - 0.5:
            for _ in range(3):  # Newton: the string's line touches the wound string, position . normal = h
                h, slope, wound = _profile(wrap, radius, thickness)
                nx, ny = math.cos(wrap), math.sin(wrap)
                wrap -= (x * nx + y * ny - h) / (y * nx - x * ny - slope)
            h, slope, wound = _profile(wrap, radius, thickness)
            nx, ny = math.cos(wrap), math.sin(wrap)
            free, path = y * nx - x * ny - slope, y * nx - x * ny + wound
        ax, ay = -ny, nx  # away from the rod along the string
        out, across = vx * ax + vy * ay, vx * nx + vy * ny
        in_plane = 1.0
        rate = out
        pull_z = 0.0
        if lateral:  # the rod unrolls: the string is the hypotenuse over path and z, on the rod as well as off it
            flat, path = path, hypot(path, z)
            in_plane, pull_z = flat / path, z / path
            rate = out * in_plane + vz * pull_z
        lift_x, lift_y, heavy_path, heavy_rate, tilt = 0.0, 1.0, -hy, -hvy, 0.0
        if swings:
            heavy_square = hx * hx + hy * hy
            heavy_free = sqrt(heavy_square - radius * radius)
            mx, my = (radius * hx - heavy_free * hy) / heavy_square, (radius * hy + heavy_free * hx) / heavy_square
            tilt = atan2(my, mx)
            lift_x, lift_y = -my, mx
            heavy_path, heavy_rate = heavy_free - radius * tilt, hvx * my - hvy * mx
        t1 = t2 = passing = 0.0
        stretch1, stretch2 = path - natural1 - passed, heavy_path - natural2 + passed
        cone = holding = 1.0
        if not dropped:
            value = exponent(wrap - tilt, abs(heavy_rate + surface))
            cone = exp(value)
            holding = exp(value * (1 + static_excess)) if static_excess else cone
            t1, t2, passing = tensions(stretch1, stretch2, rate - surface, heavy_rate + surface, passed, cone, contact.slip)
        fx, fy, fz = light_force(t, x, y, vx, vy, vz, ax, ay, nx, ny, free)
        along, toward = fx * ax + fy * ay - t1 * in_plane, fx * nx + fy * ny
        string_mass = density * free
        mass_across = m1 + string_mass / 3
        if spin:
            turning, share = -across / free, spin / (free * free)
            toward -= share * turning * (2 * out - radius * turning)
            mass_across += share
        along /= m1 + string_mass / 2
        toward /= mass_across
        heavy_total = m2 + density * heavy_path
        heavy_speed = hypot(hvx, hvy)
        hax = (t2 * lift_x - heavy_drag * heavy_speed * hvx) / heavy_total if swings else 0.0
        hay = (t2 * lift_y - heavy_drag * heavy_speed * hvy) / heavy_total - g
        if brake:
            hay -= brake * _between(hy, e.brake_from, e.brake_to, e.brake_edge) * hvy / heavy_total
        if held:
            hax = hay = 0.0
        turning_up = mobility * (t1 - t2 - bearing * contact.rod) if contact.rod else 0.0
        return _Instant(
            [
                *(vx, vy, vz, hvx, hvy, surface + passing),
                *(along * ax + toward * nx, along * ay + toward * ny, fz / m1 - t1 * pull_z / m1, hax, hay, turning_up),
            ],
            wrap,
            free,
            t1,
            t2,
            holding,
            (stretch1, stretch2),
        )

    return rates


def _between(x: float, low: float, high: float, edge: float) -> float:
    """1 between ``low`` and ``high``, 0 outside, with edges of hyperbolic tangents."""
    return 0.5 * (math.tanh((x - low) / edge) - math.tanh((x - high) / edge))


def _light_force(a: Apparatus, e: Effects) -> Callable[..., Any]:
    """Everything that acts on the light mass but the string's pull, as (x, y, z) [N]."""
    gravity, drag, string_drag = a.light_mass * a.gravity, a.light_drag, a.string_drag if a.release != "drop" else 0.0
    half_string = e.string_density * a.gravity / 2
    near = -0.5 / e.magnet_range**2
    extra = any((e.side_force, e.side_stiffness, e.magnet, e.pull, e.thrust))
    wind, linear_drag, attitude_drag = e.wind, e.linear_drag, e.attitude_drag

    def force(
        t: float, x: float, y: float, vx: float, vy: float, vz: float, ax: float, ay: float, nx: float, ny: float, free: float
    ) -> tuple[float, float, float]:
        wx = vx - wind
        speed = sqrt(wx * wx + vy * vy + vz * vz)
        quadratic = drag
        if attitude_drag and speed > 0:
            quadratic *= 1 + attitude_drag * ((wx * ax + vy * ay) / speed) ** 2
        resist = quadratic * speed + linear_drag
        across = vx * nx + vy * ny
        swept = string_drag * free * abs(across) * across
        fx, fy, fz = -resist * wx - swept * nx, -resist * vy - swept * ny - gravity - half_string * free, -resist * vz
        if extra:
            fx += e.side_force + e.side_stiffness * x
            dx, dy = e.magnet_place[0] - x, e.magnet_place[1] - y
            distance = hypot(dx, dy)
            if e.magnet and distance > 0:
                pull = e.magnet * exp(near * distance * distance) / distance
                fx, fy = fx + pull * dx, fy + pull * dy
            if e.pull:
                dx, dy = e.pull_place[0] - x, e.pull_place[1] - y
                pull = e.pull / (dx * dx + dy * dy + e.pull_softening**2) ** 1.5
                fx, fy = fx + pull * dx, fy + pull * dy
            velocity = hypot(vx, vy)
            if e.thrust and velocity > 0:
                pulse = e.thrust * exp(-0.5 * ((t - e.thrust_time) / e.thrust_width) ** 2) / velocity
                fx, fy = fx + pulse * vx, fy + pulse * vy
        return fx, fy, fz

    return force
