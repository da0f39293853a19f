"""The base of every PyBullet variant: settings for each profile, and a rig."""

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
    """A variant of the apparatus in PyBullet."""

    name = "pybullet"
    distribution = "pybullet"
    rig: ClassVar[type[Any]]
    """Class of the apparatus with a string, called with parameters and settings."""

    def build(self, scenario: Scenario) -> Rig:
        """Build the scenario's apparatus at the moment of release."""
        rig_class = FallingRig if scenario.parameters.release is Release.DROP else self.rig
        rig: Rig = rig_class(scenario.parameters, self.settings)
        return rig
