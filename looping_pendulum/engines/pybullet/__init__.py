"""PyBullet: link chains over a static sphere."""

from __future__ import annotations

from looping_pendulum.engines.protocol import Engine, Profile
from looping_pendulum.engines.pybullet.chain import PybulletChain


def engines(profile: Profile) -> list[Engine]:
    """Return every variant of this engine with the settings of ``profile``."""
    return [PybulletChain(variant=variant, profile=profile) for variant in ("chain", "defaults")]
