"""The questions of `new study` about the file of a trial: only what the file itself does not say is asked."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from looping_pendulum.measured import readers
from looping_pendulum.measured.clock import RATE_TOLERANCE
from looping_pendulum.measured.observations import DataError
from looping_pendulum.measured.readers import LENGTH_UNITS, MASSES, FileSurvey, mass_in_name, survey
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios.document import quote, shorten
from looping_pendulum.scenarios.fields import QuantityField, suggest
from looping_pendulum.scenarios.quantities import QUANTITIES
from looping_pendulum.scenarios.units import UnitError, show, to_si
from looping_pendulum.teaching.answers import Answers, Tree, put
from looping_pendulum.teaching.questions import AnswerError, check_release, check_text, read

TRIAL_KEYS = (
    "file",
    "light_track",
    "heavy_track",
    "units.length",
    "units.time",
    "frame_rate",
    "run",
    "mirrored",
    "release.kind",
)
"""Keys of the questions below, after "trials.1."."""
RELEASE_OF_KIND = {"positions": Release.LOOPING, "events": Release.LOOPING, "angle": Release.HELD, "drop": Release.DROP}
"""Kind of a file -> release that it most probably shows."""
PLAYBACK_RATE = 61.0
"""Rate at or below which a film may be slow motion that was marked as it plays [Hz]: films play at 24 to 60 frames a second."""
MAX_PROPOSED, MAX_PROPOSED_SIZE = 20, 2_000_000
"""Largest number of files, and their largest size [bytes], that are looked into for one to propose."""
NO_TRACK = "-"
"""Answer for a mass that was not tracked."""
_RATE = QuantityField(QUANTITIES["frame_rate"].kind)


def trial_file(answer: Answers, index: int, file: str, before: Sequence[Tree]) -> Tree:
    """Ask for the file of a trial, and for what the file does not say of itself.

    Parameters
    ----------
    file
        The file, if it is known already; otherwise ''.
    before
        The trials before this one, whose names this one must not have.

    Returns
    -------
    dict
        Entries of the trial in a study; the path of the file is still as the user wrote it.
    """
    at, lead = f"trials.{index + 1}", f"Trial {index + 1}: "
    path = file or answer(f"{at}.file", f"{lead}file of its marks", _usual_file(index, before), check_file)
    if not Path(path).exists():
        tracks = {
            mass: answer(f"{at}.{mass}_track", f"{lead}name of the {mass} mass's track", mass, check_text) for mass in MASSES
        }
        return {"name": _name(Path(path).stem, before), "file": path, "tracks": tracks}
    found = _survey(path)
    answer.tell(f"{path}: {_summary(found)}")
    tree: Tree = {"name": Path(path).stem, "file": path}
    _ask_release(answer, at, lead, found, tree)
    if len(found.runs) > 1:
        taken = [trial.get("run") for trial in before if trial["file"] == path]
        default = next((n for n in found.runs if n not in taken), found.runs[0])
        run = answer(f"{at}.run", f"{lead}number of the run", default, lambda a: check_choice(a, found.runs))
        tree |= {"name": f"{tree['name']}-{run}", "run": run}
    tree["name"] = _name(tree["name"], before)
    if found.tracks:
        _ask_tracks(answer, at, lead, found, tree)
    _ask_units(answer, at, lead, found, tree)
    _ask_rate(answer, at, lead, found, tree)
    _check_reading(at, path, tree, asked=not file)
    return tree


def _survey(path: str) -> FileSurvey:
    try:
        return survey(path)
    except DataError as error:
        raise AnswerError(str(error)) from None


def _summary(found: FileSurvey) -> str:
    """Say in one line what a file says of itself."""
    if found.kind == "events":
        return "a table of events"
    names = ", ".join(f"'{shorten(t.name)}'" if t.name else "one without a name" for t in found.tracks)
    what = {"drop": "heights", "angle": "angles"}.get(
        found.kind, f"tracks {names}" if found.has_names else "two tracks, no names"
    )
    rate = _rows_per_second(found)
    rows = "no times, only frames" if rate is None else f"{rate:.4g} rows a second" if rate else "a single row"
    lengths = "" if found.kind == "angle" else f"; lengths in {found.length_unit or 'a unit that it does not name'}"
    return f"{what}; {rows}{lengths}"


def _rows_per_second(found: FileSurvey) -> float | None:
    """Return the rate of the rows by the file's own times [Hz]; 0 if it has one row, None without times."""
    if found.time_step is None:
        return None
    seconds = found.time_step * _factor(found.proposed_time_unit, "s")
    return 1 / seconds if seconds > 0 else 0.0


