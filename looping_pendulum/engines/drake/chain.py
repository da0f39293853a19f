"""Drake: the string is a row of beads that slide over a static sphere under Coulomb contact; no capstan law is fed in."""

from __future__ import annotations

from looping_pendulum.engines.chain import BEADS_WEIGH, NO_STOP, STRAIGHT_STRING, bead_supplies
from looping_pendulum.engines.drake.chain_model import SETTINGS, DrakeChainSettings
from looping_pendulum.engines.drake.chain_rig import DrakeChainRig
from looping_pendulum.engines.drake.studies import chain_studies
from looping_pendulum.engines.protocol import FORCES_AND_RELEASE, Abilities, Profile, TunedEngine
from looping_pendulum.engines.studies import Studies
from looping_pendulum.engines.validated import shipped_range
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios.scenario import Scenario

_LIMITS = (
    "one Coulomb coefficient only: Drake's discrete solver ignores the static one, so where static_friction differs from "
    "kinetic_friction, the kinetic one acts in both",
    "friction that is regularised creeps, below the stiction tolerance",
    STRAIGHT_STRING,
    "Drake's distance constraint pushes too: the adapter switches a straight part off where it would, up to 1 ms late, and a "
    "string that becomes taut again stays as much longer as it was when it was caught",
    "a slack straight part passes through the rod: one that turns further while it is slack is caught late",
    "beads bounce where the light mass pulls little: the string's way over the rod is longer for some milliseconds",
    NO_STOP,
)


class DrakeChain(TunedEngine):
    """A chain of beads over a static sphere."""

    name = "drake"
    distribution = "drake"
    variant = "chain"
    abilities = Abilities(
        quick_cost=25.0,
        releases=frozenset(Release),
        effect_kinds=FORCES_AND_RELEASE,
        supplies=bead_supplies("static sphere", "friction is regularised below the stiction tolerance"),
        packages=("pydrake",),
        summary="Beads on distance constraints over a static sphere, one constraint for each straight part of the string.",
        limits=_LIMITS,
        additions=(BEADS_WEIGH.format(100 * SETTINGS[Profile.QUICK].bead_mass_ratio),),
        validated=shipped_range("drake:chain"),
        main=False,
    )
    settings_by_profile = SETTINGS
    settings: DrakeChainSettings

    def build(self, scenario: Scenario) -> DrakeChainRig:
        """Build the scenario's apparatus at the moment of release."""
        return DrakeChainRig(scenario.parameters, self.settings)

    def studies(self) -> Studies:
        """Return ladders of step, links, mass and contact, Drake's defaults, and the adapter's choices."""
        return chain_studies(self.settings, self.with_settings)
