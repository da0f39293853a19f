"""The command line. Exit status: 0 within tolerance, 1 outside it, 2 misuse or bad input, 130 interrupted."""

from __future__ import annotations

import gc
import io
import os
import sys
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer
import typer.core

from looping_pendulum import __version__
from looping_pendulum.cli import common
from looping_pendulum.cli.check import check
from looping_pendulum.cli.converge import converge
from looping_pendulum.cli.engines import conformance, engines
from looping_pendulum.cli.file_kinds import takes
from looping_pendulum.cli.identify import identify, look
from looping_pendulum.cli.maps import map_
from looping_pendulum.cli.new import new
from looping_pendulum.cli.teaching import demo, demonstrations, init, live, tracker
from looping_pendulum.cli.terminal import ProgressBars, reset_output, say, say_file, say_prose, show_json, show_table
from looping_pendulum.cli.track import track
from looping_pendulum.cli.usage import App
from looping_pendulum.engines import MEMORY_LIMIT, Profile
from looping_pendulum.errors import HarnessError, one_line, shorten

if TYPE_CHECKING:
    from looping_pendulum.compare.baseline import ResultChanges
    from looping_pendulum.reference_ode.solution import Run
    from looping_pendulum.scenarios.scenario import Scenario

USAGE_ERROR: Any = typer.BadParameter.__base__
"""Base class of the errors of a mistyped command line: click's, of which typer has a copy of its own from 0.26 on."""

MAX_MESSAGE_LENGTH = 1000
"""Largest length of an error message [characters]; what the user typed, which it quotes, may be a hundred times longer."""

MADE_BEFORE_COLLECTION = 20_000
"""Number of objects that are made before the garbage collector looks at them; Python's own 700 costs `identify` 0.3 s."""
GROUPS: dict[str, dict[str, str]] = {
    "See": {
        "live": "the exact model in a page: sliders, a lesson, films, fits",
        "demo": "the same page with the runs of all engines in it",
        "demonstrations": "nine experiments on what each model assumes",
    },
    "Begin": {
        "init": "an example folder: a scenario, two trials, next commands",
        "new": "a commented scenario, or a study of your films to fill in",
        "scenarios": "the shipped scenarios, one to copy, or the schema",
    },
    "Compare engines": {
        "run": "one scenario: its events, and how each run ends",
        "compare": "where, when and why each engine departs",
        "check": "whether engines keep the scenarios' tolerances",
        "converge": "whether finer settings remove each engine's error",
        "engines": "which engines there are, and how to install others",
    },
    "Your film": {
        "track": "a film as points of both masses, without a click",
        "look": "points compared with what a study declares, in seconds",
        "identify": "the physics that a model of measured trials lacks",
        "tracker": "a motion as a file that Tracker draws over a video",
    },
    "For engine developers": {
        "conformance": "what every engine must do, tested",
    },
    "Maps": {"map": "how runs end over ranges of one to three quantities"},
}
"""Title -> command -> what it does, in a line of a help of 80 columns."""


class GroupedCommands(typer.core.TyperGroup):
    """Commands whose help lists them by what they are for."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write a list for each of `GROUPS`."""
        for title, commands in GROUPS.items():
            with formatter.section(title):
                formatter.write_dl(list(commands.items()))


app = App(
    cls=GroupedCommands,
    pretty_exceptions_enable=False,
    help="""Two masses hang on a string over a rod; let the light one go and it whips round and stops the heavy one.

    This program solves the exact model of that apparatus (the reference), builds the same apparatus in pymunk, MuJoCo and
    PyBullet, and reports where, when and why each engine departs from the reference.

    Start with:  looping-pendulum compare ten_to_one
    """,
    epilog="Exit status: 0 within tolerance, 1 outside it, 2 bad input. With --debug anywhere, errors show tracebacks.",
)


@app.callback(invoke_without_command=True)
def root(version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False) -> None:
    """Handle options that come before the command."""
    reset_output()
    if version:
        say(f"looping-pendulum {__version__}")
        raise typer.Exit


