"""Kinds of files that a command may be given, and the command that each kind is for."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import typer

from looping_pendulum.errors import HarnessError
from looping_pendulum.installation import command_line

COMMANDS = {"scenario": "run", "study": "identify", "map": "map", "table of numbers": "new study", "film": "track"}
"""Kind of a file -> the first command for it."""
KEYS = {
    "study": ("apparatus", "trials"),
    "scenario": ("light", "heavy", "rod", "release"),
    "map": ("parameters",),
}
"""Kind of a YAML file -> keys at its top level that no other kind has."""
HEAD_SIZE = 64 * 1024
"""How much of a file is read to tell its kind [bytes]: the largest scenario that is read."""
ROW_OF_NUMBERS = re.compile(r"^[-+\d.eE;,\t ]*\d[;,\t ]+[-+.]?\d[-+\d.eE;,\t ]*$", re.MULTILINE)


def kind_of(path: Path) -> str | None:
    """Return the kind of a file, a key of `COMMANDS`; None if it is none of them, or none that can be read."""
    from looping_pendulum.measured.film import is_film
    from looping_pendulum.measured.tables.tracker_project import is_project

    try:
        if not path.is_file():
            return None
        if is_film(path):
            return "film"
        with path.open("rb") as stream:
            text = stream.read(HEAD_SIZE).decode("utf-8", "replace")
    except (OSError, ValueError):  # no such name for this file system
        return None
    for kind, keys in KEYS.items():
        if re.search(rf"^({'|'.join(keys)})[ \t]*:", text, re.M):
            return kind
    is_table = is_project(str(path)) or ROW_OF_NUMBERS.search(text.replace("\r", "\n"))
    return "table of numbers" if is_table else None


def takes(*kinds: str) -> Callable[[typer.Context, Any], Any]:
    """Return a callback of an argument or option that refuses a file of another kind, and says which command that is for."""

    def check(ctx: typer.Context, given: Any) -> Any:
        for file in () if ctx.resilient_parsing or given is None else given if isinstance(given, list) else [given]:
            kind = kind_of(Path(str(file)))
            if kind is not None and kind not in kinds:
                needed = " or a ".join(kinds)
                command = command_line(*COMMANDS[kind].split(), file)
                raise HarnessError(f"{file}: found a {kind}, needed a {needed}; with a {kind}, write: {command}")
        return given

    return check
