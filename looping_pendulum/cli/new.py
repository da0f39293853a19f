"""The command `new`: write a scenario or a study by answering questions. No answer is lost: not by a fault, not by Ctrl-C."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from looping_pendulum.cli.common import scenario_names
from looping_pendulum.cli.terminal import ProgressBars, say
from looping_pendulum.errors import HarnessError, printable

if TYPE_CHECKING:
    from looping_pendulum.jobs import ReportShare
    from looping_pendulum.measured.study import Study
    from looping_pendulum.teaching.questions import Answers

USUAL_SCENARIO = "ten_to_one"
"""Scenario whose numbers are the defaults where none is named."""


class NewFile(StrEnum):
    """Kinds of file that `new` writes."""

    SCENARIO = "scenario"
    STUDY = "study"


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
    ] = USUAL_SCENARIO,
    answers: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Answer beforehand (light.mass=12 g); repeatable."),
    ] = None,
    trial: Annotated[
        list[Path] | None,
        typer.Option(metavar="FILE", help="With `new study`: a trial's tracked points, or its film; repeatable."),
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Ask nothing: take the default where --set has no answer.")] = False,
) -> None:
    """Ask for the numbers of a scenario or a study, with units and defaults, and write the file; every answer is checked.

    A study's files are read first: tracks, rate and units that they state are not asked for. If you break off, a command is
    printed that continues with your answers. An existing file is never overwritten without asking.

    looping-pendulum new study my_study.yaml --trial first.csv --trial second.csv
    """
    from looping_pendulum.files import write_atomically
    from looping_pendulum.teaching.new_file import expected_motion, new_scenario
    from looping_pendulum.teaching.new_study import new_study, not_measured
    from looping_pendulum.teaching.questions import AnswerError, Answers

    study = what is NewFile.STUDY
    path = file or Path("my_study.yaml" if study else "my.scenario.yaml")
    if trial and not study:
        raise AnswerError("--trial: found it with a scenario, needed it with a study; write `new study`")
    given = dict(_key_and_value(answer) for answer in answers or ())
    if path.exists() and (yes or not typer.confirm(printable(f"{path} exists already. Overwrite it?"), default=False)):
        raise AnswerError(f"{path}: found a file, which is left as it is; needed another name: `new {what.value} OTHER.yaml`")
    answer = Answers(_take_default if yes else _ask, given, tell=say, asks_again=not yes)
    name = path.name.removesuffix(".yaml").removesuffix(".scenario")
    files = [str(trial_file) for trial_file in trial or ()]
    try:
        if study:

            def make(answer: Answers) -> str:
                text, loaded = new_study(answer, name=name, folder=path.parent, files=files, like=like, reporting=_bar_alone)
                _check_trials(loaded, ask=not yes)
                return text

            text, notice = answer.write(make), ""
        else:
            text, scenario = answer.write(lambda answer: new_scenario(answer, name=name, like=like))
            notice = expected_motion(scenario)
        write_atomically(path, text)
    except (typer.Abort, KeyboardInterrupt, HarnessError, OSError):
        if not yes and answer.so_far:
            say("\nTo continue with your answers so far:", err=True)
            say(f"  {_command(what, path, like, files, answer.so_far)}", err=True)
        raise
    if notice:
        say(notice)
    if study and yes and (guessed := not_measured(answer)):
        say(f"taken from {like}, and not measured: {', '.join(guessed)}; put your own numbers into the file")
    say(f"wrote {path}; next: looping-pendulum {'identify' if study else 'run'} {path}")


@contextmanager
def _bar_alone() -> Iterator[ReportShare]:
    """A bar while no question is asked, as both write to the last line of a terminal."""
    with ProgressBars() as bars:
        yield bars.update


def _check_trials(study: Study, *, ask: bool) -> None:
    """Warn of what looks wrong in the trials of a study; with ``ask``, what `identify` would refuse can be answered anew."""
    from looping_pendulum.measured.observations import DataError
    from looping_pendulum.teaching.new_study import keys_of_fault, look_at_trials
    from looping_pendulum.teaching.questions import AnswerError

    try:
        with ProgressBars() as bars:
            warnings = look_at_trials(study, bars.update)
        for warning in warnings:
            say(f"warning: {warning}", err=True)
    except DataError as fault:
        if ask and not typer.confirm(
            printable(f"`identify` would refuse this: {fault}\nWrite it all the same?"), default=False
        ):
            say("asking again what may be wrong; Enter keeps an answer")
            raise AnswerError(str(fault), keys=keys_of_fault(study, fault)) from None
        say(f"warning: `identify` will refuse this until it is corrected: {fault}", err=True)


def _command(what: NewFile, path: Path, like: str, files: list[str], answers: Mapping[str, str]) -> str:
    """Return the command that asks only what ``answers`` do not answer."""
    words = ["looping-pendulum", "new", what.value, str(path)]
    words += ["--like", like] if like != USUAL_SCENARIO else []
    words += [word for file in files for word in ("--trial", file)]
    return shlex.join([*words, *(word for key, value in answers.items() for word in ("--set", f"{key}={value}"))])


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
