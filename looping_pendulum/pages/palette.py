"""Colours, dashes and markers that distinguish runs, also for colour-blind readers, on light and dark backgrounds."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from looping_pendulum.files import utf8

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Okabe and Ito's colour-blind-safe palette without black (the reference) and yellow (faint on white)."""
DARK_COLOURS = ("#4DA3E0", "#FF8A3D", "#2CC9A0", "#E8A0CB", "#F7BF3E", "#9AD8FF")
"""The same hues in the same order, lighter, for a dark background."""
COLOUR_NAMES = ("blue", "vermilion", "green", "purple", "orange", "sky")
"""Names of these hues, in their order."""
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


Look = tuple[str, str]
"""Name of a colour and a marker, each empty if none is stated."""


def styles(labels: Iterable[str], stated: Mapping[str, Look]) -> dict[str, Style]:
    """Return a style per label, which does not depend on the labels that it is shown with, unless it is chosen here.

    Parameters
    ----------
    labels
        Of those that are shown.
    stated
        Label -> look of all that state one, shown or not. Of two that state the same, the later gets another marker. A label
        that states none gets a colour by its checksum; of several, those later by the alphabet take what is used least.
    """
    given, count = set(labels), len(COLOURS)
    looks: dict[str, tuple[int, int]] = {}

    def give(label: str, colour: int, shape: int) -> None:
        """Give ``label`` this colour, and the first shape from ``shape`` on that none has with it."""
        shapes = [(shape + k) % count for k in range(count)]
        looks[label] = colour, next((each for each in shapes if (colour, each) not in looks.values()), shape)

    for label, (name, marker) in stated.items():
        if name:
            stated_slot = COLOUR_NAMES.index(name)
            give(label, stated_slot, MARKERS.index(marker) if marker else stated_slot)
    used = [0] * count
    for label in sorted(given - looks.keys()):
        # Not hash(), which differs from process to process
        wanted = zlib.crc32(utf8(label)) % count
        slot = min(((wanted + k) % count for k in range(count)), key=used.__getitem__)
        used[slot] += 1
        give(label, slot, slot)
    return {
        label: Style(colour=COLOURS[colour], dashes=DASHES[shape], marker=MARKERS[shape], slot=colour)
        for label, (colour, shape) in looks.items()
        if label in given
    }


def colour_rules() -> str:
    """Return the CSS custom properties ``--run-0`` and so on, for both backgrounds."""

    def rules(colours: tuple[str, ...]) -> str:
        return " ".join(f"--run-{slot}: {colour};" for slot, colour in enumerate(colours))

    return f":root {{ {rules(COLOURS)} }}\n:root[data-theme=dark] {{ {rules(DARK_COLOURS)} }}"
