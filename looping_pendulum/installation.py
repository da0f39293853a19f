"""How to install a further package where this program is installed: hints about missing packages take their command here."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from importlib.machinery import PathFinder
from importlib.metadata import PackageNotFoundError, requires
from pathlib import Path

DISTRIBUTION = "looping-pendulum"


def install_command(*packages: str, anywhere: bool = False) -> str:
    """Return the shell command that installs ``packages`` into the environment in which this program runs.

    It names that environment, so that it works from any folder, whether or not the environment is activated, and whether this
    package was installed from a checkout or a wheel. Versions are those that this project asks for.

    Parameters
    ----------
    packages : str
        Names by which pip knows them.
    anywhere : bool
        For text that is read on other machines, such as a report: the command does not name the environment.
    """
    program = ["pip", "install"] if anywhere else _installer()
    # Double quotes around what a shell would interpret: sh, PowerShell and cmd.exe all take them
    requirements = [f'"{r}"' if r != shlex.quote(r) else r for r in map(_requirement, packages)]
    return " ".join([_quoted(program), *requirements])


def _installer() -> list[str]:
    """Return the words of the command that installs into this environment."""
    if Path(sys.prefix, "pipx_metadata.json").exists():
        return ["pipx", "inject", DISTRIBUTION]
    python = _shown(Path(sys.executable))
    # Not importlib.util.find_spec: it would ask setuptools' finder for pip, after which setuptools cannot be imported any more
    if PathFinder.find_spec("pip") is None:  # as in every environment that uv makes
        return ["uv", "pip", "install", "--python", python]
    return [python, "-m", "pip", "install"]


def _shown(program: Path) -> str:
    """Return a program's path, from the working folder if it is below that one."""
    return os.path.relpath(program) if program.is_relative_to(Path.cwd()) else str(program)


def command_line(*words: object) -> str:
    """Return this program's command with ``words``, quoted where a shell would take them apart, so that it can be pasted."""
    return _quoted([DISTRIBUTION, *map(str, words)])


def quoted(word: object) -> str:
    """Return one word of a command line, in quotes where a shell would take it apart."""
    return _quoted([str(word)])


def _quoted(words: list[str]) -> str:
    """Return words as a command line; an executable in quotes is a string to PowerShell, which needs & before it."""
    if os.name == "nt":
        line = subprocess.list2cmdline(words)
        return f"& {line}" if line.startswith('"') else line
    return shlex.join(words)


def _requirement(package: str) -> str:
    """Return the requirement by which this project asks for ``package``, or its name alone."""
    from packaging.requirements import Requirement
    from packaging.utils import canonicalize_name

    try:
        lines = requires(DISTRIBUTION) or []
    except PackageNotFoundError:  # run from a folder of sources
        lines = []
    for requirement in map(Requirement, lines):
        if canonicalize_name(requirement.name) == canonicalize_name(package):
            extras = f"[{','.join(sorted(requirement.extras))}]" if requirement.extras else ""
            return f"{requirement.name}{extras}{requirement.specifier}"
    return package
