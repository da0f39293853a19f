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
    OUTSIDE,
    EngineNames,
    Jobs,
    MemoryLimit,
    ProfileChoice,
    ProfileName,
    TimeLimit,
    beside_complete_comparison,
    exit_for,
    load_scenario,
    run_and_compare,
    show_output_of_failed,
)
from looping_pendulum.cli.progress import StageBar
from looping_pendulum.cli.terminal import say
from looping_pendulum.errors import printable

EXAMPLE_FOLDER = Path("looping-pendulum-example")


class NewFile(StrEnum):
    """What `new` writes."""

    SCENARIO = "scenario"
    STUDY = "study"


def demo(
    scenario: Annotated[
        str, typer.Argument(metavar="[SCENARIO]", help="Shipped scenario, or path of a YAML file.")
    ] = "ten_to_one",
    engine: EngineNames = None,
    profile: ProfileName = ProfileChoice.QUICK,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Where the page goes and results are kept; default: report/SCENARIO.")
    ] = None,
    no_open: Annotated[bool, typer.Option("--no-open", help="Write the page and do not open it in a browser.")] = False,
    again: Annotated[bool, typer.Option("--again", help="Run the engines although DIR has their results.")] = False,
    time_limit: TimeLimit = 900.0,
    memory_limit: MemoryLimit = "2 GiB",
    jobs: Jobs = None,
) -> None:
    """Show the reference and all engines whip round the rod together: one page that works offline.

    Play it in slow motion, switch engines off, and see when each stops, sticks, slips and halts. Writes demo.html beside what
    `compare` writes; where DIR has `compare`'s results of the same input and versions, no engine runs again.

    looping-pendulum demo two_to_one --no-open
    """
    from looping_pendulum.compare import write
    from looping_pendulum.compare.harness import chosen_engines
    from looping_pendulum.compare.stored import stored_result
    from looping_pendulum.engines.protocol import Profile
    from looping_pendulum.files import ready_folder
    from looping_pendulum.teaching import demo as pages

    chosen = load_scenario(scenario)
    folder = out or Path("report") / chosen.name
    ready_folder(folder, files=(*COMPARE_FILES, pages.FILE), folders=COMPARE_FOLDERS)  # before the work, not after it
    engines = chosen_engines(engine or (), Profile(profile.value))
    result = None if again else stored_result(folder, chosen, engines)
    if result is None:
        result = run_and_compare(chosen, engine, profile, time_limit=time_limit, memory_limit=memory_limit, jobs=jobs)
        folder = beside_complete_comparison(folder, result)
        write(result, folder)
    else:
        say(f"{folder} has the results of this input; --again runs the engines anew", err=True)
    path = pages.write(result, folder)
    say(f"wrote {path}")
    if not no_open and not pages.show(path):
        say(f"found no browser to open it; open {path.resolve().as_uri()} in one")
    assert result.samples is not None
    runs = [aligned.run for aligned in result.samples.aligned]
    show_output_of_failed(runs)
    exit_for(runs, within=True)


def tracker(
    source: Annotated[
        str, typer.Argument(metavar="SOURCE", help="A scenario's name or file, a folder of `compare`, or a CSV file of `run`.")
    ],
    engine: Annotated[
        str | None,
        typer.Option(
            "--engine", "-e", metavar="NAME", help="Run or take this variant (mujoco:capstan); default: the reference."
        ),
    ] = None,
    fps: Annotated[float, typer.Option(metavar="RATE", help="True frame rate of the video.")] = 240.0,
    start: Annotated[
        float, typer.Option(metavar="SECONDS", help="When the masses are let go, by the video's own clock.")
    ] = 0.0,
    profile: ProfileName = ProfileChoice.QUICK,
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="Where it goes; default: NAME-tracker.csv.")] = None,
) -> None:
    """Write a motion as a file that Tracker draws on top of a video (docs/tracker.md).

    Columns t,heavyx,heavyy,lightx,lighty: seconds by the video's clock and metres from the rod's axis, x to the right, y up;
    one row per frame. In Tracker: set the axes' origin on the rod, then Track > New > External Model.

    looping-pendulum tracker ten_to_one --fps 240 --start 0.35 --out overlay.csv
    """
    from looping_pendulum.engines.protocol import Profile
    from looping_pendulum.files import file_stem, ready_folder, write_whole
    from looping_pendulum.teaching.tracker import find_motion, overlay

    path = out or Path(f"{file_stem(Path(source).stem, engine or '')}-tracker.csv")
    ready_folder(path.parent, files=(path.name,))
    found = overlay(find_motion(source, engine, Profile(profile.value)), frame_rate=fps, start=start)
    write_whole(path, found.to_csv())
    last = found.first_frame + len(found.t) - 1
    say(f"wrote {path}: {found.name}; one row per frame, frames {found.first_frame} to {last} at {fps:g} a second")
    say(f"In Tracker's Model Builder, set the start frame to {found.first_frame}.")


