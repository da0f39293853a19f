"""MuJoCo variants with the capstan law as an effective heavy mass, on a spatial tendon or in the string's own coordinates."""

from __future__ import annotations

from enum import StrEnum

from looping_pendulum.engines.additions import measured_additions
from looping_pendulum.engines.mujoco.drum_rig import DrumRig
from looping_pendulum.engines.mujoco.effective_mass_rig import EffectiveMassRig
from looping_pendulum.engines.mujoco.studies import TENDON_STEPS, choice, softness_ladder, step_ladder, string_defaults
from looping_pendulum.engines.mujoco.tendon_mass_rig import TendonMassRig
from looping_pendulum.engines.mujoco.tendon_model import EffectiveMassSettings
from looping_pendulum.engines.protocol import (
    APPLIED_DRAG,
    FORCES_AND_RELEASE,
    Abilities,
    Profile,
    SteppedEngine,
)
from looping_pendulum.engines.studies import HiddenDefault, Studies
from looping_pendulum.engines.trajectory import Supplier, Supplies, Supply
from looping_pendulum.engines.validated import shipped_range
from looping_pendulum.reference_ode.effects import EffectKind
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.versions import installed_version


class Coordinates(StrEnum):
    """Coordinates of the light mass."""

    EFFECTIVE_MASS = "effective_mass"
    """x and y; the string is a spatial tendon."""
    DRUM = "drum"
    """Wrap angle and free length; the string is a fixed tendon."""


SETTINGS = {
    # With a time constant of two steps, the smallest that MuJoCo accepts, a turning string is too stiff for Runge-Kutta: its
    # error is 50 times that with five steps.
    (Coordinates.EFFECTIVE_MASS, Profile.QUICK): EffectiveMassSettings(time_step=5e-4, string_time_constant=2.5e-3),
    (Coordinates.EFFECTIVE_MASS, Profile.ACCURATE): EffectiveMassSettings(time_step=1e-4, string_time_constant=5e-4),
    (Coordinates.DRUM, Profile.QUICK): EffectiveMassSettings(time_step=1e-3, string_time_constant=2e-3),
    (Coordinates.DRUM, Profile.ACCURATE): EffectiveMassSettings(time_step=1e-4, string_time_constant=2e-4),
}
_WINDING = {
    Coordinates.EFFECTIVE_MASS: Supply(
        by=Supplier.ENGINE, how="spatial tendon wrapped over a cylinder; the adapter counts turns, using two in turn"
    ),
    Coordinates.DRUM: Supply(
        by=Supplier.ADAPTER, how="wrap angle and free length are the joints, and the fixed tendon adds them up: l + R theta + h"
    ),
}
_SUMMARY = {
    Coordinates.EFFECTIVE_MASS: "Two spatial tendons used in turn over a cylinder, friction as a factor on the heavy mass.",
    Coordinates.DRUM: "Hinge, slide and fixed tendon for the string's own coordinates, friction as a factor on the heavy mass.",
}
_LIMITS = (
    "the pull of a string that becomes taut has friction the way the heavy mass moved before; the reference: the way after",
    "the rig does not stop where the string leaves the rod (wrap angle 0) or the heavy mass reaches it, as the reference does",
)
_MORE_LIMITS = {
    Coordinates.EFFECTIVE_MASS: (),
    Coordinates.DRUM: ("the winding is put in by hand, so it tests MuJoCo's mechanics and nothing of its strings",),
}


class MujocoEffectiveMass(SteppedEngine):
    """MuJoCo with the capstan law as a factor on the heavy mass.

    Parameters
    ----------
    coordinates
        Coordinates of the light mass.
    profile
        Chooses the settings.
    settings
        Replaces the profile's settings, for studies of convergence.
    """

    name = "mujoco"

    def __init__(
        self,
        *,
        coordinates: str = Coordinates.EFFECTIVE_MASS,
        profile: Profile = Profile.QUICK,
        settings: EffectiveMassSettings | None = None,
    ) -> None:
        chosen = Coordinates(coordinates)
        self.variant = chosen.value
        self.profile = profile
        self.settings: EffectiveMassSettings = settings if settings is not None else SETTINGS[chosen, profile]
        self.abilities = Abilities(
            releases=frozenset(Release),
            effect_kinds=FORCES_AND_RELEASE | {EffectKind.STRING_LAW},
            supplies=Supplies(
                winding=_WINDING[chosen],
                friction_law=Supply(
                    by=Supplier.ADAPTER, how="heavy mass times exp(sign(v2) mu theta), which is the capstan law while it slides"
                ),
                stick_slip=Supply(
                    by=Supplier.ADAPTER, how="finds the stop within the step and locks the heavy mass while the rod can hold it"
                ),
                drag=APPLIED_DRAG,
            ),
            packages=("mujoco",),
            summary=_SUMMARY[chosen],
            limits=(*_LIMITS, *_MORE_LIMITS[chosen]),
            additions=measured_additions(f"mujoco:{chosen.value}"),
            validated=shipped_range(f"mujoco:{chosen.value}"),
            main=False,
        )

    def build(self, scenario: Scenario) -> EffectiveMassRig:
        """Rebuild the scenario's apparatus at the moment of release."""
        rig = DrumRig if self.variant == Coordinates.DRUM else TendonMassRig
        return rig(scenario.parameters, self.settings, self.end_length(scenario))

    def studies(self) -> Studies:
        """Return the studies: step and softness; MuJoCo's defaults; splitting of steps, and the adapter's corrections."""
        s = self.settings
        steps_stiff = round(s.string_time_constant / s.time_step)
        simple = HiddenDefault(
            setting="body simple",
            default="auto",
            ours=s.simple,
            effect="whether a body that only slides keeps the mass that it was compiled with",
            engine=self.with_settings(simple="auto"),
        )
        split = choice(
            "a step in which the motion changes",
            "taken in two",
            "taken as one, the change at its end",
            self.with_settings(split_steps=False),
        )
        turning = choice(
            "what MuJoCo leaves out (l omega^2 in the string's acceleration)",
            "made up for",
            "left out",
            self.with_settings(corrections=False),
        )
        return Studies(
            ladders=(
                step_ladder(self.with_settings, TENDON_STEPS, ("string_time_constant",), steps_stiff),
                softness_ladder(self.with_settings, "string_time_constant", s.time_step),
            ),
            defaults=(*string_defaults(self.with_settings, s), simple),
            choices=(split,) if self.variant == Coordinates.DRUM else (split, turning),
        )

    def versions(self) -> dict[str, str]:
        """Return the version of MuJoCo."""
        return {"mujoco": installed_version("mujoco")}
