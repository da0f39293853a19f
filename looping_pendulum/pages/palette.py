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


def styles(labels: Iterable[str]) -> dict[str, Style]:
    """Return a style per label, chosen by its checksum; of labels with the same one, later ones take the next free."""
    taken: dict[int, str] = {}
    # Sorted, so that a style depends on which labels there are, not on their order
    for label in sorted(set(labels)):
        # Not hash(), which differs from process to process
        wanted = zlib.crc32(utf8(label)) % len(COLOURS)
        free = [slot for k in range(len(COLOURS)) if (slot := (wanted + k) % len(COLOURS)) not in taken]
        taken[free[0] if free else len(taken)] = label
    # When all colours are taken, the next round pairs each with another dash and marker
    count = len(COLOURS)
    return {
        label: Style(
            colour=COLOURS[slot % count],
            dashes=DASHES[(slot + slot // count) % count],
            marker=MARKERS[(slot + slot // count) % count],
            slot=slot % count,
        )
        for slot, label in taken.items()
    }


def colour_rules() -> str:
    """Return the CSS custom properties ``--run-0`` and so on, for both backgrounds."""

    def rules(colours: tuple[str, ...]) -> str:
        return " ".join(f"--run-{slot}: {colour};" for slot, colour in enumerate(colours))

    return f":root {{ {rules(COLOURS)} }}\n:root[data-theme=dark] {{ {rules(DARK_COLOURS)} }}"
