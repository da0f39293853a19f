"""Tell which quantity each column of a table holds: a grammar of the names that programs and people write above columns.

A name has what a program puts before it ("Latest:", "Run #1"), the tracked object, the quantity, and a unit: in brackets,
behind a slash, after "in", or in the row below. The object may stand behind the quantity ("x1", "Y 2"). What a column holds
decides where names are silent, and refuses a name that contradicts it.
"""

from __future__ import annotations

import difflib
import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from looping_pendulum.measured.delimited import DelimitedText, TableLine, is_number, is_value, last_digits, listed
from looping_pendulum.measured.observations import DataError, ReadingNotes
from looping_pendulum.scenarios.document import quote

CLOCK_ROLES = ("t", "frame")
POSITION_ROLES = ("x", "y", "height", "angle", "angle_rate")
ROLES = {
    "t": "t", "time": "t", "times": "t", "timestamp": "t", "zeit": "t", "temps": "t", "tiempo": "t", "tempo": "t",
    "frame": "frame", "frames": "frame", "framenumber": "frame", "bild": "frame", "bildnummer": "frame", "image": "frame",
    "slice": "frame", "img": "frame",
    "horizontal": "x", "vertical": "y", "height": "height", "h": "height", "höhe": "height", "hauteur": "height",
    "altura": "height", "omega": "angle_rate", "ω": "angle_rate", "gyroscope": "angle_rate", "gyroskop": "angle_rate",
    "gyro": "angle_rate", "winkelgeschwindigkeit": "angle_rate", "angle": "angle", "theta": "angle", "θ": "angle",
    "winkel": "angle",
}  # fmt: skip
"""Word of a name, in lower case -> quantity that it says."""
WHOLE_NAMES = {
    "drop": "run", "run": "run", "particle": "object", "object": "object", "objekt": "object", "objet": "object",
    "track": "object", "trackid": "object", "tid": "object", "id": "object", "trajectory": "object", "point": "object",
    "marker": "object",
    "frame rate": "setting", "framerate": "setting", "fps": "setting", "x origin": "setting", "y origin": "setting",
    "origin x": "setting", "origin y": "setting", "origin": "setting", "scale": "setting",
}  # fmt: skip
"""Name without its unit -> what its column is: the number of a run, the name of an object, a setting of the program."""
ERROR_SUFFIX = "_error"
"""What the name of a column of standard errors has behind that of the values."""
RATE_WORDS = frozenset({"rate", "velocity", "speed", "vitesse", "geschwindigkeit", "velocidad"})
DERIVED_WORDS = RATE_WORDS | {
    "vx", "vy", "ax", "ay", "acceleration", "beschleunigung", "accélération", "force", "kraft", "energy", "momentum",
    "pixelx", "pixely", "error", "err", "sigma", "uncertainty", "std", "origin", "scale", "absolute", "step",
    "sub", "rotation", "quaternion",
}  # fmt: skip
"""Words of quantities that are computed from positions, or are none."""
SCORE_WORDS = frozenset({"likelihood", "score", "confidence", "conf", "probability"})
"""Words of how sure a tracker is of a point."""
NUMBERING_WORDS = frozenset({"id", "idx", "index", "number", "nr", "no", "n°", "nº", "#"})
"""Words that say that a name's column holds numbers of it."""
FILLING_WORDS = frozenset(
    {"position", "pos", "coordinate", "coord", "center", "centre", "centroid", "axis", "video", "elapsed"}
)
"""Words that say nothing more beside a quantity."""
UNITS = frozenset(
    {"m", "cm", "mm", "dm", "km", "um", "µm", "in", "inch", "ft", "px", "pixel", "pixels", "s", "sec", "ms", "us", "µs", "min",
     "rad", "deg", "°", "º", "˚", "rad/s", "deg/s", "°/s", "m/s", "cm/s", "mm/s", "px/s", "m/s^2", "m/s²", "px/m", "hz", "n",
     "kg", "g"}
)  # fmt: skip
"""Units, in lower case, that are told from names without brackets."""
UNIT_WORDS = {
    "seconds": "s", "second": "s", "sekunden": "s", "secondes": "s", "milliseconds": "ms", "meters": "m", "metres": "m",
    "meter": "m", "centimeters": "cm", "centimetres": "cm", "millimeters": "mm", "millimetres": "mm",
    "degrees": "deg", "radians": "rad",
}  # fmt: skip
"""Word for a unit, in lower case -> unit."""
TIME_UNITS = frozenset({"s", "sec", "ms", "us", "µs", "min"})
PIXELS = frozenset({"px", "pixel", "pixels"})
MAX_NAME = 200
"""Longest text that is read as a name [characters]; the time that this takes grows with its square."""
MAX_SHORT_SHARE = 0.5
"""Largest share of rows with fewer cells than there are names: with more, the names do not belong to the rows."""
MIN_COUNTED = 10
"""Smallest number of values by which equal steps tell a time or a row's number from a position, and of rows of an object that
stands below another."""
# "time (hh:mm:ss)" is read in seconds
_CLOCK_UNIT = re.compile(r"\s*[\[(]h*:?m+:s+[^\])]*[\])]", re.IGNORECASE)
_RUN = re.compile(r"[,:]?\s*\b(?:run|lauf|essai|série)\s*#?\s*([0-9]+)\b\s*[,:]?", re.IGNORECASE)
_AXIS = re.compile(r"(?:(.*?)[ _./-]+)?([xyz])(?:[ _]?([0-9]+)|[ _./-]+(.*))?", re.IGNORECASE)
# pandas writes the names of several lines so where it writes one
_TUPLE = re.compile(r"\('[^']*'(?:, '[^']*')*\)")
_SCORE = re.compile(r"(?:(.*)[ _./-]+)?([^ _./-]+)")
_MASS = re.compile(r"light|heavy", re.IGNORECASE)
_JOINED = re.compile(r"(light|heavy)([xy])", re.IGNORECASE)
_BETWEEN_WORDS = re.compile(r"[\s_./-]+")
_CAMEL = re.compile(r"(?<=[a-z0-9])(?=[XYZ]$)")
_UNIT_SUFFIX = re.compile(r"(.*?)_(s|ms|m|cm|mm|rad|deg|m_per_s|rad_per_s)")
COMPLETE_ROW = "complete or delete the row"
_MEANT = ("x", "y", "light_x", "heavy_y", "angle", "height")
"""Names that a misspelt one is compared with."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Column:
    """Quantity, track and unit of one column, with the rows that it stands in."""

    index: int = 0
    label: str = ""
    """Name for messages, track included: "x (mass A)"."""
    role: str = ""
    """"t", "frame", "object", "run", "setting", "score", one of `POSITION_ROLES`, or that and `ERROR_SUFFIX`; '' if none."""
    track: str = ""
    """Name of the tracked object; '' if the file does not say."""
    axis: str = ""
    """Axis of an angular rate; '' if the file does not say."""
    unit: str = ""
    """Unit as the file writes it; '' if it has none."""
    run: str = ""
    """Name of the run that it belongs to; '' if the file does not say."""
    group: str = ""
    """What stands before a colon in its name: a program's name for its data, or an object."""
    rows: Sequence[TableLine] = ()

    @property
    def cells(self) -> list[str]:
        """Return the column's cell of each row."""
        return [row.cell(self.index) for row in self.rows]

    @property
    def is_position(self) -> bool:
        """Return whether it shows where something is, or how fast it turns."""
        return self.role in POSITION_ROLES

    @property
    def is_length(self) -> bool:
        """Return whether its values are lengths."""
        return self.role in ("x", "y", "height")


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
            part = _by_name(text, header, head, rows, asked, notes)
        part = _with_clock(text, _split_where_times_begin_again(text, _split_by_cells(text, part)), notes)
        if {(c.track, c.role) for c in part if c.is_position} & {(c.track, c.role) for c in columns}:
            # The same objects in a second table: another run
            part = [replace(c, run=c.run or str(number)) for c in part]
            columns = [replace(c, run=c.run or "1") for c in columns]
        columns += part
    # Beside positions, a program computed angles and heights from them
    kinds = {"positions": ("x", "y"), "angle": ("angle", "angle_rate"), "drop": ("height",)}
    present = {c.role for c in columns}
    if kind == "auto" and "angle" in present and all(c.unit.lower() in PIXELS for c in columns if c.role in ("x", "y")):
        present -= {"x", "y"}  # of pixels the file does not say how long they are; of an angle it says all
    wanted = kinds.get(kind) or next((roles for roles in kinds.values() if present & set(roles)), ())
    columns = [replace(c, role="") if c.is_position and c.role not in wanted else c for c in columns]
    for column in columns:
        if column.role in ("x", "y") and _counts(text, column):
            found = f"found values that grow by equal steps from {column.cells[0]}, as times or numbers of rows do"
            raise text.error(column.rows[0].line, column.label, f"{found}, needed positions; correct the names of the columns")
    return columns


