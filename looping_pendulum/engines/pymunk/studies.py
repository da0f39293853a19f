"""Studies of each pymunk variant: ladders of refinement, Chipmunk's defaults one by one, and the adapter's choices."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from looping_pendulum.engines.protocol import Engine
from looping_pendulum.engines.pymunk.calls import PymunkChainSettings
from looping_pendulum.engines.pymunk.full_settings import (
    DEFAULT_COLLISION_SLOP,
    DEFAULT_ITERATIONS,
    DEFAULT_RATE,
    DEFAULT_TIME_STEP,
    FullChainSettings,
    FullChainVariant,
)
from looping_pendulum.engines.studies import AdapterChoice, HiddenDefault, Ladder, Studies, WithSettings, ladder
from looping_pendulum.pages.numbers import quantity

REFINEMENTS = (1, 2, 4, 8)
"""Refinement factors of the rungs for the chain of beads near the rod, over the settings' own values.

None is coarser than the settings: joints are springs that soften with the square of the step, and a string that has stretched
by millimetres halts by another motion.
"""
FULL_CHAIN_STEPS = (5e-5, 2e-5, 1e-5, 5e-6)
"""Time steps of the full chains' ladder [s]."""
FULL_CHAIN_LINK_LENGTHS = (8e-3, 6e-3, 4e-3, 3e-3)
"""Link lengths of the full chains' ladder [m]."""
FULL_CHAIN_ITERATIONS = (5, 10, 20, 40)
"""Solver iterations per step of the full chains' ladder."""
FULL_CHAIN_MASS_FRACTIONS = (0.04, 0.02, 0.01, 0.005)
"""String masses of the full chains' ladder, as fractions of the light mass."""
DEFAULT_STEP_TEXT = "none; 1 ms is finer than its guides use"
DEFAULT_SLOP_TEXT = "0.1 units of length: 10 cm"
DEFAULT_RATE_TEXT = f"a tenth of it every 1/60 s ({DEFAULT_RATE:.1f} /s)"

EFFECT_OF_STEP = "length of a step; joints soften with its square"
EFFECT_OF_ITERATIONS = "sweeps of the solver per step; joints stiffen in proportion"
EFFECT_OF_SLOP = "how deep shapes may rest in one another; the adapter allows for it up to 1 mm"
EFFECT_OF_CONTACT_RATE = "how fast a bead too deep in the circle comes out"
EFFECT_OF_JOINT_RATE = "how fast a stretched joint returns to its length"
ONE_STEP_PER_GROUP: dict[str, Any] = {"force_interval": 1}
"""Setting that goes with a step as long as the sample interval, in which there is room for one step only."""


def chain_studies(settings: PymunkChainSettings, with_settings: WithSettings) -> Studies:
    """Return the studies of the chain of beads near the rod."""
    s = settings
    return Studies(
        ladders=(
            ladder(with_settings, "time_step", "s", ({"time_step": s.time_step / n} for n in REFINEMENTS)),
            ladder(with_settings, "bend", "rad", ({"bend": s.bend / math.sqrt(n)} for n in REFINEMENTS)),
            ladder(
                with_settings,
                "bead_mass_ratio",
                "",
                ({"bead_mass_ratio": s.bead_mass_ratio / n**2, "time_step": s.time_step / n} for n in REFINEMENTS),
                "the step, as the root of a bead's mass, so that the joints stay as stiff",
            ),
            ladder(with_settings, "iterations", "", ({"iterations": s.iterations * n} for n in REFINEMENTS)),
        ),
        defaults=(
            _default(
                "dt",
                DEFAULT_STEP_TEXT,
                quantity(s.time_step, "s", 3),
                EFFECT_OF_STEP,
                with_settings(time_step=DEFAULT_TIME_STEP, leak_interval=1, **ONE_STEP_PER_GROUP),
            ),
            _default(
                "iterations",
                f"{DEFAULT_ITERATIONS}",
                f"{s.iterations}",
                EFFECT_OF_ITERATIONS,
                with_settings(iterations=DEFAULT_ITERATIONS),
            ),
            _default(
                "collision_slop",
                DEFAULT_SLOP_TEXT,
                quantity(s.contact_slop, "m", 3),
                EFFECT_OF_SLOP,
                with_settings(contact_slop=DEFAULT_COLLISION_SLOP),
            ),
            _default(
                "collision_bias",
                DEFAULT_RATE_TEXT,
                f"{s.contact_rate:g} /s",
                EFFECT_OF_CONTACT_RATE,
                with_settings(contact_rate=DEFAULT_RATE),
            ),
            _default(
                "error_bias",
                DEFAULT_RATE_TEXT,
                f"{s.error_rate:g} /s",
                EFFECT_OF_JOINT_RATE,
                with_settings(error_rate=DEFAULT_RATE),
            ),
            _default(
                "warm start",
                "each joint starts from its last impulse",
                f"a share of {s.impulse_leak:g} /s of it is forgotten",
                "what damps the spring that the joints act as",
                with_settings(impulse_leak=0.0),
            ),
        ),
        choices=(
            _choice("bead mass", f"{s.bead_mass_ratio:g} M1", "half", with_settings(bead_mass_ratio=s.bead_mass_ratio / 2)),
            _choice("bead mass", f"{s.bead_mass_ratio:g} M1", "double", with_settings(bead_mass_ratio=s.bead_mass_ratio * 2)),
            _choice("contact friction", "corrected for the corners", "mu itself", with_settings(polygon_friction=False)),
            _choice("circle of the beads", "corrected for the corners", "R itself", with_settings(polygon_radius=False)),
            _choice("bead radius", f"{1e3 * s.bead_radius:g} mm", "half", with_settings(bead_radius=s.bead_radius / 2)),
            _choice(
                "forces and beads updated", f"every {s.force_interval} steps", "every 10", with_settings(force_interval=10)
            ),
            _choice(
                "leak of the warm start", f"{s.impulse_leak:g} /s", "double", with_settings(impulse_leak=2 * s.impulse_leak)
            ),
            _choice("leak of the warm start", f"every {s.leak_interval} steps", "every step", with_settings(leak_interval=1)),
        ),
    )


