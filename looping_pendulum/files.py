"""Files that are whole or absent, names that every file system takes, and folders that are tried before the work."""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import secrets
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from looping_pendulum.errors import HarnessError

LONGEST_STEM = 120
"""Characters of a file's name before its ending; file systems take 255 bytes in all."""
_DIGEST = 10
"""Characters that tell apart names which would look the same."""


class OutputError(HarnessError, OSError):
    """The place where results are to go cannot take them."""


class LeftOutWarning(UserWarning):
    """A figure or a page could not be made; the results themselves are written."""


def utf8(text: str) -> bytes:
    r"""Encode ``text``; half of a surrogate pair, which is no character, becomes its escape, as JSON writes it: \ud800."""
    return text.encode("utf-8", "backslashreplace")


def write_whole(path: Path, content: bytes | str) -> None:
    """Write a file under a temporary name and rename it, so that a crash never leaves half of it.

    The temporary file is a new one: a link that somebody has put there is not followed.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    data = utf8(content) if isinstance(content, str) else content
    partial = path.with_name(f".{path.name[:LONGEST_STEM]}.{secrets.token_hex(6)}.part")
    file = os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o666)
    try:
        with os.fdopen(file, "wb") as stream:
            stream.write(data)
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def file_stem(*parts: str) -> str:
    """Return a file name that every file system takes: ("pymunk:chain", "quick") -> "pymunk-chain-quick"."""
    stem = re.sub(r"[^A-Za-z0-9.]+", "-", "-".join(p for p in parts if p)).strip("-.") or "run"
    return stem if len(stem) <= LONGEST_STEM else f"{stem[: LONGEST_STEM - _DIGEST - 1]}-{_digest(*parts)}"


def file_stems(names: Sequence[tuple[str, ...]]) -> list[str]:
    """Return a `file_stem` for each of several names, no two alike: of those that would be, each gets a digest of its name."""
    stems = [file_stem(*parts) for parts in names]
    count = Counter(stem.lower() for stem in stems)  # some file systems do not tell "A" from "a"
    alike = [count[stem.lower()] > 1 for stem in stems]
    return [f"{stem}-{_digest(*parts)}" if shared else stem for stem, shared, parts in zip(stems, alike, names, strict=True)]


def _digest(*parts: str) -> str:
    return hashlib.sha256(utf8("\0".join(parts))).hexdigest()[:_DIGEST]


@contextlib.contextmanager
def decoration(what: str) -> Iterator[None]:
    """Let what is only for the eye fail with a warning: it must not cost the results."""
    try:
        yield
    except Exception as error:
        why = " ".join(str(error).split())
        warnings.warn(LeftOutWarning(f"{what} is left out: {type(error).__name__}: {why}"), stacklevel=3)


def ready_folder(folder: Path, *, files: Sequence[str] = (), folders: Sequence[str] = ()) -> Path:
    """Make ``folder`` and try it, before the work: a file can be written there, and nothing stands in the way of the results.

    Parameters
    ----------
    files, folders
        Names that the results will have.

    Raises
    ------
    OutputError
        If results could not be written there later.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / f".{secrets.token_hex(6)}.part"
        try:
            with probe.open("xb") as file:
                file.write(b"\0")
        finally:
            probe.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"--out: {folder}: {error.strerror or error}, needed a folder to write to; choose another") from None
    for name, wanted in (*((name, "file") for name in files), *((name, "folder") for name in folders)):
        place = folder / name
        if place.exists() and place.is_dir() != (wanted == "folder"):
            found = "folder" if place.is_dir() else "file"
            raise OutputError(
                f"--out: {place}: found a {found}, needed room for a {wanted} of that name; choose another folder"
            )
    return folder
