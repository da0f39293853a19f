"""The laws of the blind studies that no library lists, as effects: only a fit that is given the answer knows them."""

from typing import Any

from looping_pendulum.reference_ode.effects.types import Coefficient, Effect, EffectKind, Kinematics
from looping_pendulum.reference_ode.geometry import light_position
from tests.blind import Effects

REST_SPEED = 1e-3
"""Speed below which the direction of the velocity is rounded off [m/s]."""
HIDDEN = Effects()
"""Where and when the laws act, as the simulator has it."""


def effects() -> list[Effect]:
    """Return the laws; each has one coefficient, which has the unit of the simulator's number."""
    source = "tests/blind/simulator.py"
    return [
        Effect(
            name="known_magnet", kind=EffectKind.FORCE, formula="F = k exp(-d^2 / 2 s^2) towards a point", source=source,
            acts_on="light mass", depends_on=("free_length", "wrap_angle"), coefficients=_coefficient("known_magnet", "N"),
            switch="known_magnet", force_on_light_mass=_magnet,
        ),
        Effect(
            name="known_thrust", kind=EffectKind.FORCE, formula="F = k exp(-(t - t0)^2 / 2 s^2) v / |v|", source=source,
            acts_on="light mass", depends_on=("time", "retreat_speed", "across_speed"),
            coefficients=_coefficient("known_thrust", "N"), switch="known_thrust", force_on_light_mass=_thrust,
        ),
        Effect(
            name="known_brake", kind=EffectKind.FORCE, formula="F = -b v2 between two heights", source=source,
            acts_on="heavy mass", depends_on=("free_length", "wrap_angle", "heavy_speed"),
            coefficients=_coefficient("known_brake", "kg/s"), switch="known_brake", force_on_heavy_mass=_brake,
        ),
        Effect(
            name="known_rough_patch", kind=EffectKind.STRING_LAW, formula="mu (1 + c) between two wrap angles", source=source,
            acts_on="string on rod", depends_on=("wrap_angle",), coefficients=_coefficient("known_rough_patch", ""),
            switch="known_rough_patch", sliding_exponent=lambda xp, k, p: p.kinetic_friction * _patch(xp, k, p),
            holding_exponent=lambda xp, k, p: p.static_friction * _patch(xp, k, p),
        ),
    ]  # fmt: skip


def _coefficient(name: str, unit: str) -> tuple[Coefficient, ...]:
    return (Coefficient(name=name, unit=unit, default=0.0, null=0.0, bounds=(-100.0, 100.0), meaning="the hidden number"),)


def _between(xp: Any, x: Any, low: float, high: float, edge: float) -> Any:
    return 0.5 * (xp.tanh((x - low) / edge) - xp.tanh((x - high) / edge))


def _magnet(xp: Any, k: Kinematics, p: Any) -> tuple[Any, Any]:
    x, y = light_position(xp, k.free_length, k.wrap_angle, p.rod_radius)
    dx, dy = HIDDEN.magnet_place[0] - x, HIDDEN.magnet_place[1] - y
    square = dx * dx + dy * dy
    pull = p.known_magnet * xp.exp(-0.5 / HIDDEN.magnet_range**2 * square) / xp.sqrt(square)
    cosine, sine = xp.cos(k.wrap_angle), xp.sin(k.wrap_angle)
    return pull * (dx * sine - dy * cosine), -pull * (dx * cosine + dy * sine)


def _thrust(xp: Any, k: Kinematics, p: Any) -> tuple[Any, Any]:
    since = (k.time - HIDDEN.thrust_time) / HIDDEN.thrust_width
    u, w = k.retreat_speed, k.across_speed
    push = p.known_thrust * xp.exp(-0.5 * since * since) / xp.sqrt(u * u + w * w + REST_SPEED * REST_SPEED)
    return -push * u, push * w


def _brake(xp: Any, k: Kinematics, p: Any) -> Any:
    height = k.free_length + p.rod_radius * k.wrap_angle - p.string_length
    return -p.known_brake * _between(xp, height, HIDDEN.brake_from, HIDDEN.brake_to, HIDDEN.brake_edge) * k.heavy_speed


def _patch(xp: Any, k: Kinematics, p: Any) -> Any:
    inside = _between(xp, k.wrap_angle, HIDDEN.patch_from, HIDDEN.patch_to, HIDDEN.patch_edge)
    return p.known_rough_patch * inside * k.contact_angle
