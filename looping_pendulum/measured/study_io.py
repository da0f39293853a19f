"""Load study files and write them. Every error is a `StudyError` of one line: file, line, key, what was found and needed."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import yaml

from looping_pendulum.errors import FileKeyError, ParameterError, ScenarioError
from looping_pendulum.measured import study_file
from looping_pendulum.measured.camera import CAMERA
from looping_pendulum.measured.events import DATA_VARIABLE, data_folders
from looping_pendulum.measured.study import (
    EARTH_GRAVITY,
    RELEASE,
    REQUIRED,
    Estimate,
    ExperimentLimits,
    Study,
    Trial,
)
from looping_pendulum.measured.study_file import StudyFile, TrialGroup
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.scenarios import document, own_effects
from looping_pendulum.scenarios.document import Document, one_line
from looping_pendulum.scenarios.fields import suggest
from looping_pendulum.scenarios.quantities import APPARATUS, QUANTITIES
from looping_pendulum.scenarios.units import show

_EVENT_UNITS = MappingProxyType({"time": "s", "length": "m", "angle": "rad"})
"""Key of an event's standard error -> SI unit."""


class StudyError(FileKeyError):
    """Raised if a file cannot be read as a study."""


def load(path: str | Path) -> Study:
    """Load a study file.

    Raises
    ------
    StudyError
        If the file is no study; the message has one line with file, line, key, what was found and needed, and a way out.
    """
    shown = os.fspath(path)
    try:
        with Path(path).open("rb") as stream:
            # One byte more than is allowed tells the parser that a file is too large, however large it is
            raw = stream.read(document.MAX_FILE_SIZE + 1)
    except OSError as error:
        raise StudyError(one_line(f"{shown}: cannot be read: {error.strerror}")) from None
    return _load(raw, shown, Path(path).stem, Path(path).parent)


def load_text(text: str, name: str, folder: Path | None = None) -> Study:
    """Load a study from YAML text; paths in it are relative to ``folder``, by default the current one."""
    # Half characters reach the parser, which refuses them as it does in a file
    return _load(text.encode("utf-8", "surrogatepass"), name, Path(name).stem, folder or Path())


def _load(raw: bytes, file: str, name: str, folder: Path) -> Study:
    try:
        doc = document.parse(raw, file, "a study")
        return _study(study_file.check(doc), doc, name, folder)
    except ScenarioError as error:  # the parser is shared with scenarios
        raise StudyError(str(error), error.path, error.problem) from None


def _study(content: StudyFile, doc: Document, name: str, folder: Path) -> Study:
    apparatus = _estimates(content.apparatus, APPARATUS)
    study = Study(
        name=name,
        title=content.title,
        folder=folder,
        apparatus=apparatus,
        effects=content.effects,
        own_effects=own_effects.read(doc.data, own_effects.KEY_IN_STUDY),
        fit=None if content.fit is None else tuple(content.fit),
        trials=tuple(_trial(group, doc, i) for i, group in enumerate(content.trials)),
        limits=ExperimentLimits(
            release_angle=content.limits.release_angle,
            mass_ratio=content.limits.mass_ratio,
            releases=tuple(Release(r) for r in content.limits.releases or Release),
        ),
        gravity_range=content.gravity_range,
    )
    _check_gravity(study, doc)
    _check_names(study, doc)
    for i, trial in enumerate(study.trials):
        _check_file_locations(folder, trial, doc, i)
        _check_trial(study, trial, doc, i)
    return study


def _check_gravity(study: Study, doc: Document) -> None:
    """Refuse a gravity that there is not where the trials were made."""
    low, high = study.gravity_range
    gravity = study.effects.get("gravity")
    if gravity is not None and not low <= gravity.value <= high:
        where = "on Earth" if study.gravity_range == EARTH_GRAVITY else "by gravity_range"
        raise doc.error(
            ("effects", "gravity"),
            f"found {gravity.value:g} m/s^2, needed {low:g} to {high:g} m/s^2, as {where}; elsewhere state the possible "
            "values, for example 'gravity_range: [1.61 m/s^2, 1.64 m/s^2]'",
        )


