"""An engine whose numbers depend on its release, in a module of its own, so that it can be pickled for its process."""

import math
import os
import shlex
import sys
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from looping_pendulum.engines.protocol import SAMPLE_INTERVAL, Abilities, Profile, SteppedEngine
from looping_pendulum.engines.reference import SUPPLIES
from looping_pendulum.reference_ode.geometry import light_position
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.releases.installers import ReleaseError

ACCELERATION = 1.0
"""Of the heavy mass [m/s^2]: enough for the static capstan test to call it sliding."""
SHIFT = 0.01
"""How far release 3.0 and later hold the light mass from where the others do [m]."""


@dataclass(frozen=True, kw_only=True)
class ReleasedSettings:
    time_step: float = SAMPLE_INTERVAL


class ReleasedEngine(SteppedEngine):
    """Holds the light mass and lets the heavy one fall; release 2.0 raises, and 2.5 does so but with an older NumPy."""

    name, variant, profile = "released", "only", Profile.QUICK
    distribution = "released-engine"

    def __init__(self) -> None:
        self.settings = ReleasedSettings()
        self.abilities = Abilities(
            releases=frozenset({Release.LOOPING}), supplies=SUPPLIES, packages=("released",), summary="follows its release"
        )

    def versions(self):
        return {"released-engine": os.environ["FAKE_RELEASE"]}

    def build(self, scenario):
        release, numpy = os.environ["FAKE_RELEASE"], os.environ["FAKE_NUMPY"]
        if release == "2.0" or (release == "2.5" and numpy != "numpy<2"):
            raise ValueError("no rod\nin this release")
        return HeldRig(scenario.parameters, SHIFT if release >= "3" else 0.0)


class HeldRig:
    def __init__(self, parameters, shift: float) -> None:
        self.parameters, self.shift, self.time = parameters, shift, 0.0

    def advance(self):
        self.time += SAMPLE_INTERVAL

    def read(self):
        p, t = self.parameters, self.time
        x, y = light_position(math, p.free_length, p.release_angle, p.rod_radius)
        height = -p.hanging_length - 0.5 * ACCELERATION * t * t
        return (x + self.shift, y, 0.0, 0.0, p.rod_radius, height, 0.0, -ACCELERATION * t, 0.0)


class FakeInstaller:
    """Makes "environments" of this Python that say which release they are; release 1.0 has no wheel."""

    def __init__(self) -> None:
        self.made: list[tuple[str, ...]] = []

    def __call__(self, folder: Path, requirements: Sequence[str], cancelled: threading.Event) -> str:
        self.made.append(tuple(requirements))
        release = requirements[0].partition("==")[2]
        if release == "1.0":
            raise ReleaseError("released-engine==1.0 has no usable wheels")
        folder.mkdir(parents=True)
        python = folder / "python"
        words = (f"FAKE_RELEASE={release}", f"FAKE_NUMPY={shlex.quote(requirements[1])}", "exec", shlex.quote(sys.executable))
        python.write_text(f'#!/bin/sh\n{" ".join(words)} "$@"\n')
        python.chmod(0o755)
        return str(python)
