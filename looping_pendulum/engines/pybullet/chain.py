"""PyBullet: the string is one multibody of links that slides over the rod under Bullet's own Coulomb contact.

A Featherstone multibody cannot stretch: a fixed base carries the heavy mass on a vertical slide, and from it one hinge after
another leads along the string to the light mass. Each link has a small contact sphere at its end, a *node*. The rod is a static
sphere: it has the rod's section in the plane of motion, and sphere on sphere is Bullet's one exact contact. With the quick
profile several links away from the rod are joined to one (`joining`).
"""

from __future__ import annotations

from looping_pendulum.engines.additions import measured_additions
from looping_pendulum.engines.chain import MASS_COMPENSATION, MASS_FRACTION
from looping_pendulum.engines.protocol import APPLIED_DRAG, FORCES_AND_RELEASE, Abilities, Profile
from looping_pendulum.engines.pybullet.chain_model import MAX_LINK_LENGTHENING, PybulletChainSettings
from looping_pendulum.engines.pybullet.chain_rig import PybulletChainRig
from looping_pendulum.engines.pybullet.multibody import MAX_JOINTS
from looping_pendulum.engines.pybullet.studies import (
    choice,
    common_choices,
    iteration_ladder,
    multibody_defaults,
    step_ladder,
    world_defaults,
)
from looping_pendulum.engines.pybullet.variant import COULOMB_AT_NODES, ONE_COEFFICIENT, PybulletVariant
from looping_pendulum.engines.studies import AdapterChoice, Ladder, Studies, ladder
from looping_pendulum.engines.trajectory import Supplier, Supplies, Supply
from looping_pendulum.engines.validated import shipped_range
from looping_pendulum.pages.numbers import quantity
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios.scenario import Scenario

SETTINGS = {
    # With 40 iterations, PyBullet's margin and no links joined, ten_to_one takes 2.6 times the CPU time. RMS at 0.35, 0.7 and
    # 1 s, those settings against these: ten_to_one 0.85, 10, 17 mm against 0.5 to 0.7, 7 to 10, 12 to 19 mm in five releases
    # within 0.01 deg or 0.1 mm; two_to_one 1.3, 1.7, 1.9 mm against 1.5, 2.5, 2.4 mm; two_and_a_half_to_one at 0.7 s 0.4 mm,
    # and 0.5 to 1.3 mm if moved by hundredths of a degree, against 1.1 to 1.4 mm. In two_to_one the heavy mass halted 26 to
    # 32 ms late; of five releases up to 6 nanoradians from the shipped one it now halts in four, 0 to 38 ms late, and in one
    # it never does. The smaller margin, not the joining, moves the acceleration of atwood, from 0.03 % too low to 0.23 % too
    # high.
    Profile.QUICK: PybulletChainSettings(
        time_step=2e-5,
        link_length=5e-3,
        outer_link_length=8e-3,
        solver_iterations=36,
        force_interval=10,
        neighbour_margin=2e-3,
        joined_hanging_links=8,
        joined_free_links=2,
        # Most of the time of ten_to_one is spent after the halt. With 1.17 or more, the string of one in four releases within
        # 0.01 deg or 0.1 mm of its own slides once more half a second later; with 10/9 none does
        lengthening_after_halt=10 / 9,
    ),
    # With PyBullet's margin of 20 mm the same run costs 1.6 times as much. At 0.7 s ten_to_one is 3.4 mm off; 1.8 mm with that
    # margin, 1.5 and 2 mm with the start moved by 0.01 deg or 0.1 mm, 6.5, 1.8 and 6.8 mm with steps of 12.5, 8 and 5 us: what
    # is left scatters with how the nodes of 4.4 mm links lie and are swept. With our margin all halt 1.4 to 2.6 ms early.
    Profile.ACCURATE: PybulletChainSettings(
        time_step=1e-5,
        link_length=4.4e-3,
        outer_link_length=8.5e-3,
        solver_iterations=20,
        force_interval=10,
        neighbour_margin=1e-4,
    ),
}

LINK_LENGTHS = (6e-3, 5.5e-3, 5e-3, 4.5e-3)
"""Link lengths of the ladder [m]; shorter ones do not fit `MAX_JOINTS` in the ten-to-one trial, and would be lengthened."""

