"""A forked process per test run, in a copy of the project: third-party packages are imported once, ours in every child."""

import contextlib
import gc
import importlib
import os
import resource
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

COPIED = (
    "looping_pendulum",
    "tests",
    "scripts",
    "docs",
    "pyproject.toml",
    "README.md",
    "CHANGELOG.md",
    "mkdocs.yml",
    "Makefile",
)

PRELOADED = (
    "numpy scipy.integrate scipy.optimize scipy.interpolate scipy.stats scipy.special heyoka pytest hypothesis pydantic pint "
    "yaml matplotlib.pyplot rich.console rich.progress typer plotly.graph_objects jinja2 markdown_it xarray zarr sympy coverage"
).split()
"""What the tests import and we do not change."""

MEMORY = 12 * 2**30
"""Bytes of address space that a child may ask for: a mutant that grows without end dies alone."""

TIME_OUTS = (-signal.SIGPROF, -signal.SIGALRM)
"""Statuses of a child whose test used more processor time than it may, and of one that waited too long."""


def preload() -> None:
    """Import what every child needs."""
    os.environ.setdefault("MPLBACKEND", "Agg")
    for name in PRELOADED:
        with contextlib.suppress(ImportError):
            importlib.import_module(name)
    freeze()


def freeze() -> None:
    """Let children neither walk nor copy what is there now."""
    gc.collect()
    gc.freeze()


@contextlib.contextmanager
def project_copy(root: Path) -> Iterator[Path]:
    """Copy of the project that a mutant may be written into, and that its children and theirs import from."""
    with tempfile.TemporaryDirectory(prefix="mutation-") as folder:
        copy = Path(folder)
        for name in COPIED:
            source = root / name
            if source.is_dir():
                shutil.copytree(source, copy / name, ignore=shutil.ignore_patterns("__pycache__"))
            elif source.is_file():
                shutil.copy(source, copy / name)
        yield copy


def run_child(copy: Path, log: Path, work: Callable[[], int], limit: float, *, fresh: bool = True) -> tuple[int, float]:
    """Call ``work`` in a forked process that imports the project from ``copy``, and end it after ``limit`` [s].

    Parameters
    ----------
    fresh
        Whether it imports the project anew.

    Returns
    -------
    int
        What ``work`` returned, or minus the number of the signal that ended the process.
    float
        Wall time [s].
    """
    start = time.monotonic()
    pid = os.fork()
    if pid == 0:
        status = 70
        try:
            if fresh:
                become_child(copy, log)
            else:
                _own_group(log)
            status = work()
        except BaseException:
            import traceback

            traceback.print_exc()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(status)
    status = _wait(pid, start + limit)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(pid, signal.SIGKILL)  # what the tests left behind
    return status, time.monotonic() - start


def forget_bytecode() -> None:
    """Let this child and its own leave no compiled files: a mutant's would be taken for the code's."""
    os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
    sys.dont_write_bytecode = True


def _wait(pid: int, deadline: float) -> int:
    pause = 0.005
    while True:
        done, status = os.waitpid(pid, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        if time.monotonic() > deadline:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
            return -signal.SIGALRM
        time.sleep(pause)
        pause = min(2 * pause, 0.1)


def _own_group(log: Path) -> None:
    """Become the leader of a process group, so that whatever is started can be ended; print to ``log``."""
    os.setsid()
    for out in (1, 2):
        os.dup2(os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644), out)


def become_child(copy: Path, log: Path) -> None:
    """Let this process import the project from ``copy`` and print to ``log``."""
    _own_group(log)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    os.chdir(copy)
    os.environ |= {"PYTHONPATH": str(copy), "CI": "true"}  # CI: Hypothesis draws the same every time
    for name in [n for n in sys.modules if n.split(".")[0] in ("tests", "looping_pendulum")]:
        del sys.modules[name]
    sys.path[:] = [
        str(copy),
        *(p for p in sys.path if p not in ("", os.getcwd()) and not (Path(p) / "looping_pendulum").is_dir()),
    ]
