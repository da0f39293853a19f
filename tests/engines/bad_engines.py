"""Engines that do one bad thing each, as a table: what each does, and what its row is to say.

They are offered as another package's adapter, so a command finds them by their names, "bad:exits" for example.
"""

import contextlib
import ctypes
import json
import math
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import warnings
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from looping_pendulum.engines.protocol import Abilities, SteppedEngine
from looping_pendulum.engines.reference import SUPPLIES
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.runs.trajectory import RunStatus

MEMORY_LIMIT = 200 * 2**20
"""What a run may hold in the test [bytes]."""


class OddEndingError(BaseException):
    """No subclass of `Exception`."""


def wait(engine):
    time.sleep(3600)


def ends_by(number):
    return lambda engine: os.kill(os.getpid(), number)


def raises(error):
    def act(engine):
        raise error

    return act


def recurses(engine):
    return recurses(engine)


def spins(engine):
    while True:
        pass


def holds_the_interpreter(engine):
    """Sleep in C without letting any other thread of Python run."""
    ctypes.PyDLL(None).sleep(3600)


def ignores_signals(engine):
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    wait(engine)


HOARD = f"import time; block = b'x' * {MEMORY_LIMIT}; time.sleep(3600)"


def child_hoards(engine):
    subprocess.Popen([sys.executable, "-c", HOARD])
    wait(engine)


def hidden_child_hoards(engine):
    """Start a process in a session of its own, with an empty environment, that has lost its parent."""
    hide(HOARD)
    wait(engine)


def hide(code):
    starts = f"import subprocess, sys; subprocess.Popen([sys.executable, '-c', {code!r}], env={{}}, start_new_session=True)"
    subprocess.run([sys.executable, "-c", starts], env={}, start_new_session=True)


LEFT = "3600.0102"
"""Word on the command line of a process that an engine leaves behind: how long it sleeps [s]."""


def leaves_a_hidden_child(engine):
    subprocess.run(["sh", "-c", f"setsid env -i {shutil.which('sleep')} {LEFT} &"])


def leaves_a_hidden_child_and_crashes(engine):
    leaves_a_hidden_child(engine)
    time.sleep(1)  # long enough to be seen once
    os._exit(1)


def leaves_a_thread(engine):
    threading.Thread(target=time.sleep, args=(3600,)).start()


def forks(engine):
    os.fork()


def prints(engine):
    for _ in range(400):
        os.write(1, b"chatter\n" * 10_000)


def prints_escapes(engine):
    os.write(1, b"\x1b[2J\xff\x00" * 100)


def closes_files(engine):
    os.closerange(0, 100)


def deletes_its_folder(engine):
    shutil.rmtree(tempfile.gettempdir())


def fills_its_folder(engine):
    """Write a file of two gigabytes that takes no disk."""
    with Path(tempfile.gettempdir(), "large").open("wb") as file:
        file.truncate(2**31)
    wait(engine)


def plants_a_record(engine):
    Path(tempfile.gettempdir(), "run.json").write_text("{half a reco")
    os._exit(0)


def plants_samples(engine):
    Path(tempfile.gettempdir(), "samples.bin").write_bytes(os.urandom(10_000))
    os._exit(0)


def makes_json_fail(engine):
    json.dumps = None


def makes_open_fail(engine):
    os.open = Path.open = Path.write_text = Path.write_bytes = None


def sets_a_low_recursion_limit(engine):
    with contextlib.suppress(RecursionError):
        sys.setrecursionlimit(40)


def sets_alarm(engine):
    signal.alarm(1)
    wait(engine)


def changed(**changes):
    """Return a function that changes fields of a run, each by a function of the run."""
    return lambda run: replace(run, **{name: change(run) for name, change in changes.items()})


def scaled(factor):
    return changed(**{
        name: lambda run, name=name: factor * getattr(run, name)
        for name in ("light_position", "light_velocity", "heavy_position", "heavy_velocity")
    })  # fmt: skip


def filled(name, value):
    return changed(**{name: lambda run: np.full_like(getattr(run, name), value)})


ROW = (-0.4, -0.4, 0.0, 0.0, 0.00625, -0.03, 0.0, 0.0, 0.0, math.nan)
"""Sample of a light mass at rest, without its time."""


def records(*rows):
    """Return a function that records samples and dies."""

    def act(engine):
        for row in rows:
            engine.record(row)
        os._exit(1)

    return act


