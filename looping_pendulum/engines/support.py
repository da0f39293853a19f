"""Which engine variant can run which shipped scenario and effect, from what the variants declare of themselves."""

from __future__ import annotations

from collections.abc import Sequence

from looping_pendulum.engines.protocol import Engine
from looping_pendulum.engines.registry import label
from looping_pendulum.engines.trajectory import supplies_as_rows
from looping_pendulum.reference_ode.effects import EFFECTS
from looping_pendulum.scenarios import loader

COMMAND = "looping-pendulum engines --support --markdown > docs/support.md"
"""What writes the page again."""

YES = "yes"

Table = tuple[list[str], list[list[str]]]
"""Header and rows."""


def tables(engines: Sequence[Engine]) -> list[Table]:
    """Three tables: scenarios, effects beyond the paper's model, and who supplies what; a row or column per variant."""
    return [scenario_table(engines), effect_table(engines), supply_table(engines)]


def scenario_table(engines: Sequence[Engine]) -> Table:
    """A row per variant, a column per shipped scenario: "yes", or what of it the variant cannot represent."""
    scenarios = [loader.load(name) for name in loader.shipped()]
    rows = []
    for engine in engines:
        missing = [engine.abilities.unsupported(scenario.parameters) for scenario in scenarios]
        rows.append([label(engine), kind(engine), *(f"no: {what}" if what else YES for what in missing)])
    return ["variant", "kind", *(scenario.name for scenario in scenarios)], rows


def effect_table(engines: Sequence[Engine]) -> Table:
    """A row per effect beyond the paper's model, with the variants that it does not reach."""
    rows = []
    for effect in EFFECTS.values():
        if not effect.in_base_model:
            lacking = [label(engine) for engine in engines if not engine.abilities.reaches(effect)]
            reached = "all" if not lacking else f"{len(engines) - len(lacking)} of {len(engines)}"
            rows.append([effect.name, effect.kind.value, reached, ", ".join(lacking) or "-"])
    return ["effect", "kind", "reaches", "not"], rows


def supply_table(engines: Sequence[Engine]) -> Table:
    """A row per variant: who supplies winding, friction law, stick-slip and drag, and what the variant cannot do."""
    whats = [what for what, _, _ in supplies_as_rows(engines[0].abilities.supplies)] if engines else []
    rows = []
    for engine in engines:
        by = [by for _, by, _ in supplies_as_rows(engine.abilities.supplies)]
        rows.append([label(engine), *by, engine.abilities.summary, "; ".join(engine.abilities.limits) or "-"])
    return ["variant", *whats, "what it is", "limits"], rows


def kind(engine: Engine) -> str:
    """Whether a comparison runs the variant unasked."""
    return "truth" if engine.name == "reference" else "main" if engine.abilities.main else "study"


def page(engines: Sequence[Engine]) -> str:
    """Return the tables as a page of Markdown."""
    scenarios, effects, supplies = (_markdown(*each) for each in tables(engines))
    return f"""# Which engine can run what

Written by `{COMMAND}` from what every variant declares of
itself (`Abilities` in `looping_pendulum/engines/protocol.py`); do not edit it by hand.
*main*: `compare` runs the variant unasked; *study*: only if named, or with `-e all`.
A scenario or an effect that a variant cannot represent is a gap in its row of every report, never a wrong result.

## Shipped scenarios

{scenarios}
## Effects beyond the paper's model

{effects}
## Who supplies what

A law that an adapter feeds in is no evidence for that law.

{supplies}"""


def _markdown(header: list[str], rows: list[list[str]]) -> str:
    lines = [header, ["---"] * len(header), *([cell.replace("|", "\\|") for cell in row] for row in rows)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)
