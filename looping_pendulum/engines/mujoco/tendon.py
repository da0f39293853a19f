"""MuJoCo: the string as a spatial tendon over a cylinder, without friction as documented or with the capstan law fed in."""

from __future__ import annotations

import importlib.metadata
from enum import StrEnum

from looping_pendulum.engines.mujoco.tendon_model import TendonSettings
from looping_pendulum.engines.mujoco.tendon_rig import TendonRig
from looping_pendulum.engines.protocol import Abilities, Profile, SteppedEngine
from looping_pendulum.engines.trajectory import Supplier, Supplies, Supply
from looping_pendulum.reference_ode.effects import EffectKind
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios.scenario import Scenario


class Variant(StrEnum):
    """What acts between string and rod."""

    DOCUMENTED = "documented"
    CAPSTAN = "capstan"


SETTINGS = {
    Profile.QUICK: TendonSettings(time_step=5e-4, string_time_constant=1e-3, friction_time_constant=1e-3),
    Profile.ACCURATE: TendonSettings(time_step=5e-5, string_time_constant=1e-4, friction_time_constant=1e-4),
}

_WINDING = Supply(by=Supplier.ENGINE, how="spatial tendon wrapped over a cylinder; the adapter counts turns, using two in turn")
_DRAG = Supply(by=Supplier.ADAPTER, how="the reference's formulas as applied forces")
_LIMITS = (
    "a slack string is caught within one time step, so up to a step's way too late",
    "where the catch turns the heavy mass round, friction turns with it; the reference gives the whole pull one direction",
    "the rig does not stop where the string leaves the rod (wrap angle 0) or the heavy mass reaches it, as the reference does",
)
_EFFECT_KINDS = {
    Variant.DOCUMENTED: frozenset({EffectKind.FORCE, EffectKind.CLOSURE}),
    Variant.CAPSTAN: frozenset({EffectKind.FORCE, EffectKind.CLOSURE, EffectKind.STRING_LAW}),
}
_STICK_SLIP = "friction-loss constraint; the adapter picks the static or kinetic bound and splits a step that reverses"
_SUPPLIES = {
    Variant.DOCUMENTED: Supplies(
        winding=_WINDING,
        friction_law=Supply(by=Supplier.NOBODY, how="spatial tendons have no friction on what they wrap"),
        stick_slip=Supply(by=Supplier.NOBODY, how="nothing to stick to"),
        drag=_DRAG,
    ),
    Variant.CAPSTAN: Supplies(
        winding=_WINDING,
        friction_law=Supply(by=Supplier.ADAPTER, how="capstan bound from the tendon's tension, fed to dof_frictionloss"),
        stick_slip=Supply(by=Supplier.ENGINE, how=_STICK_SLIP),
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
        limits = _LIMITS if variant == Variant.CAPSTAN else (*_LIMITS, "without friction the heavy mass never halts")
        friction = "no friction on the rod" if variant == Variant.DOCUMENTED else "the capstan law fed in as friction loss"
        self.abilities = Abilities(
            releases=frozenset(Release),
            effect_kinds=_EFFECT_KINDS[Variant(variant)],
            supplies=_SUPPLIES[Variant(variant)],
            packages=("mujoco",),
            summary=f"Two spatial tendons used in turn over a cylinder, {friction}.",
            limits=limits,
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
