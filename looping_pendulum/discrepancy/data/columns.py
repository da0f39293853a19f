"""Tell which quantity each column of a table of positions, angles or heights holds, by its header or by its position."""

from __future__ import annotations

import difflib
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from looping_pendulum.discrepancy.data.delimited import DelimitedTable, TableLine
from looping_pendulum.scenarios.document import quote

_ROLES = {
    "t": "t", "time": "t", "zeit": "t", "temps": "t", "tiempo": "t", "frame": "frame", "x": "x", "y": "y", "drop": "drop",
    "height": "height", "h": "height", "angle": "angle", "theta": "angle", "rate": "angle_rate", "omega": "angle_rate",
    "angle_rate": "angle_rate", "angular_velocity": "angle_rate", "angular_rate": "angle_rate",
}  # fmt: skip
_TIDY_NAME = re.compile(r"(light|heavy|m1|m2)[_ ]?([xy])|([xy])[_ ]?([12])")
"""Names with mass and axis: "light_x", "m2 y", "x1"."""
_SUFFIX = re.compile(r"(.*?)_(s|ms|m|cm|mm|rad|deg|m_per_s|rad_per_s)")
"""Names that end with their unit: "height_cm", "omega_rad_per_s"."""


@dataclass(frozen=True, kw_only=True)
class Column:
    """Quantity, track and unit of one column."""

    index: int
    label: str
    """Name for messages, track included: "x (mass A)"."""
    role: str
    """"t", "frame", "drop", "x", "y", "height", "angle" or "angle_rate"; '' if the column is not used."""
    track: str
    """Name of the tracked object that it belongs to; '' if the file does not say."""
    unit: str
    """Unit as the header writes it; '' if it has none."""


@dataclass(kw_only=True)
class ReadingNotes:
    """Values left out and assumptions made while a file is read."""

    unused: Counter[str] = field(default_factory=Counter)
    """Reason -> number of values that were left out for it."""
    assumptions: list[str] = field(default_factory=list)


def read_columns(table: DelimitedTable, kind: str, tracks: Mapping[str, str] | None, notes: ReadingNotes) -> list[Column]:
    """Return the columns of a table, by its header or, without one, by their position.

    Raises
    ------
    DataError
        If there is no column of times or frame numbers, or none of positions, angles or heights.
    """
    # From the last line up: the names stand right above the numbers, titles further up
    header = next((row for row in reversed(table.head) if _parse_column_name(row.cells[0])[0] in ("t", "frame", "drop")), None)
    title_lines = [row for row in table.head if row is not header]
    if header is None:
        return _columns_by_position(table, kind, tracks, title_lines, notes)
    # Tracker writes a name above the first column of its track; all columns up to the next name are that track's.
    starts = {i: cell for row in title_lines for i, cell in enumerate(row.cells) if cell}
    if len(starts) == 1:
        starts = {0: next(iter(starts.values()))}  # `cm_A` alone in a line stands anywhere above the only track
    columns, track = [], ""
    for index, cell in enumerate(header.cells):
        track = starts.get(index, track)
        role, own, unit = _parse_column_name(cell)
        if cell:
            owner = own or track
            label = f"{cell} ({owner})" if owner and not own else cell
            columns.append(Column(index=index, label=label, role=role, track=owner, unit=unit))
    if not any(c.role == "t" for c in columns) and not any(c.role == "frame" for c in columns):
        raise table.error(
            header.line, "", f"found no column of times among {quote(', '.join(filter(None, header.cells)))}, needed 't'"
        )
    _refuse_header_without_coordinates(table, header, columns)
    return columns


def _refuse_header_without_coordinates(table: DelimitedTable, header: TableLine, columns: list[Column]) -> None:
    """Refuse a header without any column of positions, angles or heights."""
    if any(c.role in ("x", "y", "height", "angle") for c in columns):
        return
    close_matches = [
        (c, difflib.get_close_matches(c.label.lower(), ["x", "y", "light_x", "heavy_y", "angle", "height"], 1)) for c in columns
    ]
    hint = next((f"; did you mean '{m[0]}' by '{c.label}'?" for c, m in close_matches if m), "; rename the columns so")
    labels = quote(", ".join(c.label for c in columns))
    raise table.error(
        header.line, "", f"found columns {labels}, needed positions (x, y), an angle or a height beside the time{hint}"
    )


def _parse_column_name(cell: str) -> tuple[str, str, str]:
    """Split a column's name into role, mass and unit: "light_x [cm]" -> ("x", "light", "cm")."""
    text, unit = _split_unit(cell.strip())
    text = text.lower()
    suffix = _SUFFIX.fullmatch(text)
    if suffix and not unit and not _TIDY_NAME.fullmatch(text):
        text, unit = suffix[1], suffix[2].replace("_per_", "/")
    tidy = _TIDY_NAME.fullmatch(text)
    if tidy:
        mass, axis = (tidy[1], tidy[2]) if tidy[1] else (tidy[4], tidy[3])
        return axis, {"m1": "light", "1": "light", "m2": "heavy", "2": "heavy"}.get(mass, mass), unit
    return _ROLES.get(text, ""), "", unit


def _split_unit(text: str) -> tuple[str, str]:
    """Split "x [cm]" or "x (cm)" into "x" and "cm"; the unit is '' without brackets at the end."""
    if not text.endswith(("]", ")")):
        return text, ""
    inside = text[:-1]
    last = max(inside.rfind("]"), inside.rfind(")")) + 1  # an earlier pair of brackets is part of the name
    opening = min((i for sign in "[(" if (i := inside.find(sign, last)) >= 0), default=None)
    return (text, "") if opening is None else (inside[:opening].rstrip(), inside[opening + 1 :].strip())


def _columns_by_position(
    table: DelimitedTable, kind: str, tracks: Mapping[str, str] | None, title_lines: Sequence[TableLine], notes: ReadingNotes
) -> list[Column]:
    """Return the columns of a file that does not name them: t, x, y for each track, or t, angle and perhaps its rate."""
    width = max(len([c for c in row.cells if c]) for row in table.rows)
    titles = [cell for row in title_lines for cell in row.cells if cell]
    if kind == "drop":
        raise table.error(table.rows[0].line, "", "found no names of columns, needed 'time' and 'height'; write them above")
    is_angle = kind == "angle" or (kind == "auto" and not tracks and not titles and table.delimiter == " " and width in (2, 3))
    if is_angle:
        roles = [("t", ""), ("angle", ""), ("angle_rate", "")][:width]
        notes.assumptions.append("columns without names: taken as t [s], angle [rad]" + (", rate [rad/s]" if width > 2 else ""))
    elif width in (3, 5) and (width == 3 or (tracks and len(tracks) == 2) or len(titles) == 2):
        track_names = titles if len(titles) == width // 2 else list((tracks or {}).values())
        track_names = track_names if len(track_names) == width // 2 else [Path(table.file).stem]
        roles = [("t", "")] + [(axis, track) for track in track_names for axis in "xy"]
        notes.assumptions.append("columns without names: taken as t, x, y" + (", x, y" if width == 5 else ""))
    else:
        message = f"found {width} columns without names"
        raise table.error(
            table.rows[0].line, "", f"{message}, needed a line of names above such as 't,light_x,light_y'; add it"
        )
    return [
        Column(index=i, label=f"{i + 1} ({role}{' of ' + track if track else ''})", role=role, track=track, unit="")
        for i, (role, track) in enumerate(roles)
    ]
