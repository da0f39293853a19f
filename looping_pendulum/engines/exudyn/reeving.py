"""Exudyn's reeving system: one rope without mass or friction, tangent to the rod."""

from __future__ import annotations

import math

from looping_pendulum.engines.chain import NO_STOP
from looping_pendulum.engines.exudyn.settings import REEVING_SETTINGS, ReevingSettings
from looping_pendulum.engines.exudyn.studies import reeving_studies
from looping_pendulum.engines.exudyn.system import ExudynSystem
from looping_pendulum.engines.protocol import APPLIED_DRAG, FORCES_AND_RELEASE, Abilities, TunedEngine
from looping_pendulum.engines.studies import Studies
from looping_pendulum.engines.trajectory import Supplier, Supplies, Supply
from looping_pendulum.engines.validated import shipped_range
from looping_pendulum.reference_ode.geometry import next_string_coordinates
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.scenarios.scenario import Scenario

_LIMITS = (
    "without friction the heavy mass never halts",
    "a slack rope pushes a little: Exudyn bounds its push, but its solver needs some",
    NO_STOP,
)
AXIS = (0.0, 0.0, -1.0)
"""The sheave's axis: its sign says on which side of the rod the rope passes."""


class ExudynReevingRig:
    """The apparatus with a reeving system over one sheave."""

    def __init__(self, parameters: Parameters, settings: ReevingSettings, end_length: float) -> None:
        p, s = parameters, settings
        self._parameters, self._settings = p, s
        self._has_string = p.release is not Release.DROP
        self._system = system = ExudynSystem(p, s, light_mass=p.light_mass, end_length=end_length)
        self._wrap_angle, self._turns = p.release_angle, 0
        if self._has_string:
            self._rope = system.mbs.AddObject(
                system.items.ObjectConnectorReevingSystemSprings(
                    markerNumbers=[system.light.marker, system.rod_marker, system.heavy_marker],
                    stiffnessPerLength=s.axial_stiffness,
                    dampingPerLength=s.axial_damping,
                    referenceLength=p.string_length,
                    regularizationForce=s.push_force,
                    sheavesAxes=system.exudyn.Vector3DList([list(AXIS)] * 3),
                    sheavesRadii=[0.0, p.rod_radius, 0.0],
                )
            )
        self._system.start(self._count_turns if self._has_string else None)

    def advance(self) -> None:
        """Advance by one sample interval."""
        self._system.advance()

    def read(self) -> tuple[float, ...]:
        """Return positions [m], velocities [m/s], string stretch and slip [m]: `COLUMNS` without the time."""
        masses = self._system.read_masses()
        if not self._has_string:
            return (*masses, math.nan, math.nan)
        p = self._parameters
        stretch = self._string_length(masses) - p.string_length
        return (*masses, stretch, -masses[5] - p.hanging_length)

    def _string_length(self, masses: tuple[float, ...]) -> float:
        """Return the length of the shortest way from mass to mass over the rod, as often around it as the string is [m]."""
        radius = self._parameters.rod_radius
        free_length, self._wrap_angle = next_string_coordinates(masses[0], masses[1], radius, self._wrap_angle)
        return free_length + radius * self._wrap_angle - masses[5]

    def _count_turns(self, masses: tuple[float, ...]) -> None:
        """Shorten the rope by the turns that lie on the rod when the coming step ends; Exudyn forgets whole turns."""
        p, (x, y, vx, vy) = self._parameters, masses[:4]
        _, self._wrap_angle = next_string_coordinates(x, y, p.rod_radius, self._wrap_angle)
        step = self._settings.time_step
        _, angle = next_string_coordinates(x + step * vx, y + step * vy, p.rod_radius, self._wrap_angle)
        turns = math.floor(angle / (2 * math.pi))
        if turns != self._turns:
            self._turns = turns
            length = p.string_length - 2 * math.pi * p.rod_radius * turns
            self._system.mbs.SetObjectParameter(self._rope, "referenceLength", length)


class ExudynReeving(TunedEngine):
    """A reeving system over one sheave."""

    name = "exudyn"
    distribution = "exudyn"
    variant = "reeving"
    abilities = Abilities(
        quick_cost=1.0,
        releases=frozenset(Release),
        effect_kinds=FORCES_AND_RELEASE,
        supplies=Supplies(
            winding=Supply(
                by=Supplier.ENGINE, how="a rope tangent to a sheave; the adapter counts turns, by the rope's length"
            ),
            friction_law=Supply(by=Supplier.NOBODY, how="a reeving system's tension is the same on both sides of a sheave"),
            stick_slip=Supply(by=Supplier.NOBODY, how="nothing to stick to"),
            drag=APPLIED_DRAG,
        ),
        packages=("exudyn",),
        summary="One elastic rope without mass and without friction, over a sheave.",
        limits=_LIMITS,
        additions=("the rope is a turn shorter or longer in the step in which the wrap angle passes a whole turn",),
        validated=shipped_range("exudyn:reeving"),
        main=False,
    )
    settings_by_profile = REEVING_SETTINGS
    settings: ReevingSettings

    def build(self, scenario: Scenario) -> ExudynReevingRig:
        """Build the scenario's apparatus at the moment of release."""
        return ExudynReevingRig(scenario.parameters, self.settings, self.end_length(scenario))

    def studies(self) -> Studies:
        """Return ladders of step and stiffness, Exudyn's defaults, and the adapter's choices."""
        return reeving_studies(self.settings, self.with_settings)
