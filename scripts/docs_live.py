"""MkDocs hook: add the live page to the site, so that it is never older than the model's source."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

FILE = "live.html"


def on_files(files: Any, config: Any) -> None:
    """Add the page, which is written anew, to the site's files."""
    # MkDocs loads a hook by its path, so that the project's folder is not where Python looks for modules
    sys.path.insert(0, str(Path(__file__).parents[1]))
    from mkdocs.structure.files import File

    from looping_pendulum.live.write import render

    files.append(File.generated(config, FILE, content=render()))
