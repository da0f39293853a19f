"""NVIDIA's Newton: a tendon with a capstan law of its own. Offered through the entry point that a third party uses."""

from __future__ import annotations

from looping_pendulum.engines.newton.tendon import NewtonTendon
from looping_pendulum.engines.protocol import Engine, Profile


def engines(profile: Profile) -> list[Engine]:
    """Return every variant of this engine with the settings of ``profile``."""
    return [NewtonTendon(profile=profile)]
