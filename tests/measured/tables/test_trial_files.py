"""Files of a trial for `compare --marks`: the oracle is the motion that the files were made of, seen by a known camera."""

import hashlib
import os
from pathlib import Path

import numpy as np
import pytest

from looping_pendulum.compare.trial_files import read_measured_trial
from looping_pendulum.errors import HarnessError
from looping_pendulum.measured import study_io
from looping_pendulum.measured.camera import Camera
from looping_pendulum.measured.observations import DataError
from looping_pendulum.measured.study_io import StudyError
from looping_pendulum.measured.tables.events import find_data, read_event_table

T = np.arange(60) / 100
LIGHT = np.column_stack([-0.5 + T, -0.2 - 0.3 * T])
HEAVY = np.column_stack([np.full(60, 0.006), -0.05 - 0.4 * T**2])


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def write(name="trial.csv", t=T, light=LIGHT, heavy=HEAVY, tracks=("light", "heavy")):
    rows = np.column_stack([t, light, heavy]).tolist()
    head = f",{tracks[0]},,{tracks[1]},,\nt,x,y,x,y,\n"
    Path(name).write_text(head + "".join(",".join(map(repr, row)) + ",\n" for row in rows))
    return name


def points(trial, name="light mass"):
    return np.array(next(track for track in trial.tracks if track.name == name).values).T


def test_a_tracker_export_is_read_as_it_is():
    trial = read_measured_trial([write()])
    assert (trial.name, trial.source) == ("trial", "trial.csv")
    assert points(trial) == pytest.approx(LIGHT)
    assert points(trial, "heavy mass") == pytest.approx(HEAVY)
    assert [track.level_unknown for track in trial.tracks] == [False, True]
    assert "used light_x 60" in trial.notes[0]


def test_units_frame_rate_mirror_and_names_can_be_said():
    write(t=np.arange(60) / 30, light=LIGHT * [-100, 100], heavy=HEAVY * [-100, 100], tracks=("mass A", "mass B"))
    settings = ["tracks.light=mass A", "tracks.heavy=mass B", "units.length=cm", "frame_rate=100 Hz", "mirrored=true"]
    trial = read_measured_trial(["trial.csv"], settings)
    assert points(trial) == pytest.approx(LIGHT)
    assert trial.tracks[0].t == pytest.approx(T)
    assert "put to 100" in " ".join(trial.notes)


def test_the_camera_is_undone_and_points_before_the_release_are_left_out():
    camera = Camera(origin_x=0.02, origin_y=-0.01, scale=1.05, tilt=0.03, perspective_x=0.1, distortion=0.05)
    write(t=T + 0.35, light=camera.project(LIGHT), heavy=camera.project(HEAVY))
    settings = ["camera.origin_x=2 cm", "camera.origin_y=-1 cm", "camera.scale=1.05", "camera.tilt=0.03 rad"]
    settings += ["camera.perspective_x=0.1 1/m", "camera.distortion=0.05 1/m^2", "camera.clock_offset=-0.4 s"]
    trial = read_measured_trial(["trial.csv"], settings)
    assert trial.tracks[0].t == pytest.approx(T[5:] - 0.05, abs=1e-12)
    assert points(trial) == pytest.approx(LIGHT[5:], abs=1e-9)  # rounding: Newton's steps end far below
    assert "10 points before the release are left out." in trial.notes


def test_a_file_for_each_mass():
    for name, places in (("a.csv", LIGHT), ("b.csv", HEAVY)):
        Path(name).write_text(
            "t,x,y\n" + "".join(f"{t!r},{x!r},{y!r}\n" for t, (x, y) in zip(T.tolist(), places.tolist(), strict=True))
        )
    trial = read_measured_trial(["heavy=b.csv", "light=a.csv"])
    assert points(trial) == pytest.approx(LIGHT)
    assert points(trial, "heavy mass") == pytest.approx(HEAVY)


def test_events_beside_points_and_alone():
    Path("events.csv").write_text("quantity,index,value,sigma,unit\nhalting_time,1,381,4,ms\n")
    both = read_measured_trial([write(), "events.csv"])
    assert len(both.tracks) == 2
    (row,) = both.rows
    assert (row.quantity, row.measured, row.sigma, row.unit) == ("halting_time", 0.381, 0.004, "s")
    assert read_measured_trial(["events.csv"]).tracks == ()


def test_an_angle_grows_from_straight_down_and_a_height_falls():
    Path("angle.txt").write_text("".join(f"{t} {0.5 - t}\n" for t in T.tolist()))
    (angle,) = read_measured_trial(["angle.txt"]).tracks
    assert (angle.name, angle.unit) == ("wrap angle", "rad")
    assert angle.values[0] == pytest.approx(np.pi + 0.5 - T)
    Path("drop.csv").write_text("time,height\n" + "".join(f"{t},{30 - 4.9 * t * t}\n" for t in T.tolist()))
    (height,) = read_measured_trial(["drop.csv"], ["dropped=light"]).tracks
    assert (height.name, height.channels, height.level_unknown) == ("light mass", ("light_y",), True)


