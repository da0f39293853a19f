"""The live page's fit of a trial: oracles are the planted values, and SciPy's least squares on the reference."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import least_squares

from looping_pendulum.live.settings import live_settings
from looping_pendulum.reference_ode.solve import solve_at
from tests.apparatus import TEN_TO_ONE

FRAME_RATE, FILMED, NOISE = 120.0, 0.95, 1e-3
"""Rate of the camera [1/s], its time [s], and the standard deviation of a tracked coordinate [m]."""
TRUTH = TEN_TO_ONE.replace(
    free_length=0.59,
    release_angle=math.radians(110),
    hanging_length=0.05,
    light_drag=4e-4,
    kinetic_friction=0.31,
    static_friction=0.31,
)
ORIGIN = {"origin_x": 2e-3, "origin_y": -1e-3}
"""Where the rod's axis is in the file [m]."""
MAX_Z = 4.0
"""Largest error in standard errors: one of the 28 numbers exceeds it once in 500 such tests."""
SHARE = 0.2
"""Largest difference between two least squares of the same points, in standard errors."""
LARGEST_NOISE_CORRELATION = 0.3


def task(seed, truth=TRUTH, start=TEN_TO_ONE):
    """Points of a filmed trial, to be fitted from other settings."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, FILMED, 1 / FRAME_RATE)
    samples = solve_at(truth, t)
    filmed = {
        mass: np.column_stack([t, place + list(ORIGIN.values()) + NOISE * rng.standard_normal((len(t), 2))]).tolist()
        for mass, place in (("light", samples.light_position), ("heavy", samples.heavy_position))
    }
    return {"settings": live_settings(start), "duration": 5, **filmed}


def planted(name):
    return ORIGIN[name] if name in ORIGIN else TRUTH.values().__dict__[name]


@pytest.mark.accurate  # daily, the same least squares as SciPy's, below
def test_planted_values_come_back_within_their_standard_errors(node):
    results = node("fit_trials.mjs", [task(seed) for seed in range(4)])
    z = [(p["value"] - planted(p["name"])) / p["error"] for result in results for p in result["parameters"]]
    assert len(z) == 4 * 7
    assert np.abs(z).max() < MAX_Z
    assert 0.6 < np.sqrt(np.mean(np.square(z))) < 1.5  # 1 if the errors are right; 28 numbers scatter by a seventh
    for result in results:
        assert result["converged"]
        assert result["after"] == pytest.approx(NOISE, rel=0.1)
        assert result["before"] > 10 * result["after"]
        assert abs(result["alike"]) < LARGEST_NOISE_CORRELATION


def test_it_finds_the_least_squares_that_scipy_finds(node):
    given = task(11)
    [result] = node("fit_trials.mjs", [given])
    light, heavy = np.array(given["light"]), np.array(given["heavy"])
    names = [p["name"] for p in result["parameters"]]
    errors = np.array([p["error"] for p in result["parameters"]])

    def residuals(scaled):
        values = dict(zip(names, truth + errors * scaled, strict=True))
        origin = [values.pop("origin_x"), values.pop("origin_y")]
        run = solve_at(TEN_TO_ONE.replace(**values, static_friction=values["kinetic_friction"]), light[:, 0])
        return np.concatenate(
            [(light[:, 1:] - run.light_position - origin).ravel(), (heavy[:, 1:] - run.heavy_position - origin).ravel()]
        )

    truth = np.array([planted(name) for name in names])
    found = least_squares(residuals, np.zeros(len(names)), diff_step=1e-3)
    values = np.array([p["value"] for p in result["parameters"]])
    assert (np.abs(values - truth - errors * found.x) < SHARE * errors).all()


def test_a_missing_effect_is_not_called_noise(node):
    [result] = node("fit_trials.mjs", [task(5, truth=TRUTH.replace(side_force=3e-3))])
    assert result["alike"] > LARGEST_NOISE_CORRELATION