GOES = ("FINISHED",)
BEFORE = {
    # It ends
    "exits": (lambda engine: os._exit(0), ("CRASHED",), "ended without a result"),
    "sys_exit": (raises(SystemExit(0)), ("FAILED",), "SystemExit: 0"),
    "interrupts": (raises(KeyboardInterrupt()), ("FAILED",), "KeyboardInterrupt"),
    "base_exception": (raises(OddEndingError("odd")), ("FAILED",), "OddEndingError: odd"),
    "raises_a_page": (raises(ValueError("no\nrod " * 10_000)), ("FAILED",), "ValueError: no rod no"),
    "raises_surrogates": (raises(ValueError("\udcff\x1b[2J")), ("FAILED",), "ValueError"),
    "stop_iteration": (raises(StopIteration()), ("FAILED",), "StopIteration"),
    "recurses": (recurses, ("FAILED",), "RecursionError"),
    "aborts": (lambda engine: os.abort(), ("CRASHED",), "SIGABRT"),
    "kills_itself": (ends_by(signal.SIGKILL), ("CRASHED",), "SIGKILL"),
    "alarm": (sets_alarm, ("CRASHED",), "SIGALRM"),
    # It does not end
    "spins": (spins, ("TIME_LIMIT",), "limit 6 s"),
    "stops_itself": (ends_by(signal.SIGSTOP), ("TIME_LIMIT",), "limit 6 s"),
    "holds_the_interpreter": (holds_the_interpreter, ("TIME_LIMIT",), "limit 6 s"),
    "ignores_signals": (ignores_signals, ("TIME_LIMIT",), "limit 6 s"),
    # It takes what it can
    "child_hoards": (child_hoards, ("MEMORY_LIMIT",), "limit 200 MiB"),
    "hidden_child_hoards": (hidden_child_hoards, ("MEMORY_LIMIT",), "limit 200 MiB"),
    "fills_its_folder": (fills_its_folder, ("DISK_LIMIT",), "held 2 GiB, limit 1 GiB"),
    "deletes_its_folder": (deletes_its_folder, GOES, ""),
    "closes_files": (closes_files, ("FAILED", "CRASHED"), ""),
    "plants_a_record": (plants_a_record, ("FAILED",), "simulate returned a record"),
    "plants_samples": (plants_samples, ("CRASHED",), "ended without a result"),
    "makes_json_fail": (makes_json_fail, ("FAILED",), "TypeError"),
    "makes_open_fail": (makes_open_fail, ("CRASHED",), "exit status 1"),
    # It leaves something behind, and its run is as good as any
    "leaves_a_hidden_child": (leaves_a_hidden_child, GOES, ""),
    "leaves_a_hidden_child_and_crashes": (leaves_a_hidden_child_and_crashes, ("CRASHED",), "exit status 1"),
    "leaves_a_thread": (leaves_a_thread, GOES, ""),
    # Both processes record to one file, so a time may fall
    "forks": (forks, (*GOES, "FAILED"), ""),
    "prints": (prints, GOES, ""),
    "prints_escapes": (prints_escapes, GOES, ""),
    "closes_stdout": (lambda engine: (sys.stdout.close(), os.close(1), os.close(2)), GOES, ""),
    "changes_folder": (lambda engine: os.chdir("/"), GOES, ""),
    "handles_signals": (lambda engine: signal.signal(signal.SIGTERM, signal.SIG_IGN), GOES, ""),
    "warns": (lambda engine: warnings.warn("odd", UserWarning, stacklevel=1), GOES, ""),
    "empties_environment": (lambda engine: os.environ.clear(), GOES, ""),
    "low_recursion_limit": (sets_a_low_recursion_limit, (*GOES, "FAILED", "CRASHED"), ""),
    # What it recorded before it died is garbage from some sample on
    "records_a_garbage_time": (records((0.0, *ROW), (1e300, *ROW)), ("CRASHED",), "exit status 1"),
    "records_falling_times": (records((0.002, *ROW), (0.001, *ROW)), ("CRASHED",), "exit status 1"),
    "records_huge_numbers": (records(*((k * 1e-3, *[1e308] * 10) for k in range(40))), ("CRASHED",), "exit status 1"),
    "records_nan": (records(*((k * 1e-3, *[math.nan] * 10) for k in range(40))), ("CRASHED",), "exit status 1"),
    "records_short_rows": (records((0.0, 1.0)), ("FAILED",), "found 2 values"),
}
"""Engine -> what it does before its run, statuses that its row may have, and what its sentence holds."""

