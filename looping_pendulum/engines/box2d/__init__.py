"""Box2D 3, through pyb2d3: beads that slide over a static circle under Coulomb contact; no capstan law is fed in.

Offered through the entry point that a third party uses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from looping_pendulum.engines.bead_rig import JointRig
from looping_pendulum.engines.chain import (
    NO_STOP,
    ONE_COEFFICIENT,
    STRAIGHT_STRING,
    BeadChainSettings,
    bead_abilities,
    bead_choices,
    bend_rungs,
)
from looping_pendulum.engines.protocol import Engine, Profile, SteppedEngine
from looping_pendulum.engines.studies import Ladder, Studies, Variation, default_row
from looping_pendulum.pages.numbers import quantity
from looping_pendulum.reference_ode.cartesian import Vector
from looping_pendulum.runs.trajectory import SAMPLE_INTERVAL


@dataclass(frozen=True, kw_only=True)
class Box2dChainSettings(BeadChainSettings):
    """Numerical settings of the bead chain, in SI units. The directions of the contacts stay as they are for a step."""

    sub_steps: int
    """Number of sub-steps of the solver in a step, in each of which every joint and contact is solved twice."""
    contact_hertz: float = 1e6
    """Frequency of the contacts [Hz]; Box2D takes a quarter of the sub-steps' frequency if that is lower."""
    contact_damping_ratio: float = 10.0
    """Damping ratio of the contacts."""
    push_speed: float = 3.0
    """Largest speed at which a contact drives out a bead that is too deep in the rod [m/s]."""
    length_unit: float = 1e-2
    """Length of Box2D's metre [m]. Its contacts are found within 0.02 of it, and no joint is shorter than 0.005 of it."""
    time_unit: float = 1e-4
    """Length of Box2D's second [s], in which joints have a frequency of 60, or an eighth of the sub-steps' if that is less.

    pyb2d3 cannot set it, so a short second makes the joints stiff.
    """
    sleeping: bool = False
    """Whether bodies that move slowly for a while fall asleep, until something wakes them."""
    continuous: bool = False
    """Whether a bead that would pass into the rod within a step is stopped at its surface for that step."""


SETTINGS = {
    Profile.QUICK: Box2dChainSettings(time_step=1e-5, sub_steps=4, bend=0.28, bead_mass_ratio=2e-4),
    Profile.ACCURATE: Box2dChainSettings(time_step=4e-6, sub_steps=4, bend=0.2, bead_mass_ratio=1e-4),
}


MIN_LENGTH = 1e-2
"""Shortest length to which a straight part may go slack, in Box2D's metres; Box2D allows none below its slop, 0.005."""
BEADS = -1
"""Collision group of the beads: shapes of the same negative group never touch."""


class Box2dRig(JointRig):
    """The apparatus in Box2D, in which only beads and the rod touch each other.

    Box2D's lengths are SI over `Box2dChainSettings.length_unit`, its times over `time_unit`, its masses are kilograms.
    """

    def _create_world(self) -> None:
        import pyb2d3

        s = self._settings
        self._box2d = pyb2d3
        self._length_unit, time_unit = s.length_unit, s.time_unit
        self._speed_unit = self._length_unit / time_unit
        self._force_unit = self._length_unit / time_unit**2  # for a mass of 1 kg
        self._time_step = s.time_step / time_unit
        self._world = pyb2d3.World(gravity=(0.0, -self._parameters.coefficients["gravity"] / self._force_unit))
        self._world.sleeping_enabled = s.sleeping
        self._world.continuous_enabled = s.continuous
        self._world.set_contact_tuning(s.contact_hertz * time_unit, s.contact_damping_ratio, s.push_speed / self._speed_unit)

    def _add_rod(self, radius: float, friction: float) -> None:
        self._friction = friction
        self._add_circle(self._world.create_static_body(position=(0.0, 0.0)), radius)

    def _create_bead(self, position: Vector, velocity: Vector, mass: float) -> Any:
        bead = self._create_mass(position, velocity, mass)
        self._add_circle(bead, self._settings.bead_radius, group_index=BEADS)
        # A shape adds its own mass to its body
        self._set_mass(bead, mass)
        return bead

    def _create_mass(self, position: Vector, velocity: Vector, mass: float) -> Any:
        body = self._world.create_dynamic_body(
            position=self._scaled(position, self._length_unit),
            linear_velocity=self._scaled(velocity, self._speed_unit),
            fixed_rotation=True,
        )
        self._set_mass(body, mass)
        return body

    def _create_held(self, position: Vector) -> Any:
        return self._world.create_static_body(position=self._scaled(position, self._length_unit))

    def _create_link(self, a: Any, b: Any, length: float) -> Any:
        return self._world.create_distance_joint(a, b, length=length / self._length_unit)

    def _create_straight(self, a: Any, b: Any, length: float) -> Any:
        longest = length / self._length_unit
        # Box2D sees to limits only where a spring is enabled; one of 0 Hz exerts no force
        return self._world.create_distance_joint(
            a, b, length=longest, enable_spring=True, hertz=0.0, enable_limit=True, min_length=MIN_LENGTH, max_length=longest
        )

    def _remove_joint(self, joint: Any) -> None:
        joint.destroy()

    def _remove_body(self, bead: Any) -> None:
        bead.destroy()

    def _take_steps(self, count: int, forces: Sequence[tuple[Any, Vector]]) -> None:
        scaled = [(body, (fx / self._force_unit, fy / self._force_unit)) for body, (fx, fy) in forces]
        for _ in range(count):
            # Box2D forgets a force after a step
            for body, force in scaled:
                body.apply_force_to_center(force)
            self._world.step(self._time_step, self._settings.sub_steps)

    def _position_of(self, body: Any) -> Vector:
        x, y = body.position
        return x * self._length_unit, y * self._length_unit

    def _velocity_of(self, body: Any) -> Vector:
        vx, vy = body.linear_velocity
        return vx * self._speed_unit, vy * self._speed_unit

    def _add_circle(self, body: Any, radius: float, **collision: int) -> None:
        shape = self._box2d.shape_def(
            # Box2D takes the geometric mean of two coefficients, which for equal ones is their own
            material=self._box2d.surface_material(friction=self._friction, restitution=0.0),
            filter=self._box2d.make_filter(**collision),
        )
        body.create_shape(shape, self._box2d.circle(radius=radius / self._length_unit))

    def _set_mass(self, body: Any, mass: float) -> None:
        data = self._box2d.MassData()
        data.mass, data.center, data.rotational_inertia = mass, (0.0, 0.0), 0.0
        body.mass_data = data

    @staticmethod
    def _scaled(vector: Vector, unit: float) -> Vector:
        return vector[0] / unit, vector[1] / unit


