"""The rig of Drake's bead chain: beads come where the straight string is about to touch the rod, and go where it has left it.

A bead on a straight part carries nothing sideways, so one that comes or goes there changes no force; every bead that bears on
the rod is Drake's alone. Drake's distance constraint pushes as well as it pulls: on a straight part that would be slack the rig
switches it off, until the string is as long again.
"""

from __future__ import annotations

import math

import numpy as np

from looping_pendulum.engines.chain import LEAST_BEADS, SlipGauge, StraightParts, point_on_string
from looping_pendulum.engines.drake.chain_model import ChainModel, DrakeChainSettings
from looping_pendulum.engines.protocol import SAMPLE_INTERVAL
from looping_pendulum.reference_ode.cartesian import cartesian_force, release_velocity
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release

LIGHT, HEAVY = 0, 1
"""The two ends of the string."""


class DrakeChainRig:
    """The apparatus in Drake; a plant for every number of beads, built when it is first needed."""

    def __init__(self, parameters: Parameters, settings: DrakeChainSettings) -> None:
        p, s = parameters, settings
        self._parameters, self._settings = p, s
        self._node_radius = s.node_radius(p.rod_radius)
        self._straight_parts = StraightParts(p.rod_radius, s.bend, self._node_radius)
        self._link_length = self._straight_parts.link_length
        self._has_string, self._held = p.release is not Release.DROP, p.release is Release.HELD
        self._ends = (LIGHT,) if self._held else (LIGHT, HEAVY)
        """Ends of the string with a mass that moves."""
        self._masses = (p.light_mass, p.heavy_mass)
        self._gravity = np.array([0.0, p.coefficients["gravity"]])
        self._force = cartesian_force(p)
        self._pushes = np.zeros((2, 2))  # on either mass [N]
        self._taut = [True, True]
        self._caught = [0.0, 0.0]  # by how much longer either straight part was when it was caught [m]
        self._models: dict[int, ChainModel] = {}
        self._slip = SlipGauge()
        self._groups = 0
        self._lay()

    def advance(self) -> None:
        """Step through one sample interval, in groups."""
        before = self._velocities()
        for _ in range(self._settings.groups_per_sample):
            if self._has_string:
                for end in (LIGHT, HEAVY):
                    self._tend(end)
            self._push()
            self._model.step(self._settings.steps_per_group)
            self._groups += 1
            self._places, self._speeds = self._model.places(), self._model.speeds()
            if self._has_string:
                self._catch()
        if self._has_string:
            self._slacken(before)

    def read(self) -> tuple[float, ...]:
        """Positions [m], velocities [m/s], string stretch and slip [m]: `COLUMNS` without the time."""
        x, y = self._places[:2].tolist()
        vx, vy = self._speeds[:2].tolist()
        heavy_x, heavy_y = self._mass(HEAVY).tolist()
        return (x, y, vx, vy, heavy_x, heavy_y, 0.0, float(self._speeds[-1]), *self._read_string())

    def _lay(self) -> None:
        """Lay the chain along the taut string, with the release's velocities."""
        p, bend = self._parameters, self._settings.bend
        # The outermost bead stands within half a link of the tangent point on either side of it.
        count = max(round(p.release_angle / bend) + 1, LEAST_BEADS) if self._has_string else 0
        first = p.release_angle - 0.5 * (p.release_angle - (count - 1) * bend)
        angles = first - bend * np.arange(count)
        outwards = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        beads = self._node_radius * outwards
        light, heavy = point_on_string(p, 0.0, p.rod_radius), (p.rod_radius, -p.hanging_length)
        row = np.array([light, *beads, heavy])
        self.lengths: list[float] = np.linalg.norm(np.diff(row, axis=0), axis=1).tolist()
        vx, vy, heavy_v = release_velocity(p)
        sliding = heavy_v * np.stack([-outwards[:, 1], outwards[:, 0]], axis=1)
        places = np.array([*light, *beads.ravel(), heavy[1]])
        self._use(count, places, np.array([vx, vy, *sliding.ravel(), heavy_v]))

    def _use(self, beads: int, places: Array, speeds: Array) -> None:
        """Go on with ``beads`` beads."""
        if beads not in self._models:
            self._models[beads] = ChainModel(self._parameters, self._settings, beads)
        self._beads, self._model = beads, self._models[beads]
        self._places, self._speeds = places, speeds
        self._model.set(places, speeds)
        if self._has_string:
            for link in range(1, beads):
                self._model.set_link(link, self.lengths[link], True)
            self._set_straight(LIGHT)
            self._set_straight(HEAVY)

    def _set_straight(self, end: int) -> None:
        link = self._straight(end)
        self._model.set_link(link, self.lengths[link] + self._caught[end], self._taut[end])

    def _straight(self, end: int) -> int:
        """Index of the straight link at ``end``."""
        return 0 if end == LIGHT else self._beads

    def _push(self) -> None:
        if self._force is None:
            return
        time = self._groups * self._settings.group_time
        x, y = self._places[:2].tolist()
        vx, vy = self._speeds[:2].tolist()
        fx, fy, heavy_fy = self._force(time, x, y, vx, vy, float(self._speeds[-1]))
        self._pushes[:] = (fx, fy), (0.0, heavy_fy)
        self._model.push((fx, fy), heavy_fy)

    def _mass(self, end: int) -> Array:
        """Place of the mass at ``end`` [m]."""
        return self._places[:2] if end == LIGHT else np.array([self._parameters.rod_radius, self._places[-1]])

    def _velocities(self) -> Array:
        """Velocities of both masses [m/s], shape (2, 2)."""
        return np.array([self._speeds[:2], (0.0, self._speeds[-1])])

    def _bead(self, row: Array, end: int, index: int) -> Array:
        """Of ``row``, the part of the bead that is number ``index`` from ``end``."""
        first = 2 + 2 * (index if end == LIGHT else self._beads - 1 - index)
        return row[first : first + 2]

    def _tend(self, end: int) -> None:
        """Add or take away a bead on the straight part at ``end``."""
        if not self._taut[end]:
            return
        link = self._straight(end)
        mass, outermost, following = self._mass(end), self._bead(self._places, end, 0), self._bead(self._places, end, 1)
        change = self._straight_parts.change(mass, outermost, following, self.lengths[link], self._beads)
        if change > 0:
            self._add_bead(end, self._link_length / math.dist(mass, outermost))
        elif change < 0:
            self._take_bead(end)

    def _add_bead(self, end: int, share: float) -> None:
        """Put a bead on the straight part at ``end``, at this share of the way from the outermost bead to the mass."""
        link, at = self._straight(end), 2 if end == LIGHT else 2 + 2 * self._beads
        place, speed = self._bead(self._places, end, 0), self._bead(self._speeds, end, 0)
        place = place + share * (self._mass(end) - place)
        speed = speed + share * (self._velocities()[end] - speed)
        rest = self.lengths[link] - self._link_length
        self.lengths[link : link + 1] = [rest, self._link_length] if end == LIGHT else [self._link_length, rest]
        self._use(self._beads + 1, np.insert(self._places, at, place), np.insert(self._speeds, at, speed))

    def _take_bead(self, end: int) -> None:
        """Take the outermost bead off the straight part at ``end``."""
        first = 2 if end == LIGHT else 2 * self._beads
        gone = [first, first + 1]
        joined = slice(0, 2) if end == LIGHT else slice(self._beads - 1, self._beads + 1)
        self.lengths[joined] = [math.fsum(self.lengths[joined])]
        self._use(self._beads - 1, np.delete(self._places, gone), np.delete(self._speeds, gone))

    def _slacken(self, before: Array) -> None:
        """Switch a straight part off that pushed its mass on average since the velocities were ``before``, a sample ago.

        Over a shorter time, the jolts of beads that land would pass for a push.
        """
        gained = (self._velocities() - before) / SAMPLE_INTERVAL + self._gravity
        pull = np.array(self._masses)[:, np.newaxis] * gained - self._pushes
        for end in self._ends:
            if self._taut[end] and float(pull[end] @ (self._bead(self._places, end, 0) - self._mass(end))) < 0.0:
                self._taut[end] = False
                self._set_straight(end)

    def _catch(self) -> None:
        """Switch a straight part on again where it is as long as its string."""
        for end in self._ends:
            if not self._taut[end]:
                excess = math.dist(self._mass(end), self._bead(self._places, end, 0)) - self.lengths[self._straight(end)]
                if excess >= 0.0:
                    self._taut[end], self._caught[end] = True, excess  # pulling it back at once would throw the mass
                    self._set_straight(end)

    def _read_string(self) -> tuple[float, float]:
        """How much longer than its rest length the string is (negative: it hangs slack), and how far it has slid [m]."""
        if not self._has_string:
            return math.nan, math.nan
        row = np.vstack([self._places[:-1].reshape(-1, 2), self._mass(HEAVY)])
        stretch = float(np.linalg.norm(np.diff(row, axis=0), axis=1).sum()) - math.fsum(self.lengths)
        return stretch, self._slip.read(row.tolist(), self.lengths)
