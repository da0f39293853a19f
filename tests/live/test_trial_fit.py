"""The live page's fit of a trial: the oracle is what was planted. `test_fit_against_identify` compares it with `identify`."""

import math

import numpy as np
import pytest

from looping_pendulum.live.write import live_settings
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
CAMERA_TRUTH = {"origin_x": 2e-3, "origin_y": -1e-3, "clock_offset": -0.05}
"""Where the rod's axis is in the file [m], and the time since the release at which its clock is 0 [s]."""
CAMERA_START = {"origin_x": 0.0, "origin_y": 0.0, "clock_offset": -0.04}
MAX_Z = 4.0
"""Largest error in standard errors: one of the 32 numbers exceeds it once in 500 such tests."""


def task(seed, truth=TRUTH, **changes):
    """Points of a filmed trial, to be fitted from other settings."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, FILMED, 1 / FRAME_RATE)
    samples = solve_at(truth, np.maximum(t + CAMERA_TRUTH["clock_offset"], 0))
    origin = [CAMERA_TRUTH["origin_x"], CAMERA_TRUTH["origin_y"]]
    channels = [
        {"name": f"{mass}_{axis}", "t": t.tolist(), "value": (column + NOISE * rng.standard_normal(len(t))).tolist()}
        for mass, place in (("light", samples.light_position), ("heavy", samples.heavy_position))
        for axis, column in zip("xy", (place + origin).T, strict=True)
    ]
    return {"settings": live_settings(TEN_TO_ONE), "channels": channels, "camera": CAMERA_START, "known": {}, **changes}


def planted(name):
    return CAMERA_TRUTH[name] if name in CAMERA_TRUTH else TRUTH.values().__dict__[name]


def test_planted_values_come_back_within_their_standard_errors(node):
    results = node("fit_trials.mjs", [task(seed) for seed in range(4)])
    z = [(p["value"] - planted(p["name"])) / p["error"] for result in results for p in result["parameters"]]
    assert len(z) == 4 * 8
    assert np.abs(z).max() < MAX_Z
    assert 0.6 < np.sqrt(np.mean(np.square(z))) < 1.5  # 1 if the errors are right; 32 numbers scatter by an eighth
    for result in results:
        assert result["converged"]
        assert result["after"] == pytest.approx(NOISE, rel=0.1)
        assert result["before"] > 10 * result["after"]
        assert result["outliers"] == 0
        assert not result["tests"]["larger"]
        assert not result["tests"]["pattern"]


def test_a_wrong_mass_is_corrected_within_its_error(node):
    believed = live_settings(TEN_TO_ONE.replace(heavy_mass=1.03 * TRUTH.heavy_mass))
    known = {"heavy_mass": 0.03 * believed["heavy_mass"], "light_mass": 0.0}
    exact, corrected = node("fit_trials.mjs", [task(7, settings=believed, known=k) for k in ({}, known)])
    masses = [p for p in corrected["parameters"] if p["name"].endswith("mass")]
    assert [p["name"] for p in masses] == ["heavy_mass"]  # without an error the light one is not fitted
    for result, allowed in ((exact, False), (corrected, True)):
        [friction] = [p for p in result["parameters"] if p["name"] == "kinetic_friction"]
        assert (abs(friction["value"] - TRUTH.coefficients["kinetic_friction"]) < MAX_Z * friction["error"]) == allowed
    assert masses[0]["value"] == pytest.approx(TRUTH.heavy_mass, abs=MAX_Z * masses[0]["error"])
    assert masses[0]["error"] < known["heavy_mass"]


def test_a_missing_effect_is_not_called_noise(node):
    [result] = node("fit_trials.mjs", [task(5, truth=TRUTH.replace(side_force=3e-3))])
    assert result["tests"]["pattern"]
    assert result["tests"]["larger"]
