"""Tell which quantity each column of a table holds: a grammar of the names that programs and people write above columns.

A name has what a program puts before it ("Latest:", "Run #1"), the tracked object, the quantity, and a unit: in brackets,
behind a slash, after "in", or in the row below. The object may stand behind the quantity ("x1", "Y 2"). What a column holds
decides where names are silent, and refuses a name that contradicts it.
"""

from __future__ import annotations

import difflib
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

from looping_pendulum.discrepancy.data.delimited import DelimitedText, TableLine, is_number, last_digits
from looping_pendulum.discrepancy.data.observations import ReadingNotes
from looping_pendulum.scenarios.document import quote

POSITION_ROLES = ("x", "y", "height", "angle", "angle_rate")
ROLES = {
    "t": "t", "time": "t", "times": "t", "timestamp": "t", "zeit": "t", "temps": "t", "tiempo": "t", "tempo": "t",
    "frame": "frame", "frames": "frame", "framenumber": "frame", "bild": "frame", "bildnummer": "frame", "image": "frame",
    "horizontal": "x", "vertical": "y", "height": "height", "h": "height", "höhe": "height", "hauteur": "height",
    "altura": "height", "omega": "angle_rate", "ω": "angle_rate", "gyroscope": "angle_rate", "gyroskop": "angle_rate",
    "gyro": "angle_rate", "winkelgeschwindigkeit": "angle_rate", "angle": "angle", "theta": "angle", "θ": "angle",
    "winkel": "angle",
}  # fmt: skip
"""Word of a name, in lower case -> quantity that it says."""
WHOLE_NAMES = {
    "drop": "run", "run": "run", "particle": "object", "object": "object", "objekt": "object", "objet": "object",
    "track": "object", "track id": "object", "trackid": "object", "trajectory": "object", "point": "object", "marker": "object",
    "frame rate": "setting", "framerate": "setting", "fps": "setting", "x origin": "setting", "y origin": "setting",
    "origin x": "setting", "origin y": "setting", "origin": "setting", "scale": "setting",
}  # fmt: skip
"""Name without its unit -> what its column is: the number of a run, the name of an object, a setting of the program."""
RATE_WORDS = frozenset({"rate", "velocity", "speed", "vitesse", "geschwindigkeit", "velocidad"})
DERIVED_WORDS = RATE_WORDS | {
    "vx", "vy", "ax", "ay", "acceleration", "beschleunigung", "accélération", "force", "kraft", "energy", "momentum",
    "pixelx", "pixely", "error", "err", "sigma", "uncertainty", "std", "origin", "scale", "absolute", "step",
}  # fmt: skip
"""Words of quantities that are computed from positions, or are none."""
FILLING_WORDS = frozenset(
    {"position", "pos", "coordinate", "coord", "center", "centre", "centroid", "axis", "video", "elapsed"}
)
"""Words that say nothing more beside a quantity."""
UNITS = frozenset(
    {"m", "cm", "mm", "dm", "km", "um", "µm", "in", "inch", "ft", "px", "pixel", "pixels", "s", "sec", "ms", "us", "µs", "min",
     "rad", "deg", "°", "rad/s", "deg/s", "°/s", "m/s", "cm/s", "mm/s", "px/s", "m/s^2", "m/s²", "px/m", "hz", "n", "kg", "g"}
)  # fmt: skip
"""Units, in lower case, that are told from names without brackets."""
PIXELS = frozenset({"px", "pixel", "pixels"})
MAX_NAME = 200
"""Longest text that is read as a name [characters]; the time that this takes grows with its square."""
MAX_SHORT_SHARE = 0.5
"""Largest share of rows with fewer cells than there are names: with more, the names do not belong to the rows."""
MIN_COUNTED = 10
"""Smallest number of values by which equal steps tell a time or a row's number from a position."""
MAX_SHOWN = 5
"""Largest number of lines that a sentence names."""
_RUN = re.compile(r"[,:]?\s*\b(?:run|lauf|essai|série)\s*#?\s*([0-9]+)\b\s*[,:]?", re.IGNORECASE)
_AXIS = re.compile(r"(?:(.*?)[ _./-]+)?([xyz])(?:[ _]?([0-9]+)|[ _./-]+(.*))?", re.IGNORECASE)
_JOINED = re.compile(r"(light|heavy)([xy])", re.IGNORECASE)
_CAMEL = re.compile(r"(?<=[a-z0-9])(?=[XYZ]$)")
_UNIT_SUFFIX = re.compile(r"(.*?)_(s|ms|m|cm|mm|rad|deg|m_per_s|rad_per_s)")
_MEANT = ("x", "y", "light_x", "heavy_y", "angle", "height")
"""Names that a misspelt one is compared with."""


