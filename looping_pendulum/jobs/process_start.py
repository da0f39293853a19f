"""First code of every Python process that `processes` starts; it is run by its path, before anything else is imported.

It restricts what may be imported. An engine's process also gets a supervisor: a small process that waits until the parent asks
for the end, or has itself ended, then kills the engine with all that it has started and removes their folder. This file imports
only the standard library, and little of it, because it runs at every start.
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
from collections.abc import Mapping
from importlib.machinery import ModuleSpec, PathFinder
from typing import Any

JOB, OUTPUT = "job.pickle", "output.txt"
"""Files in a supervised process's folder: its input (a pickled job), and everything that it prints."""
END_COMMAND = b"end\n"
"""Message on a supervisor's standard input that makes it end its worker; the end of the input makes the supervisor end, too."""
_PR_SET_PDEATHSIG, _PR_SET_CHILD_SUBREAPER = 1, 36
"""Options of Linux's prctl, from <sys/prctl.h>."""


class NamedModuleFinder:
    """Import finder for a few modules by name, each in a given folder; it finds nothing else in these folders."""

    def __init__(self, folders: Mapping[str, str]) -> None:
        self.module_folders = folders

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        """Return what Python needs to import ``name``; None if it is not one of the given modules."""
        if path is not None or name not in self.module_folders:
            return None
        return PathFinder.find_spec(name, [self.module_folders[name]], target)


def main(request: Mapping[str, Any]) -> None:
    """Call a function in a supervised process of its own.

    ``request`` has the keys "function" ("module:name"), "folder" (the process's own, and the function's argument) and "modules"
    (name -> folder).
    """
    folder = request["folder"]
    if hasattr(os, "fork"):
        fork_worker(folder)
    else:
        work_without_supervisor(folder)
    sys.meta_path.insert(0, NamedModuleFinder(request["modules"]))
    module, _, name = request["function"].partition(":")
    getattr(importlib.import_module(module), name)(folder)


def fork_worker(folder: str) -> None:
    """Fork: return in the new worker process, which works in ``folder``; the old one becomes its supervisor for good."""
    # The numbers of signals that arrive are written to a pipe, so that select() can wait for them and for commands together.
    signals, signal_writer = os.pipe()
    for end in (signals, signal_writer):
        os.set_blocking(end, False)
    signal.set_wakeup_fd(signal_writer, warn_on_full_buffer=False)
    for number in (signal.SIGCHLD, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: None)  # a handler must exist for the pipe to be written
    _prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    _prctl(_PR_SET_CHILD_SUBREAPER, 1)  # orphans of the worker become children of this process, so it can kill them
    if not _receive(folder):
        os._exit(1)
    supervisor = os.getpid()
    # Safe here: this process has no threads yet, and has imported no library that starts some
    worker = os.fork()
    if worker == 0:
        # The supervisor's signal handling is not the engine's
        signal.set_wakeup_fd(-1)
        for number in (signal.SIGCHLD, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_DFL)
        os.close(signals)
        os.close(signal_writer)
        # A group of its own, which the supervisor can kill as a whole
        os.setsid()
        _prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != supervisor:  # it ended between fork and prctl, so its death signal will never come
            os._exit(1)
        _redirect(folder)
        return
    try:
        _supervise(worker, signals)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        os._exit(0)


def work_without_supervisor(folder: str) -> None:
    """Do as `fork_worker` where a process cannot fork (Windows): return in this process, which ends when its input ends."""
    if not _receive(folder):
        os._exit(1)
    _report(b"pid %d" % os.getpid())
    commands, _ = os.dup(0), os.dup(1)  # while the second is open, the parent knows that this process still runs

    def exit_on_command() -> None:
        os.read(commands, len(END_COMMAND))
        os._exit(1)

    threading.Thread(target=exit_on_command, daemon=True).start()
    _redirect(folder)


def _receive(folder: str) -> bool:
    """Make the folder and store the job that the parent sends there; return whether it arrived completely."""
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
        if not isinstance(error, FileExistsError):  # a folder that existed before belongs to somebody else
            shutil.rmtree(folder, ignore_errors=True)
        return False
    return True


def _read(size: int) -> bytes:
    """Read ``size`` bytes from the parent, fewer if it ends before.

    It reads without a buffer, which might take bytes of the commands that follow.
    """
    parts = []
    while size > 0 and (part := os.read(0, min(size, 1 << 20))):
        parts.append(part)
        size -= len(part)
    return b"".join(parts)


def _redirect(folder: str) -> None:
    """Make the standard input empty, and send all that Python or C code prints to the file `OUTPUT` in ``folder``."""
    empty = os.open(os.devnull, os.O_RDONLY)
    output = os.open(os.path.join(folder, OUTPUT), os.O_WRONLY | os.O_APPEND)
    # On the descriptors themselves, because C code does not write to sys.stdout
    os.dup2(empty, 0)
    os.dup2(output, 1)
    os.dup2(output, 2)
    os.close(empty)
    os.close(output)


def _supervise(worker: int, signals: int) -> None:
    """Report the worker's start and end; kill it with all that it started on command, or when the parent has ended."""
    commands = os.dup(0)
    _report(b"pid %d" % worker)
    code: int | None = None
    while True:
        ready, _, _ = select.select([commands, signals], [], [])
        command = os.read(commands, 64) if commands in ready else None
        signal_numbers = os.read(signals, 64) if signals in ready else b""
        # An empty read is the end of the input: the parent has ended or has closed it.
        must_exit = command == b"" or signal.SIGTERM in signal_numbers or signal.SIGHUP in signal_numbers
        if code is None:
            code = _exit_code(worker, kill=command is not None or must_exit)
            if code is not None:
                _end_descendants(worker)
                _report(b"ended %d" % code)
        if must_exit:
            return


def _exit_code(worker: int, *, kill: bool) -> int | None:
    """Return the worker's exit code (negative: the number of the signal that killed it); None if it still runs."""
    if kill:
        with contextlib.suppress(ProcessLookupError):
            os.kill(worker, signal.SIGKILL)
    pid, status = os.waitpid(worker, 0 if kill else os.WNOHANG)
    return os.waitstatus_to_exitcode(status) if pid else None


def _end_descendants(worker: int) -> None:
    """Kill what the worker has started: its process group, and on Linux also processes that have left that group.

    The latter have become children of this process, which is their subreaper. Killing one may hand over its own children, so
    the loop goes on until there are none.
    """
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
    """Return the ids of this process's children; empty where the system does not tell (it is a file of Linux)."""
    try:
        with open(f"/proc/self/task/{os.getpid()}/children") as file:
            return [int(pid) for pid in file.read().split()]
    except OSError:
        return []


def _report(line: bytes) -> None:
    """Send one line to the parent."""
    with contextlib.suppress(OSError):  # the parent may have ended
        os.write(1, line + b"\n")


def _prctl(option: int, value: int) -> None:
    """Set an option of this process with Linux's prctl; do nothing on other systems."""
    if sys.platform.startswith("linux"):
        import ctypes

        ctypes.CDLL(None).prctl(option, int(value), 0, 0, 0)


if __name__ == "__main__":
    main(json.loads(sys.argv[1]))
elif __name__ == "__mp_main__":  # multiprocessing's name for the module that a new process of a pool imports first
    sys.meta_path.insert(0, NamedModuleFinder(json.loads(sys.argv[1])["modules"]))
