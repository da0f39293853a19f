"""pymunk (Chipmunk): chains over a static circle."""

from __future__ import annotations

from looping_pendulum.engines.protocol import Engine, Profile
from looping_pendulum.engines.pymunk.chain import PymunkChain


def engines(profile: Profile) -> list[Engine]:
    """Every variant of this engine, in ``profile``."""
    return [PymunkChain(profile=profile)]
