"""The example folder of `init`: a scenario, a study with its tracked points, and a page with the next commands."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path, PurePosixPath

from looping_pendulum.errors import HarnessError
from looping_pendulum.files import write_atomically

PACKAGE_FILES = resources.files("looping_pendulum.teaching")
MAP = resources.files("looping_pendulum.sweep") / "maps" / "quick.yaml"
"""Shipped map that the example folder gets as map.yaml; it takes seconds."""
NOT_COPIED = ("__pycache__", "__init__.py")


class FolderError(HarnessError, ValueError):
    """The example cannot be written into a folder."""


def write_example(folder: Path) -> tuple[Path, ...]:
    """Write the example's files into ``folder``, which is created if it does not exist.

    Returns
    -------
    tuple of Path
        The files that were written.

    Raises
    ------
    FolderError
        If it is a file, or a folder that is not empty.
    """
    if folder.exists() and not folder.is_dir():
        raise FolderError(f"{folder}: found a file, needed a folder; name another one")
    existing = sorted(entry.name for entry in folder.iterdir()) if folder.is_dir() else []
    if existing:
        shown = ", ".join(existing[:3]) + (", ..." if len(existing) > 3 else "")
        raise FolderError(f"{folder}: found {shown}, needed an empty or a new folder; write `looping-pendulum init my_folder`")
    paths = []
    for path, source in [
        *sorted(_example_files(PACKAGE_FILES.joinpath("example"), PurePosixPath())),
        (PurePosixPath("map.yaml"), MAP),
    ]:
        target = folder.joinpath(*path.parts)
        write_atomically(target, source.read_bytes())
        paths.append(target)
    return tuple(paths)


def _example_files(folder: Traversable, below: PurePosixPath) -> Iterator[tuple[PurePosixPath, Traversable]]:
    """Yield every file of the shipped example, with its path in the folder."""
    for entry in folder.iterdir():
        if entry.name in NOT_COPIED:
            continue
        path = below / entry.name
        if entry.is_dir():
            yield from _example_files(entry, path)
        else:
            yield path, entry
