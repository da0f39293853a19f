"""The commands on studies of measured trials: `look` compares points with what is declared, `identify` finds what lacks."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from looping_pendulum.cli.common import (
    INTERRUPTED,
    AsJson,
    Force,
    Quiet,
    TrackFilms,
    report_folder,
    schema_option,
    settle_films,
    without_interrupts,
)
from looping_pendulum.cli.file_kinds import takes
from looping_pendulum.cli.quantities import quantity
from looping_pendulum.cli.terminal import ProgressBars, note, say, say_prose, show_json, show_table
from looping_pendulum.errors import HarnessError
from looping_pendulum.installation import command_line

if TYPE_CHECKING:
    from looping_pendulum.discrepancy.look.check import DeclarationCheck
    from looping_pendulum.measured.observations import Observations
    from looping_pendulum.measured.study import Study


SET = "--set"
"""Option by which a user says how a table is read."""
SETTINGS = ("frame_rate", "clip_rate", "tracks", "units", "kind", "plane", "box", "run")
"""Keys of a study's trial that it takes."""


MIN_TIME_LIMIT = 0.1
"""Least time limit of a search that begins when the limit of its command is over already [s]."""


def look(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="STUDY.yaml|TABLE",
            help="Study with its trials, or a file of tracked points.",
            callback=takes("study", "table of numbers"),
        ),
    ],
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder for the picture of what looks wrong; default: report/STUDY.")
    ] = None,
    write: Annotated[
        Path | None,
        typer.Option(metavar="PLAIN.csv", help="Write the points as a plain table, which the live page takes."),
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            SET,
            metavar="KEY=VALUE",
            help="How to read a table: 'frame_rate=240 Hz', units.time=ms, 'tracks.light=mass A', run=2; repeatable.",
        ),
    ] = None,
    track: TrackFilms = False,
    force: Force = False,
) -> None:
    """Compare tracked points with what a study declares, in seconds and before any fit; or say how a table is read.

    Names large mistakes of filming or declaration (frame rate, unit, mirrored film, exchanged tracks or masses, angle, diameter
    for radius) with the key that corrects each, and draws what looks wrong: first-look.png. The exit status is 2 then.

    looping-pendulum look trials/study.yaml

    looping-pendulum look trials/first.trk --write plain.csv
    """
    if source.suffix.lower() not in (".yaml", ".yml"):
        if track:
            raise HarnessError("--track: found it beside a table, needed a study of films; leave it out")
        _look_at_table(source, settings or [], write, force=force)
    elif settings:
        raise HarnessError(f"{SET}: found it beside a study, needed a table; write such keys into the study's trial")
    else:
        _look_at_study(source, out, write, force=force, track=track)


def _look_at_table(table: Path, settings: Sequence[str], write: Path | None, *, force: bool) -> None:
    """Say how a file of tracked points is read without a study."""
    from looping_pendulum.compare.trial_files import settings_by_key, trial_of_files
    from looping_pendulum.files import prepare_output_file
    from looping_pendulum.measured.observations import DataError
    from looping_pendulum.measured.tables.readers import read

    if write is not None:
        prepare_output_file(write, force=force, option="--write")
    trial = trial_of_files([str(table)], settings_by_key(settings, SET, SETTINGS), SET)
    try:
        observations = read(
            table,
            tracks=trial.files[0][1],
            units=trial.units,
            kind=trial.kind,
            frame_rate=trial.frame_rate,
            clip_rate=trial.clip_rate,
            plane=trial.plane,
            box=trial.box,
            run=trial.run,
            proposes=True,
        )
    except DataError as error:
        raise DataError(error.on_command_line(SET)) from None
    say_prose(observations.summary())
    if write is not None:
        _write_plain(observations, write)


def _write_plain(observations: Observations, path: Path) -> None:
    from looping_pendulum.files import write_atomically
    from looping_pendulum.measured.tables.plain_table import plain_table

    write_atomically(path, plain_table(observations))
    say(f"wrote {path}")


