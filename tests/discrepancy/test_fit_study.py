"""A study from a script is fitted and identified as that of a file; the fit has what a user of lmfit looks for."""

import json
import sys

import numpy as np
import pandas
import pytest

import looping_pendulum as lp
from looping_pendulum.discrepancy.result import dump
from looping_pendulum.errors import MissingPackageError, ParameterError
from looping_pendulum.measured import study_io
from looping_pendulum.notebook import study_fit
from looping_pendulum.teaching.example_folder import write_example

COLUMNS = ["t [s]", "light_x [m]", "light_y [m]", "heavy_x [m]", "heavy_y [m]"]
pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def frames(tmp_path_factory):
    folder = tmp_path_factory.mktemp("files")
    write_example(folder)
    paths = {name: folder / "trials" / f"{name}.csv" for name in ("first", "second")}
    return {name: pandas.read_csv(p, skiprows=3, usecols=range(5), names=COLUMNS) for name, p in paths.items()}


@pytest.fixture(scope="module")
def study(frames):
    """The example's study."""
    release = {"free_length": (0.58, 1e-3), "hanging_length": "5 cm +/- 1 mm"}
    first = lp.Trial(
        name="first",
        points=frames["first"],
        heavy_mass="100 g +/- 0.5 g",
        release_angle="112 deg +/- 0.5 deg",
        **release,
    )
    second = lp.Trial(
        name="second",
        points={name: frames["second"][name].to_numpy() for name in COLUMNS},
        held_out=True,
        heavy_mass=(0.06, 3e-4),
        release_angle="104 deg +/- 0.5 deg",
        **release,
    )
    declared = {"capstan": "free", "light_drag": "free", "heavy_drag": 1e-3, "string_drag": 1e-3, "gravity": 9.81}
    return lp.Study(trials=[first, second], effects=declared, light_mass=(0.01, 5e-5), rod_radius="6.25 mm +/- 1 %")


@pytest.fixture(scope="module")
def identified(study):
    return lp.identify(study)


@pytest.fixture(scope="module")
def fitted(study):
    return lp.fit(study)


def test_the_verdict_is_that_of_the_same_study_in_files(study, identified, frames, tmp_path):
    (tmp_path / "study.yaml").write_text(study_io.dump(study), encoding="utf-8")
    for name, frame in frames.items():
        frame.to_csv(tmp_path / f"{name}.csv", index=False)
    assert dump(lp.identify(lp.load_study(tmp_path / "study.yaml"))) == dump(identified)
    assert json.loads(dump(identified))["verdict"] == "identified"
    assert "side_force" in repr(identified)


def test_a_fit_is_that_of_the_declared_model(fitted, identified):
    assert fitted.converged
    for parameter in identified.before.parameters:
        name = parameter.parameter.name
        assert abs(fitted.values[name] - parameter.value) < 0.01 * fitted.errors[name]
        assert fitted.errors[name] == pytest.approx(parameter.error, rel=0.01)
        assert f"\n{name} " in repr(fitted)
    # A side force is declared by nobody: it is taken for errors that last
    assert fitted.correlated_noise
    assert "Errors that last, or what the model lacks: light mass" in repr(fitted)
    page = study_fit(fitted)
    assert page.count("<tr>") == 1 + len(fitted.values)
    assert "Errors that last, or what the model lacks: light mass" in page


def test_a_fit_has_correlations_intervals_and_residuals(fitted):
    pair = fitted.correlations["first.heavy_mass"]
    assert pair["first.heavy_mass"] == pytest.approx(1.0)
    assert pair["second.heavy_mass"] == fitted.correlations["second.heavy_mass"]["first.heavy_mass"]
    value, error = fitted.values["light_drag"], fitted.errors["light_drag"]
    low, high = fitted.interval("light_drag", 0.6827)
    assert (value - low, high - value) == pytest.approx((error, error), rel=0.1)
    assert fitted.interval("light_drag")[0] < low
    with pytest.raises(ParameterError, match="found 'light_drg', needed one of: .*; did you mean 'light_drag'"):
        fitted.interval("light_drg")
    frame = fitted.to_frame("residuals")
    of_x = frame[(frame.trial == "first") & (frame.channel == "light_x")]
    assert np.array_equal(of_x.residual, fitted.residuals["first"]["light_x"])
    assert np.array_equal(of_x.residual, of_x.measured - of_x.predicted)


def test_tables_are_frames_and_figures_are_of_matplotlib(identified, fitted, monkeypatch):
    assert list(identified.to_frame("trials").trial) == ["first", "second"]
    assert identified.to_frame("effects").name[0] == "side_force"
    assert {"residual_before", "residual_after"} <= set(identified.to_frame("residuals"))
    assert list(lp.figures(fitted)) == ["trial-first", "trial-second"]
    assert lp.figures(identified)["motion"].axes
    monkeypatch.setitem(sys.modules, "pandas", None)
    for result in (identified, fitted):
        with pytest.raises(MissingPackageError, match="to_frame: pandas is not installed; .*pip install.*pandas") as caught:
            result.to_frame()
        assert "\n" not in str(caught.value)
