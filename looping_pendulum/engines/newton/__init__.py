"""NVIDIA's Newton: a tendon over a fixed roller with a capstan law of its own; no law is fed in.

Offered through the entry point that a third party uses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from looping_pendulum.engines.chain import NO_STOP, ONE_COEFFICIENT, point_on_string
from looping_pendulum.engines.protocol import Engine, Profile, StepGroups, SteppedEngine
from looping_pendulum.engines.shipped import shipped_abilities
from looping_pendulum.engines.studies import Ladder, Studies, Variation, default_row
from looping_pendulum.errors import EngineError
from looping_pendulum.pages.numbers import quantity
from looping_pendulum.reference_ode.cartesian import Vector, cartesian_force, masses_at_release
from looping_pendulum.reference_ode.geometry import Array, string_coordinates
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.runs.trajectory import SAMPLE_INTERVAL
from looping_pendulum.versions import installed_version


@dataclass(frozen=True, kw_only=True)
class NewtonTendonSettings(StepGroups):
    """Numerical settings of Newton's tendon, in SI units."""

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


INERTIA_RADIUS = 1e-3
"""Radius of gyration of a mass [m]. No torque acts on one, so it changes nothing, but Newton replaces an inertia of zero."""
CLOCKWISE = -1
"""Newton's sign for the side on which the string passes the rod, from the light mass to the heavy one."""
DEVICE = "cpu"


MAX_WRAP_ANGLE = math.pi + math.radians(1)
"""Wrap angle beyond which a string that slides with friction ends the run [rad].

Newton takes half a turn as the largest angle and measures a larger one from the other side: 1 degree more counts as 1 degree
less, so that a string that hangs down on both sides, within rounding errors of half a turn, is right.
"""


