"""What every PyBullet variant is: settings for each profile, and a rig."""

from __future__ import annotations

from typing import Any, ClassVar

from looping_pendulum.engines.protocol import Rig, TunedEngine
from looping_pendulum.engines.pybullet.world import FallingRig
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios.scenario import Scenario

ONE_COEFFICIENT = "one Coulomb coefficient: of a static friction above the kinetic one, only the kinetic one is represented"
COULOMB_AT_NODES = (
    "Coulomb contact at every node; the adapter solves its coefficient from the capstan law for the polygon's corners"
)


class PybulletVariant(TunedEngine):
    """A way to make the apparatus in PyBullet."""

    name = "pybullet"
    distribution = "pybullet"
    rig: ClassVar[type[Any]]
    """Makes the apparatus of parameters and settings, if it has a string."""

    def build(self, scenario: Scenario) -> Rig:
        """Rebuild the scenario's apparatus at the moment of release."""
        rig = FallingRig if scenario.parameters.release is Release.DROP else self.rig
        made: Rig = rig(scenario.parameters, self.settings)
        return made
