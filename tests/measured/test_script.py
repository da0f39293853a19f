"""A study that a script makes: from arrays, DataFrames or observations the same as from a file, with errors of one line."""

import inspect

import numpy as np
import pandas
import pytest

import looping_pendulum as lp
from looping_pendulum.measured.keywords import OF_STUDY, OF_TRIAL, StudyError
from looping_pendulum.measured.observations import DataError
from looping_pendulum.measured.study import Study, Trial, read_files
from looping_pendulum.measured.study_io import dump, load_text
from looping_pendulum.measured.tables.readers import read

TABLE = """t [s],light_x [cm],light_y [cm],heavy_x [cm],heavy_y [cm]
0.0,-54.01,-21.12,0.62,-5.06
0.004,-54.03,-21.24,,
0.008,-54.02,-21.27,0.75,-5.01
0.012,-53.92,-21.05,0.74,-4.86
"""
YAML = """title: two
apparatus: {light: {mass: 10 g +/- 0.1 g}, rod: {radius: 6.25 mm}}
effects: {gravity: 9.81 m/s^2, capstan: free, light_drag: free from 1e-3 kg/m}
trials:
- {file: trial_1.csv, name: trial_1, heavy: {mass: 100 g}, release: {angle: 112 deg, free_length: 58 cm +/- 1 mm}}
- {file: swing.csv, held_out: true, frame_rate: 240 Hz, release: {kind: held, free_length: 58 cm +/- 1 mm}}
"""


def study(points, /, **changes):
    first = {"points": points, "heavy_mass": 0.1, "release_angle": "112 deg", "free_length": (0.58, 1e-3)}
    swing = {"name": "swing", "held_out": True, "frame_rate": 240.0, "release": "held", "free_length": "58 cm +/- 1 mm"}
    return lp.Study(
        title="two",
        light_mass="10 g +/- 0.1 g",
        rod_radius=np.float64(0.00625),
        effects={"gravity": 9.81, "capstan": "free", "light_drag": "free from 1e-3 kg/m"},
        trials=[lp.Trial(**first | changes), lp.Trial(points=points, **swing)],
    )


def columns(frame):
    return {name: frame[name].to_numpy() for name in frame}


@pytest.fixture
def frame(tmp_path):
    (tmp_path / "trial_1.csv").write_text(TABLE, encoding="utf-8")
    return pandas.read_csv(tmp_path / "trial_1.csv")


def test_arrays_and_frames_and_yaml_give_one_study(frame, tmp_path):
    by_frame, by_arrays, by_yaml = study(frame), study(columns(frame)), load_text(YAML, "two", tmp_path)
    assert by_frame == by_arrays == study(frame.set_index("t [s]")) == study(frame.to_records(index=False))
    assert dump(by_frame) == dump(by_yaml)
    observations = lp.Trial(points=read(tmp_path / "trial_1.csv", name="trial_1"))
    expected = read_files(tmp_path, by_yaml.trials[0])
    assert len(expected.channels) == 4
    for trial in (by_frame.trials[0], by_arrays.trials[0], observations):
        for found, channel in zip(read_files(tmp_path, trial).channels, expected.channels, strict=True):
            assert (found.name, found.last_digit, found.time_error) == (channel.name, channel.last_digit, channel.time_error)
            assert np.array_equal([found.t, found.value], [channel.t, channel.value])


def test_signatures_name_every_keyword():
    """Type checkers and completion read them; what is understood is said by the keys of the file."""
    for model, places in ((Trial, OF_TRIAL), (Study, OF_STUDY)):
        declared = set(inspect.signature(model).parameters)
        keys = {"file": "a.csv"} if model is Trial else {"trials": [lp.Trial(file="a.csv")]}
        message = str(pytest.raises(StudyError, model, nonsense=1, **keys).value)
        known = set(message.partition("needed one of: ")[2].split(", ")) - {"name"}
        assert declared - {"name", "points"} == known
        assert places.keys() <= declared


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"heavy_mas": 1}, "trial: found an unknown keyword 'heavy_mas'; did you mean 'heavy_mass'?"),
        ({"heavy_mass": "10 cm"}, "trial: heavy_mass: expected a mass, got '10 cm'; write for example '100 g'"),
        ({"heavy_mass": -1}, "trial: heavy_mass: expected a mass above 0, got '-1.0 kg'"),
        ({"free_length": (0.58, -1e-3)}, "trial: free_length: found a standard error of '-0.001 m', needed one above 0"),
        (
            {"heavy_mass": None},
            "study: trials[0]: trial_1: a looping release needed 'heavy_mass'; write for example",
        ),
        ({"name": "swing"}, "study: trials[1].name: found a second trial 'swing'"),
        ({"file": "a.csv"}, "trial: file: found a file beside points, needed one of them"),
        ({"points": [1, 2]}, "trial: points: found an object of the type list, needed a DataFrame, arrays by their names"),
        (
            {"points": {"t": [0, 1], "light_x": [1]}},
            "trial: points: found the shapes t (2,), light_x (1,), needed columns of one",
        ),
        ({"points": None}, "trial: found neither points nor a file, needed one of them"),
        ({"points": {}}, "trial: points: found the shapes no columns, needed columns"),
    ],
)
def test_errors_are_one_line_with_the_keyword(frame, changes, message):
    with pytest.raises(StudyError) as caught:
        study(frame, **changes)
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


def test_a_missing_column_and_a_wrong_unit_are_named(frame, tmp_path):
    for table, message in (
        (frame.drop(columns="t [s]"), "points of 'trial_1': .*needed the camera.s frame rate; give .frame_rate"),
        (
            frame.rename(columns={"light_x [cm]": "light_x [kg]"}),
            "points of 'trial_1':1: column light_x .kg.: found the unit",
        ),
    ):
        with pytest.raises(DataError, match=message):
            read_files(tmp_path, study(table).trials[0])
    observations = read(tmp_path / "trial_1.csv")
    with pytest.raises(StudyError, match="units: found it beside observations, which are read already"):
        lp.Trial(points=observations, units={"length": "cm"})
