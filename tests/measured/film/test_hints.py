"""Films that the tracker cannot read, or reads wrongly, without a person's hint; its message names the one that helps."""

import math
from dataclasses import replace

import numpy as np
import pytest

from looping_pendulum.measured.film import FilmError
from looping_pendulum.measured.film.output import track_and_write
from looping_pendulum.measured.film.record import ScaleRule, Shown, TrackSettings, files_of
from looping_pendulum.measured.film.track import track
from tests.measured.film.renderer import Decoy, Scene, render, seen_by_a_camera
from tests.measured.film.test_track import PAPER, errors, rms_per_axis

ROD, SCALE = (395.0, 131.0), 415.0
SMALL = Scene(before=0.1, duration=0.6, frame_rate=120, size=(640, 360), scale=SCALE, rod=ROD)
RADIUS = 6.25e-3


def falling(x: float, since: float, until: float = math.inf) -> Decoy:
    """A ball, blacker than the heavy mass, that is dropped at a column of the picture."""

    def place(t: float) -> tuple[float, float] | None:
        return (x, min(20 + 600 * max(t - since, 0) ** 2, 345)) if t < until else None

    return Decoy(place=place, radius=14)


def trembling(i: int) -> Decoy:
    """One of many leaves at the left edge."""
    x, y = 18 + 24 * (i % 5), 18 + 25 * (i // 5)
    return Decoy(
        place=lambda t: (x + 4.8 * math.sin((20 + i % 7) * t), y + 4.8 * math.cos((20 + i % 7) * t)), radius=7, level=40 + 2 * i
    )


@pytest.fixture(scope="module")
def film(tmp_path_factory, motion):
    """A function that renders a scene with decoys and returns its path and truth."""

    def made(**changes):
        path = tmp_path_factory.mktemp("hint") / "trial.mp4"
        return path, render(path, replace(SMALL, **changes), motion)

    return made


def check(path, truth, settings, bound=0.3):
    """The points are right with these settings."""
    found = track(path, settings)
    distance, share = errors(found.light, truth.light, truth)
    assert share > 0.9
    assert rms_per_axis(distance) < bound
    return found


def shown(places, truth, t: float) -> Shown:
    """What a person shows, to a pixel."""
    k = int(np.argmin(np.abs(truth.t - t)))
    return Shown(float(round(places[k, 0])), float(round(places[k, 1])), k)


def refused(path, settings=PAPER) -> str:
    with pytest.raises(FilmError) as raised:
        track(path, settings)
    assert "\n" not in str(raised.value)
    return str(raised.value)


@pytest.mark.long
def test_another_thing_that_falls_is_told_by_heavy_or_by_region(film):
    path, truth = film(decoys=(falling(560, 0.0),), seed=402)
    message = refused(path)
    assert "another thing falls" in message
    assert "--heavy X,Y@FRAME" in message
    check(path, truth, replace(PAPER, heavy=shown(truth.heavy, truth, 0.2)))
    check(path, truth, replace(PAPER, region=(100, 0, 500, 360)))


@pytest.mark.long
def test_what_fell_before_the_trial_is_left_out_by_from(film):
    path, truth = film(before=0.9, decoys=(falling(391, -0.8, until=-0.2),), seed=405)
    message = refused(path)
    assert "another thing falls" in message
    assert "--from" in message
    check(path, truth, replace(PAPER, first=0.75))


@pytest.mark.long
def test_where_the_masses_are_not_found_the_sheet_shows_what_moves(film, tmp_path):
    path, _ = film(decoys=(falling(560, 0.0),), seed=402)
    files = files_of(path, tmp_path)
    with pytest.raises(FilmError, match=f"; {files.sheet.name} shows what moves$"):
        track_and_write(path, PAPER, files)
    assert files.sheet.read_bytes().startswith(b"\x89PNG")
    assert not files.table.exists()


@pytest.mark.long
def test_many_things_that_move_are_left_out_by_region(film):
    path, truth = film(decoys=tuple(map(trembling, range(65))), seed=404)
    assert '--region "X,Y X,Y"' in refused(path)
    check(path, truth, replace(PAPER, region=(150, 0, 640, 360)))


@pytest.mark.long
def test_a_film_that_begins_after_the_release_needs_a_rule(film):
    path, truth = film(before=-0.05, duration=0.65, seed=401)
    assert '--scale "X,Y X,Y = 1 m"' in refused(path)
    found = check(path, truth, TrackSettings(scale=ScaleRule((300, 131), (300, 131 + 0.4 * SCALE), 0.4)))
    assert found.geometry.scale == pytest.approx(truth.scale, rel=2 * found.geometry.scale_error)
    assert 1e-3 < found.geometry.scale_error < 1e-2  # of a rule that a person has shown


@pytest.mark.long
@pytest.mark.parametrize(("contrast", "level", "bound"), [(0.5, 10, 1.0), (1.0, 120, 0.3)], ids=["darker", "paler"])
def test_a_mirror_image_of_the_light_mass_is_refused_and_told_by_light(film, motion, contrast, level, bound):
    def mirrored(t: float) -> tuple[float, float]:
        x, y = motion.at(np.array([max(t, 0.0)]))[0][0]
        return ROD[0] + SCALE * (2 * RADIUS - x), ROD[1] - SCALE * y

    path, truth = film(contrast=contrast, decoys=(Decoy(place=mirrored, radius=4, level=level),), seed=403)
    message = refused(path)  # it hangs on a taut string, too, on the other side
    assert "two things on a taut string" in message
    assert "--light X,Y@FRAME" in message
    found = check(path, truth, replace(PAPER, light=shown(truth.light, truth, 0.15)), bound=bound)
    assert found.geometry.side == 1


@pytest.mark.long
def test_a_lens_hardly_displaces_the_rod_and_a_person_who_shows_it_holds_it(film):
    """By five percent at half the picture's width; before the lens was fitted, more than half a pixel."""
    path, truth = film(project=seen_by_a_camera(SMALL, lens=-0.05), seed=406)
    free = track(path, PAPER).geometry
    assert free.values["distortion"] < -3 * free.errors["distortion"]
    assert np.abs(np.array(free.rod) - ROD).max() < 0.5
    held = check(path, truth, replace(PAPER, rod=ROD)).geometry
    assert np.abs(np.array(held.rod) - ROD).max() < np.abs(np.array(free.rod) - ROD).max()


@pytest.mark.long
def test_a_mass_that_is_not_where_it_was_shown_is_named_with_its_option(film):
    path, _ = film(seed=407)
    assert "--heavy" in refused(path, replace(PAPER, heavy=Shown(20, 20, 30)))
    assert "--light" in refused(path, replace(PAPER, light=Shown(20, 20, 30)))
    assert "--from and --to" in refused(path, replace(PAPER, first=0.2, last=0.21))
