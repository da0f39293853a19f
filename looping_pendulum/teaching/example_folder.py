"""The example folder of `init`: a scenario, a study with its tracked points, and a page with the next commands."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from looping_pendulum.files import OutputError, write_atomically

EXAMPLE = resources.files("looping_pendulum.teaching") / "example"
MAP = resources.files("looping_pendulum.sweep") / "maps" / "quick.yaml"
"""Shipped map that the example folder gets as map.yaml; it takes seconds."""
NOT_COPIED = {"__pycache__", "__init__.py"}


def write_example(folder: Path) -> tuple[Path, ...]:
    """Write the example's files into ``folder``, which is created if it does not exist.

    Returns
    -------
    tuple of Path
        The files that were written.

    Raises
    ------
    OutputError
        If it is a file, or a folder that is not empty.
    """
    if folder.exists() and not folder.is_dir():
        raise OutputError(f"{folder}: found a file, needed a folder; name another one")
    existing = sorted(entry.name for entry in folder.iterdir()) if folder.is_dir() else []
    if existing:
        shown = ", ".join(existing[:3]) + (", ..." if len(existing) > 3 else "")
        raise OutputError(f"{folder}: found {shown}, needed an empty or a new folder; write `looping-pendulum init my_folder`")
    with resources.as_file(EXAMPLE) as example:
        sources = {path.relative_to(example): path for path in sorted(example.rglob("*")) if path.is_file()}
        kept = {path: source.read_bytes() for path, source in sources.items() if not NOT_COPIED.intersection(path.parts)}
    contents = kept | {Path("map.yaml"): MAP.read_bytes()}
    for path, content in contents.items():
        write_atomically(folder / path, content)
    return tuple(folder / path for path in contents)
