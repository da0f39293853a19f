"""The demonstration's data against the result they come from; when results on disk are used again: test_run_cache.py."""

import dataclasses
import json

import numpy as np
import pytest
from typer.testing import CliRunner

from looping_pendulum.cli import common as cli_common
from looping_pendulum.cli import main as cli
from looping_pendulum.compare import ComparisonResult
from looping_pendulum.pages.numbers import quantity
from looping_pendulum.runs.trajectory import RunStatus
from looping_pendulum.scenarios import load
from looping_pendulum.teaching import demo
from looping_pendulum.teaching.demo import COARSE_RATE, FINE_RATE, page_data
from tests.compare.conftest import quick_figures  # noqa: F401, a fixture
from tests.pages.small import LABELS, small_result, twin_result


def run_of(data, name):
    return next(run for run in data["runs"] if run["name"] == name)


@pytest.mark.long
def test_every_run_is_there_with_its_moments():
    result, data = small_result(), page_data(small_result())
    assert [run["name"] for run in data["runs"]] == ["reference", *LABELS]
    for engine in result.engines:
        events = {(event["kind"], event["t"]) for event in run_of(data, engine.label)["events"]}
        landmarks = engine.landmarks
        assert {t for kind, t in events if kind == "halt"} == ({landmarks.halting_time} - {None})
        assert {t for kind, t in events if kind == "slip"} == set(landmarks.slip_onsets)
        assert {t for kind, t in events if kind in ("stop", "halt")} == {stop.time for stop in landmarks.stops}
        assert ("broke" in {kind for kind, _ in events}) == (engine.label == "faulty:stretches")
    reference_events = dict(result.reference.events)
    assert ("slip", reference_events["slip_onset"]) in {(event["kind"], event["t"]) for event in data["runs"][0]["events"]}


