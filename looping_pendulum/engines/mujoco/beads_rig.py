"""The rig of the bead chain: beads come where the straight string is about to touch the rod, and go where it has left it.

A bead on a straight part carries nothing sideways, so one that comes or goes there changes no force; every bead that bears on
the rod is MuJoCo's alone. A free bead would swing like the bead of a string instrument, and need steps shorter than that
swing; so none stays free for longer than it takes to land.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from looping_pendulum.engines.chain import LEAST_BEADS, Place, SlipGauge, StraightParts, point_on_string
from looping_pendulum.engines.mujoco.beads_model import BeadSettings, bead_xml
from looping_pendulum.reference_ode.cartesian import cartesian_force, release_velocity
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release

TAUT = 1e-3
"""A straight part shorter than its string by more than this fraction hangs slack, and its beads are left alone."""

Row = Sequence[float] | Array


class _CompiledModel:
    """A model with its data, and the arrays of both that the rig reads and writes.

    Fetching an array from MuJoCo's objects costs as much as the arithmetic on it.
    """

    def __init__(self, mujoco: Any, xml: str) -> None:
        self.model: Any = mujoco.MjModel.from_xml_string(xml)
        self.data: Any = mujoco.MjData(self.model)
        self.qpos, self.qvel, self.applied = self.data.qpos, self.data.qvel, self.data.qfrc_applied
        self.warm_start = self.data.qacc_warmstart
        self.allowed = self.model.tendon_range[:, 1]
        """Length allowed to each straight part [m]."""
        self.kept = self.model.eq_data[:, 0]
        """Lengths kept between beads, less `natural_lengths` [m]."""
        self.natural_lengths = self.model.tendon_length0.copy()
        kinds = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
        self.breakdowns = [self.data.warning[int(kind)] for kind in kinds]


class BeadRig:
    """The apparatus in MuJoCo; a model for every number of beads, compiled when it is first needed."""

    def __init__(self, parameters: Parameters, settings: BeadSettings) -> None:
        import mujoco

        p = parameters
        self._mujoco: Any = mujoco
        self._step: Any = mujoco.mj_step
        self._parameters, self._settings = p, settings
        self._node_radius = settings.node_radius(p.rod_radius)
        self._straight_parts = StraightParts(p.rod_radius, settings.bend, self._node_radius)
        self._link_length = self._straight_parts.link_length
        softness = settings.string_impedance * settings.string_time_constant
        self._turning_shift = softness * softness  # MuJoCo leaves l omega^2 out of a tendon's acceleration
        self._has_string, self._held = p.release is not Release.DROP, p.release is Release.HELD
        self._heavy_free = 0 if self._held else 1
        self._force = cartesian_force(p)
        self._compiled: dict[int, _CompiledModel] = {}
        self._slip = SlipGauge()
        self._lay()

    def advance(self) -> None:
        """Step through one sample interval, in groups."""
        for _ in range(self._settings.groups_per_sample):
            places = self._now.qpos.tolist()
            self._prepare(self._tend(places) if self._has_string else places)
            self._step(self._now.model, self._now.data, self._settings.steps_per_group)

    def read(self) -> tuple[float, ...]:
        """Positions [m], velocities [m/s], string stretch and slip [m]: `COLUMNS` without the time."""
        if any(warning.number for warning in self._now.breakdowns):
            return (math.nan,) * 10  # MuJoCo only warns, and what follows looks like motion
        x, y = self._now.qpos[:2].tolist()
        vx, vy = self._now.qvel[:2].tolist()
        heavy_y, heavy_v = self._heavy()
        return (x, y, vx, vy, self._parameters.rod_radius, heavy_y, 0.0, heavy_v, *self._string())

    def _lay(self) -> None:
        """Lay the chain along the taut string, with the release's velocities."""
        p, bend = self._parameters, self._settings.bend
        vx, vy, heavy_v = release_velocity(p)
        # The outermost bead stands within half a link of the tangent point on either side of it.
        count = max(round(p.release_angle / bend) + 1, LEAST_BEADS) if self._has_string else 0
        first = p.release_angle - 0.5 * (p.release_angle - (count - 1) * bend)
        angles = [first - i * bend for i in range(count)]
        light = point_on_string(p, 0.0, p.rod_radius)
        beads = [(self._node_radius * math.cos(a), self._node_radius * math.sin(a)) for a in angles]
        rows = [light, *beads, (p.rod_radius, -p.hanging_length)]
        self.lengths = [math.dist(a, b) for a, b in zip(rows[:-1], rows[1:], strict=True)]
        sliding = [(-heavy_v * math.sin(a), heavy_v * math.cos(a)) for a in angles]
        places = np.array([*light, *np.ravel(beads), -p.hanging_length][: 2 * count + 2 + self._heavy_free])
        speeds = np.array([vx, vy, *np.ravel(sliding), heavy_v][: 2 * count + 2 + self._heavy_free])
        self._use(count, 0.0, places, speeds, np.zeros_like(places))

    def _use(self, beads: int, time: float, qpos: Row, qvel: Row, warm_start: Row) -> None:
        """Go on with ``beads`` beads."""
        if beads not in self._compiled:
            self._compiled[beads] = _CompiledModel(self._mujoco, bead_xml(self._parameters, self._settings, beads))
        self._beads, self._now = beads, self._compiled[beads]
        now = self._now
        now.data.time = time
        now.qpos[:], now.qvel[:], now.warm_start[:] = qpos, qvel, warm_start
        if self._has_string:
            now.allowed[0], now.allowed[beads] = self.lengths[0], self.lengths[beads]
            now.kept[:] = self.lengths[1:beads]
            now.kept -= now.natural_lengths[1:beads]

    def _heavy(self) -> tuple[float, float]:
        """Height [m] and upward velocity [m/s] of the heavy mass."""
        if self._held:
            return -self._parameters.hanging_length, 0.0
        return float(self._now.qpos[-1]), float(self._now.qvel[-1])

    def _prepare(self, places: list[float]) -> None:
        """Set the applied forces and the light straight part's allowed length for the coming group of steps."""
        now = self._now
        speeds = now.qvel.tolist()
        x, y, vx, vy = places[0], places[1], speeds[0], speeds[1]
        if self._force is not None:
            heavy_v = 0.0 if self._held else speeds[-1]
            now.applied[0], now.applied[1], heavy = self._force(now.data.time, x, y, vx, vy, heavy_v)
            if not self._held:
                now.applied[-1] = heavy
        if self._has_string:
            x, y = x - places[2], y - places[3]
            square = max(x * x + y * y, 1e-16)
            across = x * vy - y * vx  # the bead's own velocity is the sliding, along the string
            turning = across * across / (square * math.sqrt(square))
            now.allowed[0] = self.lengths[0] - self._turning_shift * turning

    def _tend(self, places: list[float]) -> list[float]:
        """Add or take away a bead on either straight part; ``places`` are the coordinates, before and (returned) after."""
        if self._tend_side(0, places[:2], places[2:4], places[4:6]):
            places = self._now.qpos.tolist()
        last = 2 * self._beads
        heavy = (self._parameters.rod_radius, -self._parameters.hanging_length if self._held else places[-1])
        if self._tend_side(self._beads, heavy, places[last : last + 2], places[last - 2 : last]):
            places = self._now.qpos.tolist()
        return places

    def _tend_side(self, link: int, mass: Place, end: Place, following: Place) -> bool:
        """Add or take away a bead between ``mass`` and ``end``, the outermost bead, which straight ``link`` joins."""
        distance = math.dist(mass, end)
        if distance < (1 - TAUT) * self.lengths[link]:
            return False
        change = self._straight_parts.change(mass, end, following, self.lengths[link], self._beads)
        if change > 0:
            self._add_bead(link, self._link_length / distance)
        elif change < 0:
            self._take_bead(link)
        return change != 0

    def _add_bead(self, link: int, share: float) -> None:
        """Put a bead on straight ``link``, at this share of the way from the outermost bead to the mass."""
        count = self._beads
        heavy_y, heavy_v = self._heavy()
        at, bead = (2, 2) if link == 0 else (2 * count + 2, 2 * count)

        def with_bead(row: list[float], heavy: tuple[float, float]) -> list[float]:
            mass_x, mass_y = row[:2] if link == 0 else heavy
            x, y = row[bead : bead + 2]
            return [*row[:at], x + share * (mass_x - x), y + share * (mass_y - y), *row[at:]]

        rest = self.lengths[link] - self._link_length
        self.lengths[link : link + 1] = [rest, self._link_length] if link == 0 else [self._link_length, rest]
        places, speeds, accelerations = self._rows()
        self._use(
            count + 1,
            self._now.data.time,
            with_bead(places, (self._parameters.rod_radius, heavy_y)),
            with_bead(speeds, (0.0, heavy_v)),
            with_bead(accelerations, (0.0, 0.0)),
        )

    def _take_bead(self, link: int) -> None:
        """Take the outermost bead off straight ``link``."""
        count = self._beads
        first = 2 if link == 0 else 2 * count
        joined = slice(0, 2) if link == 0 else slice(count - 1, count + 1)
        self.lengths[joined] = [math.fsum(self.lengths[joined])]
        places, speeds, accelerations = (row[:first] + row[first + 2 :] for row in self._rows())
        self._use(count - 1, self._now.data.time, places, speeds, accelerations)

    def _rows(self) -> tuple[list[float], list[float], list[float]]:
        """Coordinates, velocities, and accelerations that MuJoCo's solver starts from."""
        return self._now.qpos.tolist(), self._now.qvel.tolist(), self._now.warm_start.tolist()

    def _string(self) -> tuple[float, float]:
        """How much longer than its rest length the string is (negative: it hangs slack), and how far it has slid [m]."""
        if not self._has_string:
            return math.nan, math.nan
        places = self._now.qpos[: 2 * self._beads + 2].reshape(-1, 2).tolist()
        places.append((self._parameters.rod_radius, self._heavy()[0]))
        stretch = math.fsum(map(math.dist, places[:-1], places[1:])) - math.fsum(self.lengths)
        return stretch, self._slip.read(places, self.lengths)
