"""Draw docs/img/power.png from `docs/data/calibration.json`: what `identify` said of each blind study with one hidden effect.

`python -m benchmarks --only calibration` measures it.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from looping_pendulum.files import write_atomically
from looping_pendulum.pages.drawing import legend_below, make_figure, png
from looping_pendulum.pages.palette import COLOURS

DOCS = Path(__file__).parents[1] / "docs"
LOOKS = {
    "right": ("named", "o", COLOURS[2]),
    "tied": ("tied with others", "s", COLOURS[0]),
    "none": ("nothing is named", "x", "0.55"),
    "wrong": ("another is named", "v", COLOURS[1]),
}
"""Judgement -> its words, marker and colour."""
SMALLEST, LARGEST = 0.05, 200.0
"""Sizes over the smallest visible one beyond which a study is drawn at the edge."""
JITTER = 0.25
"""Largest shift of a marker in its row, so that studies of the same size do not hide each other."""


def figure(studies: list[dict[str, Any]]) -> Figure:
    """Draw each study as a marker in the row of its effect, by the effect's size over the smallest visible one."""
    known = [study for study in studies if study["visibility"] is not None]
    effects = sorted({study["effect"] for study in known}, reverse=True)
    picture, (axes,) = make_figure(8.0, 1.6 + 0.26 * len(effects))
    shifts = np.random.default_rng(0).uniform(-JITTER, JITTER, len(known))
    for judgement, (words, marker, colour) in LOOKS.items():
        chosen = [(study, shift) for study, shift in zip(known, shifts, strict=True) if study["judgement"] == judgement]
        sizes = [np.clip(study["visibility"], SMALLEST, LARGEST) for study, _ in chosen]
        rows = [effects.index(study["effect"]) + shift for study, shift in chosen]
        axes.plot(sizes, rows, ls="none", marker=marker, ms=5.5, color=colour, label=f"{words} ({len(chosen)})")
    axes.axvline(1.0, color="black", lw=1.0)
    axes.set_yticks(range(len(effects)), [name.replace("_", " ") for name in effects])
    axes.set(xscale="log", xlabel="size of the hidden effect over the smallest that the data could show")
    axes.set_title(f"One hidden effect in {len(known)} blind studies: what the search says of it")
    legend_below(picture, columns=2)
    return picture


def main() -> None:
    """Write the figure."""
    rates = json.loads((DOCS / "data" / "calibration.json").read_text(encoding="utf-8"))["rates"]
    write_atomically(DOCS / "img" / "power.png", png(figure(rates["summary"]["single"]["each"])))


if __name__ == "__main__":
    main()
