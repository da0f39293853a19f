"""Write a commented scenario, or a study of what films and tables show; what only a person can measure stays marked there."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import yaml
from pydantic_core import PydanticCustomError

from looping_pendulum.errors import HarnessError, ParameterError
from looping_pendulum.measured.film import is_film
from looping_pendulum.measured.film_points import settle_film
from looping_pendulum.measured.observations import DataError
from looping_pendulum.measured.study import REQUIRED
from looping_pendulum.measured.study_file import Estimate, MeasuredField
from looping_pendulum.measured.tables.readers import FileSurvey, mass_in_name, survey
from looping_pendulum.processes import ReportShare
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios import loader
from looping_pendulum.scenarios.document import quote
from looping_pendulum.scenarios.fields import TO_FILL_IN, FieldType, QuantityField
from looping_pendulum.scenarios.quantities import QUANTITIES

PLAYBACK_RATE = 61.0
"""Rate at or below which a table may be of slow motion as it plays [Hz]: films play at 24 to 60 frames a second."""
RELEASE_OF_KIND = {"positions": Release.LOOPING, "events": Release.LOOPING, "angle": Release.HELD, "drop": Release.DROP}
"""Kind of a file -> release that it most probably shows."""
USUAL_EFFECTS = ("capstan", "light_drag", "heavy_drag", "string_drag")
"""Effects that a study declares, beside gravity: the friction, and the air's drag on all that moves.

A drag that is not declared is ascribed to what acts alike: without the string's, a side force of 5.0 mN came out as 4.3 mN.
"""
USUAL_EFFECTS_WITHOUT_ROD = {Release.HELD: ("light_drag",), Release.DROP: ("heavy_drag",)}
"""Release -> the same for a study of such trials alone; on a string of one length, its drag looks like the mass's."""
SHARED = ("light_mass", "light_radius", "rod_radius")
"""What a study has once for all trials, of what is measured."""
Reporting = Callable[[], AbstractContextManager[ReportShare | None]]
"""Returns a context with a function to call while a film is tracked."""


class NewFileError(HarnessError, ValueError):
    """No file can be written from what was given; the message says what was found, what was needed and an example."""


def new_scenario(name: str, *, like: str, given: Mapping[str, str]) -> str:
    """Return the YAML of a scenario.

    Parameters
    ----------
    name
        Its title.
    like
        Shipped scenario, or file, with the values that are not given.
    given
        Name of a quantity -> value with its unit.

    Raises
    ------
    NewFileError
        If a value cannot be read, or if the values contradict each other.
    """
    values = {quantity: _read(QuantityField(QUANTITIES[quantity].kind), quantity, text) for quantity, text in given.items()}
    start = loader.load(like)
    duration = values.pop("duration", start.duration)
    friction = {n: values.pop(n) for n in tuple(values) if n in start.parameters.coefficients}
    if "kinetic_friction" in friction:  # a single coefficient, unless the file is given another
        friction["static_friction"] = friction["kinetic_friction"]
    try:
        parameters = replace(start.parameters, **values, coefficients={**start.parameters.coefficients, **friction})
    except ParameterError as error:
        raise NewFileError(f"{error}; these are the given values and those of {like}") from None
    scenario = replace(
        start, title=name, description="", parameters=parameters, duration=duration, inferred=(), measured=None, tolerances=()
    )
    lines = [
        "# yaml-language-server: $schema=scenario.schema.json",
        "# A trial: an apparatus and how it is released. Every number carries its unit. Change one, save, and run it again:",
        "# looping-pendulum run THIS_FILE",
        *_commented({key: value for key, value in yaml.safe_load(loader.dump(scenario)).items() if value != ""}),
    ]
    return "\n".join(lines) + "\n"


