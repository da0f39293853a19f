"""What several commands share: their options, the run of engines, the folder of a report, and the exit status."""

from __future__ import annotations

import json
import signal
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from importlib import import_module
from importlib.metadata import entry_points
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from looping_pendulum.cli.file_kinds import takes
from looping_pendulum.cli.quantities import quantity
from looping_pendulum.cli.terminal import ProgressBars, choose_json, choose_quiet, note, say, say_prose, show_table
from looping_pendulum.engines import Profile, own_labels
from looping_pendulum.errors import HarnessError, ScenarioError

if TYPE_CHECKING:
    from looping_pendulum.compare.result import ComparisonResult
    from looping_pendulum.compare.trial import MeasuredTrial
    from looping_pendulum.measured.study import Study
    from looping_pendulum.runs.trajectory import Trajectory
    from looping_pendulum.scenarios.scenario import Scenario


def scenario_names() -> list[str]:
    """Return the names of the shipped scenarios."""
    return _names("scenarios")


def map_names() -> list[str]:
    """Return the names of the shipped maps."""
    return _names("sweep", "maps")


def _names(*folders: str) -> list[str]:
    # From the package above, whose import is cheap, as that of the folder's own package is not
    entries = files("looping_pendulum").joinpath(*folders).iterdir()
    return sorted(entry.name.removesuffix(".yaml") for entry in entries if entry.name.endswith(".yaml"))


def engine_names() -> list[str]:
    """Return the names of engines and variants; of other packages' engines, only the engine's name is known."""
    labels = own_labels()
    others = sorted({point.name for point in entry_points(group="looping_pendulum.engines")})
    return list(dict.fromkeys([*(label.partition(":")[0] for label in labels), *labels, *others, "all"]))


OUTSIDE_TOLERANCE, BAD_INPUT, INTERRUPTED = 1, 2, 130
"""Exit statuses beside 0; 130 is the shell's own for a command that Ctrl-C ended."""
INTERRUPTED_FOLDER = "interrupted"
"""Name of the folder of an interrupted report, inside the folder of an earlier one."""


ScenarioName = Annotated[
    str,
    typer.Argument(
        metavar="SCENARIO",
        help="Name of a shipped scenario (see `scenarios`), or path of a YAML file.",
        autocompletion=scenario_names,
        callback=takes("scenario"),
    ),
]
OptionalScenario = Annotated[
    str,
    typer.Argument(
        metavar="[SCENARIO]",
        help="Shipped scenario, or path of a YAML file.",
        autocompletion=scenario_names,
        callback=takes("scenario"),
    ),
]
EngineNames = Annotated[
    list[str] | None,
    typer.Option(
        "--engine",
        "-e",
        metavar="NAME",
        help="Run this engine (pymunk) or variant (mujoco:capstan), or all; repeatable.",
        autocompletion=engine_names,
    ),
]
ProfileName = Annotated[
    Profile,
    typer.Option("--profile", "-p", help="Settings of the engines. quick: a run takes seconds to a minute. accurate: minutes."),
]
TimeLimit = Annotated[
    float,
    typer.Option(
        metavar="TIME",
        parser=quantity("s", least="0.1 s"),
        help="Stop an engine's run after this time [s], and keep its samples.",
    ),
]
MemoryLimit = Annotated[
    int,
    typer.Option(
        metavar="AMOUNT",
        # Python with NumPy takes half of the least
        parser=lambda given: int(quantity("byte", least="64 MiB")(given)),
        show_default="2 GiB",
        help="Stop an engine's run that uses more memory, and keep its samples.",
    ),
]
MAX_JOBS = 1024
"""Largest value of --jobs; above it a number is a mistake, as no machine has as many cores."""
Jobs = Annotated[
    int | None, typer.Option(metavar="N", min=1, max=MAX_JOBS, help="Number of runs at the same time; default: one per core.")
]
AsJson = Annotated[
    bool,
    typer.Option(
        "--json", callback=choose_json, help="Print the results as one JSON document, in SI units, and nothing else on stdout."
    ),
]
Quiet = Annotated[
    bool,
    typer.Option(
        "--quiet", "-q", callback=choose_quiet, help="Print errors only, no results and no progress; with --json, the document."
    ),
]
DataFolder = Annotated[
    Path | None,
    typer.Option("--data", metavar="DIR", help="Folder with measured tables (paper/...); default: $LOOPING_PENDULUM_DATA."),
]


Force = Annotated[bool, typer.Option("--force", help="Overwrite a file that is there; without it, it is left as it is.")]


def schema_option(kind: str, module: str) -> Any:
    """Return the option --schema, which prints the JSON Schema of a kind of file and ends the command.

    Parameters
    ----------
    module
        Import path of the module whose function ``json_schema`` returns it; imported on use.
    """

    def show(ctx: typer.Context, wanted: bool) -> None:
        # While a shell completes a line, it is parsed, but must print nothing of its own
        if wanted and not ctx.resilient_parsing:
            say(json.dumps(import_module(module).json_schema(), indent=2))
            raise typer.Exit

    words = f"Print the JSON Schema of {kind} files, for editors (every key, and what it takes)."
    return typer.Option("--schema", is_eager=True, callback=show, help=words)


def yaml_content(text: str) -> Any:
    """Return the content of a YAML file that has been checked, as plain data for JSON."""
    import yaml

    return yaml.safe_load(text)


MarksFiles = Annotated[
    list[str] | None,
    typer.Option(
        "--marks",
        metavar="FILE",
        callback=takes("table of numbers", "study"),
        help="Draw and judge your own trial: a file of tracked points (or light=FILE and heavy=FILE) or events, or a study.",
    ),
]
MarksSettings = Annotated[
    list[str] | None,
    typer.Option(
        "--marks-set",
        metavar="KEY=VALUE",
        help="How to read it: 'tracks.light=mass A', 'frame_rate=240 Hz', units.length=cm, mirrored=true, "
        "'camera.clock_offset=-0.35 s'; repeatable.",
    ),
]


