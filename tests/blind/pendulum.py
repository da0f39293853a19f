"""A held pendulum as a rigid body on an axle, by its angle alone: long records, and losses that a string lacks.

Like the rest of `tests.blind` it shares no equation with the package, which follows free length, wrap angle and speeds of a
mass on a string that winds on a rod. Here there is no rod and no string: I phi'' is the sum of the torques about the axle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Pendulum:
    """The apparatus and what brakes it. Angles are from the vertical, positive to the left, where a light mass is let go."""

    mass: float = 0.0415
    length: float = 0.65
    """From the axle to the centre of the bob [m]."""
    gravity: float = 9.81
    angle: float = math.radians(40)
    """At the first frame [rad]."""
    rate: float = 0.0
    """At the first frame [rad/s]."""
    bob_radius: float = 0.0
    """Of a solid sphere [m]."""
    axle_torque: float = 0.0
    """Constant friction of the axle [N m]."""
    axle_damping: float = 0.0
    """Friction of the axle per angular speed [N m s]."""
    linear_drag: float = 0.0
    """F = -b v on the bob [kg/s]."""
    quadratic_drag: float = 0.0
    """F = -g |v| v on the bob [kg/m]."""

    @property
    def inertia(self) -> float:
        """Moment of inertia about the axle, by Steiner's theorem [kg m^2]."""
        return self.mass * self.length**2 + 0.4 * self.mass * self.bob_radius**2


def swing(p: Pendulum, t: Array) -> Array:
    """Return the angle at times ``t`` [s], ascending from 0 or later [rad], shape (n,)."""
    return motion(p, t)[0]


def motion(p: Pendulum, t: Array) -> Array:
    """Return angle [rad] and angular velocity [rad/s] at times ``t`` [s], ascending from 0 or later, shape (2, n)."""
    found = np.zeros((2, len(t)))
    now, y = 0.0, np.array([p.angle, p.rate])
    while now < t[-1]:
        weight = -p.mass * p.gravity * p.length * math.sin(y[0])
        direction = math.copysign(1.0, y[1] or weight)
        if y[1] == 0 and abs(weight) <= p.axle_torque:
            found[0, t >= now] = y[0]
            break

        def rates(_: float, y: Array, direction: float = direction) -> list[float]:
            speed = p.length * y[1]
            torque = -p.mass * p.gravity * p.length * math.sin(y[0]) - p.axle_torque * direction - p.axle_damping * y[1]
            torque -= p.length * (p.linear_drag + p.quadratic_drag * abs(speed)) * speed
            return [y[1], torque / p.inertia]

        def turns(_: float, y: Array, direction: float = direction) -> float:
            return direction * y[1] if abs(y[1]) > 1e-12 else 1e-12

        turns.terminal, turns.direction = True, -1  # type: ignore[attr-defined]
        run = solve_ivp(rates, (now, t[-1]), y, "DOP853", events=turns, dense_output=True, rtol=1e-10, atol=1e-12)
        here = (t >= now) & (t <= run.t[-1])
        found[:, here] = run.sol(t[here])
        now, y = float(run.t[-1]), np.array([run.y[0, -1], 0.0])
    return found


def record(
    p: Pendulum, *, duration: float, frame_rate: float = 30.0, noise: float = 1e-3, seed: int = 0, clock: float = 0.0
) -> str:
    """Return a table of tracked points: t, light_x, light_y [s, m]; ``clock``: the file's time of the first frame [s]."""
    t = np.arange(int(duration * frame_rate)) / frame_rate
    phi = swing(p, t)
    x, y = -p.length * np.sin(phi), -p.length * np.cos(phi)
    rng = np.random.default_rng(seed)
    x, y = (v + noise * rng.standard_normal(len(t)) for v in (x, y))
    rows = [f"{a:.6f},{b:.6f},{c:.6f}" for a, b, c in zip(t + clock, x, y, strict=True)]
    return "\n".join(["t,light_x,light_y", *rows]) + "\n"


def write_record(path: Path, p: Pendulum, **film: float) -> None:
    """Write the table of `record` to a file."""
    path.write_text(record(p, **film), encoding="utf-8")  # type: ignore[arg-type]


def write_gyroscope(
    path: Path,
    p: Pendulum,
    *,
    duration: float,
    rate: float = 60.0,
    jitter: float = 0.2,
    noise: float = 0.015,
    offset: float = 0.0,
    rest: float = 0.0,
    seed: int = 0,
) -> None:
    """Write the angular velocities that a phone measures which is the bob, about its three axes [rad/s].

    Parameters
    ----------
    rate
        Samples per second.
    jitter
        Standard deviation of a time step, as a part of it.
    noise
        Standard deviation about each axis [rad/s].
    offset
        Angular velocity that is measured at rest, about the axis of the swing, towards the light mass's side [rad/s].
    rest
        Time for which the bob is held still before it is let go [s].
    """
    rng = np.random.default_rng(seed)
    count = int((rest + duration) * rate)
    t = np.cumsum(np.maximum(1 + jitter * rng.standard_normal(count), 0.1)) / rate
    t -= t[0]
    turning = np.zeros(count)
    turning[t >= rest] = motion(p, t[t >= rest] - rest)[1]
    axis = np.array([0.2, 0.9, 0.4]) / math.sqrt(1.01)
    values = (turning + offset)[:, None] * axis + noise * rng.standard_normal((count, 3))
    head = '"Time (s)","Gyroscope x (rad/s)","Gyroscope y (rad/s)","Gyroscope z (rad/s)"'
    rows = [",".join(f"{v:.9E}" for v in row) for row in np.column_stack([t, values])]
    path.write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
