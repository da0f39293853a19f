"""PyBullet: the string as one multibody of links that slides over the rod under Bullet's own Coulomb contact.

A Featherstone multibody cannot stretch: a fixed base carries the heavy mass on a vertical slide, and from it one hinge after
another leads along the string to the light mass. Links on the rod have a small contact sphere at their end, a *node*; each
straight part of the string is one long link.
"""

from __future__ import annotations

import importlib.metadata
from dataclasses import replace

from looping_pendulum.engines.protocol import Abilities, Profile, Rig, SteppedEngine
from looping_pendulum.engines.pybullet.chain_rig import MAX_JOINTS, ChainRig, ChainSettings
from looping_pendulum.engines.pybullet.studies import (
    BEAD_MASSES,
    choice,
    iteration_ladder,
    ladder,
    link_ladder,
    multibody_defaults,
    step_ladder,
    world_defaults,
)
from looping_pendulum.engines.pybullet.world import FallingRig
from looping_pendulum.engines.studies import Studies
from looping_pendulum.engines.trajectory import Supplier, Supplies, Supply
from looping_pendulum.reference_ode.effects import EffectKind
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios.scenario import Scenario

SETTINGS = {
    Profile.QUICK: ChainSettings(time_step=2e-5, link_length=3e-3, bead_mass_ratio=1e-3, solver_iterations=20),
    Profile.ACCURATE: ChainSettings(
        time_step=1e-5, link_length=2.5e-3, bead_mass_ratio=5e-4, solver_iterations=20, look_interval=4, force_interval=10
    ),
}

DRAG = Supply(by=Supplier.ADAPTER, how="the reference's formulas as applied forces")
ONE_COEFFICIENT = "one Coulomb coefficient: of a static friction above the kinetic one, only the kinetic one is represented"
REACHED = frozenset({EffectKind.FORCE, EffectKind.CLOSURE, EffectKind.RELEASE})

_ABILITIES = Abilities(
    releases=frozenset(Release),
    effect_kinds=REACHED,
    supplies=Supplies(
        winding=Supply(
            by=Supplier.ENGINE,
            how="contact of the links' end spheres with a static sphere of the rod's section; the adapter adds and takes "
            "off links on the straight parts only",
        ),
        friction_law=Supply(
            by=Supplier.ENGINE, how="Coulomb contact at every node; the adapter only corrects the coefficient for the polygon"
        ),
        stick_slip=Supply(by=Supplier.ENGINE, how="Coulomb contact"),
        drag=DRAG,
    ),
    packages=("pybullet",),
    summary="One Featherstone multibody of links that slides over a static sphere under Coulomb contact.",
    limits=(
        ONE_COEFFICIENT,
        "when a node comes and goes is the adapter's choice, and moves the vertical drop's acceleration by up to 1.5 %",
        f"at most {MAX_JOINTS} joints are reported rightly: a string wound over more links is refused",
        "links of several millimetres are long for a thin rod: the string's speed over it ripples as nodes pass",
        "straight string is one stiff massless link: no waves run along it, and slack string does not fall",
    ),
)


class PybulletChain(SteppedEngine):
    """A chain of links over a static sphere.

    Parameters
    ----------
    profile
        Chooses the settings.
    settings
        Replaces the profile's settings, for studies of convergence.
    """

    name = "pybullet"
    variant = "chain"
    abilities = _ABILITIES

    def __init__(self, *, profile: Profile = Profile.QUICK, settings: ChainSettings | None = None) -> None:
        self.profile = profile
        self.settings: ChainSettings = settings if settings is not None else SETTINGS[profile]

    def build(self, scenario: Scenario) -> Rig:
        """Rebuild the scenario's apparatus at the moment of release."""
        rig = FallingRig if scenario.parameters.release is Release.DROP else ChainRig
        return rig(scenario.parameters, self.settings)

    def with_settings(self, **changes: object) -> PybulletChain:
        """Return this variant with some settings changed."""
        settings = replace(self.settings, **changes)  # type: ignore[arg-type]
        return PybulletChain(profile=self.profile, settings=settings)

    def studies(self) -> Studies:
        """Step, links, their mass and the solver's sweeps; PyBullet's defaults; the adapter's choices."""
        s, adjusted = self.settings, self.with_settings
        return Studies(
            ladders=(
                step_ladder(adjusted, s.time_step),
                link_ladder(adjusted, s),
                iteration_ladder(adjusted, s.solver_iterations),
                ladder(adjusted, "bead_mass_ratio", "", ({"bead_mass_ratio": ratio} for ratio in BEAD_MASSES)),
            ),
            defaults=(*world_defaults(adjusted, s), *multibody_defaults(adjusted, s)),
            choices=(
                choice("radius and coefficient", "corrected for the corners", "the circle's own", adjusted(polygon=False)),
                choice(
                    "when a node goes",
                    f"off the rod for {s.goes:g} links",
                    "for 0.5 links: it swings meanwhile",
                    adjusted(comes=0.3, goes=0.5),
                ),
                choice(
                    "when a node comes and goes",
                    f"{s.comes:g} and {s.goes:g} links from touching",
                    "0.01 and 0.03",
                    adjusted(comes=0.01, goes=0.03),
                ),
                choice("steps between two looks at the nodes", f"{s.look_interval}", "1", adjusted(look_interval=1)),
                choice("steps between two updates of the forces", f"{s.force_interval}", "1", adjusted(force_interval=1)),
                choice("node radius", f"{s.node_radius:g} m", "1 mm", adjusted(node_radius=1e-3)),
                choice("inertia of a link", f"{s.relative_inertia:g} m h^2", "three times", adjusted(relative_inertia=0.03)),
                choice(
                    "share of a penetration taken back in a step",
                    f"{s.contact_error_reduction:g}",
                    "0.02",
                    adjusted(contact_error_reduction=0.02),
                ),
            ),
        )

    def end_length(self, scenario: Scenario) -> float:
        """Free length [m] at which the run ends: a chain cannot follow once only its last link is left."""
        return max(super().end_length(scenario), 2 * self.settings.length_on_rod(scenario.parameters))

    def versions(self) -> dict[str, str]:
        """Version of PyBullet."""
        return {"pybullet": importlib.metadata.version("pybullet")}