def _tables(text: DelimitedText) -> list[tuple[list[TableLine], list[TableLine]]]:
    """Return the tables of a file, each as the lines above its numbers and the rows of numbers."""
    tables: list[tuple[list[TableLine], list[TableLine]]] = [([], [])]
    texts: set[str] = set()
    for i, line in enumerate(text.lines):
        head, rows = tables[-1]
        # A text between rows of numbers is a damaged row, which is refused when it is read, unless names of columns follow
        is_row = _is_row(line, text.decimal_comma, has_head=bool(head)) and not (
            len(line.cells) == 1 and _begins_table(text, i)
        )
        # Numbers above the names of the columns are settings of the program
        is_setting = not rows and not any(map(_names_points, head)) and any(map(_names_points, text.lines[i + 1 : i + 4]))
        # An object without a point in this row has its name in other rows
        is_title = len(line.filled) == 1 and not is_row and line.filled[0] not in texts
        if (is_row and not is_setting) or (rows and not is_title and not _begins_table(text, i)):
            rows.append(line)
            texts.update(line.filled[:1])
        elif rows and is_title and not _begins_table(text, i):
            continue  # the name of an object, whose rows stand below another's
        elif rows:
            tables.append(([line], []))
        else:
            head.append(line)
    if not tables[-1][1]:
        tables.pop()
    if not tables:
        last = text.lines[-1]
        found = f"found no row of numbers (last row {quote(' '.join(last.filled))})"
        needed = "needed rows such as '0.0042,0.51,-0.22'; export the data again, as numbers without units"
        raise text.error(last.line, "", f"{found}, {needed}")
    return tables


