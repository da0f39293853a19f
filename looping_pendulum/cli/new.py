"""The commands `new scenario` and `new study`: write a commented file to run, or to fill in."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from looping_pendulum.cli.common import Force, TrackFilms, scenario_names
from looping_pendulum.cli.file_kinds import takes
from looping_pendulum.cli.terminal import ProgressBars, say
from looping_pendulum.cli.usage import App
from looping_pendulum.installation import command_line

ENDINGS = (".yaml", ".yml")

new = App(
    help="""Write a commented file: a scenario to run, or a study of your films and tables to fill in.

    looping-pendulum new study first.mp4 second.csv
    """,
)


def _option(what: str, *names: str) -> Any:
    return typer.Option(*names, metavar="VALUE", help=what)


@new.command()
def scenario(
    context: typer.Context,
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the scenario, and of its file NAME.yaml.")],
    like: Annotated[
        str,
        typer.Option(
            metavar="SCENARIO",
            help="Scenario (name or file) with all other values.",
            autocompletion=scenario_names,
            callback=takes("scenario"),
        ),
    ] = "ten_to_one",
    light_mass: Annotated[str | None, _option('Mass that loops round the rod: "12 g".')] = None,
    heavy_mass: Annotated[str | None, _option('Mass that falls: "120 g".')] = None,
    rod_radius: Annotated[str | None, _option('Radius of the rod: "6.25 mm".')] = None,
    rod_diameter: Annotated[str | None, _option('Its diameter instead: "12.5 mm".')] = None,
    free_length: Annotated[str | None, _option('String from the rod to the light mass: "58 cm".')] = None,
    hanging_length: Annotated[str | None, _option('String from the rod to the heavy mass: "5 cm".')] = None,
    release_angle: Annotated[str | None, _option('Angle of the string: "90 deg" is level, "180 deg" straight down.')] = None,
    kinetic_friction: Annotated[
        str | None, _option("Friction coefficient of the string on the rod: 0.34.", "--friction")
    ] = None,
    duration: Annotated[str | None, _option('How long to watch: "1.05 s".')] = None,
    force: Force = False,
) -> None:
    """Write a scenario, a trial to run, with a comment on each value.

    looping-pendulum new scenario my_rod --light-mass "12 g" --rod-diameter "10 mm"
    """
    from looping_pendulum.files import prepare_output_file
    from looping_pendulum.scenarios.loader import json_schema
    from looping_pendulum.teaching.new_file import new_scenario

    path = Path(name if name.endswith(ENDINGS) else f"{name}.yaml")
    prepare_output_file(path, force=force, option="NAME")
    given = {quantity: values[0] for quantity, values in _given(context).items()}
    _write(path, new_scenario(path.stem.removesuffix(".scenario").replace("_", " "), like=like, given=given))
    _write_schema(path, "scenario", json_schema)
    say(f"next: {command_line('run', path)}")


@new.command()
def study(
    context: typer.Context,
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE ...",
            help="Films, or tables of tracked points: one per trial.",
            callback=takes("film", "table of numbers"),
        ),
    ],
    out: Annotated[Path, typer.Option(metavar="STUDY.yaml", help="Where to write the study.")] = Path("my_study.yaml"),
    light_mass: Annotated[str | None, _option('Mass that loops round the rod: "20 g +/- 0.1 g".')] = None,
    light_radius: Annotated[str | None, _option('Radius of that ball: "8 mm +/- 0.1 mm"; a film shows it.')] = None,
    heavy_mass: Annotated[list[str] | None, _option('Mass that falls: "200 g +/- 0.5 %"; once, or once for each file.')] = None,
    rod_radius: Annotated[str | None, _option('Radius of the rod: "6.25 mm +/- 1 %".')] = None,
    rod_diameter: Annotated[str | None, _option('Its diameter instead: "12.5 mm +/- 1 %".')] = None,
    free_length: Annotated[
        list[str] | None, _option('String from the rod to the light mass: "58 cm +/- 1 mm"; once, or for each file.')
    ] = None,
    hanging_length: Annotated[
        list[str] | None, _option('String from the rod to the heavy mass: "5 cm +/- 1 mm"; once, or for each file.')
    ] = None,
    release_angle: Annotated[
        list[str] | None, _option('Angle of the string at release, "90 deg +/- 0.5 deg" is level; once, or for each file.')
    ] = None,
    track: TrackFilms = False,
    force: Force = False,
) -> None:
    """Write a study: what the films and tables show, what you give here, and TODO for each value that is still to be measured.

    A film shows the ball's radius, and angle and hanging length of its release, given the free length. Each value has its
    unit, and its standard error behind "+/-"; without one it is taken as exact. A film's points are those of `track`; one that
    was not tracked, or with another length, radius or rate, is named with what differs, and needs --track.

    looping-pendulum new study first.mp4 second.csv --light-mass "20 g +/- 0.1 g" --free-length "58 cm +/- 1 mm"
    """
    from looping_pendulum.files import prepare_output_file
    from looping_pendulum.measured.study_io import json_schema
    from looping_pendulum.scenarios.fields import TO_FILL_IN
    from looping_pendulum.teaching.new_file import new_study

    prepare_output_file(out, force=force)
    title, given = out.stem.replace("_", " "), _given(context)
    with ProgressBars() as bars:
        text = new_study(title, out.parent, files, given, track=track, progress=bars.update)
    _write(out, text)
    _write_schema(out, "study", json_schema)
    todo = text.count(f": {TO_FILL_IN}")
    values = "value that says" if todo == 1 else f"{todo} values that say"
    fill_in = f"fill in the {values} {TO_FILL_IN}, then" if todo else "next"
    say(f"{fill_in}: {command_line('look', out)}")


def _given(context: typer.Context) -> dict[str, list[str]]:
    """Return the values of the options that are quantities, by their names; half of the diameter is the rod's radius.

    Raises
    ------
    NewFileError
        If the rod has a radius and a diameter.
    """
    from looping_pendulum.scenarios.quantities import QUANTITIES
    from looping_pendulum.teaching.new_file import NewFileError, radius_of

    values = {name: value if isinstance(value, list) else [value] for name, value in context.params.items() if value}
    if "rod_diameter" in values:
        if "rod_radius" in values:
            raise NewFileError("--rod-diameter: found it beside --rod-radius, needed one of them; leave one out")
        values["rod_radius"] = [radius_of(diameter) for diameter in values["rod_diameter"]]
    return {name: given for name, given in values.items() if name in QUANTITIES}


def _write(path: Path, text: str) -> None:
    from looping_pendulum.files import write_atomically

    write_atomically(path, text)
    say(f"wrote {path}")


def _write_schema(path: Path, kind: str, schema: Callable[[], Any]) -> None:
    """Write the JSON Schema that the first line names, by which an editor explains each key and marks what is wrong."""
    _write(path.with_name(f"{kind}.schema.json"), json.dumps(schema(), indent=2) + "\n")