@dataclass(frozen=True, kw_only=True)
class Column:
    """Quantity, track and unit of one column, with the rows that it stands in."""

    index: int
    label: str
    """Name for messages, track included: "x (mass A)"."""
    role: str
    """"t", "frame", "object", "run", "setting" or one of `POSITION_ROLES`; '' if the column is none of these."""
    track: str
    """Name of the tracked object, or axis of an angular rate; '' if the file does not say."""
    unit: str
    """Unit as the file writes it; '' if it has none."""
    run: str = ""
    """Name of the run that it belongs to; '' if the file does not say."""
    rows: tuple[TableLine, ...] = ()


def read_columns(text: DelimitedText, kind: str, asked: Sequence[str], notes: ReadingNotes) -> list[Column]:
    """Return the columns of a file, by their names and by what they hold.

    Parameters
    ----------
    kind
        One of `readers.KINDS`; it decides what columns without names hold, and what is read of a file with several kinds.
    asked
        Names for the tracks of columns without names, in their order.

    Raises
    ------
    DataError
        If there is no column of times or frame numbers, or none of positions, angles or heights.
    """
    columns: list[Column] = []
    for number, (head, rows) in enumerate(_tables(text), start=1):
        header = _header(text, head, rows)
        if header is None:
            part = _by_position(text, kind, asked, head, rows, notes)
        else:
            part = _by_name(text, header, head, rows, notes)
        part = _split_by_cells(text, part)
        if {(c.track, c.role) for c in part if c.role in POSITION_ROLES} & {(c.track, c.role) for c in columns}:
            # The same objects in a second table: another run
            part = [replace(c, run=c.run or str(number)) for c in part]
            columns = [replace(c, run=c.run or "1") for c in columns]
        columns += part
    columns = _of_one_kind(columns, kind)
    for column in columns:
        if column.role in ("x", "y") and _counts(text, column):
            found = f"found values that grow by equal steps from {column.rows[0].cell(column.index)}"
            message = f"{found}, as times or numbers of rows do"
            raise text.error(
                column.rows[0].line, column.label, f"{message}, needed positions; correct the names of the columns"
            )
    return columns


def _tables(text: DelimitedText) -> list[tuple[list[TableLine], list[TableLine]]]:
    """Return the tables of a file, each as the lines above its numbers and the rows of numbers."""
    tables: list[tuple[list[TableLine], list[TableLine]]] = []
    head: list[TableLine] = []
    rows: list[TableLine] = []
    for i, line in enumerate(text.lines):
        # A text between rows of numbers is a damaged row, which is refused when it is read, unless names of columns follow
        if _is_row(line, text.decimal_comma, has_head=bool(head)) or (rows and not _begins_table(text, i)):
            rows.append(line)
            continue
        if rows:
            tables.append((head, rows))
            head, rows = [], []
        head.append(line)
    if rows:
        tables.append((head, rows))
    if not tables:
        last = quote(" ".join(filter(None, text.lines[-1].cells)))
        raise text.error(
            text.lines[-1].line, "", f"found no row of numbers (last row {last}), needed rows such as "
            "'0.0042,0.51,-0.22'; export the data again, as numbers without units",
        )  # fmt: skip
    return tables


