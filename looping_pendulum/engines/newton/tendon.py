"""Newton: the string is a tendon over a fixed roller with the capstan law, Newton's own; no law is fed in."""

from __future__ import annotations

from looping_pendulum.engines.chain import NO_STOP, ONE_COEFFICIENT
from looping_pendulum.engines.newton.rig import NewtonTendonRig
from looping_pendulum.engines.newton.settings import SETTINGS, NewtonTendonSettings
from looping_pendulum.engines.newton.studies import tendon_studies
from looping_pendulum.engines.protocol import APPLIED_DRAG, FORCES_AND_RELEASE, Abilities, TunedEngine
from looping_pendulum.engines.studies import Studies
from looping_pendulum.engines.trajectory import Supplier, Supplies, Supply
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.versions import installed_version

_SUPPLIES = Supplies(
    winding=Supply(by=Supplier.ENGINE, how="tangents to a fixed roller; string that winds on is taken from the straight parts"),
    friction_law=Supply(by=Supplier.ENGINE, how="the capstan law of the roller, up to half a turn"),
    stick_slip=Supply(
        by=Supplier.ENGINE, how="the same: string passes only where the tensions differ by more than the law's ratio"
    ),
    drag=APPLIED_DRAG,
)
_LIMITS = (
    "a string that slides with friction may be wound by half a turn only: beyond it Newton goes on with the friction of the "
    "angle that is left to a full turn, and the adapter ends the run",
    ONE_COEFFICIENT,
    "the friction reads the tensions from the string's stretch: a string that cannot stretch does not slide from rest at all",
    "Newton computes in single precision",
    NO_STOP,
)
_WOUND_TOO_FAR = (
    "the run is ended at half a turn, after 0.207 s: beyond it Newton has the friction of the angle that is left to a full "
    "turn (measured: a ratio of 1.71 at 270 degrees, where 4.96 is right)"
)


class NewtonTendon(TunedEngine):
    """A tendon over a fixed roller."""

    name = "newton"
    distribution = "newton"
    variant = "tendon"
    abilities = Abilities(
        quick_cost=3.0,
        releases=frozenset(Release),
        effect_kinds=FORCES_AND_RELEASE,
        supplies=_SUPPLIES,
        packages=("newton",),
        summary="A massless tendon over a fixed roller with the capstan law, in Newton's position-based solver on the CPU.",
        limits=_LIMITS,
        known_failures={
            "samples_every_millisecond_from_rest": "places are in single precision: measured 12 nm off at release",
            "free_length_and_wrap_angle_are_those_of_the_position": _WOUND_TOO_FAR,
            "runs_to_its_end": _WOUND_TOO_FAR,
            "release_against_friction_has_the_exact_acceleration": _WOUND_TOO_FAR,
            "energy_never_grows_with_losses": _WOUND_TOO_FAR,
            "follows_the_reference_past_the_halt_and_a_full_turn": _WOUND_TOO_FAR,
        },
        main=False,
    )
    settings_by_profile = SETTINGS
    settings: NewtonTendonSettings

    def build(self, scenario: Scenario) -> NewtonTendonRig:
        """Build the scenario's apparatus at the moment of release."""
        return NewtonTendonRig(scenario.parameters, self.settings)

    def studies(self) -> Studies:
        """Return ladders of step and compliance, Newton's defaults, and the adapter's choices."""
        return tendon_studies(self.settings, self.with_settings)

    def versions(self) -> dict[str, str]:
        """Return the versions of Newton, and of Warp, which compiles it."""
        return {name: installed_version(name) for name in ("newton", "warp-lang")}
