"""A film in the live page: under the model and on its clock, tracked from two clicks, and fitted."""

import numpy as np
import pytest

from looping_pendulum.reference_ode.solve import solve_at
from looping_pendulum.scenarios import loader
from tests.pages.axe import violations
from tests.pages.conftest import until
from tests.pages.live_page import settled

RATE, LEAD, FRAMES = 120, 8, 60
"""Frames a second, frames before the release, and all of them."""
FRICTION = 0.3431
"""Of the shipped scenario."""
SIZE = 400
"""Sides of the picture [px]."""
PIXEL = 0.0034
"""Length of a pixel [m]."""
AXIS = (205.0, 120.0)
"""Place of the rod's axis in the picture [px]."""
LARGEST_ERROR = 1.0
"""Largest distance of a found point from its mass [px]."""


def disc(picture, place, radius, colour):
    """Draw a disc whose edge is as smooth as a camera's."""
    y, x = np.mgrid[: picture.shape[0], : picture.shape[1]]
    share = np.clip(radius + 0.5 - np.hypot(x - place[0], y - place[1]), 0, 1)[..., None]
    picture[:] = picture * (1 - share) + share * np.array(colour)


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    """A film of a trial, and where the masses are in each frame [px], shape (frames, 4)."""
    av = pytest.importorskip("av", reason="PyAV, which writes the film, is not installed (extra `film`)")
    run = solve_at(loader.load("ten_to_one").parameters, np.maximum(np.arange(FRAMES) - LEAD, 0) / RATE)
    places = np.hstack([AXIS + p * (1 / PIXEL, -1 / PIXEL) for p in (run.light_position, run.heavy_position)])
    wall = np.random.default_rng(1).uniform(90, 130, (SIZE, SIZE, 3))
    path = tmp_path_factory.mktemp("film") / "trial.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=RATE, width=SIZE, height=SIZE, pix_fmt="yuv420p", options={"crf": "18"})
        for place in places:
            picture = wall.copy()
            disc(picture, AXIS, 3, (60, 60, 60))
            disc(picture, place[:2], 5, (230, 60, 30))
            disc(picture, place[2:], 9, (40, 120, 230))
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture.astype(np.uint8), format="rgb24")))
        container.mux(stream.encode())
    return path, places


ON_STAGE = """([x, y]) => {
      const { film, stage } = live, scale = (film.scale ?? film.guess) * stage.view.scale;
      document.getElementById("stage").scrollIntoView();
      const box = document.getElementById("stage").getBoundingClientRect();
      return [box.left + stage.view.x(0) + (x - film.axis.x) * scale, box.top + stage.view.y(0) + (y - film.axis.y) * scale];
    }"""
"""Place in the picture [px] -> place in the window."""


def click(page, x, y):
    """Click a place of the picture [px]."""
    page.mouse.click(*page.evaluate(ON_STAGE, [x, y]))
    until(page, "!live.film.film.busy")
    settled(page)


def show(page, frame):
    page.evaluate("(time) => live.film.showAt(time)", (frame + 0.5) / RATE)
    until(page, "!live.film.film.busy")
    settled(page)


@pytest.mark.long
def test_a_film_is_tracked_from_two_clicks_and_fitted(page, film):
    path, places = film
    page.set_input_files("#film-file", str(path))
    until(page, "/per second|cannot/.test(document.getElementById('film-message').textContent)")
    if "cannot" in page.inner_text("#film-message"):
        pytest.skip("this browser shows no H.264")
    assert f"{SIZE} × {SIZE}, {RATE}.0" in page.inner_text("#film-message").replace(f"{RATE}.00", f"{RATE}.0")
    assert violations(page) == []
    page.click("#film-axis")
    click(page, *AXIS)
    page.click("#film-scale")
    click(page, 50, 300)
    assert page.inner_text("#film-message").startswith("First type the known length")
    page.fill("#film-length", "34")
    click(page, 50, 300)
    click(page, 150, 300)
    assert page.evaluate("live.film.scale") == pytest.approx(PIXEL, rel=1e-3)
    show(page, LEAD)
    page.click("#film-release")
    for mass, start in (("light", 0), ("heavy", 2)):
        show(page, LEAD)
        page.click(f"#film-{mass}")
        for frame in (LEAD, LEAD + 1):
            click(page, *places[frame, start : start + 2])
        page.click("#film-find")
        until(page, "!live.film.searching")
        marks = page.evaluate("(mass) => live.film.marks[mass].map(({ time, x, y }) => [time, x, y])", mass)
        frames = np.round(np.array(marks)[:, 0] * RATE).astype(int)
        assert frames.tolist() == list(range(LEAD, FRAMES))
        assert np.abs(np.array(marks)[:, 1:] - places[frames, start : start + 2]).max() < LARGEST_ERROR
    # Arrow keys move the newest mark by a tenth of a pixel
    before = page.evaluate("live.film.newest.x")
    page.press("#stage", "ArrowRight")
    assert page.evaluate("live.film.newest.x") == pytest.approx(before + 0.1)
    # The film follows the model's clock
    page.evaluate("live.player.stopAt(0.2)")
    until(page, f"Math.abs(live.film.film.time - {LEAD / RATE + 0.2}) < 0.01")
    page.click("#film-use")
    until(page, "live.trial.trial !== null")
    page.click("#trial-fit")
    until(page, "document.getElementById('fit-table').children.length > 0")
    friction = page.evaluate("live.state.values.kinetic_friction")
    assert friction == pytest.approx(FRICTION, rel=0.05)
    assert_fit_follows(page, places)
    page.click("#film-remove")
    assert page.evaluate("live.film.film") is None