@app.command()
def scenarios(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="[SCENARIO]",
            help="Print the YAML file of this scenario.",
            autocompletion=common.scenario_names,
            callback=takes("scenario"),
        ),
    ] = None,
    schema: Annotated[bool, common.schema_option("scenario", "looping_pendulum.scenarios.loader")] = False,
    as_json: common.AsJson = False,
) -> None:
    """List the shipped scenarios, print one of them, or print the schema of scenario files.

    To write your own:  looping-pendulum scenarios ten_to_one > mine.yaml
    """
    # Imported here, and so in every command, as --help and a mistyped command must not wait for NumPy
    from looping_pendulum.scenarios import loader

    if name is not None:
        text = loader.source_text(name)
        say_file(text)
        show_json(common.yaml_content(text))
        return
    rows, listed = [], []
    for shipped in loader.shipped():
        scenario = loader.load(shipped)
        p = scenario.parameters
        ratio = p.heavy_mass / p.light_mass
        rows.append([shipped, p.release.value, f"{ratio:g}", scenario.title])
        listed.append({"scenario": shipped, "release": p.release, "mass_ratio": ratio, "title": scenario.title})
    show_table(["scenario", "release", "M2/M1", "title"], rows)
    show_json({"scenarios": listed})


app.command()(engines)


@app.command()
def run(
    scenario: common.ScenarioName,
    engine: common.EngineNames = None,
    profile: common.ProfileName = Profile.QUICK,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write the trajectories as CSV files into this folder.")
    ] = None,
    time_limit: common.TimeLimit = 900.0,
    memory_limit: common.MemoryLimit = MEMORY_LIMIT,
    jobs: common.Jobs = None,
    as_json: common.AsJson = False,
    quiet: common.Quiet = False,
) -> None:
    """Run one scenario and print its events and how each run ended; without --engine, solve the exact reference.

    looping-pendulum run two_to_one --out runs/two_to_one
    """
    from looping_pendulum.compare.harness import chosen_engines
    from looping_pendulum.compare.trajectories import trajectory_csv
    from looping_pendulum.engines.isolation import run_all
    from looping_pendulum.engines.reference import ReferenceEngine
    from looping_pendulum.files import file_stems, prepare_output_folder, write_atomically
    from looping_pendulum.runs.outcome import outcome

    chosen = common.load_scenario(scenario)
    wanted = chosen_engines(engine, profile) if engine else [ReferenceEngine(profile)]
    if out is not None:
        prepare_output_folder(out)
    with ProgressBars(time_left=True, keep=True) as bars:
        runs = run_all(
            wanted,
            chosen,
            jobs=jobs,
            time_limit=time_limit,
            memory_limit=memory_limit,
            progress=bars.update_engine,
            finished=bars.show_finished_run,
        )
    exact = _exact(chosen)
    end_of_model = None if exact is None else _end_of_model(exact)
    rows: list[list[str]] = []
    listed: list[dict[str, Any]] = []
    stems = file_stems([(result.label, result.profile) for result in runs])
    for result, stem in zip(runs, stems, strict=True):
        until, drop = ("", "") if not len(result.t) else (f"{result.t[-1]:.3f}", f"{result.heavy_drop[-1]:.4f}")
        ended = result.status.value + (f" ({result.message})" if result.message else "")
        if result.status.ends_at_rod:
            ended += f"; the scenario lasts {chosen.duration:g} s"
        if end_of_model and len(result.t) and result.t[-1] > end_of_model[0]:
            ended += "; at {:.3f} s {}".format(*end_of_model)
        spent = f"{result.cpu_time:.2f}" if len(result.t) else ""
        rows.append([result.label, str(len(result.t)), until, drop, spent, ended])
        for event in result.events:
            later = f", after the scenario's end at {chosen.duration:g} s" if event.time > chosen.duration else ""
            say(f"{result.label}: {event.time:.6f} s {event.name}{later}")
        if result.engine == "reference" and exact is not None:
            say(f"{result.label}: {outcome(exact)}")
        if out is not None and len(result.t):
            path = out / f"{stem}.csv"
            write_atomically(path, trajectory_csv(result))
            say(f"wrote {path}")
        listed.append(
            {
                "engine": result.label,
                "status": result.status.name,
                "ended": ended,
                "samples": len(result.t),
                "end_time": result.t[-1] if len(result.t) else None,
                "heavy_drop": result.heavy_drop[-1] if len(result.t) else None,
                "wall_time": result.wall_time,
                "cpu_time": result.cpu_time,
                "events": [{"time": event.time, "name": event.name} for event in result.events],
                "file": path if out is not None and len(result.t) else None,
            }
        )
    show_table(["engine", "samples", "until [s]", "M2 dropped [m]", "CPU [s]", "ended"], rows)
    show_json({"scenario": chosen.name, "profile": profile, "runs": listed})
    common.exit_with_status(runs)


