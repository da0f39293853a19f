"""NVIDIA's Newton: a tendon over a fixed roller with a capstan law of its own; no law is fed in.

Offered through the entry point that a third party uses.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from looping_pendulum.engines.chain import NO_STOP, ONE_COEFFICIENT, point_on_string
from looping_pendulum.engines.protocol import SAMPLE_INTERVAL, Engine, Profile, StepGroups, TunedEngine
from looping_pendulum.engines.shipped import shipped_abilities
from looping_pendulum.engines.studies import Studies, studies_from_rows
from looping_pendulum.errors import EngineError
from looping_pendulum.pages.numbers import quantity
from looping_pendulum.reference_ode.cartesian import cartesian_force, release_velocity
from looping_pendulum.reference_ode.geometry import Array, string_coordinates
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.versions import installed_version


@dataclass(frozen=True, kw_only=True)
class NewtonTendonSettings(StepGroups):
    """Numerical settings of Newton's tendon, in SI units."""

    time_step: float
    """Length of a step [s]; it must divide the sample interval."""
    compliance: float
    """Stretch of each straight part of the string per tension [m/N].

    Newton's friction reads the tensions from the stretch, in single precision: without one, a string at rest does not slide.
    Its error grows with the time step over the compliance.
    """
    damping: float
    """Tension per rate of stretch of each straight part [N s/m], which damps the string's own oscillations."""
    iterations: int = 1
    """Iterations of the solver per step."""
    relaxation: float = 1.0
    """Share of each correction that an iteration makes."""
    settle_tolerance: float = 1e-3
    """Relative change of the tensions at which the friction of an iteration counts as converged."""
    length_unit: float = 1e-3
    """Length of Newton's unit [m]. The solver stops masses that are slower than 1e-4 units per second."""
    steps_per_group: int = 10
    """Steps between two updates of the effects' forces; Newton replays such a group as one recorded graph."""

    def __post_init__(self) -> None:
        """Raise EngineError where groups do not divide the sample interval, or do not end in the state they began in."""
        super().__post_init__()
        if self.steps_per_group % 2:
            raise EngineError(
                f"steps_per_group: found {self.steps_per_group}, needed an even number, as two states take turns; write 2"
            )


SETTINGS = {
    Profile.QUICK: NewtonTendonSettings(time_step=1e-5, compliance=1e-4, damping=2.0),
    Profile.ACCURATE: NewtonTendonSettings(time_step=4e-6, compliance=5e-5, damping=3.0),
}
"""Profile -> settings."""


Vector = tuple[float, float]
"""Components x and y, SI."""

INERTIA_RADIUS = 1e-3
"""Radius of gyration of a mass [m]. No torque acts on one, so it changes nothing, but Newton replaces an inertia of zero."""
CLOCKWISE = -1
"""Newton's sign for the side on which the string passes the rod, from the light mass to the heavy one."""
DEVICE = "cpu"