def assert_fit_follows(page, places):
    """A point is dragged away, put back by hand, deleted and marked anew; each time the trial has it and a new fit is made."""
    frame = LEAD + 30
    fitted = (
        "document.getElementById('trial-fit').disabled === false && document.getElementById('fit-table').children.length > 0"
    )
    point = f"live.film.marks.light.find(({{ time }}) => Math.abs(time - {frame / RATE}) < 1e-3)"
    friction = "live.state.values.kinetic_friction"
    good = page.evaluate(friction)
    page.click("#film-correct")
    x, y = page.evaluate(f"(({{ x, y }}) => [x, y])({point})")
    start, end = (page.evaluate(ON_STAGE, place) for place in ([x, y], [x + 40, y - 30]))
    page.mouse.move(*start)
    page.mouse.down()
    page.mouse.move(*end, steps=4)
    page.mouse.up()
    moved = page.evaluate(f"(({{ x, y }}) => [x, y])({point})")
    assert moved == pytest.approx([x + 40, y - 30], abs=0.6)
    until(page, fitted)
    in_trial = f"live.trial.points('light').find(([t]) => Math.abs(t - {(frame - LEAD) / RATE}) < 1e-3)"
    assert page.evaluate(in_trial)[1] == pytest.approx((moved[0] - AXIS[0]) * PIXEL, abs=2 * PIXEL)
    until(page, "!live.film.film.busy")
    assert page.evaluate("live.film.film.time") == pytest.approx(frame / RATE, abs=1 / RATE), "its frame is shown"
    page.press("#stage", "Delete")
    assert page.evaluate(point) is None
    assert page.evaluate(in_trial) is None
    until(page, fitted)
    page.click("#film-light")
    show(page, frame)
    click(page, *places[frame, :2])
    assert page.evaluate(f"(({{ x, y }}) => [x, y])({point})") == pytest.approx(places[frame, :2], abs=0.6)
    until(page, fitted)
    assert page.evaluate(friction) == pytest.approx(good, rel=2e-3)


def test_a_webm_that_states_no_duration_is_played(page, tmp_path):
    """Programs that record a screen write one so; browsers say "Infinity" of it until its end was sought."""
    av = pytest.importorskip("av", reason="PyAV, which writes the film, is not installed (extra `film`)")
    pixels = np.random.default_rng(1)
    path = tmp_path / "screen.webm"
    # Of noise, so that it is long enough for the browser not to see its end at once
    options = {"b": "60M", "qmin": "0", "qmax": "2", "deadline": "realtime", "cpu-used": "8"}
    live = {"format": "webm", "options": {"live": "1"}}
    with path.open("wb") as file, av.open(OnlyWritten(file), "w", **live) as container:
        stream = container.add_stream("libvpx", rate=60, width=320, height=240, pix_fmt="yuv420p", options=options)
        for _ in range(45):
            picture = pixels.integers(0, 255, (240, 320, 3), dtype=np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())
    page.set_input_files("#film-file", str(path))
    until(page, "/per second|cannot/.test(document.getElementById('film-message').textContent)")
    assert page.evaluate("live.film.film.duration") == pytest.approx(45 / 60, abs=1.5 / 60)
    # WebM has times in whole milliseconds
    assert 1 / page.evaluate("live.film.film.step") == pytest.approx(60, rel=0.01)
    page.fill("#film-rate", "60")
    assert page.evaluate("live.film.factor") == 1, "it is no slow motion"
    # The points' times are those of even frames again
    page.evaluate("""async () => {
      const { film: panel } = live;
      for (let k = 0; k < 24; k++) {
        await panel.film.show((k + 0.5) / 60);
        panel.marks.light.push({ time: panel.film.time, x: 100 + k, y: 100 });
      }
      [panel.scale, panel.release] = [1e-3, panel.marks.light[0].time];
      panel.use();
    }""")
    until(page, "live.trial.trial !== null")
    [times, _] = page.evaluate("live.trial.trial.channels.map(({ t }) => t)")
    assert np.diff(times) == pytest.approx(np.full(23, 1 / 60), abs=2e-5)
    assert np.ptp(np.diff(times)) < 2e-6, "rounded to milliseconds they differed by one"
    page.click("#film-remove")


class OnlyWritten:
    """A file in which nobody can go back."""

    def __init__(self, file):
        self.write = file.write


def test_what_is_no_film_says_so(page, tmp_path):
    path = tmp_path / "notes.mp4"
    path.write_bytes(b"no film")
    page.set_input_files("#film-file", str(path))
    until(page, "document.getElementById('film-message').textContent.includes('cannot')")
    assert page.inner_text("#film-message").startswith(
        "notes.mp4: this browser cannot show it. Needed is a film in MP4 (H.264)"
    )
    assert not page.is_visible("#film-tools")