def _commented(tree: Mapping[str, Any], group: str = "", indent: str = "") -> list[str]:
    """Return the lines of a group of a scenario, each known quantity with its meaning."""
    meanings = {q.key: q.description().removesuffix(".") for q in QUANTITIES.values()}
    lines = []
    for key, value in tree.items():
        if isinstance(value, dict):
            lines += [f"{indent}{key}:", *_commented(value, f"{group}{key}.", f"{indent}  ")]
        else:
            meaning = meanings.get(group + key, "")
            lines.append(f"{indent}{key}: {_scalar(value)}" + (f"  # {meaning}" if meaning else ""))
    return lines


def new_study(
    title: str,
    folder: Path,
    files: Sequence[Path],
    given: Mapping[str, Sequence[str]],
    reporting: Reporting,
    *,
    track: bool = False,
    keep: bool = False,
) -> str:
    """Return the YAML of a study, in which `TO_FILL_IN` stands for each value that is neither given nor shown by a file.

    Parameters
    ----------
    folder
        Folder of the study; the trials' paths are written relative to it.
    files
        Films and tables, in the order of their trials.
    given
        Name of a quantity -> its value with its unit and standard error, one for all files or one for each.
    reporting
        Context in which films are tracked, for what they show of the release.
    track, keep
        Of a film that has no points, or was tracked with other values than the given ones: whether to track it, or to take the
        points that are there.

    Raises
    ------
    NewFileError
        If a file is not there or not understood, or if a value cannot be read.
    """
    for quantity, texts in given.items():
        for text in texts:
            estimate_of(quantity, text)  # refused here, before a film is tracked
        if len(texts) not in ((1,) if quantity in SHARED else (1, len(files))):
            count = "one" if quantity in SHARED else f"one for all files, or {len(files)}"
            raise NewFileError(f"{_option(quantity)}: found {len(texts)} values, needed {count}")
    trials: list[_Trial] = []
    for i, file in enumerate(files):
        mine = {quantity: texts[i if len(texts) > 1 else 0] for quantity, texts in given.items()}
        trials += _trials_of(file, mine, reporting, track=track, keep=keep)
    shared = {quantity: texts[0] for quantity, texts in given.items()}
    releases = {trial.release for trial in trials}
    names = _different_names(trials)
    lines = [
        "# yaml-language-server: $schema=study.schema.json",
        "# Trials of one apparatus: what was measured, and what the films and tables show.",
        f'# Write a value with its unit and its standard error wherever {TO_FILL_IN} stands: "20 g +/- 0.1 g"; or',
        '# "free from 20 g" if nobody knows it. Then: looping-pendulum look THIS_FILE',
        f"title: {_scalar(title)}",
    ]
    needed = [q for q in SHARED if any(q in REQUIRED[release] for release in releases)]
    if "rod_radius" in needed:  # what winds up comes to the rod, where its size counts
        needed.insert(1, "light_radius")
    if needed:
        lines.append("apparatus:  # in all trials; one in which it differs may have the same keys")
    shown = next((trial.shown for trial in trials if "light_radius" in trial.shown), {})
    for group in dict.fromkeys(QUANTITIES[quantity].group for quantity in needed):
        lines.append(f"  {group}:")
        for quantity in (q for q in needed if QUANTITIES[q].group == group):
            lines.append(_measured(quantity, shared, "    ", shown))
    usual = USUAL_EFFECTS_WITHOUT_ROD.get(next(iter(releases)), USUAL_EFFECTS) if len(releases) == 1 else USUAL_EFFECTS
    lines += ["effects:  # that you believe act; `looping-pendulum identify --schema` lists all", "  gravity: 9.81 m/s^2"]
    lines += [f"  {effect}: free" for effect in usual]
    lines.append("trials:")
    for i, (trial, name) in enumerate(zip(trials, names, strict=True)):
        # With forward slashes, so that the study also loads on another system
        path = Path(os.path.relpath(trial.file, folder)).as_posix()
        lines += [f"  # {trial.says}", f"  - name: {_scalar(name)}", f"    file: {_scalar(path)}"]
        lines += [f"    run: {_scalar(trial.run)}"] if trial.run else []
        lines += trial.reading
        if 0 < i == len(trials) - 1:
            lines.append("    held_out: true  # kept away from the fit, to judge the verdict on")
        lines += trial.measured
    return "\n".join(lines) + "\n"