def _is_row(line: TableLine, decimal_comma: bool, *, has_head: bool) -> bool:
    """Return whether most cells of a line are numbers; above all names, one whose first cell is empty has names of tracks."""
    first = line.cells[0]
    numbers = sum(is_value(c, decimal_comma) for c in line.filled)
    return bool(first or has_head) and 0 < numbers and (is_value(first, decimal_comma) or 2 * numbers > len(line.filled))


def _begins_table(text: DelimitedText, index: int) -> bool:
    """Return whether a line of text, or one of the next two, has names of columns."""
    lines = text.lines[index : index + 3]
    return any(
        not _is_row(line, text.decimal_comma, has_head=True) and (_names_times(line) or _names_points(line)) for line in lines
    )


def _names_times(line: TableLine) -> bool:
    return len(line.filled) > 1 and any(_named(c).role in CLOCK_ROLES for c in line.cells)


def _names_points(line: TableLine) -> bool:
    return len(line.filled) > 1 and any(_named(c).is_position for c in line.cells)


def _header(text: DelimitedText, head: list[TableLine], rows: list[TableLine]) -> TableLine | None:
    """Return the line that names what the columns hold; None: they have no names. Names of no positions are refused."""
    width = max(len(row.filled) for row in rows)
    # A line of names may be a comment
    lines = [*(c for c in text.comments if len(c.cells) in (width, len(rows[0].cells))), *head]
    # From the last line up: the names stand right above the numbers, titles further up. The times may be named in another line
    for is_named in (lambda line: _names_points(line) and _names_times(line), _names_points, _names_times):
        header = next(filter(is_named, reversed(lines)), None)
        if header is not None:
            return header
    if not head or len(head[-1].filled) < max(width, 2):
        return None
    raise _no_clock(text, [Column(index=i, label=c, rows=rows) for i, c in enumerate(head[-1].cells) if c], head[-1].line)


