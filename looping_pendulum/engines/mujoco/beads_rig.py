"""The rig of the bead chain: beads are added where the straight string will touch the rod, and removed where it has left it.

A bead on a straight part bears no transverse force, so adding or removing one there changes no force; the beads that touch the
rod are left to MuJoCo alone. A free bead would oscillate transversely like one on a musical string, and would need steps
shorter than that oscillation; so no bead stays free for longer than it takes to reach the rod.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from looping_pendulum.engines.chain import MIN_BEADS, BeadCountRule, Point, SlipGauge, point_on_string
from looping_pendulum.engines.mujoco.beads_model import BeadSettings, bead_xml
from looping_pendulum.engines.mujoco.model import compile_model
from looping_pendulum.reference_ode.cartesian import cartesian_force, release_velocity
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release

SLACK_FRACTION = 1e-3
"""A straight part shorter than its string by more than this fraction is slack; then no bead is added or removed there."""

Row = Sequence[float] | Array
"""Values of all degrees of freedom."""


class _CompiledModel:
    """A compiled model with its data, and the arrays of both that the rig reads and writes.

    The arrays are stored, because fetching one from MuJoCo's objects costs as much as the arithmetic on it.
    """

    def __init__(self, mujoco: Any, xml: str) -> None:
        self.model: Any = compile_model(mujoco, xml)
        self.data: Any = mujoco.MjData(self.model)
        self.qpos, self.qvel, self.applied = self.data.qpos, self.data.qvel, self.data.qfrc_applied
        self.warm_start = self.data.qacc_warmstart
        self.max_straight_lengths = self.model.tendon_range[:, 1]
        """Upper limit of each tendon's length [m]; the rig uses those of the two straight parts."""
        self.link_length_offsets = self.model.eq_data[:, 0]
        """Lengths that the equality constraints keep between beads, less `natural_lengths` [m]."""
        self.natural_lengths = self.model.tendon_length0.copy()
        kinds = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
        self.breakdown_warnings = [self.data.warning[int(kind)] for kind in kinds]


