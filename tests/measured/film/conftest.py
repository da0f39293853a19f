"""Rendered films, made once for all tests."""

import math
from pathlib import Path

import pytest

pytest.importorskip("cv2", reason="needs the extra film")
pytest.importorskip("av", reason="needs the extra film")

from looping_pendulum.cli.common import settle_films
from looping_pendulum.measured.study import Study
from looping_pendulum.measured.study_io import load
from tests.measured.film.renderer import Scene, Truth, looping_motion, render

SHORT = {"before": 0.1, "duration": 0.6}
"""From just before the release to just after the halt, at 720p."""


@pytest.fixture(scope="session")
def motion():
    return looping_motion(0.8)


@pytest.fixture(scope="session")
def ordinary(tmp_path_factory, motion) -> tuple[Path, Truth]:
    """240 frames a second, 1/1000 s, CRF 23, with a hand."""
    path = tmp_path_factory.mktemp("ordinary") / "trial.mp4"
    return path, render(path, Scene(**SHORT, hand=True), motion)


@pytest.fixture(scope="session")
def nasty(tmp_path_factory) -> tuple[Path, Truth]:
    """60 frames a second, 1/240 s, look-alike masses, shadow, hand, CRF 30."""
    path = tmp_path_factory.mktemp("nasty") / "nasty.mp4"
    scene = Scene(
        frame_rate=60, hand=True, shadow=True, alike=True, exposure=1 / 240, crf=30, noise=3, before=0.25, duration=0.75
    )
    return path, render(path, scene, looping_motion(0.8, heavy_mass=0.06, release_angle=math.radians(104)))


def tracked_study(path: Path) -> Study:
    """Load a study, and track its films, as `identify --track` does."""
    study = load(path)
    settle_films(study, track=True, keep=False)
    return study
