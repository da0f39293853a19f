"""Where a trial's points end: by motions of the blind simulator, with a ball that comes to rest at the rod or in a hand."""

import dataclasses
import math

import numpy as np
import pytest
from typer.testing import CliRunner

from looping_pendulum.cli.main import app
from looping_pendulum.discrepancy.inputs import read_inputs
from looping_pendulum.discrepancy.look.check import DeclarationError, take_first_look
from looping_pendulum.measured import edits
from looping_pendulum.measured.edits import until_end, until_stop
from looping_pendulum.measured.study import Estimate, read_files
from looping_pendulum.measured.study_io import load
from tests.blind import Apparatus, Effects
from tests.blind.simulator import simulate

RELEASE_ANGLE = math.radians(112)
FRAME_RATE, NOISE = 240, 2e-4
"""[Hz], [m]"""
ORIGIN = "{origin_x: 0 mm +/- 0.3 mm, origin_y: 0 mm +/- 0.3 mm}"


def positions(effects=None, *, stop=math.inf, stopping=0.01, frame_rate=FRAME_RATE, **apparatus):
    """Return times, light and heavy mass [s, m] of a trial whose light mass somebody stops from a time on, within another."""
    motion = simulate(Apparatus(**apparatus), effects, duration=1.5)
    t = np.arange(0.0, 1.5, 1 / frame_rate)
    late = np.maximum(t - stop, 0.0)
    shown = np.minimum(t, stop) + 0.5 * stopping * -np.expm1(-2 * late / stopping)
    light, heavy = motion.at(np.minimum(shown, motion.t[-1]))
    noise = np.random.default_rng(3).normal(0, NOISE, (2, len(t), 2))
    return t, light + noise[0], heavy + noise[1]


def study(folder, points, *, radius="", origin=ORIGIN, heavy_mass=0.1, release_angle=RELEASE_ANGLE):
    t, light, heavy = points
    np.savetxt(folder / "first.csv", np.column_stack([t, light, heavy]), delimiter=",", comments="", fmt="%.6f",
               header="t [s],light_x [m],light_y [m],heavy_x [m],heavy_y [m]")  # fmt: skip
    light_mass = f"{{mass: 10 g, radius: {radius}}}" if radius else "{mass: 10 g}"
    (folder / "study.yaml").write_text(
        f"title: ends\napparatus: {{light: {light_mass}, heavy: {{mass: {1e3 * heavy_mass:g} g}}, rod: {{radius: 6.25 mm}}}}\n"
        "effects: {gravity: 9.81 m/s^2, capstan: free}\n"
        f"trials: [{{file: first.csv, camera: {origin},\n"
        f"          release: {{angle: {math.degrees(release_angle):g} deg, free_length: 58 cm}}}}]\n"
    )
    return load(folder / "study.yaml")


def end_of(study):
    """Return the time of the last point that is used [s], and what the trial says of its end."""
    (trial,) = study.trials
    read = read_files(study.folder, trial)
    check = take_first_look(study)
    assert not check.mistakes, check.mistakes[0].text
    used = check.observations[trial.name]
    assert used.unused[: len(read.unused)] == read.unused
    said = [u.reason for u in used.unused[len(read.unused) :]]
    assert sum(u.count for u in used.unused[len(read.unused) :]) == sum(len(c) for c in read.channels) - used.used
    return max(c.t[-1] for c in used.channels), " ".join(said)


def test_points_end_where_a_ball_of_the_declared_radius_reaches_the_rod(tmp_path):
    radius = 8e-3
    points = positions(Effects(light_radius=radius))
    distance = np.hypot(*points[1].T)
    first_on_rod = points[0][np.argmax(distance < 6.25e-3 + radius + 3 * NOISE)]
    declared = study(tmp_path, points, radius="8 mm +/- 0.2 mm")
    end, said = end_of(declared)
    assert first_on_rod - 0.02 < end < first_on_rod
    assert "8 mm in radius, is at the rod" in said
    # The study's data have it, and the model ends there, too, without a parameter that no point tells
    inputs = read_inputs(declared)
    assert max(inputs.training[0].t) == end
    assert inputs.study.trials[0].estimates["light_radius"].value == radius
    assert "light_radius" not in {p.name for p in inputs.free_parameters}


def test_points_of_a_refused_trial_end_at_the_rod_too(tmp_path):
    """`--anyway` searches with them: those of a mirrored film went on to the end, and so did its ball on the rod."""
    t, light, heavy = positions(Effects(light_radius=8e-3))
    check = take_first_look(study(tmp_path, (t, light * [-1, 1], heavy * [-1, 1]), radius="8 mm +/- 0.2 mm"))
    assert [m.keys for m in check.mistakes] == ["mirrored: true"]
    (observations,) = check.observations.values()
    assert "8 mm in radius, is at the rod" in observations.unused[-1].reason


