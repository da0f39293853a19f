"""A string that stretches: two springs with dampers, one on either side of the rod, and string that passes between them.

With e the stretch of a part, S' the speed at which its path grows, and q the string that has passed to the light side::

    T1 = k1 (e1 + tau e1'),  e1' = S' - q'        T2 = k2 (e2 + tau e2'),  e2' = q' - u2

A part's stiffness goes with its share of the string, k1 = 1 / (C share). The rod lets string pass at the rate that keeps the
tensions on the edge of the friction cone, T2 = E T1, which is linear in q'; while it holds the string, q' = 0.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from looping_pendulum.reference_ode.state import State
from looping_pendulum.reference_ode.transitions import Mode


class Springs(NamedTuple):
    """The string at one instant."""

    light_tension: Any
    heavy_tension: Any
    passing: Any
    """q', speed at which string passes to the light side [m/s]."""
    reserve: Any
    """Stretch and tau times its rate, of both parts together [m]: below 0 there is no tension."""


def light_share(path: Any, light_stretch: Any, p: Any) -> Any:
    """Share of the string that is on the light side."""
    return (path - light_stretch) / p.string_length


def springs(mode: Mode, y: State, string_speed: Any, path: Any, ratio: Any, p: Any) -> Springs:
    """Tensions and passing string; ``ratio``: E = T2 / T1 while it slides."""
    tau, share = p.string_loss_time, light_share(path, y.light_stretch, p)
    light, heavy = 1.0 / (p.string_compliance * share), 1.0 / (p.string_compliance * (1.0 - share))
    held_light, held_heavy = y.light_stretch + tau * string_speed, y.heavy_stretch - tau * y.heavy_speed
    passing: Any = 0.0
    if mode.sliding:
        passing = (ratio * light * held_light - heavy * held_heavy) / (tau * (heavy + ratio * light))
    return Springs(
        light_tension=light * (held_light - tau * passing),
        heavy_tension=heavy * (held_heavy + tau * passing),
        passing=passing,
        reserve=held_light + held_heavy,
    )
