"""Runs the demonstrations, which are the scripts in this folder, and makes one page of what they print and draw.

A script asks a question in its docstring, prints what it finds, saves one picture, and asserts each claim of its answer.
"""

from __future__ import annotations

import ast
import base64
import contextlib
import io
import runpy
import traceback
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from looping_pendulum.errors import HarnessError
from looping_pendulum.pages.shell import page

SCRIPTS = Path(__file__).parent
LEAD = (
    "Every engine that rebuilds the looping pendulum leaves something out. Nine short experiments show what, each with a "
    "question and a guess before its answer. Each is a script that asserts what it says: read it, change it, and run it again."
)


@dataclass(frozen=True)
class Demonstration:
    """One of the scripts."""

    script: Path

    @property
    def name(self) -> str:
        """Name of the script and of its picture, "04_polygon"."""
        return self.script.stem

    @property
    def picture(self) -> str:
        """Name of the file that the script saves."""
        return f"{self.name}.png"

    @cached_property
    def source(self) -> str:
        """Text of the script."""
        return self.script.read_text(encoding="utf-8")

    @cached_property
    def title(self) -> str:
        """First line of its docstring."""
        return self._paragraphs[0].rstrip(".")

    @cached_property
    def words(self) -> dict[str, str]:
        """Paragraphs of its docstring by their first word: "Question", "Guess", "Experiment", "Change it"."""
        parts = [paragraph.partition(": ") for paragraph in self._paragraphs[1:]]
        return {heading: text for heading, _, text in parts}

    @cached_property
    def _paragraphs(self) -> list[str]:
        docstring = ast.get_docstring(ast.parse(self.source)) or self.name
        return [" ".join(paragraph.split()) for paragraph in docstring.split("\n\n")]


@dataclass(frozen=True, kw_only=True)
class DemonstrationRun:
    """What a script printed and drew."""

    demonstration: Demonstration
    printed: str
    """Up to the first claim that did not hold, if there is one."""
    false_claim: str = ""
    """That claim, as the script has it; empty if all hold."""
    caption: str = ""
    """Title of its picture, which says what it shows."""
    folder: Path
    """Where its picture is."""

    @property
    def picture(self) -> str:
        """The picture as a data URI; empty if a claim did not hold before it was drawn."""
        file = self.folder / self.demonstration.picture
        return f"data:image/png;base64,{base64.b64encode(file.read_bytes()).decode()}" if file.exists() else ""


def demonstrations() -> list[Demonstration]:
    """Return all demonstrations in their order."""
    return [Demonstration(script) for script in sorted(SCRIPTS.glob("[0-9]*.py"))]


def find_demonstrations(names: Sequence[str]) -> list[Demonstration]:
    """Return the demonstrations of these names, "4", "polygon" or "04_polygon"; all if there are none.

    Raises
    ------
    HarnessError
        If a name is unknown.
    """
    known: dict[str, Demonstration] = {}
    for one in demonstrations():
        number, _, words = one.name.partition("_")
        known |= {one.name: one, words: one, number: one, number.lstrip("0"): one}
    for name in names:
        if name not in known:
            raise HarnessError(
                f"found no demonstration {name!r}, needed one of {', '.join(one.name for one in demonstrations())}"
            )
    return [known[name] for name in names] or demonstrations()


def run_demonstration(demonstration: Demonstration, folder: Path) -> DemonstrationRun:
    """Run a script, which saves its picture in ``folder``."""
    import matplotlib.pyplot as plt

    printed = io.StringIO()
    false_claim = ""
    plt.switch_backend("agg")  # no window, and no need of a screen
    with contextlib.chdir(folder), contextlib.redirect_stdout(printed):
        try:
            runpy.run_path(str(demonstration.script), run_name="__main__")
        except AssertionError as error:
            false_claim = traceback.extract_tb(error.__traceback__)[-1].line or "an assertion"
        finally:
            caption = plt.gca().get_title()
            plt.close("all")
    return DemonstrationRun(
        demonstration=demonstration,
        printed=printed.getvalue().strip("\n"),
        false_claim=false_claim,
        caption=caption,
        folder=folder,
    )


def render(runs: Sequence[DemonstrationRun]) -> str:
    """Return one HTML page of all runs, which loads no other file."""
    return page(
        "looping_pendulum.demonstrations",
        "demonstrations.html",
        title="Looping pendulum: what each model assumes",
        lead=LEAD,
        runs=runs,
    )
