"""The example folder that `init` puts in place: a scenario, a study with its marks, and a page with the next commands."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path, PurePosixPath

from looping_pendulum.compare.export import write_whole
from looping_pendulum.errors import HarnessError

HERE = resources.files("looping_pendulum.teaching")
MAP = resources.files("looping_pendulum.sweep") / "maps" / "quick.yaml"
"""A map that takes seconds."""
NOT_COPIED = ("__pycache__", "__init__.py")


class FolderError(HarnessError, ValueError):
    """A folder cannot be filled."""


def place(folder: Path) -> tuple[Path, ...]:
    """Write the example's files into ``folder``, which is made if it is not there.

    Returns
    -------
    tuple of Path
        What was written.

    Raises
    ------
    FolderError
        If it is a file, or holds anything already.
    """
    if folder.exists() and not folder.is_dir():
        raise FolderError(f"{folder}: found a file, needed a folder; name another one")
    held = sorted(entry.name for entry in folder.iterdir()) if folder.is_dir() else []
    if held:
        shown = ", ".join(held[:3]) + (", ..." if len(held) > 3 else "")
        raise FolderError(f"{folder}: found {shown}, needed an empty or a new folder; write `looping-pendulum init my_folder`")
    written = []
    for path, source in [*sorted(_files(HERE.joinpath("example"), PurePosixPath())), (PurePosixPath("map.yaml"), MAP)]:
        target = folder.joinpath(*path.parts)
        write_whole(target, source.read_bytes())
        written.append(target)
    return tuple(written)


def _files(folder: Traversable, below: PurePosixPath) -> Iterator[tuple[PurePosixPath, Traversable]]:
    """Yield every file of the shipped example, with its path in the folder."""
    for entry in folder.iterdir():
        if entry.name in NOT_COPIED:
            continue
        path = below / entry.name
        if entry.is_dir():
            yield from _files(entry, path)
        else:
            yield path, entry
