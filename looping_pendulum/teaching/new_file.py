"""Write a commented scenario, or a study of what films and tables show; what only a person can measure stays marked there."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import yaml
from jinja2 import PackageLoader
from pydantic_core import PydanticCustomError

from looping_pendulum.errors import HarnessError, ParameterError
from looping_pendulum.measured.film import is_film
from looping_pendulum.measured.film_points import settle_film
from looping_pendulum.measured.observations import DataError
from looping_pendulum.measured.study import REQUIRED
from looping_pendulum.measured.study_file import Estimate, MeasuredField
from looping_pendulum.measured.tables.readers import FileSurvey, mass_in_name, survey
from looping_pendulum.pages.templates import templates
from looping_pendulum.processes import ReportShare
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios import loader
from looping_pendulum.scenarios.document import quote
from looping_pendulum.scenarios.fields import TO_FILL_IN, FieldType, QuantityField
from looping_pendulum.scenarios.quantities import APPARATUS, QUANTITIES

PLAYBACK_STEP = 1 / 61
"""Time between rows from which on a table may be of slow motion as it plays [s]: films play at 24 to 60 frames a second."""
RELEASE_OF_KIND = {"positions": Release.LOOPING, "events": Release.LOOPING, "angle": Release.HELD, "drop": Release.DROP}
"""Kind of a file -> release that it most probably shows."""
USUAL_EFFECTS = ("capstan", "light_drag", "heavy_drag", "string_drag")
"""Effects that a study declares, beside gravity: the friction, and the air's drag on all that moves.

A drag that is not declared is ascribed to what acts alike: without the string's, a side force of 5.0 mN came out as 4.3 mN.
"""
USUAL_EFFECTS_WITHOUT_ROD = {Release.HELD: ("light_drag",), Release.DROP: ("heavy_drag",)}
"""Release -> the same for a study of such trials alone; on a string of one length, its drag looks like the mass's."""
SHARED = tuple(name for name in APPARATUS if name != "heavy_mass")
"""What a study has once for all trials, of what is measured; each trial names its own heavy mass."""


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
    *,
    track: bool = False,
    progress: ReportShare | None = None,
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
    track
        Whether to track a film that has no points, or was tracked with other values than the given ones.
    progress
        Called while a film is tracked.

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
        trials += _trials_of(file, mine, track=track, progress=progress)
    names: set[str] = set()
    for trial in trials:
        name, n = trial.name, 1
        while trial.name in names:
            n += 1
            trial.name = f"{name}-{n}"
        names.add(trial.name)
    releases = {trial.release for trial in trials}
    required = {quantity for release in releases for quantity in REQUIRED[release]}
    if "rod_radius" in required:  # what winds up comes to the rod, where its size counts
        required.add("light_radius")
    shown = next((trial.shown for trial in trials if "light_radius" in trial.shown), {})
    environment = templates(PackageLoader("looping_pendulum.teaching", ""), autoescape=False)
    environment.filters["yaml"] = _scalar
    return environment.get_template("study.yaml.jinja").render(
        title=title,
        apparatus=_measured(required.intersection(SHARED), {quantity: texts[0] for quantity, texts in given.items()}, shown),
        effects=USUAL_EFFECTS_WITHOUT_ROD.get(releases.pop(), USUAL_EFFECTS) if len(releases) == 1 else USUAL_EFFECTS,
        trials=trials,
        # With forward slashes, so that the study also loads on another system
        path=lambda file: Path(os.path.relpath(file, folder)).as_posix(),
        TO_FILL_IN=TO_FILL_IN,
        PLAYBACK_STEP=PLAYBACK_STEP,
    )


@dataclass(kw_only=True)
class _Trial:
    """A trial of the study."""

    name: str
    file: Path
    says: str
    """What the file says of itself, in a line."""
    release: Release
    run: str = ""
    """Number of the run, in a file of several."""
    table: FileSurvey | None = None
    """None: it is a film."""
    measured: Mapping[str, Sequence[str]]
    """Group of keys -> lines of what was measured."""
    shown: Mapping[str, str] = field(default_factory=dict)
    """Name of a quantity -> its value with its standard error, where a film shows it."""

    @property
    def tracks(self) -> Mapping[str, str]:
        """Return mass -> name of its track, where the names do not say it."""
        masses = {} if self.table is None else self.table.masses
        return masses if any(mass_in_name(name) != mass for mass, name in masses.items()) else {}


