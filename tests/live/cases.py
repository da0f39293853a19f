"""Random apparatuses of the live page, and what its scripts are asked of them."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from looping_pendulum.live.write import live_settings
from looping_pendulum.reference_ode.parameters import Parameters, Release

DURATION = 5.0
FRACTIONS = np.linspace(0.0, 1.0, 101)
"""Fractions of the reference's end time at which the paths are compared."""
OF_FURTHER_EFFECTS = {
    "light_linear_drag": (0.0, 0.01),
    "heavy_linear_drag": (0.0, 0.05),
    "wind_speed": (-2.0, 2.0),
    "side_force": (-0.02, 0.02),
    "push_across": (-1.0, 1.0),
    "push_along": (-1.0, 1.0),
}
"""Coefficient -> range; in every third apparatus each is there or not."""
_RUN_CASE, _BITS_OF = (
    Path(__file__).with_name(name).read_text(encoding="utf-8").replace("export ", "")
    for name in ("run_case.mjs", "bits_of.mjs")
)
IN_PAGE = {
    "run_cases.mjs": f"(cases) => {{ {_RUN_CASE} return cases.map((item) => runCase(loopingPendulum.simulate, item)); }}",
    "bits.mjs": f"""async (jobs) => {{
      {_BITS_OF}
      const results = [];
      for (const job of jobs) results.push(await bitsOf(loopingPendulum.Core, loopingPendulum.DRIVER, job));
      return results;
    }}""",
}
"""Module for Node -> the function of a page, in which the script is, that does the same."""
RELEASES = (*Release, Release.LOOPING, Release.LOOPING)
"""Releases of successive threes; half of all are looping ones."""


def random_apparatus(rng: np.random.Generator, place: int) -> Parameters:
    """Return an apparatus within the ranges of the page's sliders; every third has some of the further effects."""
    light_mass = math.exp(rng.uniform(math.log(0.005), 0.0))
    friction = rng.uniform(0.0, 0.8)
    coefficients = {
        "kinetic_friction": friction,
        "static_friction": friction * rng.uniform(1.0, 1.5),
        # From none to several times those of the shipped scenarios
        "light_drag": rng.uniform(0.0, 3e-3),
        "heavy_drag": rng.uniform(0.0, 3e-3),
        "string_drag": rng.uniform(0.0, 2e-2),
    }
    if place % 3 == 2:
        coefficients |= {name: rng.uniform(*bounds) for name, bounds in OF_FURTHER_EFFECTS.items() if rng.random() < 0.5}
    return Parameters(
        light_mass=light_mass,
        heavy_mass=light_mass * rng.uniform(1.0, 30.0),
        rod_radius=rng.uniform(0.002, 0.03),
        free_length=rng.uniform(0.1, 1.5),
        release_angle=math.radians(rng.uniform(20.0, 170.0)),
        hanging_length=rng.uniform(0.02, 0.2),
        release=RELEASES[place // 3 % len(RELEASES)],
        coefficients=coefficients,
    )


def case_of(p: Parameters, end_time: float) -> dict[str, Any]:
    """Return the case that the JavaScript is to run."""
    return {"settings": live_settings(p), "duration": DURATION, "times": (FRACTIONS * end_time).tolist()}
