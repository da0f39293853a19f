"""Pages of demonstrations that were run: Markdown with a figure beside it, and one self-contained HTML file each."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from looping_pendulum.files import write_atomically
from looping_pendulum.pages.drawing import png, themed_svg
from looping_pendulum.pages.markdown import table
from looping_pendulum.pages.palette import COLOURS, DASHES, MARKERS
from looping_pendulum.pages.shell import page
from looping_pendulum.teaching.demonstrations.chains import POLYGON, STRETCHY
from looping_pendulum.teaching.demonstrations.demonstration import Demonstration, DemonstrationError, DemonstrationResult
from looping_pendulum.teaching.demonstrations.friction import CONSTANT_FRICTION, CREEP, FORGOTTEN_TURNS, TENDON_WITHOUT_FRICTION
from looping_pendulum.teaching.demonstrations.reference_model import BREAK_AWAY, DRAG, STRING_ON_STRING

DEMONSTRATIONS: Mapping[str, Demonstration] = {
    d.name: d
    for d in (
        TENDON_WITHOUT_FRICTION,
        CONSTANT_FRICTION,
        FORGOTTEN_TURNS,
        POLYGON,
        STRETCHY,
        CREEP,
        DRAG,
        BREAK_AWAY,
        STRING_ON_STRING,
    )
}
"""Every demonstration by name, in the order of the index."""
HERE = "looping_pendulum.teaching"
LEAD = (
    "Every engine that rebuilds the looping pendulum leaves something out. Short experiments show what, each with a question "
    "and a guess before its answer. The numbers come from the run that wrote the page, and each sentence of an answer has a "
    "test on them: one that they do not bear out says so."
)
NOT_BORNE_OUT = "Not borne out by this run:"
"""Words before a claim whose test failed."""
MADE_WITH = "Made with "
"""Start of the line with the versions, which differs from installation to installation."""


def find_demonstrations(names: Sequence[str]) -> tuple[Demonstration, ...]:
    """Return the demonstrations of these names, or all if there are none.

    Raises
    ------
    DemonstrationError
        If a name is unknown.
    """
    for name in names:
        if name not in DEMONSTRATIONS:
            near = difflib.get_close_matches(name, DEMONSTRATIONS, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ";"
            raise DemonstrationError(f"found no demonstration {name!r}{hint} known: {', '.join(DEMONSTRATIONS)}")
    return tuple(DEMONSTRATIONS[name] for name in names) or tuple(DEMONSTRATIONS.values())


def write_pages(result: DemonstrationResult, folder: Path, *, with_html: bool = True) -> tuple[Path, ...]:
    """Write NAME.png, NAME.md and, with ``with_html``, the self-contained NAME.html; return their paths."""
    name = result.demonstration.name
    files: dict[str, str | bytes] = {f"{name}.png": png(drawing(result), dpi=100), f"{name}.md": markdown(result)}
    if with_html:
        files[f"{name}.html"] = html(result)
    for file, content in files.items():
        write_atomically(folder / file, content)
    return tuple(folder / file for file in files)


def write_index(folder: Path) -> Path:
    """Write index.html, which lists the pages in ``folder``; return its path."""
    here = [d for d in DEMONSTRATIONS.values() if (folder / f"{d.name}.html").exists()]
    title = "Looping pendulum: What each model assumes"
    write_atomically(folder / "index.html", page(HERE, "demonstrations.html", title=title, lead=LEAD, demonstrations=here))
    return folder / "index.html"


def index() -> str:
    """Return the list of all demonstrations as Markdown."""
    rows = [[f"[{d.title}]({d.name}.md)", d.question] for d in DEMONSTRATIONS.values()]
    return (
        f"# What each model assumes\n\n{LEAD}\n\n"
        f"{table(['demonstration', 'question'], rows, left=2)}\n"
        "```sh\n"
        "looping-pendulum demonstrations --out demonstrations\n"
        "looping-pendulum demonstrations polygon --out demonstrations\n"
        "```\n\n"
        "The first writes all pages and `index.html`, which opens offline.\n"
    )


def markdown(result: DemonstrationResult) -> str:
    """Return the page as Markdown, which shows NAME.png."""
    d = result.demonstration
    answer = "\n\n".join(s.text if s.holds else f"**{NOT_BORNE_OUT}** {s.text}" for s in result.answer)
    commands = "\n".join(d.commands)
    return (
        f"# {d.title}\n\n"
        f"**Question.** {d.question}\n\n"
        f"**Guess.** {d.guess} What is yours?\n\n"
        f"## Experiment\n\n{d.experiment}\n\n"
        f"{table(result.header, [list(row) for row in result.rows])}\n"
        f"![{d.picture.caption}]({d.name}.png)\n\n*{d.picture.caption}*\n\n"
        f"## Answer\n\n{answer}\n\n"
        f"## See for yourself\n\n{commands_words(d)}\n\n```sh\n{start(d)}\n{commands}\n```\n\n"
        f"```yaml\n{d.change}\n```\n\n"
        f"{provenance(result)}\n"
    )


def commands_words(d: Demonstration) -> str:
    """Return the sentence that explains the commands and the lines of YAML."""
    return f"Copy the scenario `{d.scenario}`, change the lines below in the copy, and run it."


def start(d: Demonstration) -> str:
    """Return the command that copies the scenario."""
    return f"looping-pendulum scenarios {d.scenario} > mine.yaml"


def provenance(result: DemonstrationResult) -> str:
    """Return the sentence that says which command and which versions wrote the page."""
    versions = ", ".join(f"{name} {version}" for name, version in result.versions.items())
    return f"{MADE_WITH}{versions}, by `looping-pendulum demonstrations {result.demonstration.name}`."


def html(result: DemonstrationResult) -> str:
    """Return the page as one HTML file that loads no other file; its figure has the colours of the page's ground."""
    d = result.demonstration
    return page(
        HERE,
        "demonstration.html",
        title=f"Looping pendulum: {d.title}",
        d=d,
        result=result,
        not_borne_out=NOT_BORNE_OUT,
        picture=themed_svg(drawing(result)),
        copy=commands_words(d).replace("`", ""),
        start=start(d),
        provenance=provenance(result).replace("`", ""),
    )


def drawing(result: DemonstrationResult) -> Figure:
    """Draw the figure: the reference in black, the others in colours, with dashes or markers that differ as well."""
    picture = result.demonstration.picture
    fig = Figure(figsize=(7.2, 4.0), layout="constrained")
    FigureCanvasAgg(fig)
    axes = fig.subplots()
    others = 0
    for curve in result.curves:
        if curve.reference:
            axes.plot(curve.x, curve.y, color="black", lw=3.0, alpha=0.85, label=curve.label, zorder=2)
            continue
        style: dict[str, Any] = {"color": COLOURS[others % len(COLOURS)], "lw": 1.6, "zorder": 3 + others}
        if curve.points:
            axes.plot(curve.x, curve.y, linestyle="", marker=MARKERS[others % len(MARKERS)], ms=7, label=curve.label, **style)
        else:
            axes.plot(curve.x, curve.y, dashes=DASHES[others % len(DASHES)], label=curve.label, **style)
        others += 1
    axes.set(xlabel=picture.x, ylabel=picture.y)
    axes.grid(visible=True, color="0.9", lw=0.6)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    fig.legend(loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    return fig