def _exact(scenario: Scenario) -> Run | None:
    """Return the reference's run of a scenario; None where there is no reference, without which an engine runs as well."""
    from looping_pendulum.engines.reference import Reference

    try:
        return Reference(scenario).solution
    except HarnessError:
        return None


def _end_of_model(exact: Run) -> tuple[float, str] | None:
    """Return when the model ends before the light mass reaches the rod [s], and how; what an engine shows later is no motion.

    None where it does not.
    """
    from looping_pendulum.compare.stories import MODEL_ENDS
    from looping_pendulum.engines.reference import STATUS_OF_END

    status = None if exact.end.event is None else STATUS_OF_END.get(exact.end.event)
    return (exact.end_time, MODEL_ENDS[status]) if status in MODEL_ENDS else None


@app.command()
def compare(
    scenario: common.ScenarioName,
    engine: common.EngineNames = None,
    profile: common.ProfileName = Profile.QUICK,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for the report; default: report/SCENARIO.")] = None,
    data: common.DataFolder = None,
    marks: common.MarksFiles = None,
    marks_set: common.MarksSettings = None,
    time_limit: common.TimeLimit = 900.0,
    memory_limit: common.MemoryLimit = MEMORY_LIMIT,
    jobs: common.Jobs = None,
    baseline: Annotated[
        Path | None, typer.Option(metavar="RESULT.json", help="List what changed since this earlier result (file or folder).")
    ] = None,
    baseline_threshold: Annotated[
        float, typer.Option(metavar="FRACTION", min=0.0, help="Smallest relative change of a metric to list; 0.01 is 1 %.")
    ] = 0.01,
    as_json: common.AsJson = False,
    quiet: common.Quiet = False,
) -> None:
    """Run all engines on one scenario and report how each departs from the exact reference.

    Writes report.md with figures, report.html, result.json and the trajectories as CSV. In a folder without an earlier report,
    report.html appears with the first engine that ends, and grows with the others. With --baseline it also prints what
    changed since that result, and writes it to changes.json; the exit status depends on the tolerances only.

    With --marks your own filmed trial stands beside the runs: its points in the figures, and each run's residual and its RMS.

    looping-pendulum compare ten_to_one --profile quick --out report/ten_to_one
    """
    from looping_pendulum.compare import write
    from looping_pendulum.compare.baseline import changes_since, read_baseline
    from looping_pendulum.compare.report import verdict_rows
    from looping_pendulum.files import prepare_output_folder

    chosen = common.load_scenario(scenario)
    trial = common.read_marks(marks, marks_set)
    earlier = None if baseline is None else read_baseline(baseline, chosen.name)
    folder = out or Path("report") / chosen.name
    prepare_output_folder(
        folder, files=(*common.COMPARE_FILES, "changes.json"), folders=common.COMPARE_FOLDERS, record="result.json"
    )
    limits: dict[str, Any] = {"time_limit": time_limit, "memory_limit": memory_limit, "jobs": jobs}
    result = common.run_and_compare(
        chosen, engine, profile, data=data, trial=trial, meanwhile=common.page_meanwhile(folder), **limits
    )
    changes = None if earlier is None else changes_since(earlier, result, source=str(baseline), relative=baseline_threshold)
    folder = common.report_folder(folder, "result.json", interrupted=result.interrupted)
    written = write(result, folder, changes)
    show_table(*verdict_rows(result))
    common.show_residuals(result)
    for engine_result in result.engines:
        say_prose(f"- {engine_result.label}: {engine_result.story}")
    if changes is not None:
        _show_changes(changes)
    say(f"wrote {written} and report.html")
    show_json({"result": result, "changes": changes, "report": written})
    assert result.samples is not None
    common.exit_with_status((aligned.run for aligned in result.samples.aligned), within=result.within_tolerance)


