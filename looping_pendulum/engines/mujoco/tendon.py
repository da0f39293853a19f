"""MuJoCo variants with the string as a spatial tendon over a cylinder; they differ in the friction between string and rod."""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import StrEnum

from looping_pendulum.engines.additions import measured_additions
from looping_pendulum.engines.mujoco.constant_friction import FrictionSize, friction_loss
from looping_pendulum.engines.mujoco.studies import (
    DEFAULT_TIME_CONSTANT,
    TENDON_STEPS,
    choice,
    softness_ladder,
    step_ladder,
    string_defaults,
    time_constant_default,
)
from looping_pendulum.engines.mujoco.tendon_model import TendonSettings
from looping_pendulum.engines.mujoco.tendon_rig import TendonRig
from looping_pendulum.engines.protocol import (
    APPLIED_DRAG,
    FORCES_AND_RELEASE,
    SAMPLE_INTERVAL,
    Abilities,
    Profile,
    SteppedEngine,
)
from looping_pendulum.engines.studies import AdapterChoice, Studies
from looping_pendulum.engines.trajectory import Supplier, Supplies, Supply
from looping_pendulum.engines.validated import shipped_range
from looping_pendulum.pages.numbers import quantity
from looping_pendulum.reference_ode.effects import EffectKind
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.versions import installed_version


class TendonVariant(StrEnum):
    """Friction between string and rod; see `MujocoTendon`."""

    DOCUMENTED = "documented"
    CAPSTAN = "capstan"
    FRICTIONLOSS = "frictionloss"
    DEFAULTS = "defaults"


MUJOCO_DEFAULTS = TendonSettings(
    time_step=SAMPLE_INTERVAL,
    string_time_constant=DEFAULT_TIME_CONSTANT,
    friction_time_constant=DEFAULT_TIME_CONSTANT,
    impedance=0.95,
    least_impedance=0.9,
    integrator="Euler",
    jacobian="auto",
    solver_tolerance=1e-8,
    solver_iterations=100,
    corrections=False,
)
"""MuJoCo's default settings, except its step of 2 ms, which is longer than the sample interval."""

_SETTINGS = {
    Profile.QUICK: TendonSettings(time_step=5e-4, string_time_constant=1e-3, friction_time_constant=1e-3),
    Profile.ACCURATE: TendonSettings(time_step=5e-5, string_time_constant=1e-4, friction_time_constant=1e-4),
}


def settings_of(variant: TendonVariant, profile: Profile) -> TendonSettings:
    """Return the settings of ``variant`` in ``profile``."""
    return MUJOCO_DEFAULTS if variant is TendonVariant.DEFAULTS else _SETTINGS[profile]


