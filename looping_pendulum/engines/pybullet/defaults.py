"""PyBullet: the chain of links with the settings that PyBullet comes with. It fails, and shows which default is why."""

from __future__ import annotations

from dataclasses import replace

from looping_pendulum.engines.chain import MASS_COMPENSATION, MASS_FRACTION
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.pybullet.chain import TWO_TO_ONE_LIMIT, PybulletChain
from looping_pendulum.engines.pybullet.chain_model import PybulletChainSettings
from looping_pendulum.engines.pybullet.settings import (
    DEFAULT_DAMPING,
    DEFAULT_ITERATIONS,
    DEFAULT_SPEED_LIMIT,
    LARGEST_STEP,
    RodShape,
)
from looping_pendulum.engines.studies import Studies

SETTINGS = PybulletChainSettings(
    time_step=LARGEST_STEP,
    link_length=5e-3,
    outer_link_length=8e-3,
    solver_iterations=DEFAULT_ITERATIONS,
    force_interval=1,
    linear_damping=DEFAULT_DAMPING,
    angular_damping=DEFAULT_DAMPING,
    speed_limit=DEFAULT_SPEED_LIMIT,
    joint_motors=True,
    rod=RodShape.CYLINDER,
    friction_with_damping=True,
    polygon=False,
    divided_step=False,
)


_MOTORS_HOLD_JOINTS = "joint motors hold every hinge"
_EFFECTS = (
    *("light_drag", "heavy_drag", "light_linear_drag", "heavy_linear_drag", "attitude_drag", "wind"),
    *("side_force", "side_stiffness", "push_across", "push_along"),
)
_KNOWN_FAILURES = {
    "velocity_is_the_rate_of_position": f"measured 66 m/s off, as the chain flies apart after 0.14 s: {_MOTORS_HOLD_JOINTS}",
    "frictionless_vertical_release_is_an_atwood_machine": f"measured -0.0002 m/s^2 for 8.03: {_MOTORS_HOLD_JOINTS}",
    "vertical_release_obeys_the_capstan_law": f"measured -0.0002 m/s^2 for 5.80: {_MOTORS_HOLD_JOINTS}",
    "held_pendulum_swings_to_the_other_side": f"{_MOTORS_HOLD_JOINTS}, and take the pendulum's energy",
    "string_keeps_its_length": "measured 88 mm off the taut string's path: joint motors hold it bent where it is bent",
    "release_has_the_exact_acceleration": f"measured no motion of the heavy mass: {_MOTORS_HOLD_JOINTS}",
    "release_against_friction_has_the_exact_acceleration": f"measured no motion of the heavy mass: {_MOTORS_HOLD_JOINTS}",
    "energy_is_kept_without_losses": f"measured no motion of the heavy mass: {_MOTORS_HOLD_JOINTS}",
    "energy_never_grows_with_losses": f"measured no motion of the heavy mass: {_MOTORS_HOLD_JOINTS}",
    "follows_the_reference_without_losses": "measured 480 mm off at 0.14 s: the chain flies apart",
    "follows_the_reference_past_the_halt_and_a_full_turn": "measured 220 mm off at 0.42 s: the chain flies apart",
} | {
    f"{effect}_acts_as_in_the_reference": f"measured no motion of the heavy mass: {_MOTORS_HOLD_JOINTS}" for effect in _EFFECTS
}
"""Checks of `engines.conformance` that it fails, with the measured reason."""


class PybulletDefaults(PybulletChain):
    """The chain with PyBullet's own settings."""

    variant = "defaults"
    abilities = replace(
        PybulletChain.abilities,
        main=False,
        additions=(
            f"the string weighs {100 * MASS_FRACTION:g} % of the light mass; "
            f"{100 * MASS_FRACTION * MASS_COMPENSATION:g} % is taken off that",
        ),
        validated=(),
        known_failures=_KNOWN_FAILURES,
        summary="The same multibody with PyBullet's defaults: damping, joint motors, speed clamp, a cylinder as rod.",
        limits=(
            *(limit for limit in PybulletChain.abilities.limits if limit != TWO_TO_ONE_LIMIT),
            "PyBullet's own step of 1/240 s is run at 1 ms, where samples fall",
        ),
    )

    def __init__(self, *, profile: Profile = Profile.QUICK) -> None:
        super().__init__(profile=profile, settings=SETTINGS)

    def studies(self) -> Studies:
        """Return no studies: the studies of `chain` measure each default by itself."""
        return Studies()
