"""The rig of the bead chain: beads come where the straight string is about to touch the rod, and go where it has left it.

A bead on a straight part carries nothing sideways, so one that comes or goes there changes no force; every bead that bears on
the rod is MuJoCo's alone. A free bead would swing like the bead of a string instrument, and need steps shorter than that
swing; so none stays free for longer than it takes to land.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from looping_pendulum.engines.chain import point_on_string
from looping_pendulum.engines.mujoco.beads_model import BeadSettings, bead_xml
from looping_pendulum.reference_ode.cartesian import cartesian_force, release_velocity
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release

COMES = 0.2
"""A bead comes when its place on the straight string is this near to the rod's polygon, in R bend^2: the place comes nearer
by 1 while the string is wound, or slides, by one link."""
GOES = 0.5
"""The outermost bead goes when the string without it would pass the polygon at this distance, in R bend^2; more than `COMES`,
so that none flickers."""
LEAST_BEADS = 2
"""Beads that always stay."""
LEAST_LENGTH = 1.5
"""A straight part shorter than this gets no more beads, in links."""
TAUT = 1e-3
"""A straight part shorter than its string by more than this fraction hangs slack, and its beads are left alone."""


class BeadRig:
    """The apparatus in MuJoCo; a model for every number of beads, compiled when it is first needed."""

    def __init__(self, parameters: Parameters, settings: BeadSettings) -> None:
        import mujoco

        p = parameters
        self._mujoco: Any = mujoco
        self._step: Any = mujoco.mj_step
        self._parameters, self._settings = p, settings
        self._link_length = p.rod_radius * settings.bend
        self._node_radius = settings.node_radius(p.rod_radius)
        self._comes, self._goes = (
            (self._node_radius + share * p.rod_radius * settings.bend**2) ** 2 for share in (COMES, GOES)
        )
        softness = settings.string_impedance * settings.string_time_constant
        self._turning_shift = softness * softness  # MuJoCo leaves l omega^2 out of a tendon's acceleration
        self._has_string, self._held = p.release is not Release.DROP, p.release is Release.HELD
        self._heavy_free = 0 if self._held else 1
        self._force = cartesian_force(p)
        warnings = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
        self._breakdowns = tuple(int(kind) for kind in warnings)
        self._models: dict[int, tuple[Any, Any]] = {}
        self._lay()

    def advance(self) -> None:
        """Step through one sample interval, in groups."""
        model, data = self._model, self._data
        for _ in range(self._settings.groups_per_sample):
            if self._has_string:
                self._tend()
                model, data = self._model, self._data
            self._prepare()
            self._step(model, data, self._settings.steps_per_group)

    def read(self) -> tuple[float, ...]:
        """Positions [m], velocities [m/s] and string stretch [m]: `COLUMNS` without the time."""
        if any(self._data.warning[kind].number for kind in self._breakdowns):
            return (math.nan,) * 9  # MuJoCo only warns, and what follows looks like motion
        x, y = self._data.qpos[:2].tolist()
        vx, vy = self._data.qvel[:2].tolist()
        heavy_y, heavy_v = self._heavy()
        return (x, y, vx, vy, self._parameters.rod_radius, heavy_y, 0.0, heavy_v, self._stretch())

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

    def _use(self, beads: int, time: float, qpos: Array, qvel: Array, warm_start: Array) -> None:
        """Go on with ``beads`` beads."""
        if beads not in self._models:
            model = self._mujoco.MjModel.from_xml_string(bead_xml(self._parameters, self._settings, beads))
            self._models[beads] = model, self._mujoco.MjData(model)
        self._beads = beads
        self._model, self._data = self._models[beads]
        self._data.time = time
        self._data.qpos[:], self._data.qvel[:], self._data.qacc_warmstart[:] = qpos, qvel, warm_start
        if self._has_string:
            self._model.tendon_range[0, 1], self._model.tendon_range[beads, 1] = self.lengths[0], self.lengths[beads]
            self._model.eq_data[:, 0] = np.array(self.lengths[1:beads]) - self._model.tendon_length0[1:beads]

    def _heavy(self) -> tuple[float, float]:
        """Height [m] and upward velocity [m/s] of the heavy mass."""
        if self._held:
            return -self._parameters.hanging_length, 0.0
        return float(self._data.qpos[-1]), float(self._data.qvel[-1])

    def _prepare(self) -> None:
        """Set the applied forces and the light straight part's allowed length for the coming group of steps."""
        data = self._data
        x, y = data.qpos[:2].tolist()
        vx, vy = data.qvel[:2].tolist()
        if self._force is not None:
            fx, fy, heavy = self._force(data.time, x, y, vx, vy, self._heavy()[1])
            data.qfrc_applied[:2] = fx, fy
            if not self._held:
                data.qfrc_applied[-1] = heavy
        if self._has_string:
            end_x, end_y = data.qpos[2:4].tolist()
            x, y = x - end_x, y - end_y
            square = max(x * x + y * y, 1e-16)
            across = x * vy - y * vx  # the bead's own velocity is the sliding, along the string
            turning = across * across / (square * math.sqrt(square))
            self._model.tendon_range[0, 1] = self.lengths[0] - self._turning_shift * turning

    def _tend(self) -> None:
        """Add or take away a bead on either straight part."""
        qpos, last = self._data.qpos, 2 * self._beads
        x, y, end_x, end_y, next_x, next_y = qpos[:6].tolist()
        self._tend_side(0, (x, y), (end_x, end_y), (next_x, next_y))
        qpos, last = self._data.qpos, 2 * self._beads
        next_x, next_y, end_x, end_y = qpos[last - 2 : last + 2].tolist()
        self._tend_side(self._beads, (self._parameters.rod_radius, self._heavy()[0]), (end_x, end_y), (next_x, next_y))

    def _tend_side(
        self, link: int, mass: tuple[float, float], end: tuple[float, float], following: tuple[float, float]
    ) -> None:
        """Add or take away a bead between ``mass`` and ``end``, the outermost bead, which straight ``link`` joins."""
        distance = math.dist(mass, end)
        if distance < (1 - TAUT) * self.lengths[link]:
            return
        if self._height(mass, end) < self._comes:
            if self.lengths[link] > LEAST_LENGTH * self._link_length:
                self._add_bead(link, self._link_length / distance)
        elif self._beads > LEAST_BEADS and self._height(mass, following) > self._goes:
            self._take_bead(link)

    def _height(self, mass: tuple[float, float], bead: tuple[float, float]) -> float:
        """Square of the distance from the rod's centre [m^2] of the place a link from ``bead`` on the way to ``mass``."""
        share = self._link_length / math.dist(mass, bead)
        x, y = bead[0] + share * (mass[0] - bead[0]), bead[1] + share * (mass[1] - bead[1])
        return x * x + y * y

    def _add_bead(self, link: int, share: float) -> None:
        """Put a bead on straight ``link``, at this share of the way from the outermost bead to the mass."""
        data, count = self._data, self._beads
        heavy_place = np.array([self._parameters.rod_radius, self._heavy()[0]])
        heavy_speed = np.array([0.0, self._heavy()[1]])

        def with_bead(row: Array, heavy: Array) -> Array:
            mass, end = (row[:2], row[2:4]) if link == 0 else (heavy, row[2 * count : 2 * count + 2])
            return np.insert(row, 2 if link == 0 else 2 * count + 2, end + share * (mass - end))

        rest = self.lengths[link] - self._link_length
        self.lengths[link : link + 1] = [rest, self._link_length] if link == 0 else [self._link_length, rest]
        warm_start = with_bead(data.qacc_warmstart, np.zeros(2))
        places, speeds = with_bead(data.qpos, heavy_place), with_bead(data.qvel, heavy_speed)
        self._use(count + 1, data.time, places, speeds, warm_start)

    def _take_bead(self, link: int) -> None:
        """Take the outermost bead off straight ``link``."""
        data, count = self._data, self._beads
        gone = [2, 3] if link == 0 else [2 * count, 2 * count + 1]
        joined = slice(0, 2) if link == 0 else slice(count - 1, count + 1)
        self.lengths[joined] = [math.fsum(self.lengths[joined])]
        rows = (np.delete(row, gone) for row in (data.qpos, data.qvel, data.qacc_warmstart))
        self._use(count - 1, data.time, *rows)

    def _stretch(self) -> float:
        """How much longer than its rest length the string is [m]; negative where it hangs slack."""
        if not self._has_string:
            return math.nan
        row = self._data.qpos[: 2 * self._beads + 2].reshape(-1, 2)
        row = np.vstack([row, [self._parameters.rod_radius, self._heavy()[0]]])
        return float(np.linalg.norm(np.diff(row, axis=0), axis=1).sum()) - math.fsum(self.lengths)
