"""From columns to the places of objects: each form in which a program writes a place is one entry of `FORMS`.

A form says which roles it needs and how their numbers give x and y. A new one is one entry, its words in `names.ROLES`, and a
test.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from looping_pendulum.errors import WayOut
from looping_pendulum.measured.observations import ImplausibleLengthError, ReadingNotes, Track, value_range
from looping_pendulum.measured.tables.columns import checked
from looping_pendulum.measured.tables.delimited import DelimitedText, data_error, last_digits
from looping_pendulum.measured.tables.names import BOX_ROLES, ERROR_SUFFIX, PIXELS, Column
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.scenarios.document import quote
from looping_pendulum.scenarios.units import UnitError, to_si

STILL_SHARE = 0.1
"""Range of an axis along which the masses hardly move, as a share of that of another."""
RIGID_SHARE = 0.5
"""Largest change of a box's size, as a share of the way of its corner: two masses move apart by more."""
MAX_FIRST_TURN, MAX_TURN = 2 * np.pi, 40 * np.pi
"""Largest plausible angle of polar coordinates at first, and after the light mass has looped some twenty times [rad]."""
_DEFAULT_UNITS = {"length": "m", "angle": "rad", "time": "s"}
_SAYS_CENTRE = re.compile(r"cent|^[xy]c\b|^c[xy]\b")


@dataclass(frozen=True, kw_only=True)
class Stated:
    """What the study or the command line says of a file."""

    units: Mapping[str, str] = field(default_factory=dict)
    """Units of columns whose header names none, for example ``{"length": "cm", "angle": "deg", "time": "ms"}``.

    A length of ``"1.4 mm"`` is that of a pixel.
    """
    plane: str | None = None
    """Axes of the plane of the motion that are horizontal and vertical, one of `observations.PLANES`; None: x and y, unless the
    numbers say that it is another."""
    box: str | None = None
    """What x and y beside a width and a height are, one of `observations.BOXES`; None: not stated."""
    kind: str = "auto"
    """One of `observations.KINDS`."""
    frame_rate: float | None = None
    """True frame rate of the camera [Hz]. If it is given, the file's own times are only used to count frames."""
    clip_rate: float | None = None
    """Frame rate that the file's times were computed with [Hz], for slow-motion clips; None: one row is one frame, unless the
    file has a column of frame numbers."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrackedObject:
    """Columns of one object that share their rows."""

    track: str
    """Name in the file; '' if it has none."""
    columns: Mapping[str, Column]
    """Role -> column; "x" and "y" are places as its form gives them, "angle_rate z" is the rate about one of several axes."""
    again: Sequence[Column] = ()
    """Columns whose role another one has."""
    form: tuple[str, ...] = ()
    """Roles of the columns of which its places are made."""

    def with_role(self, role: str) -> list[Column]:
        """Return all columns of a role: several for the rates about several axes, or by mistake."""
        return [c for c in (*self.columns.values(), *self.again) if c.role == role]


Place = tuple[Column, Column]
"""Columns of x and y."""


def _corner_and_size(text: DelimitedText, columns: Sequence[Column], stated: Stated, notes: ReadingNotes) -> Place:
    """Return the middle of boxes whose x and y are their middle or a corner, which must be said if the names do not."""
    x, y, width, height = columns
    said = "centre" if _SAYS_CENTRE.search(x.label.lower()) else stated.box
    if said is None:
        message = (
            "found x and y beside width and height, needed to know which point of a box they are ('box: centre': its middle)"
        )
        way_out = WayOut(words="if its corner of smallest x and y, write {}", keys={"box": "corner"})
        raise text.error(None, x.label, message, way_out)
    if said == "centre":
        return x, y
    notes.assumptions.append("points taken at the middle of boxes: the corner and half of width and height")
    return _between(x, width), _between(y, height)


def _edge_and_size(text: DelimitedText, columns: Sequence[Column], stated: Stated, notes: ReadingNotes) -> Place:
    """Return the middle of boxes of which left and upper edge and the size are written."""
    left, top, width, height = _in_pixels(columns, stated)
    notes.assumptions.append("points taken at the middle of boxes: left and upper edge, and half of width and height")
    return _between(left, width), _between(top, height)


def _two_corners(text: DelimitedText, columns: Sequence[Column], stated: Stated, notes: ReadingNotes) -> Place:
    """Return the middle of boxes of which two opposite corners are written."""
    left, top, right, bottom = _in_pixels(columns, stated)
    notes.assumptions.append("points taken at the middle of boxes: between two corners")
    return replace(left, value=0.5 * (left.value + right.value)), replace(top, value=0.5 * (top.value + bottom.value))


def _polar(text: DelimitedText, columns: Sequence[Column], stated: Stated, notes: ReadingNotes) -> Place:
    """Return the places of polar coordinates, whose angle counts counterclockwise from the x axis, to the right."""
    radius, angle = columns
    turn = si_factor(text, angle, "rad", stated.units) * angle.value
    if not angle.unit and "angle" not in stated.units:
        notes.assumptions.append("angles without a unit taken in rad")
    limit = np.full(len(turn), MAX_TURN)
    limit[: np.argmax(np.isfinite(turn)) + 1] = MAX_FIRST_TURN
    far = np.flatnonzero(np.abs(np.nan_to_num(turn)) > limit)
    if len(far):
        found = f"found {turn[far[0]]:g} rad, needed at most {limit[far[0]]:.4g}"
        raise text.error(angle.rows[far[0]].line, angle.label, found, another_unit("angle", "deg"))
    notes.assumptions.append("polar coordinates taken as positions: angles counterclockwise from the x axis")
    digits = max(last_digits(radius.cells)), np.abs(np.nan_to_num(radius.value)).max() * max(last_digits(angle.cells))
    x, y = radius.value * np.cos(turn), radius.value * np.sin(turn)
    return replace(radius, value=x, digit=max(digits)), replace(radius, value=y, digit=max(digits))


def _in_plane(text: DelimitedText, columns: Sequence[Column], stated: Stated, notes: ReadingNotes) -> Place:
    """Return the horizontal and the vertical axis of the plane of the motion."""
    plane = stated.plane or "xy"
    by_axis = {c.role: c for c in columns}
    if not set(plane) <= by_axis.keys():
        have = "".join(by_axis)
        found = f"found the axes {' and '.join(have)}, needed {' and '.join(plane)}"
        way_out = WayOut(words="if these are to the right and up, write {}", keys={"plane": have[:2]})
        raise text.error(None, columns[0].label, found, way_out)
    return by_axis[plane[0]], by_axis[plane[1]]


FORMS: Mapping[tuple[str, ...], Callable[..., Place]] = {
    BOX_ROLES: _two_corners,
    ("left", "top", "width", "height"): _edge_and_size,
    ("x", "y", "width", "height"): _corner_and_size,
    ("x", "y", "z"): _in_plane,
    ("x", "y"): _in_plane,
    ("x", "z"): _in_plane,
    ("y", "z"): _in_plane,
    ("radius", "angle"): _polar,
}
"""Ways of writing a place: roles of the columns -> function that gives x and y; the first whose columns an object has is taken.