AFTER = {
    # Garbage in the right shape
    "huge": (filled("light_position", 1e308), ("NOT_FINITE",), ""),
    "huge_velocities": (filled("light_velocity", 1e308), GOES, ""),
    "huge_stretch": (filled("string_stretch", -1e308), GOES, ""),
    "zeros": (scaled(0.0), GOES, ""),
    "millimetres": (scaled(1e3), GOES, ""),
    "upside_down": (scaled(-1.0), GOES, ""),
    "tiny": (scaled(1e-300), GOES, ""),
    # Times, shapes and types; for those of single fields see test_isolation.py
    "times_huge": (changed(t=lambda run: 1e300 * run.t), ("FAILED",), "needed rising times"),
    "wrong_shape": (changed(heavy_position=lambda run: run.heavy_position[:-1]), ("FAILED",), r"shape \(50, 2\)"),
    "complex": (changed(light_position=lambda run: 1j * run.light_position), ("FAILED",), "complex128"),
    "no_samples": (changed(t=lambda run: None), ("FAILED",), "returned t"),
    "unknown_mode": (changed(mode=lambda run: np.full(len(run.t), 77)), ("FAILED",), "found 77"),
    "none": (lambda run: None, ("FAILED",), "needed a Trajectory"),
    "dict": (vars, ("FAILED",), "returned dict, needed a Trajectory"),
    "claims_to_be_missing": (changed(status=lambda run: RunStatus.MISSING), ("FAILED",), "found MISSING, needed none of"),
    "claims_to_be_interrupted": (
        changed(status=lambda run: RunStatus.INTERRUPTED),
        ("FAILED",),
        "found INTERRUPTED, needed none of",
    ),
    "odd_settings": (changed(provenance=lambda run: replace(run.provenance, settings={"odd": object()})), GOES, ""),
}
"""Engine -> what it makes of a good run, statuses that its row may have, and what its sentence holds."""


@dataclass(frozen=True, kw_only=True)
class Settings:
    time_step: float = 1e-3


class RestingRig:
    """A light mass that rests."""

    def advance(self):
        pass

    def read(self):
        return ROW


class BadEngine(SteppedEngine):
    name = "bad"
    settings = Settings()

    def __init__(self, variant, profile):
        self.variant, self.profile = variant, profile
        self.abilities = Abilities(
            releases=frozenset(Release), supplies=SUPPLIES, packages=(), summary="does one bad thing", main=False
        )

    def build(self, scenario):
        return RestingRig()

    def versions(self):
        return {}

    def simulate(self, scenario, record=None):
        self.record = record
        if self.variant in BEFORE:
            BEFORE[self.variant][0](self)
        run = super().simulate(scenario, record)
        return AFTER[self.variant][0](run) if self.variant in AFTER else run


class GoodEngine(BadEngine):
    name = "good"
    variant = "rest"


def engines(profile):
    return [BadEngine(variant, profile) for variant in (BEFORE | AFTER)]


# ---- adapters that are bad already when they are imported, or when they are asked for their engines


ADAPTERS = {
    "exits": ("import os; os._exit(0)", "its import ended: exit status 0"),
    "hangs": ("import time; time.sleep(3600)", "limit on time of 10 s"),
    "crashes": ("import ctypes; ctypes.string_at(0)", "killed by signal SIGSEGV"),
    "interrupts": ("raise KeyboardInterrupt", "KeyboardInterrupt"),
    "syntax": ("def", "SyntaxError"),
    "hoards": ("import time; block = b'x' * 2**28; time.sleep(3600)", "limit on memory of 200 MiB"),
    "no_list": ("def engines(profile): return None", "engines() gave NoneType, needed a list of engines"),
    "no_engine": ("def engines(profile): return []", "engines() gave no engine"),
    "two_arguments": ("def engines(profile, more): return []", "TypeError"),
    "odd_abilities": (
        "from dataclasses import replace\nfrom tests.engines.bad_engines import GoodEngine\n"
        "def engines(profile):\n    engine = GoodEngine('rest', profile)\n    engine.name = 'odd_abilities'\n"
        "    engine.abilities = replace(engine.abilities, packages=3)\n    return [engine]\n",
        "abilities.packages: found 3",
    ),
    "odd_colour": (
        "from looping_pendulum.engines.facts import VariantFacts\nVariantFacts(colour='mauve')",
        "found 'mauve', needed one of blue",
    ),
}
"""Entry point -> source of its module, and what its row says."""
CHATTY = """
import os, sys, threading, time
print("x" * 10**6)
threading.Thread(target=time.sleep, args=(3600,)).start()
sys.stdout.close()
os.close(1)
from tests.engines.bad_engines import GoodEngine

GoodEngine.name = "chatty"

def engines(profile):
    return [GoodEngine("rest", profile)]
"""
"""An adapter that prints, closes what it prints to and leaves a thread; its engine is good."""
