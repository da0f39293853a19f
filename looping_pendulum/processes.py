"""Processes of this package: many jobs at a time, and the start and end of a process for one function.

A child process finds the installed packages first, and what lies in the working folder or beside the script last: a student's
``mujoco.py`` or ``pickle.py`` there does not shadow the real one, and an engine's module there is found nevertheless.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import IO, TypeVar

POLL_INTERVAL = 0.05
"""Time between two looks at what goes on [s]; Ctrl-C is noticed in between."""
END_TIMEOUT = 10.0
"""Longest time to wait for processes that were killed [s]; normally they end within milliseconds."""
MARK = "LOOPING_PENDULUM_PROCESS"
"""Environment variable by which a process of `start_python`, and all that it starts, are found, wherever they belong."""
ReportShare = Callable[[str, float], None]
"""Function that is called with what is being done, and the share of all of it that is done."""
Result = TypeVar("Result")


def core_count() -> int:
    """Return the number of cores that this process may use; a container or batch system may allow fewer than there are."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def run_many(
    calls: Iterable[Callable[[], Result]],
    jobs: int,
    *,
    cancelled: threading.Event,
    meanwhile: Callable[[dict[int, Result]], None] = lambda results: None,
) -> dict[int, Result]:
    """Make ``calls`` in their order, ``jobs`` at a time; return position -> result of those that had begun.

    Ctrl-C sets ``cancelled``: no further call begins, and those that go on are to end soon, with a result. No interrupt is
    raised, so that the caller returns what there is.

    Parameters
    ----------
    calls
        Each is made in a thread, as it only waits for a process.
    cancelled
        Event that the calls watch.
    meanwhile
        Called from the caller's thread, every `POLL_INTERVAL`, with the results so far.

    Raises
    ------
    Exception
        What a call raised, after all others have ended.
    """
    results: dict[int, Result] = {}

    def make(position: int, call: Callable[[], Result]) -> None:
        if not cancelled.is_set():
            results[position] = call()

    with ThreadPoolExecutor(jobs) as pool:
        made = [pool.submit(make, position, call) for position, call in enumerate(calls)]
        going_on = True
        while going_on:
            try:
                # In short steps, as Ctrl-C reaches this thread alone, and only between two steps
                going_on = bool(wait(made, POLL_INTERVAL).not_done)
                meanwhile(dict(results))
            except KeyboardInterrupt:
                cancelled.set()
    for each in made:
        each.result()
    return results


# ---- what a child process may import


def import_path() -> list[str]:
    """Return `sys.path` as absolute paths, with the folders of which any file might be imported at its end.

    These are the working folder, and that of the running script.
    """
    folders = []
    with contextlib.suppress(OSError):  # the working folder may be gone
        folders.append(os.getcwd())
    if script := getattr(sys.modules.get("__main__"), "__file__", None):
        folders.append(os.path.dirname(os.path.abspath(script)))
    unsafe = {os.path.realpath(folder) for folder in folders}
    path = [os.path.abspath(entry) for entry in sys.path if entry or folders]
    # Sorting keeps the order of the others
    return sorted(path, key=lambda entry: os.path.realpath(entry) in unsafe)


@dataclass(frozen=True, kw_only=True)
class Interpreter:
    """The Python of another environment."""

    executable: str
    folders: tuple[str, ...]
    """Folders from which it imports what its environment does not have."""


# ---- one process for one function


def start_python(
    function: str,
    argument: str,
    *,
    mark: str,
    output: IO[bytes],
    environment: Mapping[str, str],
    interpreter: Interpreter | None,
) -> subprocess.Popen[bytes]:
    """Start a process that calls ``function``, "module:name", with a text as its argument.

    It is in a session of its own, so that Ctrl-C reaches only this process, which then decides what to do. Its standard input
    ends when this process ends.

    Parameters
    ----------
    mark
        Text by which `end_marked` finds it.
    output
        File that gets all that it prints.
    environment
        Environment variables to set.
    interpreter
        Python that runs it; by default this one, with the same packages.
    """
    module, _, name = function.partition(":")
    folders: Sequence[str]
    executable, change, folders = sys.executable, "=", import_path()
    if interpreter is not None:
        executable, change, folders = interpreter.executable, "+=", interpreter.folders
    code = f"import sys; sys.path {change} sys.argv[2:]; from {module} import {name}; {name}(sys.argv[1])"
    return subprocess.Popen(
        [executable, "-P", "-c", code, argument, *folders],
        stdin=subprocess.PIPE,
        stdout=output,
        stderr=subprocess.STDOUT,
        env=os.environ | environment | {MARK: mark},
        start_new_session=True,
        creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
    )


@contextlib.contextmanager
def ended(process: subprocess.Popen[bytes], mark: str) -> Iterator[None]:
    """Return a context at whose end a process of `start_python` and all that it has started have ended."""
    assert process.stdin is not None
    try:
        yield
    finally:
        process.kill()
        end_marked(mark)
        process.wait()
        process.stdin.close()


def end_marked(mark: str) -> None:
    """Kill all processes that carry ``mark``, except this one, and wait until they have ended.

    So a process ends, too, that an engine has started in a session of its own and that has lost its parent.
    """
    import psutil  # not at the top: a process that only computes starts sooner without it

    deadline = time.monotonic() + END_TIMEOUT
    while time.monotonic() < deadline:
        marked = []
        for process in psutil.process_iter():
            # Others' processes refuse to be read, and any may end meanwhile
            with contextlib.suppress(psutil.Error, OSError):
                if process.pid != os.getpid() and process.environ().get(MARK) == mark:
                    process.kill()
                    marked.append(process)
        if not marked:
            return
        # Again afterwards: one may have started another before it was killed
        time.sleep(0.01)


def memory_in_use(pid: int) -> int | None:
    """Return the memory of a process [bytes]; None if it has ended."""
    import psutil

    try:
        return int(psutil.Process(pid).memory_info().rss)
    except psutil.Error:
        return None
