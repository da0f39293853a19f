"""Background, blobs and paths on pictures of a few grey discs, whose places are known."""

import numpy as np
import pytest

from looping_pendulum.film.decode import Picture
from looping_pendulum.film.moving import background, blobs_of, joined, paths

WIDTH, HEIGHT = 480, 360
STILL = 180
COLUMNS, ROWS = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))


def scene(*discs: tuple[float, float, float, int], noise: float = 1.0, seed: int = 0) -> np.ndarray:
    """A grey picture with discs (x, y, radius, level)."""
    picture = np.full((HEIGHT, WIDTH), STILL, dtype=float)
    for x, y, radius, level in discs:
        cover = np.clip(radius + 0.5 - np.hypot(COLUMNS - x, ROWS - y), 0, 1)
        picture += cover * (level - picture)
    picture += np.random.default_rng(seed).normal(0, noise, picture.shape)
    return np.clip(picture + 0.5, 0, 255).astype(np.uint8)


def blobs(pictures: list[np.ndarray], still: list[np.ndarray], *, whole: bool = False):
    ground = background([(p,) for p in still], range(len(still)), (0, len(still) - 1), sure=True)
    empty = np.empty(0, np.uint8)
    return blobs_of([Picture(k, p, empty, empty) for k, p in enumerate(pictures)], ground, whole=whole)


def test_a_place_that_a_mass_covers_in_nearly_half_of_the_pictures_keeps_its_own_brightness():
    # A textured thing, of another brightness each time, in 7 pictures of 15; and in 8, as chance may have it
    for covered in (7, 8):
        still = [scene((240, 180, 30, 40 + 11 * k) if k < covered else (900, 900, 1, 0), seed=k) for k in range(15)]
        ground = background([(p,) for p in still], range(15), (0, 14), sure=True, rests=False)
        middle = ground.planes[0][170:190, 230:250].astype(float)
        assert np.abs(middle - STILL).max() < 5
        assert ground.threshold[180 * ground.threshold.shape[0] // HEIGHT, 240 * ground.threshold.shape[1] // WIDTH] < 60


def test_what_leaves_the_picture_is_left_out():
    found = blobs([scene((x, 180, 12, 60)) for x in (460, 470, 478)], [scene(seed=k) for k in range(9)])
    assert [len(found[k]) for k in range(3)] == [1, 0, 0]
    assert found[0][0].x == pytest.approx(460, abs=0.1)


def test_parts_of_one_thing_are_one_whole_and_else_the_largest_is_the_mass():
    picture = scene((200, 180, 14, 60), (230, 180, 9, 60))
    still = [scene(seed=k) for k in range(9)]
    (mass, *_), (whole,) = blobs([picture], still)[0], blobs([picture], still, whole=True)[0]
    assert mass.x == pytest.approx(200, abs=0.2)
    assert 203 < whole.x < 213


def test_a_path_goes_on_after_a_bounce():
    t = np.arange(40) / 30
    y = np.where(t < 0.5, 60 + 240 * (t / 0.5) ** 2, 300 - 500 * (t - 0.5) + 400 * (t - 0.5) ** 2)
    found = blobs(
        [scene((100 + 60 * now, at, 10, 60)) for now, at in zip(t, y, strict=True)], [scene(seed=k) for k in range(9)]
    )
    pieces = paths(found, t, WIDTH)
    (path,) = joined(pieces, t)
    assert len(path) >= 38
    assert np.abs(path[:, 2] - y[path[:, 0].astype(int)]).max() < 0.3


def test_a_point_alone_begins_no_path():
    t = np.arange(20) / 240
    pictures = [scene((60 + 3 * k, 100, 6, 60)) if k >= 6 else scene() for k in range(20)]
    pictures[0] = scene((66, 104, 6, 60))  # something else, in one picture
    (path,) = paths(blobs(pictures, [scene(seed=k) for k in range(9)]), t, WIDTH)
    assert path[0, 0] == 6