def init(
    folder: Annotated[Path, typer.Argument(metavar="[DIR]", help="A new or an empty folder.")] = EXAMPLE_FOLDER,
) -> None:
    """Put an example folder in place: a scenario, a study of two filmed trials, and a page with the next commands.

    A folder that holds anything is left as it is.

    looping-pendulum init my_pendulum
    """
    from looping_pendulum.teaching.example_folder import place

    for path in place(folder):
        say(f"wrote {path}")
    say(f"Next: cd {folder}, and read README.md; it begins with: looping-pendulum run mine.scenario.yaml")


def new(
    what: Annotated[NewFile, typer.Argument(help="A trial to run, or filmed trials to learn from.")] = NewFile.SCENARIO,
    file: Annotated[
        Path | None, typer.Argument(metavar="[FILE.yaml]", help="Default: my.scenario.yaml, or my_study.yaml.")
    ] = None,
    like: Annotated[
        str, typer.Option(metavar="SCENARIO", help="Whose numbers are offered: a shipped scenario, or a file.")
    ] = "ten_to_one",
    answers: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Answer beforehand (light.mass=12 g); repeatable.")
    ] = None,
    trial: Annotated[
        list[Path] | None, typer.Option(metavar="CSV", help="Of a study: the marks of a trial; repeatable.")
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Ask nothing: take the defaults that --set leaves.")] = False,
) -> None:
    """Write a scenario or a study by asking, with units and defaults; each answer is checked as it comes.

    A file that is there is never written over without asking.

    looping-pendulum new scenario my.scenario.yaml --like two_to_one
    """
    from looping_pendulum.compare.export import write_whole
    from looping_pendulum.teaching.new_file import new_scenario, new_study, outlook
    from looping_pendulum.teaching.questions import AnswerError

    study = what is NewFile.STUDY
    path = file or Path("my_study.yaml" if study else "my.scenario.yaml")
    if trial and not study:
        raise AnswerError("--trial: found it with a scenario, needed it with a study; write `new study`")
    if path.exists() and (yes or not typer.confirm(printable(f"{path} is there already. Write over it?"), default=False)):
        raise AnswerError(f"{path}: found a file, which is left as it is; needed another name: `new {what.value} OTHER.yaml`")
    given = dict(_key_and_value(each) for each in answers or ())
    ask = _take_default if yes else _ask
    name = path.name.removesuffix(".yaml").removesuffix(".scenario")
    if study:
        files = [str(each) for each in trial or ()]
        text = new_study(ask, name=name, folder=path.parent, files=files, given=given, like=like)
    else:
        text, scenario = new_scenario(ask, name=name, like=like, given=given)
        say(outlook(scenario))
    write_whole(path, text)
    say(f"wrote {path}; next: looping-pendulum {'identify' if study else 'run'} {path}")


def _ask(words: str, default: str, check: Callable[[str], str]) -> str:
    """Ask until an answer can be used."""
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
    """Answer with the default."""
    check(default)
    return default


def _key_and_value(text: str) -> tuple[str, str]:
    from looping_pendulum.teaching.questions import AnswerError

    key, equals, value = text.partition("=")
    if not (key.strip() and equals and value.strip()):
        raise AnswerError(f"--set: found '{text}', needed KEY=VALUE; write for example --set 'light.mass=12 g'")
    return key.strip(), value.strip()


def demonstrations(
    name: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME]...", help="Which; default: all nine. --list shows their names.")
    ] = None,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Where the pages go.")] = Path("demonstrations"),
    html: Annotated[bool, typer.Option(help="Whether to write HTML beside Markdown.")] = True,
    listed: Annotated[bool, typer.Option("--list", help="List them and run nothing.")] = False,
) -> None:
    """Show what each model assumes: a question, a guess, an experiment that is run now, and its answer.

    Writes a page per demonstration, as Markdown with a figure and as one HTML file. Exit status 1 if a run does not bear out
    what a page says.

    looping-pendulum demonstrations polygon --out demonstrations
    """
    from looping_pendulum.files import ready_folder, write_whole
    from looping_pendulum.teaching.demonstrations.demonstration import show
    from looping_pendulum.teaching.demonstrations.page import NOT_BORNE_OUT, find, index, write, write_index

    chosen = find(name or ())
    if listed:
        for each in chosen:
            say(f"{each.name:26} {each.title}")
        return
    ready_folder(out)  # before the work, not after it
    borne_out = True
    with StageBar() as stages:
        for done, each in enumerate(chosen):
            shown = show(each, lambda what, share, done=done: stages.update(what, (done + share) / len(chosen)))  # type: ignore[misc]
            pages = write(shown, out, with_html=html)
            say(f"{each.title}: wrote {pages[-1]}")
            for sentence in shown.answer:
                if not sentence.holds:
                    say(f"  {NOT_BORNE_OUT} {sentence.text}", err=True)
            borne_out = borne_out and shown.borne_out
    if html:
        say(f"wrote {write_index(out)}")
    elif not name:
        write_whole(out / "index.md", index())
    raise typer.Exit(0 if borne_out else OUTSIDE)
