"""Puts a Matplotlib figure into a page as SVG whose colours follow the page's ground, light or dark."""

from __future__ import annotations

import io
import re

import matplotlib as mpl
from markupsafe import Markup
from matplotlib.figure import Figure

from looping_pendulum.pages.palette import COLOURS

PAGE_COLOURS = {"#000000": "var(--reference)", "#ffffff": "var(--ground)"} | {
    colour.lower(): f"var(--run-{slot})" for slot, colour in enumerate(COLOURS)
}
"""Colour of a figure on white -> what stands for it in a page's style."""
GREY = re.compile(r"#([0-9a-f]{2})\1\1\b")


def themed_svg(figure: Figure) -> Markup:
    """Return ``figure`` as an SVG element in the page's colours, without a ground of its own; equal figures give equal text."""
    out = io.StringIO()
    # Text as text, so that it is read aloud and takes the page's colour; the salt makes the names of its parts repeatable
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "looping-pendulum"}):
        figure.savefig(out, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    svg = out.getvalue()
    svg = svg[svg.index("<svg") :].replace("<svg ", '<svg fill="var(--ink)" aria-hidden="true" ', 1)
    # Only in style attributes: elsewhere the same characters may be text
    return Markup(re.sub(r'style="[^"]*"', lambda style: _in_page_colours(style[0]), svg))


def _in_page_colours(style: str) -> str:
    for colour, variable in PAGE_COLOURS.items():
        style = style.replace(colour, variable)
    # Other greys are grids and guides
    return GREY.sub("var(--line)", style)
