"""The demonstration page: an animation of every engine and the reference together, in one file that works offline."""

from __future__ import annotations

import os
import sys
import webbrowser
from pathlib import Path

from looping_pendulum.compare.export import write_atomically
from looping_pendulum.compare.result import ComparisonResult
from looping_pendulum.engines.tension import AVERAGING_TIME
from looping_pendulum.pages.glossary import glossary
from looping_pendulum.pages.shell import asset, page
from looping_pendulum.teaching.demo_data import EVENT_KINDS, page_data

HERE = "looping_pendulum.teaching"
SCRIPTS = ("motion.js", "stage.js", "panels.js", "timeline.js", "demo.js")
FILE = "demo.html"


def render(result: ComparisonResult) -> str:
    """Return the page of a comparison that has its trajectories.

    Raises
    ------
    ValueError
        If ``result`` was read from a file without them.
    """
    data = page_data(result)
    return page(
        HERE,
        "demo.html",
        title=f"Looping pendulum: {result.title}",
        styles=[(HERE, "demo.css")],
        scripts=["\n".join(['"use strict";', *(asset(HERE, name) for name in SCRIPTS)])],
        data={"demo-data": data},
        result=result,
        runs=data["runs"],
        trial=data["trial"],
        rate=data["rate"],
        tension_window=round(1e3 * AVERAGING_TIME),
        string=data["string"],
        kinds=EVENT_KINDS,
        glossary=glossary("comparison"),
    )


def write(result: ComparisonResult, folder: Path) -> Path:
    """Write the page into ``folder``; return its path."""
    path = folder / FILE
    write_atomically(path, render(result))
    return path


def show(path: Path) -> bool:
    """Open ``path`` in the user's browser; return False if there is no browser with a screen."""
    if sys.platform.startswith("linux") and not any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"))):
        return False  # webbrowser would start a text browser in this terminal, which can show no animation
    return webbrowser.open(path.resolve().as_uri())
