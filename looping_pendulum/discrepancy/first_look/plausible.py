"""Usual sizes of declared values: one far from them may be right, and is worth a second look."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from types import MappingProxyType

from looping_pendulum.discrepancy.first_look.declared_trial import DeclaredTrial
from looping_pendulum.pages.numbers import quantity
from looping_pendulum.reference_ode.parameters import Release

USUAL_SIZES = MappingProxyType(
    {
        "light_mass": (1e-4, 1.0, "kg", "light: {mass: 10 g}"),
        "heavy_mass": (1e-3, 10.0, "kg", "heavy: {mass: 100 g}"),
        "rod_radius": (2e-4, 0.1, "m", "rod: {radius: 6.25 mm}"),
        "free_length": (0.03, 5.0, "m", "release: {free_length: 58 cm}"),
    }
)
"""Parameter -> smallest and largest usual value [SI], its SI unit, and how its key is written.

Between a tenth of a gram and what a hand lets go without danger; from a knitting needle to a drainpipe; from a palm's length
to a stairwell's height.
"""


def implausible_values(declared: Sequence[DeclaredTrial]) -> Iterator[str]:
    """Yield a line for every declared value of unusual size in a trial whose light mass loops."""
    said = set()
    for each in declared:
        if each.trial.release is not Release.LOOPING:
            continue
        for parameter, (low, high, unit, key) in USUAL_SIZES.items():
            known = each.estimate(parameter)
            if known is None or low <= known.value <= high or (parameter, known) in said:
                continue
            said.add((parameter, known))
            yield (
                f"trial '{each.trial.name}': found a {parameter.replace('_', ' ')} of {quantity(known.value, unit)}, which is "
                f"unusual ({quantity(low, unit)} to {quantity(high, unit)}); check its unit, as in '{key}'"
            )
