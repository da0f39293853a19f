"""Tell which quantity each column of a table holds: by the names above it, by what stands above these, and by what it holds.

What a column holds decides where names are silent, and refuses a name that contradicts it.
"""

from __future__ import annotations

import difflib
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from looping_pendulum.measured.observations import DataError, ReadingNotes
from looping_pendulum.measured.tables.delimited import DelimitedText, TableLine, last_digits, listed
from looping_pendulum.measured.tables.names import (
    BOX_ROLES,
    CLOCK_ROLES,
    DERIVED_WORDS,
    POSITION_ROLES,
    RUN,
    TIME_UNITS,
    UNIT_WORDS,
    UNITS,
    Column,
    bare_unit,
    read_name,
    without_filling,
)
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.scenarios.document import quote

MAX_SHORT_SHARE = 0.5
"""Largest share of rows with fewer cells than there are names: with more, the names do not belong to the rows."""
MIN_COUNTED = 10
"""Smallest number of values by which equal steps tell a time or a row's number from a position, and of rows of an object that
stands below another."""
MAX_UNREST = 0.2
"""Largest difference of a step from the mean one, as a share of it, where a column without a name may be one of times."""
MAX_OBJECTS = 500
"""Largest number of objects and tables in a file."""
MAX_TEXT_LINES = 5000
"""Largest number of lines without numbers."""
MAX_HEAD = 60
"""Largest number of lines above the numbers in which names are looked for."""
MOT_ROLES = ("frame", "object", "left", "top", "width", "height", "score", "", "", "")
"""Columns of the tables without names of multiple object tracking (MOT challenge)."""
MOT_WIDTHS = (7, 9, 10)
PLACE_ROLES = ("x", "y", *BOX_ROLES)
"""Roles that show where an object is."""
_CLOCKS, _POSITIONS = frozenset(CLOCK_ROLES), frozenset(POSITION_ROLES)
_NAMES = _CLOCKS | _POSITIONS
_NO_LINE = TableLine(line=0, cells=())
MEANT = ("x", "y", "light_x", "heavy_y", "angle", "height")
"""Names that a misspelt one is compared with."""