A function takes the table, these columns, what is stated, and the notes.
"""


def tracked_objects(text: DelimitedText, columns: Sequence[Column], stated: Stated, notes: ReadingNotes) -> list[TrackedObject]:
    """Return the objects of a file with their places, in the order of their columns.

    Raises
    ------
    DataError
        If cells of places are no numbers, or what they mean must be said.
    """
    by_object: dict[tuple[int, str, str], list[Column]] = {}
    for c in columns:
        if c.role and not c.role.endswith(ERROR_SUFFIX):
            by_object.setdefault((id(c.rows), c.track, c.run), []).append(c)
    objects = []
    for (_, track, _), own in by_object.items():
        by_role: dict[str, Column] = {}
        again = [c for c in own if by_role.setdefault(f"{c.role} {c.axis}".strip(), c) is not c]
        objects.append(TrackedObject(track=track, columns=by_role, again=again))
    if stated.kind in ("angle", "drop"):
        return objects
    objects = _with_boxes_of_two_corners(objects)
    if stated.plane is None:
        _ask_for_plane(text, objects)
    return [_placed(text, thing, stated, notes) for thing in objects]


def _placed(text: DelimitedText, thing: TrackedObject, stated: Stated, notes: ReadingNotes) -> TrackedObject:
    """Return an object with its places, or with the one of x and y that it has."""
    form = next((needs for needs in FORMS if set(needs) <= thing.columns.keys()), None)
    if form is None:
        return thing
    x, y = FORMS[form](text, [checked(text, thing.columns[role]) for role in form], stated, notes)
    places = {"x": replace(x, role="x"), "y": replace(y, role="y")}
    # Of three axes, one is not used
    form = tuple(role for role in form if role not in ("x", "y", "z") or role in (x.role, y.role))
    return replace(thing, columns={**thing.columns, **places}, form=form)


def tracks_of(objects: Sequence[TrackedObject]) -> list[Track]:
    """Return the tracks of objects that have places, in the file's units, without missing points."""
    places: dict[str, dict[str, Array]] = {}
    for thing in objects:
        for axis in thing.columns.keys() & {"x", "y"}:
            column = thing.columns[axis]
            places.setdefault(thing.track, {"x": np.empty(0), "y": np.empty(0)})[axis] = column.value[column.has_values]
    return [Track(name=name, x=axes["x"], y=axes["y"]) for name, axes in places.items()]


