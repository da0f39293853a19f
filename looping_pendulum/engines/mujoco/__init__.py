"""Adapter of MuJoCo: the string as tendons over a cylinder, or as a chain of beads."""

from __future__ import annotations

from looping_pendulum.engines.mujoco.beads import MujocoBeads
from looping_pendulum.engines.mujoco.tendon import MujocoTendon
from looping_pendulum.engines.protocol import Engine, Profile


def engines(profile: Profile) -> list[Engine]:
    """Return every variant of this engine, in ``profile``."""
    return [
        *(MujocoTendon(variant=variant, profile=profile) for variant in ("documented", "capstan", "frictionloss", "defaults")),
        MujocoBeads(profile=profile),
    ]