def _check_file_locations(folder: Path, trial: Trial, doc: Document, index: int) -> None:
    """Refuse files outside the study's folder, the current one and the data folders.

    Otherwise a study from a stranger could have any file of this computer read and reported on.
    """
    # Real paths, because ".." or a link in a permitted folder may lead out of it
    allowed = [Path(os.path.realpath(each)) for each in (folder, Path(), *data_folders())]
    keys = ("file",) if len(trial.files) == 1 else tuple(("files", mass) for _, tracks in trial.files for mass in tracks)
    key_and_path = [(key, path) for key, (path, _) in zip(keys, trial.files, strict=True)]
    key_and_path += [("events", trial.events)] if trial.events is not None else []
    for key, path in key_and_path:
        where: tuple[str | int, ...] = ("trials", index, *((key,) if isinstance(key, str) else key))
        try:
            target = Path(os.path.realpath(folder / path))
        except ValueError:
            raise doc.error(where, f"found {document.quote(path)}, which is not a valid file name; needed one") from None
        whole = path + doc.line_of(where).partition(path)[2].rstrip()
        if not target.exists() and (folder / whole).exists():
            raise doc.error(where, f"found {document.quote(path)}, which is no file; {document.QUOTE_COMMENT_SIGN}, '{whole}'")
        if not any(target.is_relative_to(each) for each in allowed):
            message = f"found {document.quote(path)}, needed a file below the study's folder or the current one"
            raise doc.error(where, f"{message}; put it there, or name its folder in ${DATA_VARIABLE}")


def _estimates(group: Any, names: Iterable[str]) -> dict[str, Estimate]:
    """Return the estimates of those parameters ``names`` that a group of the file gives."""
    estimates = {}
    for name in names:
        value = group
        for part in _path(name):
            value = getattr(value, part, None)
        if value is not None:
            estimates[name] = value
    return estimates


def _path(parameter: str) -> tuple[str, str]:
    """Return group and key of a parameter in a study file."""
    group, key = ("release", "speed") if parameter == "push_across" else QUANTITIES[parameter].key.split(".")
    return group, key


def trial_of(doc: Document) -> Trial:
    """Return the first trial of a document, without what a fit of it would need.

    Raises
    ------
    ScenarioError
        If a key of it has an error.
    """
    return _trial(study_file.check(doc).trials[0], doc, 0)


def _trial(group: TrialGroup, doc: Document, index: int) -> Trial:
    path = ("trials", index)
    if (group.file is None) == (group.files is None):
        text = "nothing" if group.file is None else "both 'file' and 'files'"
        raise doc.error((*path, "file"), f"found {text}, needed one of them; write for example 'file: first.csv'")
    if group.files and group.tracks:
        raise doc.error((*path, "tracks"), "found tracks beside a file for each mass, needed one of them; leave one out")
    files = [(file, {mass: ""}) for mass, file in (group.files or {}).items()]
    files = files or [(str(group.file), dict(group.tracks or {}))]
    release = Release(vars(group.release)["kind"])
    estimates = _estimates(group, (*APPARATUS, *RELEASE))
    if release is Release.VERTICAL and "release_angle" in estimates:
        raise doc.error(
            (*path, "release", "angle"), "found an angle, needed none: a vertical release hangs at 180 deg; leave it out"
        )
    if release in (Release.LOOPING, Release.VERTICAL) and "hanging_length" not in estimates:
        # It does not influence the motion: it only shifts the measured height of the heavy mass
        estimates["hanging_length"] = Estimate(value=Parameters.hanging_length, free=True)
    errors = {_EVENT_UNITS[n]: s for n, s in group.event_errors.model_dump(exclude_none=True).items()}
    return Trial(
        name=group.name or Path(files[0][0]).stem,
        files=tuple(files),
        events=group.events,
        **{n: getattr(group, n) for n in ("kind", "frame_rate", "clip_rate", "run", "dropped", "mirrored", "held_out")},
        units=group.units or {},
        release=release,
        estimates=estimates,
        camera={n: group.camera[n] for n in CAMERA if n in group.camera},
        event_errors=errors,
    )


def _check_names(study: Study, doc: Document) -> None:
    """Refuse names of trials that occur twice, and unknown names under 'fit'."""
    first_index: dict[str, int] = {}
    for i, trial in enumerate(study.trials):
        if first_index.setdefault(trial.name, i) != i:
            message = f"found a second trial '{trial.name}', needed names that differ; write for example 'name: {trial.name}-2'"
            raise doc.error(("trials", i, "name"), message)
    if not study.training:
        raise doc.error(("trials",), "found only held-out trials, needed one to learn from; set 'held_out: false' for one")
    known = [*APPARATUS, *RELEASE, *study.effects]
    for i, name in enumerate(study.fit or ()):
        if name not in known:
            raise doc.error(("fit", i), f"found '{name}', needed one of: {', '.join(known)}{suggest(name, known)}")
    for name, known_value in study.effects.items():
        if study.fit is not None and known_value.free and name not in study.fit:
            raise doc.error(("effects", name), f"found 'free', but 'fit' leaves it out; add '{name}' to 'fit' or give a value")