def _trials_of(file: Path, given: Mapping[str, str], **of_film: Any) -> list[_Trial]:
    """Return the trial of a film or table, or that of each run in it; ``of_film`` are options of `settle_film`."""
    if not file.exists():
        raise NewFileError(f"found no file {quote(str(file))}, needed a film or a table of tracked points; correct the path")
    try:
        if is_film(file):
            says = f"a film; {file.stem}.track.png beside it shows what was tracked: check it"
            shown = _shown_by_film(file, given, **of_film)
            measured = _measured_in_trial(Release.LOOPING, given, shown)
            return [_Trial(name=file.stem, file=file, says=says, release=Release.LOOPING, measured=measured, shown=shown)]
        table = survey(file)
    except DataError as error:
        raise NewFileError(str(error)) from None
    release = RELEASE_OF_KIND[table.kind]
    return [
        _Trial(
            name=f"{file.stem}-{run}" if run else file.stem,
            file=file,
            says=_summary(table),
            release=release,
            run=run,
            table=table,
            measured=_measured_in_trial(release, given, {}),
        )
        for run in (table.runs if len(table.runs) > 1 else ("",))
    ]


def _shown_by_film(film: Path, given: Mapping[str, str], **of_film: Any) -> dict[str, str]:
    """Return what a film shows of ball and release, by the names of quantities; nothing without the free length, its scale."""
    if "free_length" not in given:
        return {}
    stated: dict[str, float] = {}
    for quantity in ("free_length", "rod_radius"):
        if quantity in given:
            estimate = estimate_of(quantity, given[quantity])
            stated |= {quantity: estimate.value, f"{quantity}_error": estimate.sigma or 0.0}
    return settle_film(film, stated, **of_film).shown()


def _measured_in_trial(release: Release, given: Mapping[str, str], shown: Mapping[str, str]) -> dict[str, list[str]]:
    """Return group of keys -> lines of what is measured in a trial; ``shown`` is what its film shows."""
    quantities = {"heavy_mass"} if release is Release.DROP else set(REQUIRED[release]).difference(SHARED)
    if release is Release.LOOPING and ("hanging_length" in given or "hanging_length" in shown):
        quantities.add("hanging_length")
    return _measured(quantities, given, shown)


def _measured(quantities: Set[str], given: Mapping[str, str], shown: Mapping[str, str]) -> dict[str, list[str]]:
    """Return group of keys -> lines of measured quantities: values as given or as a film shows them, or marks to fill in."""
    lines: dict[str, list[str]] = {}
    for quantity, q in QUANTITIES.items():
        if quantity not in quantities:
            continue
        text = given.get(quantity) or shown.get(quantity, TO_FILL_IN)
        comment = q.meaning
        if text == TO_FILL_IN:
            comment += f"; for example {q.measured_example}"
        elif not estimate_of(quantity, text).uncertain:
            comment += f"; taken as exact, as it has no standard error, such as +/- {q.usual_error}"
        if quantity in shown and quantity not in given:
            comment += "; as the film shows it"
        lines.setdefault(q.group, []).append(f"{q.last_key}: {_scalar(text)}  # {comment}")
    return lines


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
    step = found.time_step
    rows = "no times, only frames" if step is None else f"{1 / step:.4g} rows a second" if step > 0 else "a single row"
    lengths = "" if found.kind == "angle" else f"; lengths in {found.length_unit or 'a unit that it does not name'}"
    return f"{what}; {rows}{lengths}"


def _scalar(value: str | float) -> str:
    """Return a value as YAML writes it, on one line; text in quotes only where it needs them."""
    if isinstance(value, float):
        return repr(value)
    plain = yaml.safe_dump(value, allow_unicode=True, width=float("inf")).removesuffix("\n").removesuffix("\n...")
    return json.dumps(value) if "\n" in plain else plain
