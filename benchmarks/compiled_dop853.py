"""The program that a careful user would write with Numba: DOP853 with events, all in compiled code, one run after another.

The equations of a string that slides or sticks, written by hand in s with dt = l ds and with the fewest variables each mode
needs; no slack string, so it does less work. Events are detected by signs at the ends of steps and located by Newton's
method, each iteration a step of its own.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from scipy.integrate._ivp import dop853_coefficients as tableau

from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.transitions import Mode

PARAMETERS = (
    "light_mass",
    "heavy_mass",
    "rod_radius",
    "gravity",
    "kinetic_friction",
    "light_drag",
    "heavy_drag",
    "string_drag",
    "end_length",
)
"""Parameters of a run, in the order of the tuple ``p``; after them the free length and the angle at release."""
STICK, DOWN, UP, ENDED = (np.uint64(mode) for mode in (Mode.STICKING, Mode.SLIDING_DOWN, Mode.SLIDING_UP, Mode.ENDED))
HASH_START, HASH_FACTOR = np.uint64(0xCBF29CE484222325), np.uint64(0x100000001B3)
STOP, END, UNWRAPPED, TIME_UP, SLIP_ONSET_DOWN, SLIP_ONSET_UP = range(1, 7)
MAX_STEPS = 20_000
compiled = numba.njit(error_model="numpy")


@compiled
def sliding(y, s, p):
    """Return d/ds of (l, theta, u, w, t); ``s``: +1 up, -1 down."""
    length, theta, u, w, _ = y
    m1, m2, radius, g, mu, drag1, drag2, alpha, _ = p
    ratio = math.exp(-s * mu * theta)
    speed = math.sqrt(u * u + w * w)
    pull = m1 * (w * w - length * g * math.cos(theta)) - length * drag1 * speed * u
    rate = (ratio * pull - length * (m2 * g + s * drag2 * u * u)) / (m2 + m1 * ratio)
    across = length * (g * math.sin(theta) - (drag1 * speed + alpha * length * abs(w)) * w / m1) - u * w
    return length * u - radius * w, w, rate, across, length


@compiled
def sticking(y, c, p):
    """Return d/ds of (theta, w, t); ``c``: the constant l + R theta."""
    theta, w, _ = y
    length = c - p[2] * theta
    return w, length * (p[3] * math.sin(theta) - (p[5] + p[7] * length) * abs(w) * w / p[0]), length


def _step_function(rates, n):
    """One step of DOP853 for ``n`` variables, unrolled: (y, dy/ds, h, own, p, tolerance) -> (y, dy/ds, error)."""

    def tuple_of(parts):
        return "(" + ", ".join(parts) + ",)"

    def weighted(weights, i):
        return " + ".join(f"{float(w)!r} * k{j}[{i}]" for j, w in enumerate(weights) if w)

    lines = ["def step(y, k0, h, own, p, tolerance):"]
    for stage in range(1, 12):
        inner = tuple_of(f"y[{i}] + h * ({weighted(tableau.A[stage, :stage], i)})" for i in range(n))
        lines.append(f"    k{stage} = rates({inner}, own, p)")
    lines.append(f"    z = {tuple_of(f'y[{i}] + h * ({weighted(tableau.B, i)})' for i in range(n))}")
    lines += ["    k12 = rates(z, own, p)", "    fifth = third = 0.0"]
    for i in range(n):
        lines.append(f"    scale = tolerance * (0.1 + max(abs(y[{i}]), abs(z[{i}])))")
        lines.append(f"    fifth += (({weighted(tableau.E5, i)}) / scale) ** 2")
        lines.append(f"    third += (({weighted(tableau.E3, i)}) / scale) ** 2")
    lines.append(f"    error = abs(h) * fifth / math.sqrt((fifth + 0.01 * third) * {n}) if fifth > 0.0 else 0.0")
    lines.append("    return z, k12, error")
    scope = {"math": math, "rates": rates}
    exec("\n".join(lines), scope)  # text that this function wrote
    return compiled(scope["step"])


slide_step, stick_step = _step_function(sliding, 5), _step_function(sticking, 3)


@compiled
def margins(length, theta, w, p):
    """By how much the rod holds the string against sliding down and up, times the free length; below 0 it slides."""
    pull, grip = p[0] * (w * w - length * p[3] * math.cos(theta)), math.exp(p[4] * theta)
    weight = length * p[1] * p[3]
    return pull * grip - weight, weight * grip - pull


@compiled
def slide_event(kind, y, k, s, p, duration):
    """An event's function and its derivative."""
    if kind == STOP:
        return s * y[2], s * k[2]
    if kind == END:
        return y[0] - p[8], k[0]
    if kind == UNWRAPPED:
        return y[1], k[1]
    return duration - y[4], -k[4]


