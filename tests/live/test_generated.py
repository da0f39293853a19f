"""The generated JavaScript and the page are what the package writes."""

from importlib.resources import files

from looping_pendulum.live.generate import model_source
from looping_pendulum.live.write import render, shipped_script
from scripts.live_page import PAGE, script

FOLDER = files("looping_pendulum.live")
ADVICE = "run `npm ci && python -m scripts.live_page`"


def test_the_file_is_what_the_generator_writes():
    assert (FOLDER / "model.js").read_text(encoding="utf-8") == model_source(), "run `python -m looping_pendulum.live.generate`"


def test_the_page_that_is_shipped_is_what_the_package_writes():
    assert PAGE.read_text(encoding="utf-8") == render(), ADVICE


def test_its_script_is_what_esbuild_makes_of_the_modules(esbuild):
    assert shipped_script() == script(), ADVICE
