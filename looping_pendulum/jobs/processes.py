"""Start the child processes of this package: restrict what they may import, and end them with their parent.

A child process imports nothing merely because it lies in the working folder or beside the script: a student's ``mujoco.py`` or
``pickle.py`` there must not shadow the real package. Modules that the parent itself has imported from such a folder (an
engine's module, a test) are the exception: the child may import them by name, and nothing else from there.
"""

from __future__ import annotations

import contextlib
import json
import multiprocessing
import os
import secrets
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import spawn
from multiprocessing.context import SpawnContext, SpawnProcess
from pathlib import Path
from typing import Any

from looping_pendulum.jobs import process_start

MEMORY_POLL_INTERVAL = 0.05 if sys.platform.startswith("linux") else 0.5
"""Time between two measurements of a process's memory [s]; without /proc each one has to start `ps`."""
END_TIMEOUT = 10.0
"""Longest time that a supervisor may take to end its worker [s], before it is killed; normally it takes milliseconds."""
_SAFE_PATH = "PYTHONSAFEPATH"
"""Environment variable that keeps Python from importing from the working folder; it is equivalent to the option -P."""


def unsafe_import_folders() -> frozenset[str]:
    """Return the folders from which Python would import any file: the working folder, and that of the running script."""
    folders = {""}
    with contextlib.suppress(OSError):  # the working folder may be gone
        folders.add(os.path.realpath(os.getcwd()))
    script = getattr(sys.modules.get("__main__"), "__file__", None)
    if script:
        folders.add(os.path.realpath(os.path.dirname(os.path.abspath(script))))
    return frozenset(folders)


def import_path() -> list[str]:
    """Return `sys.path` without the `unsafe_import_folders`."""
    unsafe = unsafe_import_folders()
    return [os.path.abspath(entry) for entry in sys.path if entry and os.path.realpath(entry) not in unsafe]


def modules_from_unsafe_folders() -> dict[str, str]:
    """Map each module that this process has imported from one of the `unsafe_import_folders` to that folder.

    Modules that this process, itself a child, may import by name are among them, so that its own children may import them, too.
    """
    unsafe = unsafe_import_folders()
    module_folders: dict[str, str] = {}
    for finder in sys.meta_path:
        module_folders |= getattr(finder, "module_folders", {})  # of `process_start.NamedModuleFinder`
    # A copy, as another thread may import while this one looks
    for name, module in list(sys.modules.items()):
        # A submodule is found through its package; these two are the script itself, which a child does not import
        if "." in name or name in ("__main__", "__mp_main__"):
            continue
        for path in _source_paths(module):
            folder = os.path.realpath(os.path.dirname(path))
            if folder in unsafe:
                module_folders[name] = folder
    return module_folders


def _source_paths(module: Any) -> list[str]:
    """Return the files or folders that a top-level module or package was imported from."""
    spec = getattr(module, "__spec__", None)
    folders = getattr(spec, "submodule_search_locations", None)
    if folders is not None:
        return [str(folder) for folder in folders]
    file = getattr(module, "__file__", None)
    return [file] if isinstance(file, str) else []


@dataclass(frozen=True, kw_only=True)
class Interpreter:
    """A Python for a worker, and what it may import beside its own packages."""

    executable: str
    folders: tuple[str, ...]
    """Folders from which it imports first."""
    modules: Mapping[str, str]
    """Further modules -> the folder of each."""


def this_interpreter() -> Interpreter:
    """Return the running Python: its children may import what it does, but for the `unsafe_import_folders`."""
    return Interpreter(executable=sys.executable, folders=tuple(import_path()), modules=modules_from_unsafe_folders())


