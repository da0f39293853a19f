"""Files that the live page reads and writes, in a real browser: trials, a fit of one, scenarios, pictures and tables."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

from looping_pendulum.errors import ScenarioError
from looping_pendulum.live.write import render
from looping_pendulum.measured.study import Estimate
from looping_pendulum.measured.study_io import load as load_study
from looping_pendulum.measured.tables import readers
from looping_pendulum.reference_ode.solve import solve, solve_at
from looping_pendulum.scenarios import load, shipped
from looping_pendulum.teaching.example_folder import write_example
from tests.measured.test_clock import motion
from tests.pages.conftest import until
from tests.pages.live_page import downloaded, preset, settled, type_into, value

FITTED = re.compile(r"(.+): (-?[\d.]+) ± ([\d.]+)")
"""A line of what a fit found: name, value and standard error."""


@pytest.fixture
def example(tmp_path):
    return next(path for path in write_example(tmp_path / "example") if path.name == "first.csv")


def refusal(page):
    """Wait until the page refuses a trial, and return what it says."""
    until(page, "document.getElementById('trial-error').textContent !== ''")
    return page.inner_text("#trial-error")


def drop_file(page, name, content):
    """Let a file fall on the page."""
    page.evaluate(
        """([name, content]) => {
          const data = new DataTransfer();
          data.items.add(new File([content], name));
          document.body.dispatchEvent(new DragEvent("drop", { dataTransfer: data, bubbles: true, cancelable: true }));
        }""",
        [name, content],
    )


def test_a_trial_is_dropped_and_drawn_over_the_motion(page, example):
    drop_file(page, "first.csv", example.read_text(encoding="utf-8"))
    until(page, "live.trial.trial !== null")
    settled(page)
    message = page.inner_text("#trial-message")
    assert message.startswith("first.csv: used light_x 227, light_y 227, heavy_x 231, heavy_y 231; ")
    assert page.evaluate("live.trial.points('light').length") == 227
    assert page.is_visible("#residuals")
    distance = float(re.search(r"Typical distance from the run: ([\d.]+) mm", message)[1])
    # With the angle of the trial, which its study file states, the points are nearer
    for name, number in (("release_angle", 112), ("free_length", 58)):
        type_into(page, f"#field-{name}", str(number))
    settled(page)
    nearer = float(re.search(r"run: ([\d.]+) mm", page.inner_text("#trial-message"))[1])
    assert nearer != distance
    page.click("#trial-remove")
    settled(page)
    assert not page.is_visible("#residuals")


@pytest.mark.long
def test_a_trial_with_german_commas_named_tracks_and_centimetres(page):
    rows = "".join(f"{0.01 * i:.2f};{55 - i};{-20 - i}\n".replace(".", ",") for i in range(20))
    page.set_input_files(
        "#trial-file", {"name": "versuch.csv", "mimeType": "text/csv", "buffer": f";Kugel;\nt;x;y\n{rows}".encode()}
    )
    assert refusal(page).startswith("versuch.csv: found 'Kugel', needed to know which mass each track is")
    page.select_option("#trial-light", label="Kugel")
    assert "found light_x = 55 m, needed at most 20 m" in page.inner_text("#trial-error")
    page.select_option("#trial-length", "cm")
    settled(page)
    assert page.inner_text("#trial-error") == ""
    assert page.evaluate("live.trial.points('light')[0]") == pytest.approx([0, 0.55, -0.2])
    page.check("#trial-mirror")
    assert page.evaluate("live.trial.points('light')[0]") == pytest.approx([0, -0.55, -0.2])
    type_into(page, "#trial-release", "0,05")
    assert page.evaluate("live.trial.points('light')[0][0]") == pytest.approx(-0.05)


@pytest.mark.long
def test_a_clock_that_begins_elsewhere_is_told_and_stands_in_the_study(page):
    t = np.arange(60) / 120
    points = motion(t)[:, :2] + 2e-4 * np.random.default_rng(1).standard_normal((len(t), 2))
    rows = "".join(f"{time + 5:.4f},{x:.5f},{y:.5f}\n" for time, (x, y) in zip(t, points, strict=True))
    drop_file(page, "film.csv", f"t [s],light_x [m],light_y [m]\n{rows}")
    until(page, "live.trial.trial !== null")
    settled(page)
    assert page.evaluate("live.trial.points('light')[0]") == pytest.approx([0, *points[0]], abs=1e-4)
    assert "the first time, 5 s, was taken as 0" in page.inner_text("#trial-message")
    assert "clock_offset: free from -5 s" in page.evaluate("live.fit.study()")


def test_an_export_of_trackers_needs_its_tracks_only(page):
    rows = "".join(f"{0.01 * i:.2f},{-0.5 + 0.01 * i:.3f},-.2,{0.01 * i:.2f},.006,{-0.05 - i / 1000:.3f},\n" for i in range(20))
    drop_file(page, "tracker.csv", f",mass A,,,mass B,,\nt,x,y,t,x,y,\n{rows}")
    assert "found 'mass A', 'mass B', needed to know" in refusal(page)
    page.select_option("#trial-light", label="mass A")
    page.select_option("#trial-heavy", label="mass B")
    settled(page)
    assert page.inner_text("#trial-error") == ""
    assert page.inner_text("#trial-message").startswith("tracker.csv: used light_x 20, light_y 20, heavy_x 20, heavy_y 20; ")


def test_a_bad_file_cannot_write_into_the_page(page):
    drop_file(page, "bad.csv", "t,light_x,light_y\n0,1,2\n.01,<img src=x onerror=alert(1)>,3\n")
    assert refusal(page).startswith("bad.csv:3: column 'light_x': found '<img src=x onerror=alert(1)>'")
    assert page.locator("#trial-error img").count() == 0


def test_a_file_that_is_no_plain_table_is_sent_to_look(opened):
    page = opened.page
    for name, content in (
        ("trial.trk", b"<?xml version='1.0'?>"),
        ("sheet.xlsx", b"PK\x03\x04"),
        ("words.txt", b"not a table"),
    ):
        page.set_input_files("#trial-file", {"name": name, "mimeType": "text/csv", "buffer": content})
        assert refusal(page).endswith(f"use looping-pendulum look '{name}' --write plain.csv, which writes a plain table")
        assert page.evaluate("live.trial.trial") is None
        page.click("#trial-remove")
    assert opened.complaints == []


GERMAN = "Zeit in s;Masse A x in cm;Masse A y in cm;Masse B x in cm;<img src=x>\n" + "".join(
    f"{i / 60:.4f};{-30 + i};{-10 - i};0,5;{-0.2 - i / 200:.3f}\n".replace(".", ",") for i in range(30)
)
"""A table that the page cannot tell by itself: which mass is which, and what the last column is."""


def test_a_table_of_its_own_kind_is_read_by_saying_what_its_columns_are(opened):
    page = opened.page
    drop_file(page, "versuch.csv", GERMAN)
    until(page, "!document.getElementById('trial-columns').hidden")
    assert page.inner_text("#trial-error") == ""
    choices = page.locator("#trial-columns-table select")
    assert choices.evaluate_all("(all) => all.map(({ value }) => value)") == ["t", "", "", "", ""]
    assert page.locator("#trial-columns-table img").count() == 0, "a heading cannot write into the page"
    assert page.is_disabled("#trial-columns-use"), "a time alone is no trial"
    for place, role in enumerate(["heavy_x", "heavy_y", "light_x", "light_y"], start=1):
        choices.nth(place).select_option(role)
    assert page.is_enabled("#trial-columns-use")
    page.select_option("#language", "de")
    assert choices.nth(1).input_value() == "heavy_x"
    assert "versuch.csv ist eine Tabelle eigener Art" in page.inner_text("#trial-columns-ask")
    page.select_option("#language", "en")
    page.click("#trial-columns-use")
    until(page, "live.trial.trial !== null")
    assert page.is_hidden("#trial-columns")
    read = page.evaluate("Object.fromEntries(live.trial.trial.channels.map(({ name, value }) => [name, value[3]]))")
    # The last column states no unit
    assert read == pytest.approx({"heavy_x": -0.27, "heavy_y": -0.13, "light_x": 0.005, "light_y": -0.215}, abs=1e-9)
    saved = downloaded(page, "#trial-plain").decode().splitlines()
    assert saved[0] == "t [s],heavy_x [m],heavy_y [m],light_x [m],light_y [m]"
    assert len(saved) == 1 + 30
    page.click("#trial-remove")
    drop_file(page, "noch einer.csv", GERMAN)
    until(page, "!document.getElementById('trial-columns').hidden")
    remembered = choices.evaluate_all("(all) => all.map(({ value }) => value)")
    assert remembered == ["t", "heavy_x", "heavy_y", "light_x", "light_y"]
    page.evaluate("localStorage.clear()")
    assert opened.complaints == []


@pytest.mark.long
def test_files_of_the_page(page, tmp_path):
    assert downloaded(page, "#save-scenario").decode() == page.evaluate("live.keeping.scenario()")
    for name in shipped():
        preset(page, name)
        file = tmp_path / "live.scenario.yaml"
        file.write_text(page.evaluate("live.keeping.scenario()"), encoding="utf-8")
        expected, written = load(name).parameters, load(str(file)).parameters
        assert written.release is expected.release
        for key, number in vars(expected.values()).items():
            if isinstance(number, float):
                assert getattr(written.values(), key) == pytest.approx(number, rel=1e-9), (name, key)
    preset(page, "ten_to_one")
    lines = downloaded(page, "#save-numbers").decode().splitlines()
    assert lines[0].startswith("t [s],light_x [m],light_y [m],")
    reference = solve(load("ten_to_one").parameters).sample([0.3]).light_position[0]
    assert [float(cell) for cell in lines[301].split(",")[1:3]] == pytest.approx(list(reference), abs=1e-7)
    assert downloaded(page, "#save-picture").startswith(b"\x89PNG")
    assert page.evaluate("live.keeping.words()")[:2] == ["t = 0.000 s", "Angle of the string from straight up 113.08 °"]


GOOD = "t,light_x,light_y\n" + "".join(f"{0.01 * i:.2f},{-0.5 + 0.01 * i:.3f},{-0.2 - 0.01 * i:.3f}\n" for i in range(20))


@pytest.mark.long
@pytest.mark.parametrize("bad", ["", "t,light_x,light_y\n0,1,2\n.01,x,3\n", "not a table"])
def test_a_bad_file_keeps_the_good_trial(page, bad):
    drop_file(page, "good.csv", GOOD)
    until(page, "live.trial.trial !== null")
    type_into(page, "#trial-release", "0.02")
    settled(page)
    points, message = page.evaluate("live.trial.points('light')"), page.inner_text("#trial-message")
    drop_file(page, "bad.csv", bad)
    until(page, "document.getElementById('trial-error').textContent !== ''")
    settled(page)
    error = page.inner_text("#trial-error")
    assert error.startswith("bad.csv")
    assert error.endswith("good.csv stays.")
    assert page.evaluate("live.trial.points('light')") == points
    assert page.inner_text("#trial-message") == message
    page.select_option("#language", "de")
    settled(page)
    assert page.inner_text("#trial-error").endswith("good.csv bleibt.")
    page.select_option("#language", "en")
    drop_file(page, "good.csv", GOOD)
    until(page, "document.getElementById('trial-error').textContent === ''")


@pytest.mark.long
def test_a_message_stands_beside_the_field_that_helps(page):
    drop_file(page, "cm.csv", GOOD.replace("-0.", "-10"))
    until(page, "document.getElementById('trial-error').textContent !== ''")
    assert (
        page.evaluate("document.getElementById('trial-error').previousElementSibling.querySelector('select').id")
        == "trial-length"
    )
    assert page.locator("[aria-invalid]").evaluate_all("(all) => all.map(({ id }) => id)") == ["trial-length"]
    page.select_option("#trial-length", "mm")
    settled(page)
    assert page.inner_text("#trial-error") == ""
    assert page.locator("[aria-invalid]").count() == 0


@pytest.mark.parametrize(("slower", "words"), [(8, "8 times"), (1, ""), (0.25, "1/4 times")])
def test_a_wrong_frame_rate_is_named_as_look_names_it(page, slower, words):
    """As `looping-pendulum look`: times that are 8 times what the declared apparatus allows, and frame_rate: 240 Hz."""
    t = np.arange(0, 1.0, 1 / 240)
    places = solve(load("ten_to_one").parameters).sample(t).light_position
    rows = "".join(f"{slower * time:.6f},{x:.5f},{y:.5f}\n" for time, (x, y) in zip(t, places, strict=True))
    drop_file(page, "film.csv", f"t,light_x,light_y\n{rows}")
    until(page, "live.trial.trial !== null")
    settled(page)
    message = page.inner_text("#trial-faults")
    if not words:
        assert message == ""
        return
    assert message == (
        f"The times are {words} what the settings allow, as of a wrong frame rate: the true frames per second would be 240."
    )
    type_into(page, "#trial-rate", "240")
    settled(page)
    assert page.inner_text("#trial-faults") == ""
    assert "Typical distance from the run: 0.0 mm" in page.inner_text("#trial-message")


@pytest.mark.long
@pytest.mark.parametrize("language", ["en", "de"])
def test_the_table_of_the_run_is_read_as_a_trial(page, tmp_path, language):
    """In German spreadsheets, cells are separated by semicolons, as the comma is the decimal sign."""
    page.select_option("#language", language)
    with page.expect_download() as download:
        page.click("#save-numbers")
    page.select_option("#language", "en")
    file = tmp_path / "run.csv"
    file.write_bytes(Path(download.value.path()).read_bytes())
    assert (";" in file.read_text(encoding="utf-8")) is (language == "de")
    channels = {c.name: c for c in readers.read(file).channels}
    reference = solve(load("ten_to_one").parameters).sample([0.3])
    assert channels["light_x"].value[300] == pytest.approx(reference.light_position[0, 0], abs=1e-7)
    assert channels["heavy_y"].value[300] == pytest.approx(reference.heavy_position[0, 1], abs=1e-7)


@pytest.mark.accurate  # daily, the other files that the page writes
def test_a_film_of_the_motion(page):
    page.click("[data-slow='1']")
    with page.expect_download() as download:
        page.click("#save-film")
        until(page, "live.player.time > 0.2")
        page.click("#play")
    assert Path(download.value.path()).read_bytes().startswith(b"\x1aE\xdf\xa3")  # how every WebM begins
    assert page.evaluate("live.keeping.stopFilm") is None


@pytest.mark.accurate  # daily, the shipped scenarios
def test_a_scenario_of_ones_own_comes_first(visit, tmp_path):
    file = tmp_path / "mine.scenario.yaml"
    source = (Path(__file__).parents[2] / "looping_pendulum" / "scenarios" / "two_to_one.yaml").read_text(encoding="utf-8")
    file.write_text(
        source.replace("67.454 deg", "3 deg").replace("title: Two to one", "title: '</script><b>mine</b>'"), encoding="utf-8"
    )
    opened = visit(render(load(str(file))))
    assert opened.page.input_value("#preset") == load(str(file)).name
    assert value(opened.page, "release_angle") == 3  # below the slider's own range, which is widened
    assert "</script><b>mine</b>" in opened.page.locator("#preset option").all_inner_texts()
    assert opened.complaints == []


def made_up(page, tmp_path, parameters, scale=1.0, errors=0.0, tilt=0.0):
    """Load a trial of other parameters than those that are set, filmed at another scale by a camera that is turned."""
    t = np.arange(0, 0.7, 1 / 120)
    run = solve_at(parameters, t)
    noise = np.random.default_rng(3)
    turned = np.array([[math.cos(tilt), math.sin(tilt)], [-math.sin(tilt), math.cos(tilt)]])
    points = scale * np.hstack([run.light_position @ turned, run.heavy_position @ turned])
    points += 1e-3 * noise.standard_normal(points.shape)
    names = ["light_x", "light_y", "heavy_x", "heavy_y"]
    columns, table = ["t", *names], np.column_stack([t, points])
    if errors:
        columns += [f"{name}_error" for name in names]
        table = np.column_stack([table, np.full(points.shape, errors)])
    file = tmp_path / "trial.csv"
    np.savetxt(file, table, delimiter=",", header=",".join(columns), comments="", fmt="%.6f")
    page.set_input_files("#trial-file", file)
    until(page, "live.trial.trial !== null")
    page.click("#trial-fit")
    until(page, "!document.getElementById('trial-fit').disabled")
    settled(page)
    return page.inner_text("#fit-message")


def test_what_is_stated_and_contradicts_the_trial_is_named(page, tmp_path):
    filmed = load("ten_to_one").parameters
    assert "contradicts" not in made_up(page, tmp_path, filmed)
    preset(page, "ten_to_one")
    said = made_up(page, tmp_path, filmed.replace(heavy_mass=0.6 * filmed.heavy_mass))
    assert "The trial contradicts what is stated: " in said
    assert re.search(r"Heavy mass M2 [\d.]+ ± [\d.]+ g in place of 100\.00 ± 0\.50 g", said), said
    preset(page, "ten_to_one")
    page.evaluate("live.trial.remove()")
    said = made_up(page, tmp_path, filmed, scale=1.03)
    assert re.search(r"Lengths in your file, per true length 1\.0[23]\d* ± [\d.]+ in place of 1\.000\d* ± 0\.005\d*", said)


@pytest.mark.parametrize(
    ("filmed", "label", "true", "known", "stated"),
    [
        ({"scale": 1.01}, "Lengths in your file, per true length", 1.01, 0.015, "scale: 1 +/- 0.005"),
        # Without it the errors of rod and axis were too small
        ({"tilt": math.radians(0.6)}, "Picture turned by", 0.6, 0.5, "tilt: 0 deg +/- 0.5 deg"),
    ],
    ids=["scale", "tilt"],
)
def test_what_the_camera_does_is_fitted_and_the_points_lie_on_the_run(page, tmp_path, filmed, label, true, known, stated):
    said = made_up(page, tmp_path, load("ten_to_one").parameters, **filmed)
    assert "What is left looks like noise." in said
    fitted = {name: (float(x), float(error)) for name, x, error in FITTED.findall(page.inner_text("#fit-table"))}
    found, error = fitted[label]
    assert abs(found - true) < 3 * error < known
    # A millimetre of noise in each coordinate
    assert page.evaluate("live.fit.fitted.after") == pytest.approx(1.18e-3, rel=0.2)
    # As the study states it, which takes the file's lengths
    assert stated in page.evaluate("live.fit.study()")


def test_a_fit_that_leaves_a_pattern_says_where(page, tmp_path):
    filmed = load("ten_to_one").parameters.replace(side_force=6e-3)
    said = made_up(page, tmp_path, filmed)
    assert re.search(r"\(M[12] [\w ]+, while the string (does not )?slides?, most of all at 0\.\d\d s\)", said)
    # Where the table states errors as large as this, nothing is left
    preset(page, "ten_to_one")
    page.evaluate("live.trial.remove()")
    assert "What is left looks like noise." in made_up(page, tmp_path, filmed, errors=0.05)


@pytest.mark.long
def test_a_fit_sets_the_sliders_says_what_is_left_and_writes_the_study(page, example):
    page.set_input_files("#trial-file", example)
    until(page, "live.trial.trial !== null")
    page.click("#trial-fit")
    until(page, "document.getElementById('fit-table').children.length > 0")
    settled(page)
    assert "looping-pendulum identify study.yaml" in page.inner_text("#fit-message")
    assert "this page sends nothing" in page.inner_text("#trial")
    # Its points were made with an effect that the page does not have (looping_pendulum/teaching/example/study.yaml)
    assert "What is left is not noise" in page.inner_text("#fit-message")
    before, after = map(float, re.findall(r"([\d.]+) mm (?:before|after)", page.inner_text("#fit-message")))
    assert after < before / 5
    # One definition: what stands beside the trial is that of the fit
    assert f"Typical distance from the run: {after} mm" in page.inner_text("#trial-message")
    shown = {label: (float(x), float(error)) for label, x, error in FITTED.findall(page.inner_text("#fit-table"))}
    angle = shown["Angle of the string from straight up"]
    assert value(page, "release_angle") == angle[0]
    assert angle[0] == pytest.approx(112, abs=1.5)  # as the study states it, within three of its errors
    with page.expect_download() as download:
        page.click("#trial-study")
    assert download.value.suggested_filename == "study.yaml"
    file = example.with_name("study.yaml")
    download.value.save_as(file)
    study = load_study(file)
    assert study.trials[0].estimates["release_angle"].value == pytest.approx(math.radians(angle[0]))
    # The fit has moved the sliders of the masses; the study says what was measured
    assert value(page, "light_mass") == shown["Light mass M1"][0] != 10
    assert study.apparatus["light_mass"] == Estimate(value=0.01, sigma=5e-5)
    # That the study's calibration finds these numbers is held in tests/live/test_fit_against_identify.py
    page.click("#undo")
    settled(page)
    assert value(page, "release_angle") == 113.08
    page.click("#redo")
    settled(page)
    page.click("#trial-fit")  # again, from what it found: what was measured has not moved with it
    until(page, "document.getElementById('fit-table').children.length > 0 && !document.getElementById('trial-fit').disabled")
    again = {label: float(x) for label, x, _ in FITTED.findall(page.inner_text("#fit-table"))}
    assert again["Light mass M1"] == pytest.approx(shown["Light mass M1"][0], abs=0.2 * shown["Light mass M1"][1])


def test_a_scenario_with_an_effect_that_the_page_lacks_is_refused_without_runs_of_it(tmp_path):
    file = tmp_path / "thick.yaml"
    source = (Path(__file__).parents[2] / "looping_pendulum" / "scenarios" / "two_to_one.yaml").read_text(encoding="utf-8")
    file.write_text(source + "effects: {string_thickness: 1 mm}\n", encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"^thick: effects: found string_thickness, which the live .*demo"):
        render(load(str(file)))
