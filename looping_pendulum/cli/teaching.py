"""Commands for teaching: a demonstration, a new scenario, an example folder, a file for Tracker."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from looping_pendulum.cli.common import (
    COMPARE_FILES,
    COMPARE_FOLDERS,
    OUTSIDE_TOLERANCE,
    EngineNames,
    Jobs,
    MemoryLimit,
    ProfileChoice,
    ProfileName,
    TimeLimit,
    comparison_folder,
    exit_with_status,
    load_scenario,
    run_and_compare,
    show_output_of_failed,
)
from looping_pendulum.cli.completion import engine_names, scenario_names
from looping_pendulum.cli.progress import ProgressBars
from looping_pendulum.cli.terminal import note, say
from looping_pendulum.errors import printable

EXAMPLE_FOLDER = Path("looping-pendulum-example")
"""Folder that `init` fills where none is named."""


class NewFile(StrEnum):
    """Kinds of file that `new` writes."""

    SCENARIO = "scenario"
    STUDY = "study"


def demo(
    scenario: Annotated[
        str,
        typer.Argument(metavar="[SCENARIO]", help="Shipped scenario, or path of a YAML file.", autocompletion=scenario_names),
    ] = "ten_to_one",
    engine: EngineNames = None,
    profile: ProfileName = ProfileChoice.QUICK,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder for the page and the results; default: report/SCENARIO.")
    ] = None,
    no_open: Annotated[bool, typer.Option("--no-open", help="Write the page, but do not open it in a browser.")] = False,
    again: Annotated[bool, typer.Option("--again", help="Run the engines even if DIR has their results.")] = False,
    time_limit: TimeLimit = 900.0,
    memory_limit: MemoryLimit = "2 GiB",
    jobs: Jobs = None,
) -> None:
    """Animate the reference and all engines together, on one web page that works offline.

    Play it in slow motion, switch engines off, and see when each stops, sticks, slips and halts. Writes demo.html beside the
    files of `compare`; if DIR has `compare`'s results of the same input and versions, no engine runs again.

    looping-pendulum demo two_to_one --no-open
    """
    from looping_pendulum.compare import write
    from looping_pendulum.compare.harness import chosen_engines
    from looping_pendulum.compare.stored import stored_result
    from looping_pendulum.engines.protocol import Profile
    from looping_pendulum.files import prepare_output_folder
    from looping_pendulum.teaching import demo as pages

    chosen = load_scenario(scenario)
    folder = out or Path("report") / chosen.name
    prepare_output_folder(
        folder, files=(*COMPARE_FILES, pages.FILE), folders=COMPARE_FOLDERS
    )  # refuse an unusable folder before the work, not after it
    engines = chosen_engines(engine or (), Profile(profile.value))
    result = None if again else stored_result(folder, chosen, engines)
    if result is None:
        result = run_and_compare(chosen, engine, profile, time_limit=time_limit, memory_limit=memory_limit, jobs=jobs)
        folder = comparison_folder(folder, result)
        write(result, folder)
    else:
        note(f"{folder} has the results of this input; use --again to run the engines again")
    path = pages.write(result, folder)
    say(f"wrote {path}")
    if not no_open and not pages.show(path):
        say(f"no browser was found; open {path.resolve().as_uri()} in one")
    assert result.samples is not None
    runs = [aligned.run for aligned in result.samples.aligned]
    show_output_of_failed(runs)
    # The command shows the motion, and judges no tolerance
    exit_with_status(runs, within=True)


def tracker(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE",
            help="Scenario (name or file), folder that `compare` wrote, or CSV file that `run` wrote.",
            autocompletion=scenario_names,
        ),
    ],
    engine: Annotated[
        str | None,
        typer.Option(
            "--engine",
            "-e",
            metavar="NAME",
            help="Take the motion of this variant (mujoco:capstan); default: the reference.",
            autocompletion=engine_names,
        ),
    ] = None,
    fps: Annotated[float, typer.Option(metavar="RATE", help="True frame rate of the video.")] = 240.0,
    start: Annotated[float, typer.Option(metavar="SECONDS", help="Time of the release by the video's clock.")] = 0.0,
    profile: ProfileName = ProfileChoice.QUICK,
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="File to write; default: NAME-tracker.csv.")] = None,
) -> None:
    """Write a motion as a file that Tracker draws over a video (docs/tracker.md).

    Columns t,heavyx,heavyy,lightx,lighty: seconds by the video's clock and metres from the rod's axis, x to the right, y up;
    one row per frame. In Tracker: set the axes' origin on the rod, then Track > New > External Model.

    looping-pendulum tracker ten_to_one --fps 240 --start 0.35 --out overlay.csv
    """
    from looping_pendulum.engines.protocol import Profile
    from looping_pendulum.files import file_stem, prepare_output_folder, write_atomically
    from looping_pendulum.teaching.tracker import find_motion, overlay

    path = out or Path(f"{file_stem(Path(source).stem, engine or '')}-tracker.csv")
    prepare_output_folder(path.parent, files=(path.name,))
    frames = overlay(find_motion(source, engine, Profile(profile.value)), frame_rate=fps, start=start)
    write_atomically(path, frames.to_csv())
    last = frames.first_frame + len(frames.t) - 1
    say(f"wrote {path}: {frames.name}; one row per frame, frames {frames.first_frame} to {last} at {fps:g} a second")
    say(f"In Tracker's Model Builder, set the start frame to {frames.first_frame}.")


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
    say(f"Next: cd {folder}, and read README.md; it begins with: looping-pendulum run mine.scenario.yaml")


def new(
    what: Annotated[NewFile, typer.Argument(help="A trial to run, or filmed trials to explain.")] = NewFile.SCENARIO,
    file: Annotated[
        Path | None, typer.Argument(metavar="[FILE.yaml]", help="Default: my.scenario.yaml, or my_study.yaml.")
    ] = None,
    like: Annotated[
        str,
        typer.Option(
            metavar="SCENARIO",
            help="Scenario (name or file) whose numbers are offered as defaults.",
            autocompletion=scenario_names,
        ),
    ] = "ten_to_one",
    answers: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Answer beforehand (light.mass=12 g); repeatable."),
    ] = None,
    trial: Annotated[
        list[Path] | None, typer.Option(metavar="CSV", help="With `new study`: file of a trial's tracked points; repeatable.")
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Ask nothing: take the default where --set has no answer.")] = False,
) -> None:
    """Ask for the numbers of a scenario or a study, with units and defaults, and write the file; every answer is checked.

    An existing file is never overwritten without asking.

    looping-pendulum new scenario my.scenario.yaml --like two_to_one
    """
    from looping_pendulum.compare.export import write_atomically
    from looping_pendulum.teaching.new_file import expected_motion, new_scenario, new_study
    from looping_pendulum.teaching.questions import AnswerError

    study = what is NewFile.STUDY
    path = file or Path("my_study.yaml" if study else "my.scenario.yaml")
    if trial and not study:
        raise AnswerError("--trial: found it with a scenario, needed it with a study; write `new study`")
    if path.exists() and (yes or not typer.confirm(printable(f"{path} exists already. Overwrite it?"), default=False)):
        raise AnswerError(f"{path}: found a file, which is left as it is; needed another name: `new {what.value} OTHER.yaml`")
    given = dict(_key_and_value(answer) for answer in answers or ())
    ask = _take_default if yes else _ask
    name = path.name.removesuffix(".yaml").removesuffix(".scenario")
    if study:
        files = [str(trial_file) for trial_file in trial or ()]
        text = new_study(ask, name=name, folder=path.parent, files=files, given=given, like=like)
    else:
        text, scenario = new_scenario(ask, name=name, like=like, given=given)
        say(expected_motion(scenario))
    write_atomically(path, text)
    say(f"wrote {path}; next: looping-pendulum {'identify' if study else 'run'} {path}")


def _ask(words: str, default: str, check: Callable[[str], str]) -> str:
    """Ask until the answer passes its check."""
    from looping_pendulum.teaching.questions import AnswerError

    while True:
        answer = str(typer.prompt(printable(f"{words} [{default}]"), default=default, show_default=False)).strip()
        try:
            warning = check(answer)
        except AnswerError as error:
            say(f"  {error}")
            continue
        if warning:
            say(f"  {warning}")
        return answer


def _take_default(words: str, default: str, check: Callable[[str], str]) -> str:
    """Return the default, after its check."""
    check(default)
    return default


def _key_and_value(text: str) -> tuple[str, str]:
    """Split an answer of --set into key and value."""
    from looping_pendulum.teaching.questions import AnswerError

    key, equals, value = text.partition("=")
    if not (key.strip() and equals and value.strip()):
        raise AnswerError(f"--set: found '{text}', needed KEY=VALUE; write for example --set 'light.mass=12 g'")
    return key.strip(), value.strip()


def demonstrations(
    name: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME]...", help="Names of demonstrations (see --list); default: all nine.")
    ] = None,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for the pages.")] = Path("demonstrations"),
    html: Annotated[bool, typer.Option(help="Whether to write HTML files beside the Markdown files.")] = True,
    listed: Annotated[bool, typer.Option("--list", help="List the demonstrations, and run nothing.")] = False,
) -> None:
    """Show what each model assumes: a question, a guess, an experiment that is run now, and the answer.

    Writes a page per demonstration, as Markdown with a figure and as one HTML file. The exit status is 1 if a run contradicts
    what a page says.

    looping-pendulum demonstrations polygon --out demonstrations
    """
    from looping_pendulum.files import prepare_output_folder, write_atomically
    from looping_pendulum.teaching.demonstrations.demonstration import run_demonstration
    from looping_pendulum.teaching.demonstrations.page import (
        NOT_BORNE_OUT,
        find_demonstrations,
        index,
        write_index,
        write_pages,
    )

    chosen = find_demonstrations(name or ())
    if listed:
        for demonstration in chosen:
            say(f"{demonstration.name:26} {demonstration.title}")
        return
    prepare_output_folder(out)  # refuse an unusable folder before the work, not after it
    all_hold = True
    with ProgressBars() as bars:
        for i, demonstration in enumerate(chosen):

            def report_progress(description: str, fraction: float, i: int = i) -> None:
                bars.update(description, (i + fraction) / len(chosen))

            result = run_demonstration(demonstration, report_progress)
            pages = write_pages(result, out, with_html=html)
            say(f"{demonstration.title}: wrote {pages[-1]}")
            for claim in result.answer:
                if not claim.holds:
                    say(f"  {NOT_BORNE_OUT} {claim.text}", err=True)
            all_hold = all_hold and result.all_claims_hold
    if html:
        say(f"wrote {write_index(out)}")
    elif not name:
        write_atomically(out / "index.md", index())
    raise typer.Exit(0 if all_hold else OUTSIDE_TOLERANCE)
