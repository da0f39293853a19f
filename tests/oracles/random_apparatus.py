"""Random apparatus: of the paper's model, and of any release with any effects."""

import math

import numpy as np

from looping_pendulum.reference_ode.effects import EFFECTS
from looping_pendulum.reference_ode.parameters import Parameters, Release, is_possible
from tests.reference_ode.test_effects import TYPICAL

FURTHER = tuple(name for name in TYPICAL if not name.startswith("push"))
"""Effects beyond the paper's model and the pushes, which every draw may have."""


def of_papers_model(seed: int) -> Parameters:
    """Return an apparatus of the paper's model, pushed or not."""
    return _apparatus(np.random.default_rng([1, seed]), Release.LOOPING, {})


def of_any_kind(seed: int) -> Parameters:
    """Return an apparatus with one to three further effects and any release; of 22 in a row each effect is the first of one."""
    rng = np.random.default_rng([2, seed])
    names = [FURTHER[seed % len(FURTHER)], *rng.choice(FURTHER, rng.integers(0, 3))]
    first = EFFECTS[names[0]]
    releases = [r for r in (Release.LOOPING, Release.HELD, Release.VERTICAL, Release.DROP) if is_possible(first, r)]
    release = releases[0] if rng.random() < 0.6 else rng.choice(releases)
    coefficients = {}
    for name in names:
        if is_possible(EFFECTS[name], release):
            for coefficient, typical in TYPICAL[name].items():
                is_switch = coefficient.startswith(("closure_of", "closure_by", "closure_scale"))
                coefficients[coefficient] = typical * (1.0 if is_switch else rng.uniform(0.3, 2.0))
    return _apparatus(rng, release, coefficients)


def _apparatus(rng: np.random.Generator, release: Release, coefficients: dict[str, float]) -> Parameters:
    light_mass = 10 ** rng.uniform(-2.3, -1.3)
    friction = rng.uniform(0.0, 0.8)
    usual = {
        "kinetic_friction": friction,
        "static_friction": friction * rng.choice([1.0, 1.0, 1.3]),
        "light_drag": rng.uniform(0.0, 2e-3),
        "heavy_drag": 10 ** rng.uniform(-5, -2) if rng.random() < 0.8 else rng.uniform(0.05, 1.0),  # so strong: slack
        "string_drag": rng.uniform(0.0, 1e-3),
        "push_across": rng.choice([0.0, rng.uniform(-2.0, 2.0)]),
        "push_along": rng.choice([0.0, 0.0, rng.uniform(-1.0, 1.0)]),
    }
    return Parameters(
        light_mass=light_mass,
        heavy_mass=light_mass * 10 ** rng.uniform(0.0, 1.5),
        rod_radius=10 ** rng.uniform(-2.7, -1.7),
        free_length=rng.uniform(0.2, 1.2),
        release_angle=math.radians(rng.uniform(12.0, 178.0)),
        hanging_length=rng.uniform(0.02, 0.5),
        light_radius=rng.choice([0.0, 0.01]),
        release=release,
        coefficients=usual | coefficients,
    )
