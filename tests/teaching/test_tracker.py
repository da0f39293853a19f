"""A motion for Tracker: what our own readers make of the file, and where its rows lie."""

import numpy as np
import pytest

from looping_pendulum.compare.trajectories import trajectory_csv
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.registry import select
from looping_pendulum.files import file_stem
from looping_pendulum.measured.readers import read
from looping_pendulum.reference_ode.solve import solve
from looping_pendulum.scenarios import load
from looping_pendulum.teaching.tracker import TrackerError, find_motion, overlay, trajectory_motion


def simulated(engine, profile=Profile.QUICK):
    return select([engine], profile)[0].simulate(load("ten_to_one"))


@pytest.mark.parametrize("engine", [None, "mujoco:capstan"])
def test_our_readers_read_every_digit_back(tmp_path, engine):
    frames = overlay(find_motion("ten_to_one", engine), frame_rate=240.0, start=0.35)
    file = tmp_path / "overlay.csv"
    file.write_text(frames.to_csv())
    # By the clip's clock, which the study of such a file would state by `clock_offset`
    points = read(file, starts_at_release=False)
    assert not points.unused
    for name, values in (("heavy", frames.heavy), ("light", frames.light)):
        for axis, column in zip("xy", values.T, strict=True):
            channel = points.channel(f"{name}_{axis}")
            assert np.array_equal(channel.t, frames.t)
            assert np.array_equal(channel.value, column)


def test_rows_lie_on_the_frames_of_the_video_and_have_the_places_of_the_reference():
    frames = overlay(find_motion("ten_to_one"), frame_rate=240.0, start=0.3512)
    assert frames.first_frame == 85  # 0.3512 s is between the frames 84 and 85
    assert np.array_equal(frames.t, (85 + np.arange(len(frames.t))) / 240)
    scenario = load("ten_to_one")
    samples = solve(scenario.parameters).sample(frames.t - 0.3512)
    assert np.array_equal(frames.light, samples.light_position)
    assert np.array_equal(frames.heavy, samples.heavy_position)


def test_between_samples_an_engines_run_is_as_near_to_the_reference_as_on_them():
    run = simulated("reference:scipy", Profile.ACCURATE)
    frames = overlay(trajectory_motion(run), frame_rate=777.0)
    exact = overlay(find_motion("ten_to_one"), frame_rate=777.0)
    # Samples are 1 ms apart and a cubic bends by the fourth power of it; at the halt, where the acceleration jumps by some
    # 20 m/s^2, it is off by a tenth of a (1 ms)^2: 2 um.
    assert np.abs(frames.light - exact.light).max() < 1e-5
    assert np.abs(frames.heavy - exact.heavy).max() < 1e-5


def test_a_run_in_a_folder_of_compare_is_found(tmp_path):
    folder = tmp_path / "trajectories"  # as `compare` writes it
    folder.mkdir()
    for engine in ("mujoco:capstan", "mujoco:documented"):
        run = simulated(engine)
        (folder / f"{file_stem(run.label, run.profile)}.csv").write_text(trajectory_csv(run))
    (folder / "reference.csv").write_text(trajectory_csv(simulated("reference:scipy")))
    exact = overlay(find_motion("ten_to_one"))
    kept = overlay(find_motion(str(tmp_path)))
    assert np.allclose(kept.light, exact.light, atol=1e-5)
    engine = overlay(find_motion(str(tmp_path), "mujoco:documented"))
    assert np.abs(engine.light - exact.light).max() > 0.1  # it never halts
    with pytest.raises(TrackerError, match="2 runs of 'mujoco'.*choose by --engine"):
        find_motion(str(tmp_path), "mujoco")
    with pytest.raises(TrackerError, match="no run of 'pymunk'"):
        find_motion(str(tmp_path), "pymunk")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"frame_rate": 0.0}, "--fps: found 0"),
        ({"frame_rate": float("nan")}, "--fps: found nan"),
        ({"start": -1.0}, "--start: found -1"),
        ({"frame_rate": 0.1, "start": 1.0}, "no frame falls into"),
    ],
)
def test_impossible_frames_are_refused(options, message):
    with pytest.raises(TrackerError, match=message):
        overlay(find_motion("ten_to_one"), **options)


def test_a_file_that_is_no_run_is_refused_in_one_line(tmp_path):
    file = tmp_path / "marks.csv"
    file.write_text("t,x,y\n0,1,2\n")
    (tmp_path / "empty").mkdir()
    with pytest.raises(TrackerError, match="found no column 'heavy_x'"):
        find_motion(str(file))
    with pytest.raises(TrackerError, match="found no runs"):
        find_motion(str(tmp_path / "empty"))
