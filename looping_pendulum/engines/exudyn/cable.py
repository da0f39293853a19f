"""Exudyn: the string is a cable of ANCF elements that slides over a circle with friction; no capstan law is fed in."""

from __future__ import annotations

from looping_pendulum.engines.chain import NO_STOP, ONE_COEFFICIENT
from looping_pendulum.engines.exudyn.cable_rig import ExudynCableRig
from looping_pendulum.engines.exudyn.settings import CABLE_SETTINGS, CableSettings
from looping_pendulum.engines.exudyn.studies import cable_studies
from looping_pendulum.engines.protocol import APPLIED_DRAG, FORCES_AND_RELEASE, Abilities, TunedEngine
from looping_pendulum.engines.studies import Studies
from looping_pendulum.engines.trajectory import Supplier, Supplies, Supply
from looping_pendulum.engines.validated import shipped_range
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios.scenario import Scenario

_LIMITS = (
    ONE_COEFFICIENT,
    "the string stretches like a soft thread, by a millimetre or two at ten_to_one where it catches the light mass",
    "a slack string buckles: then Newton's iterations need short steps, or fail",
    NO_STOP,
)


class ExudynCable(TunedEngine):
    """A cable of finite elements over a circle."""

    name = "exudyn"
    distribution = "exudyn"
    variant = "cable"
    abilities = Abilities(
        quick_cost=70.0,
        releases=frozenset(Release),
        effect_kinds=FORCES_AND_RELEASE,
        supplies=Supplies(
            winding=Supply(by=Supplier.ENGINE, how="contact of the cable's segments with a circle"),
            friction_law=Supply(
                by=Supplier.ENGINE,
                how="Coulomb friction between segments and circle, its coefficient solved for their corners",
            ),
            stick_slip=Supply(by=Supplier.ENGINE, how="the same contact: a sticking segment is held by a spring"),
            drag=APPLIED_DRAG,
        ),
        packages=("exudyn",),
        summary="An elastic cable of ANCF elements with mass along the whole string, over a circle with friction.",
        limits=_LIMITS,
        additions=(
            "the string weighs 1 % of the light mass; 0.4 % is taken off that",
            "the string is slightly taut before its release, lest it buckle",
        ),
        validated=shipped_range("exudyn:cable"),
        known_failures={
            "vertical_release_obeys_the_capstan_law": "measured an acceleration 1.2 % too large: friction is 2 % too small; "
            "elements half as long bring a third of it back, and contacts four times as stiff lose half as much again",
        },
        main=False,
    )
    settings_by_profile = CABLE_SETTINGS
    settings: CableSettings

    def build(self, scenario: Scenario) -> ExudynCableRig:
        """Build the scenario's apparatus at the moment of release."""
        return ExudynCableRig(scenario.parameters, self.settings, self.end_length(scenario))

    def studies(self) -> Studies:
        """Return ladders of step, elements, stiffnesses and mass, Exudyn's defaults, and the adapter's choices."""
        return cable_studies(self.settings, self.with_settings)
