"""The command line. Exit status: 0 within tolerance, 1 outside it, 2 misuse or bad input, 130 interrupted."""

from __future__ import annotations

import os
import signal
import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from looping_pendulum import __version__
from looping_pendulum.cli_progress import EngineBars, StageBar
from looping_pendulum.errors import HarnessError

if TYPE_CHECKING:
    from looping_pendulum.compare.result import ComparisonResult
    from looping_pendulum.engines.trajectory import Trajectory
    from looping_pendulum.scenarios.scenario import Scenario

OUTSIDE, BAD_INPUT, INTERRUPTED = 1, 2, 130

# rich_markup_mode=None: drawing the help with rich would double the time that --help takes
app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    help="""Two masses hang on a string over a rod; let the light one go and it whips round and stops the heavy one.

    This runs an exact reference of that apparatus and rebuilds it in pymunk, MuJoCo and PyBullet, and reports where, when and
    why each engine departs from the truth.

    Start with:  looping-pendulum compare ten_to_one
    """,
    epilog="Exit status: 0 within tolerance, 1 outside it, 2 bad input. --debug, anywhere, shows tracebacks.",
)


class ProfileChoice(StrEnum):
    """How much a run may cost; the values of `engines.protocol.Profile`, which is too heavy to import for --help."""

    QUICK = "quick"
    ACCURATE = "accurate"


ScenarioName = Annotated[
    str, typer.Argument(metavar="SCENARIO", help="Name of a shipped scenario (see `scenarios`), or path of a YAML file.")
]
EngineNames = Annotated[
    list[str] | None,
    typer.Option("--engine", "-e", metavar="NAME", help="Only this engine (pymunk) or variant (mujoco:capstan); repeatable."),
]
ProfileName = Annotated[ProfileChoice, typer.Option("--profile", "-p", help="quick: seconds to a minute. accurate: minutes.")]
TimeLimit = Annotated[
    float, typer.Option(metavar="SECONDS", min=0.1, help="Stop an engine's run after this long; keep what it has.")
]
Jobs = Annotated[int | None, typer.Option(metavar="N", min=1, help="Runs at once; default: one per core.")]
DataFolder = Annotated[
    Path | None,
    typer.Option("--data", metavar="DIR", help="Folder with measured tables (paper/...); also $LOOPING_PENDULUM_DATA."),
]


@app.callback(invoke_without_command=True)
def root(version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False) -> None:
    """Options that stand before the command."""
    if version:
        typer.echo(f"looping-pendulum {__version__}")
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

        typer.echo(json.dumps(loader.json_schema(), indent=2))
    elif name is not None:
        typer.echo(loader.source_text(name), nl=False)
    else:
        table = _table("scenario", "release", "M2/M1", "title")
        for shipped in loader.shipped():
            scenario = loader.load(shipped)
            p = scenario.parameters
            table.add_row(shipped, p.release.value, f"{p.heavy_mass / p.light_mass:g}", scenario.title)
        _print(table)


@app.command()
def engines(profile: ProfileName = ProfileChoice.QUICK) -> None:
    """List the engines: installed or how to get them, and who supplies which physics."""
    from looping_pendulum.engines.protocol import Profile
    from looping_pendulum.engines.registry import HOW_TO_GET, all_engines, label, missing_packages
    from looping_pendulum.engines.trajectory import supplies_as_rows

    table = _table("engine", "here", "winding", "friction law", "stick-slip", "drag", "what it is")
    notes: dict[str, str] = {}
    for engine in all_engines(Profile(profile.value)):
        missing = missing_packages(engine)
        suppliers = [by for _, by, _ in supplies_as_rows(engine.abilities.supplies)]
        table.add_row(label(engine), "no" if missing else "yes", *suppliers, engine.abilities.summary)
        notes |= {package: HOW_TO_GET.get(package, f"pip install {package}") for package in missing}
    _print(table)
    for package, how in notes.items():
        typer.echo(f"{package} is not installed; to get it: {how}")


