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
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from looping_pendulum import process_start

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
    """Map each module that this process has imported from one of the `unsafe_import_folders` to that folder."""
    unsafe = unsafe_import_folders()
    module_folders: dict[str, str] = {}
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


def start_process(
    function: str,
    arguments: Sequence[str],
    *,
    folder: Path | None = None,
    environment: Mapping[str, str] | None = None,
    stderr: int | None = subprocess.DEVNULL,
) -> subprocess.Popen[bytes]:
    """Start a Python process that calls ``function``, "module:name", with ``arguments``, and ends when this process does.

    The process may import from `import_path` and the `modules_from_unsafe_folders`. The two processes communicate over its
    standard input and output. It leads its own session, so that Ctrl-C reaches only this process, which then decides what to
    do. With a ``folder`` the process is a supervisor (`SupervisedProcess`).
    """
    request = {"function": function, "arguments": list(arguments), "modules": modules_from_unsafe_folders()}
    request |= {} if folder is None else {"folder": str(folder)}
    # PYTHONPATH cannot quote its separator, so an entry that contains one is left out.
    path = os.pathsep.join(entry for entry in import_path() if os.pathsep not in entry)
    return subprocess.Popen(
        [sys.executable, "-P", str(Path(process_start.__file__)), json.dumps(request)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=stderr,
        env=os.environ | dict(environment or {}) | {"PYTHONPATH": path},
        start_new_session=True,
    )


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
    """

    def __init__(self, function: str, job: bytes, environment: Mapping[str, str] | None = None) -> None:
        self.folder = Path(tempfile.gettempdir(), f"looping-pendulum-{secrets.token_hex(8)}").absolute()
        self.pid: int | None = None
        """Process id of the worker; None until it has started."""
        self.returncode: int | None = None
        """Exit status of the worker (negative: the number of the signal that killed it); None until it has ended."""
        self.start_error = ""
        """Why the worker could not start; empty if it did."""
        self._ended = threading.Event()
        self._process = start_process(function, [str(self.folder)], folder=self.folder, environment=environment)
        self._listener = threading.Thread(target=self._read_reports, daemon=True)
        self._listener.start()
        self._send(len(job).to_bytes(8, "little") + job)

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


def end_with_parent() -> None:
    """Make this process, started by `multiprocessing`, leave Ctrl-C to its parent and end when the parent has ended."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None

    def exit_after_parent() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=exit_after_parent, daemon=True).start()


_spawn_lock = threading.Lock()
_nesting_depth = 0
"""How many `safe_spawning` contexts are open, in all threads."""
_saved_values: list[str | None] = []
"""Value of `_SAFE_PATH` before the outermost open context."""


@contextlib.contextmanager
def safe_spawning() -> Iterator[None]:
    """Keep processes that `multiprocessing` spawns inside this context from importing from the working folder.

    `multiprocessing` starts them with ``python -c``, which would look for its own modules there first. The environment
    belongs to the whole process, so contexts that overlap in several threads are counted: the last to end restores it.
    """
    global _nesting_depth
    with _spawn_lock:
        _nesting_depth += 1
        if _nesting_depth == 1:
            _saved_values.append(os.environ.get(_SAFE_PATH))
            os.environ[_SAFE_PATH] = "1"
    try:
        yield
    finally:
        with _spawn_lock:
            _nesting_depth -= 1
            if _nesting_depth == 0:
                saved = _saved_values.pop()
                if saved is None:
                    os.environ.pop(_SAFE_PATH, None)
                else:
                    os.environ[_SAFE_PATH] = saved
