"""Write files atomically, make file names that every file system accepts, and test output folders before the work starts."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import re
import secrets
import stat
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from looping_pendulum.errors import HarnessError

MAX_STEM_LENGTH = 120
"""Most characters of a file name before its extension; file systems accept 255 bytes in all."""
_DIGEST_LENGTH = 10
"""Characters of the digest that distinguishes names which would otherwise be the same."""


class OutputError(HarnessError, OSError):
    """Results cannot be written to the output folder."""


class SkippedOutputWarning(UserWarning):
    """A figure or a page could not be made and was skipped; the results themselves are written."""


def utf8(text: str) -> bytes:
    r"""Encode ``text`` as UTF-8; a lone surrogate, which UTF-8 cannot hold, becomes its escape as in JSON: \ud800."""
    return text.encode("utf-8", "backslashreplace")


def read_file(path: str | os.PathLike[str], largest: int) -> bytes:
    """Return the content of a file that a user names; of one of more than ``largest`` bytes, one byte more than that.

    Raises
    ------
    OSError
        If it cannot be read, or is a folder, a pipe or a device, which may never end.
    """
    mode = os.stat(path).st_mode
    if not stat.S_ISREG(mode):  # opening a pipe would wait for its writer
        found = "a folder" if stat.S_ISDIR(mode) else "a pipe or a device"
        raise OSError(errno.EINVAL, f"found {found}, needed a file", os.fspath(path))
    with Path(path).open("rb") as stream:
        return stream.read(largest + 1)


def write_atomically(path: Path, content: bytes | str) -> None:
    """Write a file under a temporary name and rename it, so that a crash never leaves half of it.

    The temporary file must be new (O_EXCL), so that a link that somebody has put there is not followed.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    data = utf8(content) if isinstance(content, str) else content
    partial = path.with_name(f".{path.name[:MAX_STEM_LENGTH]}.{secrets.token_hex(6)}.part")
    # Not tempfile.mkstemp, whose files are readable by their owner alone: 0o666 leaves the mode to the umask, as open() does
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
    return stem if len(stem) <= MAX_STEM_LENGTH else f"{stem[: MAX_STEM_LENGTH - _DIGEST_LENGTH - 1]}-{_digest(*parts)}"


def file_stems(names: Sequence[tuple[str, ...]]) -> list[str]:
    """Return a `file_stem` for each of several names, no two equal: names whose stems coincide get a digest appended."""
    stems = [file_stem(*parts) for parts in names]
    count = Counter(stem.lower() for stem in stems)  # some file systems do not distinguish "A" from "a"
    ambiguous = [count[stem.lower()] > 1 for stem in stems]
    return [
        f"{stem}-{_digest(*parts)}" if shared else stem for stem, shared, parts in zip(stems, ambiguous, names, strict=True)
    ]


def _digest(*parts: str) -> str:
    return hashlib.sha256(utf8("\0".join(parts))).hexdigest()[:_DIGEST_LENGTH]


@contextlib.contextmanager
def optional_output(what: str) -> Iterator[None]:
    """Turn an error inside this context into a warning: a figure or page that fails must not cost the results."""
    try:
        yield
    except Exception as error:
        why = " ".join(str(error).split())
        warnings.warn(SkippedOutputWarning(f"{what} is left out: {type(error).__name__}: {why}"), stacklevel=3)


def prepare_output_file(path: Path, *, force: bool, option: str = "--out") -> None:
    """Test, before the work starts, that one file can be written, and that no file of the user's own stands in its place.

    Raises
    ------
    OutputError
        If it could not be written, or if there is a file and ``force`` is false.
    """
    if path.is_file() and not force:
        raise OutputError(
            f"{option}: {path}: found a file, which is left as it is; name another, or add --force to overwrite this one"
        )
    prepare_output_folder(path.parent, files=(path.name,), option=option)


def prepare_output_folder(
    folder: Path, *, files: Sequence[str] = (), folders: Sequence[str] = (), record: str = "", option: str = "--out"
) -> Path:
    """Make ``folder`` and test, before the work starts, that results can be written there under their names.

    Parameters
    ----------
    files, folders
        Names of the files and folders that will be written.
    record
        That of them by which an earlier report is known: where it is missing, files of these names are a user's own.
    option
        Option that names the folder, for messages.

    Raises
    ------
    OutputError
        If results could not be written there later, or would overwrite a user's own files.
    """
    if record and not (folder / record).exists():
        # A page may be left of a run that was killed: it is written while engines still run
        own = next((name for name in files if (folder / name).is_file() and not name.endswith(".html")), "")
        if own:
            raise OutputError(
                f"{option}: {folder / own}: found a file, but no {record} of an earlier report beside it; it is left as it is; "
                "choose another folder"
            )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / f".{secrets.token_hex(6)}.part"
        try:
            with probe.open("xb") as file:
                # A byte, because a full disk may still have room for the name of an empty file
                file.write(b"\0")
        finally:
            probe.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(
            f"{option}: {folder}: {error.strerror or error}, needed a folder to write to; choose another"
        ) from None
    for name, kind in (*((name, "file") for name in files), *((name, "folder") for name in folders)):
        path = folder / name
        if path.exists() and path.is_dir() != (kind == "folder"):
            existing = "folder" if path.is_dir() else "file"
            raise OutputError(
                f"{option}: {path}: found a {existing}, needed room for a {kind} of that name; choose another folder"
            )
    return folder