def _is_row(line: TableLine, decimal_comma: bool, *, has_head: bool) -> bool:
    """Return whether most cells of a line are numbers; above all names, one whose first cell is empty has names of tracks."""
    filled = [c for c in line.cells if c]
    numbers = sum(is_number(c, decimal_comma) for c in filled)
    return (
        bool(line.cells[0] or has_head)
        and 0 < numbers
        and (is_number(line.cells[0], decimal_comma) or 2 * numbers > len(filled))
    )


def _begins_table(text: DelimitedText, index: int) -> bool:
    """Return whether a line of text, or one of the next two, has names of columns."""
    return any(
        not _is_row(line, text.decimal_comma, has_head=True) and _names_times(line) for line in text.lines[index : index + 3]
    )


def _names_times(line: TableLine) -> bool:
    return len([c for c in line.cells if c]) > 1 and any(_name(c).role in ("t", "frame") for c in line.cells)


def _header(text: DelimitedText, head: list[TableLine], rows: list[TableLine]) -> TableLine | None:
    """Return the line of names; None: the columns have none.

    Raises
    ------
    DataError
        If there are names, but none of a time.
    """
    # From the last line up: the names stand right above the numbers, titles further up
    header = next((line for line in reversed(head) if _names_times(line)), None)
    if header is not None:
        return header
    width = max(len([c for c in row.cells if c]) for row in rows)
    # A line of names may be a comment
    header = next((c for c in reversed(text.comments) if _names_times(c) and len(c.cells) == width), None)
    if header is not None or not head or len([c for c in head[-1].cells if c]) < max(width, 2):
        return header
    names = [c for c in head[-1].cells if c]
    columns = [
        Column(index=i, label=c, role="", track="", unit="", rows=tuple(rows)) for i, c in enumerate(head[-1].cells) if c
    ]
    counted = next((c.label for c in columns if _counts(text, c, unrest=0.2)), "")
    if {"a", "acceleration"} & {_name(c).words for c in names}:
        hint = (
            "if each row is a trial, as in a table of masses and accelerations, measure one trial's positions over time instead"
        )
    else:
        hint = f"{quote(counted)} grows by equal steps: if it is the time, name it 't'" if counted else "name it 't'"
    raise text.error(head[-1].line, "", f"found no column of times among {quote(', '.join(names))}, needed one; {hint}")


@dataclass(frozen=True, kw_only=True)
class _Name:
    """Name of a column, in parts."""

    words: str
    """What is left without unit, run and program, in lower case."""
    role: str
    track: str = ""
    unit: str = ""
    run: str = ""
    group: str = ""
    """What stands before a colon: a program's name for its data, or an object."""


def _name(cell: str) -> _Name:
    """Split the name of a column: "Latest: light x [cm], Run #2" -> x of light in cm, run 2."""
    if len(cell) > MAX_NAME:
        return _Name(words=cell, role="")
    found = _RUN.search(cell)
    run = found[1] if found else ""
    text = _RUN.sub("", cell) if found else cell
    group, _, text = text.rpartition(":")
    text, unit = _split_unit(text.strip())
    words = text.lower()
    parts = {"unit": unit, "run": run, "group": group.strip(), "words": words}
    tokens = [t for t in re.split(r"[\s_./-]+", words) if t]
    whole = WHOLE_NAMES.get(" ".join(tokens))
    if whole:
        return _Name(role=whole, **parts)
    axis = _AXIS.fullmatch(_CAMEL.sub(" ", _JOINED.sub(r"\1 \2", text)))
    roles = [ROLES[t] for t in tokens if t in ROLES]
    is_rate = "angle_rate" in roles or bool(
        ({"angular"} | {t for t in tokens if ROLES.get(t) == "angle"}) & set(tokens) and RATE_WORDS & set(tokens)
    )
    if is_rate or (axis and unit.lower() in ("rad/s", "deg/s", "°/s")):
        return _Name(role="angle_rate", track=axis[2].lower() if axis else "", **parts)
    # "v x" is a velocity, "A x" the object A
    is_derived = DERIVED_WORDS & set(tokens) or ({"v", "a"} & set(re.split(r"[\s_./-]+", text)) and len(tokens) <= 2)
    if is_derived or ("/" in unit and unit.lower() in UNITS):
        return _Name(role="", **parts)
    if axis and axis[2].lower() != "z":
        track = " ".join(filter(None, (_without_filling(axis[1] or ""), _without_filling(axis[4] or ""), axis[3])))
        return _Name(role=axis[2].lower(), track=track, **parts)
    return _Name(role=roles[0] if roles and len(tokens) <= 3 else "", **parts)


