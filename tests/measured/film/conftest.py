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


def write_study(folder: Path, trials: list[tuple[str, float, float]], hanging: str, line: str = "") -> Path:
    """Write what somebody knows who measured the apparatus of three films, of which `c` is held out.

    Parameters
    ----------
    trials
        Name, heavy mass [kg] and stated angle of the release [deg] of each.
    hanging
        Stated hanging length.
    line
        More of each trial.
    """
    entries = "".join(
        f"- name: {name}\n  file: {name}.mp4\n  held_out: {str(name == 'c').lower()}\n"
        f"  heavy: {{mass: {1e3 * heavy_mass:g} g +/- 0.5 %}}\n"
        f"  release: {{angle: {angle:.2f} deg +/- 0.5 deg, free_length: 58 cm +/- 1 mm, hanging_length: {hanging}}}\n"
        + (f"  {line}\n" if line else "")
        for name, heavy_mass, angle in trials
    )
    path = folder / "study.yaml"
    path.write_text(
        "title: rendered\napparatus:\n  light: {mass: 10 g +/- 0.5 %}\n  rod: {radius: 6.25 mm +/- 1 %}\n"
        "effects: {gravity: 9.81 m/s^2, capstan: free, light_drag: free, heavy_drag: free, string_drag: free}\n"
        f"trials:\n{entries}"
    )
    return path


def tracked_study(path: Path) -> Study:
    """Load a study, and track its films, as `identify --track` does."""
    study = load(path)
    settle_films(study, track=True)
    return study
