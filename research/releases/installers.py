"""Ask pip or uv for the releases of a package, and let them make an environment with one of these.

Both take the package index that they are set up with; this package names none.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from packaging.version import InvalidVersion, Version

from looping_pendulum.errors import HarnessError, shorten

INDEX_TIME, INSTALL_TIME = 120.0, 1800.0
"""Time limits for the list of releases and for one environment [s]."""
POLL_INTERVAL = 0.05
"""Time between two checks for an interrupt [s]."""
NO_ANSWER = ("Retrying", "Could not fetch URL", "Could not connect", "error sending request", "dns error")
"""Parts of what pip and uv print where the package index does not answer."""
NO_INSTALLER = "found neither pip nor uv, needed one; install uv"
MAX_ERROR_LENGTH = 300
"""Characters of an installer's message that are kept."""


class ReleaseError(HarnessError, RuntimeError):
    """There is no such release, the package index does not answer, or an environment cannot be made."""


class InstallationStopped(HarnessError):
    """An installer was stopped because the user interrupted the study."""


def list_releases(distribution: str) -> tuple[Version, ...]:
    """Return the releases of ``distribution`` (its name for pip) that the package index offers to this Python, oldest first.

    Raises
    ------
    ReleaseError
        If the index does not answer or does not know the package, or if neither pip nor uv is installed.
    """
    arguments = ["index", "versions", "--retries", "1", "--timeout", "15", distribution]
    if _has_pip():
        command = [sys.executable, "-m", "pip", *arguments]
    elif uv() is not None:
        command = [str(uv()), "tool", "run", "--quiet", "pip", *arguments]
    else:
        raise ReleaseError(NO_INSTALLER)
    code, text = run_command(command, INDEX_TIME)
    listed = re.search(r"^Available versions: (.+)$", text, re.MULTILINE)
    if code or listed is None:
        if any(sign in text for sign in NO_ANSWER):
            raise ReleaseError(f"{distribution}: the package index does not answer; is there a network? pip: {one_line(text)}")
        raise ReleaseError(f"{distribution}: the package index offers no release to this Python: {one_line(text)}")
    return tuple(sorted(version for word in listed.group(1).split(",") if (version := _version(word)) is not None))


def _version(word: str) -> Version | None:
    """Return a version; None for a name that is none by today's rules, as some old ones are."""
    try:
        return Version(word.strip())
    except InvalidVersion:
        return None


def install(folder: Path, requirements: Sequence[str], cancelled: threading.Event | None = None) -> str:
    """Make an environment of this Python in ``folder``, install ``requirements`` as wheels, and return its Python's path.

    uv does it where it is installed, as it links files of its cache; where it fails, and without it, venv and pip do: uv
    does not know the index of a house that pip is set up with. Nothing is compiled, which may take an hour.

    Raises
    ------
    ReleaseError
        If it cannot be made: in one line, what the installer says.
    """
    shutil.rmtree(folder, ignore_errors=True)
    folder.parent.mkdir(parents=True, exist_ok=True)
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    only_wheels = ["--only-binary", ":all:", *requirements]
    tries = []
    if (program := uv()) is not None:
        make = [program, "venv", "--quiet", "--clear", "--no-project", "--python", sys.executable, str(folder)]
        tries.append((make, [program, "pip", "install", "--quiet", "--python", str(python), *only_wheels]))
    if _has_pip():
        make = [sys.executable, "-m", "venv", "--clear", "--without-pip", str(folder)]
        quiet = ["--quiet", "--disable-pip-version-check", "--no-input"]
        tries.append((make, [sys.executable, "-m", "pip", "--python", str(python), "install", *quiet, *only_wheels]))
    said: list[str] = []
    for commands in tries:
        for command in commands:
            code, text = run_command(command, INSTALL_TIME, cancelled)
            if code:
                said.append(one_line(text))
                break
        else:
            return str(python)
    shutil.rmtree(folder, ignore_errors=True)
    # uv, which comes first, says more: pip's answer to a release without a wheel is that it cannot be found
    raise ReleaseError(said[0] if said else NO_INSTALLER)


def run_command(command: Sequence[str], time_limit: float, cancelled: threading.Event | None = None) -> tuple[int, str]:
    """Run a command; return its exit status and what it printed.

    It leads a session of its own, so that Ctrl-C reaches only this process, which then ends it.

    Raises
    ------
    InstallationStopped
        If ``cancelled`` was set meanwhile.
    ReleaseError
        If it takes longer than ``time_limit`` [s].
    """
    process = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        start_new_session=True,
        env=os.environ | {"PYTHONPATH": "", "NO_COLOR": "1"},
    )
    deadline = time.monotonic() + time_limit
    try:
        while True:
            try:
                text, _ = process.communicate(timeout=POLL_INTERVAL)
                return process.returncode, text
            except subprocess.TimeoutExpired:
                if cancelled is not None and cancelled.is_set():
                    raise InstallationStopped("interrupted") from None
                if time.monotonic() > deadline:
                    raise ReleaseError(f"{Path(command[0]).name}: no end within {time_limit:g} s") from None
    finally:
        if process.poll() is None:
            if hasattr(os, "killpg"):
                os.killpg(process.pid, signal.SIGKILL)  # with what it has started
            else:
                process.kill()
            process.communicate()


def one_line(text: str) -> str:
    """Return the line in which pip or uv says why it failed, without hints and ornament."""
    lines = [line.strip(" ×╰─▶├│") for line in text.splitlines()]
    printed = [line for line in lines if line and not line.startswith(("hint:", "WARNING:", "[notice]"))]
    errors = [line for line in printed if line.startswith(("ERROR:", "error:", "cause:", "Because"))] or printed[-1:]
    why = next((line for line in errors if line.startswith(("cause:", "Because"))), errors[0] if errors else "no message")
    why = re.sub(r"^(cause|error|ERROR):\s*", "", why)
    # What pip lists of other versions, and what uv concludes, is longer than the reason
    why = re.sub(r"\s*\(from versions: [^)]*\)", "", re.sub(r"^Because (.+?) and you require .*", r"\1", why))
    return shorten(" ".join(why.split()), MAX_ERROR_LENGTH)


@cache
def uv() -> str | None:
    """Return the path of uv: beside this Python, or on the PATH; None where there is none."""
    beside = Path(sys.executable).parent / ("uv.exe" if os.name == "nt" else "uv")
    return str(beside) if beside.exists() else shutil.which("uv")


def _has_pip() -> bool:
    return find_spec("pip") is not None
