"""The keywords by which a script makes a trial or a study: the keys of a study file, and measured parameters by their names.

The models of the file check them, so that a script has the same keys, bounds and messages as YAML. Numbers are in SI.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import numpy as np

from looping_pendulum.errors import FileKeyError, ScenarioError
from looping_pendulum.measured.study_file import PLACES
from looping_pendulum.scenarios.document import Document, key_text
from looping_pendulum.scenarios.fields import read_model, suggest, undescribed_schema
from looping_pendulum.scenarios.quantities import APPARATUS

Quantity = float | str
"""A quantity in SI, or as text with its unit: 240.0, "240 Hz"."""
Measured = float | tuple[float, float] | str
"""A measured value: exact or with its standard error, both in SI, or as in a study file: 0.01, (0.01, 1e-4), "10 g +/- 1 %"."""
Model = TypeVar("Model")

OF_STUDY = {name: ("apparatus", *PLACES[name].split(".")) for name in APPARATUS}
"""Keyword of a study -> the keys that lead to it in a file, where these differ."""
OF_TRIAL = {
    name: tuple(place.split(".")) for name, place in PLACES.items() if place.partition(".")[0] in ("light", "heavy", "release")
} | {"release": ("release", "kind")}
"""The same of a trial."""


class StudyError(FileKeyError):
    """Raised if a file, or what a script gives, cannot be read as a study."""


def read_keywords(
    model: Callable[..., Model],
    keywords: Mapping[str, Any],
    places: Mapping[str, tuple[str, ...]],
    beside: Mapping[str, Any],
    *,
    label: str,
    check: Callable[[Model, Document], None] | None = None,
) -> Model:
    """Return a trial or a study made of a script's keywords; one that is None is not given.

    Parameters
    ----------
    places
        `OF_TRIAL` or `OF_STUDY`.
    beside
        Values that are in no file, by the names of their fields in brackets.
    label
        What is made, for messages.
    check
        What checks the whole.

    Raises
    ------
    StudyError
        In one line, with the keyword.
    """
    groups = {keys[0] for keys in places.values()}
    known = [*places, *(key for key in undescribed_schema(model)["properties"] if key not in groups)]
    data: dict[str, Any] = {}
    for name, value in keywords.items():
        if name not in known:
            hint = suggest(name, known) or f", needed one of: {', '.join(known)}"
            raise StudyError(f"{label}: found an unknown keyword '{name}'{hint}", (name,))
        *outer, last = places.get(name, (name,))
        group = data
        for key in outer:
            group = group.setdefault(key, {})
        if value is not None:
            group[last] = dict(value) if isinstance(value, Mapping) else value
    doc = Document(file=label, data=data, lines={}, text="")
    try:
        made = read_model(model, doc, beside)
        if check is not None:
            check(made, doc)
    except ScenarioError as error:
        message = str(error)
        for name, keys in (OF_STUDY | OF_TRIAL | dict(places)).items():
            if key_text(keys) in message:
                message = re.sub(rf"'{keys[-1]}: (.*?)'", rf"{name}='\1'", message.replace(key_text(keys), name))
        raise StudyError(message, error.path, error.problem) from None
    return made


def table_text(points: Any, label: str) -> str:
    """Return columns of values as the text of a table, as a file would hold it.

    Parameters
    ----------
    points
        A DataFrame, a structured array, or a mapping of names to arrays of shape (n,).

    Raises
    ------
    StudyError
        If it is none of these, or if its columns are not equally long.
    """
    if getattr(getattr(points, "index", None), "name", None):  # of a DataFrame whose times are its index
        points = points.reset_index()
    names = getattr(getattr(points, "dtype", None), "names", None) or getattr(points, "columns", None)
    if names is None and not isinstance(points, Mapping):
        found = f"found an object of the type {type(points).__name__}"
        raise StudyError(
            f"{label}: points: {found}, needed a DataFrame, arrays by their names, or what lp.track returns; write for example "
            "points={'t': t, 'light_x': x, 'light_y': y}"
        )
    columns = {str(name): np.asarray(points[name]) for name in (points if names is None else names)}
    shapes = {values.shape for values in columns.values()}
    if len(shapes) != 1 or len(shapes.pop()) != 1:
        found = ", ".join(f"{name} {values.shape}" for name, values in columns.items()) or "no columns"
        raise StudyError(f"{label}: points: found the shapes {found}, needed columns of one length, (n,)")
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*(values.tolist() for values in columns.values()), strict=True))
    return text.getvalue()
