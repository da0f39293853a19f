"""Files that the live page reads and writes, in a real browser: trials, a fit of one, scenarios, pictures and tables."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest

from looping_pendulum.discrepancy.data.study_io import load_text
from looping_pendulum.errors import ScenarioError
from looping_pendulum.live.write import render
from looping_pendulum.reference_ode.solve import solve
from looping_pendulum.scenarios import load, shipped
from looping_pendulum.teaching.example_folder import write_example
from tests.pages.conftest import until
from tests.pages.live_page import preset, settled, value


@pytest.fixture
def example(tmp_path):
    return next(path for path in write_example(tmp_path / "example") if path.name == "first.csv")


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


def test_a_trial_is_dropped_and_drawn_over_the_motion(opened, example):
    page = opened.page
    drop_file(page, "first.csv", example.read_text(encoding="utf-8"))
    until(page, "live.trial.trial !== null")
    settled(page)
    message = page.inner_text("#trial-message")
    assert message.startswith("first.csv: used light_x 227, light_y 227, heavy_x 231, heavy_y 231; ")
    assert page.evaluate("live.trial.points('light').length") == 227
    assert page.is_visible("#residuals")
    distance = float(re.search(r"Typical distance from the run: ([\d.]+) cm", message)[1])
    # With the angle of the trial, which its study file states, the points are nearer
    for name, number in (("release_angle", 112), ("free_length", 58)):
        page.fill(f"#field-{name}", str(number))
        page.keyboard.press("Tab")
    settled(page)
    nearer = float(re.search(r"run: ([\d.]+) cm", page.inner_text("#trial-message"))[1])
    assert nearer != distance
    page.click("#trial-remove")
    settled(page)
    assert not page.is_visible("#residuals")


def test_a_trial_with_german_commas_named_tracks_and_centimetres(opened):
    page = opened.page
    rows = "".join(f"{0.01 * i:.2f};{55 - i};{-20 - i}\n".replace(".", ",") for i in range(20))
    page.set_input_files(
        "#trial-file", {"name": "versuch.csv", "mimeType": "text/csv", "buffer": f";Kugel;\nt;x;y\n{rows}".encode()}
    )
    until(page, "document.getElementById('trial-error').textContent !== ''")
    assert page.inner_text("#trial-error") == (
        "versuch.csv: found the tracks 'Kugel', needed to know which mass each is; say so by 'tracks: {light: Kugel}'"
    )
    page.select_option("#trial-light", label="Kugel")
    assert "found 55 m, needed at most 20" in page.inner_text("#trial-error")
    page.select_option("#trial-length", "cm")
    settled(page)
    assert page.inner_text("#trial-error") == ""
    assert page.evaluate("live.trial.points('light')[0]") == pytest.approx([0, 0.55, -0.2])
    page.check("#trial-mirror")
    assert page.evaluate("live.trial.points('light')[0]") == pytest.approx([0, -0.55, -0.2])
    page.fill("#trial-release", "0,05")
    page.keyboard.press("Tab")
    assert page.evaluate("live.trial.points('light')[0][0]") == pytest.approx(-0.05)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "bad.csv: found no rows, needed a table of numbers; export the data again"),
        (
            "t,light_x,light_y\n0,1,2\n.01,<img src=x onerror=alert(1)>,3\n",
            "bad.csv:3: column light_x: found '<img src=x onerror=alert(1)>'",
        ),
        ("PK\x03\x04", "bad.csv: found a zip archive (a spreadsheet or a Tracker project), needed a text table"),
    ],
)
def test_a_bad_file_is_refused_in_one_line(opened, content, message):
    page = opened.page
    drop_file(page, "bad.csv", content)
    until(page, "document.getElementById('trial-error').textContent !== ''")
    assert page.inner_text("#trial-error").startswith(message)
    assert page.locator("#trial-error img").count() == 0


def test_files_of_the_page(opened, tmp_path):
    page = opened.page
    with page.expect_download() as download:
        page.click("#save-scenario")
    assert Path(download.value.path()).read_text(encoding="utf-8") == page.evaluate("live.scenario()")
    for name in shipped():
        preset(page, name)
        file = tmp_path / "live.scenario.yaml"
        file.write_text(page.evaluate("live.scenario()"), encoding="utf-8")
        expected, written = load(name).parameters, load(str(file)).parameters
        assert written.release is expected.release
        for key, number in vars(expected.values()).items():
            if isinstance(number, float):
                assert getattr(written.values(), key) == pytest.approx(number, rel=1e-9), (name, key)
    preset(page, "ten_to_one")
    with page.expect_download() as download:
        page.click("#save-numbers")
    lines = Path(download.value.path()).read_text(encoding="utf-8").splitlines()
    assert lines[0].startswith("t,light_x,light_y")
    reference = solve(load("ten_to_one").parameters).sample([0.3]).light_position[0]
    assert [float(cell) for cell in lines[301].split(",")[1:3]] == pytest.approx(list(reference), abs=1e-7)
    with page.expect_download() as download:
        page.click("#save-picture")
    assert Path(download.value.path()).read_bytes().startswith(b"\x89PNG")


@pytest.mark.accurate  # daily, the other files that the page writes
def test_a_film_of_the_motion(opened):
    page = opened.page
    page.click("[data-slow='1']")
    with page.expect_download() as download:
        page.click("#save-film")
        until(page, "live.player.time > 0.2")
        page.click("#play")
    assert Path(download.value.path()).read_bytes().startswith(b"\x1aE\xdf\xa3")  # how every WebM begins
    assert page.evaluate("live.endFilm") is None


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


def test_a_fit_sets_the_sliders_says_what_is_left_and_writes_the_study(opened, example):
    page = opened.page
    page.set_input_files("#trial-file", example)
    until(page, "live.trial.trial !== null")
    page.click("#trial-fit")
    until(page, "document.getElementById('fit-table').children.length > 0")
    settled(page)
    # Its points were made with an effect that the page does not have (looping_pendulum/teaching/example/study.yaml)
    assert "What is left is not noise" in page.inner_text("#fit-message")
    before, after = map(float, re.findall(r"([\d.]+) cm (?:before|after)", page.inner_text("#fit-message")))
    assert after < before / 5
    angle = re.search(r"Angle of the string: ([\d.]+) ± ([\d.]+) °", page.inner_text("#fit-table"))
    assert value(page, "release_angle") == float(angle[1])
    assert float(angle[1]) == pytest.approx(112, abs=1.5)  # as the study states it, within three of its errors
    study = load_text(page.evaluate("live.study()"), "mine")
    assert study.trials[0].files[0][0] == "first.csv"
    assert study.trials[0].estimates["release_angle"].value == pytest.approx(math.radians(float(angle[1])))
    page.click("#undo")
    assert value(page, "release_angle") == 113.08


def test_a_scenario_with_an_effect_that_the_page_lacks_is_refused_without_runs_of_it(tmp_path):
    file = tmp_path / "thick.yaml"
    source = (Path(__file__).parents[2] / "looping_pendulum" / "scenarios" / "two_to_one.yaml").read_text(encoding="utf-8")
    file.write_text(source + "effects: {string_thickness: 1 mm}\n", encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"^thick: effects: found string_thickness, which the live .*demo"):
        render(load(str(file)))
