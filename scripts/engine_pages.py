"""Write docs/engines/NAME.md, a page for each engine, from the declarations of its variants.

python -m scripts.engine_pages
"""

import re
from pathlib import Path

from looping_pendulum.compare.convergence.report import format_setting
from looping_pendulum.engines.protocol import Engine, Profile
from looping_pendulum.engines.registry import all_engines, how_to_get, label
from looping_pendulum.engines.support import kind
from looping_pendulum.engines.trajectory import supplies_as_rows
from looping_pendulum.pages.markdown import table
from looping_pendulum.reference_ode.effects import COEFFICIENTS, EFFECTS
from looping_pendulum.scenarios.quantities import file_key
from looping_pendulum.scenarios.units import pretty

DOCS = Path(__file__).parents[1] / "docs"
FOLDER = DOCS / "engines"
_ENTRY = re.compile(r"^ +- (.+): engines/(\w+)\.md$", re.MULTILINE)
TITLES = {name: title for title, name in _ENTRY.findall((DOCS.parent / "mkdocs.yml").read_text(encoding="utf-8"))}
"""Engine -> its title, in the order of the site's contents."""
KIND_SENTENCES = {
    "reference": "All other engines are compared with the reference.",
    "main": "It runs in every comparison.",
    "study": "It is for studies and runs only if it is named.",
}


def main() -> None:
    """Write the pages."""
    FOLDER.mkdir(exist_ok=True)
    for name, text in pages().items():
        (FOLDER / f"{name}.md").write_text(text, encoding="utf-8")


def pages() -> dict[str, str]:
    """Return engine -> the text of its page."""
    engines = all_engines(Profile.QUICK)
    return {name: page(name, [e for e in engines if e.name == name]) for name in TITLES}


def page(name: str, variants: list[Engine]) -> str:
    """Return the page of one engine."""
    packages = sorted({package for engine in variants for package in engine.abilities.packages})
    get = "\n".join(f"- `{package}`: {how_to_get(package, anywhere=True)}" for package in packages)
    sections = "\n".join(_variant(engine) for engine in variants)
    effects = f"\n{_effects()}" if name == "reference" else ""
    return (
        f"# {TITLES[name]}\n\n"
        "`python -m scripts.engine_pages` writes this page from what each variant declares; do not edit it by hand. "
        "[Engines](../engines.md) explains the conventions, and the traps that the adapters avoid; "
        "[engine study](../engine-study.md) shows the errors and their causes; "
        "the [glossary](../glossary.md) explains the terms.\n\n"
        f"How to install what it needs ([what installs where](../install.md)):\n\n{get}\n\n{sections}{effects}"
    )


def _variant(engine: Engine) -> str:
    a = engine.abilities
    supplies = table(["physics", "by", "how"], supplies_as_rows(a.supplies), left=3)
    limits = "".join(f"- {limit}\n" for limit in a.limits) or "None declared.\n"
    text = f"## {label(engine)}\n\n{_sentence(a.summary)} {KIND_SENTENCES[kind(engine)]}\n\n{supplies}\n### Limits\n\n{limits}"
    if a.additions:
        text += "\n### What the adapter adds\n\n" + "".join(f"- {addition}\n" for addition in a.additions)
    studies = engine.studies()
    ladders = [[each.setting, ", ".join(format_setting(v, each.unit) for v in each.values)] for each in studies.ladders]
    tables: dict[str, tuple[list[str], list[list[str]]]] = {
        "Checks that it fails": (
            ["check", "measured reason"],
            [[check.replace("_", " "), why] for check, why in a.known_failures.items()],
        ),
        "Hidden defaults": (
            ["setting", "default", "value used here", "effect"],
            [[d.setting, d.default, d.ours, d.effect] for d in studies.defaults],
        ),
        "Choices of the adapter": (
            ["choice", "used here", "equally good alternative"],
            [[c.what, c.ours, c.instead] for c in studies.choices],
        ),
        "Settings that can be refined": (["setting", "from coarse to fine"], ladders),
    }
    for title, (header, rows) in tables.items():
        if rows:
            text += f"\n### {title}\n\n{table(header, rows, left=len(header))}"
    return text + "\n"


def _effects() -> str:
    rows = []
    for effect in EFFECTS.values():
        for c in effect.coefficients:
            if c.name in COEFFICIENTS and not effect.name.startswith("closure"):
                rows.append([f"`{file_key(c.name)}`", c.meaning, pretty(c.unit), effect.formula, effect.acts_on, effect.source])
    header = ["key in a scenario", "meaning", "unit", "formula", "acts on", "source"]
    return f"## Effects that it includes\n\n{table(header, rows, left=6)}"


def _sentence(text: str) -> str:
    return text[0].upper() + text[1:].rstrip(".") + "."


if __name__ == "__main__":
    main()
