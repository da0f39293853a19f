"""Make the two filmed trials of the example folder that `looping-pendulum init` puts in place.

    python -m scripts.make_example_trials

from the project's folder writes looping_pendulum/teaching/example/trials; `--out DIR` elsewhere. The trials come from the
simulator and the camera of `tests/blind`, which share no equation with the package: 240 frames a second, 1 mm noise, blur,
missing marks. What the study file beside them does not tell is `HIDDEN`.
"""

from __future__ import annotations

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
"""The first is fitted, the second is held out."""
FILMED = 1.0
"""[s]"""
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
    """Name of a trial -> its Tracker export."""
    rng = np.random.default_rng(SEED)
    return {
        name: tracker_csv(film(simulate(a, HIDDEN, duration=FILMED), Camera(), rng, duration=FILMED), names=("light", "heavy"))
        for name, a in TRIALS.items()
    }


if __name__ == "__main__":
    main()
