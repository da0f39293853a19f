"""Studies of films whose light mass is a ball that winds up to the rod, or is caught in mid-air: from the film to the verdict.

Nobody states the ball's radius. `python -m pytest -m accurate tests/film/test_studies_of_balls.py` takes about an hour.
"""

import math
from dataclasses import dataclass, field

import numpy as np
import pytest

from looping_pendulum.discrepancy.identify import identify
from looping_pendulum.discrepancy.result import Verdict
from looping_pendulum.measured.study_io import load
from tests.blind import Effects
from tests.film.renderer import Scene, looping_motion, render, until_ball_rests

pytestmark = pytest.mark.accurate
FINE, COARSE = {"crf": 23, "noise": 1.0}, {"crf": 28, "noise": 1.5}
TRIALS = (("a", 0.1, 114.0), ("b", 0.14, 105.0), ("c", 0.12, 96.0))
"""Name, heavy mass [kg] and angle of the release [deg] of the two fitted trials and of the one held out."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """Three films of one ball, and what nobody declared of them."""

    radius: float
    """[m]"""
    frame_rate: float
    quality: dict[str, float]
    caught: bool = False
    """Whether a hand catches the ball at about 0.8 s in every film."""
    hidden: Effects = Effects()
    name: str = ""
    """Of the hidden effect in the library."""
    seed: int = field(default=0)

    def __str__(self) -> str:
        """Return a test's name."""
        quality = "fine" if self.quality is FINE else "coarse"
        end = "caught" if self.caught else "wound"
        return f"{1e3 * self.radius:g}mm-{self.frame_rate:g}-{quality}-{end}-{self.name or 'clean'}"


SIDE, DRAG = Effects(side_force=5e-3), Effects(linear_drag=2e-3)
WRAP, PUSH = Effects(friction_per_wrap=0.06), Effects(push=0.06)
CASES = [
    Case(radius=8e-3, frame_rate=240, quality=FINE, seed=801),
    Case(radius=8e-3, frame_rate=240, quality=FINE, hidden=SIDE, name="side_force", seed=802),
    Case(radius=8e-3, frame_rate=240, quality=FINE, caught=True, seed=803),
    Case(radius=8e-3, frame_rate=60, quality=COARSE, caught=True, hidden=SIDE, name="side_force", seed=804),
    Case(radius=5e-3, frame_rate=120, quality=COARSE, seed=805),
    Case(radius=15e-3, frame_rate=60, quality=FINE, seed=806),
    Case(radius=10e-3, frame_rate=120, quality=FINE, caught=True, seed=807),
    Case(radius=12e-3, frame_rate=240, quality=COARSE, hidden=DRAG, name="light_linear_drag", seed=808),
    Case(radius=5e-3, frame_rate=60, quality=FINE, hidden=PUSH, name="push_across", seed=809),
    Case(radius=10e-3, frame_rate=120, quality=FINE, hidden=WRAP, name="friction_per_wrap", seed=810),
    Case(radius=6e-3, frame_rate=240, quality=COARSE, caught=True, hidden=PUSH, name="push_across", seed=811),
    Case(radius=12e-3, frame_rate=60, quality=COARSE, seed=812),
    Case(radius=15e-3, frame_rate=240, quality=FINE, caught=True, hidden=DRAG, name="light_linear_drag", seed=813),
    Case(radius=7e-3, frame_rate=120, quality=COARSE, hidden=SIDE, name="side_force", seed=814),
]

REPEATED = "the first look takes pictures of this film for ones that are stored again"
WRONG = {
    804: "at 60 frames a second the catch is not named in two of the three films",
    805: REPEATED,
    807: REPEATED,
    808: "a swing of the heavy mass by 0.1 degrees is named beside the drag, by marks that drift by a tenth of a pixel",
    811: "the catch in the held-out film is not seen",
}
"""Seed of a case that is judged wrongly -> why."""


def study(folder, case):
    """Render three films, and write what somebody knows who measured the apparatus, but not the ball."""
    random = np.random.default_rng(case.seed)
    trials = []
    for name, heavy_mass, angle in TRIALS:
        angle += float(random.uniform(-2, 2))
        hanging = float(random.uniform(0.05, 0.09))
        caught = float(random.uniform(0.75, 0.85)) if case.caught else math.inf
        motion = looping_motion(
            1.5, case.hidden, heavy_mass=heavy_mass, release_angle=math.radians(angle), hanging_length=hanging
        )
        motion = until_ball_rests(motion, case.radius, caught)
        scene = Scene(
            before=0.15, duration=1.25, frame_rate=case.frame_rate, exposure=min(1e-3, 0.1 / case.frame_rate), hand=True,
            seed=int(random.integers(1, 2**31)), light_radius=case.radius, **case.quality,
        )  # fmt: skip
        render(folder / f"{name}.mp4", scene, motion)
        stated = angle + float(random.normal(0, 0.4))
        trials.append(
            f"- name: {name}\n  file: {name}.mp4\n  held_out: {str(name == 'c').lower()}\n"
            f"  heavy: {{mass: {1e3 * heavy_mass:g} g +/- 0.5 %}}\n"
            f"  release: {{angle: {stated:.2f} deg +/- 0.5 deg, free_length: 58 cm +/- 1 mm, hanging_length: 7 cm +/- 2 cm}}\n"
        )
    path = folder / "study.yaml"
    path.write_text(
        "title: balls\napparatus:\n  light: {mass: 10 g +/- 0.5 %}\n  rod: {radius: 6.25 mm +/- 1 %}\n"
        "effects: {gravity: 9.81 m/s^2, capstan: free, light_drag: free, heavy_drag: free, string_drag: free}\n"
        f"trials:\n{''.join(trials)}"
    )
    return load(path)


@pytest.mark.parametrize(
    "case",
    [pytest.param(c, marks=pytest.mark.xfail(reason=WRONG[c.seed]) if c.seed in WRONG else ()) for c in CASES],
    ids=str,
)
def test_a_ball_at_the_rod_and_a_catch_end_the_points_and_the_verdict_is_right(case, tmp_path):
    result = identify(study(tmp_path, case))
    named = [{e.name for e in one.effects} | ({"law"} if one.law else set()) for one in result.explanations if one.credible]
    why = "hand" if case.caught else "at the rod"
    assert any(why in line for line in result.data), result.data
    if case.name:
        assert {case.name} in named, result.sentence
    else:
        assert set() in named, result.sentence
        assert result.verdict in (Verdict.NO_MISSING_EFFECT, Verdict.AMBIGUOUS), result.sentence
    assert max(e.standardised_rms_after for e in result.errors) < 1.3
