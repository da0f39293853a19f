"""Drake: the string as beads that slide over a static sphere under Coulomb contact; no law is fed in."""

from __future__ import annotations

import importlib.metadata
from dataclasses import replace

from looping_pendulum.engines.drake.chain_model import SETTINGS, ChainSettings
from looping_pendulum.engines.drake.chain_rig import ChainRig
from looping_pendulum.engines.drake.studies import chain_studies
from looping_pendulum.engines.protocol import Abilities, Profile, SteppedEngine
from looping_pendulum.engines.studies import Studies
from looping_pendulum.engines.trajectory import Supplier, Supplies, Supply
from looping_pendulum.reference_ode.effects import EffectKind
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios.scenario import Scenario

_SUPPLIES = Supplies(
    winding=Supply(
        by=Supplier.ENGINE,
        how="contact of beads with a static sphere; the adapter adds and removes beads on the straight parts only",
    ),
    friction_law=Supply(
        by=Supplier.ENGINE, how="Coulomb friction between beads and sphere, corrected for the polygon's corners"
    ),
    stick_slip=Supply(by=Supplier.ENGINE, how="the same contact: friction is regularised below the stiction tolerance"),
    drag=Supply(by=Supplier.ADAPTER, how="the reference's formulas as applied forces"),
)
_LIMITS = (
    "one Coulomb coefficient only: Drake's discrete solver ignores the static one, so where static_friction differs from "
    "kinetic_friction, the kinetic one acts in both",
    "friction that is regularised creeps, below the stiction tolerance",
    "straight string has no mass and stays straight: no waves run along it, and slack string does not fall",
    "Drake's distance constraint pushes too: the adapter switches a straight part off where it would, up to 1 ms late, and a "
    "string that becomes taut again stays as much longer as it was when it was caught",
    "a slack straight part passes through the rod: one that turns further while it is slack is caught late",
    "beads bounce where the light mass pulls little: the string's way over the rod is up to 0.6 mm longer for some ms",
    "the rig does not stop where the string leaves the rod (wrap angle 0) or the heavy mass reaches it, as the reference does",
)


class DrakeChain(SteppedEngine):
    """Chain of beads over a static sphere.

    Parameters
    ----------
    profile
        Chooses the settings.
    settings
        Replaces the profile's settings, for studies of convergence.
    """

    name = "drake"
    variant = "chain"

    def __init__(self, *, profile: Profile = Profile.QUICK, settings: ChainSettings | None = None) -> None:
        self.profile = profile
        self.settings: ChainSettings = settings if settings is not None else SETTINGS[profile]
        self.abilities = Abilities(
            releases=frozenset(Release),
            effect_kinds=frozenset({EffectKind.FORCE, EffectKind.CLOSURE, EffectKind.RELEASE}),
            supplies=_SUPPLIES,
            packages=("pydrake",),
            summary="Beads on distance constraints over a static sphere, one constraint for each straight part of the string.",
            limits=_LIMITS,
            main=False,
        )

    def build(self, scenario: Scenario) -> ChainRig:
        """Rebuild the scenario's apparatus at the moment of release."""
        return ChainRig(scenario.parameters, self.settings)

    def with_settings(self, **changes: object) -> DrakeChain:
        """Return this variant with some settings changed."""
        return DrakeChain(profile=self.profile, settings=replace(self.settings, **changes))  # type: ignore[arg-type]

    def studies(self) -> Studies:
        """Step, links, their mass, contact; Drake's defaults; the rod's shape, the polygon, how often beads are seen to."""
        return chain_studies(self.settings, self.with_settings)

    def versions(self) -> dict[str, str]:
        """Version of Drake."""
        return {"drake": importlib.metadata.version("drake")}