def test_tracks_are_the_runs_own_samples():
    samples, data = small_result().samples, page_data(small_result())
    run, track = samples.aligned[0].run, run_of(data, LABELS[0])
    every = slice(None, None, 1000 // data["rate"])
    assert np.allclose(track["drop"], run.heavy_drop[every], rtol=0, atol=1e-6)  # written to a micrometre
    assert np.allclose(track["angle"], run.wrap_angle[every], rtol=0, atol=1e-5)
    assert np.allclose(track["distance"], samples.aligned[0].distance[every], rtol=0, atol=1e-8)
    # a rod without friction: the string pulls equally at both ends
    assert np.allclose(track["light_tension"], track["heavy_tension"], rtol=0, atol=0.005)
    assert max(track["light_tension"]) > 2
    reference = data["runs"][0]
    assert np.allclose(reference["heavy_tension"], samples.reference.heavy_tension[every], rtol=0, atol=1e-5)
    json.dumps(data, allow_nan=False)


def test_the_detail_has_the_distance_of_the_path():
    result, data = small_result(), page_data(small_result())
    engine = result.engines[1]
    assert (
        f"RMS distance of its path until the halt: {quantity(engine.metrics['rms_halt'], 'm')}."
        in run_of(data, LABELS[1])["detail"]
    )
    early = dataclasses.replace(engine, metrics=engine.metrics | {"rms_halt": None, "rms_1.0s": None})
    detail = page_data(dataclasses.replace(result, engines=(result.engines[0], early, *result.engines[2:])))["runs"][2][
        "detail"
    ]
    assert f"RMS distance of its path until 0.7 s: {quantity(engine.metrics['rms_0.7s'], 'm')}." in detail
    assert "RMS distance of its path" not in run_of(data, LABELS[3])["detail"], "it has no path"


def test_captions_say_who_supplies_friction_and_details_what_is_lacking():
    data = page_data(small_result())
    captions, details = ({run["name"]: run[part] for run in data["runs"]} for part in ("caption", "detail"))
    assert "No friction on the rod" in captions["mujoco:documented"]
    assert "Its heavy mass does not halt" in captions["mujoco:documented"]
    assert "Lacks the string's friction on the rod and sticking and slipping" in details["mujoco:documented"]
    assert "dof_frictionloss" in details["mujoco:capstan"]
    assert "dof_frictionloss" not in captions["mujoco:capstan"], "one plain line; what only experts read is folded"
    assert "Friction fed in by our adapter" in captions["mujoco:capstan"]
    assert "No physics is declared missing" in details["mujoco:capstan"]
    assert RunStatus.STRING_DRIFT.value in captions["faulty:stretches"]
    assert run_of(data, "faulty:absent")["gap"].startswith(RunStatus.MISSING.value)


@pytest.mark.parametrize("name", ["drop", "held", "atwood"])
def test_every_release_can_be_shown(name):
    scenario = load(name)
    result = twin_result(scenario)
    run = result.samples.aligned[0].run
    data = page_data(result)
    twin = run_of(data, run.label)
    assert data["string"] is (name != "drop")
    places = np.array(list(zip(twin["x"], twin["y"], strict=True))) if "x" in twin else None
    assert (places is None) is data["string"]
    if places is not None:
        assert np.allclose(places, run.light_position[:: 1000 // data["rate"]], rtol=0, atol=1e-6)
    assert scenario.title in demo.demo_page(result)


def test_a_long_run_is_drawn_more_coarsely():
    short = page_data(small_result())
    long = page_data(dataclasses.replace(small_result(), duration=10.0))
    assert (short["rate"], long["rate"]) == (FINE_RATE, COARSE_RATE)


def test_a_result_without_trajectories_is_refused():
    with pytest.raises(ValueError, match="make it again"):
        demo.demo_page(dataclasses.replace(small_result(), samples=None))


@pytest.mark.long
@pytest.mark.usefixtures("quick_figures")
def test_the_command_uses_what_compare_left(tmp_path, monkeypatch):
    arguments = ["two_to_one", "--engine", "mujoco:capstan", "--out", str(tmp_path)]
    done = CliRunner().invoke(cli.app, ["compare", *arguments])
    assert done.exit_code == 0, done.output
    ran = (tmp_path / "result.json").read_bytes()
    opened = []
    monkeypatch.setattr(demo.webbrowser, "open", lambda url: opened.append(url) or True)
    monkeypatch.setenv("BROWSER", "one")

    def no_run(*_, **__):
        raise AssertionError("an engine was run again")

    monkeypatch.setattr(cli_common, "run_and_compare", no_run)
    for extra in ([], ["--no-open"]):
        done = CliRunner().invoke(cli.app, ["demo", *arguments, *extra])
        assert done.exit_code == 0, done.output
    assert opened == [(tmp_path / "demo.html").resolve().as_uri()]
    assert (tmp_path / "result.json").read_bytes() == ran
    assert "mujoco:capstan" in (tmp_path / "demo.html").read_text()
    run = small_result().samples.reference
    marks = tmp_path / "mine.csv"
    rows = np.column_stack([run.t, run.light_position])[::4].tolist()
    marks.write_text("t,light_x,light_y\n" + "".join(",".join(map(repr, row)) + "\n" for row in rows))
    for extra in (["--marks", str(marks)], []):  # without it, the trial that the results are of stays
        done = CliRunner().invoke(cli.app, ["demo", *arguments, "--no-open", *extra])
        assert done.exit_code == 0, done.output
        assert '"trial":{"name":"mine"' in (tmp_path / "demo.html").read_text()
        trial = ComparisonResult.from_json((tmp_path / "result.json").read_text()).trial
        assert trial.tracks[0].reference.rms < 1e-6, "the reference's own places, to the digits of the files"
    for arguments_of_another in (
        [*arguments, "--again"],
        ["ten_to_one", *arguments[1:]],
        [*arguments, "--profile", "accurate"],
    ):
        done = CliRunner().invoke(cli.app, ["demo", *arguments_of_another, "--no-open"])
        assert isinstance(done.exception, AssertionError), "other results were taken for these"


def test_without_a_screen_it_says_where_the_page_is(monkeypatch, tmp_path):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(demo.sys, "platform", "linux")
    assert demo.show(tmp_path / "demo.html") is False
