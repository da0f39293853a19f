"""The `protocol.Abilities` of each variant of the full chain: what it can and cannot do, as data."""

from __future__ import annotations

from collections.abc import Mapping

from looping_pendulum.engines.chain import MASS_COMPENSATION, MASS_FRACTION, ONE_COEFFICIENT
from looping_pendulum.engines.protocol import APPLIED_DRAG, FORCES_AND_RELEASE, Abilities
from looping_pendulum.engines.pymunk.full_settings import FullChainVariant
from looping_pendulum.engines.trajectory import Supplier, Supplies, Supply
from looping_pendulum.engines.validated import shipped_range
from looping_pendulum.reference_ode.parameters import Release


def _supplies(links: str, contact: str) -> Supplies:
    return Supplies(
        winding=Supply(by=Supplier.ENGINE, how=f"contact of {links} along the whole string with a static circle"),
        friction_law=Supply(by=Supplier.ENGINE, how=contact),
        stick_slip=Supply(by=Supplier.ENGINE, how="the same contact: the solver clamps friction to its cone"),
        drag=APPLIED_DRAG,
    )


_SOLVED = "Coulomb friction between {} and circle, its coefficient solved from the capstan law for the polygon's corners"
_SUPPLIES = {
    FullChainVariant.BEADS: _supplies("beads", _SOLVED.format("beads")),
    FullChainVariant.SEGMENTS: _supplies("segments", _SOLVED.format("segments")),
    FullChainVariant.DEFAULTS: _supplies("beads", "Coulomb friction between beads and circle, uncorrected"),
}
_SUMMARIES = {
    FullChainVariant.BEADS: "Point beads on pin joints along the whole string, slide joints over many; public calls only.",
    FullChainVariant.SEGMENTS: (
        "Rigid segments on pivot joints along the whole string, slide joints over many; public calls only."
    ),
    FullChainVariant.DEFAULTS: (
        "Point beads on pin joints along the whole string, with every setting of Chipmunk left as it comes."
    ),
}
_SPRING = (
    "nothing damps its joints, which act as a spring: the string rings along its length, and the halted heavy mass with it"
)
_MASS = (
    f"the string weighs {100 * MASS_FRACTION:g} % of the light mass; {100 * MASS_FRACTION * MASS_COMPENSATION:g} % is taken "
    "off that"
)
_LIMITS = {
    FullChainVariant.BEADS: (ONE_COEFFICIENT, _SPRING),
    FullChainVariant.SEGMENTS: (ONE_COEFFICIENT, _SPRING),
    FullChainVariant.DEFAULTS: (ONE_COEFFICIENT, "the string stretches without bound: no run of it says anything of a string"),
}
_LOST_EFFECTS = ("light_drag", "heavy_drag", "light_linear_drag", "heavy_linear_drag", "attitude_drag", "wind", "side_force")
KNOWN_FAILURES: dict[FullChainVariant, Mapping[str, str]] = {
    FullChainVariant.SEGMENTS: {
        "follows_the_reference_past_the_halt_and_a_full_turn": "measured 5.8 mm off at 0.42 s, for 5.7 mm: it rings",
    },
    FullChainVariant.DEFAULTS: {
        "samples_every_millisecond_from_rest": "measured to stretch by more than its budget after 0.06 s, which ends the run",
        "runs_to_its_end": "measured to stretch by more than its budget after 0.06 s, which ends the run",
        "frictionless_vertical_release_is_an_atwood_machine": "measured 9.56 for 8.03 m/s^2: a string that stretches lets fall",
        "vertical_release_obeys_the_capstan_law": "measured 9.56 for 5.80 m/s^2: a string that stretches lets fall",
        "friction_holds_the_string_of_a_small_overweight": "measured 12 mm in 0.1 s: a string that stretches lets fall",
        "held_pendulum_swings_to_the_other_side": "the light mass falls all the way: the string that should turn it stretches",
        "string_keeps_its_length": "measured 22 mm of stretch after 0.15 s",
        "release_has_the_exact_acceleration": "measured free fall of the light mass: no string pulls it",
        "release_against_friction_has_the_exact_acceleration": "measured free fall of the light mass: no string pulls it",
        "energy_never_grows_with_losses": "measured 1.1 % of what the heavy mass gave, where 1 % is allowed",
        "energy_is_kept_without_losses": "measured 1.6 % of what the heavy mass gave, where 1 % is allowed",
        "follows_the_reference_without_losses": "measured 21 mm off at 0.06 s",
        "follows_the_reference_past_the_halt_and_a_full_turn": "measured 10 mm off at 0.05 s",
        "error_is_covered_by_refinement": "its finer runs break off like its own: the string stretches without bound",
    }
    | {
        f"{effect}_acts_as_in_the_reference": "measured on one mass only: a string that stretches does not pull the other"
        for effect in (*_LOST_EFFECTS, "side_stiffness")
    },
}
"""Variant -> the checks of `engines.conformance` that it fails -> the measured reason."""


def full_abilities(variant: FullChainVariant) -> Abilities:
    """Return what ``variant`` can do."""
    return Abilities(
        releases=frozenset(Release),
        effect_kinds=FORCES_AND_RELEASE,
        supplies=_SUPPLIES[variant],
        packages=("pymunk",),
        summary=_SUMMARIES[variant],
        limits=_LIMITS[variant],
        additions=(_MASS,),
        validated=shipped_range(f"pymunk:{variant.value}"),
        known_failures=KNOWN_FAILURES.get(variant, {}),
        main=False,
    )
