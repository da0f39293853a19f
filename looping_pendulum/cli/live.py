"""The command that writes the live page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from looping_pendulum.cli.common import load_scenario
from looping_pendulum.cli.terminal import note, say


def live(
    scenario: Annotated[
        str, typer.Argument(metavar="[SCENARIO]", help="Shipped scenario, or path of a YAML file, with which it starts.")
    ] = "ten_to_one",
    out: Annotated[Path, typer.Option(metavar="FILE", help="File to write.")] = Path("live.html"),
    results: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder with results of `compare`; default: report/SCENARIO.")
    ] = None,
    no_open: Annotated[bool, typer.Option("--no-open", help="Write the page, but do not open it in a browser.")] = False,
) -> None:
    """Write a web page in which the exact model runs while you drag its masses and sliders; it works offline.

    One file, which needs no Python and no network: send it, or open it from a stick. Drop a file of tracked points on it to see
    them over the motion. Where DIR has results of `compare` for this scenario, the engines' runs move beside it; `demo` makes
    them, if need be.

    looping-pendulum live two_to_one
    """
    from looping_pendulum.compare.trajectories import stored_result
    from looping_pendulum.errors import HarnessError
    from looping_pendulum.files import prepare_output_folder
    from looping_pendulum.live.write import write
    from looping_pendulum.teaching import demo

    chosen = load_scenario(scenario)
    prepare_output_folder(out.parent, files=(out.name,))  # refuse an unusable folder before the work, not after it
    folder = results or Path("report") / chosen.name
    result = stored_result(folder, chosen, engines=None)
    if result is not None:
        demo.write(result, out)
        say(f"wrote {out}, with the runs of {', '.join(map(result.short_name, result.engines))} from {folder}")
    elif results is not None:
        raise HarnessError(
            f"--results: found no result of this scenario in {folder}, needed a folder that `compare` wrote; "
            f"write for example `looping-pendulum compare {scenario} --out {folder}` first"
        )
    else:
        write(out, chosen)
        say(f"wrote {out}")
        note(f"no engines beside it: {folder} has no result of this scenario; `looping-pendulum compare {scenario}` makes one")
    if not no_open and not demo.show(out):
        say(f"no browser was found; open {out.resolve().as_uri()} in one")