def _no_clock(text: DelimitedText, columns: Sequence[Column], line: int) -> DataError:
    """Return the error that no column has times."""
    counted = next((c.label for c in columns if _counts(text, c, unrest=0.2)), "")
    hint = f"{quote(counted)} grows by equal steps: if it is the time, name it 't'" if counted else "name it 't'"
    if {"a", "acceleration"} & {_named(c.label).label for c in columns}:
        hint = (
            "if each row is a trial, as in a table of masses and accelerations, measure one trial's positions over time instead"
        )
    names = quote(", ".join(dict.fromkeys(c.label for c in columns)))
    return text.error(line, "", f"found no column of times among {names}, needed one; {hint}")


def _named(cell: str) -> Column:
    """Split the name of a column: "Latest: light x [cm], Run #2" -> x of light in cm, run 2.

    Its label is what is left without unit, run and program, in lower case.
    """
    if len(cell) > MAX_NAME:
        return Column(label=cell)
    if _TUPLE.fullmatch(cell):
        cell = " ".join(re.findall(r"'([^']*)'", cell))
    run = _RUN.search(cell)
    group, _, text = _CLOCK_UNIT.sub("", _RUN.sub("", cell)).rpartition(":")
    text, unit = _split_unit(text.strip())
    name = Column(label=text.lower(), unit=UNIT_WORDS.get(unit.lower(), unit), run=run[1] if run else "", group=group.strip())
    tokens = [t for t in _BETWEEN_WORDS.split(name.label) if t]
    tokens = [t.strip("#") for t in tokens]
    whole = WHOLE_NAMES.get(" ".join(t for t in tokens if t and t not in NUMBERING_WORDS) or name.label)
    if whole:
        return replace(name, role=whole)
    score = _SCORE.fullmatch(text)
    if score and score[2].lower() in SCORE_WORDS:
        return replace(name, role="score", track=score[1] or "")
    axis = _AXIS.fullmatch(_CAMEL.sub(" ", _JOINED.sub(r"\1 \2", text)))
    roles = [ROLES[t] for t in tokens if t in ROLES]
    is_rate = "angle_rate" in roles or (("angle" in roles or "angular" in tokens) and bool(RATE_WORDS & set(tokens)))
    if is_rate or (axis and unit.lower() in ("rad/s", "deg/s", "°/s")):
        return replace(name, role="angle_rate", axis=axis[2].lower() if axis else "")
    # "light_x_error" beside "light_x", as `track` writes them
    of = _named(text[: -len(ERROR_SUFFIX)]) if text.lower().endswith(ERROR_SUFFIX) else name
    if of.is_position:
        return replace(name, role=of.role + ERROR_SUFFIX, track=of.track)
    # "v x" is a velocity, "A x" the object A
    is_derived = DERIVED_WORDS & set(tokens) or ({"v", "a"} & set(_BETWEEN_WORDS.split(text)) and len(tokens) <= 2)
    if is_derived or ("/" in unit and unit.lower() in UNITS):
        return name
    if axis and axis[2].lower() != "z":
        track = " ".join(filter(None, (_without_filling(axis[1] or ""), _without_filling(axis[4] or ""), axis[3])))
        return replace(name, role=axis[2].lower(), track=track)
    return replace(name, role=roles[0] if roles and len(tokens) <= 3 else "")


