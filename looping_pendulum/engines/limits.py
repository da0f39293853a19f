"""Expand the tolerances of a scenario from engine names to engine variants.

A scenario file names an engine as a command line does: "mujoco:capstan" for one variant, "mujoco" for all its main variants. A
limit under a variant's own name replaces one on the same metric under the engine's name.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Sequence

from looping_pendulum.engines.protocol import Engine, Profile
from looping_pendulum.engines.registry import ADAPTERS, label, load_engines, unknown_engine_message
from looping_pendulum.errors import ScenarioError
from looping_pendulum.scenarios.scenario import Scenario


def expand_tolerances(scenario: Scenario, profile: Profile) -> Scenario:
    """Return ``scenario`` with every tolerance under the name of one variant.

    Raises
    ------
    ScenarioError
        If a tolerance names an engine that no installed package offers, or one without a main variant.
    """
    engines, faults = load_engines(profile)
    variants = {name: _variants(name, scenario.name, engines, faults) for name in {t.engine for t in scenario.tolerances}}
    explicit = {(t.engine, t.profile, t.metric) for t in scenario.tolerances}
    tolerances = [
        dataclasses.replace(tolerance, engine=variant)
        for tolerance in scenario.tolerances
        for variant in variants[tolerance.engine]
        if variant == tolerance.engine or (variant, tolerance.profile, tolerance.metric) not in explicit
    ]
    return dataclasses.replace(scenario, tolerances=tuple(tolerances))


def _variants(name: str, scenario: str, engines: Sequence[Engine], faults: dict[str, str]) -> list[str]:
    """Return the labels of the variants that ``name`` refers to."""
    if name in {label(engine) for engine in engines}:
        return [name]
    fault = faults.get(name.partition(":")[0])
    if fault is not None and name.partition(":")[0] not in ADAPTERS:
        raise ScenarioError(f"{scenario}: tolerances: {fault}")
    same_engine = [engine for engine in engines if engine.name == name]
    main = [label(engine) for engine in same_engine if engine.abilities.main]
    if main:
        return main
    if same_engine:
        choice = ", ".join(label(engine) for engine in same_engine)
        raise ScenarioError(f"{scenario}: tolerances: {name!r} has no main variant; write one of {choice}")
    raise ScenarioError(f"{scenario}: tolerances: {unknown_engine_message(name, engines)}")


def why_no_tolerances(scenario: Scenario, profile: str, asked: Collection[str] | None) -> str:
    """Return why ``scenario`` has no limit for ``profile`` on any of the variants ``asked`` (None: all); empty: it has some."""
    named = list(dict.fromkeys(t.engine for t in scenario.tolerances if t.profile == profile))
    if any(asked is None or name in asked for name in named):
        return ""
    others = sorted({t.profile for t in scenario.tolerances} - {profile})
    if named:
        return f"no tolerances for profile {profile} of the engines asked for: it has them for {', '.join(named)}"
    way = f"it has them for profile {others[0]}" if others else "add some under `tolerances:`"
    return f"no tolerances for profile {profile}: {way}"
