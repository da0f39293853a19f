"""Run one input, and say whether it was accepted."""

import signal
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from looping_pendulum.errors import HarnessError

CPU_LIMIT = 10.0
"""[s] of processor time, so that other work on the machine does not count; most inputs take milliseconds."""


class NoEnd(BaseException):
    """Raised by the timer; no handler of ordinary errors catches it."""


def was_accepted(run: Callable[[bytes], None], data: bytes, *, cpu_limit: float = CPU_LIMIT) -> bool:
    """Return whether an input was accepted; False: it was refused in one line.

    Raises
    ------
    Exception
        Anything else that became of it.
    """
    try:
        with time_limit(cpu_limit), warnings.catch_warnings():
            warnings.simplefilter("error")
            run(data)
    except HarnessError as error:
        if len(str(error).splitlines()) != 1:
            raise AssertionError("a refusal is not one line") from error
        return False
    except NoEnd as late:
        raise TimeoutError(str(late)) from late
    return True


@contextmanager
def time_limit(cpu_limit: float) -> Iterator[None]:
    """Raise `NoEnd` in what takes longer."""

    def stop(_number: int, _frame: FrameType | None) -> None:
        raise NoEnd(f"{cpu_limit:g} s of processor time")

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, cpu_limit)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
