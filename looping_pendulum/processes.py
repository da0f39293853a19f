"""Processes of this package: many jobs at a time, and the start and end of a process for one function.

A child process finds the installed packages first, and what lies in the working folder or beside the script last: a student's
``mujoco.py`` or ``pickle.py`` there does not shadow the real one, and an engine's module there is found nevertheless.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass
from enum import Enum, auto
from pathlib import Path
from types import MappingProxyType
from typing import Any, NoReturn, TypeVar

POLL_INTERVAL = 0.05
"""Time between two looks at what goes on [s]; Ctrl-C is noticed in between."""
END_TIMEOUT = 10.0
"""Longest time to wait for processes that were killed [s]; normally they end within milliseconds."""
ReportShare = Callable[[str, float], None]
"""Function that is called with what is being done, and the share of all of it that is done."""
Result = TypeVar("Result")


def notebook_progress() -> ReportShare:
    """Return a function that shows in a notebook, in one line, what is being done; elsewhere it does nothing."""
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    if not hasattr(shell, "kernel"):
        return lambda what, share: None
    from IPython.display import DisplayHandle

    line: Any = DisplayHandle()  # type: ignore[no-untyped-call]
    line.display({"text/plain": ""}, raw=True)
    return lambda what, share: line.update({"text/plain": f"{100 * share:.0f} %: {what}"}, raw=True)


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


OUTPUT = "output.txt"
"""File in the folder of a process with all that it prints."""
OUTPUT_LIMIT = 2**24
"""Size at which that file is emptied, so that it cannot fill the disk [bytes]."""
DISK_LIMIT = 2**30
"""How much the folder of a process may hold [bytes]; what it writes elsewhere is not limited."""
SHARE_OF_LOOKING = 0.05
"""Largest share of a processor that is spent on looking for what a process has started."""


class Cause(Enum):
    """Why a process of `run_python` ended."""

    ITSELF = auto()
    SIGNAL = auto()
    TIME = auto()
    MEMORY = auto()
    DISK = auto()
    CANCELLED = auto()


@dataclass(frozen=True, kw_only=True)
class Ending:
    """How a process of `run_python` ended."""

    cause: Cause
    amount: int = 0
    """Exit status, number of the signal, or how much it held [bytes]."""

    @property
    def succeeded(self) -> bool:
        """Return whether it ended by itself with status 0."""
        return self.cause is Cause.ITSELF and self.amount == 0

    def __str__(self) -> str:
        """Return how it died, in a few words."""
        if self.cause is Cause.SIGNAL:
            name = signal.Signals(self.amount).name
            hint = "; this program did not send it: was the machine out of memory?" if name == "SIGKILL" else ""
            return f"killed by signal {name}{hint}"
        return (
            f"exit status {self.amount}" if self.cause is Cause.ITSELF else f"stopped by its limit on {self.cause.name.lower()}"
        )


def run_python(
    function: str,
    folder: Path,
    *,
    time_limit: float,
    memory_limit: int,
    disk_limit: int = DISK_LIMIT,
    environment: Mapping[str, str] = MappingProxyType({}),
    interpreter: Interpreter | None = None,
    cancelled: threading.Event | None = None,
    meanwhile: Callable[[], None] = lambda: None,
) -> Ending:
    """Call ``function``, "module:name", with the path of ``folder`` in a process of its own, and wait until it has ended.

    All that it has started ends with it, except what has left its session and lost its parent before it was seen once
    (`ProcessTree`). The function begins with `end_with_parent` and ends with `finish`. The process is in a session of its own,
    so that Ctrl-C reaches only this one, which then decides what to do.

    Parameters
    ----------
    folder
        Gets what it prints (`OUTPUT`), and its temporary files.
    time_limit, memory_limit, disk_limit
        On its wall time [s], on the memory of all that it has started [bytes], and on what ``folder`` holds [bytes].
    environment
        Environment variables to set.
    interpreter
        Python that runs it; by default this one, with the same packages.
    cancelled
        Event that ends it.
    meanwhile
        Called every `POLL_INTERVAL`.

    Raises
    ------
    OSError
        If it cannot be started.
    """
    module, _, name = function.partition(":")
    folders: Sequence[str]
    executable, change, folders = sys.executable, "=", import_path()
    if interpreter is not None:
        executable, change, folders = interpreter.executable, "+=", interpreter.folders
    program = f"import sys; sys.path {change} sys.argv[2:]; from {module} import {name}; {name}(sys.argv[1])"
    temporary = dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(folder))
    with (folder / OUTPUT).open("ab") as output:
        process = subprocess.Popen(
            [executable, "-P", "-c", program, str(folder), *folders],
            stdin=subprocess.PIPE,
            stdout=output,
            stderr=subprocess.STDOUT,
            env={**os.environ, **temporary, **environment},
            start_new_session=True,
            creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
        )
        assert process.stdin is not None
        tree = ProcessTree(process.pid)
        try:
            deadline = time.monotonic() + time_limit
            while (code := _exit_code(process)) is None:
                if cancelled is not None and cancelled.is_set():
                    return Ending(cause=Cause.CANCELLED)
                if time.monotonic() > deadline:
                    return Ending(cause=Cause.TIME)
                if (held := tree.memory()) > memory_limit:
                    return Ending(cause=Cause.MEMORY, amount=held)
                if file_size(folder / OUTPUT) > OUTPUT_LIMIT:  # the process appends, so it goes on writing at its new end
                    os.truncate(folder / OUTPUT, 0)
                if (held := folder_size(folder)) > disk_limit:
                    return Ending(cause=Cause.DISK, amount=held)
                meanwhile()
        finally:
            tree.end()
            process.wait()
            process.stdin.close()
    return Ending(cause=Cause.ITSELF, amount=code) if code >= 0 else Ending(cause=Cause.SIGNAL, amount=-code)


def _exit_code(process: subprocess.Popen[bytes]) -> int | None:
    """Wait a moment, and return the exit code of a process (negative: the signal that killed it); None if it goes on."""
    try:
        return process.wait(POLL_INTERVAL)
    except subprocess.TimeoutExpired:
        return None


def file_size(path: Path) -> int:
    """Return the size of a file [bytes]; 0 if it does not exist (yet)."""
    try:
        return path.stat().st_size
    except OSError:
        return 0


def folder_size(folder: Path) -> int:
    """Return the size of all files below ``folder`` [bytes], as far as it can be read."""
    return sum(file_size(Path(parent, name)) for parent, _, names in os.walk(folder) for name in names)


class ProcessTree:
    """A process and all that it has started, directly or not, that was seen once: also what has lost its parent since.

    On Linux nothing is missed while the process lives, since what loses its parent becomes its child (`adopt_orphans`).
    """

    def __init__(self, pid: int) -> None:
        import psutil  # not at the top: a process that only computes starts sooner without it

        self._root = psutil.Process(pid)
        self._seen: set[Any] = {self._root}
        self._next_look = 0.0

    def _look(self) -> None:
        """Add what was started since the last time."""
        import psutil

        started = time.thread_time()
        below: set[Any] = set()
        for process in (self._root, *self._seen):
            if process not in below:  # one that has lost its parent, or the process itself
                with contextlib.suppress(psutil.Error):
                    below.update(process.children(recursive=True))
        self._seen |= below
        # It reads the list of all processes, which takes milliseconds
        self._next_look = time.monotonic() + (time.thread_time() - started) / SHARE_OF_LOOKING

    def memory(self) -> int:
        """Return the memory that all of them hold [bytes]."""
        import psutil

        if time.monotonic() >= self._next_look:
            self._look()
        held = 0
        for process in self._seen:
            with contextlib.suppress(psutil.Error):
                held += process.memory_info().rss
        return held

    def end(self) -> None:
        """Kill all of them, and whatever else is in the process's group, and wait until those that were seen have ended."""
        import psutil

        with contextlib.suppress(psutil.Error):
            self._root.suspend()  # it starts no more, and goes on adopting what it has started
        try:
            self.end_descendants()
        finally:  # it would stay suspended
            with contextlib.suppress(psutil.Error):
                self._root.kill()
            # What was started at the very end, and not seen
            with contextlib.suppress(AttributeError, OSError):
                os.killpg(self._root.pid, signal.SIGKILL)

    def end_descendants(self) -> None:
        """Kill all but the process itself, and wait until they have ended."""
        import psutil

        deadline = time.monotonic() + END_TIMEOUT
        alive = True
        while alive and time.monotonic() < deadline:
            self._look()
            alive = False
            for process in self._seen - {self._root}:
                with contextlib.suppress(psutil.Error):
                    if process.is_running() and process.status() != psutil.STATUS_ZOMBIE:
                        process.kill()
                        alive = True


