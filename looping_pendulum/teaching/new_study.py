"""Ask for a study of filmed trials, and write its YAML; what the trials' files say of themselves is not asked."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

from looping_pendulum.film.decode import is_film
from looping_pendulum.jobs import ReportShare
from looping_pendulum.measured import readers, study_io
from looping_pendulum.measured.clock import RATE_TOLERANCE
from looping_pendulum.measured.observations import DataError
from looping_pendulum.measured.readers import LENGTH_UNITS, MASSES, FileSurvey, mass_in_name, survey
from looping_pendulum.measured.study import REQUIRED, Study, film_files
from looping_pendulum.measured.study_file import MeasuredField
from looping_pendulum.reference_ode.effects import EFFECTS
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios.document import quote, shorten
from looping_pendulum.scenarios.fields import QuantityField, suggest
from looping_pendulum.scenarios.quantities import QUANTITIES
from looping_pendulum.scenarios.units import UnitError, show, to_si
from looping_pendulum.teaching.new_file import scenario_tree
from looping_pendulum.teaching.questions import (
    QUESTIONS,
    AnswerError,
    Answers,
    Tree,
    check_measured,
    check_release,
    check_text,
    get,
    put,
    read,
    yaml_text,
)

STUDY_HEAD = """\
# "+/-" is the standard error of what was measured; "free" is what nobody knows. Then: looping-pendulum identify THIS_FILE
"""
USUAL_EFFECTS = "capstan, light_drag, heavy_drag, string_drag"
"""Default of the effects that a study declares, beside gravity: the friction, and the air's drag on all that moves.

A drag that is not declared is ascribed to what acts alike: without the string's, a side force of 5.0 mN came out as 4.3 mN.
"""
USUAL_EFFECTS_WITHOUT_ROD = {Release.HELD: "light_drag", Release.DROP: "heavy_drag"}
"""Release -> the same for a study of such trials alone; on a string of one length, its drag looks like the mass's."""
MEASURED_PER_TRIAL = {
    Release.LOOPING: ("heavy.mass", "release.angle", "release.free_length", "release.hanging_length"),
    Release.VERTICAL: ("heavy.mass", "release.free_length", "release.hanging_length"),
    Release.HELD: ("release.free_length",),
    Release.DROP: ("heavy.mass",),
}
"""Release -> keys of what is measured for each trial."""
Reporting = Callable[[], AbstractContextManager[ReportShare | None]]
LENGTH_OF_FILM = "release.free_length"
"""Key of the length by which a film is tracked."""
APPARATUS = {"light.mass": "light_mass", "rod.radius": "rod_radius"}
"""Key of what is measured once for all trials -> parameter."""
STUDY_KEYS = ("title", "count", "effects", *APPARATUS)
"""Keys of the questions about the whole study."""
KEYS_OF_DATA = ("units", "frame_rate", "release")
"""Keys of a trial's questions that decide how its data compare with the motion."""
MAX_TRIALS = 20
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


