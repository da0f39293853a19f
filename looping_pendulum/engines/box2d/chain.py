"""Box2D 3: the string is a row of beads that slide over a static circle under Coulomb contact; no capstan law is fed in."""

from __future__ import annotations

from looping_pendulum.engines.bead_rig import BeadRig
from looping_pendulum.engines.box2d.settings import SETTINGS, Box2dChainSettings
from looping_pendulum.engines.box2d.studies import chain_studies
from looping_pendulum.engines.box2d.world import Box2dWorld
from looping_pendulum.engines.chain import BEADS_WEIGH, NO_STOP, ONE_COEFFICIENT, STRAIGHT_STRING, bead_supplies
from looping_pendulum.engines.protocol import FORCES_AND_RELEASE, Abilities, Profile, TunedEngine
from looping_pendulum.engines.studies import Studies
from looping_pendulum.engines.validated import shipped_range
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios.scenario import Scenario

_LIMITS = (
    ONE_COEFFICIENT,
    "Box2D computes in single precision: each sub-step rounds velocities, so that more and shorter ones than those of the "
    "accurate profile make the path worse",
    "pyb2d3 gives no access to Box2D's stiffness of joints, 60 Hz; the adapter makes them stiff by time units of 0.1 ms",
    STRAIGHT_STRING,
    NO_STOP,
)


class Box2dChain(TunedEngine):
    """A chain of beads over a static circle."""

    name = "box2d"
    distribution = "pyb2d3"
    variant = "chain"
    abilities = Abilities(
        quick_cost=8.0,
        releases=frozenset(Release),
        effect_kinds=FORCES_AND_RELEASE,
        supplies=bead_supplies("static circle", "the solver clamps friction to its cone"),
        packages=("pyb2d3",),
        summary="Point beads on distance joints over a static circle, one joint for each straight part of the string.",
        limits=_LIMITS,
        additions=(BEADS_WEIGH.format(100 * SETTINGS[Profile.QUICK].bead_mass_ratio),),
        validated=shipped_range("box2d:chain"),
        known_failures={
            "samples_every_millisecond_from_rest": "places are in single precision: measured 12 nm off at release",
        },
        main=False,
    )
    settings_by_profile = SETTINGS
    settings: Box2dChainSettings

    def build(self, scenario: Scenario) -> BeadRig:
        """Build the scenario's apparatus at the moment of release."""
        return BeadRig(scenario.parameters, self.settings, Box2dWorld(scenario.parameters, self.settings))

    def studies(self) -> Studies:
        """Return ladders of step, sub-steps, links and mass, Box2D's defaults, and the adapter's choices."""
        return chain_studies(self.settings, self.with_settings)
