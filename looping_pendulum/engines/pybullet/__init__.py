"""PyBullet: link chains over a static sphere."""

from __future__ import annotations

from looping_pendulum.engines.protocol import Engine, Profile
from looping_pendulum.engines.pybullet.chain import PybulletChain


def engines(profile: Profile) -> list[Engine]:
    """Every variant of this engine, in ``profile``."""
    return [PybulletChain(profile=profile)]
