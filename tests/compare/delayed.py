"""An engine whose error is known: it is the exact motion, late by ``offset + slope step^order``."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from looping_pendulum.engines.protocol import Abilities, Profile
from looping_pendulum.engines.reference import SUPPLIES
from looping_pendulum.engines.studies import Ladder, Studies, Variation
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.reference_ode.solve import solve_at
from looping_pendulum.runs.trajectory import SAMPLE_INTERVAL, Provenance, RunStatus, from_samples

STEPS = (8e-4, 4e-4, 2e-4, 1e-4)
"""[s]"""


@dataclass(frozen=True, kw_only=True)
class DelayedSettings:
    time_step: float = 4e-4
    order: float = 1.0
    slope: float = 0.5
    offset: float = 0.0
    """What no step takes away [s]."""
    jitter: float = 0.0
    """Delay that depends on the step and start without rule [s]."""
    steps: tuple[float, ...] = STEPS
    other_offset: float | None = None
    """Offset of another choice [s]; None: there is none."""


class DelayedEngine:
    name = "delayed"
    variant = "exact"
    profile = Profile.QUICK
    abilities = Abilities(
        releases=frozenset({Release.LOOPING}), supplies=SUPPLIES, packages=("numpy",), summary="The exact motion, late"
    )

    def __init__(self, **settings) -> None:
        self.settings = DelayedSettings(**settings)

    def delay(self, parameters) -> float:
        s = self.settings
        seed = hash((s.time_step, parameters.release_angle, parameters.free_length, parameters.hanging_length)) % 2**32
        return s.offset + s.slope * s.time_step**s.order + s.jitter * float(np.random.default_rng(seed).uniform(-1, 1))

    def simulate(self, scenario, record=None):
        t = np.arange(round(scenario.duration / SAMPLE_INTERVAL) + 1) * SAMPLE_INTERVAL
        asked = np.maximum(t - self.delay(scenario.parameters), 0.0)
        moved = solve_at(scenario.parameters, np.unique(asked))
        back = np.searchsorted(np.unique(asked), asked)
        parts = (moved.light_position, moved.light_velocity, moved.heavy_position, moved.heavy_velocity)
        rows = np.column_stack([t, *(part[back] for part in parts), np.zeros(len(t)), np.full(len(t), np.nan)])
        return from_samples(
            rows,
            parameters=scenario.parameters,
            engine=self.name,
            variant=self.variant,
            profile=self.profile.value,
            scenario=scenario.name,
            status=RunStatus.FINISHED,
            wall_time=1e-4 / self.settings.time_step,
            provenance=Provenance(versions={}, settings=dataclasses.asdict(self.settings), supplies=SUPPLIES),
        )

    def with_settings(self, **changes) -> DelayedEngine:
        return DelayedEngine(**(dataclasses.asdict(self.settings) | changes))

    def studies(self) -> Studies:
        other = self.settings.other_offset
        return Studies(
            ladders=(Ladder("time_step", "s", self.settings.steps),),
            defaults=(Variation("step", "0.4 ms", "0.8 ms", {"time_step": 8e-4}, "lateness"),),
            choices=() if other is None else (Variation("when it starts", "now", "then", {"offset": other}),),
        )
