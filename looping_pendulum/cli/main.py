"""The command line. Exit status: 0 within tolerance, 1 outside it, 2 misuse or bad input, 130 interrupted."""

from __future__ import annotations

import io
import os
import signal
import sys
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from looping_pendulum import __version__
from looping_pendulum.cli.check import check
from looping_pendulum.cli.common import (
    BAD_INPUT,
    COMPARE_FILES,
    COMPARE_FOLDERS,
    INTERRUPTED,
    OUTSIDE,
    DataFolder,
    EngineNames,
    Jobs,
    MemoryLimit,
    ProfileChoice,
    ProfileName,
    ScenarioName,
    TimeLimit,
    beside_complete,
    beside_complete_comparison,
    exit_for,
    load_scenario,
    run_and_compare,
    show_output_of_failed,
)
from looping_pendulum.cli.converge import converge
from looping_pendulum.cli.engines import conformance, engines
from looping_pendulum.cli.maps import map_, maps
from looping_pendulum.cli.progress import EngineBars, StageBar
from looping_pendulum.cli.teaching import demo, demonstrations, init, new, tracker
from looping_pendulum.cli.terminal import new_table, say, say_file, show_table
from looping_pendulum.errors import HarnessError, one_line, shorten

if TYPE_CHECKING:
    from looping_pendulum.compare.baseline import ResultChanges

USAGE_ERROR: Any = typer.BadParameter.__base__
"""Base of the errors of a mistyped command line; it is click's, and typer has a copy of its own from 0.26 on."""

LONGEST_MESSAGE = 1000
"""[characters] of a line that says what was wrong; what a command line holds may be a hundred times longer."""

# rich_markup_mode=None: drawing the help with rich would double the time that --help takes
app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    help="""Two masses hang on a string over a rod; let the light one go and it whips round and stops the heavy one.

    This runs an exact reference of that apparatus and rebuilds it in pymunk, MuJoCo and PyBullet, and reports where, when and
    why each engine departs from the reference.

    Start with:  looping-pendulum compare ten_to_one
    """,
    epilog="Exit status: 0 within tolerance, 1 outside it, 2 bad input. --debug, anywhere, shows tracebacks.",
)


@app.callback(invoke_without_command=True)
def root(version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False) -> None:
    """Options that stand before the command."""
    if version:
        say(f"looping-pendulum {__version__}")
        raise typer.Exit


@app.command()
def scenarios(
    name: Annotated[str | None, typer.Argument(metavar="[SCENARIO]", help="Print this scenario's YAML.")] = None,
    schema: Annotated[bool, typer.Option("--schema", help="Print the JSON Schema of scenario files, for editors.")] = False,
) -> None:
    """List the shipped scenarios, print one, or print the schema of the files.

    To write your own:  looping-pendulum scenarios ten_to_one > mine.yaml
    """
    from looping_pendulum.scenarios import loader

    if schema:
        import json

        say(json.dumps(loader.json_schema(), indent=2))
    elif name is not None:
        say_file(loader.source_text(name))
    else:
        table = new_table("scenario", "release", "M2/M1", "title")
        for shipped in loader.shipped():
            scenario = loader.load(shipped)
            p = scenario.parameters
            table.add_row(shipped, p.release.value, f"{p.heavy_mass / p.light_mass:g}", scenario.title)
        show_table(table)


app.command()(engines)


