"""pymunk (Chipmunk): chains over a static circle."""

from __future__ import annotations

from looping_pendulum.engines.protocol import Engine, Profile
from looping_pendulum.engines.pymunk.chain import PymunkChain
from looping_pendulum.engines.pymunk.full_chain import PymunkFullChain


def engines(profile: Profile) -> list[Engine]:
    """Return every variant of this engine with the settings of ``profile``."""
    return [
        PymunkChain(profile=profile),
        *(PymunkFullChain(variant=variant, profile=profile) for variant in ("beads", "segments", "defaults")),
    ]
