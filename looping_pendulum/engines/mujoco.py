"""MuJoCo: the string as a spatial tendon over a cylinder, without friction as documented or with the capstan law fed in."""

from __future__ import annotations

import importlib.metadata
from enum import StrEnum

from looping_pendulum.engines.mujoco_model import TendonSettings
from looping_pendulum.engines.mujoco_rig import TendonRig
from looping_pendulum.engines.protocol import Abilities, Engine, Profile, SteppedEngine
from looping_pendulum.engines.trajectory import Supplier, Supplies, Supply
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios.scenario import Scenario


class Variant(StrEnum):
    """What acts between string and rod."""

    DOCUMENTED = "documented"
    CAPSTAN = "capstan"


SETTINGS = {
    Profile.QUICK: TendonSettings(time_step=1e-3, string_time_constant=2e-3, friction_time_constant=2e-3),
    Profile.ACCURATE: TendonSettings(time_step=1e-4, string_time_constant=2e-4, friction_time_constant=2e-4),
}

_WINDING = Supply(by=Supplier.ENGINE, how="spatial tendon wrapped over a cylinder; the adapter counts half turns and switches tendons")
_DRAG = Supply(by=Supplier.ADAPTER, how="the reference's formulas as applied forces")
_TWO_SIDED = "the tendon is a two-sided constraint: it pushes where a string would go slack"
_SUPPLIES = {
    Variant.DOCUMENTED: Supplies(
        winding=_WINDING,
        friction_law=Supply(by=Supplier.NOBODY, how="spatial tendons have no friction on what they wrap"),
        stick_slip=Supply(by=Supplier.NOBODY, how="nothing to stick to"),
        drag=_DRAG,
    ),
    Variant.CAPSTAN: Supplies(
        winding=_WINDING,
        friction_law=Supply(by=Supplier.ADAPTER, how="capstan bound from the tendon's tension, fed to dof_frictionloss of the heavy mass"),
        stick_slip=Supply(by=Supplier.ENGINE, how="friction-loss constraint of the heavy mass's slide; the adapter chooses static or kinetic"),
        drag=_DRAG,
    ),
}


class MujocoTendon(SteppedEngine):
    """Spatial tendon over a cylinder.

    Parameters
    ----------
    variant
        `Variant.DOCUMENTED`: no friction between string and rod, which is all that MuJoCo documents for a tendon.
        `Variant.CAPSTAN`: the friction bound of the effects' string laws acts on the heavy mass's slide.
    profile
        Chooses the settings.
    settings
        Replaces the profile's settings, for studies of convergence.
    """

    name = "mujoco"

    def __init__(
        self, *, variant: str = Variant.CAPSTAN, profile: Profile = Profile.QUICK, settings: TendonSettings | None = None
    ) -> None:
        self.variant = Variant(variant).value
        self.profile = profile
        self.settings: TendonSettings = settings if settings is not None else SETTINGS[profile]
        friction = "no friction on the rod" if variant == Variant.DOCUMENTED else "the capstan law fed in as friction loss"
        self.abilities = Abilities(
            releases=frozenset(Release),
            supplies=_SUPPLIES[Variant(variant)],
            packages=("mujoco",),
            summary=f"Two spatial tendons used in turn over a cylinder, {friction}.",
            limits=(_TWO_SIDED,) if variant == Variant.CAPSTAN else (_TWO_SIDED, "the string slides freely, so it never halts"),
        )

    def build(self, scenario: Scenario) -> TendonRig:
        """Rebuild the scenario's apparatus at the moment of release."""
        return TendonRig(
            scenario.parameters,
            self.settings,
            end_length=self.end_length(scenario),
            with_friction=self.variant == Variant.CAPSTAN,
        )

    def versions(self) -> dict[str, str]:
        """Version of MuJoCo."""
        return {"mujoco": importlib.metadata.version("mujoco")}


def engines(profile: Profile) -> list[Engine]:
    """Every variant of this engine, in ``profile``."""
    return [MujocoTendon(variant=variant, profile=profile) for variant in Variant]
