"""The command `track`: from a film to a table of points, without a click."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from looping_pendulum.cli.common import AsJson, Quiet
from looping_pendulum.cli.file_kinds import takes
from looping_pendulum.cli.quantities import quantity
from looping_pendulum.cli.terminal import ProgressBars, say, say_prose, show_json
from looping_pendulum.errors import shorten
from looping_pendulum.measured.film import FilmError

if TYPE_CHECKING:
    from looping_pendulum.measured.film.record import ScaleRule


def track(
    films: Annotated[
        list[Path], typer.Argument(metavar="FILM ...", help="Films of a camera that stands still.", callback=takes("film"))
    ],
    free_length: Annotated[
        str | None,
        typer.Option(metavar="LENGTH", help='String from the rod to the light mass at the release: "58 cm +/- 1 mm".'),
    ] = None,
    rod_radius: Annotated[
        str, typer.Option(metavar="LENGTH", help='Radius of the rod, half its diameter: "6.25 mm +/- 1 %".')
    ] = "6.25 mm +/- 50 %",
    frame_rate: Annotated[
        float | None,
        typer.Option(
            metavar="RATE",
            parser=quantity("Hz", least="0.01 Hz"),
            help='True rate of slow motion whose file does not state it: "240 Hz".',
        ),
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
        float | None,
        typer.Option(
            "--from", metavar="TIME", parser=quantity("s", least="0 s"), help='Read the film from this time on: "1.5 s".'
        ),
    ] = None,
    end: Annotated[
        float | None, typer.Option("--to", metavar="TIME", parser=quantity("s", least="0 s"), help="Read it up to this time.")
    ] = None,
    region: Annotated[
        str | None, typer.Option(metavar="X,Y X,Y", help="Look for the masses in this rectangle only [pixels].")
    ] = None,
    readout: Annotated[
        float | None,
        typer.Option(
            metavar="TIME",
            parser=quantity("s", least="0 s"),
            help='Of a rolling shutter, from the first row to the last: "10 ms".',
        ),
    ] = None,
    still: Annotated[bool, typer.Option("--still", help="Take the camera as standing still.")] = False,
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
    from looping_pendulum.measured.film import output, words
    from looping_pendulum.measured.film.moving import follow_all
    from looping_pendulum.measured.film.record import Shown, TrackSettings, files_of, record_tree
    from looping_pendulum.teaching.new_file import estimate_of

    length = None if free_length is None else estimate_of("free_length", free_length)
    radius = estimate_of("rod_radius", rod_radius)
    light_shown, heavy_shown = numbers_of("--light", light, SHOWN), numbers_of("--heavy", heavy, SHOWN)
    place, corners = numbers_of("--rod", rod, "790,262"), numbers_of("--region", region, "100,80 1200,700")
    if corners is not None and not (corners[0] < corners[2] and corners[1] < corners[3]):
        raise FilmError(f"--region: found '{region}', needed the left upper corner first; write for example 100,80 1200,700")
    settings = TrackSettings(
        free_length=None if length is None else length.value,
        free_length_error=0.0 if length is None else length.sigma or 0.0,
        rod_radius=radius.value,
        rod_radius_error=radius.sigma or 0.0,
        frame_rate=frame_rate,
        scale=None if scale is None else rule_of(scale),
        light=None if light_shown is None else Shown(light_shown[0], light_shown[1], int(light_shown[2])),
        heavy=None if heavy_shown is None else Shown(heavy_shown[0], heavy_shown[1], int(heavy_shown[2])),
        rod=None if place is None else (place[0], place[1]),
        first=start,
        last=end,
        readout=readout,
        region=None if corners is None else (int(corners[0]), int(corners[1]), int(corners[2]), int(corners[3])),
        still=still,
    )
    listed = []
    for film in films:
        files = files_of(film, out)
        prepare_output_folder(files.table.parent, files=(files.table.name, files.record.name, files.sheet.name))
        with ProgressBars() as bars:
            if plain:
                output.refuse_foreign_table(files)
                things = follow_all(film, settings, bars.update)
                written = output.write_plain(things, files)
                for name, points in things.things.items():
                    say(f"{name}: {len(points.frame)} frames, from {points.frame[0]} to {points.frame[-1]}")
                facts, tree = things.facts, record_tree(things)
            else:
                found, written = output.track_and_write(film, settings, files, bars.update, overlay=overlay)
                say_prose(words.sentence(found))
                for warning in (*words.contradictions(found), *filter(None, [words.doubt(found)])):
                    say_prose(f"warning: {warning}")
                say("Check the marks on the contact sheet. In a study:")
                say(words.study_lines(found, Path(film).name if out is None else files.table.name))
                facts, tree = found.facts, record_tree(found)
        for note in words.film_notes(facts):
            say_prose(f"note: {note}")
        say(f"wrote {', '.join(map(str, written))}")
        listed.append(tree | {"files": [str(path) for path in written]})
    show_json({"films": listed})


SHOWN = "343,438@72"
"""Example of a place in a frame, as it is typed."""
NUMBER = r"(\d{1,7}(?:\.\d{1,6})?)"


def numbers_of(option: str, text: str | None, example: str) -> tuple[float, ...] | None:
    """Return the numbers of pixels and frames in a text of the same shape as the ``example``; None of none.

    Raises
    ------
    FilmError
        If it has another shape.
    """
    if text is None:
        return None
    match = re.fullmatch(re.sub(r"\d+", lambda _: NUMBER, example), " ".join(text.split()))
    if match is None:
        raise FilmError(f"{option}: found '{shorten(text)}', needed pixels; write for example {option} \"{example}\"")
    return tuple(float(number) for number in match.groups())


def rule_of(text: str) -> ScaleRule:
    """Return the rule of --scale, "640,120 640,920 = 1 m".

    Raises
    ------
    FilmError
        If it is none.
    """
    from looping_pendulum.measured.film.record import ScaleRule
    from looping_pendulum.teaching.new_file import NewFileError, estimate_of

    places, _, length = text.partition("=")
    try:
        x, y, u, v = numbers_of("--scale", places, "640,120 640,920") or ()
        rule = ScaleRule((x, y), (u, v), estimate_of("free_length", length).value)
    except (FilmError, NewFileError):
        rule = None
    if rule is None or not rule.pixels:
        needed = 'two places in pixels and their distance; write for example --scale "640,120 640,920 = 1 m"'
        raise FilmError(f"--scale: found '{shorten(text)}', needed {needed}")
    return rule
