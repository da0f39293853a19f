"""The laws of the blind studies that no library lists, as effects: only a fit that is given the answer knows them."""

from collections.abc import Callable
from typing import Any

from looping_pendulum.reference_ode.effects.types import TURN, Coefficient, Effect, EffectKind, Kinematics
from looping_pendulum.reference_ode.geometry import light_position
from tests.blind import Effects
from tests.blind.cases import CASES

REST_SPEED = 1e-3
"""Speed below which the direction of the velocity is rounded off [m/s]."""
EDGE = 0.02
"""Angle over which the kink is rounded off where friction begins to grow [rad]."""
SOURCE = "tests/blind/simulator.py"


def effects() -> list[Effect]:
    """Return the laws; each has one coefficient, which has the unit of the simulator's number."""
    place = ("free_length", "wrap_angle")
    return [
        Effect(
            name="known_magnet", kind=EffectKind.FORCE, formula="F = k exp(-d^2 / 2 s^2) towards a point", source=SOURCE,
            acts_on="light mass", depends_on=place, coefficients=_coefficient("known_magnet", "N"),
            switch="known_magnet", force_on_light_mass=_magnet,
        ),
        Effect(
            name="known_pull", kind=EffectKind.FORCE, formula="F = k d / (d^2 + s^2)^(3/2) towards a point", source=SOURCE,
            acts_on="light mass", depends_on=place, coefficients=_coefficient("known_pull", "N*m**2"),
            switch="known_pull", force_on_light_mass=_pull,
        ),
        Effect(
            name="known_thrust", kind=EffectKind.FORCE, formula="F = k exp(-(t - t0)^2 / 2 s^2) v / |v|", source=SOURCE,
            acts_on="light mass", depends_on=("time", "retreat_speed", "across_speed"),
            coefficients=_coefficient("known_thrust", "N"), switch="known_thrust", force_on_light_mass=_thrust,
        ),
        Effect(
            name="known_brake", kind=EffectKind.FORCE, formula="F = -b v2 between two heights", source=SOURCE,
            acts_on="heavy mass", depends_on=("free_length", "wrap_angle", "heavy_speed"),
            coefficients=_coefficient("known_brake", "kg/s"), switch="known_brake", force_on_heavy_mass=_brake,
        ),
        _friction("rough_patch", "mu (1 + c) between two wrap angles", _patch),
        _friction("late_patch", "mu (1 + c) between two wrap angles", _patch),
        _friction("friction_per_turn", "mu (1 + c (theta - pi) / 2 pi) from half a turn on", _turns_beyond_half),
    ]  # fmt: skip


def _coefficient(name: str, unit: str) -> tuple[Coefficient, ...]:
    return (Coefficient(name=name, unit=unit, default=0.0, null=0.0, bounds=(-100.0, 100.0), meaning="the hidden number"),)


def _friction(case: str, formula: str, growth: Callable[[Any, Any, Effects], Any]) -> Effect:
    """Return a law of the string on the rod: friction grows in proportion to a function of the wrap angle."""
    name, where = f"known_{case}", CASES[case].hidden()

    def exponent(xp: Any, k: Kinematics, p: Any, friction: Any) -> Any:
        return friction * getattr(p, name) * growth(xp, k.wrap_angle, where) * k.contact_angle

    return Effect(
        name=name, kind=EffectKind.STRING_LAW, formula=formula, source=SOURCE, acts_on="string on rod",
        depends_on=("wrap_angle",), coefficients=_coefficient(name, ""), switch=name,
        sliding_exponent=lambda xp, k, p: exponent(xp, k, p, p.kinetic_friction),
        holding_exponent=lambda xp, k, p: exponent(xp, k, p, p.static_friction),
    )  # fmt: skip


def _between(xp: Any, x: Any, low: float, high: float, edge: float) -> Any:
    return 0.5 * (xp.tanh((x - low) / edge) - xp.tanh((x - high) / edge))


def _patch(xp: Any, wrap_angle: Any, where: Effects) -> Any:
    return _between(xp, wrap_angle, where.patch_from, where.patch_to, where.patch_edge)


def _turns_beyond_half(xp: Any, wrap_angle: Any, where: Effects) -> Any:
    beyond = wrap_angle - TURN / 2
    return 0.5 * (beyond + xp.sqrt(beyond * beyond + EDGE * EDGE)) / TURN


def _towards(xp: Any, k: Kinematics, p: Any, place: tuple[float, float]) -> tuple[Any, Any, Any]:
    """Return the way to a point, along and across the string, and the square of its length."""
    x, y = light_position(xp, k.free_length, k.wrap_angle, p.rod_radius)
    dx, dy = place[0] - x, place[1] - y
    cosine, sine = xp.cos(k.wrap_angle), xp.sin(k.wrap_angle)
    return dx * sine - dy * cosine, -(dx * cosine + dy * sine), dx * dx + dy * dy


def _magnet(xp: Any, k: Kinematics, p: Any) -> tuple[Any, Any]:
    where = CASES["magnet"].hidden()
    along, across, square = _towards(xp, k, p, where.magnet_place)
    pull = p.known_magnet * xp.exp(-0.5 / where.magnet_range**2 * square) / xp.sqrt(square)
    return pull * along, pull * across


def _pull(xp: Any, k: Kinematics, p: Any) -> tuple[Any, Any]:
    where = CASES["pull"].hidden()
    along, across, square = _towards(xp, k, p, where.pull_place)
    softened = square + where.pull_softening**2
    pull = p.known_pull / (softened * xp.sqrt(softened))
    return pull * along, pull * across


def _thrust(xp: Any, k: Kinematics, p: Any) -> tuple[Any, Any]:
    where = CASES["thrust"].hidden()
    since = (k.time - where.thrust_time) / where.thrust_width
    u, w = k.retreat_speed, k.across_speed
    push = p.known_thrust * xp.exp(-0.5 * since * since) / xp.sqrt(u * u + w * w + REST_SPEED * REST_SPEED)
    return -push * u, push * w


def _brake(xp: Any, k: Kinematics, p: Any) -> Any:
    where = CASES["brake"].hidden()
    height = k.free_length + p.rod_radius * k.wrap_angle - p.string_length
    return -p.known_brake * _between(xp, height, where.brake_from, where.brake_to, where.brake_edge) * k.heavy_speed
