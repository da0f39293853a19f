"""Track a film: from the pictures of a camera that stands still to the points of both masses, in the order of the modules.

`decode` reads pictures and their times, `moving` finds what moves before a still background, `pendulum` tells the masses from
all else by the string that ties them, `geometry` fits camera and release, `points` gives the masses' points their errors,
`track` is the function to call, and `record` what it returns and what stands beside the film. Only that is needed to read it.
"""

from __future__ import annotations

from pathlib import Path

from looping_pendulum.errors import HarnessError

FILM_ENDINGS = (".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm", ".3gp", ".mts", ".m2ts", ".mpg", ".mpeg", ".wmv", ".gif")
"""Endings of file names that are taken for films where a table may stand, too."""


class FilmError(HarnessError, ValueError):
    """A film cannot be read, or the masses cannot be found in it."""


def is_film(path: str | Path) -> bool:
    """Return whether a file is a film by its name."""
    return Path(path).suffix.lower() in FILM_ENDINGS
