"""The command `track`: from a film to a table of points, without a click."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from looping_pendulum.cli.common import AsJson, Quiet
from looping_pendulum.cli.file_kinds import takes
from looping_pendulum.cli.terminal import ProgressBars, say, say_prose, show_json


def track(
    films: Annotated[
        list[Path], typer.Argument(metavar="FILM ...", help="Films of a camera that stands still.", callback=takes("film"))
    ],
    free_length: Annotated[
        str | None,
        typer.Option(metavar="LENGTH", help='String from the rod to the light mass at the release: "58 cm +/- 1 mm".'),
    ] = None,
    rod_radius: Annotated[str, typer.Option(metavar="LENGTH", help="Radius of the rod: half its diameter.")] = "6.25 mm",
    frame_rate: Annotated[
        str | None, typer.Option(metavar="RATE", help='True rate of slow motion whose file does not state it: "240 Hz".')
    ] = None,
    scale: Annotated[
        str | None, typer.Option(metavar="RULE", help='A rule instead of the free length: "640,120 640,920 = 1 m".')
    ] = None,
    light: Annotated[str | None, typer.Option(metavar="X,Y@FRAME", help="Show the light mass in a frame [pixels].")] = None,
    heavy: Annotated[
        str | None, typer.Option(metavar="X,Y@FRAME", help="Show the heavy mass in a frame that has it moving.")
    ] = None,
    rod: Annotated[str | None, typer.Option(metavar="X,Y", help="Show the centre of the rod's end [pixels].")] = None,
    start: Annotated[
        str | None, typer.Option("--from", metavar="TIME", help='Read the film from this time on: "1.5 s".')
    ] = None,
    end: Annotated[str | None, typer.Option("--to", metavar="TIME", help="Read it up to this time.")] = None,
    region: Annotated[
        str | None, typer.Option(metavar="X,Y X,Y", help="Look for the masses in this rectangle only [pixels].")
    ] = None,
    readout: Annotated[
        str | None, typer.Option(metavar="TIME", help='Of a rolling shutter, from the first row to the last: "10 ms".')
    ] = None,
    plain: Annotated[bool, typer.Option("--plain", help="Follow whatever moves, without physics.")] = False,
    overlay: Annotated[bool, typer.Option("--overlay", help="Also write the film with the marks on it.")] = False,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for the files; default: beside each film.")] = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Track the masses in films, and write tables of points that `identify` reads (docs/film.md).

    For each film it writes NAME.csv, NAME.film.json (what the film is, where scale and rod come from) and NAME.track.png, the
    sheet by which you check it in ten seconds; and it prints the lines of a study for this trial. No click is needed: the
    string's declared length ties both masses. Where that fails, the message says which option helps.

    looping-pendulum track trial.mp4 --free-length "58 cm +/- 1 mm"
    """
    from looping_pendulum.files import prepare_output_folder
    from looping_pendulum.film import options, output
    from looping_pendulum.film.plain import follow_all
    from looping_pendulum.film.track import TrackSettings

    length, error = (None, 0.0) if free_length is None else options.read_length("--free-length", free_length)
    settings = TrackSettings(
        free_length=length,
        free_length_error=error,
        rod_radius=options.read_length("--rod-radius", rod_radius)[0],
        frame_rate=None if frame_rate is None else options.read_rate("--frame-rate", frame_rate),
        scale=None if scale is None else options.read_rule("--scale", scale),
        light=None if light is None else options.read_shown("--light", light),
        heavy=None if heavy is None else options.read_shown("--heavy", heavy),
        rod=None if rod is None else options.read_place("--rod", rod),
        first=None if start is None else options.read_quantity("--from", start, "s", "1.5 s"),
        last=None if end is None else options.read_quantity("--to", end, "s", "3 s"),
        readout=None if readout is None else options.read_quantity("--readout", readout, "s", "10 ms"),
        region=None if region is None else options.read_region("--region", region),
    )
    listed = []
    for film in films:
        files = output.files_of(film, out)
        prepare_output_folder(files.table.parent, files=(files.table.name, files.facts.name, files.sheet.name))
        with ProgressBars() as bars:
            if plain:
                output.refuse_foreign_table(files)
                things = follow_all(film, settings, bars.update)
                written = output.write_plain(things, files)
                for name, points in things.things.items():
                    say(f"{name}: {len(points.frame)} frames, from {points.frame[0]} to {points.frame[-1]}")
                found = output.facts(things)
            else:
                tracked, written = output.track_and_write(film, settings, files, bars.update, overlay=overlay)
                say_prose(output.sentence(tracked))
                if doubt := output.doubt(tracked):
                    say(f"warning: {doubt}")
                say("Check the marks on the contact sheet. In a study:")
                say(output.study_lines(tracked, Path(film).name if out is None else files.table.name))
                found = output.facts(tracked)
        say(f"wrote {', '.join(map(str, written))}")
        listed.append(found | {"files": [str(path) for path in written]})
    show_json({"films": listed})