_LIMITS = (
    ONE_COEFFICIENT,
    "Box2D computes in single precision: each sub-step rounds velocities, so that more and shorter ones than those of the "
    "accurate profile make the path worse",
    "pyb2d3 gives no access to Box2D's stiffness of joints, 60 Hz; the adapter makes them stiff by time units of 0.1 ms",
    STRAIGHT_STRING,
    NO_STOP,
)


class Box2dChain(SteppedEngine):
    """A chain of beads over a static circle."""

    name = "box2d"
    distribution = "pyb2d3"
    variant = "chain"
    rig = Box2dRig
    settings_by_profile = SETTINGS
    settings: Box2dChainSettings
    abilities = bead_abilities(
        "box2d:chain",
        rod="static circle",
        stick_slip="the solver clamps friction to its cone",
        packages=("pyb2d3",),
        summary="Point beads on distance joints over a static circle, one joint for each straight part of the string.",
        limits=_LIMITS,
        bead_mass_ratio=SETTINGS[Profile.QUICK].bead_mass_ratio,
        main=False,
    )

    def studies(self) -> Studies:
        """Return ladders of step, sub-steps, links and mass, Box2D's defaults, and the adapter's choices."""
        s = self.settings
        sub_step = s.time_step / s.sub_steps
        steps = [{"time_step": dt, "sub_steps": max(round(dt / sub_step), 1)} for dt in (4e-5, 2e-5, 1e-5, 5e-6)]
        return Studies(
            ladders=(
                Ladder("time_step", "s", steps, "the number of sub-steps, so that their length stays"),
                Ladder("sub_steps", "", (2, 4, 8, 16)),
                bend_rungs(s, (0.4, 0.28, 0.2, 0.14)),
                Ladder("bead_mass_ratio", "", (8e-4, 4e-4, 2e-4, 1e-4)),
            ),
            defaults=(
                Variation(
                    "timeStep",
                    quantity(s.time_step, "s", 3),
                    "none; 1 ms is finer than the 1/60 s of its guides",
                    {"time_step": SAMPLE_INTERVAL, "steps_per_group": 1},
                    "length of a step, during which a contact keeps its direction",
                ),
                Variation(
                    "jointHertz",
                    f"{60e-3 / s.time_unit:g} kHz, by units of {quantity(s.time_unit, 's', 3)}; "
                    "an eighth of the sub-steps' if less",
                    "60 Hz",
                    {"time_unit": 1.0},
                    "how stiff joints are; pyb2d3 gives no access to it",
                ),
                default_row(
                    s,
                    "contact_hertz",
                    30.0,
                    "contactHertz",
                    "how stiff contacts are; Box2D takes a quarter of the sub-steps' frequency if that is lower",
                    "Hz",
                ),
                default_row(
                    s, "length_unit", 1.0, "lengthUnitsPerMeter", "the length of which the shortest joint is 0.005", "m"
                ),
                default_row(s, "sleeping", True, "enableSleep", "bodies slower than 0.05 units stop after half a time unit"),
                default_row(
                    s,
                    "continuous",
                    True,
                    "enableContinuous",
                    "beads that would pass into the rod within a step are stopped at its surface",
                ),
            ),
            choices=(
                Variation("bead mass", f"{s.bead_mass_ratio:g} M1", "half", {"bead_mass_ratio": s.bead_mass_ratio / 2}),
                Variation("length unit", quantity(s.length_unit, "m", 3), "1 mm", {"length_unit": 1e-3}),
                *bead_choices(s),
                Variation("contact damping ratio", f"{s.contact_damping_ratio:g}", "1", {"contact_damping_ratio": 1.0}),
            ),
        )


def engines(profile: Profile) -> list[Engine]:
    """Return every variant of this engine with the settings of ``profile``."""
    return [Box2dChain(profile=profile)]