class BeadRig:
    """The apparatus in MuJoCo, with one model for every number of beads, compiled when it is first needed."""

    def __init__(self, parameters: Parameters, settings: BeadSettings) -> None:
        import mujoco

        p = parameters
        self._mujoco: Any = mujoco
        self._step: Any = mujoco.mj_step
        self._parameters, self._settings = p, settings
        self._node_radius = settings.node_radius(p.rod_radius)
        self._bead_rule = BeadCountRule(p.rod_radius, settings.bend, self._node_radius)
        self._link_length = self._bead_rule.link_length
        softness = settings.string_impedance * settings.string_time_constant
        self._turning_shift = (
            softness * softness
        )  # compensates for l omega^2, which MuJoCo leaves out of a tendon's acceleration
        self._has_string, self._held = p.release is not Release.DROP, p.release is Release.HELD
        self._heavy_dofs = 0 if self._held else 1
        self._force = cartesian_force(p)
        self._compiled: dict[int, _CompiledModel] = {}
        self._slip = SlipGauge()
        self._place_chain()

    def advance(self) -> None:
        """Step through one sample interval, in groups of steps."""
        for _ in range(self._settings.groups_per_sample):
            places = self._current.qpos.tolist()
            self._prepare(self._update_beads(places) if self._has_string else places)
            # One call for the whole group, which spares Python between its steps
            self._step(self._current.model, self._current.data, self._settings.steps_per_group)

    def read(self) -> tuple[float, ...]:
        """Return positions [m], velocities [m/s], string stretch and slip [m]: `COLUMNS` without the time."""
        if any(warning.number for warning in self._current.breakdown_warnings):
            return (math.nan,) * 10  # MuJoCo only warns of a breakdown, and the numbers that follow look like motion
        x, y = self._current.qpos[:2].tolist()
        vx, vy = self._current.qvel[:2].tolist()
        heavy_y, heavy_v = self._heavy_mass_state()
        return (x, y, vx, vy, self._parameters.rod_radius, heavy_y, 0.0, heavy_v, *self._stretch_and_slip())

    def _place_chain(self) -> None:
        """Place the chain along the taut string, with the release's velocities."""
        p, bend = self._parameters, self._settings.bend
        vx, vy, heavy_v = release_velocity(p)
        # The outermost bead stands at most half a link before or behind the tangent point.
        count = max(round(p.release_angle / bend) + 1, MIN_BEADS) if self._has_string else 0
        first = p.release_angle - 0.5 * (p.release_angle - (count - 1) * bend)
        angles = [first - i * bend for i in range(count)]
        light = point_on_string(p, 0.0, p.rod_radius)
        beads = [(self._node_radius * math.cos(a), self._node_radius * math.sin(a)) for a in angles]
        rows = [light, *beads, (p.rod_radius, -p.hanging_length)]
        self.lengths = [math.dist(a, b) for a, b in zip(rows[:-1], rows[1:], strict=True)]
        sliding = [(-heavy_v * math.sin(a), heavy_v * math.cos(a)) for a in angles]
        # Cut off: a heavy mass that is held has no coordinate
        places = np.array([*light, *np.ravel(beads), -p.hanging_length][: 2 * count + 2 + self._heavy_dofs])
        speeds = np.array([vx, vy, *np.ravel(sliding), heavy_v][: 2 * count + 2 + self._heavy_dofs])
        self._switch_model(count, 0.0, places, speeds, np.zeros_like(places))

    def _switch_model(self, beads: int, time: float, qpos: Row, qvel: Row, warm_start: Row) -> None:
        """Continue with the model of ``beads`` beads, from the given state."""
        if beads not in self._compiled:
            self._compiled[beads] = _CompiledModel(self._mujoco, bead_xml(self._parameters, self._settings, beads))
        self._beads, self._current = beads, self._compiled[beads]
        current = self._current
        current.data.time = time
        current.qpos[:], current.qvel[:], current.warm_start[:] = qpos, qvel, warm_start
        if self._has_string:
            current.max_straight_lengths[0], current.max_straight_lengths[beads] = self.lengths[0], self.lengths[beads]
            current.link_length_offsets[:] = self.lengths[1:beads]
            current.link_length_offsets -= current.natural_lengths[1:beads]

    def _heavy_mass_state(self) -> tuple[float, float]:
        """Return height [m] and upward velocity [m/s] of the heavy mass."""
        if self._held:
            return -self._parameters.hanging_length, 0.0
        return float(self._current.qpos[-1]), float(self._current.qvel[-1])

    def _prepare(self, places: list[float]) -> None:
        """Set the applied forces and the limit of the light mass's straight part for the coming group of steps."""
        current = self._current
        speeds = current.qvel.tolist()
        x, y, vx, vy = places[0], places[1], speeds[0], speeds[1]
        if self._force is not None:
            heavy_v = 0.0 if self._held else speeds[-1]
            current.applied[0], current.applied[1], heavy = self._force(current.data.time, x, y, vx, vy, heavy_v)
            if not self._held:
                current.applied[-1] = heavy
        if self._has_string:
            x, y = x - places[2], y - places[3]
            square = max(x * x + y * y, 1e-16)  # avoids a division by zero if mass and bead coincide
            across = x * vy - y * vx  # without the bead's velocity, which is sliding along the string
            turning = across * across / (square * math.sqrt(square))
            current.max_straight_lengths[0] = self.lengths[0] - self._turning_shift * turning

    def _update_beads(self, places: list[float]) -> list[float]:
        """Add or remove a bead on either straight part, if needed; take and return the coordinates ``places`` of all bodies."""
        if self._update_end(0, places[:2], places[2:4], places[4:6]):
            places = self._current.qpos.tolist()
        last = 2 * self._beads
        heavy = (self._parameters.rod_radius, -self._parameters.hanging_length if self._held else places[-1])
        if self._update_end(self._beads, heavy, places[last : last + 2], places[last - 2 : last]):
            places = self._current.qpos.tolist()
        return places

    def _update_end(self, link: int, mass: Point, end: Point, following: Point) -> bool:
        """Add or remove a bead, if needed, between ``mass`` and the outermost bead ``end``, which straight ``link`` connects.

        Return whether the number of beads has changed.
        """
        distance = math.dist(mass, end)
        if distance < (1 - SLACK_FRACTION) * self.lengths[link]:
            return False
        change = self._bead_rule.bead_count_change(mass, end, following, self.lengths[link], self._beads)
        if change > 0:
            self._add_bead(link, self._link_length / distance)
        elif change < 0:
            self._remove_bead(link)
        return change != 0

    def _add_bead(self, link: int, fraction: float) -> None:
        """Put a bead on the straight ``link``, at this ``fraction`` of the way from the outermost bead to the mass."""
        count = self._beads
        heavy_y, heavy_v = self._heavy_mass_state()
        at, bead = (2, 2) if link == 0 else (2 * count + 2, 2 * count)

        def with_bead(row: list[float], heavy: tuple[float, float]) -> list[float]:
            # Position, velocity and acceleration of the new bead are all interpolated, so that the motion stays smooth.
            mass_x, mass_y = row[:2] if link == 0 else heavy
            x, y = row[bead : bead + 2]
            return [*row[:at], x + fraction * (mass_x - x), y + fraction * (mass_y - y), *row[at:]]

        rest = self.lengths[link] - self._link_length
        self.lengths[link : link + 1] = [rest, self._link_length] if link == 0 else [self._link_length, rest]
        places, speeds, accelerations = self._state_rows()
        self._switch_model(
            count + 1,
            self._current.data.time,
            with_bead(places, (self._parameters.rod_radius, heavy_y)),
            with_bead(speeds, (0.0, heavy_v)),
            with_bead(accelerations, (0.0, 0.0)),
        )

    def _remove_bead(self, link: int) -> None:
        """Remove the outermost bead, so that the straight ``link`` gets longer."""
        count = self._beads
        first = 2 if link == 0 else 2 * count
        joined = slice(0, 2) if link == 0 else slice(count - 1, count + 1)
        self.lengths[joined] = [math.fsum(self.lengths[joined])]
        places, speeds, accelerations = (row[:first] + row[first + 2 :] for row in self._state_rows())
        self._switch_model(count - 1, self._current.data.time, places, speeds, accelerations)

    def _state_rows(self) -> tuple[list[float], list[float], list[float]]:
        """Return coordinates, velocities, and the accelerations from which MuJoCo's solver starts."""
        return self._current.qpos.tolist(), self._current.qvel.tolist(), self._current.warm_start.tolist()

    def _stretch_and_slip(self) -> tuple[float, float]:
        """Return how much longer than its rest length the string is (negative: it is slack), and how far it has slid [m]."""
        if not self._has_string:
            return math.nan, math.nan
        places = self._current.qpos[: 2 * self._beads + 2].reshape(-1, 2).tolist()
        places.append((self._parameters.rod_radius, self._heavy_mass_state()[0]))
        stretch = math.fsum(map(math.dist, places[:-1], places[1:])) - math.fsum(self.lengths)
        return stretch, self._slip.read(places, self.lengths)
