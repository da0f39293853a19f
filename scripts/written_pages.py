"""Write the pages of the site that are made from the code's own tables; `make docs` runs this before it builds the site.

The pages are docs/keys.md, docs/metrics.md, docs/engine-facts.md, the live page, and the gallery of the demonstrations, which
run for it. Git ignores them, so that none is edited or out of date.
"""

import shutil
from pathlib import Path

from looping_pendulum.engines.protocol import Engine, Profile
from looping_pendulum.engines.registry import all_engines, engine_facts, how_to_get, label
from looping_pendulum.pages.markdown import table
from looping_pendulum.runs.trajectory import supplies_as_rows
from looping_pendulum.scenarios.metrics import METRICS
from looping_pendulum.sweep.cells import FIELDS
from scripts import demonstrations_page, keys_page, live_page

DOCS = Path(__file__).parents[1] / "docs"


def main() -> None:
    """Write the pages."""
    for name, text in pages().items():
        (DOCS / f"{name}.md").write_text(text, encoding="utf-8")
    shutil.copy(live_page.PAGE, DOCS)
    demonstrations_page.write()


def pages() -> dict[str, str]:
    """Return the name of each page that is made from tables -> its text."""
    return {"keys": keys_page.page(), "metrics": metrics_page(), "engine-facts": engine_facts_page()}


def metrics_page() -> str:
    """Return the page of the metrics and of a map's variables."""
    head = ["metric", "SI unit", "shown in", "limit", "meaning"]
    rows = [[f"`{m.name}`", m.unit, m.shown_in.name, m.limit_words, m.description] for m in METRICS.values()]
    variables = [[f"`{name}`", f.unit, f.meaning] for name, f in FIELDS.items()]
    return f"""# Metrics

These numbers say how far an engine's run is from the reference. `result.json` holds them in SI units, and `null` where a metric
is not defined. Differences are positive for what is late or more than the reference. A scenario's tolerances may limit each of
them: a limit of the kind *at most* holds for the magnitude. A further one is one function of yours: [write a
metric](write-a-metric.md).

{table(head, rows, left=len(head))}
## Variables of a map

What a [map](maps.md) holds of every run; its report gives the smallest, mean and largest value of each that is no code.

{table(["variable", "SI unit", "meaning"], variables, left=3)}"""


def engine_facts_page() -> str:
    """Return the page of what each variant declares."""
    engines = [engine for engine in all_engines(Profile.QUICK) if engine.name != "reference"]
    names = dict.fromkeys(engine.name for engine in engines)
    sections = "\n".join(_engine(name, [e for e in engines if e.name == name]) for name in names)
    return f"""# What each variant declares

Limits, additions and failed checks with their measured reasons, as each adapter's code states them. [Engines](engines.md) says
what the variants are, [accuracy](accuracy.md) how large their errors are.

{sections}"""


def _engine(name: str, variants: list[Engine]) -> str:
    packages = sorted({package for engine in variants for package in engine.abilities.packages})
    get = "\n".join(f"- `{package}`: {how_to_get(package, anywhere=True)}" for package in packages)
    return f"## {engine_facts(name).title or name}\n\n{get}\n\n" + "\n".join(_variant(engine) for engine in variants)


def _variant(engine: Engine) -> str:
    a = engine.abilities
    supplies = table(["physics", "by", "how"], supplies_as_rows(a.supplies), left=3)
    failures = [f"{check.replace('_', ' ')}: {reason}" for check, reason in a.known_failures.items()]
    changed = [[d.what, d.other, d.ours, d.effect] for d in engine.studies().defaults]
    text = f"### {label(engine)}\n\n{a.summary}\n\n{supplies}\n"
    text += _listed("Limits:", a.limits)
    text += _listed("The adapter adds:", a.additions)
    text += _listed("Checks that it fails:", failures)
    if changed:
        head = ["setting", "default", "value here", "effect"]
        text += f"Defaults that the adapter changes:\n\n{table(head, changed, left=len(head))}\n"
    return text


def _listed(heading: str, lines: tuple[str, ...] | list[str]) -> str:
    return f"{heading}\n\n" + "".join(f"- {line}\n" for line in lines) + "\n" if lines else ""


if __name__ == "__main__":
    main()