def _with_boxes_of_two_corners(objects: list[TrackedObject]) -> list[TrackedObject]:
    """Return the objects with "x1, y1, x2, y2" joined where these are corners of boxes and no two masses.

    The corners of a box keep their distance, but for its blur, and their order.
    """
    by_name = {(id(o.columns[a].rows), o.track): o for o in objects for a in "x" if {"x", "y"} <= o.columns.keys()}
    joined = list(objects)
    for (rows, track), first in by_name.items():
        name, number = track[:-1], track[-1:]
        second = by_name.get((rows, f"{name}{int(number) + 1}")) if number in ("0", "1") else None
        if second is None or name[-1:].isdigit():
            continue
        corners = [o.columns[axis] for o in (first, second) for axis in "xy"]
        x, y, other_x, other_y = (c.value for c in corners)
        sizes = [size[np.isfinite(size)] for size in (other_x - x, other_y - y)]
        way = max(value_range(v[np.isfinite(v)]) for v in (x, y))
        if all(len(size) and size.min() > 0 and np.ptp(size) < RIGID_SHARE * way for size in sizes):
            edges = {role: replace(c, role=role) for role, c in zip(BOX_ROLES, corners, strict=True)}
            joined[joined.index(first)] = replace(first, track=name.rstrip(" _"), columns=edges)
            joined.remove(second)
    return joined


def _ask_for_plane(text: DelimitedText, objects: Sequence[TrackedObject]) -> None:
    """Refuse places in space whose masses hardly move along x or y, but along z."""
    inside = [o.columns for o in objects if {"x", "y", "z"} <= o.columns.keys()]
    way = {a: max((value_range(c[a].value[c[a].has_values]) for c in inside), default=0.0) for a in "xyz"}
    still = "y" if way["y"] < way["x"] else "x"
    if way[still] >= STILL_SHARE * way["z"]:
        return
    plane = "zy" if still == "x" and way["y"] > way["z"] * STILL_SHARE else "xz"
    column = inside[0][still]
    unit = f" {column.unit}" if column.unit else ""
    found = f"found that {still} hardly moves ({way[still]:.3g}{unit}), but z does ({way['z']:.3g}{unit})"
    way_out = WayOut(words="if these are its axes, to the right and up, write {}", keys={"plane": plane})
    raise text.error(None, column.label, f"{found}, needed the plane of the motion", way_out)


def _between(corner: Column, size: Column) -> Column:
    """Return the middle of a box along one axis."""
    return replace(corner, value=corner.value + 0.5 * size.value)


def _in_pixels(columns: Sequence[Column], stated: Stated) -> list[Column]:
    """Return a box's edges or size in pixels where nothing says another unit."""
    return [replace(c, unit=c.unit or ("" if "length" in stated.units else "px")) for c in columns]


def another_unit(kind: str, unit: str) -> WayOut:
    """Return the way out that values may be in another unit."""
    return WayOut(words="if the file is in another unit, say so: {}", keys={f"units.{kind}": unit})


def si_factor(text: DelimitedText, column: Column, si: str, units: Mapping[str, str]) -> float:
    """Return the factor from the column's unit to ``si``."""
    kind = "time" if column.role == "t" else "length" if column.is_length else "angle" if column.role == "angle" else ""
    unit = column.unit or units.get(kind, _DEFAULT_UNITS.get(kind, si))
    line = min((row.line for row in column.rows), default=1) - 1 if column.unit else None
    return unit_factor(text.file, line, column.label, unit, si, units)


def unit_factor(file: str, line: int | None, column: str, unit: str, si: str, units: Mapping[str, str]) -> float:
    """Return the factor from a unit to SI; it may have a size of its own: "1.4 mm" for the pixels of a picture."""
    if unit.lower() in PIXELS and si == "m":
        unit = units.get("length", "m")
        if unit == "m" or unit.lower() in PIXELS:
            way_out = WayOut(words="say so by {}", keys={"units.length": "1.4 mm"})
            message = "found lengths in pixels, needed the size of one"
            raise data_error(file, None, column, message, way_out, ImplausibleLengthError)
    try:
        return to_si(unit if unit[:1].isdigit() else f"1 {unit}", si)
    except UnitError as error:
        detail = f" ({error})" if str(error) else ""
        message = f"found the unit {quote(unit)}{detail}, needed one that converts to {si}; write for example '[{si}]'"
        raise data_error(file, line, column, message) from None
