"""PyBullet: link chains over a static sphere."""

from __future__ import annotations

from looping_pendulum.engines.protocol import Engine, Profile
from looping_pendulum.engines.pybullet.chain import PybulletChain, PybulletDefaults
from looping_pendulum.engines.pybullet.point_to_point import PybulletPointToPoint
from looping_pendulum.engines.pybullet.remade import PybulletRemade


def engines(profile: Profile) -> list[Engine]:
    """Return every variant of this engine with the settings of ``profile``."""
    return [
        PybulletChain(profile=profile),
        PybulletRemade(profile=profile),
        PybulletPointToPoint(profile=profile),
        PybulletDefaults(profile=profile),
    ]