def new_study(
    answer: Answers, *, name: str, folder: Path, files: Sequence[str], like: str, reporting: Reporting = nullcontext
) -> tuple[str, Study]:
    """Ask for a study of filmed trials.

    Parameters
    ----------
    answer
        How to ask, and what was answered beforehand.
    folder
        Folder of the study file; the trials' paths are written relative to it.
    files
        The trials' files, relative to the current folder; if empty, they are asked for.
    like
        Shipped scenario, or file, whose numbers are the defaults.
    reporting
        Returns a context with a function that is called while a film is tracked, for what it shows of the release.

    Returns
    -------
    text : str
        YAML of the file.
    study : Study
        The study that the file loads to.

    Raises
    ------
    AnswerError
        If a file is not there or cannot be used, or if an answer was given to a question that there is not.
    StudyError
        If the answers contradict each other.
    """
    for file in files:
        if not Path(file).exists():
            raise AnswerError(f"--trial: found no file {quote(file)}, needed the file of a trial's marks; correct the path")
        if not is_film(file):
            _survey(file)  # before any question, as no answer corrects a file that is not understood
    _refuse_unknown_keys(answer)
    defaults = scenario_tree(like)
    tree: Tree = {"title": answer("title", "Title, a few words", name.replace("_", " "), check_text), "apparatus": {}}
    count = len(files) or int(answer("count", "How many trials were filmed", "2", check_count))
    trials: list[Tree] = []
    for i in range(count):
        trials.append(trial_file(answer, i, files[i] if files else "", trials))
    releases = {Release(get(trial, "release.kind") or Release.LOOPING) for trial in trials}
    for key, parameter in APPARATUS.items():
        if any(parameter in REQUIRED[release] for release in releases):
            put(tree["apparatus"], key, _measured(answer, key, key, defaults))
    only = next(iter(releases)) if len(releases) == 1 else Release.LOOPING
    usual_effects = USUAL_EFFECTS_WITHOUT_ROD.get(only, USUAL_EFFECTS)
    declared_effects = answer("effects", "Effects that you believe act, beside gravity", usual_effects, check_effects)
    tree["effects"] = {"gravity": "9.81 m/s^2"} | {effect: "free" for effect in _split_effects(declared_effects)}
    for i, trial in enumerate(trials):
        _measure_trial(answer, i, count, trial, defaults, get(tree["apparatus"], "rod.radius"), reporting)
        # With forward slashes, so that the study also loads on another system
        trial["file"] = Path(os.path.relpath(trial["file"], folder)).as_posix()
    tree["trials"] = trials
    for key in answer.unused:
        raise AnswerError(f"--set: found {quote(key)}, which is not asked for in this study; leave it out", keys=(key,))
    text = STUDY_HEAD + yaml_text(tree, ("title", "apparatus", "effects", "trials"))
    # Loaded for contradictions between answers, which show here, before the file is written
    return text, study_io.load_text(text, f"{name}.yaml", folder)


def look_at_trials(study: Study, progress: ReportShare) -> tuple[str, ...]:
    """Read the trials of a study as `identify` will, and return its warnings; none if a file is not there yet.

    Parameters
    ----------
    progress
        Called while films are tracked.

    Raises
    ------
    DataError
        If `identify` would refuse them.
    """
    # These import what fits, which takes a second
    from looping_pendulum.discrepancy.first_look.check import take_first_look
    from looping_pendulum.discrepancy.inputs import read_inputs

    if not all((study.folder / path).exists() for trial in study.trials for path, _ in trial.files):
        return ()
    # In the order of `identify`: a first look says more of lengths in pixels than that they are implausible
    check = take_first_look(study, progress)
    check.refuse_mistakes()
    read_inputs(study, check.observations)
    return check.warnings


def not_measured(answer: Answers) -> list[str]:
    """Return the keys of the measurements that were asked for, of which nobody may have thought if defaults were taken."""
    return [key for key in answer.asked if key.endswith(tuple(q.key for q in QUESTIONS.values() if q.usual_error))]


def keys_of_fault(study: Study, fault: DataError) -> tuple[str, ...]:
    """Return the keys of the questions to ask again; empty: all of them.

    Those about one trial's data are enough if the fault names that trial, and no value of the apparatus.
    """
    from looping_pendulum.discrepancy.first_look.check import DeclarationError

    if isinstance(fault, DeclarationError) and not all(m.keys.startswith(KEYS_OF_DATA) for m in fault.check.mistakes):
        return ()  # a mass, a radius, a track
    index = next((i for i, trial in enumerate(study.trials, 1) if str(fault).startswith(f"trial {trial.name!r}:")), None)
    return () if index is None else tuple(f"trials.{index}.{key}" for key in KEYS_OF_DATA)


def _refuse_unknown_keys(answer: Answers) -> None:
    """Refuse answers to questions that there are not, before any is asked."""
    known = (*STUDY_KEYS, *(f"trials.1.{key}" for key in (*TRIAL_KEYS, "held_out", *MEASURED_PER_TRIAL[Release.LOOPING])))
    for key in tuple(answer.unused):
        if re.sub(r"^trials\.[1-9][0-9]?\.", "trials.1.", key) not in known:
            message = f"--set: found {quote(key)}, which is not asked for{suggest(key, known)}"
            raise AnswerError(f"{message}; ask for the file and change it there, as docs/keys.md says", keys=(key,))