def _without_filling(text: str) -> str:
    """Return an object's name without words such as "position"; nothing else of it is changed."""
    if not FILLING_WORDS & set(_BETWEEN_WORDS.split(text.lower())):
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
    text: DelimitedText,
    header: TableLine,
    head: list[TableLine],
    rows: list[TableLine],
    asked: Sequence[str],
    notes: ReadingNotes,
) -> list[Column]:
    """Return the columns of a table whose names stand in ``header``, and those of their objects perhaps above it."""
    cells = header.cells
    if all(len(row.cells) == len(cells) + 1 for row in rows) and _counts(text, Column(rows=rows)):
        cells = ("", *cells)  # the rows are numbered, and their numbers have no name
    above = [line for line in head if line.line < header.line]
    below = [line for line in head if line.line > header.line]
    # pandas names the times below the other columns, OpenSim above them
    clocks = [(i, c) for line in above + below for i, c in enumerate(line.cells) if _named(c).role in CLOCK_ROLES]
    named_elsewhere = {i: c for i, c in clocks if i < len(cells) and not _named(cells[i]).role}
    cells = tuple(named_elsewhere.get(i, cell) for i, cell in enumerate(cells))
    whole = _whole_rows(text, max(i + 1 for i, cell in enumerate(cells) if cell), rows, notes)
    units = next((line for line in below if 2 * sum(_bare(c).lower() in UNITS for c in line.filled) > len(line.filled)), None)
    length_unit = _stated_length_unit(head)
    names = [
        replace(name, role="") if DERIVED_WORDS & {line.cell(i).lower() for line in above[-1:]} else name
        for i, name in enumerate(map(_named, cells))
    ]
    titles = _titles(above, names, asked)
    has_groups = len({n.group for n in names if n.is_position}) != 1
    columns = []
    for index, (cell, name, title) in enumerate(zip(cells, names, titles, strict=True)):
        run_in_title = _RUN.fullmatch(title)
        own = " ".join(filter(None, (name.group, name.track))) if has_groups else name.track
        # "X1" below the name of an object is its x
        own = "" if own.isdigit() and title else own
        track = own or ("" if run_in_title else title)
        unit = name.unit or (_bare(units.cell(index)) if units else "") or (length_unit if name.is_length else "")
        run = name.run or (run_in_title[1] if run_in_title else "")
        label = f"{cell} ({track})" if track and not own else cell
        if cell or _counts(text, Column(index=index, rows=whole)):
            columns.append(
                replace(name, index=index, label=label or str(index + 1), track=track, unit=unit, run=run, rows=whole)
            )
    said = [(c.track, c.role, c.axis, c.run) for c in columns if c.is_position]
    if len(set(said)) < len(said) and any(titles):
        # The same objects side by side: what stands above tells the runs
        columns = [replace(c, run=c.run or titles[c.index]) for c in columns]
    for c in columns:
        value = next(filter(None, c.cells), "") if c.role == "setting" else ""
        notes.assumptions += [f"setting in the table left out: {c.label} = {value}"] if value else []
    columns = [c for c in _with_numbered_tracks(columns) if c.role != "setting"]
    if not any(c.is_position for c in columns):
        matches = [(c, difflib.get_close_matches(c.label.lower(), _MEANT, 1)) for c in columns]
        hint = next((f"did you mean '{m[0]}' by '{c.label}'?" for c, m in matches if m), "rename the columns so")
        found = f"found columns {quote(', '.join(c.label for c in columns))}"
        raise text.error(header.line, "", f"{found}, needed positions (x, y), an angle or a height beside the time; {hint}")
    return columns


def _titles(above: Sequence[TableLine], names: Sequence[Column], asked: Sequence[str]) -> list[str]:
    """Return the name of the object that stands above each column, '' where none does.

    Several lines may stand there: of programs, kinds, networks, objects and numbers. The one that names the objects tells the
    columns of each axis apart, and each of its names stands above the same axes; if no line does, all together may. A name
    stands above all columns up to the next name, and alone in its line above all.
    """
    lines = []
    first = next((i for i, name in enumerate(names) if name.is_position), 0)
    for line in above:
        spread, title = [], line.filled[0] if len(line.filled) == 1 else ""
        for i in range(len(names)):
            title = line.cell(i) or title
            spread.append(title)
        prefixes = {title.rpartition(":")[0] for title, name in zip(spread, names, strict=True) if name.is_position}
        # "Take 3: light" and "Take 3: heavy" are the objects of one take
        names_above = [_without_filling(t.rpartition(":")[2].strip() if len(prefixes) == 1 else t) for t in spread]
        lines.append([title if i >= first else "" for i, title in enumerate(names_above)])

    def places(titles: Sequence[str]) -> list[tuple[str, Column]]:
        return [(title, name) for title, name in zip(titles, names, strict=True) if name.is_position]

    varied = [line for line in lines if len({title for title, _ in places(line)}) > 1]
    constant = [line for line in reversed(lines) if line not in varied]
    together = [" ".join(filter(None, titles)) for titles in zip(*varied, strict=True)] if varied else []
    fitting = []
    for titles in filter(None, (*varied, together, *constant)):
        axes: dict[str, list[tuple[str, ...]]] = {}
        for title, name in places(titles):
            axes.setdefault(title, []).append((name.role, name.axis, name.run, name.track.strip("0123456789")))
        is_unique = all(len(set(own)) == len(own) for own in axes.values())
        if axes and "" not in axes and is_unique and len({frozenset(own) for own in axes.values()}) == 1:
            fitting.append(titles)
    # That of several which has the names that are asked for, or those of the masses
    return min(
        fitting,
        key=lambda titles: (not set(asked) & set(titles), not any(_MASS.search(title) for title in titles)),
        default=[""] * len(names),
    )


