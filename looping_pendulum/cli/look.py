"""First look at a study: the command `look`, and the same before `identify`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from looping_pendulum.cli.terminal import say
from looping_pendulum.errors import HarnessError

if TYPE_CHECKING:
    from looping_pendulum.discrepancy.first_look.result import DeclarationCheck


class FirstLookError(HarnessError, ValueError):
    """Tracked points contradict a study; the message says how to go on."""


def look(
    study: Annotated[
        Path, typer.Argument(metavar="STUDY.yaml", help="Study file: apparatus, declared effects, and the trials' files.")
    ],
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for the picture; default: report/STUDY.")] = None,
) -> None:
    """Compare tracked points with what a study declares, in seconds and before any fit.

    Names large mistakes of filming or declaration (frame rate, unit, mirrored film, exchanged tracks or masses, angle, diameter
    for radius) with the key that mends each, and draws first-look.png. The exit status is 2 if something looks wrong.

    looping-pendulum look trials/study.yaml
    """
    from looping_pendulum.discrepancy.data import study_io
    from looping_pendulum.discrepancy.first_look import picture
    from looping_pendulum.discrepancy.first_look.check import take_first_look
    from looping_pendulum.files import prepare_output_folder

    loaded = study_io.load(study)
    folder = out or Path("report") / loaded.name
    prepare_output_folder(folder, files=(picture.NAME,))  # refuse an unusable folder before the work, not after it
    check = take_first_look(loaded)
    for trial in check.trials:
        say(trial.text)
    for warning in check.warnings:
        say(f"warning: {warning}")
    drawn = _write_picture(check, folder)
    if drawn is not None:
        say(f"wrote {drawn}")
    if check.mistakes:
        raise FirstLookError("; ".join(mistake.text for mistake in check.mistakes))
    if not check.warnings:
        say("nothing looks wrong")


@contextmanager
def stop_at_mistakes(folder: Path) -> Iterator[None]:
    """Where the points contradict the study, write the picture into ``folder`` and say how to go on."""
    from looping_pendulum.discrepancy.first_look.result import DeclarationError

    try:
        yield
    except DeclarationError as error:
        drawn = _write_picture(error.check, folder)
        seen = "" if drawn is None else f"; {drawn} shows it"
        raise FirstLookError(f"{error}{seen}; correct the study, or search --anyway") from None


def _write_picture(check: DeclarationCheck, folder: Path) -> Path | None:
    """Write the picture of a first look; None: there is nothing to draw."""
    from looping_pendulum.discrepancy.first_look import picture
    from looping_pendulum.files import optional_output, write_atomically

    with optional_output(picture.NAME):
        image = picture.draw(check)
        if image is not None:
            write_atomically(folder / picture.NAME, image)
            return folder / picture.NAME
    return None