def read_columns(text: DelimitedText, kind: str, asked: Sequence[str], notes: ReadingNotes) -> list[Column]:
    """Return the columns of a file with their numbers, by their names and by what they hold.

    Parameters
    ----------
    kind
        One of `observations.KINDS`; it decides what columns without names hold, and what is read of a file with several kinds.
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
        part = _with_clock(text, _split_objects(text, part), notes)
        if {(c.track, c.role) for c in part if c.is_position} & {(c.track, c.role) for c in columns}:
            # The same objects in a second table: another run
            part = [replace(c, run=c.run or str(number)) for c in part]
            columns = [replace(c, run=c.run or "1") for c in columns]
        columns += part
    return [replace(c, value=_values(c)) if c.role and not len(c.value) else c for c in columns]


def checked(text: DelimitedText, column: Column) -> Column:
    """Return a column whose cells are all numbers, empty, or say that there is none.

    Raises
    ------
    DataError
        If one holds anything else.
    """
    for row, is_read in zip(column.rows, column.has_values, strict=True):
        if not is_read:
            text.number(row, column.index, column.label)
    return column


def _values(column: Column) -> Array:
    return np.array([row.value(column.index) for row in column.rows])


def _tables(text: DelimitedText) -> list[tuple[list[TableLine], list[TableLine]]]:
    """Return the tables of a file, each as the lines above its numbers and the rows of numbers."""
    lines = text.lines
    is_row = [_is_row(line) for line in lines]
    if not any(is_row) or len(lines) - sum(is_row) > MAX_TEXT_LINES:
        found = f"found no table of numbers (last row {quote(' '.join(lines[-1].filled))})"
        needed = "needed rows such as '0.0042,0.51,-0.22'; export the data again, as numbers without units"
        raise text.error(lines[-1].line, "", f"{found}, {needed}")
    roles = [set() if row else _roles(line) for line, row in zip(lines, is_row, strict=True)]
    tables: list[tuple[list[TableLine], list[TableLine]]] = [([], [])]
    head_names_points = False
    texts: set[str] = set()
    for i, line in enumerate(lines):
        head, rows = tables[-1]
        begins_table = any(own & _NAMES for own in roles[i : i + 3])
        # A text between rows of numbers is a damaged row, which is refused when it is read, unless names of columns follow
        has_numbers = is_row[i] and bool(line.cells[0] or head) and not (len(line.cells) == 1 and begins_table)
        # Numbers above the names of the columns are settings of the program
        is_setting = not (rows or head_names_points) and any(own & _POSITIONS for own in roles[i + 1 : i + 4])
        # An object without a point in this row has its name in other rows
        is_title = len(line.filled) == 1 and not has_numbers and line.filled[0] not in texts
        if (has_numbers and not is_setting) or (rows and not is_title and not begins_table):
            rows.append(line)
            texts.update(line.filled[:1])
        elif rows and begins_table:
            tables.append(([line], []))
            head_names_points = bool(roles[i] & _POSITIONS)
        elif not rows:  # else the name of an object, whose rows stand below another's
            head.append(line)
            head_names_points |= bool(roles[i] & _POSITIONS)
    tables = [(head, rows) for head, rows in tables if rows]
    _refuse_many(text, len(tables))
    return tables


def _refuse_many(text: DelimitedText, objects: int) -> None:
    if objects > MAX_OBJECTS:
        raise text.error(None, "", f"found {objects} objects or tables, needed two masses of one trial; export these alone")


def _is_row(line: TableLine) -> bool:
    """Return whether most cells of a line, or its first one, are numbers."""
    numbers = sum(not math.isnan(value) for value in line.values)
    return 2 * numbers > len(line.filled) or not math.isnan(line.values[0])


def _roles(line: TableLine) -> set[str]:
    """Return the roles of the columns that a line of names names; none where it has a single name, which is a title."""
    return {read_name(c).role for c in line.filled} - {""} if len(line.filled) > 1 else set()


def _header(text: DelimitedText, head: list[TableLine], rows: list[TableLine]) -> TableLine | None:
    """Return the line that names what the columns hold; None: they have no names. Names of no positions are refused."""
    width = max(len(row.filled) for row in rows)
    # A line of names may be a comment
    lines = [*[c for c in text.comments if len(c.cells) in (width, len(rows[0].cells))][:MAX_HEAD], *head[-MAX_HEAD:]]
    # From the last line up: the names stand right above the numbers, titles further up. The times may be named in another line
    roles = [(line, _roles(line) & _NAMES) for line in reversed(lines)]
    ranked = [(bool(own & _POSITIONS), bool(own & _CLOCKS), line) for line, own in roles if own]
    if ranked:
        return max(ranked, key=lambda rank: rank[:2])[2]
    if not head or len(head[-1].filled) < max(width, 2):
        return None
    raise _no_clock(text, [Column(index=i, label=c, rows=rows) for i, c in enumerate(head[-1].cells) if c], head[-1].line)


def _no_clock(text: DelimitedText, columns: Sequence[Column], line: int) -> DataError:
    """Return the error that no column has times."""
    counted = next((c.label for c in columns if counts(c, MAX_UNREST)), "")
    hint = f"{quote(counted)} grows by equal steps: if it is the time, name it 't'" if counted else "name it 't'"
    if {"a", "acceleration"} & {read_name(c.label).label for c in columns}:
        hint = (
            "if each row is a trial, as in a table of masses and accelerations, measure one trial's positions over time instead"
        )
    names = quote(", ".join(dict.fromkeys(c.label for c in columns)))
    return text.error(line, "", f"found no column of times among {names}, needed one; {hint}")


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
    if all(len(row.cells) == len(cells) + 1 for row in rows) and counts(Column(rows=rows)):
        cells = ("", *cells)  # the rows are numbered, and their numbers have no name
    above = [line for line in head if line.line < header.line][-MAX_HEAD:]
    below = [line for line in head if line.line > header.line]
    # pandas names the times below the other columns, OpenSim above them
    clocks = {i: c for line in above + below for i, c in enumerate(line.cells) if read_name(c).role in CLOCK_ROLES}
    cells = tuple(cell if read_name(cell).role else clocks.get(i, cell) for i, cell in enumerate(cells))
    kinds = above[-1] if above else _NO_LINE
    names = [
        replace(read_name(cell), role="") if kinds.cell(i).lower() in DERIVED_WORDS else read_name(cell)
        for i, cell in enumerate(cells)
    ]
    titles = _titles(above, names, asked)
    whole = _whole_rows(text, max(i + 1 for i, cell in enumerate(cells) if cell), rows, notes)
    units = _units(names, head, below)
    has_groups = len({n.group for n in names if n.is_position}) != 1
    columns = []
    for index, (cell, name) in enumerate(zip(cells, names, strict=True)):
        named = _named(name, cell or str(index + 1), titles[index], has_groups)
        column = replace(named, index=index, unit=units[index], rows=whole)
        if cell or counts(column):
            columns.append(column)
    said = [(c.track, c.role, c.axis, c.run) for c in columns if c.is_position]
    if len(set(said)) < len(said) and any(titles):
        # The same objects side by side: what stands above tells the runs
        columns = [replace(c, run=c.run or titles[c.index]) for c in columns]
    columns = _without_settings(_with_numbered_tracks(columns), notes)
    if any(c.is_position for c in columns):
        return columns
    matches = [(c, difflib.get_close_matches(c.label.lower(), MEANT, 1)) for c in columns]
    hint = next((f"did you mean '{m[0]}' by '{c.label}'?" for c, m in matches if m), "rename the columns so")
    found = f"found columns {quote(', '.join(c.label for c in columns))}"
    raise text.error(header.line, "", f"{found}, needed positions (x, y), an angle or a height beside the time; {hint}")


def _named(name: Column, cell: str, title: str, has_groups: bool) -> Column:
    """Return a column with the object and the run that its name says, or else the title above it."""
    run_in_title = RUN.fullmatch(title)
    own = " ".join(filter(None, (name.group, name.track))) if has_groups else name.track
    # "X1" below the name of an object is its x
    own = "" if own.isdigit() and title else own
    track = own or ("" if run_in_title else title)
    run = name.run or (run_in_title[1] if run_in_title else "")
    return replace(name, label=f"{cell} ({track})" if track and not own else cell, track=track, run=run)


def _without_settings(columns: list[Column], notes: ReadingNotes) -> list[Column]:
    """Return the columns that are no settings of the program; those with a value are named."""
    for c in columns:
        value = next(filter(None, c.cells), "") if c.role == "setting" else ""
        notes.assumptions += [f"setting in the table left out: {c.label} = {value}"] if value else []
    return [c for c in columns if c.role != "setting"]


def _units(names: Sequence[Column], head: Sequence[TableLine], below: Sequence[TableLine]) -> list[str]:
    """Return the unit of each column: in its name, in a line below the names, or by a setting above them; '' if none."""
    is_of_units = (line for line in below if 2 * sum(bare_unit(c).lower() in UNITS for c in line.filled) > len(line.filled))
    units = next(is_of_units, _NO_LINE)
    length = _stated_length_unit(head)
    return [n.unit or bare_unit(units.cell(i)) or (length if n.is_length else "") for i, n in enumerate(names)]


def _titles(above: Sequence[TableLine], names: Sequence[Column], asked: Sequence[str]) -> list[str]:
    """Return the name of the object that stands above each column, '' where none does.

    Several lines may stand there: of programs, kinds, networks, objects and numbers. The one that names the objects tells the
    columns of each axis apart, and each of its names stands above the same axes; if no line does, all together may.
    """
    places = [i for i, name in enumerate(names) if name.is_position]
    first = next((i for i, name in enumerate(names) if name.is_position or name.role in ("z", "radius", "width")), 0)
    lines = [_spread(line, len(names), places, first) for line in above]
    varied = [line for line in lines if len({line[i] for i in places}) > 1]
    constant = [line for line in reversed(lines) if line not in varied]
    together = [" ".join(filter(None, titles)) for titles in zip(*varied, strict=True)] if varied else []

    def tells_objects(titles: Sequence[str]) -> bool:
        axes: dict[str, list[tuple[str, ...]]] = {}
        for i in places:
            axis = (names[i].role, names[i].axis, names[i].run, names[i].track.strip("0123456789"))
            axes.setdefault(titles[i], []).append(axis)
        is_unique = all(len(set(own)) == len(own) for own in axes.values())
        return bool(axes) and "" not in axes and is_unique and len({frozenset(own) for own in axes.values()}) == 1

    def names_none(titles: Sequence[str]) -> tuple[bool, bool]:
        is_of_masses = any("light" in title.lower() or "heavy" in title.lower() for title in titles)
        return not set(asked) & set(titles), not is_of_masses

    fitting = [titles for titles in (*varied, together, *constant) if titles and tells_objects(titles)]
    return min(fitting, key=names_none, default=[""] * len(names))


def _spread(line: TableLine, width: int, places: Sequence[int], first: int) -> list[str]:
    """Return what a line says above each column: a name stands above all up to the next one, a lone one above all."""
    titles, title = [], line.filled[0] if len(line.filled) == 1 else ""
    for i in range(width):
        title = line.cell(i) or title
        titles.append(title)
    # "Take 3: light" and "Take 3: heavy" are the objects of one take
    is_one_take = len({titles[i].rpartition(":")[0] for i in places}) == 1
    titles = [without_filling(t.rpartition(":")[2].strip() if is_one_take else t) for t in titles]
    return [title if i >= first else "" for i, title in enumerate(titles)]


def _stated_length_unit(head: Sequence[TableLine]) -> str:
    """Return the unit of lengths that a setting above the columns states, right of its name or below it; '' if none does."""
    for line, following in pairwise((*head, _NO_LINE)):
        for i, cell in enumerate(line.cells):
            if cell.lower() in ("units", "length units"):
                stated = (UNIT_WORDS.get(c.lower(), c) for c in (line.cell(i + 1), following.cell(i)))
                return next((unit for unit in stated if unit.lower() in UNITS), "")
    return ""


def counts(column: Column, unrest: float = 0.0) -> bool:
    """Return whether values begin near zero and grow by equal steps, as times and numbers of rows do.

    Parameters
    ----------
    unrest
        Largest difference of a step from their mean, as a share of it; by default that of rounding alone.
    """
    values = _values(column)
    known = np.isfinite(values)
    if known.sum() < max(MIN_COUNTED, len(values) // 2):
        return False
    steps = np.diff(values[known])
    step = steps.mean()
    if not np.all(steps > 0) or abs(values[known][0]) > 1.5 * step:
        return False
    digits = last_digits([cell for cell, is_known in zip(column.cells, known, strict=True) if is_known])
    return bool(np.all(np.abs(steps - step) <= max(1.01 * max(digits), unrest * step)))


def _with_clock(text: DelimitedText, columns: list[Column], notes: ReadingNotes) -> list[Column]:
    """Return the columns with one of frames, if none is named as times: one of whole numbers that grow, or the rows' numbers.

    Raises
    ------
    DataError
        If nothing tells when the rows were.
    """
    if any(c.role in CLOCK_ROLES for c in columns) or not any(c.role in PLACE_ROLES for c in columns):
        return columns
    for c in (c for c in columns if not c.role):
        are_frames = len(c.rows) > 1 and all(map(str.isdigit, c.cells)) and bool(np.all(np.diff(_values(c)) > 0))
        are_times = c.unit.lower() in TIME_UNITS or (c.label.isdigit() and counts(c))
        if are_frames or are_times:
            role, what = ("t", "times") if are_times and (c.unit or not are_frames) else ("frame", "numbers of frames")
            notes.assumptions.append(f"column {c.label!r}: its values grow, and were taken as {what}")
            return [replace(other, role=role) if other.index == c.index else other for other in columns]
    rows = {id(c.rows): c.rows for c in columns}
    lines = [row.line for own in rows.values() for row in own]
    has_gaps = len(lines) <= max(lines) - min(lines)
    if has_gaps or any(counts(c, MAX_UNREST) for c in columns) or len({len(own) for own in rows.values()}) > 1:
        raise _no_clock(text, columns, columns[0].rows[0].line)
    notes.assumptions.append("no column of times: each row taken as a frame")
    return columns + [Column(label="row", role="frame", rows=own, value=np.arange(float(len(own)))) for own in rows.values()]


def _split_objects(text: DelimitedText, columns: list[Column]) -> list[Column]:
    """Return the columns of each object and run: as columns say which one a row shows, or else where the times begin again."""
    names = _names_in_rows(columns)
    columns = [c for c in columns if c.role not in ("object", "run")]
    rows = columns[0].rows
    own_names = {c.track for c in columns if c.role in PLACE_ROLES}
    if "object" in names and own_names != {""} and len(set(names["object"])) == 1:
        # One animal, all of whose points have names
        names["object"] = [""] * len(rows)
    blocks = _blocks(columns) if len(set(zip(*names.values(), strict=True))) < 2 else []
    _refuse_many(text, len(blocks))
    if len(blocks) > 1:
        titles = _names_above(text, blocks)
        # A lone name is the title of the file
        has_titles = all(titles) and len(set(titles)) == len(titles)
        are_runs = (own_names != {""} or "object" in names) and not (len(own_names) == 1 and has_titles)
        titles = titles if has_titles else [str(i + 1) for i in range(len(blocks))]
        names["run" if are_runs else "object"] = [title for title, block in zip(titles, blocks, strict=True) for _ in block]
    parts: dict[tuple[str, str], list[TableLine]] = {}
    none = [""] * len(rows)
    for row, thing, run in zip(rows, names.get("object", none), names.get("run", none), strict=True):
        shows_none = ("object" in names and not thing) or ("run" in names and not run)
        if own_names != {""} or not shows_none:
            parts.setdefault((thing, run), []).append(row)
    _refuse_many(text, len(parts))
    return [_part_of(c, thing, run, own, len(own_names) > 1) for (thing, run), own in parts.items() for c in columns]


def _names_in_rows(columns: Sequence[Column]) -> dict[str, list[str]]:
    """Return what columns of objects and of runs say of each row, by their role; none where each row has a name of its own."""
    names: dict[str, list[str]] = {}
    for by in (c for c in columns if c.role in ("object", "run")):
        # "2" for "2.0"
        cells = [f"{v:g}" if np.isfinite(v) else c for c, v in zip(by.cells, _values(by), strict=True)]
        if any(cells) and len(set(cells)) <= max(2, len(cells) // 2):
            names.setdefault(by.role, cells)
    return names


def _part_of(column: Column, thing: str, run: str, rows: Sequence[TableLine], has_own_name: bool) -> Column:
    """Return the part of a column that shows one object and run."""
    track = " ".join(filter(None, (thing, column.track if has_own_name or not thing else "")))
    label = f"{column.label} ({thing})" if thing and column.is_position else column.label
    return replace(column, label=label, track=track, run=run or column.run, rows=rows)


def _blocks(columns: Sequence[Column]) -> list[Sequence[TableLine]]:
    """Return the rows in blocks, at whose beginnings the times begin again."""
    clock = next((c for role in CLOCK_ROLES for c in columns if c.role == role), None)
    clock = clock or next((c for c in columns if not c.role and all(map(str.isdigit, c.cells))), None)
    rows = columns[0].rows
    value = np.full(len(rows), np.nan) if clock is None else _values(clock)
    known = np.flatnonzero(np.isfinite(value))
    begins = [0]
    for before, i in pairwise(known):
        # Far back: a single time out of turn is a damaged row
        if value[i] < (value[known[np.searchsorted(known, begins[-1])]] + value[before]) / 2:
            begins.append(int(i))
    blocks = [rows[start:end] for start, end in pairwise([*begins, len(rows)])]
    return blocks if min(map(len, blocks)) >= MIN_COUNTED else [rows]


def _names_above(text: DelimitedText, blocks: Sequence[Sequence[TableLine]]) -> list[str]:
    """Return the name that stands right above each block of rows, below the block before it; '' where none does."""
    in_blocks = {row.line for block in blocks for row in block}
    first_lines = [block[0].line for block in blocks]
    names = [""] * len(blocks)
    for line in sorted((*text.comments, *text.lines), key=lambda line: line.line):
        block = int(np.searchsorted(first_lines, line.line))
        if line.line not in in_blocks and block < len(blocks) and not _roles(line) & _NAMES:
            names[block] = " ".join(line.filled)
    return names


def _whole_rows(text: DelimitedText, width: int, rows: list[TableLine], notes: ReadingNotes) -> list[TableLine]:
    """Return the rows with as many cells as there are names; a row with more, or mostly rows with fewer, are refused.

    Where a point is missing, some programs leave its cells out, so that all later ones stand in another's columns.
    """
    last = max((i for i, row in enumerate(rows) if len(row.cells) >= width), default=-1)
    is_short = [len(row.cells) < width for row in rows]
    # Editors trim tabs at the end of a line, so that short rows at the end of a table only lack the track that ended before;
    # where others are short, too, any cell may be missing
    end = last + 1 if text.delimiter == "\t" and last >= 0 and not any(is_short[:last]) else len(rows)
    short = [row for row, is_cut in zip(rows[:end], is_short, strict=False) if is_cut]
    wrong = [row for row in rows if any(row.cells[width:])] or (short if len(short) > MAX_SHORT_SHARE * len(rows) else [])
    if wrong:
        is_long = len(wrong[0].cells) > width and text.delimiter == ","
        way_out = "if these are decimal commas, export with semicolons" if is_long else "complete or delete the row"
        raise text.error(wrong[0].line, "", f"found {len(wrong[0].cells)} cells, needed {width}; {way_out}")
    if short:
        left_out = f"left out {len(short)} of {len(rows)} rows (line {listed([str(row.line) for row in short])})"
        notes.assumptions.append(f"{left_out}: they have fewer cells than there are names, and any may be missing")
    return [row for i, row in enumerate(rows) if i >= end or not is_short[i]]


def _with_numbered_tracks(columns: list[Column]) -> list[Column]:
    """Give tracks without a name a number where there are several: columns "x, y, x, y", or "x, y, x 2, y 2"."""
    others = {c.track for c in columns if c.role in PLACE_ROLES} - {""}
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
    if width in MOT_WIDTHS and all(row.cell(i).isdigit() for row in whole for i in (0, 1)):
        roles = [(role, "") for role in MOT_ROLES[:width]]
    elif kind == "angle" or (kind == "auto" and not asked and not titles and text.delimiter == " " and width in (2, 3)):
        roles = [("t", ""), ("angle", ""), ("angle_rate", "")][:width]
    elif kind != "drop" and (width == 3 or (width == 5 and 2 in (len(asked), len(titles)))):
        # Names that are asked for have no order
        tracks = titles if len(titles) == width // 2 else ["1", "2"] if width == 5 else [""]
        roles = [("t", "")] + [(axis, track) for track in tracks for axis in "xy"]
        if not counts(Column(rows=whole)) and counts(Column(index=width - 1, rows=whole)):
            roles = [*roles[1:], roles[0]]
    else:
        names = "'time,height'" if kind == "drop" else "'t,light_x,light_y'"
        needed = f"needed a line of names above such as {names}; add it"
        raise text.error(rows[0].line, "", f"found {width} columns without names, {needed}")
    units = {"t": "t [s]", "angle": "angle [rad]", "angle_rate": "rate [rad/s]"} if ("angle", "") in roles else {}
    taken = ", ".join(units.get(role, role) for role, _ in roles if role)
    notes.assumptions.append(f"columns without names: taken as {taken}")
    return [
        Column(index=i, label=f"{i + 1} ({role}{' of ' + track if track else ''})", role=role, track=track, rows=whole)
        for i, (role, track) in enumerate(roles)
        if role
    ]
