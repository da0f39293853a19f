"""Commands for teaching: a demonstration, an example folder, a file for Tracker, the experiments on each model."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from looping_pendulum.cli import common
from looping_pendulum.cli.file_kinds import takes
from looping_pendulum.cli.quantities import quantity
from looping_pendulum.cli.terminal import ProgressBars, note, say
from looping_pendulum.engines import MEMORY_LIMIT, Profile
from looping_pendulum.installation import command_line, quoted

EXAMPLE_FOLDER = Path("looping-pendulum-example")
"""Folder that `init` fills where none is named."""


def demo(
    scenario: common.OptionalScenario = "ten_to_one",
    engine: common.EngineNames = None,
    profile: common.ProfileName = Profile.QUICK,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder for the page and the results; default: report/SCENARIO.")
    ] = None,
    film: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Also write a film for slides: demo.gif, or demo.mp4 with ffmpeg.")
    ] = None,
    no_open: Annotated[bool, typer.Option("--no-open", help="Write the page, but do not open it in a browser.")] = False,
    marks: common.MarksFiles = None,
    marks_set: common.MarksSettings = None,
    force: common.Force = False,
    again: Annotated[bool, typer.Option("--again", help="Run the engines even if DIR has their results.")] = False,
    time_limit: common.TimeLimit = 900.0,
    memory_limit: common.MemoryLimit = MEMORY_LIMIT,
    jobs: common.Jobs = None,
) -> None:
    """Animate the reference and all engines together, on the page of `live`, which works offline.

    Play it in slow motion, switch engines off, and see when each stops, sticks, slips and halts. Writes demo.html beside the
    files of `compare`; if DIR has `compare`'s results of the same input and versions, no engine runs again. With --marks the
    points of your own filmed trial move in step.

    looping-pendulum demo two_to_one --no-open
    """
    from looping_pendulum.compare import write
    from looping_pendulum.compare.comparison import with_trial
    from looping_pendulum.compare.harness import chosen_engines
    from looping_pendulum.compare.trajectories import stored_result
    from looping_pendulum.files import prepare_output_file, prepare_output_folder
    from looping_pendulum.teaching import demo as pages

    chosen = common.load_scenario(scenario)
    trial = common.read_marks(marks, marks_set)
    if film is not None:
        from looping_pendulum.teaching.film import check_film, write_film

        check_film(film)
        prepare_output_file(film, force=force, option="--film")
    folder = out or Path("report") / chosen.name
    prepare_output_folder(
        folder, files=(*common.COMPARE_FILES, pages.FILE), folders=common.COMPARE_FOLDERS, record="result.json"
    )
    engines = chosen_engines(engine or (), profile)
    result = None if again else stored_result(folder, chosen, engines)
    if result is None:
        limits: dict[str, Any] = {"time_limit": time_limit, "memory_limit": memory_limit, "jobs": jobs}
        result = common.run_and_compare(chosen, engine, profile, trial=trial, **limits)
        folder = common.report_folder(folder, "result.json", interrupted=result.interrupted)
        write(result, folder)
    else:
        note(f"{folder} has the results of this input; use --again to run the engines again")
        if trial is not None:
            result = with_trial(result, trial)
            write(result, folder)
    path = folder / pages.FILE
    pages.write(result, path)
    say(f"wrote {path}")
    if film is not None:
        with ProgressBars() as bars:
            write_film(result, film, bars.update)
        say(f"wrote {film}")
    if not no_open and not pages.show(path):
        say(f"no browser was found; open {path.resolve().as_uri()} in one")
    assert result.samples is not None
    # The command shows the motion, and judges no tolerance
    common.exit_with_status((aligned.run for aligned in result.samples.aligned), within=True)


def tracker(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE",
            help="Scenario (name or file), folder that `compare` wrote, or CSV file that `run` wrote.",
            autocompletion=common.scenario_names,
            callback=takes("scenario", "table of numbers"),
        ),
    ],
    engine: Annotated[
        str | None,
        typer.Option(
            "--engine",
            "-e",
            metavar="NAME",
            help="Take the motion of this variant (mujoco:capstan); default: the reference.",
            autocompletion=common.engine_names,
        ),
    ] = None,
    fps: Annotated[
        float, typer.Option(metavar="RATE", parser=quantity("Hz", least="0.01 Hz"), help="True frame rate of the video [Hz].")
    ] = 240.0,
    start: Annotated[
        float,
        typer.Option(metavar="TIME", parser=quantity("s", least="0 s"), help="Time of the release by the video's clock [s]."),
    ] = 0.0,
    profile: common.ProfileName = Profile.QUICK,
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="File to write; default: NAME-tracker.csv.")] = None,
    force: common.Force = False,
) -> None:
    """Write a motion as a file that Tracker draws over a video (docs/film.md).

    Columns t,heavyx,heavyy,lightx,lighty: seconds by the video's clock and metres from the rod's axis, x to the right, y up;
    one row per frame. In Tracker: set the axes' origin on the rod, then Track > New > External Model.

    looping-pendulum tracker ten_to_one --fps 240 --start 0.35 --out overlay.csv
    """
    from looping_pendulum.files import file_stem, prepare_output_file, write_atomically
    from looping_pendulum.teaching.tracker import find_motion, overlay, tracker_csv

    path = out or Path(f"{file_stem(Path(source).stem, engine or '')}-tracker.csv")
    prepare_output_file(path, force=force)
    first, rows = overlay(find_motion(source, engine, profile), frame_rate=fps, start=start)
    write_atomically(path, tracker_csv(rows))
    last = first + len(rows) - 1
    say(f"wrote {path}: {engine or 'reference'} of {source}; one row per frame, frames {first} to {last} at {fps:g} a second")
    say(f"In Tracker's Model Builder, set the start frame to {first}.")


def init(
    folder: Annotated[Path, typer.Argument(metavar="[DIR]", help="New or empty folder.")] = EXAMPLE_FOLDER,
) -> None:
    """Create an example folder: a scenario, a study of two filmed trials, and a page with the next commands.

    A folder that is not empty is left unchanged.

    looping-pendulum init my_pendulum
    """
    from looping_pendulum.teaching.example_folder import write_example

    for path in write_example(folder):
        say(f"wrote {path}")
    say(f"Next: cd {quoted(folder)}, and read README.md; it begins with: {command_line('run', 'mine.scenario.yaml')}")


def demonstrations(
    name: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME ...]", help="Names or numbers (see --list); default: all nine.")
    ] = None,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for scripts, pictures and the page.")] = Path(
        "demonstrations"
    ),
    listed: Annotated[bool, typer.Option("--list", help="List the demonstrations, and run nothing.")] = False,
) -> None:
    """Show what each model assumes: a question, a guess, an experiment that is run now, and the answer.

    Each is a script. It is copied to the folder, unless it is there, for you to read and change; with it come its picture and
    a page of all that were run.
    The exit status is 1 if a run contradicts what a script says.

    looping-pendulum demonstrations polygon --out demonstrations
    """
    from looping_pendulum.demonstrations.runner import find_demonstrations, render, run_demonstration
    from looping_pendulum.files import prepare_output_folder, write_atomically

    chosen = find_demonstrations(name or ())
    if listed:
        for demonstration in chosen:
            say(f"{demonstration.name:24} {demonstration.title}")
        return
    prepare_output_folder(out)
    runs = []
    for demonstration in chosen:
        say(f"{demonstration.title}\n{demonstration.words['Question']}\n")
        run = run_demonstration(demonstration, out)
        say(f"{run.printed}\n")
        if run.false_claim:
            say(f"{demonstration.name}: not borne out by this run: {run.false_claim}", err=True)
        runs.append(run)
        mine = out / demonstration.script.name
        if not mine.exists():  # what a reader changed stays
            write_atomically(mine, demonstration.source)
    write_atomically(out / "index.html", render(runs))
    say(f"wrote {out / 'index.html'}")
    raise typer.Exit(common.OUTSIDE_TOLERANCE if any(run.false_claim for run in runs) else 0)


def live(
    scenario: common.OptionalScenario = "ten_to_one",
    out: Annotated[Path, typer.Option(metavar="FILE", help="File to write.")] = Path("live.html"),
    force: common.Force = False,
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
    from looping_pendulum.files import prepare_output_file
    from looping_pendulum.live.write import write
    from looping_pendulum.teaching import demo

    chosen = common.load_scenario(scenario)
    prepare_output_file(out, force=force)
    folder = results or Path("report") / chosen.name
    result = stored_result(folder, chosen, engines=None)
    if result is not None:
        demo.write(result, out)
        say(f"wrote {out}, with the runs of {', '.join(map(result.short_name, result.engines))} from {folder}")
    elif results is not None:
        raise HarnessError(
            f"--results: found no result of this scenario in {folder}, needed a folder that `compare` wrote; "
            f"write for example `{command_line('compare', scenario, '--out', folder)}` first"
        )
    else:
        write(out, chosen)
        say(f"wrote {out}")
        makes = command_line("compare", scenario)
        note(f"no engines beside it: {folder} has no result of this scenario; `{makes}` makes one")
    if not no_open and not demo.show(out):
        say(f"no browser was found; open {out.resolve().as_uri()} in one")
