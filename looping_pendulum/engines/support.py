"""Tables of which engine variant can run which shipped scenario and effect, from the declarations of the variants."""

from __future__ import annotations

from collections.abc import Sequence

from looping_pendulum.engines.facts import QUANTITIES, VALIDATED_METRICS
from looping_pendulum.engines.protocol import Engine
from looping_pendulum.engines.registry import label
from looping_pendulum.pages.numbers import amount
from looping_pendulum.reference_ode.effects import EFFECTS
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.runs.trajectory import supplies_as_rows
from looping_pendulum.scenarios import loader
from looping_pendulum.scenarios.metrics import METRICS

YES = "yes"
"""Cell of a scenario that a variant represents completely."""

Table = tuple[list[str], list[list[str]]]
"""Header and rows."""


def tables(engines: Sequence[Engine]) -> list[Table]:
    """Return the tables of scenarios, effects beyond the paper's model, suppliers, additions, and measured accuracy."""
    return [
        scenario_table(engines),
        effect_table(engines),
        supply_table(engines),
        addition_table(engines),
        *accuracy_tables(engines),
    ]


def scenario_table(engines: Sequence[Engine]) -> Table:
    """Return a row per variant and a column per shipped scenario: "yes", or what the variant cannot represent or lacks."""
    scenarios = [loader.load(name) for name in loader.shipped()]

    def cell(engine: Engine, parameters: Parameters) -> str:
        unsupported, lacks = engine.abilities.unsupported(parameters), engine.abilities.lacks(parameters)
        if unsupported:
            return f"no: {unsupported}"
        return f"without {', '.join(piece.replace('_', ' ') for piece in lacks)}" if lacks else YES

    rows = [[label(engine), kind(engine), *(cell(engine, each.parameters) for each in scenarios)] for engine in engines]
    return ["variant", "kind", *(scenario.name for scenario in scenarios)], rows


def effect_table(engines: Sequence[Engine]) -> Table:
    """Return a row per effect beyond the paper's model, with the variants that it does not reach."""
    rows = []
    for effect in EFFECTS.values():
        if not effect.in_base_model:
            lacking = [label(engine) for engine in engines if not engine.abilities.reaches(effect)]
            reached = "all" if not lacking else f"{len(engines) - len(lacking)} of {len(engines)}"
            rows.append([effect.name, effect.kind.value, reached, ", ".join(lacking) or "-"])
    return ["effect", "kind", "reaches", "not"], rows


def supply_table(engines: Sequence[Engine]) -> Table:
    """Return a row per variant: who supplies winding, friction law, stick-slip and drag, and what the variant cannot do."""
    physics = [piece for piece, _, _ in supplies_as_rows(engines[0].abilities.supplies)] if engines else []
    rows = []
    for engine in engines:
        by = [by for _, by, _ in supplies_as_rows(engine.abilities.supplies)]
        rows.append([label(engine), *by, engine.abilities.summary, "; ".join(engine.abilities.limits) or "-"])
    return ["variant", *physics, "what it is", "limits"], rows


def addition_table(engines: Sequence[Engine]) -> Table:
    """Return a row for each addition of an adapter beyond its engine."""
    return ["variant", "what the adapter adds"], [[label(e), addition] for e in engines for addition in e.abilities.additions]


def accuracy_tables(engines: Sequence[Engine]) -> list[Table]:
    """Return two tables with a row per variant and profile: errors over random scenarios, and the ranges of these scenarios."""
    errors: list[list[str]] = []
    ranges: list[list[str]] = []
    for name, validated in ((label(engine), each) for engine in engines for each in engine.abilities.validated):
        spreads = ((METRICS[metric].shown_in.per_si_unit, validated.errors.get(metric)) for metric in VALIDATED_METRICS)
        bounds = ((quantity.per_unit, validated.bounds.get(quantity.name)) for quantity in QUANTITIES)
        errors.append(
            [
                *(name, validated.profile, f"{validated.scenarios - validated.failed} of {validated.scenarios}"),
                *(" / ".join(amount(e, unit) for e in (s.median, s.ninety, s.worst)) if s else "-" for unit, s in spreads),
            ]
        )
        cells = (" to ".join(amount(value, unit, 3) for value in pair) if pair else "-" for unit, pair in bounds)
        ranges.append([name, validated.profile, *cells])
    headers = [f"{q.name} [{q.unit}]" if q.unit else q.name for q in QUANTITIES]
    return [
        (["variant", "profile", "ended properly", *(METRICS[metric].column for metric in VALIDATED_METRICS)], errors),
        (["variant", "profile", *headers], ranges),
    ]


def kind(engine: Engine) -> str:
    """Return "reference", "main" if a comparison runs the variant unasked, or "study"."""
    return "reference" if engine.name == "reference" else "main" if engine.abilities.main else "study"
