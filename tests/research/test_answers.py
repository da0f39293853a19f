"""The summaries that docs/answers.md is made from: fresh runs say what they say."""

import json
import math

import numpy as np
import pytest

from looping_pendulum.reference_ode.solve import solve
from looping_pendulum.scenarios.loader import load
from research import heyoka_runs
from research.answers import boundaries, common, precision, questions
from research.answers.lyapunov import solve_tangent_map

pytest.importorskip("heyoka", reason="the summaries are computed with heyoka")


def test_the_four_halting_times_come_out_again():
    """Two solvers, heyoka and the reference, within what each keeps at its tolerance times the growth to the halt (20)."""
    for degrees, stored in common.read("four_angles")["scenario"].items():
        p = common.at_angle(common.case("scenario"), float(degrees))
        reported = float(stored["reported_time"])
        assert heyoka_runs.solve(p).halting_time == pytest.approx(reported, abs=1e-14)
        assert solve(p).halting_time == pytest.approx(reported, abs=1e-11)


def test_the_growth_to_the_halt_comes_out_again():
    stored = common.read("growth")["scenario"]["at_last_stop"]
    p = common.at_angle(common.case("scenario"), 75.0)
    fresh = solve_tangent_map(p, np.array([stored["t"] + 1e-9]))
    assert fresh.growth[0, 0] == pytest.approx(stored["growth"], rel=1e-6)


def test_a_plain_program_comes_out_again():
    stored = common.read("plain_programs")
    step = stored["steps"].index(0.01)
    p = common.at_angle(common.case("scenario"), 75.0)
    assert (
        precision.apparent_halting_time(*precision.fixed_step_path(p, "rk4", 0.01))
        == stored["cases"]["scenario"]["rk4"][step][0]
    )


def test_changes_along_the_angle_are_where_the_summary_says():
    changes = common.read("along_the_angle")["equal"]
    base = common.case("scenario")
    for change in changes[:: max(1, len(changes) // 8)]:
        sides = [solve(common.at_angle(base, change["angle"] + s * 2e-6), duration=10.0).modes for s in (-1, 1)]
        assert [common.letters(modes) for modes in sides] == [change["below"], change["above"]]


def test_the_lowest_ratio_halts_and_a_millionth_less_does_not():
    data, longest = common.read("lowest_ratio"), questions.LONGEST_TIME_LIMIT
    for name in common.CASES:
        base, stored = common.case(name), data[name]
        for where in (stored["best"], stored["at_75"] | {"angle": 75.0}):
            p = common.at_angle(base, where["angle"])
            above, below = (p.replace(heavy_mass=(where["ratio"] + s * 1e-6) * p.light_mass) for s in (1, -1))
            assert solve(above, duration=longest).halting_time is not None
            assert solve(below, duration=longest).halting_time is None


def test_the_maps_hold_what_single_runs_say():
    base = load("ten_to_one").parameters
    data = common.read_map("halting_map")
    rng = np.random.default_rng(3)
    for _ in range(12):
        i, j = rng.integers(len(data["release_angle"])), rng.integers(len(data["mass_ratio"]))
        heavy = float(data["mass_ratio"][j]) * base.light_mass
        run = solve(base.replace(release_angle=float(data["release_angle"][i]), heavy_mass=heavy))
        stored = data["halting_time"][i, j]
        assert (run.halting_time is None) == math.isnan(stored)
        if run.halting_time is not None:
            assert abs(run.halting_time - stored) <= 0.51 * common.TIME_UNIT


def test_masses_times_s_are_drags_over_s():
    """One is the other to the last digits, so the two runs differ by rounding alone."""
    result = questions._mass_drag_equivalence(load("ten_to_one").parameters)
    assert result["largest_difference"] < 1e-12


@pytest.mark.accurate
@pytest.mark.parametrize("name", ["growth", "mass_scale", "near_75"])
def test_a_whole_summary_comes_out_again(name, tmp_path, monkeypatch):
    module = questions if hasattr(questions, name) else boundaries
    stored = common.read(name)
    monkeypatch.setattr(common, "DATA", tmp_path)
    common.write(name, getattr(module, name)())
    fresh = json.loads((tmp_path / f"{name}.json").read_text())
    _compare(fresh, stored)


def _compare(a, b):
    if isinstance(a, dict):
        assert a.keys() == b.keys()
        for key in a:
            _compare(a[key], b[key])
    elif isinstance(a, list):
        assert len(a) == len(b)
        for x, y in zip(a, b, strict=True):
            _compare(x, y)
    elif isinstance(a, float):
        assert a == pytest.approx(b, rel=1e-3, abs=1e-9)
    else:
        assert a == b