def _without_filling(text: str) -> str:
    """Return an object's name without words such as "position"; nothing else of it is changed."""
    if not FILLING_WORDS & set(re.split(r"[\s_./-]+", text.lower())):
        return text
    return " ".join(t for t in re.split(r"[\s_]+", text) if t.lower() not in FILLING_WORDS)


def _split_unit(text: str) -> tuple[str, str]:
    """Split a unit off: "x [cm]", "x (cm)", "x/cm", "x in cm", "x, cm" or "x_cm"; '' if there is none."""
    if text.endswith(("]", ")")):
        inside = text[:-1]
        last = max(inside.rfind("]"), inside.rfind(")")) + 1  # an earlier pair of brackets is part of the name
        opening = min((i for sign in "[(" if (i := inside.find(sign, last)) >= 0), default=None)
        return (text, "") if opening is None else (inside[:opening].rstrip(" /"), inside[opening + 1 :].strip())
    for sign in ("/", " in ", ","):
        # From the left, as a unit may have a slash of its own
        for at in (i for i in range(1, len(text)) if text.startswith(sign, i)):
            if text[at + len(sign) :].strip().lower() in UNITS:
                return text[:at].strip(), text[at + len(sign) :].strip()
    suffix = _UNIT_SUFFIX.fullmatch(text)
    return (suffix[1], suffix[2].replace("_per_", "/")) if suffix else (text, "")


def _by_name(
    text: DelimitedText, header: TableLine, head: list[TableLine], rows: list[TableLine], notes: ReadingNotes
) -> list[Column]:
    """Return the columns of a table whose names stand in ``header``."""
    cells = header.cells
    if all(len(row.cells) == len(cells) + 1 for row in rows) and _counts(text, _numbered(0, rows)):
        cells = ("", *cells)  # the rows are numbered, and their numbers have no name
    width = max(i + 1 for i, cell in enumerate(cells) if cell)
    whole = _whole_rows(text, width, rows, notes)
    below = [line for line in head if line.line > header.line]
    units = next((line for line in below if all(_bare(c).lower() in UNITS for c in line.cells if c)), None)
    # Tracker writes a name above the first column of its track; all columns up to the next name are that track's.
    titles = {i: c for line in head if line.line < header.line for i, c in enumerate(line.cells) if c}
    if len(titles) == 1:
        titles = {0: next(iter(titles.values()))}  # `cm_A` alone in a line stands anywhere above the only track
    names = [_name(cell) for cell in cells]
    groups = {n.group for n in names if n.role in POSITION_ROLES}
    columns, title = [], ""
    for index, (cell, name) in enumerate(zip(cells, names, strict=True)):
        title = titles.get(index, title)
        run_in_title = _RUN.fullmatch(title)
        if not cell:
            continue
        own = name.track if len(groups) == 1 else " ".join(filter(None, (name.group, name.track)))
        track = own or ("" if run_in_title else title)
        columns.append(
            Column(
                index=index,
                label=f"{cell} ({track})" if track and not own else cell,
                role=name.role,
                track=track,
                unit=name.unit or (_bare(units.cell(index)) if units else ""),
                run=name.run or (run_in_title[1] if run_in_title else ""),
                rows=whole,
            )
        )
    columns = _with_numbered_tracks(columns)
    settings = [c for c in columns if c.role == "setting"]
    for c in settings:
        value = next((row.cell(c.index) for row in whole if row.cell(c.index)), "")
        notes.assumptions += [f"setting in the table left out: {c.label} = {value}"] if value else []
    columns = [c for c in columns if c.role != "setting"]
    _refuse_names_without_positions(text, header, columns)
    return columns