app.command()(check)
app.command()(conformance)
app.command()(converge)
app.command("map")(map_)


app.command()(identify)
app.command()(look)
app.command()(live)
app.command()(demo)
app.add_typer(new, name="new")
app.command()(init)
app.command()(tracker)
app.command()(track)
app.command()(demonstrations)


def _show_changes(changes: ResultChanges) -> None:
    """Print what changed since a baseline."""
    from looping_pendulum.compare.baseline import MAX_CONSOLE_CHANGES

    say(changes.heading)
    head, changed_rows = changes.table()
    if changed_rows:
        show_table(head, changed_rows[:MAX_CONSOLE_CHANGES])
    if len(changed_rows) > MAX_CONSOLE_CHANGES:
        say(f"... and {len(changed_rows) - MAX_CONSOLE_CHANGES} more in report.md and changes.json")


def _short_warning(message: Warning | str, *_: object, **__: object) -> str:
    return f"warning: {one_line(str(message))}\n"


def _fail(message: str) -> NoReturn:
    """Print a user's mistake in one line, and exit."""
    say(f"error: {shorten(one_line(message), MAX_MESSAGE_LENGTH)}", err=True)
    sys.exit(common.BAD_INPUT)


def main() -> None:
    """Run the command line; print an error as one line, or with --debug as a traceback."""
    for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(
            variable, "1"
        )  # before numpy is imported: with matrices this small a second thread only waits for a core
    # A command imports and makes much that stays to its end, which the collector would look through again and again
    gc.set_threshold(MADE_BEFORE_COLLECTION)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a character that the terminal cannot show must not end a command
    debug = "--debug" in sys.argv
    if debug:
        # Removed before typer parses the rest, so that it may stand before or after the command
        sys.argv.remove("--debug")
    else:
        warnings.formatwarning = _short_warning
    try:
        # Not standalone, so that errors come here instead of being printed by typer
        sys.exit(app(standalone_mode=False))
    except USAGE_ERROR as error:
        text = io.StringIO()
        error.show(file=text)
        # Only the message quotes what was typed, and may be long
        usage, error_sign, message = text.getvalue().rstrip("\n").partition("\nError: ")
        say(f"{usage}{error_sign}{shorten(one_line(message), MAX_MESSAGE_LENGTH)}", err=True)
        sys.exit(common.BAD_INPUT)
    except typer.Abort:
        say("Aborted.", err=True)
        sys.exit(common.OUTSIDE_TOLERANCE)
    except HarnessError as error:
        if debug:
            raise
        _fail(str(error))
    except KeyboardInterrupt:
        say("interrupted", err=True)
        sys.exit(common.INTERRUPTED)
    except OSError as error:
        if debug:
            raise
        where = f"{error.filename}: " if error.filename else ""
        _fail(f"{where}{error.strerror or error or type(error).__name__}; write to a folder that is yours and has room")
    except Exception as error:
        if debug:
            raise
        _fail(f"unexpected {type(error).__name__}: {error}; --debug shows where")
