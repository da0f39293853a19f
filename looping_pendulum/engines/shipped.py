"""Abilities of the adapters of this package, with what was measured of them: what they add, and their range of scenarios."""

from __future__ import annotations

from typing import Any

from looping_pendulum.engines.facts import own_facts
from looping_pendulum.engines.protocol import APPLIED_DRAG, FORCES_AND_RELEASE, Abilities
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.runs.trajectory import Supplier, Supplies, Supply


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
    engine, _, variant = label.partition(":")
    facts = own_facts(engine).variant(variant)
    supplied = {"winding": winding, "friction_law": friction_law, "stick_slip": stick_slip}
    by = {piece: Supply(by=Supplier.ENGINE, how=who) if isinstance(who, str) else who for piece, who in supplied.items()}
    usual = {"releases": frozenset(Release), "effect_kinds": FORCES_AND_RELEASE, "packages": (engine,)}
    thin = (f"a rod of less than {1e3 * min_rod_radius:.4g} mm of radius is refused",) if min_rod_radius else ()
    return Abilities(
        limits=(*limits, *thin),
        min_rod_radius=min_rod_radius,
        supplies=Supplies(drag=APPLIED_DRAG, **by),
        additions=(*first_additions, *map(str, facts.additions), *additions),
        validated=facts.measured,
        known_failures=facts.failed_checks,
        **(usual | declared),
    )
