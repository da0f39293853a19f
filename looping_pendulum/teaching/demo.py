"""The live page with the runs of a comparison in it, each beside the page's own, in one file that works offline."""

from __future__ import annotations

import os
import sys
import webbrowser
from pathlib import Path

from looping_pendulum.compare.result import ComparisonResult
from looping_pendulum.files import write_atomically
from looping_pendulum.live.write import render as render_live
from looping_pendulum.reference_ode.parameters import parameters_from
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.teaching.engine_runs import page_data

FILE = "demo.html"


def render(result: ComparisonResult) -> str:
    """Return the page of a comparison that has its trajectories.

    Raises
    ------
    ValueError
        If ``result`` was read from a file without them.
    """
    scenario = Scenario(
        name=result.scenario,
        title=result.title,
        description=result.description,
        parameters=parameters_from(result.parameters),
        duration=result.duration,
    )
    return render_live(scenario, engine_runs=page_data(result))


def write(result: ComparisonResult, path: Path) -> None:
    """Write the page to ``path``."""
    write_atomically(path, render(result))


def show(path: Path) -> bool:
    """Open ``path`` in the user's browser; return False if there is no browser with a screen."""
    if sys.platform.startswith("linux") and not any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"))):
        return False  # webbrowser would start a text browser in this terminal, which can show no animation
    return webbrowser.open(path.resolve().as_uri())
