"""The live page's fit of the table that `track` writes of a clean rendered film: the oracle is what was filmed."""

import base64
import math

import pytest

pytest.importorskip("cv2", reason="needs the extra film")
pytest.importorskip("av", reason="needs the extra film")

from looping_pendulum.live.write import live_settings
from looping_pendulum.measured.camera import CAMERA
from looping_pendulum.measured.film import output
from looping_pendulum.measured.film.record import TrackSettings
from looping_pendulum.measured.film.track import track
from looping_pendulum.measured.tables.plain_table import plain_table
from tests.apparatus import TEN_TO_ONE
from tests.blind import Apparatus
from tests.measured.film.conftest import SHORT
from tests.measured.film.renderer import Scene, looping_motion, render

STATED = {"light_mass": 0.005, "heavy_mass": 0.005, "rod_radius": 0.01, "scale": 0.005}
"""Relative standard errors that the page takes by default."""
NEAR = {"release_angle": math.radians(0.1), "free_length": 2e-3, "kinetic_friction": 0.005, "hanging_length": 5e-4}
"""Largest distances from what was filmed: a fifth of a pixel in its angle and lengths, and 1.5 % of the friction."""


def test_a_clean_film_is_noise_and_its_values_come_back(node, tmp_path):
    path, filmed = tmp_path / "clean.mp4", Apparatus()
    render(path, Scene(**SHORT, hand=True), looping_motion(0.8))
    table = plain_table(track(path, TrackSettings(free_length=filmed.free_length)).observations("clean"), output.DECIMALS)
    [read] = node("read_trials.mjs", [{"file": "clean.csv", "bytes": base64.b64encode(table.encode()).decode(), "options": {}}])
    assert all(len(c["error"]) == len(c["t"]) for c in read["channels"])
    known = {name: getattr(filmed, name) for name in ("light_mass", "heavy_mass", "rod_radius", "gravity")}
    # The fit begins a degree and some millimetres off, and with a string that has hardly any drag
    settings = live_settings(TEN_TO_ONE.replace(**known))
    camera = {"origin_x": 0.0, "origin_y": 0.0, "clock_offset": 0.0, "scale": 1.0, "tilt": 0.0}
    errors = {name: share * (settings | camera)[name] for name, share in STATED.items()} | {"tilt": CAMERA["tilt"].error}
    errors |= {"heavy_drag": 1e-3, "string_drag": 1e-3}
    [result] = node("fit_trials.mjs", [{"settings": settings, "channels": read["channels"], "camera": camera, "known": errors}])
    assert result["converged"]
    assert result["tests"] == {"ratio": pytest.approx(0.7, abs=0.3), "larger": False, "pattern": False, "place": None}
    fitted = {p["name"]: p["value"] for p in result["parameters"]}
    truth = {"kinetic_friction": filmed.friction} | {n: getattr(filmed, n) for n in NEAR if n != "kinetic_friction"}
    for name, near in NEAR.items():
        assert fitted[name] == pytest.approx(truth[name], abs=near), name
    for name, error in errors.items():
        assert abs(fitted[name] - (settings | camera)[name]) < 3 * error, f"{name} is right, and contradicts nothing"
