"""The rig of Drake's bead chain: beads are added where the straight string is about to touch the rod, and removed behind it.

A bead on a straight part carries no lateral load, so adding or removing it there changes no force; beads that bear on the rod
are moved by Drake alone. Drake's distance constraint pushes as well as it pulls: the rig deactivates that of a straight part
which would be slack, until its ends are as far apart as the string is long.
"""

from __future__ import annotations

import math

import numpy as np

from looping_pendulum.engines.chain import BeadCountRule, SlipGauge, beads_at_release, point_on_string
from looping_pendulum.engines.drake.chain_model import ChainModel, DrakeChainSettings
from looping_pendulum.engines.protocol import SAMPLE_INTERVAL
from looping_pendulum.reference_ode.cartesian import cartesian_force, release_velocity
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release

LIGHT, HEAVY = 0, 1
"""Indices of the string's two ends."""


class DrakeChainRig:
    """The apparatus in Drake, with a plant for every number of beads, built when it is first needed.

    A Drake plant cannot change once it is finalized, so a bead that is added or removed means another plant.
    """

    def __init__(self, parameters: Parameters, settings: DrakeChainSettings) -> None:
        p, s = parameters, settings
        self._parameters, self._settings = p, s
        self._node_radius = s.node_radius(p.rod_radius)
        self._straight_parts = BeadCountRule(p.rod_radius, s.bend, self._node_radius)
        self._link_length = self._straight_parts.link_length
        self._has_string, self._is_held = p.release is not Release.DROP, p.release is Release.HELD
        self._ends = (LIGHT,) if self._is_held else (LIGHT, HEAVY)
        """Ends of the string whose mass can move."""
        self._masses = (p.light_mass, p.heavy_mass)
        self._gravity = np.array([0.0, p.coefficients["gravity"]])
        self._force = cartesian_force(p)
        self._applied_forces = np.zeros((2, 2))  # forces of the effects on light and heavy mass [N]
        self._taut = [True, True]
        self._extra_length = [0.0, 0.0]  # of a straight part beyond its rest length when it became taut again [m]
        self._models: dict[int, ChainModel] = {}
        self._slip = SlipGauge()
        self._groups = 0
        self._place_chain()

    def advance(self) -> None:
        """Advance by one sample interval, in groups of steps."""
        before = self._mass_velocities()
        for _ in range(self._settings.groups_per_sample):
            if self._has_string:
                for end in (LIGHT, HEAVY):
                    self._update_beads(end)
            self._apply_forces()
            self._model.step(self._settings.steps_per_group)
            self._groups += 1
            self._positions, self._velocities = self._model.positions(), self._model.velocities()
            if self._has_string:
                self._reactivate_taut_parts()
        if self._has_string:
            self._deactivate_pushing_parts(before)

    def read(self) -> tuple[float, ...]:
        """Return positions [m], velocities [m/s], string stretch and slip [m]: `COLUMNS` without the time."""
        x, y = self._positions[:2].tolist()
        vx, vy = self._velocities[:2].tolist()
        heavy_x, heavy_y = self._mass_position(HEAVY).tolist()
        return (x, y, vx, vy, heavy_x, heavy_y, 0.0, float(self._velocities[-1]), *self._read_string())

    def _place_chain(self) -> None:
        """Place the chain along the taut string, with the release's velocities."""
        p, beads, sliding = self._parameters, np.empty((0, 2)), np.empty((0, 2))
        if self._has_string:
            beads, sliding = beads_at_release(p, self._settings.bend, self._node_radius)
        light, heavy = point_on_string(p, 0.0, p.rod_radius), (p.rod_radius, -p.hanging_length)
        row = np.array([light, *beads, heavy])
        self.lengths: list[float] = np.linalg.norm(np.diff(row, axis=0), axis=1).tolist()
        vx, vy, heavy_v = release_velocity(p)
        positions = np.array([*light, *beads.ravel(), heavy[1]])
        self._use_model(len(beads), positions, np.array([vx, vy, *sliding.ravel(), heavy_v]))

    def _use_model(self, beads: int, positions: Array, velocities: Array) -> None:
        """Continue with the plant of ``beads`` beads, in the state of these coordinates [m] and velocities [m/s]."""
        if beads not in self._models:
            self._models[beads] = ChainModel(self._parameters, self._settings, beads)
        self._beads, self._model = beads, self._models[beads]
        self._positions, self._velocities = positions, velocities
        self._model.set_state(positions, velocities)
        if self._has_string:
            for link in range(1, beads):
                self._model.set_link(link, self.lengths[link], True)
            self._update_straight_link(LIGHT)
            self._update_straight_link(HEAVY)

    def _update_straight_link(self, end: int) -> None:
        """Set the length and the activity of the straight link at ``end`` in the plant."""
        link = self._straight_index(end)
        self._model.set_link(link, self.lengths[link] + self._extra_length[end], self._taut[end])

    def _straight_index(self, end: int) -> int:
        """Return the index of the straight link at ``end``."""
        return 0 if end == LIGHT else self._beads

    def _apply_forces(self) -> None:
        """Set the effects' forces on both masses."""
        if self._force is None:
            return
        time = self._groups * self._settings.group_time
        x, y = self._positions[:2].tolist()
        vx, vy = self._velocities[:2].tolist()
        fx, fy, heavy_fy = self._force(time, x, y, vx, vy, float(self._velocities[-1]))
        self._applied_forces[:] = (fx, fy), (0.0, heavy_fy)
        self._model.apply_forces((fx, fy), heavy_fy)

    def _mass_position(self, end: int) -> Array:
        """Return the position [m] of the mass at ``end``."""
        return self._positions[:2] if end == LIGHT else np.array([self._parameters.rod_radius, self._positions[-1]])

    def _mass_velocities(self) -> Array:
        """Return the velocities of both masses [m/s], shape (2, 2)."""
        return np.array([self._velocities[:2], (0.0, self._velocities[-1])])

    def _bead_part(self, row: Array, end: int, index: int) -> Array:
        """Return the x and y components in ``row`` of the bead that is number ``index`` from ``end``."""
        first = 2 + 2 * (index if end == LIGHT else self._beads - 1 - index)
        return row[first : first + 2]

    def _update_beads(self, end: int) -> None:
        """Add or remove a bead on the straight part at ``end``, if one is due."""
        # The beads of a slack part do not lie on the line to its mass
        if not self._taut[end]:
            return
        link = self._straight_index(end)
        mass, outermost, following = (
            self._mass_position(end),
            self._bead_part(self._positions, end, 0),
            self._bead_part(self._positions, end, 1),
        )
        change = self._straight_parts.bead_count_change(mass, outermost, following, self.lengths[link], self._beads)
        if change > 0:
            self._add_bead(end, self._link_length / math.dist(mass, outermost))
        elif change < 0:
            self._remove_bead(end)

    def _add_bead(self, end: int, share: float) -> None:
        """Add a bead on the straight part at ``end``, a fraction ``share`` of the way from the outermost bead to the mass."""
        link, at = self._straight_index(end), 2 if end == LIGHT else 2 + 2 * self._beads
        position, velocity = self._bead_part(self._positions, end, 0), self._bead_part(self._velocities, end, 0)
        position = position + share * (self._mass_position(end) - position)
        velocity = velocity + share * (self._mass_velocities()[end] - velocity)
        rest = self.lengths[link] - self._link_length
        self.lengths[link : link + 1] = [rest, self._link_length] if end == LIGHT else [self._link_length, rest]
        self._use_model(self._beads + 1, np.insert(self._positions, at, position), np.insert(self._velocities, at, velocity))

    def _remove_bead(self, end: int) -> None:
        """Remove the outermost bead at ``end``, so that its link becomes part of the straight string."""
        first = 2 if end == LIGHT else 2 * self._beads
        removed = [first, first + 1]
        joined = slice(0, 2) if end == LIGHT else slice(self._beads - 1, self._beads + 1)
        self.lengths[joined] = [math.fsum(self.lengths[joined])]
        self._use_model(self._beads - 1, np.delete(self._positions, removed), np.delete(self._velocities, removed))

    def _deactivate_pushing_parts(self, before: Array) -> None:
        """Deactivate a straight part that pushed its mass on average over the last sample interval.

        Over a shorter time, the jolts of beads that land would look like a push.

        Parameters
        ----------
        before
            Velocities of both masses a sample interval ago [m/s], shape (2, 2).
        """
        # Acceleration without gravity's part, of which the string's pull and the effects are the causes.
        specific_force = (self._mass_velocities() - before) / SAMPLE_INTERVAL + self._gravity
        pull = np.array(self._masses)[:, np.newaxis] * specific_force - self._applied_forces
        for end in self._ends:
            if (
                self._taut[end]
                and float(pull[end] @ (self._bead_part(self._positions, end, 0) - self._mass_position(end))) < 0.0
            ):
                self._taut[end] = False
                self._update_straight_link(end)

    def _reactivate_taut_parts(self) -> None:
        """Activate a slack straight part again where its ends are as far apart as its string is long."""
        for end in self._ends:
            if not self._taut[end]:
                excess = (
                    math.dist(self._mass_position(end), self._bead_part(self._positions, end, 0))
                    - self.lengths[self._straight_index(end)]
                )
                if excess >= 0.0:
                    # Correcting the excess in one step would give the mass a large velocity, so it remains.
                    self._taut[end], self._extra_length[end] = True, excess
                    self._update_straight_link(end)

    def _read_string(self) -> tuple[float, float]:
        """Return the string's stretch beyond its rest length (negative: it hangs slack) and its slip over the rod [m]."""
        if not self._has_string:
            return math.nan, math.nan
        row = np.vstack([self._positions[:-1].reshape(-1, 2), self._mass_position(HEAVY)])
        stretch = float(np.linalg.norm(np.diff(row, axis=0), axis=1).sum()) - math.fsum(self.lengths)
        return stretch, self._slip.read(row.tolist(), self.lengths)