class NewtonTendonRig:
    """The apparatus in Newton."""

    def __init__(self, parameters: Parameters, settings: NewtonTendonSettings) -> None:
        import warp

        # Compiled once for each version of Newton, in half a minute; with the gradients that nobody asks for here, in minutes
        warp.config.enable_backward = False
        import newton

        p = self._parameters = parameters
        self._warp, self._newton = warp, newton
        self._settings, self._unit = settings, settings.length_unit
        self._builder: Any = newton.ModelBuilder(
            up_axis=newton.Axis.Y, gravity=(0.0, -p.coefficients["gravity"] / self._unit, 0.0)
        )
        self._force = cartesian_force(p)
        self._groups = 0
        self._has_string, self._is_held = p.release is not Release.DROP, p.release is Release.HELD
        self._heavy_position = point_on_string(p, p.string_length, p.rod_radius)
        masses = masses_at_release(p)
        velocities = [masses.light_velocity]
        self._add_mass(masses.light_position, p.light_mass)
        if not self._is_held:
            velocities.append(masses.heavy_velocity)
            self._add_mass(self._heavy_position, p.heavy_mass)
        if self._has_string:
            self._add_string()
        self._wrap_angle = p.release_angle
        self._start(velocities)

    def advance(self) -> None:
        """Advance by one sample interval.

        Raises
        ------
        EngineError
            If the string slides with friction and is wound by more than half a turn.
        """
        for _ in range(self._settings.groups_per_sample):
            self._apply_effect_forces()
            self._warp.capture_launch(self._graph)
            self._groups += 1
        # String that is held cannot slide, and one without friction does not ask for the angle
        if self._has_string and not self._is_held and self._parameters.coefficients["kinetic_friction"] > 0:
            _, angles = string_coordinates(self._positions()[:1], self._parameters.rod_radius, self._wrap_angle)
            self._wrap_angle = float(angles[0])
            if self._wrap_angle > MAX_WRAP_ANGLE:
                time = round(self._groups * self._settings.group_time / SAMPLE_INTERVAL) * SAMPLE_INTERVAL
                raise EngineError(
                    f"newton:tendon: found a wrap of {math.degrees(self._wrap_angle):.1f} deg at {time:.3f} s, needed at most "
                    "180: beyond half a turn Newton's roller has the friction of the angle that is left to a full turn"
                )

    def read(self) -> tuple[float, ...]:
        """Return positions [m], velocities [m/s], string stretch and slip [m]: `COLUMNS` without the time."""
        positions, velocities = self._positions().tolist(), self._velocities().tolist()
        if self._is_held:
            positions.append(list(self._heavy_position))
            velocities.append([0.0, 0.0])
        string: Vector = (math.nan, math.nan)
        if self._has_string:
            rest = self._in_metres(self._solver.tendon_segment_rest_length)
            lengths = self._in_metres(self._solver.tendon_segment_length)
            string = float(lengths.sum() - rest.sum()), float(rest[1])
        return (*positions[0], *velocities[0], *positions[1], *velocities[1], *string)

    def _add_mass(self, position: Vector, mass: float) -> None:
        """Add a point mass [m, kg]."""
        wp = self._warp
        inertia = mass * (INERTIA_RADIUS / self._unit) ** 2
        self._builder.add_body(
            xform=wp.transform(p=wp.vec3(*self._in_units(position))),
            mass=mass,
            inertia=wp.mat33(inertia, 0.0, 0.0, 0.0, inertia, 0.0, 0.0, 0.0, inertia),
            lock_inertia=True,
        )

    def _add_string(self) -> None:
        """Add the string from the light mass, body 0, over the rod to the heavy mass, body 1, or to where that is held."""
        guide, kind = self._newton.TendonGuide, self._newton.TendonGuideType
        # Both are the same in every unit of length
        span = {"compliance": self._settings.compliance, "damping": self._settings.damping}
        p = self._parameters
        friction = p.coefficients["kinetic_friction"]
        rod = {"radius": p.rod_radius / self._unit, "orientation": CLOCKWISE, "mu": friction}
        end = {"body": -1, "offset": self._in_units(self._heavy_position)} if self._is_held else {"body": 1}
        self._builder.add_tendon(
            [
                guide(body=0, guide_type=kind.ANCHOR),
                guide(body=-1, guide_type=kind.ROLLER, **rod, **span),
                guide(guide_type=kind.ANCHOR, **end, **span),
            ]
        )

    def _start(self, velocities: list[Vector]) -> None:
        """End the building: make the solver, give the masses their ``velocities`` [m/s], and record a group of steps."""
        s = self._settings
        self._model = self._builder.finalize(device=DEVICE)
        self._solver = self._newton.solvers.SolverXPBD(
            self._model, iterations=s.iterations, joint_linear_relaxation=s.relaxation, tendon_settle_tol=s.settle_tolerance
        )
        self._states = first, second = self._model.state(), self._model.state()
        scaled = np.zeros((len(velocities), 6))
        scaled[:, :2] = np.array(velocities) / self._unit
        first.body_qd.assign(scaled)
        self._forces = np.zeros_like(scaled)
        with self._warp.ScopedCapture(device=DEVICE) as capture:
            control = self._model.control(clone_variables=False)
            for _ in range(s.steps_per_group // 2):
                self._solver.step(first, second, control, None, s.time_step)
                self._solver.step(second, first, control, None, s.time_step)
        self._graph = capture.graph

    def _apply_effect_forces(self) -> None:
        """Set the effects' forces on the masses that can move, for a group of steps."""
        if self._force is None:
            return
        (x, y), (vx, vy) = self._positions()[0], self._velocities()[0]
        heavy_vy = 0.0 if self._is_held else float(self._velocities()[1, 1])
        time = self._groups * self._settings.group_time
        fx, fy, heavy_fy = self._force(time, float(x), float(y), float(vx), float(vy), heavy_vy)
        self._forces[:, :2] = np.array([(fx, fy), (0.0, heavy_fy)][: len(self._forces)]) / self._unit
        for state in self._states:
            state.body_f.assign(self._forces)

    def _positions(self) -> Array:
        """Return the positions of the masses that can move [m], shape (n, 2)."""
        return np.asarray(self._states[0].body_q.numpy()[:, :2] * float(self._unit), dtype=float)

    def _velocities(self) -> Array:
        """Return their velocities [m/s], shape (n, 2)."""
        return np.asarray(self._states[0].body_qd.numpy()[:, :2] * float(self._unit), dtype=float)

    def _in_metres(self, values: Any) -> Array:
        """Return lengths of the straight parts, light side first [m]."""
        return np.asarray(values.numpy(), dtype=float) * self._unit

    def _in_units(self, position: Vector) -> tuple[float, float, float]:
        return position[0] / self._unit, position[1] / self._unit, 0.0


_LIMITS = (
    "a string that slides with friction may be wound by half a turn only: beyond it Newton goes on with the friction of the "
    "angle that is left to a full turn, and the adapter ends the run",
    ONE_COEFFICIENT,
    "the friction reads the tensions from the string's stretch: a string that cannot stretch does not slide from rest at all",
    "Newton computes in single precision",
    NO_STOP,
)


class NewtonTendon(SteppedEngine):
    """A tendon over a fixed roller."""

    name = "newton"
    distribution = "newton"
    variant = "tendon"
    settings_by_profile = SETTINGS
    rig = NewtonTendonRig
    settings: NewtonTendonSettings
    abilities = shipped_abilities(
        "newton:tendon",
        winding="tangents to a fixed roller; string that winds on is taken from the straight parts",
        friction_law="the capstan law of the roller, up to half a turn",
        stick_slip="the same: string passes only where the tensions differ by more than the law's ratio",
        summary="A massless tendon over a fixed roller with the capstan law, in Newton's position-based solver on the CPU.",
        limits=_LIMITS,
        main=False,
    )

    def studies(self) -> Studies:
        """Return ladders of step and compliance, Newton's defaults, and the adapter's choices."""
        s = self.settings
        return Studies(
            ladders=(
                Ladder("time_step", "s", (1e-4, 5e-5, 2e-5, 1e-5, 4e-6)),
                Ladder("compliance", "m/N", (1e-3, 1e-4, 5e-5, 1e-5, 1e-6)),
            ),
            defaults=(
                default_row(s, "compliance", 0.0, "compliance", "the stretch from which friction reads the tensions", "m/N"),
                default_row(s, "length_unit", 1.0, "length unit", "a mass slower than 1e-4 units per second is stopped", "m"),
                default_row(s, "iterations", 2, "iterations", "corrections of the string's length per step"),
                default_row(
                    s,
                    "relaxation",
                    0.7,
                    "joint_linear_relaxation",
                    "share of a correction that is made, of the string's length, too",
                ),
            ),
            choices=(
                Variation("damping", quantity(s.damping, "N s/m", 3), "none", {"damping": 0.0}),
                Variation("length unit", quantity(s.length_unit, "m", 3), "1 cm", {"length_unit": 1e-2}),
                Variation("tolerance of the friction", f"{s.settle_tolerance:g}", "1e-05", {"settle_tolerance": 1e-5}),
                Variation("steps between two updates of drag", f"{s.steps_per_group}", "2", {"steps_per_group": 2}),
            ),
        )

    def versions(self) -> dict[str, str]:
        """Return the versions of Newton, and of Warp, which compiles it."""
        return {name: installed_version(name) for name in ("newton", "warp-lang")}


def engines(profile: Profile) -> list[Engine]:
    """Return every variant of this engine with the settings of ``profile``."""
    return [NewtonTendon(profile=profile)]