def end_with_parent(folder: Path) -> None:
    """End this process of `run_python`, with all that it has started and its folder, as soon as its parent has ended.

    The function that it runs gets an empty standard input.
    """
    adopt_orphans()
    parent = os.dup(0)
    empty = os.open(os.devnull, os.O_RDONLY)
    os.dup2(empty, 0)
    os.close(empty)

    def wait_for_end() -> None:
        # The parent's end of the pipe is closed when it has ended
        os.read(parent, 1)
        try:
            ProcessTree(os.getpid()).end_descendants()
        finally:
            shutil.rmtree(folder, ignore_errors=True)
            os._exit(1)

    threading.Thread(target=wait_for_end, daemon=True).start()


def finish() -> NoReturn:
    """End this process of `run_python` with success, with all that it has started.

    Threads that go on, and what foreign code has to do at the end of Python, count for nothing.
    """
    # What was printed from C waits in its own buffer
    with contextlib.suppress(Exception):
        import ctypes

        ctypes.CDLL(None).fflush(None)
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(Exception):
            stream.flush()
    with contextlib.suppress(ChildProcessError, ImportError):  # the Python of another environment may lack psutil
        if hasattr(os, "WNOHANG"):
            os.waitpid(-1, os.WNOHANG)  # raises ChildProcessError where there is nothing to end
        ProcessTree(os.getpid()).end_descendants()
    os._exit(0)


def adopt_orphans() -> None:
    """Make this process the parent of what it has started, at any depth, and what has lost its parent; on Linux only."""
    set_child_subreaper = 36  # of linux/prctl.h
    with contextlib.suppress(AttributeError, OSError):  # another system
        import ctypes

        if sys.platform == "linux":
            ctypes.CDLL(None).prctl(set_child_subreaper, 1, 0, 0, 0)
