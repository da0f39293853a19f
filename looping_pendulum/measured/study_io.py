"""Load study files and write them. Every error is a `StudyError` of one line: file, line, key, what was found and needed."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from looping_pendulum.errors import ScenarioError
from looping_pendulum.measured.keywords import StudyError as StudyError
from looping_pendulum.measured.study import Study, Trial, check_study
from looping_pendulum.measured.study_file import MeasuredField
from looping_pendulum.measured.tables.events import DATA_VARIABLE, data_folders
from looping_pendulum.scenarios import document, own_effects
from looping_pendulum.scenarios.document import Document
from looping_pendulum.scenarios.fields import file_keys, model_schema, read_model
from looping_pendulum.scenarios.quantities import quantity_kind


def load(path: str | Path) -> Study:
    """Load a study file.

    Raises
    ------
    StudyError
        If the file is no study; the message has one line with file, line, key, what was found and needed, and a way out.
    """
    with _as_study_errors():
        doc = document.parse(document.read(path), os.fspath(path), "a study")
        return _study(doc, Path(path).stem, Path(path).parent)


def load_text(text: str, name: str, folder: Path | None = None) -> Study:
    """Load a study from YAML text; paths in it are relative to ``folder``, by default the current one."""
    with _as_study_errors():
        # Half characters reach the parser, which refuses them as it does in a file
        doc = document.parse(text.encode("utf-8", "surrogatepass"), name, "a study")
        return _study(doc, Path(name).stem, folder or Path())


@contextmanager
def _as_study_errors() -> Iterator[None]:
    """Turn the errors of the parser and the checks, which scenarios share, into those of studies."""
    try:
        yield
    except ScenarioError as error:
        raise StudyError(str(error), error.path, error.problem) from None


def _study(doc: Document, name: str, folder: Path) -> Study:
    own_effects.warn_of_faulty_packages()
    study = read_model(Study, doc, {"<name>": name, "<folder>": folder})
    for i, trial in enumerate(study.trials):
        _check_file_locations(folder, trial, doc, i)
    check_study(study, doc)
    return study


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
        whole = path + doc.line_of(where).partition(path)[2].rstrip()
        try:
            target = Path(os.path.realpath(folder / path))
            is_cut = not target.exists() and (folder / whole).exists()
        except (OSError, ValueError):  # too long, or with a null character
            raise doc.error(where, f"found {document.quote(path)}, which is not a valid file name; needed one") from None
        if is_cut:
            raise doc.error(where, f"found {document.quote(path)}, which is no file; {document.QUOTE_COMMENT_SIGN}, '{whole}'")
        if not any(target.is_relative_to(each) for each in allowed):
            message = f"found {document.quote(path)}, needed a file below the study's folder or the current one"
            raise doc.error(where, f"{message}; put it there, or name its folder in ${DATA_VARIABLE}")


def trial_of(doc: Document) -> Trial:
    """Return the first trial of a document, without what a fit of it would need.

    Raises
    ------
    ScenarioError
        If a key of it has an error.
    """
    return read_model(Study, doc, {"<name>": "", "<folder>": Path()}).trials[0]


def dump(study: Study) -> str:
    """Write ``study`` as YAML with units, which loads back to an equal one."""
    # Which unit a coefficient has, only the study knows: it may be of an effect that the study defines
    effects = {name: MeasuredField(quantity_kind(study.coefficients[name])).write(e) for name, e in study.effects.items()}
    keys = file_keys(study) | ({"effects": effects} if effects else {})
    return document.to_yaml(keys)


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a study file, for editors that complete and check YAML."""
    return model_schema(Study, "Looping pendulum study")