@app.command()
def run(
    scenario: ScenarioName,
    engine: EngineNames = None,
    profile: ProfileName = ProfileChoice.QUICK,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Write the trajectories here as CSV.")] = None,
    time_limit: TimeLimit = 900.0,
    memory_limit: MemoryLimit = "2 GiB",
    jobs: Jobs = None,
) -> None:
    """Run one scenario and show how it went; without --engine, the exact reference.

    looping-pendulum run two_to_one --out runs/two_to_one
    """
    from looping_pendulum.compare.export import trajectory_csv
    from looping_pendulum.compare.harness import chosen_engines
    from looping_pendulum.engines.isolation import run_all
    from looping_pendulum.engines.memory import parse_memory
    from looping_pendulum.engines.protocol import Profile
    from looping_pendulum.engines.reference import ReferenceEngine
    from looping_pendulum.files import file_stems, ready_folder, write_whole
    from looping_pendulum.reference_ode.solve import available_integrators

    chosen, speed, most_memory = load_scenario(scenario), Profile(profile.value), parse_memory(memory_limit)
    wanted = chosen_engines(engine, speed) if engine else [ReferenceEngine(available_integrators()[0], speed)]
    if out is not None:
        ready_folder(out)  # before the work, not after it
    with EngineBars() as progress:
        runs = run_all(
            wanted,
            chosen,
            jobs=jobs,
            time_limit=time_limit,
            memory_limit=most_memory,
            progress=progress.update,
            finished=progress.finished,
        )
    table = new_table("engine", "samples", "until [s]", "M2 dropped [m]", "wall [s]", "ended")
    stems = file_stems([(result.label, result.profile) for result in runs])
    for result, stem in zip(runs, stems, strict=True):
        until, drop = ("", "") if not len(result.t) else (f"{result.t[-1]:.3f}", f"{result.heavy_drop[-1]:.4f}")
        ended = result.status.value + (f" ({result.message})" if result.message else "")
        table.add_row(result.label, str(len(result.t)), until, drop, f"{result.wall_time:.2f}", ended)
        for event in result.events:
            say(f"{result.label}: {event.time:.6f} s {event.name}")
        if out is not None and len(result.t):
            path = out / f"{stem}.csv"
            write_whole(path, trajectory_csv(result))
            say(f"wrote {path}")
    show_table(table)
    show_output_of_failed(runs)
    exit_for(runs)


@app.command()
def compare(
    scenario: ScenarioName,
    engine: EngineNames = None,
    profile: ProfileName = ProfileChoice.QUICK,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Where the report goes; default: report/SCENARIO.")] = None,
    data: DataFolder = None,
    time_limit: TimeLimit = 900.0,
    memory_limit: MemoryLimit = "2 GiB",
    jobs: Jobs = None,
    baseline: Annotated[
        Path | None, typer.Option(metavar="RESULT.json", help="List what changed since this earlier run (or its folder).")
    ] = None,
    baseline_threshold: Annotated[
        float, typer.Option(metavar="FRACTION", min=0.0, help="Smallest change of a metric to list; 0.01 is 1 %.")
    ] = 0.01,
) -> None:
    """Run all engines on one scenario and report how each departs from the exact reference.

    Writes report.md with figures, report.html, result.json and the trajectories as CSV. With --baseline also changes.json:
    what changed since then is shown, and does not alter the exit status, which the tolerances decide.

    looping-pendulum compare ten_to_one --profile quick --out report/ten_to_one
    """
    from looping_pendulum.compare import write
    from looping_pendulum.compare.baseline import changes_since, read_baseline
    from looping_pendulum.compare.report import verdict_rows
    from looping_pendulum.files import ready_folder

    chosen = load_scenario(scenario)
    earlier = None if baseline is None else read_baseline(baseline, chosen.name)
    folder = out or Path("report") / chosen.name
    ready_folder(folder, files=(*COMPARE_FILES, "changes.json"), folders=COMPARE_FOLDERS)  # before the work, not after it
    result = run_and_compare(chosen, engine, profile, data=data, time_limit=time_limit, memory_limit=memory_limit, jobs=jobs)
    changes = None if earlier is None else changes_since(earlier, result, source=str(baseline), relative=baseline_threshold)
    folder = beside_complete_comparison(folder, result)
    written = write(result, folder, changes)
    header, rows = verdict_rows(result)
    table = new_table(*header)
    for row in rows:
        table.add_row(*row)
    show_table(table)
    for one in result.engines:
        say(f"- {one.label}: {one.story}")
    if changes is not None:
        _show_changes(changes)
    say(f"wrote {written} and report.html")
    assert result.samples is not None
    runs = [aligned.run for aligned in result.samples.aligned]
    show_output_of_failed(runs)
    exit_for(runs, within=result.within_tolerance)


app.command()(check)
app.command()(conformance)
app.command()(converge)
app.command("map")(map_)
app.command()(maps)