def _factor(unit: str, si: str) -> float:
    try:
        return to_si(f"1 {unit}", si)
    except UnitError:
        return 1.0  # a unit that is none is refused where the file is read


def _ask_release(answer: Answers, at: str, lead: str, found: FileSurvey, tree: Tree) -> None:
    """Ask for the kind of release, if the file shows another than the demonstration's."""
    usual = RELEASE_OF_KIND[found.kind]
    key = f"{at}.release.kind"
    if usual is Release.LOOPING:
        kind = answer.optional(key, check_release) or usual.value
    else:
        kind = answer(key, f"{lead}kind of release ({', '.join(Release)})", usual.value, check_release)
    if kind != Release.LOOPING.value:
        put(tree, "release.kind", kind)


def _ask_tracks(answer: Answers, at: str, lead: str, found: FileSurvey, tree: Tree) -> None:
    """Ask which track is which mass; the names say it, or the motion proposes it."""
    names = [t.name for t in found.tracks]
    proposed = found.proposed_masses()
    stated = {mass_in_name(name) for name in names}
    masses: dict[str, str] = {}
    for mass in MASSES:
        key, default = f"{at}.{mass}_track", proposed.get(mass, NO_TRACK)

        def check(name: str) -> str:
            return check_choice(name, (*names, NO_TRACK))

        if names == [""] or mass in stated:
            # One unnamed track, or one that says its mass: nothing to ask
            name = answer.optional(key, check) or default
        else:
            choices = f"{', '.join(map(quote, names))}, or {NO_TRACK} for none"
            words = f"{lead}track of the {mass} mass ({choices}{_reason(found, mass, proposed)})"
            name = answer(key, words, default, check)
        if name != NO_TRACK:
            masses[mass] = name
    if not masses or len(set(masses.values())) < len(masses):
        tracks = (f"{at}.light_track", f"{at}.heavy_track")
        raise AnswerError("found no track, or one track for both masses, needed one for each mass that was marked", keys=tracks)
    # In the order of the columns, by which a file without names is read
    tree["tracks"] = {m: masses[m] for m in sorted(masses, key=lambda mass: names.index(masses[mass]))}
    mirrored = "yes" if found.starts_on_the_right(masses) else "no"
    if (answer.optional(f"{at}.mirrored", check_yes_or_no) or mirrored) == "yes":
        answer.tell(f"{found.file}: the light mass starts on the right, so the picture is taken as mirrored")
        tree["mirrored"] = "true"


def _reason(found: FileSurvey, mass: str, proposed: dict[str, str]) -> str:
    """Say why a track is proposed for a mass."""
    track = next((t for t in found.tracks if t.name == proposed.get(mass)), None)
    if track is None or mass != "heavy":
        return ""
    unit = f" {found.length_unit}" if found.length_unit else ""
    return f"; {quote(track.name)} moves {track.width:.2g}{unit} sideways and {track.fall:.2g}{unit} down"


def _ask_units(answer: Answers, at: str, lead: str, found: FileSurvey, tree: Tree) -> None:
    """Ask for the units that the header does not give."""
    if found.kind in ("positions", "drop") and not found.length_unit:
        words = f"{lead}unit of the lengths in {found.file} ({', '.join(LENGTH_UNITS)}, in)"
        unit = answer(f"{at}.units.length", words, found.proposed_length_unit, lambda a: check_unit(a, "m"))
        if unit != "m":
            put(tree, "units.length", unit)
    key = f"{at}.units.time"
    if found.time_step is not None and not found.time_unit and found.proposed_time_unit != "s":
        words = f"{lead}unit of the times in {found.file}, which has a row every {found.time_step:.4g}"
        unit = answer(key, words, found.proposed_time_unit, lambda a: check_unit(a, "s"))
    else:
        unit = answer.optional(key, lambda a: check_unit(a, "s")) or "s"
    if unit != "s":
        put(tree, "units.time", unit)


