"""Runs in double and extended precision."""

import math

import numpy as np
import pytest

from looping_pendulum.errors import MissingPackageError
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.scenarios.loader import load

heyoka = pytest.importorskip("heyoka", reason="runs in extended precision need heyoka")
from research import heyoka_runs  # noqa: E402


@pytest.mark.parametrize("angle", [66.5, 75.1, 100.5])
def test_double_precision_is_right_to_its_rounding(angle):
    """Modes agree, and event times are within a hundred roundings: as much as small differences grow during a run."""
    p = load("two_and_a_half_to_one").parameters.replace(release_angle=math.radians(angle))
    exact, double = heyoka_runs.solve(p, precision="128-bit"), heyoka_runs.solve(p)
    assert exact.modes == double.modes
    assert abs(double.halting_time - float(exact.halting_time)) < 100 * np.finfo(float).eps


def test_precisions_agree_to_80_bits():
    p = load("two_and_a_half_to_one").parameters
    a, b = heyoka_runs.solve(p, precision="80-bit"), heyoka_runs.solve(p, precision="128-bit")
    assert a.modes == b.modes
    difference = type(b.halting_time)(str(a.halting_time)) - b.halting_time
    assert abs(float(difference)) < 100 * float(np.finfo(np.longdouble).eps)


def test_a_frictionless_drop_is_a_fall():
    """Falling h without drag takes sqrt(2 h / g), to 128 bits' tolerance but for the series that leaves rest."""
    p = Parameters(
        light_mass=0.02, heavy_mass=0.2, rod_radius=1e-3, free_length=0.5, release_angle=math.pi, hanging_length=0.1,
        release=Release.VERTICAL,
    )  # fmt: skip
    run = heyoka_runs.solve(p, duration=5.0, precision="128-bit")
    fall = run.parameters.free_length - run.parameters.end_length  # the light mass rises to the rod
    acceleration = 9.81 * (0.2 - 0.02) / (0.2 + 0.02)
    assert float(run.end_time) == pytest.approx(math.sqrt(2 * fall / acceleration), rel=1e-12)


def test_a_precision_is_that_of_its_numbers(monkeypatch):
    # Oracle: what the names say. 64 bits of fraction in 80 (x86's), 113 in 128 (IEEE's quadruple).
    if "real128" in dir(heyoka):
        assert heyoka_runs.number_type_of("128-bit") is heyoka.real128
        monkeypatch.delattr(heyoka, "real128")
    if np.finfo(np.longdouble).nmant >= 63:
        assert heyoka_runs.number_type_of("80-bit") is np.longdouble
    with pytest.raises(MissingPackageError, match="128-bit numbers are not available"):
        heyoka_runs.number_type_of("128-bit")


def test_an_unknown_precision_is_refused():
    with pytest.raises(ValueError, match="double, 80-bit, 128-bit"):
        heyoka_runs.solve(load("ten_to_one").parameters, precision="64-bit")
