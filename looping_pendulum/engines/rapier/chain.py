"""Rapier: the string is a row of beads that slide over a fixed cylinder under Coulomb contact; no capstan law is fed in."""

from __future__ import annotations

from looping_pendulum.engines.bead_rig import BeadRig
from looping_pendulum.engines.chain import BEADS_WEIGH, NO_STOP, ONE_COEFFICIENT, STRAIGHT_STRING, bead_supplies
from looping_pendulum.engines.protocol import FORCES_AND_RELEASE, Abilities, Profile, TunedEngine
from looping_pendulum.engines.rapier.settings import SETTINGS, RapierChainSettings
from looping_pendulum.engines.rapier.studies import chain_studies
from looping_pendulum.engines.rapier.world import RapierWorld
from looping_pendulum.engines.studies import Studies
from looping_pendulum.engines.validated import shipped_range
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios.scenario import Scenario

_LIMITS = (
    ONE_COEFFICIENT,
    "rapier3d computes in single precision, and PyPI has no Rapier of double precision: each step rounds places and "
    "velocities, so that the accurate profile is hardly better than the quick one, and shorter steps make the path worse",
    STRAIGHT_STRING,
    NO_STOP,
)


class RapierChain(TunedEngine):
    """A chain of beads over a fixed cylinder."""

    name = "rapier"
    distribution = "rapier3d"
    variant = "chain"
    abilities = Abilities(
        quick_cost=8.0,
        releases=frozenset(Release),
        effect_kinds=FORCES_AND_RELEASE,
        supplies=bead_supplies("fixed cylinder", "the solver clamps friction to its cone"),
        packages=("rapier3d",),
        summary="Point beads on ropes over a fixed cylinder, one rope for each straight part of the string.",
        limits=_LIMITS,
        additions=(BEADS_WEIGH.format(100 * SETTINGS[Profile.QUICK].bead_mass_ratio),),
        validated=shipped_range("rapier:chain"),
        known_failures={
            "samples_every_millisecond_from_rest": "places are in single precision: measured 8 nm off at release",
        },
        main=False,
    )
    settings_by_profile = SETTINGS
    settings: RapierChainSettings

    def build(self, scenario: Scenario) -> BeadRig:
        """Build the scenario's apparatus at the moment of release."""
        return BeadRig(scenario.parameters, self.settings, RapierWorld(scenario.parameters, self.settings))

    def studies(self) -> Studies:
        """Return ladders of step, iterations, links and mass, Rapier's defaults, and the adapter's choices."""
        return chain_studies(self.settings, self.with_settings)
