"""Rapier, through rapier3d: a chain of beads. Offered through the entry point that a third party uses."""

from __future__ import annotations

from looping_pendulum.engines.protocol import Engine, Profile
from looping_pendulum.engines.rapier.chain import RapierChain


def engines(profile: Profile) -> list[Engine]:
    """Return every variant of this engine with the settings of ``profile``."""
    return [RapierChain(profile=profile)]