@dataclass(frozen=True, kw_only=True)
class _Trial:
    """A trial of the study, and the lines of its entry."""

    file: Path
    says: str
    """What the file says of itself, in a line."""
    release: Release
    run: str = ""
    """Number of the run, in a file of several."""
    reading: Sequence[str] = ()
    """Lines on how to read the file."""
    measured: Sequence[str]
    """Lines of what was measured."""
    shown: Mapping[str, str] = field(default_factory=dict)
    """Name of a quantity -> its value with its standard error, where a film shows it."""


def _different_names(trials: Sequence[_Trial]) -> list[str]:
    """Return a name for each trial, by its file and run."""
    names: list[str] = []
    for trial in trials:
        stem = f"{trial.file.stem}-{trial.run}" if trial.run else trial.file.stem
        others = (stem, *(f"{stem}-{n}" for n in range(2, len(trials) + 1)))
        names.append(next(name for name in others if name not in names))
    return names


def _trials_of(file: Path, given: Mapping[str, str], reporting: Reporting, *, track: bool, keep: bool) -> list[_Trial]:
    """Return the trial of a film or table, or that of each run in it."""
    if not file.exists():
        raise NewFileError(f"found no file {quote(str(file))}, needed a film or a table of tracked points; correct the path")
    if is_film(file):
        says = f"a film; {file.stem}.track.png beside it shows what was tracked: check it"
        shown = _shown_by_film(file, given, reporting, track=track, keep=keep)
        measured = _measured_lines(Release.LOOPING, given, shown)
        return [_Trial(file=file, says=says, release=Release.LOOPING, measured=measured, shown=shown)]
    try:
        found = survey(file)
    except DataError as error:
        raise NewFileError(str(error)) from None
    release = RELEASE_OF_KIND[found.kind]
    return [
        _Trial(
            file=file,
            says=_summary(found),
            release=release,
            run=run,
            reading=_reading_lines(found),
            measured=_measured_lines(release, given, {}),
        )
        for run in (found.runs if len(found.runs) > 1 else ("",))
    ]


def _shown_by_film(film: Path, given: Mapping[str, str], reporting: Reporting, *, track: bool, keep: bool) -> dict[str, str]:
    """Return what a film shows of ball and release, by the names of quantities; nothing without the free length, its scale."""
    if "free_length" not in given:
        return {}
    length = estimate_of("free_length", given["free_length"])
    stated = {"free_length": length.value, "free_length_error": length.sigma or 0.0}
    if "rod_radius" in given:
        radius = estimate_of("rod_radius", given["rod_radius"])
        stated |= {"rod_radius": radius.value, "rod_radius_error": radius.sigma or 0.0}
    try:
        with reporting() as progress:
            return settle_film(film, stated, track=track, keep=keep, progress=progress).shown()
    except DataError as error:
        raise NewFileError(str(error)) from None


def _reading_lines(found: FileSurvey) -> list[str]:
    """Return the lines that say how a table is read where it does not say so itself; what is guessed has a comment."""
    lines = []
    masses = found.masses
    if any(mass_in_name(name) != mass for mass, name in masses.items()):
        lines.append("    tracks:  # by their motion, as their names do not say it: the heavy mass falls along a vertical line")
        lines += [f"      {mass}: {_scalar(name)}" for mass, name in masses.items()]
    units = found.units
    if units:
        lines.append("    units:  # guessed, as the file does not name them")
        lines += [f"      {kind}: {unit}" for kind, unit in units.items()]
    rate = _rows_per_second(found)
    if found.kind == "positions" and rate is None:
        lines.append(f"    frame_rate: {TO_FILL_IN}  # true frame rate of the camera, such as 240 Hz: the file has no times")
    elif found.kind == "positions" and rate is not None and 0 < rate <= PLAYBACK_RATE:
        lines.append("    # frame_rate: 240 Hz  # without the first '#', for slow motion: the camera's true rate")
    if found.starts_on_the_right:
        lines.append("    mirrored: true  # the light mass starts on the right")
    return lines