def test_a_trial_of_a_study():
    write("one.csv")
    write("two.csv", light=LIGHT + 0.01)
    release = "{angle: 112 deg, free_length: 58 cm}"
    entries = "".join(f"  - {{file: {name}.csv, release: {release}, heavy: {{mass: 100 g}}}}\n" for name in ("one", "two"))
    Path("study.yaml").write_text(
        f"title: Two\napparatus: {{light: {{mass: 10 g}}, rod: {{radius: 6 mm}}}}\ntrials:\n{entries}"
    )
    assert points(read_measured_trial(["study.yaml"], ["name=two"])) == pytest.approx(LIGHT + 0.01)
    for settings, message in (
        ([], "study.yaml: found the trials one, two, needed one of them; choose by --marks-set name=one"),
        (["name=three"], "found no trial 'three' among one, two"),
        (["mirrored=true"], "found a study file beside other files or settings"),
    ):
        with pytest.raises(HarnessError, match="^[^\n]*$") as error:
            read_measured_trial(["study.yaml"], settings)
        assert message in str(error.value)


@pytest.mark.parametrize(
    ("tracks", "settings", "message"),
    [
        (
            ("a", "b"),
            [],
            "which mass each is; by their motion, write --marks-set tracks.light=a --marks-set tracks.heavy=b",
        ),
        (
            ("a", "b"),
            ["tracks.light=c"],
            "the tracks 'a', 'b', needed 'c'; by their motion, write --marks-set tracks.light=a --marks-set tracks.heavy=b",
        ),
        (("light", "heavy"), ["frame_rate=240"], "--marks-set: frame_rate: expected a quantity in Hz, got '240'"),
        (("light", "heavy"), ["frame_rat=1 Hz"], "did you mean 'frame_rate'?"),
        (("light", "heavy"), ["camera.orign_x=1 m"], "did you mean 'origin_x'?"),
        (("light", "heavy"), ["mirrored"], "--marks-set: found 'mirrored', needed KEY=VALUE"),
        (("light", "heavy"), ["release.angle=3 deg"], "found the key 'release.angle', needed one of: name, kind"),
        (("light", "heavy"), ["camera.clock_offset=-9 s"], "found no point after the release, needed some; say when it was by"),
    ],
)
def test_a_mistake_is_one_line_with_a_way_out_on_the_command_line(tracks, settings, message):
    write(tracks=tracks)
    with pytest.raises(HarnessError, match="^[^\n]*$") as error:
        read_measured_trial(["trial.csv"], settings)
    assert message in str(error.value)
    assert "trials[0]" not in str(error.value)
    assert "'tracks:" not in str(error.value)


def test_the_true_position_is_the_inverse_of_what_the_camera_does():
    camera = Camera(
        origin_x=0.01,
        scale=1.2,
        tilt=-0.2,
        foreshortening=0.9,
        perspective_x=0.2,
        perspective_y=-0.1,
        distortion=0.2,
        centre_x=0.1,
    )
    places = np.random.default_rng(1).uniform(-0.7, 0.7, (200, 2))
    assert camera.true_position(camera.project(places)) == pytest.approx(places, abs=1e-12)


# ---- measured event tables: found where they may be, and read or refused in one line


HEAD = "quantity,index,measured,paper_numerical,unit\n"


def test_reads_rows_in_si(clip):
    rows = read_event_table(
        clip(f"# comment\n{HEAD}\nx1_extremum,2,0.52,0.53,s\ndrop,1,37,,cm\nwrap_angle_at_halt,1,,4.738,rad\n")
    )
    assert [(r.quantity, r.index, r.measured, r.paper_numerical, r.unit) for r in rows] == [
        ("x1_extremum", 2, 0.52, 0.53, "s"),
        ("drop", 1, 0.37, None, "m"),
        ("wrap_angle_at_halt", 1, None, 4.738, "rad"),
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f"# c\n{HEAD}halt,1,x,0.3,s\n", ":3: column measured: found 'x', needed a finite number or an empty cell"),
        (f"{HEAD}halt,1,inf,0.3,s\n", ":2: column measured: found 'inf', needed a finite number or an empty cell"),
        (f"{HEAD}halt,1,0.3,1e999,s\n", ":2: column paper_numerical: found '1e999', needed a finite number"),
        (f"{HEAD}halt,0,1,1,s\n", ":2: column index: found '0', needed a whole number from 1"),
        (f"{HEAD}halt,one,1,1,s\n", ":2: column index: found 'one', needed a whole number from 1"),
        (f"{HEAD}halt,1,1,1,furlong\n", ":2: column unit: found 'furlong', needed a unit of time, length or angle"),
        (f"{HEAD},1,1,1,s\n", ":2: column quantity: found nothing, needed a name"),
        (f"{HEAD}halt,1,1,s\n", ":2: found 4 cells, needed 5"),
        (f"{HEAD}halt,1,1,1,s\nhalt,1,1,1,s\n", ":3: column index: found halt 1 again (first on line 2)"),
        ("a,b\n1,2\n", ":1: found columns 'a,b', needed 'quantity,index,value,sigma,unit' or 'quantity,index,measured"),
        ("", ": found no rows, needed"),
        (HEAD, ":1: found no rows below the names of the columns, needed"),
        (HEAD.encode() + b"\xff\n", ":2: found 1 cells, needed 5"),
        (b"#" * 2_000_000, ": found more than 1 MiB"),
    ],
)
def test_a_faulty_table_gives_its_line(clip, text, message):
    path = clip(text)
    with pytest.raises(DataError) as caught:
        read_event_table(path)
    assert str(caught.value).startswith(f"{path}{message}")
    assert str(caught.value).isprintable()


