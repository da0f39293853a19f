"""Studies of three rendered films of a ball that winds up to the rod, or is caught in mid-air."""

import hashlib
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.blind import Effects
from tests.measured.film.renderer import Scene, looping_motion, render, until_ball_rests

QUALITIES = {"fine": {"crf": 23, "noise": 1.0}, "coarse": {"crf": 28, "noise": 1.5}}
TRIALS = (("a", 0.1, 114.0), ("b", 0.14, 105.0), ("c", 0.12, 96.0))
"""Name, heavy mass [kg] and angle of the release [deg] of the two fitted trials and of the one held out."""
HIDDEN = {
    "side_force": Effects(side_force=5e-3),
    "light_linear_drag": Effects(linear_drag=2e-3),
    "friction_per_wrap": Effects(friction_per_wrap=0.06),
    "push_across": Effects(push=0.06),
}
"""Name of an effect in the library -> what nobody declared."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """Three films of one ball, and what nobody declared of them."""

    seed: int
    radius: float
    """[m]"""
    frame_rate: float
    quality: str = "fine"
    caught: tuple[float, float] | None = None
    """Times between which a hand catches the ball in each film [s]; None: it winds up to the rod."""
    stopping: float = 0.01
    """Time in which the hand stops it [s]."""
    windings: float = 0.0
    """Height of the string's windings on the rod, on which the ball comes to rest [m]."""
    hidden: str | None = None
    """Key of `HIDDEN`."""

    def __str__(self) -> str:
        """Return a test's name."""
        end = "caught" if self.caught else "wound"
        return f"{self.seed}-{1e3 * self.radius:g}mm-{self.frame_rate:g}-{self.quality}-{end}-{self.hidden or 'clean'}"


def drawn(seed: int) -> Case:
    """Return a case whose every property is drawn."""
    random = np.random.default_rng(seed)
    is_caught = bool(random.random() < 0.4)
    return Case(
        seed=seed,
        radius=round(float(random.uniform(5e-3, 15e-3)), 4),
        frame_rate=float(random.choice([60, 120, 240])),
        quality=str(random.choice(list(QUALITIES))),
        caught=(0.5, 0.75) if is_caught else None,
        stopping=float(np.exp(random.uniform(np.log(5e-3), np.log(0.08)))),
        windings=0.0 if is_caught else float(random.choice([0, 1])) * float(random.uniform(0.5e-3, 2e-3)),
        hidden=None if random.random() < 0.4 else str(random.choice(list(HIDDEN))),
    )


LATE = (0.75, 0.85)
CASES = [
    Case(seed=801, radius=8e-3, frame_rate=240),
    Case(seed=802, radius=8e-3, frame_rate=240, hidden="side_force"),
    Case(seed=803, radius=8e-3, frame_rate=240, caught=LATE),
    Case(seed=804, radius=8e-3, frame_rate=60, quality="coarse", caught=LATE, hidden="side_force"),
    Case(seed=805, radius=5e-3, frame_rate=120, quality="coarse"),
    Case(seed=806, radius=15e-3, frame_rate=60),
    Case(seed=807, radius=10e-3, frame_rate=120, caught=LATE),
    Case(seed=808, radius=12e-3, frame_rate=240, quality="coarse", hidden="light_linear_drag"),
    Case(seed=809, radius=5e-3, frame_rate=60, hidden="push_across"),
    Case(seed=810, radius=10e-3, frame_rate=120, hidden="friction_per_wrap"),
    Case(seed=811, radius=6e-3, frame_rate=240, quality="coarse", caught=LATE, hidden="push_across"),
    Case(seed=812, radius=12e-3, frame_rate=60, quality="coarse"),
    Case(seed=813, radius=15e-3, frame_rate=240, caught=LATE, hidden="light_linear_drag"),
    Case(seed=814, radius=7e-3, frame_rate=120, quality="coarse", hidden="side_force"),
    *(drawn(seed) for seed in range(815, 841)),
]


def rendered(cache, case):
    """Return the folder of a case's films, which are made once by the same sources."""
    here = Path(__file__)
    sources = here, here.parent / "renderer.py", here.parents[2] / "blind/simulator.py"
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()[:12]
    folder = Path(cache) / digest / str(case)
    if not (folder / "study.yaml").exists():
        folder.mkdir(parents=True, exist_ok=True)
        films(folder, case)
    return folder


def films(folder, case):
    """Render three films, and write what somebody knows who measured the apparatus, but not the ball."""
    random = np.random.default_rng(case.seed)
    trials = []
    for name, heavy_mass, angle in TRIALS:
        angle += float(random.uniform(-2, 2))
        hanging = float(random.uniform(0.05, 0.09))
        caught = float(random.uniform(*case.caught)) if case.caught else math.inf
        motion = looping_motion(
            1.5, HIDDEN.get(case.hidden), heavy_mass=heavy_mass, release_angle=math.radians(angle), hanging_length=hanging
        )
        motion = until_ball_rests(motion, case.radius + case.windings, caught, case.stopping)
        scene = Scene(
            before=0.15, duration=1.25, frame_rate=case.frame_rate, exposure=min(1e-3, 0.1 / case.frame_rate), hand=True,
            seed=int(random.integers(1, 2**31)), light_radius=case.radius, **QUALITIES[case.quality],
        )  # fmt: skip
        render(folder / f"{name}.mp4", scene, motion)
        stated = angle + float(random.normal(0, 0.4))
        trials.append(
            f"- name: {name}\n  file: {name}.mp4\n  held_out: {str(name == 'c').lower()}\n"
            f"  heavy: {{mass: {1e3 * heavy_mass:g} g +/- 0.5 %}}\n"
            f"  release: {{angle: {stated:.2f} deg +/- 0.5 deg, free_length: 58 cm +/- 1 mm, hanging_length: 7 cm +/- 2 cm}}\n"
        )
    (folder / "study.yaml").write_text(
        "title: balls\napparatus:\n  light: {mass: 10 g +/- 0.5 %}\n  rod: {radius: 6.25 mm +/- 1 %}\n"
        "effects: {gravity: 9.81 m/s^2, capstan: free, light_drag: free, heavy_drag: free, string_drag: free}\n"
        f"trials:\n{''.join(trials)}"
    )