def read_marks(files: list[str] | None, settings: list[str] | None) -> MeasuredTrial | None:
    """Read the trial of --marks; None without one."""
    from looping_pendulum.compare.trial_files import read_measured_trial

    if files:
        return read_measured_trial(files, settings or ())
    if settings:
        raise HarnessError("--marks-set: found it without --marks, needed the trial's file; add for example --marks trial.csv")
    return None


TrackFilms = Annotated[
    bool, typer.Option("--track", help="Track films that have no points, or were tracked with other values.")
]


def settle_films(study: Study, *, track: bool) -> None:
    """Track a study's films as far as it is needed and asked for."""
    from looping_pendulum.measured.film import is_film
    from looping_pendulum.measured.film_points import settle_film
    from looping_pendulum.measured.study import stated_of_film

    for trial in study.trials:
        stated = stated_of_film(trial, study.estimate("rod_radius", trial))
        for film in (study.folder / path for path, _ in trial.files if is_film(path)):
            with ProgressBars() as bars:
                settle_film(film, stated, track=track, progress=bars.update)


def load_scenario(name: str) -> Scenario:
    """Load a shipped scenario, or a scenario file."""
    from looping_pendulum.scenarios import loader

    if name in engine_names() and not Path(name).exists():
        raise ScenarioError(f"{name}: found an engine, needed a scenario; write for example: ten_to_one --engine {name}")
    return loader.load(name)


def run_and_compare(
    scenario: Scenario,
    engine: list[str] | None,
    profile: Profile,
    *,
    data: Path | None = None,
    trial: MeasuredTrial | None = None,
    time_limit: float,
    memory_limit: int,
    jobs: int | None,
    meanwhile: Callable[[ComparisonResult, tuple[str, ...]], None] | None = None,
) -> ComparisonResult:
    """Run engines on ``scenario``, showing their progress, and compare them with the reference.

    ``meanwhile`` gets the comparison of those that have ended, with the labels of those that go on.
    """
    from looping_pendulum.compare.harness import compare_engines

    with ProgressBars(time_left=True, keep=True) as bars:
        return compare_engines(
            scenario,
            engines=engine or (),
            profile=profile.value,
            data_folder=data,
            trial=trial,
            jobs=jobs,
            time_limit=time_limit,
            memory_limit=memory_limit,
            progress=bars.update_engine,
            finished=bars.show_finished_run,
            meanwhile=meanwhile,
        )


def page_meanwhile(folder: Path) -> Callable[[ComparisonResult, tuple[str, ...]], None] | None:
    """Return a function that writes report.html while engines still run; None where ``folder`` has a report already.

    An earlier report is kept until this one is complete, as this one may be interrupted.
    """
    from looping_pendulum.compare import write_page_meanwhile

    if (folder / "result.json").exists():
        return None
    announced = False

    def write(result: ComparisonResult, running: tuple[str, ...]) -> None:
        nonlocal announced
        write_page_meanwhile(result, running, folder)
        if not announced:
            note(f"{folder / 'report.html'} has the engines that have ended; reload it for the others")
            announced = True

    return write


def show_residuals(result: ComparisonResult) -> None:
    """Print what a measured trial says of the reference and of each engine, and what looks like a mistake in it."""
    from looping_pendulum.compare.report import short_residual_rows

    if result.trial is None:
        return
    say(f"Trial {result.trial.name}, measured less predicted:")
    head, rows = short_residual_rows(result)
    if rows:
        show_table(head, rows)
    for remark in result.trial.notes:
        say_prose(f"- {remark}")


COMPARE_FILES, COMPARE_FOLDERS = ("result.json", "report.md", "report.html", "residuals.csv"), ("figures", "trajectories")
"""Files and folders that `compare.write` writes."""


def report_folder(folder: Path, record: str, *, interrupted: bool) -> Path:
    """Return the folder to write a report into: ``folder``, or one inside it where an interrupted one would replace another.

    ``record`` is the name of the file by which an earlier report is known.
    """
    if not (interrupted and (folder / record).exists()):
        return folder
    say(f"interrupted: the earlier report in {folder} is kept; this one goes into {folder / INTERRUPTED_FOLDER}", err=True)
    return folder / INTERRUPTED_FOLDER


@contextmanager
def without_interrupts() -> Iterator[None]:
    """Ignore Ctrl-C, which must not cut a report short: writing one takes two seconds."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def exit_with_status(runs: Iterable[Trajectory], *, within: bool | None = None) -> NoReturn:
    """Print the last lines of what each failed engine printed, and exit with the status of ``runs``.

    It is `INTERRUPTED`, `OUTSIDE_TOLERANCE` or 0.

    Parameters
    ----------
    within
        Whether all tolerances are kept; None: whether all runs that could be started reached their end.
    """
    from looping_pendulum.runs.trajectory import RunStatus

    statuses = set()
    for run in runs:
        statuses.add(run.status)
        if not run.status.ok and run.output.strip():
            say(f"{run.label} printed:", err=True)
            for line in run.output.strip().splitlines()[-8:]:
                say(f"    {line}", err=True)
    if RunStatus.INTERRUPTED in statuses:
        raise typer.Exit(INTERRUPTED)
    if within is None:
        not_started = {RunStatus.MISSING, RunStatus.UNSUPPORTED}
        within = all(status.ok or status in not_started for status in statuses)
    raise typer.Exit(0 if within else OUTSIDE_TOLERANCE)