class NewtonWorld:
    """A world of Newton: first masses and a string are added, then `start` is called, then `advance`.

    Parameters
    ----------
    gravity
        Downward acceleration [m/s^2].
    settings
        Numerical settings.
    """

    def __init__(self, gravity: float, settings: NewtonTendonSettings) -> None:
        import warp

        # Compiled once for each version of Newton, in half a minute; with the gradients that nobody asks for here, in minutes
        warp.config.enable_backward = False
        import newton

        self._warp, self._newton = warp, newton
        self._settings, self._unit = settings, settings.length_unit
        self._builder: Any = newton.ModelBuilder(up_axis=newton.Axis.Y, gravity=(0.0, -gravity / self._unit, 0.0))
        self._velocities: list[Vector] = []
        self._has_string = False

    def add_mass(self, position: Vector, velocity: Vector, mass: float) -> int:
        """Add a point mass [m, m/s, kg] and return its index."""
        wp = self._warp
        inertia = mass * (INERTIA_RADIUS / self._unit) ** 2
        body: int = self._builder.add_body(
            xform=wp.transform(p=wp.vec3(*self._place(position))),
            mass=mass,
            inertia=wp.mat33(inertia, 0.0, 0.0, 0.0, inertia, 0.0, 0.0, 0.0, inertia),
            lock_inertia=True,
        )
        self._velocities.append(velocity)
        return body

    def add_string(self, light: int, heavy: int | Vector, rod_radius: float, friction: float) -> None:
        """Add the string from the mass ``light`` over the rod to the mass ``heavy``, or to a fixed point [m]."""
        guide, kind = self._newton.TendonGuide, self._newton.TendonGuideType
        # Both are the same in every unit of length
        span = {"compliance": self._settings.compliance, "damping": self._settings.damping}
        rod = {"radius": rod_radius / self._unit, "orientation": CLOCKWISE, "mu": friction}
        end = {"body": heavy} if isinstance(heavy, int) else {"body": -1, "offset": self._place(heavy)}
        self._builder.add_tendon(
            [
                guide(body=light, guide_type=kind.ANCHOR),
                guide(body=-1, guide_type=kind.ROLLER, **rod, **span),
                guide(guide_type=kind.ANCHOR, **end, **span),
            ]
        )
        self._has_string = True

    def start(self) -> None:
        """End the building: make the solver, and record a group of steps as a graph."""
        s, wp = self._settings, self._warp
        self._model = self._builder.finalize(device=DEVICE)
        self._solver = self._newton.solvers.SolverXPBD(
            self._model,
            iterations=s.iterations,
            joint_linear_relaxation=s.relaxation,
            tendon_settle_tol=s.settle_tolerance,
        )
        self._states = self._model.state(), self._model.state()
        velocities = np.zeros((len(self._velocities), 6))
        velocities[:, :2] = np.array(self._velocities) / self._unit
        self._states[0].body_qd.assign(velocities)
        self._forces = np.zeros_like(velocities)
        self._rest_lengths_at_release = self._rest_lengths()
        with wp.ScopedCapture(device=DEVICE) as capture:
            self._step_group()
        self._graph = capture.graph

    def advance(self, forces: Sequence[Vector]) -> None:
        """Advance by a group of steps, with these forces [N] on the masses."""
        if forces:
            self._forces[:, :2] = np.array(forces) / self._unit
            for state in self._states:
                state.body_f.assign(self._forces)
        self._warp.capture_launch(self._graph)

    def positions(self) -> Array:
        """Return the masses' positions [m], shape (n, 2)."""
        return np.asarray(self._states[0].body_q.numpy()[:, :2] * float(self._unit), dtype=float)

    def velocities(self) -> Array:
        """Return the masses' velocities [m/s], shape (n, 2)."""
        return np.asarray(self._states[0].body_qd.numpy()[:, :2] * float(self._unit), dtype=float)

    def stretch_and_slip(self) -> Vector:
        """Return by how much the string is longer than at rest, and how far it has slid to the heavy side [m]."""
        rest = self._rest_lengths()
        stretch = self._lengths().sum() - rest.sum()
        return float(stretch), float(rest[1] - self._rest_lengths_at_release[1])

    def _step_group(self) -> None:
        control = self._model.control(clone_variables=False)
        first, second = self._states
        for _ in range(self._settings.steps_per_group // 2):
            self._solver.step(first, second, control, None, self._settings.time_step)
            self._solver.step(second, first, control, None, self._settings.time_step)

    def _rest_lengths(self) -> Array:
        """Return the rest lengths of the straight parts, light side first [m]."""
        return self._read(self._solver.tendon_segment_rest_length)

    def _lengths(self) -> Array:
        return self._read(self._solver.tendon_segment_length)

    def _read(self, values: Any) -> Array:
        return np.asarray(values.numpy(), dtype=float) * self._unit if self._has_string else np.zeros(0)

    def _place(self, position: Vector) -> tuple[float, float, float]:
        return position[0] / self._unit, position[1] / self._unit, 0.0


MAX_WRAP_ANGLE = math.pi + math.radians(1)
"""Wrap angle beyond which a string that slides with friction ends the run [rad].

Newton takes half a turn as the largest angle and measures a larger one from the other side: 1 degree more counts as 1 degree
less, so that a string that hangs down on both sides, within rounding errors of half a turn, is right.
"""


class NewtonTendonRig:
    """The apparatus in one world of Newton."""

    def __init__(self, parameters: Parameters, settings: NewtonTendonSettings) -> None:
        p = self._parameters = parameters
        self._settings = settings
        friction = p.coefficients["kinetic_friction"]
        self._world = NewtonWorld(p.coefficients["gravity"], settings)
        self._force = cartesian_force(p)
        self._groups = 0
        self._held_at: Vector | None = None
        vx, vy, heavy_vy = release_velocity(p)
        light = self._world.add_mass(point_on_string(p, 0.0, p.rod_radius), (vx, vy), p.light_mass)
        heavy_position = point_on_string(p, p.string_length, p.rod_radius)
        heavy: int | Vector
        if p.release is Release.HELD:
            heavy = self._held_at = heavy_position
        else:
            heavy = self._world.add_mass(heavy_position, (0.0, heavy_vy), p.heavy_mass)
        self._has_string = p.release is not Release.DROP
        if self._has_string:
            self._world.add_string(light, heavy, p.rod_radius, friction)
        # String that is held cannot slide, and one without friction does not ask for the angle
        self._wrap_is_limited = self._has_string and self._held_at is None and friction > 0
        self._wrap_angle = p.release_angle
        self._world.start()

    def advance(self) -> None:
        """Advance by one sample interval.

        Raises
        ------
        EngineError
            If the string slides with friction and is wound by more than half a turn.
        """
        for _ in range(self._settings.groups_per_sample):
            self._world.advance(self._effect_forces())
            self._groups += 1
        if self._wrap_is_limited:
            self._check_wrap()

    def read(self) -> tuple[float, ...]:
        """Return positions [m], velocities [m/s], string stretch and slip [m]: `COLUMNS` without the time."""
        positions, velocities = self._world.positions().tolist(), self._world.velocities().tolist()
        if self._held_at is not None:
            positions.append(list(self._held_at))
            velocities.append([0.0, 0.0])
        string = self._world.stretch_and_slip() if self._has_string else (math.nan, math.nan)
        return (*positions[0], *velocities[0], *positions[1], *velocities[1], *string)

    def _effect_forces(self) -> list[Vector]:
        """Return the effects' forces [N] on the masses that can move; none without effects."""
        if self._force is None:
            return []
        (x, y), (vx, vy), heavy_vy = self._world.positions()[0], self._world.velocities()[0], 0.0
        if self._held_at is None:
            heavy_vy = float(self._world.velocities()[1, 1])
        time = self._groups * self._settings.group_time
        fx, fy, heavy_fy = self._force(time, float(x), float(y), float(vx), float(vy), heavy_vy)
        return [(fx, fy)] if self._held_at is not None else [(fx, fy), (0.0, heavy_fy)]

    def _check_wrap(self) -> None:
        _, angles = string_coordinates(self._world.positions()[:1], self._parameters.rod_radius, self._wrap_angle)
        self._wrap_angle = float(angles[0])
        if self._wrap_angle > MAX_WRAP_ANGLE:
            time = round(self._groups * self._settings.group_time / SAMPLE_INTERVAL) * SAMPLE_INTERVAL
            raise EngineError(
                f"newton:tendon: found a wrap of {math.degrees(self._wrap_angle):.1f} deg at {time:.3f} s, needed at most 180: "
                "beyond half a turn Newton's roller has the friction of the angle that is left to a full turn"
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
    settings_by_profile = SETTINGS
    settings: NewtonTendonSettings
    abilities = shipped_abilities(
        "newton:tendon",
        quick_cost=3.0,
        winding="tangents to a fixed roller; string that winds on is taken from the straight parts",
        friction_law="the capstan law of the roller, up to half a turn",
        stick_slip="the same: string passes only where the tensions differ by more than the law's ratio",
        summary="A massless tendon over a fixed roller with the capstan law, in Newton's position-based solver on the CPU.",
        limits=_LIMITS,
        known_failures={"samples_every_millisecond_from_rest": "places are in single precision: measured 12 nm off at release"}
        | dict.fromkeys(
            (
                "free_length_and_wrap_angle_are_those_of_the_position",
                "runs_to_its_end",
                "release_against_friction_has_the_exact_acceleration",
                "energy_never_grows_with_losses",
                "follows_the_reference_past_the_halt_and_a_full_turn",
            ),
            _WOUND_TOO_FAR,
        ),
        main=False,
    )

    def build(self, scenario: Scenario) -> NewtonTendonRig:
        """Build the scenario's apparatus at the moment of release."""
        return NewtonTendonRig(scenario.parameters, self.settings)

    def studies(self) -> Studies:
        """Return ladders of step and compliance, Newton's defaults, and the adapter's choices."""
        s = self.settings
        return studies_from_rows(
            self,
            ladders=(
                ("time_step", "s", (1e-4, 5e-5, 2e-5, 1e-5, 4e-6)),
                ("compliance", "m/N", (1e-3, 1e-4, 5e-5, 1e-5, 1e-6)),
            ),
            defaults=(
                (
                    "compliance",
                    "0: the string cannot stretch",
                    quantity(s.compliance, "m/N", 3),
                    "the stretch from which the friction reads the tensions",
                    {"compliance": 0.0},
                ),
                (
                    "length unit",
                    "none; metres are usual",
                    quantity(s.length_unit, "m", 3),
                    "a mass that is slower than 1e-4 units per second is stopped, at every step",
                    {"length_unit": 1.0},
                ),
                ("iterations", "2", f"{s.iterations}", "corrections of the string's length per step", {"iterations": 2}),
                (
                    "joint_linear_relaxation",
                    "0.7",
                    f"{s.relaxation:g}",
                    "share of a correction that is made, of the string's length, too",
                    {"relaxation": 0.7},
                ),
            ),
            choices=(
                ("damping", quantity(s.damping, "N s/m", 3), "none", {"damping": 0.0}),
                ("length unit", quantity(s.length_unit, "m", 3), "1 cm", {"length_unit": 1e-2}),
                ("tolerance of the friction", f"{s.settle_tolerance:g}", "1e-05", {"settle_tolerance": 1e-5}),
                ("steps between two updates of drag", f"{s.steps_per_group}", "2", {"steps_per_group": 2}),
            ),
        )

    def versions(self) -> dict[str, str]:
        """Return the versions of Newton, and of Warp, which compiles it."""
        return {name: installed_version(name) for name in ("newton", "warp-lang")}


def engines(profile: Profile) -> list[Engine]:
    """Return every variant of this engine with the settings of ``profile``."""
    return [NewtonTendon(profile=profile)]
