"""Usual sizes of declared values: one far from them may be right, and is worth a second look."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from looping_pendulum.discrepancy.first_look.declared_trial import DeclaredTrial
from looping_pendulum.pages.numbers import quantity
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios.quantities import QUANTITIES

CHECKED = ("light_mass", "heavy_mass", "rod_radius", "free_length")
"""Parameters whose values are compared with their usual range."""


def implausible_values(declared: Sequence[DeclaredTrial]) -> Iterator[str]:
    """Yield a line for every declared value of unusual size in a trial whose light mass loops."""
    said = set()
    for each in declared:
        if each.trial.release is not Release.LOOPING:
            continue
        for parameter in CHECKED:
            q, known = QUANTITIES[parameter], each.estimate(parameter)
            (low, high), unit = q.usual, q.kind.unit
            if known is None or low <= known.value <= high or (parameter, known) in said:
                continue
            said.add((parameter, known))
            example = f"{q.group}: {{{q.last_key}: {q.kind.example_text}}}"
            yield (
                f"trial '{each.trial.name}': found a {parameter.replace('_', ' ')} of {quantity(known.value, unit)}, which is "
                f"unusual ({quantity(low, unit)} to {quantity(high, unit)}); check its unit, as in '{example}'"
            )