@compiled
def stick_event(kind, y, k, c, p, duration):
    """As `slide_event`; a margin's derivative is left to the secant."""
    if kind == END:
        return c - p[2] * y[0] - p[8], -p[2] * k[0]
    if kind == UNWRAPPED:
        return y[0], k[0]
    if kind == TIME_UP:
        return duration - y[2], -k[2]
    down, up = margins(c - p[2] * y[0], y[0], y[1], p)
    return (down if kind == SLIP_ONSET_DOWN else up), 0.0


def _locator(step, function):
    """Where an event that lies within a step happens: (fraction of s, y, dy/ds)."""

    @compiled
    def locate(kind, y, k, h, own, p, duration, tolerance):
        low, high, x = 0.0, h, h
        z, kz, _ = step(y, k, h, own, p, tolerance)
        value, slope = function(kind, z, kz, own, p, duration)
        before, _ = function(kind, y, k, own, p, duration)
        x_before = 0.0
        for _ in range(60):
            if value < 0:
                high = x
            else:
                low = x
            if slope == 0.0:
                slope = (value - before) / (x - x_before)
            following = x - value / slope
            if not low <= following <= high:
                following = 0.5 * (low + high)
            if abs(following - x) <= 4e-16 * x or value == 0.0:
                break
            x_before, before, x = x, value, following
            z, kz, _ = step(y, k, x, own, p, tolerance)
            value, slope = function(kind, z, kz, own, p, duration)
        return x, z, kz

    return locate


locate_slide, locate_stick = _locator(slide_step, slide_event), _locator(stick_step, stick_event)


@compiled
def next_length(h, error):
    return h * (6.0 if error == 0.0 else min(6.0, max(0.3, 0.9 * error**-0.125)))


@compiled
def slide(y, s, p, duration, tolerance):
    """Slide until an event; returns (event, state)."""
    k, h, fresh = sliding(y, s, p), 2e-3 / y[0], True
    for _ in range(MAX_STEPS):
        z, kz, error = slide_step(y, k, h, s, p, tolerance)
        if not error <= 1.0:
            h *= max(0.2, 0.9 * error**-0.125) if error == error else 0.2
            continue
        if s * z[2] < 0.0 and fresh and h * y[0] > 1e-7:
            h *= 0.1  # a slide starts at rest: go nearer, until it is seen to have left rest
            continue
        first, at, there = 0, h, z
        for kind in (STOP, END, UNWRAPPED, TIME_UP):
            if slide_event(kind, z, kz, s, p, duration)[0] < 0.0:
                x, state, _ = locate_slide(kind, y, k, h, s, p, duration, tolerance)
                if x <= at:
                    first, at, there = kind, x, state
        if first:
            return first, there
        y, k, fresh, h = z, kz, False, next_length(h, error)
    return 0, y


