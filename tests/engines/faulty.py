"""Engines that misbehave on purpose; in a module of their own, so that they travel to their process as pickles."""

from __future__ import annotations

import ctypes
import math
import os
import time
from dataclasses import dataclass

from looping_pendulum.engines.protocol import SAMPLE_INTERVAL, Abilities, Profile, SteppedEngine
from looping_pendulum.engines.reference import SUPPLIES
from looping_pendulum.reference_ode.parameters import Release

FAULT_AT = 0.02
"""Simulated time of the fault [s]."""


@dataclass(frozen=True, kw_only=True)
class FaultSettings:
    fault: str
    time_step: float = SAMPLE_INTERVAL


class FaultyEngine(SteppedEngine):
    """Hangs the light mass still in the air until the fault comes."""

    name = "faulty"
    profile = Profile.QUICK

    def __init__(self, fault: str, packages: tuple[str, ...] = ("numpy",)) -> None:
        self.variant = fault
        self.settings = FaultSettings(fault=fault)
        self.abilities = Abilities(
            releases=frozenset({Release.LOOPING}), supplies=SUPPLIES, packages=packages, summary="misbehaves"
        )

    def versions(self):
        return {"numpy": "?"}

    def build(self, scenario):
        if self.variant == "raises":
            raise ValueError("no rod today")
        return FaultyRig(self.variant)


class FaultyRig:
    def __init__(self, fault: str) -> None:
        self.fault, self.time = fault, 0.0

    def advance(self):
        self.time += SAMPLE_INTERVAL
        if self.time < FAULT_AT:
            return
        if self.fault == "segfault":
            ctypes.string_at(0)
        if self.fault == "exit":
            os._exit(3)
        if self.fault == "hang":
            time.sleep(3600)

    def read(self):
        if self.fault == "prints" and self.time == 0:
            print("chatter on stdout")  # noqa: T201
        x = math.nan if self.fault == "nan" and self.time >= FAULT_AT else -0.4
        stretch = 1.0 if self.fault == "stretches" and self.time >= FAULT_AT else 0.0
        return (x, -0.4, 0.0, 0.0, 0.00625, -0.03, 0.0, 0.0, stretch)