def _measure_trial(
    answer: Answers, index: int, count: int, trial: Tree, defaults: Tree, radius: str | None, reporting: Reporting
) -> None:
    """Ask for what was measured of one trial."""
    at, lead = f"trials.{index + 1}", f"Trial {index + 1}: "
    held_out = "no" if count == 1 or index < count - 1 else "yes"
    if (
        answer(f"{at}.held_out", f"{lead}keep it away from the fit, to judge the verdict on", held_out, check_yes_or_no)
        == "yes"
    ):
        trial["held_out"] = "true"
    keys = MEASURED_PER_TRIAL[Release(get(trial, "release.kind") or Release.LOOPING)]
    shown: dict[str, str] = {}
    if is_film(trial["file"]):  # one length is measured, and the film shows the others
        keys = (LENGTH_OF_FILM, *(key for key in keys if key != LENGTH_OF_FILM))
    for key in keys:
        before = next((a for i in range(index, 0, -1) if (a := answer.known.get(f"trials.{i}.{key}"))), None)
        put(trial, key, _measured(answer, f"{at}.{key}", key, defaults, shown.get(key) or before, lead))
        if key == LENGTH_OF_FILM and is_film(trial["file"]):
            shown = _shown_by_film(answer, trial, radius, reporting)


def _shown_by_film(answer: Answers, trial: Tree, radius: str | None, reporting: Reporting) -> dict[str, str]:
    """Return what a film shows of its release, as answers by their keys; none, with the reason said, without its track."""
    from looping_pendulum.film.output import stated_release

    length = MeasuredField(QUANTITIES["free_length"].kind).estimate(get(trial, LENGTH_OF_FILM))
    rod = None if radius is None else MeasuredField(QUANTITIES["rod_radius"].kind).estimate(radius).value
    try:
        with reporting() as progress:
            files = film_files(Path(trial["file"]), length, rod, None, progress)
    except DataError as error:
        answer.tell(str(error))
        return {}
    return {f"release.{key}": text for key, text in stated_release(files).items()}


def _measured(answer: Answers, key: str, question: str, defaults: Tree, before: str | None = None, lead: str = "") -> str:
    """Ask for a quantity with its standard error; ``before`` is the answer for the trial before."""
    asked = QUESTIONS[question]
    usual = get(defaults, question) or get(scenario_tree("ten_to_one"), question)
    return answer(key, lead + asked.question, before or f"{usual} +/- {asked.usual_error}", check_measured(asked))


def check_effects(answer: str) -> str:
    """Check names of effects, separated by commas.

    Raises
    ------
    AnswerError
        If one is unknown, or has no value to start from.
    """
    for effect in _split_effects(answer):
        if effect not in EFFECTS:
            raise AnswerError(
                f"found an unknown effect '{effect}', needed some of: {', '.join(EFFECTS)}{suggest(effect, EFFECTS)}"
            )
        first = EFFECTS[effect].coefficients[0]
        has_start = first.name in QUANTITIES and QUANTITIES[first.name].free_start is not None
        if effect != "gravity" and not has_start and first.default != first.null:
            raise AnswerError(f"found '{effect}', which has no value to start from; add it to the file by hand")
    return ""


def _split_effects(answer: str) -> list[str]:
    """Return the names of effects in an answer, without gravity, which every study has."""
    return [effect for part in answer.split(",") if (effect := part.strip()) and effect != "gravity"]


def check_count(answer: str) -> str:
    """Check a number of trials.

    Raises
    ------
    AnswerError
        If it is no whole number, or too large.
    """
    if not (answer.isascii() and answer.isdigit() and 0 < int(answer) <= MAX_TRIALS):
        raise AnswerError(f"expected a whole number from 1 to {MAX_TRIALS}, got '{answer}'")
    return "with a single trial, blocks of time are held out; a second trial tells more" if answer == "1" else ""


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
    if is_film(path):
        answer.tell(f"{path}: a film, which tells the release's angle by the free length; NAME.track.png will show the marks")
        return {"name": _name(Path(path).stem, before), "file": path}
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
    if not is_film(path):
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
