"""PyBullet: the multibody of links is created anew whenever a node reaches or leaves the rod, so that it has fewer links.

Only links on the rod have nodes; each straight part of the string is one long link, where `chain` keeps short ones near the
rod. It is not as good: the adapter chooses when a node is added or removed, and the masses feel it.
"""

from __future__ import annotations

from dataclasses import replace

from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.pybullet.chain import NO_STRETCH_LIMIT, RIPPLE_LIMIT, PybulletChain
from looping_pendulum.engines.pybullet.multibody import MAX_JOINTS
from looping_pendulum.engines.pybullet.remade_model import RemadeSettings
from looping_pendulum.engines.pybullet.remade_rig import RemadeRig
from looping_pendulum.engines.pybullet.studies import BEAD_MASS_RATIOS, choice, iteration_ladder, link_ladder, step_ladder
from looping_pendulum.engines.pybullet.variant import ONE_COEFFICIENT, PybulletVariant
from looping_pendulum.engines.studies import Studies, ladder
from looping_pendulum.engines.trajectory import Supplier, Supply
from looping_pendulum.engines.validated import shipped_range
from looping_pendulum.scenarios.scenario import Scenario

SETTINGS = {
    Profile.QUICK: RemadeSettings(time_step=2e-5, link_length=3e-3, bead_mass_ratio=1e-3, solver_iterations=20),
    Profile.ACCURATE: RemadeSettings(
        time_step=1e-5, link_length=2.5e-3, bead_mass_ratio=5e-4, solver_iterations=20, look_interval=4, force_interval=10
    ),
}

_ABILITIES = replace(
    PybulletChain.abilities,
    quick_cost=15.0,
    supplies=replace(
        PybulletChain.abilities.supplies,
        winding=Supply(
            by=Supplier.ENGINE,
            how="contact of the links' end spheres with a static sphere of the rod's section; the adapter adds and takes "
            "off links on the straight parts only",
        ),
    ),
    main=False,
    additions=(
        f"nodes on the rod weigh {100 * SETTINGS[Profile.QUICK].bead_mass_ratio:.2g} % of the light mass each; nothing is "
        "taken off the masses for them",
        "what a node that goes had in length and speed is shared out between the masses, as the string's pull would",
    ),
    validated=shipped_range("pybullet:remade"),
    summary="The multibody made anew whenever a node comes on the rod or goes; its constants were selected on ten_to_one.",
    limits=(
        ONE_COEFFICIENT,
        "its constants were selected on ten_to_one, where it scatters; at mass ratios of 2 and 2.5 it is farther off",
        "when a node comes and goes is the adapter's choice, and moves the vertical drop's acceleration",
        f"at most {MAX_JOINTS} joints are reported rightly: a string wound over more links is refused",
        RIPPLE_LIMIT,
        NO_STRETCH_LIMIT,
        "straight string is one stiff massless link: no waves run along it, and slack string does not fall",
    ),
)


class PybulletRemade(PybulletVariant):
    """A chain whose links are added and removed as the string winds."""

    variant = "remade"
    abilities = _ABILITIES
    settings_by_profile = SETTINGS
    rig = RemadeRig
    settings: RemadeSettings

    def studies(self) -> Studies:
        """Return ladders of step, links, their mass and iterations, and choices of when nodes are added and removed.

        PyBullet's defaults are studied by `chain`.
        """
        s, with_settings = self.settings, self.with_settings
        return Studies(
            ladders=(
                step_ladder(with_settings, s.time_step),
                link_ladder(with_settings, s),
                iteration_ladder(with_settings, s.solver_iterations),
                ladder(with_settings, "bead_mass_ratio", "", ({"bead_mass_ratio": ratio} for ratio in BEAD_MASS_RATIOS)),
            ),
            choices=(
                choice(
                    "when a node goes",
                    f"off the rod for {s.goes:g} links",
                    "for 0.5 links: it swings meanwhile",
                    with_settings(comes=0.3, goes=0.5),
                ),
                choice(
                    "when a node comes and goes",
                    f"{s.comes:g} and {s.goes:g} links from touching",
                    "0.01 and 0.03",
                    with_settings(comes=0.01, goes=0.03),
                ),
                choice("steps between two looks at the nodes", f"{s.look_interval}", "1", with_settings(look_interval=1)),
            ),
        )

    def end_length(self, scenario: Scenario) -> float:
        """Return the free length [m] at which the run ends: a chain cannot follow once only its last link is left."""
        return max(super().end_length(scenario), 2 * self.settings.length_on_rod(scenario.parameters))