def test_a_ball_that_rests_on_the_string_that_it_wound_up_ends_the_points_after_all_that_is_looked_at(tmp_path):
    """Its marks on the rod were fitted: the string's thickness and the ball's inertia were "identified"."""
    t, light, heavy = positions(stop=1.1)
    end, said = end_of(study(tmp_path, (t, light, heavy)))
    assert 1.1 - 0.02 < end < 1.1 + 1 / FRAME_RATE
    assert "something other than its string" in said


def test_the_end_of_a_swing_is_no_stop(tmp_path):
    t, light, heavy = positions()
    x = light[:, 0]
    turns = np.flatnonzero((np.diff(np.sign(np.diff(x))) != 0) & (t[1:-1] > 0.4)) + 3
    for last in turns[:5]:
        (trial,) = (declared := study(tmp_path, (t[:last], light[:last], heavy[:last]))).trials
        assert len(until_stop(read_files(declared.folder, trial)).channels[0]) == last


def test_a_film_says_how_large_the_ball_is_unless_the_study_does(tmp_path):
    declared = study(tmp_path, positions(Effects(light_radius=8e-3)))
    (trial,) = declared.trials
    seen = dataclasses.replace(read_files(declared.folder, trial), light_radius=(8.1e-3, 3e-4))
    assert "8.1 mm in radius, is at the rod" in until_end(declared, trial, seen, {}).unused[-1].reason
    stated = study(tmp_path, positions(Effects(light_radius=8e-3)), radius="7.9 mm")
    assert "7.9 mm in radius" in until_end(stated, stated.trials[0], seen, {}).unused[-1].reason


def test_a_film_is_read_until_its_ball_is_at_the_rod(tmp_path, monkeypatch):
    """A ball that rested there looked like a clock that is eight times too slow, and the film was refused."""
    declared = study(tmp_path, positions(Effects(light_radius=8e-3)))
    (trial,) = declared.trials
    seen = dataclasses.replace(read_files(declared.folder, trial), light_radius=(8e-3, 2e-4))
    monkeypatch.setattr(edits, "is_film", lambda path: True)
    monkeypatch.setattr(edits, "read_files", lambda *_: seen)
    assert "8 mm in radius, is at the rod" in edits.read_trial(declared, trial).unused[-1].reason
    free = dataclasses.replace(trial, camera={"origin_x": Estimate(value=0.0, free=True)})
    assert edits.read_trial(declared, free) == seen  # where the rod is, only a fit tells


LATE_OR_SLOW = [
    pytest.param(*case, marks=pytest.mark.long) for case in ((0.5, 1e-3), (0.9, 1e-3), (0.5, 0.02), (0.7, 0.02), (0.9, 0.02))
]


@pytest.mark.parametrize(("stop", "stopping"), [(0.7, 1e-3), *LATE_OR_SLOW])
def test_points_end_before_a_hand_stops_the_light_mass(stop, stopping, tmp_path):
    end, said = end_of(study(tmp_path, positions(stop=stop, stopping=stopping)))
    assert stop - 0.03 < end <= stop
    assert "something other than its string" in said
    assert f"{end + 1 / FRAME_RATE:.3f} s" in said


@pytest.mark.long
@pytest.mark.parametrize("stopping", [5e-3, 0.1])
def test_points_end_before_a_hand_stops_the_light_mass_with_few_frames(stopping, tmp_path):
    end, said = end_of(study(tmp_path, positions(stop=0.6, stopping=stopping, frame_rate=60)))
    assert 0.6 - 5 / 60 < end <= 0.6 + 0.1 * stopping
    assert "something other than its string" in said


def test_a_ball_on_the_string_that_is_wound_on_the_rod_is_at_the_rod(tmp_path):
    t, light, heavy = positions(Effects(light_radius=8e-3))
    windings = 1.5e-3
    on_rod = int(np.argmax(np.hypot(*light.T) < 6.25e-3 + 8e-3 + windings))
    light[on_rod:] = light[on_rod]  # a codec stores what does not move once
    end, said = end_of(study(tmp_path, (t, light, heavy), radius="8 mm +/- 0.2 mm"))
    assert t[on_rod] - 0.05 < end < t[on_rod]
    assert "8 mm in radius, is at the rod" in said


