"""What can be varied of each pymunk variant: ladders of refinement, Chipmunk's defaults one by one, the adapter's choices."""

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
from looping_pendulum.engines.studies import AdapterChoice, Adjusted, HiddenDefault, Ladder, Studies, ladder
from looping_pendulum.pages.numbers import quantity

REFINEMENTS = (1, 2, 4, 8)
"""How many times finer than the settings' own a rung of the chain of beads near the rod is. None is coarser: its joints are
springs that soften with the square of the step, and a string that has stretched by millimetres halts by another motion."""
FULL_STEPS = (5e-5, 2e-5, 1e-5, 5e-6)
"""[s]"""
LINKS = (8e-3, 6e-3, 4e-3, 3e-3)
"""[m]"""
SWEEPS = (5, 10, 20, 40)
STRING_MASSES = (0.04, 0.02, 0.01, 0.005)
"""Of the light mass."""
COARSE_STEP = "none; 1 ms is finer than its guides use"
SLOP = "0.1 units of length: 10 cm"
A_TENTH = f"a tenth of it every 1/60 s ({DEFAULT_RATE:.1f} /s)"

LENGTH = "length of a step; joints soften with its square"
PER_STEP = "sweeps of the solver per step; joints stiffen in proportion"
DEPTH = "how deep shapes may rest in one another; the adapter allows for it up to 1 mm"
RISE = "how fast a bead too deep in the circle comes out"
RETURN = "how fast a stretched joint returns to its length"
NO_GROUPS: dict[str, Any] = {"force_interval": 1}
"""A step as long as the sample interval leaves no groups."""


def chain_studies(settings: PymunkChainSettings, adjusted: Adjusted) -> Studies:
    """What can be varied of the chain of beads near the rod."""
    s = settings
    return Studies(
        ladders=(
            ladder(adjusted, "time_step", "s", ({"time_step": s.time_step / n} for n in REFINEMENTS)),
            ladder(adjusted, "bend", "rad", ({"bend": s.bend / math.sqrt(n)} for n in REFINEMENTS)),
            ladder(
                adjusted,
                "bead_mass_ratio",
                "",
                ({"bead_mass_ratio": s.bead_mass_ratio / n**2, "time_step": s.time_step / n} for n in REFINEMENTS),
                "the step, as the root of a bead's mass, so that the joints stay as stiff",
            ),
            ladder(adjusted, "iterations", "", ({"iterations": s.iterations * n} for n in REFINEMENTS)),
        ),
        defaults=(
            _default(
                "dt",
                COARSE_STEP,
                quantity(s.time_step, "s", 3),
                LENGTH,
                adjusted(time_step=DEFAULT_TIME_STEP, leak_interval=1, **NO_GROUPS),
            ),
            _default(
                "iterations", f"{DEFAULT_ITERATIONS}", f"{s.iterations}", PER_STEP, adjusted(iterations=DEFAULT_ITERATIONS)
            ),
            _default(
                "collision_slop", SLOP, quantity(s.contact_slop, "m", 3), DEPTH, adjusted(contact_slop=DEFAULT_COLLISION_SLOP)
            ),
            _default("collision_bias", A_TENTH, f"{s.contact_rate:g} /s", RISE, adjusted(contact_rate=DEFAULT_RATE)),
            _default("error_bias", A_TENTH, f"{s.error_rate:g} /s", RETURN, adjusted(error_rate=DEFAULT_RATE)),
            _default(
                "warm start",
                "each joint starts from its last impulse",
                f"a share of {s.impulse_leak:g} /s of it is forgotten",
                "what damps the spring that the joints act as",
                adjusted(impulse_leak=0.0),
            ),
        ),
        choices=(
            _choice("bead mass", f"{s.bead_mass_ratio:g} M1", "half", adjusted(bead_mass_ratio=s.bead_mass_ratio / 2)),
            _choice("bead mass", f"{s.bead_mass_ratio:g} M1", "double", adjusted(bead_mass_ratio=s.bead_mass_ratio * 2)),
            _choice("contact friction", "corrected for the corners", "mu itself", adjusted(polygon_friction=False)),
            _choice("circle of the beads", "corrected for the corners", "R itself", adjusted(polygon_radius=False)),
            _choice("bead radius", f"{1e3 * s.bead_radius:g} mm", "half", adjusted(bead_radius=s.bead_radius / 2)),
            _choice("forces and beads updated", f"every {s.force_interval} steps", "every 10", adjusted(force_interval=10)),
            _choice("leak of the warm start", f"{s.impulse_leak:g} /s", "double", adjusted(impulse_leak=2 * s.impulse_leak)),
            _choice("leak of the warm start", f"every {s.leak_interval} steps", "every step", adjusted(leak_interval=1)),
        ),
    )