def _look_at_study(study: Path, out: Path | None, write: Path | None, *, force: bool, track: bool) -> None:
    """Compare the points of a study's trials with what it declares."""
    from looping_pendulum.measured import study_io

    loaded = study_io.load(study)
    _say_what_begins(loaded)
    from looping_pendulum.discrepancy.look.check import take_first_look
    from looping_pendulum.discrepancy.report import figures
    from looping_pendulum.files import prepare_output_file, prepare_output_folder
    from looping_pendulum.measured.observations import UNITS

    folder = out or Path("report") / loaded.name
    if out is not None:  # refuse an unusable folder before the work, not after it
        prepare_output_folder(folder, files=(f"{figures.FIRST_LOOK}.png",))
    plain = {} if write is None else _plain_tables(write, [each.name for each in loaded.trials])
    for path in plain.values():
        prepare_output_file(path, force=force, option="--write")
    settle_films(loaded, track=track)
    with ProgressBars() as bars:
        check = take_first_look(loaded, progress=bars.update)
    for sentence in dict.fromkeys(sentence for trial in check.trials for sentence in trial.reading):
        trials = ", ".join(f"'{trial.trial}'" for trial in check.trials if sentence in trial.reading)
        say_prose(f"read {trials}: {sentence}")
    for trial in check.trials:
        say_prose(trial.text)
    for warning in check.warnings:
        say(f"warning: {warning}")
    if (check.mistakes or check.warnings) and (drawn := _write_picture(check, folder)):
        say(f"wrote {drawn}")
    for name, path in plain.items():
        _write_plain(check.observations[name], path)
    if check.mistakes:
        raise HarnessError("; ".join(mistake.text for mistake in check.mistakes))
    for name, observations in check.observations.items():
        unused: Counter[str] = Counter()
        for left_out in observations.unused:
            column, _, reason = left_out.reason.partition(": ")
            unused[reason if column in UNITS else left_out.reason] += left_out.count
        for reason, count in unused.items():
            say_prose(f"of trial '{name}' {count} values are not used: {reason}")
    if any(trial.distance is not None for trial in check.trials):
        say_prose(
            "such a distance is no fault in itself: the motion is that of the declared values, with what is free at its first "
            "guess; fitting what is free or uncertain comes with `identify`, which judges what is left"
        )
    if not check.warnings:
        say(f"nothing looks wrong; next: {command_line('identify', study)}")


def _say_what_begins(study: Study) -> None:
    """Print what is done next: the import of what does it takes most of a second."""
    note(f"0 %: reading the points of {', '.join(trial.name for trial in study.trials)}")


def _plain_tables(write: Path, trials: Sequence[str]) -> dict[str, Path]:
    """Return the path of each trial's plain table: ``write``, with the trial's name where there are several."""
    from looping_pendulum.files import file_stem

    if len(trials) == 1:
        return {trials[0]: write}
    return {trial: write.with_stem(f"{write.stem}-{file_stem(trial)}") for trial in trials}


@contextmanager
def stop_at_mistakes(folder: Path) -> Iterator[None]:
    """Where the points contradict the study, write the picture into ``folder`` and say how to go on."""
    from looping_pendulum.discrepancy.look.check import DeclarationError

    try:
        yield
    except DeclarationError as error:
        drawn = _write_picture(error.check, folder)
        seen = "" if drawn is None else f"; {drawn} shows it"
        raise HarnessError(f"{error}{seen}; correct the study, or search --anyway") from None


def _write_picture(check: DeclarationCheck, folder: Path) -> Path | None:
    """Write the picture of a first look; None: there is nothing to draw."""
    from looping_pendulum.discrepancy.report import figures
    from looping_pendulum.files import optional_output, write_atomically
    from looping_pendulum.pages.drawing import draw, png

    path = folder / f"{figures.FIRST_LOOK}.png"
    with optional_output(path.name):
        chart = figures.first_look_chart(check)
        if chart is not None:
            write_atomically(path, png(draw(chart)))
            return path
    return None