@pytest.mark.long
def test_a_catch_is_no_change_of_the_clock_and_is_said(tmp_path):
    study(tmp_path, positions(stop=0.6, stopping=0.03))
    looked = CliRunner().invoke(app, ["look", str(tmp_path / "study.yaml"), "--out", str(tmp_path / "look")])
    assert looked.exit_code == 0, looked.output
    assert "something other than its string holds the light mass" in " ".join(looked.output.split())


def test_an_origin_that_is_free_and_far_off_costs_no_point(tmp_path):
    """From 10 cm on, 148 to 406 values were left out as a hand's: what is cut is judged about the fitted origin."""
    t, light, heavy = positions()
    moving = np.hypot(*light.T) > 12e-3
    count = len(t) if moving.all() else int(np.argmin(moving))
    shifted = (t[:count], light[:count] + 0.15, heavy[:count] + 0.15)
    end, said = end_of(study(tmp_path, shifted, origin="{origin_x: free from 0 mm, origin_y: free from 0 mm}"))
    assert said == ""
    assert end == pytest.approx(t[count - 1])


def test_points_that_no_hypothesis_explains_are_not_left_out(tmp_path):
    """The corner of a box whose size changes: 330 values went as those of a hand, and a clock_offset was identified."""
    t, light, heavy = positions()
    size = 0.03 + 0.05 * np.abs(np.sin(40 * t))
    declared = study(tmp_path, (t, light - size[:, None], heavy - 0.02))
    check = take_first_look(declared)
    assert check.mistakes
    with pytest.raises(DeclarationError):
        check.refuse_mistakes()
    used, read = check.observations["first"], read_files(declared.folder, declared.trials[0])
    assert used.used == read.used


@pytest.mark.long
def test_a_wall_from_which_the_light_mass_rebounds_costs_no_point(tmp_path):
    """Nothing holds the mass: something begins to act later, which is left to the fit, and no point is left out."""
    t, light, heavy = positions()
    wall = 0.7
    back = np.where(t < wall, t, 2 * wall - t)
    light = np.stack([np.interp(back, t, axis) for axis in light.T], axis=1)
    declared = study(tmp_path, (t, light, heavy))
    read = read_files(declared.folder, declared.trials[0])
    assert take_first_look(declared).observations["first"].used == read.used


TWO_TO_ONE = {"heavy_mass": 0.02, "release_angle": math.radians(80)}
EFFECTS = {
    "nothing": None,
    "side force": Effects(side_force=5e-3),
    "push": Effects(push=0.3),
    "linear drag": Effects(linear_drag=5e-3),
    "side stiffness": Effects(side_stiffness=0.05),
    "magnet": Effects(magnet=0.05),
    "wind": Effects(wind=2.0),
    "stretch": Effects(compliance=0.02, string_loss_time=0.01),
    "static friction": Effects(static_excess=0.3),
}
TOO_LARGE = pytest.mark.xfail(strict=True, reason="moves exact points by 36 to 50 mm, and is refused")


@pytest.mark.parametrize(
    ("effects", "apparatus"),
    [
        pytest.param(
            effects,
            apparatus,
            id=f"{ratio} {name}",
            marks=[TOO_LARGE] * (not apparatus and name in ("side stiffness", "stretch"))
            + [pytest.mark.long] * (effects is not None),
        )
        for ratio, apparatus in (("10:1", {}), ("2:1", TWO_TO_ONE))
        for name, effects in EFFECTS.items()
    ],
)
def test_no_effect_looks_like_a_hand(effects, apparatus, tmp_path):
    t, light, heavy = positions(effects, **apparatus)
    moving = np.hypot(*light.T) > 12e-3  # before it reaches the rod
    count = len(t) if moving.all() else int(np.argmin(moving))
    end, said = end_of(study(tmp_path, (t[:count], light[:count], heavy[:count]), **apparatus))
    assert "holds" not in said
    assert end == pytest.approx(t[count - 1])


SLIPS = {
    "single points": ([60, 130, 175], [[0.03, -0.01], [-0.05, 0.02], [0.01, 0.04]]),
    "small": ([120, 150, 190], [[0.004, -0.005], [-0.006, 0.002], [0.001, 0.007]]),
    "another thing for a while": (slice(100, 130), [0.03, -0.02]),
}


@pytest.mark.long
@pytest.mark.parametrize("slip", SLIPS)
def test_a_slip_of_the_tracker_is_no_hand(slip, tmp_path):
    t, light, heavy = positions()
    where, way = SLIPS[slip]
    light[where] += way
    count = int(np.argmax(np.hypot(*light.T) < 12e-3)) or len(t)
    end, said = end_of(study(tmp_path, (t[:count], light[:count], heavy[:count])))
    assert said == ""
    assert end == pytest.approx(t[count - 1])
