"""Fits take hundreds of runs: without heyoka a run costs sixty times as much, so the tests that fit are left out there."""

import pytest

from looping_pendulum.reference_ode.solve import available_integrators

FITTING = (
    "test_camera_studies",
    "test_events",
    "test_first_look",
    "test_identify",
    "test_held_out",
    "test_evidence",
    "test_calibration",
    "test_residual",
    "test_discovery",
    "test_real_data",
    "test_held_pendulum",
    "test_outliers",
    "test_correlated_noise",
)


def pytest_collection_modifyitems(items):
    if "heyoka" in available_integrators():
        return
    skip = pytest.mark.skip(reason="heyoka is not installed: these fits would take many minutes with SciPy")
    for item in items:
        if item.path.stem in FITTING:
            item.add_marker(skip)
