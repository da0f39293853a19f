"""Box2D 3, through pyb2d3: a chain of beads. Offered through the entry point that a third party uses."""

from __future__ import annotations

from looping_pendulum.engines.box2d.chain import Box2dChain
from looping_pendulum.engines.protocol import Engine, Profile


def engines(profile: Profile) -> list[Engine]:
    """Return every variant of this engine with the settings of ``profile``."""
    return [Box2dChain(profile=profile)]
