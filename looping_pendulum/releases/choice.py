"""Choose what a study of releases runs: variants of one engine, and releases of its package."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence

from packaging.version import InvalidVersion, Version

from looping_pendulum.engines.protocol import Engine, Profile
from looping_pendulum.engines.registry import all_engines, label, unknown_engine_message
from looping_pendulum.errors import EngineError
from looping_pendulum.releases.installers import ReleaseError


def chosen_variants(engine: str, variants: Iterable[str], profile: Profile) -> list[Engine]:
    """Return the variants of ``engine`` with these names, or without names its main ones; all, if none is a main one.

    Raises
    ------
    EngineError
        If the engine or a variant is not known, or is the reference, which is no engine's release.
    """
    engines = all_engines(profile)
    own = [each for each in engines if each.name == engine and engine != "reference"]
    if not own:
        raise EngineError(unknown_engine_message(engine, [each for each in engines if each.name != "reference"]))
    names = tuple(variants)
    if not names:
        return [each for each in own if each.abilities.main] or own
    by_name = {each.variant: each for each in own} | {label(each): each for each in own}
    for name in names:
        if name not in by_name:
            known = ", ".join(each.variant for each in own)
            raise EngineError(f"--variant: {engine} has no variant {name!r}; it has {known}")
    return [each for each in own if each in [by_name[name] for name in names]]


def chosen_releases(
    package: str,
    available: Sequence[Version],
    *,
    first: str | None = None,
    last: str | None = None,
    listed: str | None = None,
) -> list[Version]:
    """Return the releases from ``first`` to ``last``, both included, or those ``listed`` with commas between, oldest first.

    Raises
    ------
    ReleaseError
        If a word is no version, a listed release does not exist, or none lies between the two.
    """
    if listed is not None:
        if first is not None or last is not None:
            raise ReleaseError("--versions: found it beside --from or --to, needed one of the two ways; leave one out")
        wanted = sorted({_version("--versions", word.strip()) for word in listed.split(",") if word.strip()})
        for version in wanted:
            if version not in available:
                near = difflib.get_close_matches(str(version), [str(v) for v in available], n=3, cutoff=0.3)
                nearest = f"; near it are {', '.join(near)}" if near else ""
                raise ReleaseError(f"--versions: {package} has no release {version}{nearest}; {_range(available)}")
        chosen = wanted
    elif first is None and last is None:
        raise ReleaseError(f"needed --from V, --to V or --versions V,W; {package}: {_range(available)}")
    else:
        low = available[0] if first is None else _version("--from", first)
        high = available[-1] if last is None else _version("--to", last)
        chosen = [version for version in available if low <= version <= high]
        if not chosen:
            raise ReleaseError(f"{package} has no release from {low} to {high}; {_range(available)}")
    if not chosen:
        raise ReleaseError("--versions: found no version, needed one or more with commas between; write 3.1.0,3.2.7")
    return chosen


def _version(option: str, word: str) -> Version:
    try:
        return Version(word)
    except InvalidVersion:
        raise ReleaseError(f"{option}: found {word!r}, needed a version; write for example 3.1.0") from None


def _range(available: Sequence[Version]) -> str:
    return f"it has {len(available)} releases, {available[0]} to {available[-1]}"
