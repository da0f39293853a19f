"""Writes the live page: one file with the model, its scripts and the shipped scenarios, which needs no network.

The runs of engines come as plain data: who reads results of `compare` stands above this package (`teaching.demo`).
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from looping_pendulum import __version__
from looping_pendulum.errors import ParameterError, ScenarioError
from looping_pendulum.files import write_atomically
from looping_pendulum.live.models import live_coefficients, live_effects
from looping_pendulum.pages.shell import page
from looping_pendulum.reference_ode.parameters import NUMBERS, Parameters
from looping_pendulum.scenarios import loader
from looping_pendulum.scenarios.quantities import file_key
from looping_pendulum.scenarios.scenario import Scenario

PACKAGE = "looping_pendulum.live"
FILE = "live.html"
"""The shipped page, and what a page is called if no other name is given."""
FIRST = "ten_to_one"
"""Shipped scenario with which the page starts."""


def render(scenario: Scenario | None = None, *, engine_runs: Mapping[str, Any] | None = None, script: str | None = None) -> str:
    """Return the page, which starts with ``scenario``; None: with the first of the shipped ones.

    Parameters
    ----------
    engine_runs
        What `teaching.demo.page_data` returns of a comparison on ``scenario``: its runs are drawn beside the page's own.
    script
        The page's script; None: that of the shipped page.

    Raises
    ------
    ScenarioError
        If the scenario has an effect that the live model has not, and there are no runs to be shown in its place.
    """
    shipped = [loader.load(name) for name in loader.shipped()]
    shipped.sort(key=lambda s: s.name != FIRST)
    presets = shipped
    if scenario is not None and not any(_is_same(scenario, one) for one in shipped):
        # A scenario of the reader's own may have the name of a shipped one
        presets = [scenario, *(one for one in shipped if one.name != scenario.name)]
    return page(
        PACKAGE,
        "live.html",
        title="The looping pendulum, live"
        if engine_runs is None or scenario is None
        else f"The looping pendulum: {scenario.title}",
        styles=[(PACKAGE, "live.css")],
        scripts=[shipped_script() if script is None else script],
        webassembly=True,
        data={
            "live-data": {
                "presets": [_preset(s, shipped=s in shipped, has_runs=engine_runs is not None) for s in presets],
                "start": FIRST if scenario is None else scenario.name,
                "keys": {name: file_key(name) for name in ("release", *NUMBERS, *live_coefficients())},
            },
            "engine-runs-data": engine_runs,
        },
        version=__version__,
    )


def shipped_script() -> str:
    """Return the script of the shipped page, its last element, which `scripts/live_page.py` has put there."""
    shipped = files(PACKAGE).joinpath(FILE).read_text(encoding="utf-8")
    return shipped.rpartition("<script>")[2].partition("</script>")[0]


def write(path: Path, scenario: Scenario | None = None) -> None:
    """Write the page to ``path``."""
    write_atomically(path, render(scenario))


def _is_same(one: Scenario, other: Scenario) -> bool:
    """Return whether two scenarios are the same for this page, which shows neither tolerances nor sources."""
    return (one.name, one.title, one.description, one.parameters) == (
        other.name,
        other.title,
        other.description,
        other.parameters,
    )


def _preset(scenario: Scenario, *, shipped: bool, has_runs: bool) -> dict[str, Any]:
    """Return a scenario as the page reads it: SI units and radians, and which of its effects the page's model lacks.

    The page's languages have the texts of shipped ones.
    """
    settings_of = settings_without_absent_effects if has_runs else live_settings
    try:
        settings = settings_of(scenario.parameters)
    except ParameterError as error:
        raise ScenarioError(f"{scenario.name}: {error}; `looping-pendulum demo` shows runs of this scenario") from None
    return {
        "name": scenario.name,
        "title": scenario.title,
        "description": " ".join(scenario.description.split()),
        "shipped": shipped,
        "release": settings.pop("release"),
        "settings": settings,
        "lacks": list(absent_effects(scenario.parameters)),
        "duration": scenario.duration,
    }


def absent_effects(parameters: Parameters) -> tuple[str, ...]:
    """Return the names of the effects that act on the apparatus and that the live model does not have."""
    known = {effect.name for effect in live_effects(parameters.release)}
    return tuple(effect.name for effect in parameters.effects if effect.name not in known)


def live_settings(parameters: Parameters) -> dict[str, float | str]:
    """Return the settings [SI] by name, for `simulate` of `run.js`.

    Raises
    ------
    ParameterError
        If an effect acts that the live model does not have.
    """
    absent = absent_effects(parameters)
    if absent:
        known = ", ".join(sorted(effect.name for effect in live_effects(parameters.release)))
        raise ParameterError(f"effects: found {absent[0]}, which the live model does not have; it has {known}")
    return settings_without_absent_effects(parameters)


def settings_without_absent_effects(parameters: Parameters) -> dict[str, float | str]:
    """Return the settings of the live model that is nearest to an apparatus: the same, without `absent_effects`."""
    numbers = {name: float(getattr(parameters, name)) for name in NUMBERS}
    coefficients = {name: parameters.coefficients[name] for name in live_coefficients()}
    return {"release": parameters.release.value, **numbers, **coefficients}
