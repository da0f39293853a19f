"""Run one input and say what became of it."""

import signal
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from types import FrameType

from looping_pendulum.errors import HarnessError

CPU_LIMIT = 10.0
"""[s] of processor time, so that other work on the machine does not count; most inputs take milliseconds."""
WALL_LIMIT = 120.0
"""[s]; for what waits and does not compute."""
PACKAGE = str(Path(__file__).parents[2] / "looping_pendulum")


class Outcome(StrEnum):
    """What became of an input."""

    ACCEPTED = "accepted"
    CLEAN_ERROR = "clean errors"
    TRACEBACK = "tracebacks"
    HANG = "hangs"

    @property
    def is_fault(self) -> bool:
        return self in (Outcome.TRACEBACK, Outcome.HANG)


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Outcome of one input, with the same signature for faults of the same cause."""

    outcome: Outcome
    signature: str = ""
    report: str = ""


class NoEnd(BaseException):
    """Raised by the timer; no handler of ordinary errors catches it."""


def judge(run: Callable[[bytes], None], data: bytes, *, cpu_limit: float = CPU_LIMIT) -> Verdict:
    """Run ``data`` within the time limits."""
    try:
        with time_limits(cpu_limit), warnings.catch_warnings():
            warnings.simplefilter("error")
            run(data)
    except NoEnd:
        # Where it was interrupted is chance, so every hang of a kind has one signature.
        return Verdict(outcome=Outcome.HANG, signature="hang", report=traceback.format_exc())
    except HarnessError as error:
        if not str(error).strip() or "\n" in str(error):
            return Verdict(outcome=Outcome.TRACEBACK, signature="no one-line message", report=repr(error))
        return Verdict(outcome=Outcome.CLEAN_ERROR)
    except Exception as error:
        return Verdict(outcome=Outcome.TRACEBACK, signature=signature(error), report=traceback.format_exc())
    return Verdict(outcome=Outcome.ACCEPTED)


def signature(error: BaseException) -> str:
    """Type of ``error`` and the innermost line of the package that it went through."""
    frames = traceback.extract_tb(error.__traceback__)
    inside = [frame for frame in frames if frame.filename.startswith(PACKAGE)] or list(frames)
    return f"{type(error).__name__} at {Path(inside[-1].filename).name}:{inside[-1].lineno}"


@contextmanager
def time_limits(cpu_limit: float) -> Iterator[None]:
    """Raise `NoEnd` in what takes longer."""

    def stop(number: int, _frame: FrameType | None) -> None:
        raise NoEnd(f"{cpu_limit:g} s of processor time" if number == signal.SIGPROF else f"{WALL_LIMIT:g} s")

    timers = ((signal.SIGPROF, signal.ITIMER_PROF, cpu_limit), (signal.SIGALRM, signal.ITIMER_REAL, WALL_LIMIT))
    before = [signal.signal(number, stop) for number, _, _ in timers]
    try:
        for _, timer, limit in timers:
            signal.setitimer(timer, limit)
        yield
    finally:
        for _, timer, _ in timers:
            signal.setitimer(timer, 0.0)
        for (number, _, _), handler in zip(timers, before, strict=True):
            signal.signal(number, handler)