def _bare(cell: str) -> str:
    """Return a unit without its brackets."""
    return cell.strip("[]() ")


def _numbered(index: int, rows: Sequence[TableLine]) -> Column:
    return Column(index=index, label=str(index + 1), role="", track="", unit="", rows=tuple(rows))


def _counts(text: DelimitedText, column: Column, unrest: float = 0.0) -> bool:
    """Return whether values begin near zero and grow by equal steps, as times and numbers of rows do.

    Parameters
    ----------
    unrest
        Largest difference of a step from their mean, as a share of it; by default that of rounding alone.
    """
    cells = [c for row in column.rows if is_number(c := row.cell(column.index), text.decimal_comma)]
    if len(cells) < max(MIN_COUNTED, len(column.rows) // 2):
        return False
    values = [float(c.replace(",", ".")) for c in cells]
    step = (values[-1] - values[0]) / (len(values) - 1)
    rounding = max(1.01 * max(last_digits(cells)), unrest * step)
    return (
        step > 0 and abs(values[0]) <= 1.5 * step and all(b > a and abs(b - a - step) <= rounding for a, b in pairwise(values))
    )


def _whole_rows(text: DelimitedText, width: int, rows: list[TableLine], notes: ReadingNotes) -> tuple[TableLine, ...]:
    """Return the rows with as many cells as there are names.

    Where a point is missing, some programs leave its cells out, so that all later ones stand in another's columns.

    Raises
    ------
    DataError
        If a row has more cells, or most have fewer.
    """
    for row in rows:
        if any(row.cells[width:]):
            too_many = (
                "if these are decimal commas, export with semicolons" if text.delimiter == "," else "complete or delete the row"
            )
            raise text.error(row.line, "", f"found {len(row.cells)} cells, needed {width}; {too_many}")
    last = max((i for i, row in enumerate(rows) if len(row.cells) >= width), default=-1)
    # Editors trim tabs at the end of a line, so that short rows at the end of a table only lack the track that ended before
    short = [row for i, row in enumerate(rows) if len(row.cells) < width and not (text.delimiter == "\t" and 0 <= last < i)]
    if len(short) > MAX_SHORT_SHARE * len(rows):
        raise text.error(short[0].line, "", f"found {len(short[0].cells)} cells, needed {width}; complete or delete the row")
    if short:
        more = f" and {len(short) - MAX_SHOWN} more" if len(short) > MAX_SHOWN else ""
        lines = ", ".join(str(row.line) for row in short[:MAX_SHOWN])
        left_out = f"left out {len(short)} of {len(rows)} rows (line {lines}{more})"
        notes.assumptions.append(f"{left_out}: they have fewer cells than there are names, and any may be missing")
    return tuple(row for row in rows if row not in short) if short else tuple(rows)


def _with_numbered_tracks(columns: list[Column]) -> list[Column]:
    """Give tracks without a name a number where there are several: columns "x, y, x, y", or "x, y, x 2, y 2"."""
    seen: Counter[tuple[str, str, str]] = Counter()
    named = []
    others = {c.track for c in columns if c.role in ("x", "y")} - {""}
    for c in columns:
        if c.role in ("x", "y") and not c.track:
            seen[c.role, c.run, ""] += 1
            count = seen[c.role, c.run, ""]
            c = replace(c, track=str(count) if count > 1 else "")
        named.append(c)
    if others or any(count > 1 for count in seen.values()):
        first = next(n for n in ("1", "0", "first") if n not in others)
        named = [replace(c, track=first) if c.role in ("x", "y") and not c.track else c for c in named]
    return named


def _refuse_names_without_positions(text: DelimitedText, header: TableLine, columns: list[Column]) -> None:
    """Refuse names of which none is a position, an angle or a height."""
    if any(c.role in POSITION_ROLES for c in columns):
        return
    matches = [(c, difflib.get_close_matches(c.label.lower(), _MEANT, 1)) for c in columns]
    hint = next((f"; did you mean '{m[0]}' by '{c.label}'?" for c, m in matches if m), "; rename the columns so")
    labels = quote(", ".join(c.label for c in columns))
    needed = "needed positions (x, y), an angle or a height beside the time"
    raise text.error(header.line, "", f"found columns {labels}, {needed}{hint}")


def _by_position(
    text: DelimitedText, kind: str, asked: Sequence[str], head: list[TableLine], rows: list[TableLine], notes: ReadingNotes
) -> list[Column]:
    """Return the columns of a table that does not name them: t, x, y for each track, or t, angle and perhaps its rate."""
    width = max(len([c for c in row.cells if c]) for row in rows)
    whole = _whole_rows(text, width, rows, notes)
    titles = [cell for line in head for cell in line.cells if cell]
    if kind == "drop":
        raise text.error(rows[0].line, "", "found no names of columns, needed 'time' and 'height'; write them above")
    if kind == "angle" or (kind == "auto" and not asked and not titles and text.delimiter == " " and width in (2, 3)):
        roles = [("t", ""), ("angle", ""), ("angle_rate", "")][:width]
        notes.assumptions.append("columns without names: taken as t [s], angle [rad]" + (", rate [rad/s]" if width > 2 else ""))
    elif width in (3, 5) and (width == 3 or len(asked) == 2 or len(titles) == 2):
        track_names = titles if len(titles) == width // 2 else list(asked)
        track_names = track_names if len(track_names) == width // 2 else [Path(text.file).stem]
        roles = [("t", "")] + [(axis, track) for track in track_names for axis in "xy"]
        if not _counts(text, _numbered(0, whole)) and _counts(text, _numbered(width - 1, whole)):
            roles = [*roles[1:], roles[0]]
        notes.assumptions.append("columns without names: taken as " + ", ".join(role for role, _ in roles))
    else:
        message = f"found {width} columns without names"
        raise text.error(rows[0].line, "", f"{message}, needed a line of names above such as 't,light_x,light_y'; add it")
    return [
        Column(index=i, label=f"{i + 1} ({role}{' of ' + track if track else ''})", role=role, track=track, unit="", rows=whole)
        for i, (role, track) in enumerate(roles)
    ]


def _split_by_cells(text: DelimitedText, columns: list[Column]) -> list[Column]:
    """Return the columns of each object and run where a column says which one a row shows."""
    for role in ("object", "run"):
        by = next((c for c in columns if c.role == role), None)
        if by is None:
            continue
        columns = [c for c in columns if c is not by]
        names = list(dict.fromkeys(_short_number(row.cell(by.index), text.decimal_comma) for row in by.rows))
        if 2 * len(names) > len(by.rows) and len(names) > 2:
            continue  # no names: each row has its own
        parts = []
        for name in filter(None, names):
            rows = tuple(row for row in by.rows if _short_number(row.cell(by.index), text.decimal_comma) == name)
            for c in columns:
                label = f"{c.label} ({name})" if c.role in POSITION_ROLES else c.label
                own = replace(c, run=name) if role == "run" else replace(c, track=name, label=label)
                parts.append(replace(own, rows=rows))
        columns = parts
    return columns


def _short_number(cell: str, decimal_comma: bool) -> str:
    """Return a number as people write it, "2" for "2.0"; a text as it is."""
    return f"{float(cell.replace(',', '.')):g}" if is_number(cell, decimal_comma) else cell


def _of_one_kind(columns: list[Column], kind: str) -> list[Column]:
    """Leave angles and heights out beside positions, from which a program computed them, unless they are asked for."""
    kinds = {"positions": ("x", "y"), "angle": ("angle", "angle_rate"), "drop": ("height",)}
    present = {c.role for c in columns}
    wanted = kind if kind in kinds else next((k for k, roles in kinds.items() if present & set(roles)), "")
    return [replace(c, role="") if c.role in POSITION_ROLES and c.role not in kinds.get(wanted, ()) else c for c in columns]
