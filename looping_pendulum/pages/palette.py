"""Colours, dashes and markers that distinguish runs, also for colour-blind readers, on light and dark backgrounds."""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from dataclasses import dataclass

from looping_pendulum.files import utf8

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Okabe and Ito's colour-blind-safe palette without black (the reference) and yellow (faint on white)."""
DARK_COLOURS = ("#4DA3E0", "#FF8A3D", "#2CC9A0", "#E8A0CB", "#F7BF3E", "#9AD8FF")
"""The same hues in the same order, lighter, for a dark background."""
GREY = "0.55"
"""Of lines that are no run: limits, zeros, the declared model."""
DASHES: tuple[tuple[float, ...], ...] = ((1, 0), (6, 2), (2, 1.5), (6, 2, 1.5, 2), (9, 3), (4, 1.5, 1, 1.5, 1, 1.5))
"""Lengths of strokes and gaps, in line widths or points."""
MARKERS = "osD^vP"
"""Matplotlib's letters: circle, square, diamond, triangle up, triangle down, plus."""


@dataclass(frozen=True, kw_only=True)
class Style:
    """Appearance of an engine in all figures."""

    colour: str
    dashes: tuple[float, ...]
    marker: str
    slot: int
    """Index of the colour in `COLOURS`; pages use ``var(--run-SLOT)``, which depends on the background."""


KNOWN_LABELS = (
    # The variants that run if none is named, and Drake's
    "mujoco:capstan",
    "pymunk:chain",
    "pybullet:chain",
    "mujoco:documented",
    "mujoco:beads",
    "drake:chain",
    # No two variants of one engine have the same colour
    "box2d:chain",
    "mujoco:frictionloss",
    "mujoco:defaults",
    "rapier:chain",
    "newton:tendon",
    "pybullet:defaults",
    "reference",
    "exudyn:cable",
)
"""Labels of this package's engines: the place of each gives its style, which is the same on every page and in every figure."""


def styles(labels: Iterable[str]) -> dict[str, Style]:
    """Return a style per label: always the same for one of `KNOWN_LABELS`, for another one chosen by its checksum.

    Of other labels with the same checksum, later ones by the alphabet take the next free style.
    """
    given = set(labels)
    slots = {label: slot for slot, label in enumerate(KNOWN_LABELS) if label in given}
    count, taken = len(COLOURS), set[int]()
    for label in sorted(given - slots.keys()):
        # Not hash(), which differs from process to process
        wanted = zlib.crc32(utf8(label)) % count
        free = [slot for k in range(count) if (slot := (wanted + k) % count) not in taken]
        slot = free[0] if free else len(taken)
        taken.add(slot)
        # Behind the known ones, so that a colour that both have goes with other dashes and markers
        slots[label] = len(KNOWN_LABELS) + slot
    made = {}
    for label, slot in slots.items():
        # Each round through the colours pairs them with other dashes and markers
        shape = (slot + slot // count) % count
        made[label] = Style(colour=COLOURS[slot % count], dashes=DASHES[shape], marker=MARKERS[shape], slot=slot % count)
    return made


def colour_rules() -> str:
    """Return the CSS custom properties ``--run-0`` and so on, for both backgrounds."""

    def rules(colours: tuple[str, ...]) -> str:
        return " ".join(f"--run-{slot}: {colour};" for slot, colour in enumerate(colours))

    return f":root {{ {rules(COLOURS)} }}\n:root[data-theme=dark] {{ {rules(DARK_COLOURS)} }}"
