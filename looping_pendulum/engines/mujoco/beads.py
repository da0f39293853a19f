"""MuJoCo variant with the string as beads that slide over a cylinder; all friction is MuJoCo's own Coulomb contact."""

from __future__ import annotations

from looping_pendulum.engines.additions import measured_additions
from looping_pendulum.engines.chain import BEADS_WEIGH, NO_STOP, ONE_COEFFICIENT, STRAIGHT_STRING, bead_supplies
from looping_pendulum.engines.mujoco.beads_model import SETTINGS, BeadSettings
from looping_pendulum.engines.mujoco.beads_rig import BeadRig
from looping_pendulum.engines.mujoco.studies import (
    BEAD_MASSES,
    BEAD_STEPS,
    BENDS,
    choice,
    softness_ladder,
    solver_defaults,
    time_constant_default,
)
from looping_pendulum.engines.protocol import FORCES_AND_RELEASE, Abilities, Profile, TunedEngine
from looping_pendulum.engines.studies import AdapterChoice, HiddenDefault, Ladder, Studies, ladder
from looping_pendulum.engines.validated import shipped_range
from looping_pendulum.pages.numbers import quantity
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios.scenario import Scenario

_LIMITS = (
    ONE_COEFFICIENT,
    "friction that is a soft constraint creeps: the halted heavy mass still sinks, by some 0.03 mm/s",
    STRAIGHT_STRING,
    NO_STOP,
)


class MujocoBeads(TunedEngine):
    """MuJoCo with the string as a chain of beads over a cylinder."""

    name = "mujoco"
    distribution = "mujoco"
    variant = "beads"
    abilities = Abilities(
        quick_cost=4.0,
        releases=frozenset(Release),
        effect_kinds=FORCES_AND_RELEASE,
        supplies=bead_supplies("cylinder", "the solver keeps friction within its elliptic cone"),
        packages=("mujoco",),
        summary="Beads on links of fixed length over a cylinder, a limited tendon for each straight part of the string.",
        limits=_LIMITS,
        additions=(
            *measured_additions("mujoco:beads"),
            BEADS_WEIGH.format(100 * SETTINGS[Profile.QUICK].bead_mass_ratio),
        ),
        validated=shipped_range("mujoco:beads"),
    )
    settings_by_profile = SETTINGS
    settings: BeadSettings

    def build(self, scenario: Scenario) -> BeadRig:
        """Rebuild the scenario's apparatus at the moment of release."""
        return BeadRig(scenario.parameters, self.settings)

    def studies(self) -> Studies:
        """Return the studies: step, softness, links and their mass; MuJoCo's defaults; the polygon and the updates of beads."""
        return Studies(ladders=self._ladders(), defaults=self._defaults(), choices=self._choices())

    def _ladders(self) -> tuple[Ladder, ...]:
        s, with_settings = self.settings, self.with_settings
        density, group_time = s.bead_mass_ratio / s.bend, s.time_step * s.steps_per_group
        return (
            ladder(
                with_settings,
                "time_step",
                "s",
                ({"time_step": dt, "steps_per_group": round(group_time / dt)} for dt in BEAD_STEPS),
                "steps between two updates of drag and beads, so that the time between them stays",
            ),
            ladder(
                with_settings,
                "bend",
                "rad",
                ({"bend": bend, "bead_mass_ratio": density * bend} for bend in BENDS),
                "a bead's mass, so that the string's mass per length stays",
            ),
            ladder(with_settings, "bead_mass_ratio", "", ({"bead_mass_ratio": ratio} for ratio in BEAD_MASSES)),
            softness_ladder(with_settings, "contact_time_constant", s.time_step),
            softness_ladder(with_settings, "string_time_constant", s.time_step),
        )

    def _defaults(self) -> tuple[HiddenDefault, ...]:
        s, with_settings = self.settings, self.with_settings
        contact = f"{s.least_contact_impedance:g} to {s.contact_impedance:g} within 0.5 mm"
        ratio = f"{s.friction_to_normal_impedance:g}"
        rows = (
            ("solimp (links)", "0.95", f"{s.string_impedance:g}", "how much of a link is enforced", {"string_impedance": 0.95}),
            (
                "solimp (contacts)",
                "0.9 to 0.95",
                contact,
                "how much of a contact is enforced",
                {"least_contact_impedance": 0.9, "contact_impedance": 0.95},
            ),
            ("cone", "pyramidal", s.cone, "shape of the friction cone", {"cone": "pyramidal"}),
            ("impratio", "1", ratio, "how much harder friction is than contact", {"friction_to_normal_impedance": 1.0}),
        )
        return (
            time_constant_default(
                with_settings,
                "string_time_constant",
                s.string_time_constant,
                "solref (links)",
                "how fast links return to their length",
            ),
            time_constant_default(
                with_settings,
                "contact_time_constant",
                s.contact_time_constant,
                "solref (contacts)",
                "how fast beads come to rest",
            ),
            *(
                HiddenDefault(setting=name, default=default, ours=ours, effect=effect, engine=with_settings(**changes))
                for name, default, ours, effect, changes in rows
            ),
            *solver_defaults(with_settings, s, steps_per_group=1),
        )

    def _choices(self) -> tuple[AdapterChoice, ...]:
        s, with_settings = self.settings, self.with_settings
        return (
            choice("radius and coefficient", "corrected for the polygon", "the circle's own", with_settings(polygon=False)),
            choice(
                "steps between two updates of drag and beads",
                f"{s.steps_per_group}",
                "1",
                with_settings(steps_per_group=1),
            ),
            choice("bead radius", quantity(s.bead_radius, "m", 3), "0.5 mm", with_settings(bead_radius=5e-4)),
        )
