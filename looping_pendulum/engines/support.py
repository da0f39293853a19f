"""Which engine variant can run which shipped scenario and effect, from what the variants declare of themselves."""

from __future__ import annotations

from collections.abc import Sequence

from looping_pendulum.engines.protocol import Engine
from looping_pendulum.engines.registry import label
from looping_pendulum.engines.trajectory import supplies_as_rows
from looping_pendulum.engines.validated import QUANTITIES, Spread, ValidatedQuantity
from looping_pendulum.pages.numbers import amount
from looping_pendulum.reference_ode.effects import EFFECTS
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.scenarios import loader

COMMAND = "looping-pendulum engines --support --markdown > docs/support.md"
"""What writes the page again."""

YES = "yes"

ERRORS = {
    "rms_0.35s": "RMS to 0.35 s [mm]",
    "rms_0.7s": "RMS to 0.7 s [mm]",
    "halting_time_error": "halting time [ms]",
}
"""What of `ValidatedRange.errors` is shown, and as what: median / 90 % / worst."""

Table = tuple[list[str], list[list[str]]]
"""Header and rows."""


def tables(engines: Sequence[Engine]) -> list[Table]:
    """Scenarios, effects beyond the paper's model, who supplies what, what adapters add, and where accuracy was measured."""
    return [
        scenario_table(engines),
        effect_table(engines),
        supply_table(engines),
        addition_table(engines),
        *accuracy_tables(engines),
    ]


def scenario_table(engines: Sequence[Engine]) -> Table:
    """A row per variant, a column per shipped scenario: "yes", or what of it the variant cannot represent or goes without."""
    scenarios = [loader.load(name) for name in loader.shipped()]
    rows = []
    for engine in engines:
        rows.append([label(engine), kind(engine), *(_how_much_of(engine, scenario.parameters) for scenario in scenarios)])
    return ["variant", "kind", *(scenario.name for scenario in scenarios)], rows


def _how_much_of(engine: Engine, parameters: Parameters) -> str:
    """How much of a scenario with ``parameters`` the variant has."""
    unsupported, lacks = engine.abilities.unsupported(parameters), engine.abilities.lacks(parameters)
    if unsupported:
        return f"no: {unsupported}"
    return f"without {', '.join(what.replace('_', ' ') for what in lacks)}" if lacks else YES


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


def addition_table(engines: Sequence[Engine]) -> Table:
    """A row for everything that an adapter adds beyond its engine."""
    return ["variant", "what the adapter adds"], [[label(e), what] for e in engines for what in e.abilities.additions]


def accuracy_tables(engines: Sequence[Engine]) -> list[Table]:
    """Two tables with a row per variant and profile: how far off it was over random scenarios, and how far those reached."""
    stated = [(label(engine), each) for engine in engines for each in engine.abilities.validated]
    errors: list[list[str]] = []
    ranges: list[list[str]] = []
    for name, validated in stated:
        ended = f"{validated.scenarios - validated.failed} of {validated.scenarios}"
        errors.append([name, validated.profile, ended, *(_spread(validated.errors.get(what)) for what in ERRORS)])
        ranges.append([name, validated.profile, *(_reach(q, validated.bounds.get(q.name)) for q in QUANTITIES)])
    headers = [f"{q.name} [{q.unit}]" if q.unit else q.name for q in QUANTITIES]
    return [
        (["variant", "profile", "ended properly", *ERRORS.values()], errors),
        (["variant", "profile", *headers], ranges),
    ]


def _spread(spread: Spread | None) -> str:
    """Median, 90 % and worst, in thousandths of the SI unit."""
    if spread is None:
        return "-"
    return " / ".join(amount(value, 1e3) for value in (spread.median, spread.ninety, spread.worst))


def _reach(quantity: ValidatedQuantity, bounds: tuple[float, float] | None) -> str:
    return "-" if bounds is None else " to ".join(amount(value, quantity.per_unit, 3) for value in bounds)


def kind(engine: Engine) -> str:
    """Whether a comparison runs the variant unasked."""
    return "reference" if engine.name == "reference" else "main" if engine.abilities.main else "study"


def page(engines: Sequence[Engine]) -> str:
    """Return the tables as a page of Markdown."""
    scenarios, effects, supplies, additions, errors, ranges = (_markdown(*each) for each in tables(engines))
    return f"""# Which engine can run what

Written by `{COMMAND}` from what every variant declares of
itself (`Abilities` in `looping_pendulum/engines/protocol.py`); do not edit it by hand.
*main*: `compare` runs the variant unasked; *study*: only if named, or with `-e all`.
A scenario or an effect that a variant cannot represent is a gap in its row of every report. Physics of the paper's model that a
variant goes without (*without ...*) is declared beside its result: it is run, and its report names what is missing.

## Shipped scenarios

{scenarios}
## Effects beyond the paper's model

{effects}
## Who supplies what

A law that an adapter feeds in is no evidence for that law.

{supplies}
What the adapter adds beyond its engine, with what it is worth on the 10:1 trial (quick profile) where that was measured:

{additions}
## Where the accuracy was measured

On seeded random scenarios (`python -m benchmarks.engine_range`; every run stands in docs/data/engine_range.json): how far the
light mass was from the reference's, root mean square up to that time or to the end of the run if that is earlier, as median /
90 % / worst of the scenarios whose run ended properly. `compare` says so where a scenario lies outside the range.

{errors}
The scenarios reached:

{ranges}"""


def _markdown(header: list[str], rows: list[list[str]]) -> str:
    lines = [header, ["---"] * len(header), *([cell.replace("|", "\\|") for cell in row] for row in rows)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)
