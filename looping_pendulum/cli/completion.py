"""The names that a shell completes. A user waits for them at every press of Tab, so nothing heavy is imported."""

from __future__ import annotations

from importlib.metadata import entry_points
from importlib.resources import files

VARIANTS = (
    "reference:heyoka",
    "reference:scipy",
    "mujoco:documented",
    "mujoco:capstan",
    "mujoco:frictionloss",
    "mujoco:defaults",
    "mujoco:effective_mass",
    "mujoco:drum",
    "mujoco:beads",
    "pymunk:chain",
    "pymunk:beads",
    "pymunk:segments",
    "pymunk:defaults",
    "pybullet:chain",
    "pybullet:remade",
    "pybullet:point_to_point",
    "pybullet:defaults",
)
"""Variants of this package's engines; the adapters, which know them, import NumPy. A test compares the two."""


def scenario_names() -> list[str]:
    """Return the names of the shipped scenarios."""
    return _names("scenarios")


def map_names() -> list[str]:
    """Return the names of the shipped maps."""
    return _names("sweep", "maps")


def _names(*folders: str, suffix: str = ".yaml") -> list[str]:
    # From the package above, whose import is cheap, as that of the folder's own package is not
    entries = files("looping_pendulum").joinpath(*folders).iterdir()
    return sorted(entry.name.removesuffix(suffix) for entry in entries if entry.name.endswith(suffix))


def engine_names() -> list[str]:
    """Return the names of engines and variants; of other packages' engines, only the engine's name is known."""
    others = sorted({point.name for point in entry_points(group="looping_pendulum.engines")})
    return [*dict.fromkeys(variant.partition(":")[0] for variant in VARIANTS), *VARIANTS, *others, "all"]


def claim_engine_names() -> list[str]:
    """Return the names of the engines about which `repro` has scripts."""
    return _script_engine_names("scripts")


def recipe_engine_names() -> list[str]:
    """Return the names of the engines for which `recipe` has scripts."""
    return _script_engine_names("recipes")


def _script_engine_names(folder: str) -> list[str]:
    return list(dict.fromkeys(name.partition("_")[0] for name in _names("repro", folder, suffix=".py")))
