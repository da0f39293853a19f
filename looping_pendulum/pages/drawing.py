"""What all figures that matplotlib draws have in common. It is imported on use, since that takes a second."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Literal

from looping_pendulum.files import utf8

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_LABEL_LENGTH = 50
"""Characters of a name that a figure shows: a longer one would leave no room for the axes."""


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure [inches] that makes room for the labels of its axes."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def png(figure: Figure, dpi: float | Literal["figure"] = "figure") -> bytes:
    """Return the figure as a PNG file; ``dpi``: pixels per inch, "figure": its own."""
    out = io.BytesIO()
    # No version, so that the same figure has the same bytes
    figure.savefig(out, format="png", metadata={"Software": None}, dpi=dpi)
    return out.getvalue()


def without_mathtext(text: str) -> str:
    """Return ``text`` so that matplotlib shows it as it is.

    It takes what stands between two $ for a formula, and no half characters.
    """
    shown = utf8(text).decode()
    return (shown if len(shown) <= MAX_LABEL_LENGTH else f"{shown[:MAX_LABEL_LENGTH]}...").replace("$", r"\$")
