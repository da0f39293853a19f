"""Make the two filmed trials of the example folder that `looping-pendulum init` puts in place.

    python -m scripts.make_example_trials

from the project's folder writes looping_pendulum/teaching/example/trials; `--out DIR` elsewhere. The trials come from the
simulator and the camera of `tests/blind`, which share no equation with the package: 240 frames a second, 1 mm noise, blur,
missing marks. The study file beside them does not declare the effect `HIDDEN`.
"""

import argparse
import math
from pathlib import Path

import numpy as np

from tests.blind import Apparatus, Effects
from tests.blind.camera import Camera, film, tracker_csv
from tests.blind.simulator import simulate

HIDDEN = Effects(side_force=5e-3)
"""A steady sideways force on the light mass, half a gram's weight."""
TRIALS = {"first": Apparatus(), "second": Apparatus(heavy_mass=0.060, release_angle=math.radians(104))}
"""Name of a trial -> its apparatus; the study fits the first and holds the second out."""
DURATION = 1.0
"""Filmed time [s]."""
SEED = 7
FOLDER = Path(__file__).parents[1] / "looping_pendulum" / "teaching" / "example" / "trials"


def main() -> None:
    """Write a Tracker export per trial."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, default=FOLDER)
    folder: Path = parser.parse_args().out
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in trials().items():
        (folder / f"{name}.csv").write_text(text, encoding="utf-8")


def trials() -> dict[str, str]:
    """Return name of a trial -> the text of its Tracker export."""
    rng = np.random.default_rng(SEED)
    return {
        name: tracker_csv(
            film(simulate(a, HIDDEN, duration=DURATION), Camera(), rng, duration=DURATION), names=("light", "heavy")
        )
        for name, a in TRIALS.items()
    }


if __name__ == "__main__":
    main()
