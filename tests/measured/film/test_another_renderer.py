"""Films of a renderer and an integrator that the project did not write, with their truth (README.md beside them)."""

import csv
import gzip
import json
import math
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from looping_pendulum.measured.film import words
from looping_pendulum.measured.film.record import CAMERA_PRIORS, HANGING_LENGTH_ERROR, RADIUS_ERROR, TrackSettings
from looping_pendulum.measured.film.track import track
from tests.discrepancy.real_data import real

STATED = {
    "n1_240": ("58.05 cm +/- 1 mm", "6.27 mm +/- 1 %", "10.03 g", ("100.3 g", "59.9 g", "40.1 g")),
    "s1_240c": ("58.07 cm +/- 1 mm", "6.27 mm +/- 1 %", "10.03 g", ("100.3 g", "59.9 g", "40.1 g")),
    "r_240t": ("58 cm +/- 1 mm", "5.94 mm +/- 0.5 %", "10 g", ("100 g", "60 g")),
    "w_240ae": ("58 cm +/- 1 mm", "6.25 mm +/- 1 %", "10 g", ("100 g", "60 g", "40 g")),
    "n2_60v": ("54.06 cm +/- 1 mm", "6.27 mm +/- 1 %", "10.02 g", ("100.05 g", "60.03 g", "40.02 g")),
}
"""Study -> free length, radius of the rod, and masses, each known to 0.5 %, as somebody typed them."""
HIDDEN = {"s1_240c": "side_force", "r_240t": "wrong_rod_radius", "w_240ae": "string_density"}


def number(text: str) -> float:
    """Return the number before a unit, in SI."""
    value, unit = text.split("+/-")[0].split()
    return float(value) * {"cm": 1e-2, "mm": 1e-3}[unit]


@pytest.mark.long
@pytest.mark.parametrize(
    ("study", "film"), [("n1_240", "t3"), ("s1_240c", "t1"), ("r_240t", "t2"), ("w_240ae", "t1"), ("n2_60v", "t1")]
)
def test_a_film_shows_its_geometry_and_release_whatever_was_stated_of_it(study, film):
    """The angle was that of the first seen point, 1.5 to 5.4 deg off; two of these five films were refused."""
    path = Path(real(f"rendered_films/{study}/{film}.mp4"))
    truth = json.loads(path.with_suffix(".truth.json").read_text())
    with gzip.open(path.with_suffix(".truth.csv.gz"), "rt") as stream:
        rows = list(csv.DictReader(stream))
    true = {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}
    length, radius = (number(text) for text in STATED[study][:2])
    share = float(STATED[study][1].split("+/-")[1].split()[0]) / 100
    found = track(
        path,
        TrackSettings(free_length=length, free_length_error=1e-3, rod_radius=radius, rod_radius_error=share * radius),
    )
    view, k = found.geometry, found.light.frame
    moving = (true["t_mid"][k] > 0) & (true["t_mid"][k] < truth["end"])
    off = (found.light.place - np.stack([true["lx_px"], true["ly_px"]], axis=1)[k])[moving]
    assert np.sqrt(np.mean(off**2)) < (0.25 if truth["fps"] == 240 else 0.5)
    # Marks of a shaded ball are a tenth of a pixel aside, and the rod is where they have it
    assert np.abs(np.array(view.rod) - truth["rod_px"]).max() < 0.3 + 3 * view.errors["rod_y"]
    assert abs(view.rod_radius - truth["p"]["R"]) < 4 * view.errors["rod_radius"]
    assert abs(math.degrees(found.release.angle - truth["p"]["th0"])) < 0.15
    released = np.interp(0.0, true["t_mid"], found.t[: len(rows)])
    assert abs(found.release.time - released) < 3 * found.release.time_error
    said = words.contradictions(found)
    assert any("the film shows a rod of radius 6.2" in line for line in said) == (study == "r_240t"), said
    first = true["t_mid"][k][moving].min()
    seen = np.sum(moving) / np.sum((true["t_mid"] >= first) & (true["t_mid"] < truth["end"]))
    assert seen > 0.97


