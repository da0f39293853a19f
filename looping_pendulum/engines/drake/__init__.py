"""Drake: a chain of beads, by its discrete contact solver. Offered through the entry point that a third party uses."""

from __future__ import annotations

from looping_pendulum.engines.drake.chain import DrakeChain
from looping_pendulum.engines.protocol import Engine, Profile


def engines(profile: Profile) -> list[Engine]:
    """Return every variant of this engine with the settings of ``profile``."""
    return [DrakeChain(profile=profile)]