@app.command()
def run(
    scenario: ScenarioName,
    engine: EngineNames = None,
    profile: ProfileName = ProfileChoice.QUICK,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Write the trajectories here as CSV.")] = None,
    time_limit: TimeLimit = 900.0,
    jobs: Jobs = None,
) -> None:
    """Run one scenario and show how it went; without --engine, the exact reference.

    looping-pendulum run two_to_one --out runs/two_to_one
    """
    from looping_pendulum.compare.export import file_stem, trajectory_csv, write_whole
    from looping_pendulum.compare.harness import chosen_engines
    from looping_pendulum.engines.isolation import run_all
    from looping_pendulum.engines.protocol import Profile
    from looping_pendulum.engines.reference import ReferenceEngine
    from looping_pendulum.reference_ode.solve import available_integrators

    chosen, speed = _load(scenario), Profile(profile.value)
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
    wanted = chosen_engines(engine, speed) if engine else [ReferenceEngine(available_integrators()[0], speed)]
    with EngineBars() as progress:
        runs = run_all(wanted, chosen, jobs=jobs, time_limit=time_limit, progress=progress.update, finished=progress.finished)
    table = _table("engine", "samples", "until [s]", "M2 dropped [m]", "wall [s]", "ended")
    for result in runs:
        until, drop = ("", "") if not len(result.t) else (f"{result.t[-1]:.3f}", f"{result.heavy_drop[-1]:.4f}")
        ended = result.status.value + (f" ({result.message})" if result.message else "")
        table.add_row(result.label, str(len(result.t)), until, drop, f"{result.wall_time:.2f}", ended)
        for event in result.events:
            typer.echo(f"{result.label}: {event.time:.6f} s {event.name}")
        if out is not None and len(result.t):
            path = out / f"{file_stem(result.label, result.profile)}.csv"
            write_whole(path, trajectory_csv(result))
            typer.echo(f"wrote {path}")
    _print(table)
    _show_output_of_failed(runs)
    _exit_for(runs)


@app.command()
def compare(
    scenario: ScenarioName,
    engine: EngineNames = None,
    profile: ProfileName = ProfileChoice.QUICK,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Where the report goes; default: report/SCENARIO.")] = None,
    data: DataFolder = None,
    time_limit: TimeLimit = 900.0,
    jobs: Jobs = None,
) -> None:
    """Run all engines on one scenario and report how each departs from the exact reference.

    Writes report.md with figures, result.json and the trajectories as CSV.

    looping-pendulum compare ten_to_one --profile quick --out report/ten_to_one
    """
    from looping_pendulum.compare import write
    from looping_pendulum.compare.report import verdict_rows

    chosen = _load(scenario)
    folder = out or Path("report") / chosen.name
    folder.mkdir(parents=True, exist_ok=True)  # before the work, not after it
    result = _compared(chosen, engine, profile, data, time_limit, jobs)
    header, rows = verdict_rows(result)
    table = _table(*header)
    for row in rows:
        table.add_row(*row)
    _print(table)
    for one in result.engines:
        typer.echo(f"- {one.label}: {one.story}")
    typer.echo(f"wrote {write(result, folder)}")
    assert result.samples is not None
    runs = [aligned.run for aligned in result.samples.aligned]
    _show_output_of_failed(runs)
    _exit_for(runs, within=result.within_tolerance)


@app.command()
def check(
    scenario: Annotated[list[str] | None, typer.Argument(metavar="[SCENARIO]...", help="Default: every shipped one.")] = None,
    engine: EngineNames = None,
    profile: ProfileName = ProfileChoice.QUICK,
    time_limit: TimeLimit = 900.0,
    jobs: Jobs = None,
) -> None:
    """Check the tolerances that stand in the scenarios' files; write nothing.

    Engines whose tolerances a scenario does not name are not run.
    """
    from looping_pendulum.scenarios import loader

    within = True
    for chosen in [_load(name) for name in scenario or loader.shipped()]:
        named = sorted({t.engine for t in chosen.tolerances if t.profile == profile.value})
        wanted = [name for name in named if not engine or any(name == e or name.startswith(f"{e}:") for e in engine)]
        if not wanted:
            typer.echo(f"{chosen.name}: no tolerances for profile {profile.value}")
            continue
        result = _compared(chosen, wanted, profile, None, time_limit, jobs)
        table = _table("scenario", "engine", "metric", "value", "limit", "outcome")
        for t in result.tolerances:
            value = "" if t.value is None else f"{t.value:.6g}"
            table.add_row(chosen.name, t.engine, t.metric, value, f"{t.limit:.6g}", t.outcome.value)
        _print(table)
        within = within and result.within_tolerance
    raise typer.Exit(0 if within else OUTSIDE)


