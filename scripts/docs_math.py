"""MkDocs hook: replace TeX between dollar signs by an inline SVG, drawn by matplotlib; so the site needs no script and no font.

The TeX itself is the picture's label for screen readers.
"""

import html
import re
from functools import cache

import numpy as np
from matplotlib.font_manager import FontProperties
from matplotlib.path import Path
from matplotlib.textpath import text_to_path

FONT_SIZE = 16.0
"""Font size at which formulas are laid out; the page scales them by its own em."""
RELATIVE_SIZE = 1.1
"""Size of a formula relative to the text around it; its letters are smaller than the page's at the same size."""
CODE = re.compile(r"(```.*?```|~~~.*?~~~|`[^`\n]*`)", re.DOTALL)
DISPLAY = re.compile(r"\$\$(.+?)\$\$", re.DOTALL)
INLINE = re.compile(r"(?<![\\$\w])\$(?!\s)([^$\n]*(?:\n[^$\n]+)?[^$\s])\$(?!\w)")
SHORT_FRACTION = re.compile(r"\\[td]?frac(\d)(\d)")
MATPLOTLIB_NAMES = {r"\text": r"\mathrm", r"\tfrac": r"\frac", r"\dfrac": r"\frac", r"\lvert": "|", r"\rvert": "|"}
"""TeX that matplotlib does not know -> its equivalent in matplotlib."""
SVG_COMMANDS = {Path.MOVETO: "M", Path.LINETO: "L", Path.CURVE3: "Q", Path.CURVE4: "C"}


def on_page_markdown(markdown: str, **_: object) -> str:
    """Replace the formulas of a page, except those in code."""
    parts = CODE.split(markdown)
    parts[::2] = [_with_formulas(part) for part in parts[::2]]
    return "".join(parts)


def _with_formulas(text: str) -> str:
    text = DISPLAY.sub(lambda m: f'\n<div class="formula">{svg(m[1])}</div>\n', text)
    return INLINE.sub(lambda m: svg(m[1]), text)


@cache
def svg(tex: str) -> str:
    """Return the picture of a formula, its baseline on that of the text around it."""
    tex = " ".join(tex.split())
    tex_for_matplotlib = SHORT_FRACTION.sub(r"\\frac{\1}{\2}", tex)
    for name, matplotlib_name in MATPLOTLIB_NAMES.items():
        tex_for_matplotlib = tex_for_matplotlib.replace(name, matplotlib_name)
    font = FontProperties(size=FONT_SIZE, math_fontfamily="stix")
    vertices, codes = text_to_path.get_text_path(font, f"${tex_for_matplotlib}$", ismath=True)
    width, height, depth = text_to_path.get_text_width_height_descent(f"${tex_for_matplotlib}$", font, ismath=True)
    scale = FONT_SIZE / text_to_path.FONT_SCALE
    svg_path = _svg_path(Path(np.array(vertices) * scale, codes)) if len(vertices) else ""
    box = f"-0.5 {depth - height - 0.5:.2f} {width + 1:.2f} {height + 1:.2f}"
    em = FONT_SIZE / RELATIVE_SIZE
    size = f"width:{(width + 1) / em:.3f}em;height:{(height + 1) / em:.3f}em;vertical-align:{-(depth + 0.5) / em:.3f}em"
    label = html.escape(tex, quote=True)
    return f'<svg class="tex" role="img" aria-label="{label}" viewBox="{box}" style="{size}"><path d="{svg_path}"/></svg>'


def _svg_path(path: Path) -> str:
    """Return a path in SVG's notation, with y reversed, since SVG's y axis points down."""
    commands = []
    for points, code in path.iter_segments(simplify=False, curves=True):
        if code == Path.CLOSEPOLY:
            commands.append("Z")
        else:
            commands.append(
                SVG_COMMANDS[code] + " ".join(f"{v:.2f}" for v in points * [(1, -1)[i % 2] for i in range(len(points))])
            )
    return "".join(commands)
