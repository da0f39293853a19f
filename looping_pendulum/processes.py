"""Processes that this package starts: what they may import, and that they end with what started them.

Nothing is imported because it lies in the working folder, or beside a script: a student's ``mujoco.py`` or ``pickle.py`` there
is a file like any other. What the starting process has itself imported from such a folder (an engine's module, a test) may be
imported by a process that it starts, too: by name, and nothing else from there.
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

GRACE = 10.0
"""How long a supervisor may take to end what it supervises [s]; it takes milliseconds."""
_SAFE_PATH = "PYTHONSAFEPATH"
"""Environment variable that keeps Python from importing from the working folder, as its option -P does."""


def open_folders() -> frozenset[str]:
    """Folders of which Python would import anything that lies there: the working folder, and that of the script that runs."""
    folders = {""}
    with contextlib.suppress(OSError):  # the working folder may be gone
        folders.add(_real(os.getcwd()))
    script = getattr(sys.modules.get("__main__"), "__file__", None)
    if script:
        folders.add(_real(os.path.dirname(os.path.abspath(script))))
    return frozenset(folders)


def import_path() -> list[str]:
    """`sys.path` without the `open_folders`."""
    left_out = open_folders()
    return [os.path.abspath(entry) for entry in sys.path if entry and _real(entry) not in left_out]


def named_modules() -> dict[str, str]:
    """Module or package that this process has imported from one of the `open_folders` -> that folder."""
    left_out = open_folders()
    found: dict[str, str] = {}
    for name, module in list(sys.modules.items()):
        if "." in name or name in ("__main__", "__mp_main__"):
            continue
        for place in _places(module):
            folder = _real(os.path.dirname(place))
            if folder in left_out:
                found[name] = folder
    return found


def _places(module: Any) -> list[str]:
    """Files or folders that a top-level module or package was imported from."""
    spec = getattr(module, "__spec__", None)
    folders = getattr(spec, "submodule_search_locations", None)
    if folders is not None:
        return [str(folder) for folder in folders]
    file = getattr(module, "__file__", None)
    return [file] if isinstance(file, str) else []


def _real(folder: str) -> str:
    return os.path.realpath(folder)


def start(
    function: str,
    arguments: Sequence[str],
    *,
    folder: Path | None = None,
    environment: Mapping[str, str] | None = None,
    stderr: int | None = subprocess.DEVNULL,
) -> subprocess.Popen[bytes]:
    """Start a Python process that calls ``function``, "module:name", with ``arguments``, and ends when this process does.

    It imports as `import_path` and `named_modules` say, is spoken with over its standard input and output, and leads a session
    of its own: Ctrl-C reaches this process alone, which then decides. With a ``folder`` it is a supervisor (`Supervised`).
    """
    told = {"function": function, "arguments": list(arguments), "modules": named_modules()}
    told |= {} if folder is None else {"folder": str(folder)}
    path = os.pathsep.join(entry for entry in import_path() if os.pathsep not in entry)
    return subprocess.Popen(
        [sys.executable, "-P", str(Path(process_start.__file__)), json.dumps(told)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=stderr,
        env=os.environ | dict(environment or {}) | {"PYTHONPATH": path},
        start_new_session=True,
    )


class Supervised:
    """A process with a folder of its own that calls a function with that folder.

    It ends with this process, even if that is killed, and all that it has started ends with it; then the folder is removed.

    Parameters
    ----------
    function
        "module:name"; called with the folder's path, in which `process_start.JOB` is.
    job
        What that file holds.
    environment
        Variables to set.
    """

    def __init__(self, function: str, job: bytes, environment: Mapping[str, str] | None = None) -> None:
        self.folder = Path(tempfile.gettempdir(), f"looping-pendulum-{secrets.token_hex(8)}").absolute()
        self.pid: int | None = None
        """Of the process that works; None until it has begun."""
        self.returncode: int | None = None
        """Exit status, a signal's negative; None until it has ended."""
        self.fault = ""
        """Why it could not begin."""
        self._ended = threading.Event()
        self._process = start(function, [str(self.folder)], folder=self.folder, environment=environment)
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()
        self._tell(len(job).to_bytes(8, "little") + job)

    def wait(self, seconds: float) -> bool:
        """Wait until the process has ended, for so long at most; return whether it has."""
        return self._ended.wait(seconds)

    def end(self) -> None:
        """End the process and all that it has started; its folder stays until `close`."""
        if not self._ended.is_set():
            self._tell(process_start.END)
            if not self._ended.wait(GRACE):
                self._process.kill()
                self._ended.wait(GRACE)

    def close(self) -> None:
        """End what has not ended, and remove the folder."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with contextlib.suppress(OSError):  # what was not read any more is lost
            self._process.stdin.close()
        try:
            self._process.wait(GRACE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._listener.join()
        self._process.stdout.close()
        shutil.rmtree(self.folder, ignore_errors=True)  # where the supervisor was killed

    def _tell(self, message: bytes) -> None:
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):  # it has ended
            self._process.stdin.write(message)
            self._process.stdin.flush()

    def _listen(self) -> None:
        """Note what the supervisor reports."""
        assert self._process.stdout is not None
        for line in self._process.stdout:
            word, _, content = line.decode(errors="replace").strip().partition(" ")
            if word == "pid":
                self.pid = int(content)
            elif word == "failed":
                self.fault = content
            elif word == "ended":
                self.returncode = int(content)
                self._ended.set()
        if self.returncode is None:
            self.returncode = self._process.wait()
        self._ended.set()


def end_with_parent() -> None:
    """In a process of `multiprocessing`: leave Ctrl-C to the parent, and end when it has ended, whatever goes on then."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


_spawning = threading.Lock()
_depth = 0


@contextlib.contextmanager
def safe_spawning() -> Iterator[None]:
    """Let processes that `multiprocessing` spawns meanwhile import nothing from the working folder before they are ready.

    It starts them with ``python -c``, which looks there first for multiprocessing's own modules.
    """
    global _depth
    with _spawning:
        _depth += 1
        if _depth == 1:
            _before.append(os.environ.get(_SAFE_PATH))
            os.environ[_SAFE_PATH] = "1"
    try:
        yield
    finally:
        with _spawning:
            _depth -= 1
            if _depth == 0:
                before = _before.pop()
                if before is None:
                    os.environ.pop(_SAFE_PATH, None)
                else:
                    os.environ[_SAFE_PATH] = before


_before: list[str | None] = []