_WINDING = Supply(by=Supplier.ENGINE, how="spatial tendon wrapped over a cylinder; the adapter counts turns, using two in turn")
_NO_FRICTION = Supply(by=Supplier.NOBODY, how="spatial tendons have no friction on what they wrap")
_NO_STICKING = Supply(by=Supplier.NOBODY, how="nothing to stick to")
_FRICTIONLESS = Supplies(winding=_WINDING, friction_law=_NO_FRICTION, stick_slip=_NO_STICKING, drag=APPLIED_DRAG)
_STICK_SLIP = (
    "the adapter predicts where in a step the string stops and decides by the laws whether the rod holds it; MuJoCo's "
    "friction-loss constraint then stops and holds it"
)
_SUPPLIES = {
    TendonVariant.DOCUMENTED: _FRICTIONLESS,
    TendonVariant.DEFAULTS: _FRICTIONLESS,
    TendonVariant.CAPSTAN: Supplies(
        winding=_WINDING,
        friction_law=Supply(by=Supplier.ADAPTER, how="capstan bound from the tendon's tension, fed to dof_frictionloss"),
        stick_slip=Supply(by=Supplier.ADAPTER, how=_STICK_SLIP),
        drag=APPLIED_DRAG,
    ),
    TendonVariant.FRICTIONLOSS: Supplies(
        winding=_WINDING,
        friction_law=Supply(
            by=Supplier.ENGINE,
            how="constant frictionloss of the hanging part's tendon, whatever its load; its size is the adapter's",
        ),
        stick_slip=Supply(by=Supplier.ENGINE, how="the same friction-loss constraint"),
        drag=APPLIED_DRAG,
    ),
}
_COMMON_LIMITS = (
    "a slack string is caught within one time step, so up to a step's way too late",
    "the rig does not stop where the string leaves the rod (wrap angle 0) or the heavy mass reaches it, as the reference does",
)
_NEVER_HALTS = "without friction the heavy mass never halts"
_LIMITS: Mapping[TendonVariant, tuple[str, ...]] = {
    TendonVariant.DOCUMENTED: (_NEVER_HALTS,),
    TendonVariant.CAPSTAN: (
        "where the catch turns the heavy mass round, friction turns with it; the reference gives the whole pull one direction",
    ),
    TendonVariant.FRICTIONLOSS: (
        "friction does not grow with the tension or with the turns on the rod, so the grip that ends the fall is missing",
        "MuJoCo's frictionloss of the string's own tendon would brake nothing, as its length stays; the hanging part has it",
        "no size halts in time: of 0.1 to 1.2 N, 0.2 N is nearest to the reference up to 0.35 s, and its heavy mass turns back",
    ),
    TendonVariant.DEFAULTS: (_NEVER_HALTS, "MuJoCo's step of 2 ms is halved, so that samples fall on steps"),
}
_FRICTION = {
    TendonVariant.DOCUMENTED: "no friction on the rod",
    TendonVariant.CAPSTAN: "the capstan law fed in as friction loss",
    TendonVariant.FRICTIONLOSS: "MuJoCo's constant friction loss for friction",
    TendonVariant.DEFAULTS: "no friction on the rod, every solver setting left as it comes",
}


_LATE_CATCH = "the length by which a slack string is caught late, which is let go of again within some milliseconds"
_ADDITIONS: Mapping[TendonVariant, tuple[str, ...]] = {
    TendonVariant.DOCUMENTED: (_LATE_CATCH,),
    TendonVariant.CAPSTAN: (
        "the tension without friction, found by a solve of its own at every step, from which law and bound follow",
        "the force of the friction that turns round within a step",
        _LATE_CATCH,
    ),
    TendonVariant.FRICTIONLOSS: (
        "the size of the constant: the friction at the release in the reference's own run, which the adapter solves beforehand",
        _LATE_CATCH,
    ),
    TendonVariant.DEFAULTS: (),
}
_KNOWN_FAILURES = {
    TendonVariant.FRICTIONLOSS: {
        "follows_the_reference_past_the_halt_and_a_full_turn": "measured 121 mm off at 0.39 s: it does not halt it",
    },
    TendonVariant.DEFAULTS: {
        "held_pendulum_swings_to_the_other_side": "measured 6 % of the fall's energy off: the string stretches",
        "string_keeps_its_length": "measured 1.8 mm in 0.15 s, where 1 mm is allowed: a string with a time constant of 20 ms",
        "runs_to_its_end": "the string stretches by more than its budget before the light mass is at the rod",
        "release_has_the_exact_acceleration": "measured a start 0.58 ms early: half of Euler's step of 1 ms, and a soft string",
    },
}
"""Variant -> checks of `engines.conformance` that it fails, with the measured reason."""


