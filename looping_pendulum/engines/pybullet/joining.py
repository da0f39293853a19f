"""Joining: away from the rod several links of PyBullet's chain are one, so that a step costs less.

A step of a Featherstone multibody costs about its number of links times its number of contacts. Links must be short where they
lie on the rod or may soon do so; a straight part needs no short ones. A long link is split before it reaches the rod, which
changes neither positions nor velocities. Links that have left the rod are joined, which keeps the chain's momentum.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from looping_pendulum.engines.pybullet.chain_model import ReleasedChain
from looping_pendulum.engines.pybullet.links import ChainState
from looping_pendulum.reference_ode.geometry import Array


class Joining:
    """Which nodes of the chain at release exist: all near the rod, and away from it only the ends of long links.

    Parameters
    ----------
    chain
        Chain at release, with all its nodes.
    joined_links
        Number of links that one long link replaces, on the heavy mass's side and on the light mass's; 1: none are joined.
    unjoined_links
        Number of links that stay short beyond the string on the rod, on either side.
    rod_radius
        Radius of the rod [m].
    """

    def __init__(self, chain: ReleasedChain, joined_links: tuple[int, int], unjoined_links: float, rod_radius: float) -> None:
        self._last, self._counts = len(chain.positions) - 1, joined_links
        self._near_square = (chain.node_circles**2 + (unjoined_links * chain.bends * rod_radius) ** 2).tolist()
        self._short = (0, self._last)
        self.nodes = list(range(self._last + 1))
        """Indices, in the chain at release, of the nodes that exist; the first and last one are the masses."""

    def update(self, positions: Sequence[Sequence[float]]) -> bool:
        """Choose the nodes anew, where those that exist are at ``positions`` [m]; return whether others shall exist now."""
        near = [
            i for i, (x, y) in zip(self.nodes[1:-1], positions[1:-1], strict=True) if x * x + y * y < self._near_square[i - 1]
        ]
        if not near:
            return False
        (heavy_count, light_count), (first, last), end = self._counts, self._short, self._last
        short = (_short_from(first, near[0], heavy_count), end - _short_from(end - last, end - near[-1], light_count))
        if short == self._short:
            return False
        first, last = self._short = short
        # Long links are counted from the masses, so that the others stay as they are when one is joined or split
        self.nodes = [*range(0, first, heavy_count), *range(first, last + 1), *range(end, last, -light_count)[::-1]]
        return True


def _short_from(now: int, near: int, count: int) -> int:
    """Return from which node on links are short, if they now are from node ``now`` on, and ``near`` is the first near the rod.

    Nodes are counted from a mass. The link before ``near`` is short too; joining waits for two more, so that it is not undone.
    """
    if count > 1 and (now > near - 1 or now + count <= near - 3):
        return max(near - 1, 0) // count * count
    return now


def with_nodes(chain: ChainState, nodes: Sequence[int], kept: Sequence[int], arc: Array) -> ChainState:
    """Return ``chain``, whose nodes have the indices ``nodes``, with those of indices ``kept``: new ones lie on its links.

    Parameters
    ----------
    arc
        String length from the heavy mass at every index [m].
    """
    old, new = arc[list(nodes)], arc[list(kept)]
    positions, velocities = (
        np.stack([np.interp(new, old, column) for column in rows.T], axis=1) for rows in (chain.positions, chain.velocities)
    )
    return ChainState(positions=positions, velocities=velocities)


def with_rigid_links(chain: ChainState, masses: Array, *, held: bool) -> ChainState:
    """Return ``chain`` with velocities that rigid links allow, after nodes were left out of it.

    Nodes oscillate across the string, so what were neighbours of theirs move towards or away from one another. The velocities
    become those that are nearest to the present ones in the sense of kinetic energy: the bodies exchange the impulses of rigid
    links, as in a plastic collision, and their momentum along every possible motion remains.

    Parameters
    ----------
    masses
        Masses of the bodies [kg], heavy mass first.
    held
        Whether the heavy mass cannot move; otherwise it moves vertically only.
    """
    n = len(chain.positions)
    motion = np.zeros((n, 2, n))  # of every body, for unit speed of the heavy mass or unit turn rate of a link
    motion[:, 1, 0] = 0.0 if held else 1.0
    for link, (dx, dy) in enumerate(np.diff(chain.positions, axis=0).tolist(), start=1):
        motion[link:, 0, link], motion[link:, 1, link] = -dy, dx
    weights = np.sqrt(masses)[:, None]
    rates = np.linalg.lstsq((weights[..., None] * motion).reshape(2 * n, n), (weights * chain.velocities).ravel(), rcond=None)[
        0
    ]
    return ChainState(positions=chain.positions, velocities=motion @ rates)