def films_in_words(count: int, time_limit: float | None) -> str:
    """Say how long a study of films may take (docs/film.md has the times of each step)."""
    films = "a film" if count == 1 else f"{count} films"
    limit = 'end it sooner by --time-limit "2 min", or by Ctrl-C'
    if time_limit is not None:
        limit = f"{time_limit:g} s at most, by --time-limit"
    return (
        f"{films}: a first look takes some 10 s, the search mostly half a minute to two, and up to ten where a law that nobody "
        f"listed is looked for; {limit}"
    )


def identify(
    study: Annotated[
        Path,
        typer.Argument(
            metavar="STUDY.yaml",
            help="Study file: apparatus, declared effects, and the trials' files.",
            callback=takes("study"),
        ),
    ],
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for the report; default: report/STUDY.")] = None,
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Random seed of the fit's second starting point.")] = 0,
    time_limit: Annotated[
        float | None,
        typer.Option(
            metavar="TIME",
            parser=quantity("s", least="1 s"),
            help="Take at most this time [s]: end the search before, and report its results so far.",
        ),
    ] = None,
    schema: Annotated[bool, schema_option("study", "looping_pendulum.measured.study_io")] = False,
    as_json: AsJson = False,
    quiet: Quiet = False,
    anyway: Annotated[
        bool, typer.Option("--anyway", help="Search even if the tracked points contradict what the study declares.")
    ] = False,
    track: TrackFilms = False,
) -> None:
    """Find the physics that a model of measured trials lacks, and report the model's error before and after adding it.

    Before the search it takes a first look, as `look` does, and stops if the points contradict the study. Writes report.md,
    report.html with figures, verdict.json and repaired.yaml, a scenario file that `compare` can run.

    looping-pendulum identify trials/study.yaml --out report/trials
    """
    began = time.monotonic()
    from looping_pendulum.measured import study_io

    loaded = study_io.load(study)
    _say_what_begins(loaded)
    from looping_pendulum.discrepancy.identify import identify as find
    from looping_pendulum.discrepancy.report import writing
    from looping_pendulum.discrepancy.result import Verdict
    from looping_pendulum.files import prepare_output_folder
    from looping_pendulum.measured.film import is_film

    folder = out or Path("report") / loaded.name
    prepare_output_folder(folder, files=writing.FILES, folders=writing.FOLDERS, record="verdict.json")
    settle_films(loaded, track=track)
    if films := [path for trial in loaded.trials for path, _ in trial.files if is_film(path)]:
        note(films_in_words(len(films), time_limit))
    left = None if time_limit is None else max(time_limit - (time.monotonic() - began), MIN_TIME_LIMIT)
    with stop_at_mistakes(folder), ProgressBars() as bars:
        result = find(loaded, seed=seed, progress=bars.update, time_limit=left, anyway=anyway)
    interrupted = result.verdict is Verdict.INTERRUPTED
    with without_interrupts():
        folder = report_folder(folder, "verdict.json", interrupted=interrupted)
        written = writing.write(result, folder)
    say_prose(f"{result.verdict.value}: {result.sentence}")
    for each in result.notes:
        say_prose(each)
    rows = []
    for e in result.errors:
        # A trial without tracked points has measured events only, and so no RMS distance.
        sizes = ["" if rms is None else f"{1e3 * rms:.2f}" for rms in (e.rms_before, e.rms_after)]
        sizes += [f"{rms:.2f}" for rms in (e.standardised_rms_before, e.standardised_rms_after)]
        rows.append([e.trial, "yes" if e.held_out else "no", *sizes])
    show_table(["trial", "held out", "RMS before [mm]", "RMS after [mm]", "before [noise]", "after [noise]"], rows)
    say(f"wrote {written} and report.html")
    summary = {"verdict": result.verdict, "sentence": result.sentence, "notes": result.notes, "errors": result.errors}
    show_json({"study": loaded.name, **summary, "report": written})
    if interrupted:
        raise typer.Exit(INTERRUPTED)
