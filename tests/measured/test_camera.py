"""The camera model is that of a camera in space, and its derivatives are right."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from looping_pendulum.measured.camera import CAMERA, Camera
from looping_pendulum.measured.observations import DataError
from tests.blind import camera as blind

POINTS = np.random.default_rng(1).uniform(-0.6, 0.6, (50, 2))
WITH_ERRORS = Camera(
    origin_x=0.01, origin_y=-0.02, scale=1.03, tilt=0.05, foreshortening=0.96, shear=0.03,
    perspective_x=0.08, perspective_y=-0.03,
    distortion=-0.1, centre_x=0.1, centre_y=-0.2,
)  # fmt: skip


def test_null_values_change_no_bit_and_every_bound_holds_them():
    assert {f.name for f in dataclasses.fields(Camera)} == set(CAMERA)
    assert all(c.bounds[0] < c.null < c.bounds[1] and c.error > 0 for c in CAMERA.values())
    assert np.array_equal(Camera().project(POINTS), POINTS)
    old = Camera(scale=1.03, tilt=0.05, centre_x=0.3)  # without a distortion the picture's centre does not matter
    (cosine, sine), (x, y) = (np.cos(0.05), np.sin(0.05)), POINTS.T
    by_hand = 1.03 * np.column_stack([cosine * x - sine * y, sine * x + cosine * y])
    assert np.array_equal(old.project(POINTS), by_hand)
    assert np.array_equal(old.project_displacement(POINTS, POINTS), by_hand)


def test_the_model_without_its_short_cut_is_the_same():
    for name in ("foreshortening", "shear", "perspective_x", "perspective_y", "distortion"):
        nearly = Camera(**{name: CAMERA[name].null + 1e-15})
        assert nearly.project(POINTS) == pytest.approx(POINTS, abs=1e-14)


def test_values_out_of_bounds_and_masses_behind_the_camera_are_refused():
    with pytest.raises(DataError, match="camera scale: found -1"):
        Camera(scale=-1.0)
    with pytest.raises(DataError, match="camera perspective: found 0.5 1/m and 0 1/m, with which a mass is behind the camera"):
        Camera(perspective_x=0.5).project(np.array([[-2.1, 0.0]]))


def test_tilt_turns_counterclockwise_and_scale_keeps_the_angle():
    assert Camera(tilt=math.pi / 2).project(np.array([[1.0, 0.0]])) == pytest.approx(np.array([[0.0, 1.0]]), abs=1e-15)
    assert Camera(scale=2.0, origin_x=1.0).project(np.array([[1.0, 3.0]])) == pytest.approx(np.array([[3.0, 6.0]]))


@pytest.mark.parametrize("camera", [Camera(tilt=0.05), WITH_ERRORS], ids=["straight", "with_errors"])
def test_the_displacement_is_the_derivative_of_the_projection(camera):
    directions = np.random.default_rng(2).normal(size=(50, 3, 2))
    exact = camera.project_displacement(POINTS[:, np.newaxis], directions)
    for j in range(3):
        step = 1e-5 * directions[:, j]
        difference = (camera.project(POINTS + step) - camera.project(POINTS - step)) / 2e-5
        # Central differences: 1e-10 of a third derivative of order 1, and rounding of 1e-16 over 1e-5
        assert exact[:, j] == pytest.approx(difference, abs=1e-9)


def expected_camera(true: blind.Camera) -> Camera:
    """Model of a camera in space, by the formulas of the page on the derivation; one above the rod aims at it."""
    depth = true.distance + true.aside[0] * math.sin(true.sideways)  # of the rod, along the optical axis
    shortened = math.cos(true.sideways) * true.distance / depth / math.cos(true.above)
    distortion = true.lens / depth**2
    # An operator's rule of half a metre, upright at the rod, is itself seen with the lens's distortion
    scale = (depth + true.rule_behind) / depth / (1 + distortion * 0.25**2)
    if true.above:
        half = -0.25 * math.sin(true.above) / depth  # the rule is seen shortened, and its ends at two distances
        scale = 1 - half**2
    return Camera(
        scale=scale,
        foreshortening=shortened * (1 + true.pixel_aspect),
        shear=-math.sin(true.sideways) * math.tan(true.above),
        perspective_x=-math.sin(true.sideways) * math.cos(true.above) / depth,
        perspective_y=-math.sin(true.above) / depth,
        distortion=distortion,
        centre_x=true.aside[0],
        centre_y=true.aside[1],
    )


@pytest.mark.parametrize(
    "true",
    [
        blind.Camera(pixel_aspect=0.03),
        blind.Camera(sideways=math.radians(14)),
        blind.Camera(sideways=math.radians(-14), distance=1.5),
        blind.Camera(sideways=math.radians(9), aside=(0.3, 0.0)),
        blind.Camera(above=math.radians(10)),
        blind.Camera(above=math.radians(10), sideways=math.radians(14)),
        blind.Camera(above=math.radians(-20), sideways=math.radians(30), distance=2.0),
        blind.Camera(lens=-0.3, distance=1.5),
        blind.Camera(lens=0.1, sideways=math.radians(5)),
        blind.Camera(rule_behind=0.1),
    ],
    ids=[
        "pixel_aspect",
        "side",
        "other_side",
        "aimed_beside_the_rod",
        "above",
        "above_and_side",
        "far_below",
        "lens",
        "lens_from_the_side",
        "rule_behind",
    ],
)
def test_the_model_is_that_of_a_camera_in_space(true):
    """Oracle: rays from points in space through a pinhole and a lens, in pixels, which an operator turns into lengths."""
    assert expected_camera(true).project(POINTS) == pytest.approx(blind.Pinhole(true).stated(POINTS), abs=1e-12)


def test_a_lens_whose_picture_is_not_centred_on_the_rod():
    true = blind.Camera(lens=-0.2, distance=2.0, aside=(0.15, -0.25))
    stated = blind.Pinhole(true).stated(POINTS)
    modelled = expected_camera(true).project(POINTS)
    # Only the rule's scale differs: the distortion acts on it, too
    ratio = np.sum(stated * modelled) / np.sum(modelled**2)
    assert stated == pytest.approx(ratio * modelled, abs=1e-12)


def test_the_page_on_identification_lists_every_key():
    page = (Path(__file__).parents[2] / "docs" / "measured.md").read_text(encoding="utf-8")
    assert all(f"| `{c.name}` | {c.unit} | {c.meaning} |" in page for c in CAMERA.values())
