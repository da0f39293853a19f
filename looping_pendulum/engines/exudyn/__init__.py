"""Exudyn: a cable of finite elements, and its reeving system. Offered through the entry point that a third party uses."""

from __future__ import annotations

from looping_pendulum.engines.exudyn.cable import ExudynCable
from looping_pendulum.engines.exudyn.reeving import ExudynReeving
from looping_pendulum.engines.protocol import Engine, Profile


def engines(profile: Profile) -> list[Engine]:
    """Return every variant of this engine with the settings of ``profile``."""
    return [ExudynCable(profile=profile), ExudynReeving(profile=profile)]