def full_studies(variant: FullChainVariant, settings: FullChainSettings, adjusted: Adjusted) -> Studies:
    """What can be varied of a full chain; of that with Chipmunk's defaults only what is not a default."""
    s = settings
    if variant is FullChainVariant.DEFAULTS:
        return Studies(ladders=(_of(adjusted, "time_step", "s", (1e-3, 5e-4, 2e-4, 1e-4)),))
    return Studies(
        ladders=(
            _of(adjusted, "time_step", "s", FULL_STEPS),
            _of(adjusted, "link_length", "m", LINKS),
            _of(adjusted, "iterations", "", SWEEPS),
            _of(adjusted, "mass_fraction", "", STRING_MASSES),
        ),
        defaults=(
            _default(
                "dt", COARSE_STEP, quantity(s.time_step, "s", 3), LENGTH, adjusted(time_step=DEFAULT_TIME_STEP, **NO_GROUPS)
            ),
            *(
                [
                    _default(
                        "iterations",
                        f"{DEFAULT_ITERATIONS}",
                        f"{s.iterations}",
                        PER_STEP,
                        adjusted(iterations=DEFAULT_ITERATIONS),
                    )
                ]
                if s.iterations != DEFAULT_ITERATIONS
                else []
            ),
            _default(
                "collision_slop",
                SLOP,
                quantity(s.collision_slop, "m", 3),
                DEPTH,
                adjusted(collision_slop=DEFAULT_COLLISION_SLOP),
            ),
            _default("error_bias", A_TENTH, f"{s.error_rate:g} /s", RETURN, adjusted(error_rate=DEFAULT_RATE)),
        ),
        choices=(
            _choice("long-range joints", f"up to {s.long_range} links", "none", adjusted(long_range=0)),
            _choice("string mass", f"{s.mass_fraction:g} M1", "half", adjusted(mass_fraction=s.mass_fraction / 2)),
            _choice("contact friction", "corrected for the corners", "mu itself", adjusted(polygon_friction=False)),
            _choice("circle of the links", "corrected for the corners", "R itself", adjusted(polygon_radius=False)),
            _choice("links' half thickness", f"{1e3 * s.bead_radius:g} mm", "0.5 mm", adjusted(bead_radius=5e-4)),
            _choice("forces updated", f"every {s.force_interval} steps", "every step", adjusted(force_interval=1)),
        ),
    )


def _of(adjusted: Adjusted, setting: str, unit: str, values: Iterable[Any]) -> Ladder:
    """Make a ladder of one setting, along which nothing else moves."""
    return ladder(adjusted, setting, unit, ({setting: value} for value in values))


def _default(setting: str, default: str, ours: str, effect: str, engine: Engine) -> HiddenDefault:
    return HiddenDefault(setting=setting, default=default, ours=ours, effect=effect, engine=engine)


def _choice(what: str, ours: str, instead: str, engine: Engine) -> AdapterChoice:
    return AdapterChoice(what=what, ours=ours, instead=instead, engine=engine)
