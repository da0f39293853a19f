"""First code of a Python process that this package starts (see `processes`); run by its path, before anything else is imported.

It settles what may be imported, and that the process ends with the one that started it. An engine's process gets a supervisor:
a small process that ends the engine with all that it has started, whatever becomes of either, and then removes their folder.
Only the standard library is imported here, and little of it.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import select
import shutil
import signal
import sys
import threading
import time
from collections.abc import Mapping
from importlib.machinery import ModuleSpec, PathFinder
from typing import Any

JOB, OUTPUT = "job.pickle", "output.txt"
"""Files in a supervised process's folder: what it is asked to do, and all that it prints."""
END = b"end\n"
"""What a supervisor is told to end its process; when its input ends, it goes too."""
_DEATH_SIGNAL, _SUBREAPER = 1, 36
"""Numbers of Linux's prctl."""
_LOOK = 0.5
"""Time between two looks whether the parent is there [s]."""


class NamedModules:
    """Finds some modules by name, each in a folder of its own, and nothing else there."""

    def __init__(self, folders: Mapping[str, str]) -> None:
        self._folders = folders

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        """Return what Python needs to import ``name``; None if it is not one of ours."""
        if path is not None or name not in self._folders:
            return None
        return PathFinder.find_spec(name, [self._folders[name]], target)


def main(told: Mapping[str, Any]) -> None:
    """Call the function that the parent names."""
    folder = told.get("folder")
    if folder is None:
        end_with_parent()
    elif hasattr(os, "fork"):
        supervise(folder)
    else:
        work_alone(folder)
    sys.meta_path.insert(0, NamedModules(told["modules"]))
    module, _, name = told["function"].partition(":")
    getattr(importlib.import_module(module), name)(*told["arguments"])


def end_with_parent() -> None:
    """End this process when its parent has ended, whatever it is doing then."""
    parent = os.getppid()
    _prctl(_DEATH_SIGNAL, signal.SIGKILL if hasattr(signal, "SIGKILL") else signal.SIGTERM)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_LOOK)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def supervise(folder: str) -> None:
    """Return in a new process, which works in ``folder``; this one only watches over it, and never returns."""
    signals, wake = os.pipe()
    for end in (signals, wake):
        os.set_blocking(end, False)
    signal.set_wakeup_fd(wake, warn_on_full_buffer=False)
    for number in (signal.SIGCHLD, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: None)  # noted by the pipe
    _prctl(_DEATH_SIGNAL, signal.SIGTERM)
    _prctl(_SUBREAPER, 1)
    if not _receive(folder):
        os._exit(1)
    supervisor = os.getpid()
    worker = os.fork()
    if worker == 0:
        signal.set_wakeup_fd(-1)
        for number in (signal.SIGCHLD, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_DFL)
        os.close(signals)
        os.close(wake)
        os.setsid()
        _prctl(_DEATH_SIGNAL, signal.SIGKILL)
        if os.getppid() != supervisor:
            os._exit(1)
        _redirect(folder)
        return
    try:
        _watch(worker, signals)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        os._exit(0)


def work_alone(folder: str) -> None:
    """Do as `supervise` where a process cannot fork (Windows): return in this process, which ends when its input does."""
    if not _receive(folder):
        os._exit(1)
    _report(b"pid %d" % os.getpid())
    commands, _ = os.dup(0), os.dup(1)  # while the second is open, the parent knows that this process goes on

    def watch() -> None:
        os.read(commands, len(END))
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    _redirect(folder)


def _receive(folder: str) -> bool:
    """Make the folder and put the job that the parent sends there; return whether all of it came."""
    size = int.from_bytes(_read(8), "little")
    job = _read(size)
    if not 0 < size == len(job):
        return False
    try:
        os.mkdir(folder, 0o700)
        for name, content in ((JOB, job), (OUTPUT, b"")):
            with open(os.path.join(folder, name), "xb") as file:
                file.write(content)
    except OSError as error:
        _report(f"failed {error.filename}: {error.strerror}".encode(errors="replace"))
        if not isinstance(error, FileExistsError):  # that folder is somebody else's
            shutil.rmtree(folder, ignore_errors=True)
        return False
    return True


def _read(size: int) -> bytes:
    """Read so many bytes from the parent, fewer if it ends before; not one more, which a buffer would."""
    parts = []
    while size > 0 and (part := os.read(0, min(size, 1 << 20))):
        parts.append(part)
        size -= len(part)
    return b"".join(parts)


def _redirect(folder: str) -> None:
    """Read nothing; print, from Python or from C, into the folder."""
    nothing = os.open(os.devnull, os.O_RDONLY)
    printed = os.open(os.path.join(folder, OUTPUT), os.O_WRONLY | os.O_APPEND)
    os.dup2(nothing, 0)
    os.dup2(printed, 1)
    os.dup2(printed, 2)
    os.close(nothing)
    os.close(printed)


def _watch(worker: int, signals: int) -> None:
    """Report the worker's start and end; end it with all that it started when told to, or when the parent has ended."""
    told = os.dup(0)
    _report(b"pid %d" % worker)
    code: int | None = None
    while True:
        ready, _, _ = select.select([told, signals], [], [])
        asked = os.read(told, 64) if told in ready else None
        noted = os.read(signals, 64) if signals in ready else b""
        gone = asked == b"" or signal.SIGTERM in noted or signal.SIGHUP in noted
        if code is None:
            code = _ended(worker, kill=asked is not None or gone)
            if code is not None:
                _end_descendants(worker)
                _report(b"ended %d" % code)
        if gone:
            return


def _ended(worker: int, *, kill: bool) -> int | None:
    """Exit code of the worker, a signal's negative; None if it goes on."""
    if kill:
        with contextlib.suppress(ProcessLookupError):
            os.kill(worker, signal.SIGKILL)
    pid, status = os.waitpid(worker, 0 if kill else os.WNOHANG)
    return os.waitstatus_to_exitcode(status) if pid else None


def _end_descendants(worker: int) -> None:
    """End what the worker has started: its group, and on Linux what has left that group, which comes to us as children."""
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(worker, signal.SIGKILL)
    while pids := _children():
        for pid in pids:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        for pid in pids:
            with contextlib.suppress(ChildProcessError):
                os.waitpid(pid, 0)


def _children() -> list[int]:
    """Our children, as far as this system says."""
    try:
        with open(f"/proc/self/task/{os.getpid()}/children") as file:
            return [int(pid) for pid in file.read().split()]
    except OSError:
        return []


def _report(line: bytes) -> None:
    with contextlib.suppress(OSError):  # the parent may be gone
        os.write(1, line + b"\n")


def _prctl(option: int, value: int) -> None:
    """Ask something of Linux for this process; nothing elsewhere."""
    if sys.platform.startswith("linux"):
        import ctypes

        ctypes.CDLL(None).prctl(option, int(value), 0, 0, 0)


if __name__ == "__main__":
    main(json.loads(sys.argv[1]))
