"""The script that a careful user would write with SciPy alone: solve_ivp, DOP853, rtol 1e-9, events for stop and slip onset.

It is written for the 10:1 trial (down, stick, end) and handles neither slack nor other slip onsets, so it does less work.
"""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from looping_pendulum.reference_ode.parameters import POINT_MASS_END, Parameters


def plain_run(p: Parameters, t: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the light mass's positions at times ``t`` [s] and the halting time [s]."""
    c = p.coefficients
    m1, m2, radius, g = p.light_mass, p.heavy_mass, p.rod_radius, c["gravity"]
    mu, drag1, drag2, alpha = c["kinetic_friction"], c["light_drag"], c["heavy_drag"], c["string_drag"]
    end_length = POINT_MASS_END * radius

    def across(length, theta, u, w):
        return g * np.sin(theta) - (drag1 * np.hypot(u, w) + alpha * length * abs(w)) * w / m1 - u * w / length

    def sliding(_, y):
        length, theta, u, w = y
        ratio = np.exp(mu * theta)
        pull = m1 * (w * w / length - g * np.cos(theta)) - drag1 * np.hypot(u, w) * u
        rate = (ratio * pull - m2 * g - drag2 * abs(u) * u) / (m2 + m1 * ratio)
        return [u - radius * w / length, w / length, rate, across(length, theta, u, w)]

    def sticking(_, y):
        length, theta, w = y
        return [-radius * w / length, w / length, across(length, theta, 0.0, w)]

    def stop(_, y):
        return y[2]

    def end(_, y):
        return y[0] - end_length

    def slip_onset(_, y):
        length, theta, w = y
        return m1 * (w * w / length - g * np.cos(theta)) * np.exp(mu * theta) - m2 * g

    for event in (stop, end, slip_onset):
        event.terminal = True
    stop.direction, end.direction, slip_onset.direction = 1, -1, -1
    options = {"method": "DOP853", "rtol": 1e-9, "atol": 1e-10, "dense_output": True}
    first = solve_ivp(sliding, (0.0, 5.0), [p.free_length, p.release_angle, 0.0, 0.0], events=[stop, end], **options)
    halt, y = first.t[-1], first.y[:, -1]
    second = solve_ivp(sticking, (halt, 5.0), [y[0], y[1], y[3]], events=[end, slip_onset], **options)
    before, after = t[t <= halt], t[(t > halt) & (t <= second.t[-1])]
    length, theta = np.concatenate([first.sol(before)[:2], second.sol(after)[:2]], axis=1)
    cosine, sine = np.cos(theta), np.sin(theta)
    return np.stack([radius * cosine - length * sine, radius * sine + length * cosine], axis=1), halt