def _check_trial(study: Study, trial: Trial, doc: Document, index: int) -> None:
    """Refuse a trial without a measured value that its release needs, or with impossible values."""
    needs = (f"{trial.dropped}_mass",) if trial.release is Release.DROP else REQUIRED[trial.release]
    for name in needs:
        if study.estimate(name, trial) is None:
            where = f"{'apparatus.' if name in APPARATUS else ''}{QUANTITIES[name].key}"
            example = f"{QUANTITIES[name].last_key}: {QUANTITIES[name].measured_example}"
            message = f"a {trial.release.value} release needed '{where}'; write for example '{example}'"
            raise doc.error(("trials", index), f"{trial.name}: {message}")
    try:
        study.parameters({}, trial)
    except ParameterError as error:
        raise doc.error(("trials", index), f"{trial.name}: {error}") from None


def dump(study: Study) -> str:
    """Write ``study`` as YAML with units, which loads back to an equal one."""
    data: dict[str, Any] = {"title": study.title, "apparatus": _tree(study.apparatus)}
    data["effects"] = {
        effect.name: given
        for effect in study.known_effects
        if (
            given := {
                c.name: estimate_text(study.effects[c.name], c.unit) for c in effect.coefficients if c.name in study.effects
            }
        )
    }
    data[own_effects.KEY_IN_STUDY] = own_effects.tree(study.own_effects)
    data["fit"] = list(study.fit) if study.fit is not None else None
    data["trials"] = [_trial_tree(trial) for trial in study.trials]
    limits = study.limits
    data["limits"] = {
        "release_angle": [show(a, "rad") for a in limits.release_angle] if limits.release_angle else None,
        "mass_ratio": list(limits.mass_ratio) if limits.mass_ratio else None,
        "releases": [r.value for r in limits.releases],
    }
    if study.gravity_range != EARTH_GRAVITY:
        data["gravity_range"] = [show(g, "m/s**2") for g in study.gravity_range]
    return str(yaml.dump(_without_empty(data), Dumper=yaml.SafeDumper, sort_keys=False, allow_unicode=True, width=100))


def estimate_text(estimate: Estimate, unit: str) -> str:
    """Write an estimate as a study file has it."""
    value = show(estimate.value, unit)
    if estimate.free:
        return f"free from {value}"
    return value if estimate.sigma is None else f"{value} +/- {show(estimate.sigma, unit)}"


def _tree(estimates: Mapping[str, Estimate]) -> dict[str, Any]:
    tree: dict[str, Any] = {}
    for name, estimate in estimates.items():
        group, key = _path(name)
        tree.setdefault(group, {})[key] = estimate_text(estimate, QUANTITIES[name].kind.unit)
    return tree


def _trial_tree(trial: Trial) -> dict[str, Any]:
    """Return a trial as nested keys and texts of a study file."""
    by_mass = all(list(tracks.values()) == [""] for _, tracks in trial.files)
    tree = _tree(trial.estimates)
    tree["release"] = {"kind": trial.release.value} | tree.get("release", {})
    names = {unit: name for name, unit in _EVENT_UNITS.items()}
    return {
        "name": trial.name,
        "file": None if by_mass else trial.files[0][0],
        "files": {mass: path for path, tracks in trial.files for mass in tracks} if by_mass else None,
        "events": trial.events,
        "kind": trial.kind,
        "frame_rate": show(trial.frame_rate, "Hz") if trial.frame_rate else None,
        "clip_rate": show(trial.clip_rate, "Hz") if trial.clip_rate else None,
        "tracks": None if by_mass else dict(trial.files[0][1]),
        "units": dict(trial.units),
        "run": trial.run,
        "dropped": trial.dropped,
        "mirrored": trial.mirrored,
        "held_out": trial.held_out,
        **tree,
        "camera": {n: estimate_text(e, CAMERA[n].unit) for n, e in trial.camera.items()},
        "event_errors": {names[u]: show(s, u) for u, s in trial.event_errors.items()},
    }


def _without_empty(data: Any) -> Any:
    """Return nested keys and texts without those that have no content."""
    if isinstance(data, dict):
        return {k: kept for k, v in data.items() if (kept := _without_empty(v)) not in (None, {}, [])}
    return [_without_empty(v) for v in data] if isinstance(data, list) else data