ADDS_A_LAW = pytest.mark.xfail(
    strict=True, reason="beside the string's mass a law of 0.09 mN, which the held-out film confirms by 31 nats"
)


@pytest.mark.accurate
@pytest.mark.parametrize("study", [pytest.param(s, marks=ADDS_A_LAW if s == "w_240ae" else ()) for s in STATED])
def test_the_page_typed_leads_to_the_verdict(study, tmp_path):
    """docs/film.md to the letter, with the film's own angles: two of these five were right, now four."""
    films = sorted(Path(real(f"rendered_films/{study}/t1.mp4")).parent.glob("*.mp4"))
    for film in films:
        shutil.copyfile(film, tmp_path / film.name)
    length, radius, light, heavy = STATED[study]
    names = " ".join(film.name for film in films)
    of_apparatus = f"--free-length '{length}' --rod-radius '{radius}'"
    masses = f"--light-mass '{light} +/- 0.5 %' " + " ".join(f"--heavy-mass '{mass} +/- 0.5 %'" for mass in heavy)
    for command in (
        f"track {names} {of_apparatus}",
        f"new study {names} {of_apparatus} {masses} --out study.yaml",
        "look study.yaml",
        "identify study.yaml --out report",
    ):
        done = subprocess.run(
            [sys.executable, "-m", "looping_pendulum", *shlex.split(command)], cwd=tmp_path, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stdout + done.stderr
        assert "Warning" not in done.stderr
    found = json.loads((tmp_path / "report/verdict.json").read_text())
    credible = [{e["candidate"]["name"] for e in one["effects"]} for one in found["explanations"] if one["credible"]]
    assert credible == [{HIDDEN[study]} if study in HIDDEN else set()], found["sentence"]


@pytest.mark.accurate
@pytest.mark.parametrize(("study", "film"), [("n1_240", "t1"), ("s1_240c", "t1"), ("n2_60v", "t2"), ("w_240ae", "t3")])
def test_values_within_their_errors_change_nothing_beyond_the_errors(study, film):
    """A rod of 6.27 mm for 6.25 mm made 117 deg of 112. The scale is that of the stated length, and moves with it."""
    path = Path(real(f"rendered_films/{study}/{film}.mp4"))
    true = json.loads(path.with_suffix(".truth.json").read_text())["p"]
    random = np.random.default_rng(64)

    def tracked(length, radius):
        known = {"free_length": length, "free_length_error": 1e-3, "rod_radius": radius, "rod_radius_error": 0.01 * true["R"]}
        return track(path, TrackSettings(**known))

    base = tracked(true["l0"], true["R"])
    for length, radius in random.uniform(-2, 2, (20, 2)):
        found = tracked(true["l0"] + 1e-3 * length, true["R"] * (1 + 0.01 * radius))
        _, mine, its = np.intersect1d(base.light.frame, found.light.frame, return_indices=True)
        assert len(mine) > 0.98 * len(base.light.frame)
        assert np.abs(base.light.place[mine] - found.light.place[its]).max() < 0.05
        in_pixels = [one.geometry.scale * one.geometry.values["free_length"] for one in (base, found)]
        assert abs(in_pixels[1] / in_pixels[0] - 1) < 0.25 * base.geometry.scale_error
        for name in ("rod_x", "rod_y", "tilt", *CAMERA_PRIORS, "readout"):
            assert abs(found.geometry.values[name] - base.geometry.values[name]) < base.geometry.errors[name], name
        assert abs(found.release.angle - base.release.angle) < base.release.angle_error
        assert abs(found.release.time - base.release.time) < base.release.time_error
        assert abs(found.hanging_length - base.hanging_length) < HANGING_LENGTH_ERROR
        assert abs(found.light.radius - base.light.radius) < RADIUS_ERROR