@compiled
def stick(y, p, duration, tolerance):
    """Stick until an event; returns (event, state)."""
    c, state = y[0] + p[2] * y[1], (y[1], y[3], y[4])
    k, h = sticking(state, c, p), 5e-3 / y[0]
    for _ in range(MAX_STEPS):
        z, kz, error = stick_step(state, k, h, c, p, tolerance)
        if not error <= 1.0 or abs(z[0] - state[0]) > 1.0:
            h *= max(0.2, min(0.9, 0.9 * error**-0.125)) if error == error else 0.2
            continue
        first, at, there = 0, h, z
        for kind in (SLIP_ONSET_DOWN, SLIP_ONSET_UP, END, UNWRAPPED, TIME_UP):
            if stick_event(kind, z, kz, c, p, duration)[0] < 0.0:
                x, event_state, _ = locate_stick(kind, state, k, h, c, p, duration, tolerance)
                if x <= at:
                    first, at, there = kind, x, event_state
        if not first and h > 1e-3 and _may_dip(state, k, z, h, c, p, tolerance):
            h *= 0.5
            continue
        if first:
            return first, (c - p[2] * there[0], there[0], 0.0, there[1], there[2])
        state, k, h = z, kz, next_length(h, error)
    return 0, y


@compiled
def _may_dip(state, k, z, h, c, p, tolerance):
    """Whether a parabola through a margin's ends and middle nearly touches zero in between."""
    middle, _, _ = stick_step(state, k, 0.5 * h, c, p, tolerance)
    starts = margins(c - p[2] * state[0], state[0], state[1], p)
    middles = margins(c - p[2] * middle[0], middle[0], middle[1], p)
    ends = margins(c - p[2] * z[0], z[0], z[1], p)
    for i in range(2):
        bend, slope = 2 * (starts[i] + ends[i] - 2 * middles[i]), 4 * middles[i] - 3 * starts[i] - ends[i]
        if bend > 0 and 0 < -slope < 2 * bend and starts[i] - slope**2 / (4 * bend) < 0.15 * min(starts[i], ends[i]):
            return True
    return False


@compiled
def chosen(y, p):
    """Mode of a string at rest on the rod."""
    down, up = margins(y[0], y[1], y[3], p)
    return DOWN if down < 0 else (UP if up < 0 else STICK)


@compiled
def run_one(p, free_length, angle, duration, tolerance):
    """(halting time, nan without one; end time; hash of the modes as in `BatchResult`)."""
    y = (free_length, angle, 0.0, 0.0, 0.0)
    mode, halt, event = chosen(y, p), 0.0, 0
    modes = (HASH_START ^ mode) * HASH_FACTOR
    for _ in range(MAX_STEPS):
        if mode == STICK:
            event, y = stick(y, p, duration, tolerance)
        else:
            event, y = slide(y, 1.0 if mode == UP else -1.0, p, duration, tolerance)
        if event in (0, END, UNWRAPPED, TIME_UP):
            break
        y = (y[0], y[1], 0.0, y[3], y[4])
        mode = chosen(y, p) if event == STOP else (DOWN if event == SLIP_ONSET_DOWN else UP)
        modes, halt = (modes ^ mode) * HASH_FACTOR, y[4]
    halts = event == END and mode == STICK
    return halt if halts else math.nan, y[4], (modes ^ ENDED) * HASH_FACTOR


@compiled
def run_all(table, duration, tolerance, halting_times, end_times, sequences):
    """Run every row of ``table``: `PARAMETERS`, free length, release angle."""
    for i in range(len(table)):
        r = table[i]
        p = (r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8])
        halting_times[i], end_times[i], sequences[i] = run_one(p, r[9], r[10], duration, tolerance)


def solve_with_numba(base: Parameters, columns: dict[str, np.ndarray], duration: float, tolerance: float):
    """Halting times, end times and sequences of many runs, as `solve_batch` takes them."""
    n = len(next(iter(columns.values())))
    values = vars(base.values()) | columns
    table = np.stack([np.broadcast_to(values[name], n) for name in (*PARAMETERS, "free_length", "release_angle")], axis=1)
    halting_times, end_times, sequences = np.empty(n), np.empty(n), np.empty(n, dtype=np.uint64)
    run_all(table, duration, tolerance, halting_times, end_times, sequences)
    return halting_times, end_times, sequences
