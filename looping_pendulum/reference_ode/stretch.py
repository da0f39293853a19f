"""Tensions of a string that stretches: a spring and damper on either side of the rod, and string that passes between them.

With e the stretch of a side, S' the speed at which the path on the light side grows, u2 the upward speed of the heavy mass, and
q the length of string that has passed to the light side::

    T1 = k1 (e1 + tau e1'),  e1' = S' - q'        T2 = k2 (e2 + tau e2'),  e2' = q' - u2

The stiffness of a side is k = 1 / (C share), with its share of the string's length and the compliance C of the whole string.
While the string slides, q' is the speed that keeps the tensions on the edge of the friction cone, T2 = E T1, an
equation that is linear in q'; while the rod holds the string, q' = 0.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, NamedTuple

from looping_pendulum.reference_ode.state import State
from looping_pendulum.reference_ode.transitions import Mode


class Springs(NamedTuple):
    """Tensions and passing speed of the string at one instant."""

    light_tension: Any
    """T1 [N]."""
    heavy_tension: Any
    """T2 [N]."""
    passing_speed: Any
    """q', speed at which string passes to the light side [m/s]."""
    taut_margin: Any
    """Sum over both sides of the stretch and tau times its rate, e + tau e' [m]: below 0 there is no tension."""


def light_share(path: Any, light_stretch: Any, p: SimpleNamespace) -> Any:
    """Return the share of the string's rest length that is on the light side; ``path``: length of that side [m]."""
    return (path - light_stretch) / p.string_length


def springs(mode: Mode, y: State, string_speed: Any, path: Any, ratio: Any, p: SimpleNamespace) -> Springs:
    """Return tensions and passing speed.

    Parameters
    ----------
    string_speed
        Speed S' at which the path on the light side grows [m/s].
    path
        Length of string from the top of the rod to the light mass [m].
    ratio
        E = T2 / T1 while the string slides; not read in other modes.
    """
    tau, share = p.string_loss_time, light_share(path, y.light_stretch, p)
    light_stiffness, heavy_stiffness = 1.0 / (p.string_compliance * share), 1.0 / (p.string_compliance * (1.0 - share))
    # e + tau e' on either side if no string passed
    held_light, held_heavy = y.light_stretch + tau * string_speed, y.heavy_stretch - tau * y.heavy_speed
    passing_speed: Any = 0.0
    if mode.sliding:
        passing_speed = (ratio * light_stiffness * held_light - heavy_stiffness * held_heavy) / (
            tau * (heavy_stiffness + ratio * light_stiffness)
        )
    return Springs(
        light_tension=light_stiffness * (held_light - tau * passing_speed),
        heavy_tension=heavy_stiffness * (held_heavy + tau * passing_speed),
        passing_speed=passing_speed,
        taut_margin=held_light + held_heavy,
    )