class SupervisedProcess:
    """A worker process under a supervisor process, with a temporary folder of its own.

    The worker ends when this process ends, even if this process is killed. Whatever the worker has started ends with it, and
    then the folder is removed.

    Parameters
    ----------
    function
        "module:name" of the function to call; its argument is the path of the folder, which contains `process_start.JOB`.
    job
        Content of that file.
    environment
        Environment variables to set.
    interpreter
        Python that runs it, another environment's for example; default: this one.
    """

    def __init__(
        self,
        function: str,
        job: bytes,
        environment: Mapping[str, str] | None = None,
        interpreter: Interpreter | None = None,
    ) -> None:
        self.folder = Path(tempfile.gettempdir(), f"looping-pendulum-{secrets.token_hex(8)}").absolute()
        self.pid: int | None = None
        """Process id of the worker; None until it has started."""
        self.returncode: int | None = None
        """Exit status of the worker (negative: the number of the signal that killed it); None until it has ended."""
        self.start_error = ""
        """Why the worker could not start; empty if it did."""
        self._ended = threading.Event()
        self._process = self._start_supervisor(function, environment or {}, interpreter or this_interpreter())
        self._listener = threading.Thread(target=self._read_reports, daemon=True)
        self._listener.start()
        self._send(len(job).to_bytes(8, "little") + job)

    def _start_supervisor(
        self, function: str, environment: Mapping[str, str], interpreter: Interpreter
    ) -> subprocess.Popen[bytes]:
        """Start the supervisor: it takes commands on its standard input and reports on its standard output.

        It leads its own session, so that Ctrl-C reaches only this process, which then decides what to do.
        """
        request = {"function": function, "folder": str(self.folder), "modules": dict(interpreter.modules)}
        # PYTHONPATH cannot quote its separator, so an entry that contains one is left out.
        path = os.pathsep.join(entry for entry in interpreter.folders if os.pathsep not in entry)
        return subprocess.Popen(
            [interpreter.executable, "-P", process_start.__file__, json.dumps(request)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=os.environ | environment | {"PYTHONPATH": path},
            start_new_session=True,
        )

    def wait(self, seconds: float) -> bool:
        """Wait until the worker has ended, at most ``seconds``; return whether it has."""
        return self._ended.wait(seconds)

    def end(self) -> None:
        """End the worker and all that it has started; its folder stays until `close`."""
        if not self._ended.is_set():
            self._send(process_start.END_COMMAND)
            if not self._ended.wait(END_TIMEOUT):
                # The worker dies with its supervisor (by its parent-death signal, on Linux)
                self._process.kill()
                self._ended.wait(END_TIMEOUT)

    def close(self) -> None:
        """End the worker and the supervisor if they still run, and remove the folder."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with contextlib.suppress(OSError):  # the supervisor ended before it read all of it
            self._process.stdin.close()  # the end of its input tells the supervisor to end
        try:
            self._process.wait(END_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._listener.join()
        self._process.stdout.close()
        shutil.rmtree(self.folder, ignore_errors=True)  # a supervisor that was killed could not do it

    def _send(self, message: bytes) -> None:
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):  # the supervisor has ended
            self._process.stdin.write(message)
            self._process.stdin.flush()

    def _read_reports(self) -> None:
        """Store what the supervisor reports on its standard output, line by line, until it ends."""
        assert self._process.stdout is not None
        for line in self._process.stdout:
            word, _, content = line.decode(errors="replace").strip().partition(" ")
            if word == "pid":
                self.pid = int(content)
            elif word == "failed":
                self.start_error = content
            elif word == "ended":
                self.returncode = int(content)
                self._ended.set()
        if self.returncode is None:
            self.returncode = self._process.wait()
        self._ended.set()


def memory_in_use(pid: int) -> int | None:
    """Return the memory of a process, in RAM and swapped out [bytes]; None if it has ended or this system does not report it.

    Linux reports both in /proc. Elsewhere `ps` gives the part in RAM only; where there is no `ps` (Windows) nothing is known.
    """
    if sys.platform.startswith("linux"):
        try:
            lines = Path(f"/proc/{pid}/status").read_text().splitlines()
        except OSError:
            return None
        kibibytes = [int(line.split()[1]) for line in lines if line.startswith(("VmRSS:", "VmSwap:"))]
    else:
        try:
            ps = subprocess.run(["ps", "-o", "rss=", "-p", str(pid)], capture_output=True, text=True, timeout=5, check=False)
        except (OSError, subprocess.TimeoutExpired):
            return None
        kibibytes = [int(number) for number in ps.stdout.split() if number.isdigit()]
    return 1024 * sum(kibibytes) if kibibytes else None


@contextlib.contextmanager
def process_pool(
    count: int, initializer: Callable[..., object] | None = None, initargs: tuple[Any, ...] = ()
) -> Iterator[ProcessPoolExecutor]:
    """Return a context with an executor of ``count`` processes; they end with the context or this process, even when busy.

    They leave Ctrl-C to this process. They may import from `import_path` and the `modules_from_unsafe_folders`, but they do not
    import the running script: it needs no ``if __name__ == "__main__"``, and what it defines itself cannot be sent to them.
    They are spawned, not forked, because a copy of a process whose libraries have threads may hang.

    Parameters
    ----------
    count
        Number of processes; each starts when it is first needed.
    initializer, initargs
        Function that each process calls first, and its arguments, which may include shared memory.
    """
    with safe_spawning():  # the executor's locks start a process of their own
        pool = ProcessPoolExecutor(count, _PoolContext(), _initialize, (initializer, initargs))
    try:
        yield pool
    finally:
        _kill(pool)
        pool.shutdown(cancel_futures=True)


def _kill(pool: Any) -> None:
    """Kill the processes of an executor: the public `kill_workers` is new in Python 3.14.

    A process may be killed in the middle of a message. The executor's threads would wait for its rest, or for a reader, as
    long as this process itself held the other ends of their pipes open; they close these, too, once a process has ended.
    """
    pool._call_queue._reader.close()
    pool._result_queue._writer.close()
    for process in list((pool._processes or {}).values()):
        process.kill()


class _PoolProcess(SpawnProcess):
    """A process of a `process_pool`."""

    def start(self) -> None:
        """Start the process as `multiprocessing` does, but for what it may import and for signals."""
        with safe_spawning(), _without_interrupts():
            spawn.get_preparation_data = _preparation_data
            try:
                super().start()
            finally:
                spawn.get_preparation_data = _usual_preparation_data


class _PoolContext(SpawnContext):
    Process = _PoolProcess


_usual_preparation_data = spawn.get_preparation_data


def _preparation_data(name: str) -> dict[str, Any]:
    """Return what `multiprocessing` shall do first in a process: import `process_start` instead of the running script."""
    data = _usual_preparation_data(name)
    data.pop("init_main_from_name", None)
    request = json.dumps({"modules": modules_from_unsafe_folders()})
    script = process_start.__file__
    return data | {"sys_path": import_path(), "sys_argv": [script, request], "init_main_from_path": script}


@contextlib.contextmanager
def _without_interrupts() -> Iterator[None]:
    """Block Ctrl-C in this thread; processes that it starts inherit that, so that none is interrupted while it starts."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _initialize(initializer: Callable[..., object] | None, initargs: tuple[Any, ...]) -> None:
    """Make this process of a pool ignore Ctrl-C and end when its parent has ended; then call the initializer."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None

    def exit_after_parent() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=exit_after_parent, daemon=True).start()
    if initializer is not None:
        initializer(*initargs)


_spawn_lock = threading.RLock()


@contextlib.contextmanager
def safe_spawning() -> Iterator[None]:
    """Keep processes that `multiprocessing` starts inside this context from importing from the working folder.

    It starts them with ``python -c``, which would look for its own modules there first. The environment belongs to the whole
    process, so one thread at a time may change it.
    """
    with _spawn_lock:
        saved = os.environ.get(_SAFE_PATH)
        os.environ[_SAFE_PATH] = "1"
        try:
            yield
        finally:
            if saved is None:
                del os.environ[_SAFE_PATH]
            else:
                os.environ[_SAFE_PATH] = saved