def test_checksum_must_agree(clip):
    path = clip(f"{HEAD}halt,1,0.4,0.38,s\n")
    right = hashlib.sha256(path.read_bytes()).hexdigest()
    assert len(read_event_table(path, right.upper())) == 1
    with pytest.raises(DataError, match="found SHA-256 .*, needed 000000000000"):
        read_event_table(path, "0" * 64)


def test_a_missing_table_is_said(tmp_path):
    with pytest.raises(DataError, match="cannot be read"):
        read_event_table(tmp_path / "none.csv")


def test_looks_in_the_given_folder_then_the_variable_then_nearby(tmp_path, monkeypatch):
    work = tmp_path / "work"
    given, named, near = tmp_path / "given", tmp_path / "named", work / "data"
    for folder in (given, named, near):
        (folder / "paper").mkdir(parents=True)
        (folder / "paper" / "t.csv").touch()
    monkeypatch.chdir(work)
    monkeypatch.setenv("LOOPING_PENDULUM_DATA", str(named))
    find = lambda folders=None: find_data("paper/t.csv", folders)  # noqa: E731
    assert find(given) == find([tmp_path / "nowhere", given]) == given / "paper/t.csv"
    assert find(tmp_path / "nowhere") == find() == named / "paper/t.csv"
    monkeypatch.delenv("LOOPING_PENDULUM_DATA")
    assert find().resolve() == near / "paper/t.csv"
    (near / "paper" / "t.csv").unlink()
    assert find() is None


# ---- which files a study may have read: those below its own folder, the current one or a data folder, wherever its text points


STUDY = """
title: t
apparatus: {light: {mass: 10 g}, heavy: {mass: 100 g}, rod: {radius: 6 mm}}
trials:
  - {name: one, file: %s, release: {angle: 112 deg, free_length: 58 cm}}
"""


@pytest.fixture
def folders(tmp_path, monkeypatch):
    """A study's folder, the current folder, a data folder, and one that is none of them."""
    for name in ("study/trials", "here/data", "data", "secret"):
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / "secret" / "passwd").write_text("root:x:0:0\nsecret:hash\n")
    (tmp_path / "study" / "link.csv").symlink_to(tmp_path / "secret" / "passwd")
    (tmp_path / "study" / "folder").symlink_to(tmp_path / "secret")
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setenv("LOOPING_PENDULUM_DATA", str(tmp_path / "data"))
    return tmp_path


def written(folders, file):
    path = folders / "study" / "study.yaml"
    path.write_text(STUDY % file)
    return path


@pytest.mark.parametrize(
    "file",
    ["../secret/passwd", "../../../../../../../../etc/passwd", "/etc/passwd", "link.csv", "folder/passwd",
     "trials/../../secret/passwd", "'~/.ssh/../../etc/passwd/../../../../../etc/passwd'", "../study2/a.csv"],
)  # fmt: skip
def test_a_file_elsewhere_is_not_read_and_nothing_of_it_is_shown(folders, file, monkeypatch):
    """`file: ../../../../etc/passwd` was opened, and its last line stood in the error."""
    path = written(folders, file)
    opened = []
    monkeypatch.setattr("looping_pendulum.measured.tables.readers.read_bytes", lambda *a: opened.append(a) or b"")
    with pytest.raises(StudyError, match=r"^[^\n]*study.yaml:5: trials\[0\].file: found '[^\n]*needed a file below") as caught:
        study_io.load(path)
    assert opened == []
    assert "hash" not in str(caught.value)


def test_each_kind_of_file_of_a_trial_is_looked_at(folders):
    path = folders / "study" / "study.yaml"
    for more, key in (
        ("files: {light: a.csv, heavy: /etc/passwd}", "files.heavy"),
        ("file: a.csv, events: /etc/passwd", "events"),
    ):
        path.write_text((STUDY % "x").replace("file: x", more))
        with pytest.raises(StudyError, match=key):
            study_io.load(path)


def test_files_below_the_study_the_current_folder_and_the_data_folder_are_taken(folders):
    for place in ("study/a.csv", "study/trials/a.csv", "here/a.csv", "data/a.csv", "here/data/a.csv"):
        relative = os.path.relpath(folders / place, folders / "study")
        for file in (relative, str(folders / place)):
            assert study_io.load(written(folders, file)).trials[0].files[0][0] == file