def _ask_rate(answer: Answers, at: str, lead: str, found: FileSurvey, tree: Tree) -> None:
    """Ask for the true frame rate, if the file has no times, or so few rows a second that it may be slow motion as it plays."""
    rate, key = _rows_per_second(found), f"{at}.frame_rate"
    if found.kind != "positions" or (rate is not None and rate > PLAYBACK_RATE):
        text = answer.optional(key, check_rate)
    elif rate:
        words = f"{lead}true frame rate of the camera (the file has {rate:.4g} rows a second; slow motion plays so, too)"
        text = answer(key, words, show(float(f"{rate:.4g}"), "Hz"), check_rate)
    else:
        text = answer(key, f"{lead}true frame rate of the camera (the file has no times)", "240 Hz", check_rate)
    if text is not None and not (rate and abs(_RATE.read(text) / rate - 1) < RATE_TOLERANCE):
        tree["frame_rate"] = text


def _check_reading(at: str, path: str, tree: Tree, *, asked: bool) -> None:
    """Read the file as `identify` will.

    Raises
    ------
    AnswerError
        If it cannot be read so.
    """
    options: dict[str, Any] = {key: tree[key] for key in ("tracks", "units", "run") if key in tree}
    if "frame_rate" in tree:
        options["frame_rate"] = _RATE.read(tree["frame_rate"])
    try:
        readers.read(path, **options)
    except DataError as error:
        # A file that was not asked for cannot be asked for again, but what was said about it can
        about = ("units", "frame_rate", "light_track", "heavy_track", "run", *(("file",) if asked else ()))
        raise AnswerError(str(error), keys=tuple(f"{at}.{key}" for key in about)) from None


def _usual_file(index: int, before: Sequence[Tree]) -> str:
    """Return the first file of tracked points in the current folder, or in one below it, that no trial has yet, or a name."""
    taken = {Path(trial["file"]) for trial in before}
    tables = [p for pattern in ("*.csv", "*/*.csv") for p in sorted(Path().glob(pattern)) if p not in taken]
    small = [p for p in tables[:MAX_PROPOSED] if p.stat().st_size < MAX_PROPOSED_SIZE]
    return next((str(p) for p in small if _has_tracks(p)), f"trial{index + 1}.csv")


def _has_tracks(path: Path) -> bool:
    try:
        return bool(survey(path).tracks)
    except DataError:
        return False


def _name(stem: str, before: Sequence[Tree]) -> str:
    """Return a name for a trial that none before it has."""
    taken = {trial["name"] for trial in before}
    return next(name for n in range(1, len(taken) + 2) if (name := stem if n == 1 else f"{stem}-{n}") not in taken)


def check_file(path: str) -> str:
    """Check that a file can be read; return a warning if it does not exist yet.

    Raises
    ------
    AnswerError
        If it exists and cannot be used, or if its name is nearly that of another one.
    """
    if not Path(path).exists():
        folder = Path(path).parent
        near = suggest(path, [str(p) for p in folder.iterdir() if p.is_file()] if folder.is_dir() else ())
        if near:
            raise AnswerError(f"found no file {quote(path)}{near}")
        return f"{path} is not there yet; put it there before `identify`"
    _survey(path)
    return ""


def check_choice(answer: str, choices: Any) -> str:
    """Check that an answer is one of several.

    Raises
    ------
    AnswerError
        If it is not.
    """
    known = tuple(choices)
    if answer not in known:
        raise AnswerError(f"expected one of {', '.join(map(quote, known))}, got {quote(answer)}{suggest(answer, known)}")
    return ""


def check_unit(answer: str, si: str) -> str:
    """Check a unit that converts to the SI unit ``si``.

    Raises
    ------
    AnswerError
        If it is none.
    """
    try:
        to_si(f"1 {answer}", si)
    except UnitError as error:
        detail = f" ({error})" if str(error) else ""
        example = "cm" if si == "m" else "ms"
        raise AnswerError(f"expected a unit that converts to {si}, got {quote(answer)}{detail}; write '{example}'") from None
    return ""


def check_rate(answer: str) -> str:
    """Check a frame rate.

    Raises
    ------
    AnswerError
        If it is none.
    """
    read(_RATE, answer)
    return ""


def check_yes_or_no(answer: str) -> str:
    """Check an answer of yes or no.

    Raises
    ------
    AnswerError
        If it is neither.
    """
    return check_choice(answer, ("yes", "no"))