def _measured_lines(release: Release, given: Mapping[str, str], shown: Mapping[str, str]) -> list[str]:
    """Return the lines of what was measured in a trial; ``shown`` is what its film shows."""
    needed = [q for q in REQUIRED[release] if q not in SHARED]
    if release is Release.DROP:
        needed = ["heavy_mass"]
    lines = ["    heavy:", _measured("heavy_mass", given, "      ", shown)] if "heavy_mass" in needed else []
    if release is Release.LOOPING:
        kind = "looping  # or vertical, where both hang straight down; then without an angle"
        needed.append("hanging_length")
    else:
        kind = release.value
    lines += ["    release:", f"      kind: {kind}"]
    for quantity in [q for q in needed if QUANTITIES[q].group == "release"]:
        if quantity in given or quantity in shown or quantity != "hanging_length":
            lines.append(_measured(quantity, given, "      ", shown))
    return lines


def _measured(quantity: str, given: Mapping[str, str], indent: str, shown: Mapping[str, str]) -> str:
    """Return the line of a measured quantity: its value as given, or as a film shows it, or the mark for one to fill in."""
    q, text = QUANTITIES[quantity], given.get(quantity) or shown.get(quantity, TO_FILL_IN)
    comment = q.meaning if text != TO_FILL_IN else f"{q.meaning}; for example {q.measured_example}"
    if text != TO_FILL_IN and not estimate_of(quantity, text).uncertain:
        comment += f"; taken as exact, as it has no standard error, such as +/- {q.usual_error}"
    if quantity in shown and quantity not in given:
        comment += "; as the film shows it"
    return f"{indent}{q.last_key}: {_scalar(text)}  # {comment}"


def estimate_of(quantity: str, text: str) -> Estimate:
    """Return value and standard error of a quantity [SI] that a user typed for the option of its name.

    Raises
    ------
    NewFileError
        If it is none; the message names the option.
    """
    value: Estimate = _read(MeasuredField(QUANTITIES[quantity].kind), quantity, text)
    return value


def _read(field_type: FieldType, quantity: str, text: str) -> Any:
    """Return the value of an option; an error names the option."""
    try:
        return field_type.read(text)
    except PydanticCustomError as error:
        raise NewFileError(f"{_option(quantity)}: {error}") from None


def radius_of(diameter: str) -> str:
    """Return a rod's radius, with its standard error, of its diameter."""
    twice = estimate_of("rod_radius", diameter)
    half = replace(twice, value=twice.value / 2, sigma=None if twice.sigma is None else twice.sigma / 2)
    return MeasuredField(QUANTITIES["rod_radius"].kind).write(half)


def _option(quantity: str) -> str:
    return f"--{quantity.removeprefix('kinetic_').replace('_', '-')}"


def _summary(found: FileSurvey) -> str:
    """Say in one line what a table says of itself."""
    if found.kind == "events":
        return "a table of events"
    names = ", ".join(quote(t.name) if t.name else "one without a name" for t in found.tracks)
    what = {"drop": "heights", "angle": "angles"}.get(found.kind, f"tracks {names}")
    rate = _rows_per_second(found)
    rows = "no times, only frames" if rate is None else f"{rate:.4g} rows a second" if rate else "a single row"
    lengths = "" if found.kind == "angle" else f"; lengths in {found.length_unit or 'a unit that it does not name'}"
    return f"{what}; {rows}{lengths}"


def _rows_per_second(found: FileSurvey) -> float | None:
    """Return the rate of the rows by the file's own times [Hz]; 0 if it has one row, None without times."""
    if found.time_step is None:
        return None
    return 1 / found.time_step if found.time_step > 0 else 0.0


def _scalar(value: str | float) -> str:
    """Return a value as YAML writes it, on one line; text in quotes only where it needs them."""
    if isinstance(value, float):
        return repr(value)
    plain = yaml.safe_dump(value, allow_unicode=True, width=float("inf")).removesuffix("\n").removesuffix("\n...")
    return json.dumps(value) if "\n" in plain else plain
