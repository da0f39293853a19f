"""Writes the live page: one file with the model, its scripts and the shipped scenarios, which needs no network."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from looping_pendulum import __version__
from looping_pendulum.errors import ParameterError, ScenarioError
from looping_pendulum.files import write_atomically
from looping_pendulum.live.bundle import PACKAGE, bundle
from looping_pendulum.live.settings import live_settings
from looping_pendulum.live.symbols import live_coefficients
from looping_pendulum.pages.shell import page
from looping_pendulum.reference_ode.parameters import NUMBERS
from looping_pendulum.scenarios import loader
from looping_pendulum.scenarios.scenario import Scenario, file_key

FILE = "live.html"
FIRST = "ten_to_one"
"""Shipped scenario with which the page starts."""


def render(scenario: Scenario | None = None) -> str:
    """Return the page, which starts with ``scenario``; None: with the first of the shipped ones.

    Raises
    ------
    ScenarioError
        If the scenario has an effect that the live model has not.
    """
    shipped = [loader.load(name) for name in loader.shipped()]
    shipped.sort(key=lambda s: s.name != FIRST)
    own = [scenario] if scenario is not None and scenario not in shipped else []
    return page(
        PACKAGE,
        "live.html",
        title="The looping pendulum, live",
        styles=[(PACKAGE, "live.css")],
        scripts=[bundle("assets/main.js")],
        blob_workers=True,
        data={
            "live-data": {
                "presets": [_preset(s, shipped=s in shipped) for s in (*own, *shipped)],
                "start": FIRST if scenario is None else scenario.name,
                "keys": {name: file_key(name) for name in ("release", *NUMBERS, *live_coefficients())},
            }
        },
        version=__version__,
    )


def write(path: Path, scenario: Scenario | None = None) -> None:
    """Write the page to ``path``."""
    write_atomically(path, render(scenario))


def _preset(scenario: Scenario, *, shipped: bool) -> dict[str, Any]:
    """Return a scenario as the page reads it: SI units and radians; the page's languages have the texts of shipped ones."""
    try:
        settings = live_settings(scenario.parameters)
    except ParameterError as error:
        raise ScenarioError(f"{scenario.name}: {error}; show this scenario by `looping-pendulum demo`") from None
    return {
        "name": scenario.name,
        "title": scenario.title,
        "description": " ".join(scenario.description.split()),
        "shipped": shipped,
        "release": settings.pop("release"),
        "settings": settings,
    }
