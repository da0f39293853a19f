"""The command that writes the live page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from looping_pendulum.cli.common import load_scenario
from looping_pendulum.cli.terminal import say


def live(
    scenario: Annotated[
        str, typer.Argument(metavar="[SCENARIO]", help="Shipped scenario, or path of a YAML file, with which it starts.")
    ] = "ten_to_one",
    out: Annotated[Path, typer.Option(metavar="FILE", help="File to write.")] = Path("live.html"),
    no_open: Annotated[bool, typer.Option("--no-open", help="Write the page, but do not open it in a browser.")] = False,
) -> None:
    """Write a web page in which the exact model runs while you drag its masses and sliders; it works offline.

    One file, which needs no Python and no network: send it, or open it from a stick. Drop a file of tracked points on it to see
    them over the motion.

    looping-pendulum live two_to_one
    """
    from looping_pendulum.files import prepare_output_folder
    from looping_pendulum.live.write import write
    from looping_pendulum.teaching.demo import show

    chosen = load_scenario(scenario)
    prepare_output_folder(out.parent, files=(out.name,))  # refuse an unusable folder before the work, not after it
    write(out, chosen)
    say(f"wrote {out}")
    if not no_open and not show(out):
        say(f"no browser was found; open {out.resolve().as_uri()} in one")