RIPPLE_LIMIT = "links of several millimetres are long for a thin rod: the string's speed over it ripples as nodes pass"
TWO_TO_ONE_LIMIT = (
    "quick: whether two_to_one comes to rest is chance: of five releases up to 6 nanoradians from its own one never did, and "
    "the others halted 0 to 38 ms late"
)
NO_STRETCH_LIMIT = "reduced coordinates cannot stretch: the string stretch is 0 by construction, not a measurement"

WINDING = (
    "contact of the links' end spheres with a static sphere of the rod's section; quick: the adapter joins and splits links on "
    "the straight parts only"
)

_ABILITIES = Abilities(
    quick_cost=10.0,
    releases=frozenset(Release),
    effect_kinds=FORCES_AND_RELEASE,
    supplies=Supplies(
        winding=Supply(by=Supplier.ENGINE, how=WINDING),
        friction_law=Supply(by=Supplier.ENGINE, how=COULOMB_AT_NODES),
        stick_slip=Supply(by=Supplier.ENGINE, how="Coulomb contact"),
        drag=APPLIED_DRAG,
    ),
    packages=("pybullet",),
    summary="One Featherstone multibody of links that slides over a static sphere under Coulomb contact.",
    limits=(
        ONE_COEFFICIENT,
        f"at most {MAX_JOINTS} joints are reported rightly: links of a long string are laid up to {MAX_LINK_LENGTHENING:g} "
        "times longer than the settings say, and a longer string still is refused",
        "a link that winds on must not be longer than the rod is thick: quick (8 mm links) refuses rods below 4 mm of radius",
        "explicit steps: where the rod holds back more than at ten_to_one they are shorter than the settings say",
        RIPPLE_LIMIT,
        TWO_TO_ONE_LIMIT,
        NO_STRETCH_LIMIT,
    ),
    additions=(
        f"a string that weighs {100 * MASS_FRACTION:g} % of the light mass, "
        f"from which {100 * MASS_FRACTION * MASS_COMPENSATION:g} % is taken off",
        "a contact coefficient and radius solved from the capstan law for the chain's corners: a little of that law is fed in",
        *measured_additions("pybullet:chain"),
        "quick: which links away from the rod are one, and when; when links that left the rod are joined, velocities change "
        "as in a plastic collision",
        "how long a step is, from the largest T2 - T1 of the reference's run until its halt, and from the time of that halt",
        "the wrap angle over which that coefficient is right on average: the release's, and a quarter turn for what follows",
    ),
    validated=shipped_range("pybullet:chain"),
)


class PybulletChain(PybulletVariant):
    """A chain of links over a static sphere."""

    variant = "chain"
    abilities = _ABILITIES
    settings_by_profile = SETTINGS
    rig = PybulletChainRig
    settings: PybulletChainSettings

    def studies(self) -> Studies:
        """Return ladders of step, link length and iterations, PyBullet's defaults, and the adapter's choices."""
        s, with_settings = self.settings, self.with_settings
        return Studies(
            ladders=(
                step_ladder(with_settings, s.time_step),
                self._link_ladder(),
                iteration_ladder(with_settings, s.solver_iterations),
            ),
            defaults=(*world_defaults(with_settings, s), *multibody_defaults(with_settings, s)),
            choices=(
                *(c for c in (*common_choices(with_settings, s), self._unjoined()) if c.engine.settings != s),
                choice(
                    "links below the rod",
                    quantity(s.hanging_link_length, "m", 3),
                    "half as long",
                    with_settings(hanging_link_length=7.5e-3),
                ),
                choice(
                    "inertia of a link", f"{s.relative_inertia:g} m h^2", "three times", with_settings(relative_inertia=0.03)
                ),
            ),
        )

    def _unjoined(self) -> AdapterChoice:
        s = self.settings
        ours = f"joined by {s.joined_hanging_links} below the rod, by {s.joined_free_links} beyond it"
        separate = self.with_settings(joined_hanging_links=1, joined_free_links=1)
        return choice("links away from the rod", ours, "separate", separate)

    def _link_ladder(self) -> Ladder:
        ours = self.settings.link_length
        outer = self.settings.outer_link_length / ours
        lengths = sorted({*LINK_LENGTHS, ours}, reverse=True)
        rungs = ({"link_length": h, "outer_link_length": outer * h} for h in lengths)
        return ladder(self.with_settings, "link_length", "m", rungs, "links that only wind on, in proportion")

    def end_length(self, scenario: Scenario) -> float:
        """Return the free length [m] at which the run ends: a chain cannot follow once only its last link is left."""
        return max(super().end_length(scenario), self.settings.outer_link_length)