@app.command()
def identify(
    study: Annotated[Path, typer.Argument(metavar="STUDY.yaml", help="Apparatus, declared effects, trials and their files.")],
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Where the report goes; default: report/STUDY.")] = None,
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Of the second start of the fit.")] = 0,
) -> None:
    """Find the physics that a model of measured trials lacks, and report the error before and after adding it.

    Writes report.md with figures, verdict.json and repaired.yaml, a scenario that `compare` runs as it is.

    looping-pendulum identify trials/study.yaml --out report/trials
    """
    for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(variable, "1")  # before numpy comes: threads on such small matrices cost three times what they do

    from looping_pendulum.discrepancy import study_io, writing
    from looping_pendulum.discrepancy.identify import identify as find
    from looping_pendulum.discrepancy.verdict import Verdict

    loaded = study_io.load(study)
    with StageBar() as stages:
        result = find(loaded, seed=seed, progress=stages.update)
    typer.echo(f"{result.verdict.value}: {result.sentence}")
    table = _table("trial", "seen by the fit", "RMS before [mm]", "RMS after [mm]", "before [noise]", "after [noise]")
    for e in result.errors:
        numbers = (1e3 * e.rms_before, 1e3 * e.rms_after, e.noise_before, e.noise_after)
        table.add_row(e.trial, "no" if e.held_out else "yes", *(f"{value:.2f}" for value in numbers))
    _print(table)
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # what was found is written whole; that takes two seconds
    try:
        typer.echo(f"wrote {writing.write(result, out or Path('report') / loaded.name)}")
    finally:
        signal.signal(signal.SIGINT, before)
    if result.verdict is Verdict.INTERRUPTED:
        raise typer.Exit(INTERRUPTED)


def main() -> None:
    """Run the command line; print a user's mistake as one line."""
    debug = "--debug" in sys.argv
    if debug:
        sys.argv.remove("--debug")
    try:
        app()
    except HarnessError as error:
        if debug:
            raise
        typer.echo(f"error: {error}", err=True)
        sys.exit(BAD_INPUT)
    except KeyboardInterrupt:
        typer.echo("interrupted", err=True)
        sys.exit(INTERRUPTED)
    except OSError as error:
        if debug:
            raise
        typer.echo(f"error: {error.filename or ''}: {error.strerror or error}; choose another folder with --out?", err=True)
        sys.exit(BAD_INPUT)
    except Exception as error:
        if debug:
            raise
        typer.echo(f"error: unexpected {type(error).__name__}: {error}; --debug shows where", err=True)
        sys.exit(BAD_INPUT)


def _load(name: str) -> Scenario:
    from looping_pendulum.scenarios import loader

    return loader.load(name)


def _compared(
    scenario: Scenario,
    engine: list[str] | None,
    profile: ProfileChoice,
    data: Path | None,
    time_limit: float,
    jobs: int | None,
) -> ComparisonResult:
    from looping_pendulum.compare.harness import compare_engines

    with EngineBars() as progress:
        return compare_engines(
            scenario,
            engines=engine or (),
            profile=profile.value,
            data_folder=data,
            jobs=jobs,
            time_limit=time_limit,
            progress=progress.update,
            finished=progress.finished,
        )


def _exit_for(runs: list[Trajectory], *, within: bool | None = None) -> None:
    """Leave with the status that the runs deserve."""
    from looping_pendulum.engines.trajectory import RunStatus

    statuses = {run.status for run in runs}
    if RunStatus.INTERRUPTED in statuses:
        raise typer.Exit(INTERRUPTED)
    if within is None:
        gaps = {RunStatus.MISSING, RunStatus.UNSUPPORTED}
        within = all(status.ok or status in gaps for status in statuses)
    raise typer.Exit(0 if within else OUTSIDE)


def _show_output_of_failed(runs: list[Trajectory]) -> None:
    """Show the last lines that a failed engine printed."""
    for run in runs:
        if not run.status.ok and run.output.strip():
            typer.echo(f"{run.label} printed:", err=True)
            for line in run.output.strip().splitlines()[-8:]:
                typer.echo(f"    {line}", err=True)


def _table(*columns: str) -> Any:
    from rich.box import SIMPLE_HEAD
    from rich.markup import escape
    from rich.table import Table

    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for column in columns:
        table.add_column(escape(column), overflow="fold")  # else rich takes "[mm]" for markup
    return table


def _print(table: Any) -> None:
    from rich.console import Console

    console = Console()
    if not console.is_terminal:
        console = Console(width=200)
    console.print(table)


if __name__ == "__main__":
    main()
