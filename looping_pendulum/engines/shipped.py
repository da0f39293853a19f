"""Abilities of the adapters of this package, with what was measured of them: what they add, and their range of scenarios."""

from __future__ import annotations

import json
from functools import cache
from importlib.resources import files
from typing import Any

from looping_pendulum.engines.protocol import APPLIED_DRAG, FORCES_AND_RELEASE, Abilities
from looping_pendulum.engines.validated import shipped_range
from looping_pendulum.pages.numbers import amount
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.runs.trajectory import Supplier, Supplies, Supply

FILE = "additions.json"
"""File beside this module with what `research.additions` measured: variant -> rows of an addition and errors.

Errors are the root mean square distances of the light mass from the reference on ten_to_one with the quick profile,
up to 0.35 s and up to 0.7 s [m]; those without the addition are null where that run did not come to its proper end.
"""
SIGNIFICANT_DIGITS = 2
"""Significant digits of an error in a sentence; whole millimetres are not rounded further."""


def shipped_abilities(
    label: str,
    *,
    winding: str | Supply,
    friction_law: str | Supply,
    stick_slip: str | Supply,
    first_additions: tuple[str, ...] = (),
    additions: tuple[str, ...] = (),
    limits: tuple[str, ...] = (),
    min_rod_radius: float = 0.0,
    **declared: Any,
) -> Abilities:
    """Return abilities of the variant ``label``, "mujoco:beads": all releases, forces and pushes, and what was measured of it.

    Parameters
    ----------
    winding, friction_law, stick_slip
        Who supplies them; a text says how the engine itself does it.
    first_additions, additions
        What the adapter adds, before and after the measured additions.
    limits, min_rod_radius
        Fields of `Abilities`; the radius is stated among the limits, too.
    declared
        Further fields of `Abilities`; without ``packages`` the engine's package has its name.
    """
    supplied = {"winding": winding, "friction_law": friction_law, "stick_slip": stick_slip}
    by = {piece: Supply(by=Supplier.ENGINE, how=who) if isinstance(who, str) else who for piece, who in supplied.items()}
    usual = {"releases": frozenset(Release), "effect_kinds": FORCES_AND_RELEASE, "packages": (label.partition(":")[0],)}
    thin = (f"a rod of less than {1e3 * min_rod_radius:.4g} mm of radius is refused",) if min_rod_radius else ()
    return Abilities(
        limits=(*limits, *thin),
        min_rod_radius=min_rod_radius,
        supplies=Supplies(drag=APPLIED_DRAG, **by),
        additions=(*first_additions, *_measured_additions().get(label, ()), *additions),
        validated=shipped_range(label),
        **(usual | declared),
    )


@cache
def _measured_additions() -> dict[str, list[str]]:
    """Return variant -> sentences on what its adapter adds, each with the errors with and without it."""

    def shown(errors: list[float]) -> str:
        return " / ".join(amount(error, 1e3, SIGNIFICANT_DIGITS) for error in errors) + " mm"

    def sentence(what: str, errors: list[float], errors_without: list[float] | None) -> str:
        if errors_without is None:
            return f"{what}: without it ten_to_one does not come to its proper end"
        effect = f"without it ten_to_one is off by {shown(errors_without)} up to 0.35 / 0.7 s, with it by {shown(errors)}"
        return f"{what}: {effect}"

    variants = json.loads(files(__package__).joinpath(FILE).read_text(encoding="utf-8"))
    return {label: [sentence(**row) for row in rows] for label, rows in variants.items()}
