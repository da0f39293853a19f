"""Engines that misbehave on purpose, in a module of their own, so that they can be pickled for their process."""

import contextlib
import ctypes
import math
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest

from looping_pendulum.engines import other_packages, registry
from looping_pendulum.engines.protocol import Abilities, Profile, SteppedEngine
from looping_pendulum.engines.reference import SUPPLIES
from looping_pendulum.errors import EngineError
from looping_pendulum.processes import ProcessTree
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.runs.trajectory import SAMPLE_INTERVAL

FAULT_AT = 0.02
"""Simulated time of the fault [s]."""

HOARD = 310 * 2**20
"""Memory that the fault "memory" comes to hold [bytes], a little above the limit that tests set."""


@dataclass(frozen=True, kw_only=True)
class FaultSettings:
    fault: str
    time_step: float = SAMPLE_INTERVAL


class FaultyEngine(SteppedEngine):
    """Holds the light mass at rest until the time of the fault."""

    name = "faulty"
    profile = Profile.QUICK

    def __init__(
        self, fault: str, packages: tuple[str, ...] = ("numpy",), releases=frozenset({Release.LOOPING}), main: bool = True
    ) -> None:
        self.variant = fault
        self.settings = FaultSettings(fault=fault)
        self.abilities = Abilities(releases=releases, supplies=SUPPLIES, packages=packages, summary="misbehaves", main=main)

    def versions(self):
        return {"numpy": "?"}

    def simulate(self, scenario, record=None):
        run = super().simulate(scenario, record)
        if self.variant == "returns_nan":
            run.light_position[round(FAULT_AT * 1000) :] = math.nan
        if self.variant == "leaves_child":
            print(subprocess.Popen(["sleep", "600"], start_new_session=True).pid, flush=True)  # noqa: T201
        return None if self.variant == "returns_nothing" else run

    def build(self, scenario):
        if self.variant == "raises":
            raise ValueError("no rod today")
        return FaultyRig(self.variant)


class FaultyRig:
    def __init__(self, fault: str) -> None:
        self.fault, self.time = fault, 0.0
        self.hoard: list[bytes] = []

    def advance(self):
        self.time += SAMPLE_INTERVAL
        if self.time < FAULT_AT:
            return
        if self.fault == "gives_up":
            raise EngineError("found a wrap of 181 deg, needed at most 180")
        if self.fault == "segfault":
            ctypes.string_at(0)
        if self.fault == "exit":
            os._exit(3)
        if self.fault == "hang_after_print":
            print("chatter" * 100, flush=True)  # noqa: T201
        if self.fault == "hang_with_child":
            print(subprocess.Popen(["sleep", "600"]).pid, flush=True)  # noqa: T201
        if self.fault == "hang_with_children":
            subprocess.Popen(["sleep", "600"])
            subprocess.Popen(["sleep", "600"], start_new_session=True)  # left the engine's group
        if self.fault.startswith("hang"):
            time.sleep(3600)
        while self.fault == "memory" and ProcessTree(os.getpid()).memory() < HOARD:
            self.hoard.append(os.urandom(1) * 2**24)
        if self.fault == "memory":
            time.sleep(3600)

    def read(self):
        if self.fault == "prints" and self.time == 0:
            print("chatter on stdout")  # noqa: T201
        if self.fault == "prints_from_c" and self.time == 0:
            os.write(1, b"chatter on fd 1\n")
            ctypes.CDLL(None).printf(b"chatter of printf\n")
            ctypes.CDLL(None).fflush(None)
        faults = {"nan": math.nan, "flies_off": 1e11}
        x = faults.get(self.fault, -0.4) if self.time >= FAULT_AT else -0.4
        stretch = 1.0 if self.fault == "stretches" and self.time >= FAULT_AT else 0.0
        return (x, -0.4, 0.0, 0.0, 0.00625, -0.03, 0.0, 0.0, stretch, math.nan)


def alive(pid):
    done = subprocess.run(["ps", "-o", "stat=", "-p", str(pid)], capture_output=True, text=True)
    return bool(done.stdout.strip()) and not done.stdout.startswith("Z")


def forget_adapters() -> None:
    """Let the next question for engines look for adapters anew, and import those of other packages anew."""
    registry.adapter_modules.cache_clear()
    other_packages.DESCRIBED.clear()


def adapter_of(*engines: str) -> str:
    """Return the source of an adapter that offers ``engines``, Python expressions."""
    return (
        "from looping_pendulum.reference_ode.parameters import Release\n"
        "from tests.engines.faulty import FaultyEngine\n"
        f"def engines(profile):\n    return [{', '.join(engines)}]\n"
    )


@contextlib.contextmanager
def adapters_of_another_package(folder: Path, sources: Mapping[str, str | None]) -> Iterator[None]:
    """Install adapters, name -> source of its module (None: it has none), as the entry points of the package "elsewhere"."""
    modules = {name: f"adapter_{name}" for name in sources}
    info = folder / "elsewhere-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: elsewhere\nVersion: 1.0\n")
    points = "".join(f"{name} = {module}\n" for name, module in modules.items())
    (info / "entry_points.txt").write_text(f"[{registry.ENTRY_POINTS}]\n{points}")
    for name, source in sources.items():
        if source is not None:
            (folder / f"{modules[name]}.py").write_text(source)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        forget_adapters()
        yield
    forget_adapters()
    for module in modules.values():
        sys.modules.pop(module, None)