def full_studies(variant: FullChainVariant, settings: FullChainSettings, with_settings: WithSettings) -> Studies:
    """Return the studies of a full chain; that with Chipmunk's defaults varies only its step, which is no default."""
    s = settings
    if variant is FullChainVariant.DEFAULTS:
        return Studies(ladders=(_single_ladder(with_settings, "time_step", "s", (1e-3, 5e-4, 2e-4, 1e-4)),))
    return Studies(
        ladders=(
            _single_ladder(with_settings, "time_step", "s", FULL_CHAIN_STEPS),
            _single_ladder(with_settings, "link_length", "m", FULL_CHAIN_LINK_LENGTHS),
            _single_ladder(with_settings, "iterations", "", FULL_CHAIN_ITERATIONS),
            _single_ladder(with_settings, "mass_fraction", "", FULL_CHAIN_MASS_FRACTIONS),
        ),
        defaults=(
            _default(
                "dt",
                DEFAULT_STEP_TEXT,
                quantity(s.time_step, "s", 3),
                EFFECT_OF_STEP,
                with_settings(time_step=DEFAULT_TIME_STEP, **ONE_STEP_PER_GROUP),
            ),
            *(
                [
                    _default(
                        "iterations",
                        f"{DEFAULT_ITERATIONS}",
                        f"{s.iterations}",
                        EFFECT_OF_ITERATIONS,
                        with_settings(iterations=DEFAULT_ITERATIONS),
                    )
                ]
                if s.iterations != DEFAULT_ITERATIONS
                else []
            ),
            _default(
                "collision_slop",
                DEFAULT_SLOP_TEXT,
                quantity(s.collision_slop, "m", 3),
                EFFECT_OF_SLOP,
                with_settings(collision_slop=DEFAULT_COLLISION_SLOP),
            ),
            _default(
                "error_bias",
                DEFAULT_RATE_TEXT,
                f"{s.error_rate:g} /s",
                EFFECT_OF_JOINT_RATE,
                with_settings(error_rate=DEFAULT_RATE),
            ),
        ),
        choices=(
            _choice("long-range joints", f"up to {s.long_range} links", "none", with_settings(long_range=0)),
            _choice("string mass", f"{s.mass_fraction:g} M1", "half", with_settings(mass_fraction=s.mass_fraction / 2)),
            _choice("contact friction", "corrected for the corners", "mu itself", with_settings(polygon_friction=False)),
            _choice("circle of the links", "corrected for the corners", "R itself", with_settings(polygon_radius=False)),
            _choice("links' half thickness", f"{1e3 * s.bead_radius:g} mm", "0.5 mm", with_settings(bead_radius=5e-4)),
            _choice("forces updated", f"every {s.force_interval} steps", "every step", with_settings(force_interval=1)),
        ),
    )


def _single_ladder(with_settings: WithSettings, setting: str, unit: str, values: Iterable[Any]) -> Ladder:
    """Return a ladder of one setting along which no other setting changes."""
    return ladder(with_settings, setting, unit, ({setting: value} for value in values))


def _default(setting: str, default: str, ours: str, effect: str, engine: Engine) -> HiddenDefault:
    return HiddenDefault(setting=setting, default=default, ours=ours, effect=effect, engine=engine)


def _choice(what: str, ours: str, instead: str, engine: Engine) -> AdapterChoice:
    return AdapterChoice(what=what, ours=ours, instead=instead, engine=engine)
