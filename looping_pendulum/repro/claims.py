"""List the scripts for an engine's own users, claims and recipes, each of which says in its head all that is known here.

A claim, in `scripts/`, shows what an engine does wrong; a recipe, in `recipes/`, shows settings with which it does right. A
script is named ENGINE_NAME.py and imports nothing but the engine and NumPy, so that a stranger can run it. Its docstring is
the head: a first line with the claim, an explanation, and then one line each of

- ``Closed form``: the exact value with its unit, and what it is;
- ``Observed``: the value with its unit, the package and version it was observed with, and how far another machine's may differ;
- ``Mended`` in a claim, ``Reached`` in a recipe: how near to the closed form the observed value must be for the claim to hold
  no longer, or for the recipe to hold; the script's exit status is then 0, and otherwise 1;
- ``Study``: the variant of this package that the script concerns;
- ``Default``: where the cause is a hidden default of the engine study (docs/accuracy.md), its name; several by commas.
"""

from __future__ import annotations

import ast
import re
from dataclasses import dataclass
from importlib.resources import files

from looping_pendulum.errors import HarnessError

CLAIMS, RECIPES = "scripts", "recipes"
"""Folders of the scripts."""
HEAD = re.compile(
    r"(?P<engine>[^:\n]+): (?P<title>[^\n]+)\n\n"
    r"(?P<text>.+?)\n\n"
    r"Closed form: (?P<closed_form>(?P<expected>[^\s,]+)[^\n]*)\n"
    r"Observed: (?P<observed>\S+)(?P<unit>| \S+) with (?P<package>\S+) (?P<version>\S+), give or take (?P<spread>\S+)\n"
    r"(?:Mended|Reached): within (?P<limit>\S+)(?P=unit) of the closed form\n"
    r"Study: \w+:(?P<variant>\w+)"
    r"(?:\nDefault: (?P<defaults>[^\n]+))?",
    re.DOTALL,
)
"""What a script's docstring must be."""


class ClaimError(HarnessError, ValueError):
    """There is no such claim or recipe, engine or variant."""


@dataclass(frozen=True, kw_only=True)
class Claim:
    """One claim about an engine, or one recipe for it, and the script that shows it."""

    engine: str
    """Name of the engine, as in `looping-pendulum engines`."""
    name: str
    """Name of the claim or recipe, unique for its engine; a recipe's is that of its variant."""
    title: str
    """The claim or the recipe, as a sentence."""
    variant: str
    """Variant of the engine that it concerns."""
    defaults: tuple[str, ...]
    """Hidden defaults of the engine study that cause it."""
    closed_form: str
    """Exact value, with unit and meaning."""
    expected: float
    """Exact value, rounded, in the script's unit."""
    observed: float
    """Value that the engine gave, in the script's unit."""
    unit: str
    """Unit of the values; '' for a pure number."""
    spread: float
    """How far another machine's value may differ, in the script's unit."""
    limit: float
    """Distance from the closed form up to which a claim counts as mended, or a recipe holds, in the script's unit."""
    package: str
    """Distribution that the engine is installed with."""
    version: str
    """Its version that the value was observed with."""
    source: str
    """Text of the script."""

    @property
    def file_name(self) -> str:
        """Return the name of the script's file."""
        return f"{self.engine}_{self.name}.py"


def read_claim(file_name: str, source: str) -> Claim:
    """Return the claim of a script.

    Raises
    ------
    ValueError
        If its head is not as `HEAD` says.
    """
    head = HEAD.fullmatch(ast.get_docstring(ast.parse(source)) or "")
    if head is None:
        raise ValueError(f"{file_name}: found another head than looping_pendulum/repro/claims.py describes")
    engine, _, name = file_name.removesuffix(".py").partition("_")
    return Claim(
        engine=engine,
        name=name,
        title=head["title"],
        variant=head["variant"],
        defaults=tuple(head["defaults"].split(", ")) if head["defaults"] else (),
        closed_form=head["closed_form"],
        expected=float(head["expected"]),
        observed=float(head["observed"]),
        unit=head["unit"].strip(),
        spread=float(head["spread"]),
        limit=float(head["limit"]),
        package=head["package"],
        version=head["version"],
        source=source,
    )


def all_claims(folder: str = CLAIMS) -> list[Claim]:
    """Return all claims, or with `RECIPES` all recipes, sorted by engine and name."""
    scripts = files("looping_pendulum").joinpath("repro", folder).iterdir()
    return [
        read_claim(script.name, script.read_text(encoding="utf-8"))
        for script in sorted(scripts, key=lambda script: script.name)
        if script.name.endswith(".py")
    ]


def find_claims(engine: str, variant: str | None = None, name: str | None = None, folder: str = CLAIMS) -> list[Claim]:
    """Return the claims about ``engine``, with ``variant`` and ``name`` those that concern this variant or have this name.

    With ``folder`` `RECIPES` these are recipes.

    Raises
    ------
    ClaimError
        If there is none; the message names the choices.
    """
    claims, kind = all_claims(folder), "recipe for" if folder == RECIPES else "claim about"
    of_engine = [claim for claim in claims if claim.engine == engine]
    _refuse_unknown(of_engine, "engine", engine, {claim.engine for claim in claims})
    chosen = [claim for claim in of_engine if variant in (None, claim.variant)]
    _refuse_unknown(chosen, f"variant of {engine}", variant, {claim.variant for claim in of_engine})
    named = [claim for claim in chosen if name in (None, claim.name)]
    label = engine if variant is None else f"{engine}:{variant}"
    _refuse_unknown(named, f"{kind} {label}", name, {claim.name for claim in chosen})
    return named


def _refuse_unknown(found: list[Claim], what: str, name: str | None, choices: set[str]) -> None:
    """Raise `ClaimError` if nothing was found by a name."""
    if not found:
        raise ClaimError(f"found '{name}', needed the {what}; choose one of {', '.join(sorted(choices))}")
