"""MuJoCo: the string as beads that slide over a cylinder under Coulomb contact; no law is fed in."""

from __future__ import annotations

import importlib.metadata
from dataclasses import replace

from looping_pendulum.engines.mujoco.beads_model import SETTINGS, BeadSettings
from looping_pendulum.engines.mujoco.beads_rig import BeadRig
from looping_pendulum.engines.mujoco.studies import (
    BEAD_MASSES,
    BEAD_STEPS,
    BENDS,
    choice,
    ladder,
    softness_ladder,
    solver_defaults,
    time_constant_default,
)
from looping_pendulum.engines.mujoco.tendon import DRAG
from looping_pendulum.engines.protocol import Abilities, Profile, SteppedEngine
from looping_pendulum.engines.studies import Choice, HiddenDefault, Ladder, Studies
from looping_pendulum.engines.trajectory import Supplier, Supplies, Supply
from looping_pendulum.reference_ode.effects import EffectKind
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios.scenario import Scenario

_SUPPLIES = Supplies(
    winding=Supply(
        by=Supplier.ENGINE,
        how="contact of beads with a cylinder; the adapter adds and removes beads on the straight parts only",
    ),
    friction_law=Supply(
        by=Supplier.ENGINE, how="Coulomb friction between beads and cylinder, corrected for the polygon's corners"
    ),
    stick_slip=Supply(by=Supplier.ENGINE, how="the same contact: the solver keeps friction within its elliptic cone"),
    drag=DRAG,
)
_LIMITS = (
    "one Coulomb coefficient only: where static_friction differs from kinetic_friction, the kinetic one acts in both",
    "friction that is a soft constraint creeps: the halted heavy mass still sinks, by some 0.05 mm/s",
    "straight string has no mass and stays straight: no waves run along it, and slack string does not fall",
    "the rig does not stop where the string leaves the rod (wrap angle 0) or the heavy mass reaches it, as the reference does",
)


class MujocoBeads(SteppedEngine):
    """Chain of beads over a cylinder.

    Parameters
    ----------
    profile
        Chooses the settings.
    settings
        Replaces the profile's settings, for studies of convergence.
    """

    name = "mujoco"
    variant = "beads"

    def __init__(self, *, profile: Profile = Profile.QUICK, settings: BeadSettings | None = None) -> None:
        self.profile = profile
        self.settings: BeadSettings = settings if settings is not None else SETTINGS[profile]
        self.abilities = Abilities(
            releases=frozenset(Release),
            effect_kinds=frozenset({EffectKind.FORCE, EffectKind.CLOSURE, EffectKind.RELEASE}),
            supplies=_SUPPLIES,
            packages=("mujoco",),
            summary="Beads on links of fixed length over a cylinder, a limited tendon for each straight part of the string.",
            limits=_LIMITS,
        )

    def build(self, scenario: Scenario) -> BeadRig:
        """Rebuild the scenario's apparatus at the moment of release."""
        return BeadRig(scenario.parameters, self.settings)

    def with_settings(self, **changes: object) -> MujocoBeads:
        """Return this variant with some settings changed."""
        settings = replace(self.settings, **changes)  # type: ignore[arg-type]
        return MujocoBeads(profile=self.profile, settings=settings)

    def studies(self) -> Studies:
        """Step, softness, links and their mass; MuJoCo's defaults; the polygon, and how often beads are seen to."""
        return Studies(ladders=self._ladders(), defaults=self._defaults(), choices=self._choices())

    def _ladders(self) -> tuple[Ladder, ...]:
        s, adjusted = self.settings, self.with_settings
        density = s.bead_mass_ratio / s.bend
        return (
            ladder(adjusted, "time_step", "s", ({"time_step": dt} for dt in BEAD_STEPS)),
            ladder(
                adjusted,
                "bend",
                "rad",
                ({"bend": bend, "bead_mass_ratio": density * bend} for bend in BENDS),
                "a bead's mass, so that the string's mass per length stays",
            ),
            ladder(adjusted, "bead_mass_ratio", "", ({"bead_mass_ratio": ratio} for ratio in BEAD_MASSES)),
            softness_ladder(adjusted, "contact_time_constant", s.time_step),
            softness_ladder(adjusted, "string_time_constant", s.time_step),
        )

    def _defaults(self) -> tuple[HiddenDefault, ...]:
        s, adjusted = self.settings, self.with_settings
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
                adjusted,
                "string_time_constant",
                s.string_time_constant,
                "solref (links)",
                "how fast links return to their length",
            ),
            time_constant_default(
                adjusted, "contact_time_constant", s.contact_time_constant, "solref (contacts)", "how fast beads come to rest"
            ),
            *(
                HiddenDefault(setting=name, default=default, ours=ours, effect=effect, engine=adjusted(**changes))
                for name, default, ours, effect, changes in rows
            ),
            *solver_defaults(adjusted, s, steps_per_group=1),
        )

    def _choices(self) -> tuple[Choice, ...]:
        s, adjusted = self.settings, self.with_settings
        return (
            choice("radius and coefficient", "corrected for the polygon", "the circle's own", adjusted(polygon=False)),
            choice(
                "steps between two updates of drag and beads",
                f"{s.steps_per_group}",
                "1",
                adjusted(steps_per_group=1),
            ),
            choice("bead radius", f"{s.bead_radius:g} m", "0.5 mm", adjusted(bead_radius=5e-4)),
        )

    def versions(self) -> dict[str, str]:
        """Version of MuJoCo."""
        return {"mujoco": importlib.metadata.version("mujoco")}