class MujocoTendon(SteppedEngine):
    """MuJoCo with the string as a spatial tendon over a cylinder.

    Parameters
    ----------
    variant
        `TendonVariant.DOCUMENTED`: no friction between string and rod, because MuJoCo documents none for a tendon.
        `TendonVariant.CAPSTAN`: the friction bound of the effects' string laws acts on the heavy mass's slide.
        `TendonVariant.FRICTIONLOSS`: a constant friction loss, the only friction that MuJoCo has for tendons.
        `TendonVariant.DEFAULTS`: as documented, with the solver's default settings.
    profile
        Chooses the settings.
    settings
        Replaces the profile's settings, for studies of convergence.
    friction_size
        Size of the constant friction loss of `TendonVariant.FRICTIONLOSS`.
    """

    name = "mujoco"

    def __init__(
        self,
        *,
        variant: str = TendonVariant.CAPSTAN,
        profile: Profile = Profile.QUICK,
        settings: TendonSettings | None = None,
        friction_size: FrictionSize = FrictionSize.AT_RELEASE,
    ) -> None:
        chosen = TendonVariant(variant)
        self.variant = chosen.value
        self.profile = profile
        self.settings: TendonSettings = settings if settings is not None else settings_of(chosen, profile)
        self.friction_size = friction_size
        self.abilities = Abilities(
            releases=frozenset(Release),
            effect_kinds=FORCES_AND_RELEASE | {EffectKind.STRING_LAW}
            if chosen is TendonVariant.CAPSTAN
            else FORCES_AND_RELEASE,
            supplies=_SUPPLIES[chosen],
            packages=("mujoco",),
            summary=f"Two spatial tendons used in turn over a cylinder, {_FRICTION[chosen]}.",
            limits=(*_COMMON_LIMITS, *_LIMITS[chosen]),
            known_failures=_KNOWN_FAILURES.get(chosen, {}),
            additions=(*measured_additions(f"mujoco:{chosen.value}"), *_ADDITIONS[chosen]),
            validated=shipped_range(f"mujoco:{chosen.value}"),
            main=chosen in (TendonVariant.DOCUMENTED, TendonVariant.CAPSTAN),
        )

    def build(self, scenario: Scenario) -> TendonRig:
        """Rebuild the scenario's apparatus at the moment of release."""
        constant = self.variant == TendonVariant.FRICTIONLOSS
        return TendonRig(
            scenario.parameters,
            self.settings,
            end_length=self.end_length(scenario),
            capstan=self.variant == TendonVariant.CAPSTAN,
            friction_loss=friction_loss(scenario.parameters, self.friction_size) if constant else 0.0,
        )

    def studies(self) -> Studies:
        """Return the studies: step and softness; MuJoCo's defaults; the choices of winding, catching and constant friction."""
        s, with_friction = self.settings, self.variant in (TendonVariant.CAPSTAN, TendonVariant.FRICTIONLOSS)
        constants = ("string_time_constant", "friction_time_constant")[: 2 if with_friction else 1]
        followers = () if self.variant == TendonVariant.DEFAULTS else constants
        ladders = (
            step_ladder(self.with_settings, TENDON_STEPS, followers),
            *(softness_ladder(self.with_settings, name, s.time_step) for name in constants),
        )
        friction = time_constant_default(
            self.with_settings,
            "friction_time_constant",
            s.friction_time_constant,
            "solreffriction",
            "how fast string that is held comes to rest",
        )
        defaults = (*string_defaults(self.with_settings, s), *((friction,) if with_friction else ()))
        if self.variant == TendonVariant.DEFAULTS:  # it has nothing but defaults
            return Studies(ladders=ladders)
        return Studies(ladders=ladders, defaults=defaults, choices=self._choices())

    def _choices(self) -> tuple[AdapterChoice, ...]:
        s = self.settings
        other_size = FrictionSize.AT_RELEASE if self.friction_size is FrictionSize.EQUAL_WORK else FrictionSize.EQUAL_WORK
        other = MujocoTendon(variant=self.variant, profile=self.profile, settings=s, friction_size=other_size)
        size_choice = choice("size of the constant friction", self.friction_size.value, other_size.value, other)
        return (
            choice(
                "wrap angle at which the next tendon takes over",
                f"{math.degrees(s.switch_up):.0f} deg above k pi",
                "225 deg above k pi",
                self.with_settings(switch_up=math.radians(225)),
            ),
            choice(
                "wrap angle at which the last tendon takes over",
                f"{math.degrees(s.switch_down):.0f} deg above k pi",
                "5 deg above k pi",
                self.with_settings(switch_down=math.radians(5)),
            ),
            choice(
                "time in which a late catch is taken back",
                quantity(s.catch_time, "s", 3),
                quantity(5 * s.catch_time, "s", 3),
                self.with_settings(catch_time=5 * s.catch_time),
            ),
            choice(
                "what MuJoCo leaves out (l omega^2 in the string's acceleration, half a step of velocity)",
                "made up for",
                "left out",
                self.with_settings(corrections=False),
            ),
            *((size_choice,) if self.variant == TendonVariant.FRICTIONLOSS else ()),
        )

    def versions(self) -> dict[str, str]:
        """Return the version of MuJoCo."""
        return {"mujoco": installed_version("mujoco")}