@app.command()
def identify(
    study: Annotated[Path, typer.Argument(metavar="STUDY.yaml", help="Apparatus, declared effects, trials and their files.")],
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Where the report goes; default: report/STUDY.")] = None,
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Of the second start of the fit.")] = 0,
    time_limit: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", min=1.0, help="End the search after about this long, and report what it has found."),
    ] = None,
) -> None:
    """Find the physics that a model of measured trials lacks, and report the error before and after adding it.

    Writes report.md with figures, report.html, verdict.json and repaired.yaml, a scenario that `compare` runs as it is.

    looping-pendulum identify trials/study.yaml --out report/trials
    """
    from looping_pendulum.discrepancy.data import study_io
    from looping_pendulum.discrepancy.identify import identify as find
    from looping_pendulum.discrepancy.report import writing
    from looping_pendulum.discrepancy.result import Verdict
    from looping_pendulum.files import ready_folder

    loaded = study_io.load(study)
    folder = out or Path("report") / loaded.name
    ready_folder(folder, files=writing.FILES, folders=writing.FOLDERS)  # before the work, not after it
    with StageBar() as stages:
        result = find(loaded, seed=seed, progress=stages.update, time_limit=time_limit)
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # what was found is written whole; that takes two seconds
    try:
        interrupted = result.verdict is Verdict.INTERRUPTED
        folder = beside_complete(
            folder, "verdict.json", interrupted=interrupted, cut_short=lambda found: found["verdict"] == Verdict.INTERRUPTED
        )
        written = writing.write(result, folder)
    finally:
        signal.signal(signal.SIGINT, before)
    say(f"{result.verdict.value}: {result.sentence}")
    table = new_table("trial", "seen by the fit", "RMS before [mm]", "RMS after [mm]", "before [noise]", "after [noise]")
    for e in result.errors:
        # without marks, only events were seen of the trial
        sizes = ["" if rms is None else f"{1e3 * rms:.2f}" for rms in (e.rms_before, e.rms_after)]
        table.add_row(e.trial, "no" if e.held_out else "yes", *sizes, f"{e.noise_before:.2f}", f"{e.noise_after:.2f}")
    show_table(table)
    say(f"wrote {written} and report.html")
    if interrupted:
        raise typer.Exit(INTERRUPTED)


app.command()(demo)
app.command()(new)
app.command()(init)
app.command()(tracker)
app.command()(demonstrations)


def _show_changes(changes: ResultChanges) -> None:
    """Show what changed since a baseline."""
    from looping_pendulum.compare.baseline import HEADER, SAID_ON_CONSOLE, heading, rows

    say(heading(changes))
    found = rows(changes)
    table = new_table(*HEADER)
    for row in found[:SAID_ON_CONSOLE]:
        table.add_row(*row)
    if found:
        show_table(table)
    if len(found) > SAID_ON_CONSOLE:
        say(f"... and {len(found) - SAID_ON_CONSOLE} more in report.md and changes.json")


def _short_warning(message: Warning | str, *_: object, **__: object) -> str:
    return f"warning: {one_line(str(message))}\n"


def _fail(message: str) -> NoReturn:
    """End with one line for a user's mistake."""
    say(f"error: {shorten(one_line(message), LONGEST_MESSAGE)}", err=True)
    sys.exit(BAD_INPUT)


def main() -> None:
    """Run the command line; print a user's mistake as one line."""
    for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(variable, "1")  # before numpy comes: a second thread on such small matrices only waits for a core
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # what a terminal cannot show must not end a command
    debug = "--debug" in sys.argv
    if debug:
        sys.argv.remove("--debug")
    else:
        warnings.formatwarning = _short_warning
    try:
        sys.exit(app(standalone_mode=False))
    except USAGE_ERROR as error:
        words = io.StringIO()
        error.show(file=words)
        usage, error_sign, message = words.getvalue().rstrip("\n").partition("\nError: ")
        say(f"{usage}{error_sign}{shorten(one_line(message), LONGEST_MESSAGE)}", err=True)
        sys.exit(BAD_INPUT)
    except typer.Abort:
        say("Aborted.", err=True)
        sys.exit(OUTSIDE)
    except HarnessError as error:
        if debug:
            raise
        _fail(str(error))
    except KeyboardInterrupt:
        say("interrupted", err=True)
        sys.exit(INTERRUPTED)
    except OSError as error:
        if debug:
            raise
        where = f"{error.filename}: " if error.filename else ""
        _fail(f"{where}{error.strerror or error or type(error).__name__}; choose another folder with --out?")
    except Exception as error:
        if debug:
            raise
        _fail(f"unexpected {type(error).__name__}: {error}; --debug shows where")