def _stated_length_unit(head: Sequence[TableLine]) -> str:
    """Return the unit of lengths that a setting above the columns states, right of its name or below it; '' if none does."""
    for line, following in pairwise((*head, TableLine(line=0, cells=()))):
        for i, cell in enumerate(line.cells):
            if cell.lower() in ("units", "length units"):
                stated = (UNIT_WORDS.get(c.lower(), c) for c in (line.cell(i + 1), following.cell(i)))
                return next((unit for unit in stated if unit.lower() in UNITS), "")
    return ""


def _bare(cell: str) -> str:
    """Return a unit without its brackets."""
    return cell.strip("[]() ")


def _counts(text: DelimitedText, column: Column, unrest: float = 0.0) -> bool:
    """Return whether values begin near zero and grow by equal steps, as times and numbers of rows do.

    Parameters
    ----------
    unrest
        Largest difference of a step from their mean, as a share of it; by default that of rounding alone.
    """
    cells = [c for c in column.cells if is_number(c, text.decimal_comma)]
    if len(cells) < max(MIN_COUNTED, len(column.rows) // 2):
        return False
    values = [float(c.replace(",", ".")) for c in cells]
    step = (values[-1] - values[0]) / (len(values) - 1)
    rounding = max(1.01 * max(last_digits(cells)), unrest * step)
    is_even = all(b > a and abs(b - a - step) <= rounding for a, b in pairwise(values))
    return step > 0 and abs(values[0]) <= 1.5 * step and is_even


def _with_clock(text: DelimitedText, columns: list[Column], notes: ReadingNotes) -> list[Column]:
    """Return the columns with one of frames, if none is named as times: one of whole numbers that grow, or the rows' numbers.

    Raises
    ------
    DataError
        If nothing tells when the rows were.
    """
    if any(c.role in CLOCK_ROLES for c in columns) or not any(c.role in ("x", "y") for c in columns):
        return columns
    rows = {id(c.rows): c.rows for c in columns}
    for c in (c for c in columns if not c.role):
        values = [int(cell) for cell in c.cells if cell.isdigit()]
        are_frames = len(values) == len(c.rows) > 1 and all(b > a for a, b in pairwise(values))
        are_times = c.unit.lower() in TIME_UNITS or (c.label.isdigit() and _counts(text, c))
        if are_frames or are_times:
            role, what = ("t", "times") if are_times and (c.unit or not are_frames) else ("frame", "numbers of frames")
            notes.assumptions.append(f"column {c.label!r}: its values grow, and were taken as {what}")
            return [replace(other, role=role) if other.index == c.index else other for other in columns]
    lines = [row.line for own in rows.values() for row in own]
    has_gaps = len(lines) <= max(lines) - min(lines)
    if has_gaps or any(_counts(text, c, unrest=0.2) for c in columns) or len({len(own) for own in rows.values()}) > 1:
        raise _no_clock(text, columns, columns[0].rows[0].line)
    notes.assumptions.append("no column of times: each row taken as a frame")
    with_clock = []
    for own in rows.values():
        width = max(len(row.cells) for row in own)
        numbered = [replace(row, cells=(*row.cells, *[""] * (width - len(row.cells)), str(i))) for i, row in enumerate(own)]
        with_clock += [replace(c, rows=numbered) for c in columns if c.rows is own]
        with_clock.append(replace(with_clock[-1], index=width, label="row", role="frame", track="", unit="", rows=numbered))
    return with_clock


def _split_where_times_begin_again(text: DelimitedText, columns: list[Column]) -> list[Column]:
    """Return the columns of each object, or of each run of a named object, where they stand one below the other."""
    clock = next((c for role in CLOCK_ROLES for c in columns if c.role == role), None)
    clock = clock or next((c for c in columns if not c.role and all(map(str.isdigit, c.cells))), None)
    if clock is None or any(c.rows is not clock.rows for c in columns):
        return columns
    blocks: list[list[TableLine]] = [[]]
    first = last = math.nan
    for row in clock.rows:
        value = text.number(row, clock.index, clock.label)
        # Far back: a single time out of turn is a damaged row
        if value < (first + last) / 2:
            blocks.append([])
        first = value if not blocks[-1] or math.isnan(first) else first
        last = value if not math.isnan(value) else last
        blocks[-1].append(row)
    if len(blocks) == 1 or min(map(len, blocks)) < MIN_COUNTED:
        return columns
    names = [_name_above(text, own, before) for own, before in zip(blocks, [[], *blocks], strict=False)]
    tracks = {c.track for c in columns if c.role in ("x", "y")}
    is_named = tracks != {""} and not (len(tracks) == 1 and all(names))
    # A lone name is the title of the file
    names = names if all(names) else [str(i + 1) for i in range(len(blocks))]
    split = []
    for own, name in zip(blocks, names, strict=True):
        block = [replace(c, label=f"{c.label} ({name})", rows=own) for c in columns]
        split += [replace(c, run=name) if is_named else replace(c, track=name) for c in block]
    return split


def _name_above(text: DelimitedText, rows: Sequence[TableLine], before: Sequence[TableLine]) -> str:
    """Return the name that stands right above rows, below the rows before them; '' if none does."""
    low = before[-1].line if before else 0
    between = [line for line in (*text.comments, *text.lines) if low < line.line < rows[0].line]
    names = [line for line in between if not (_names_points(line) or _names_times(line))]
    return " ".join(max(names, key=lambda line: line.line).filled) if names else ""


def _whole_rows(text: DelimitedText, width: int, rows: list[TableLine], notes: ReadingNotes) -> list[TableLine]:
    """Return the rows with as many cells as there are names; a row with more, or mostly rows with fewer, are refused.

    Where a point is missing, some programs leave its cells out, so that all later ones stand in another's columns.
    """

    def cells(row: TableLine, way_out: str) -> DataError:
        return text.error(row.line, "", f"found {len(row.cells)} cells, needed {width}; {way_out}")

    for row in rows:
        if any(row.cells[width:]):
            has_commas = text.delimiter == ","
            raise cells(row, "if these are decimal commas, export with semicolons" if has_commas else COMPLETE_ROW)
    last = max((i for i, row in enumerate(rows) if len(row.cells) >= width), default=-1)
    # Editors trim tabs at the end of a line, so that short rows at the end of a table only lack the track that ended before;
    # where others are short, too, any cell may be missing
    only_at_end = all(len(row.cells) >= width for row in rows[: last + 1])
    end = last + 1 if text.delimiter == "\t" and last >= 0 and only_at_end else len(rows)
    short = [row for row in rows[:end] if len(row.cells) < width]
    if len(short) > MAX_SHORT_SHARE * len(rows):
        raise cells(short[0], COMPLETE_ROW)
    if short:
        left_out = f"left out {len(short)} of {len(rows)} rows (line {listed([str(row.line) for row in short])})"
        notes.assumptions.append(f"{left_out}: they have fewer cells than there are names, and any may be missing")
    return [row for row in rows[:end] if len(row.cells) >= width] + rows[end:]


def _with_numbered_tracks(columns: list[Column]) -> list[Column]:
    """Give tracks without a name a number where there are several: columns "x, y, x, y", or "x, y, x 2, y 2"."""
    others = {c.track for c in columns if c.role in ("x", "y")} - {""}
    seen: Counter[tuple[str, str]] = Counter()
    number = {}
    for c in columns:
        if c.role in ("x", "y") and not c.track:
            seen[c.role, c.run] += 1
            number[c.index] = seen[c.role, c.run]
    has_several = bool(others) or max(number.values(), default=1) > 1
    first = next((n for n in ("1", "0", "first") if n not in others), "") if has_several else ""
    return [replace(c, track=str(n) if n > 1 else first) if (n := number.get(c.index, 0)) else c for c in columns]


def _by_position(
    text: DelimitedText, kind: str, asked: Sequence[str], head: list[TableLine], rows: list[TableLine], notes: ReadingNotes
) -> list[Column]:
    """Return the columns of a table that does not name them: t, x, y for each track, or t, angle and perhaps its rate."""
    width = max(len(row.filled) for row in rows)
    whole = _whole_rows(text, width, rows, notes)
    titles = [cell for line in head for cell in line.filled]
    if kind == "drop":
        raise text.error(rows[0].line, "", "found no names of columns, needed 'time' and 'height'; write them above")
    if kind == "angle" or (kind == "auto" and not asked and not titles and text.delimiter == " " and width in (2, 3)):
        roles = [("t", ""), ("angle", ""), ("angle_rate", "")][:width]
        notes.assumptions.append("columns without names: taken as t [s], angle [rad]" + (", rate [rad/s]" if width > 2 else ""))
    elif width == 3 or (width == 5 and 2 in (len(asked), len(titles))):
        # Names that are asked for have no order
        tracks = titles if len(titles) == width // 2 else ["1", "2"] if width == 5 else [""]
        roles = [("t", "")] + [(axis, track) for track in tracks for axis in "xy"]
        if not _counts(text, Column(rows=whole)) and _counts(text, Column(index=width - 1, rows=whole)):
            roles = [*roles[1:], roles[0]]
        notes.assumptions.append("columns without names: taken as " + ", ".join(role for role, _ in roles))
    else:
        needed = "needed a line of names above such as 't,light_x,light_y'; add it"
        raise text.error(rows[0].line, "", f"found {width} columns without names, {needed}")
    return [
        Column(index=i, label=f"{i + 1} ({role}{' of ' + track if track else ''})", role=role, track=track, rows=whole)
        for i, (role, track) in enumerate(roles)
    ]


def _split_by_cells(text: DelimitedText, columns: list[Column]) -> list[Column]:
    """Return the columns of each object and run where columns say which one a row shows."""
    rows = columns[0].rows
    names: dict[str, list[str]] = {}
    for role in ("object", "run"):
        by = next((c for c in columns if c.role == role), None)
        if by is not None:
            columns = [c for c in columns if c is not by]
            # "2" for "2.0"
            cells = [f"{float(c.replace(',', '.')):g}" if is_number(c, text.decimal_comma) else c for c in by.cells]
            # Not where each row has a name of its own, or none
            if any(cells) and len(set(cells)) <= max(2, len(rows) // 2):
                names[role] = cells
    own_names = {c.track for c in columns if c.role in ("x", "y")}
    if "object" in names and own_names != {""}:
        # One animal, all of whose points have names, or several of them
        is_only = len(set(names["object"])) == 1
        names["object"] = [""] * len(rows) if is_only else names["object"]
    parts: dict[tuple[str, ...], list[TableLine]] = {}
    for row, *said_in_row in zip(rows, *names.values(), strict=True):
        if all(said_in_row) or own_names != {""}:
            parts.setdefault(tuple(said_in_row), []).append(row)
    split = []
    for which, own in parts.items():
        said = dict(zip(names, which, strict=True))
        for c in columns:
            track = " ".join(
                filter(None, (said.get("object"), c.track if len(own_names) > 1 or not said.get("object") else ""))
            )
            label = f"{c.label} ({track})" if said.get("object") and c.is_position else c.label
            split.append(replace(c, label=label, track=track, run=said.get("run", c.run), rows=own))
    return split
