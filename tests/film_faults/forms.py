"""Write a film's table in the forms in which programs deliver points: names, units, delimiters, encodings, layouts.

Each form is a `Form`, plain data, so that a failing one can be reduced to the part that matters.
"""

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tests.blind.camera import exponent_notation
from tests.film_faults.films import Array, Film

NAMES: dict[str, Callable[[str, str, int], str]] = {
    "object axis": lambda thing, axis, number: f"{thing} {axis}",
    "axis object": lambda thing, axis, number: f"{axis} {thing}",
    "object_axis": lambda thing, axis, number: f"{thing}_{axis}",
    "axis_object": lambda thing, axis, number: f"{axis}_{thing}",
    "object.axis": lambda thing, axis, number: f"{thing}.{axis}",
    "object-axis": lambda thing, axis, number: f"{thing}-{axis}",
    "object/0/AXIS": lambda thing, axis, number: f"{thing}/0/{axis.upper()}",
    "axis-number": lambda thing, axis, number: f"{axis}{number}",
    "AXIS number": lambda thing, axis, number: axis.upper() if number == 1 else f"{axis.upper()} {number}",
    "axis number": lambda thing, axis, number: f"{axis} {number}",
    "object: AXIS": lambda thing, axis, number: f"{thing}: {axis.upper()}",
    "object axis position": lambda thing, axis, number: f"{thing} {axis} position",
    "axis position object": lambda thing, axis, number: f"{axis} position {thing}",
    "object position axis": lambda thing, axis, number: f"{thing} position {axis}",
}
"""Order of a name -> name of the column of an object's axis."""
NUMBERED = ("axis-number", "AXIS number", "axis number")
"""Names in which only the object's number is said."""
UNIT_STYLES: dict[str, Callable[[str, str], str]] = {
    "": lambda name, unit: name,
    "(m)": lambda name, unit: f"{name} ({unit})",
    "(m) joined": lambda name, unit: f"{name}({unit})",
    "[m]": lambda name, unit: f"{name} [{unit}]",
    "/m": lambda name, unit: f"{name}/{unit}",
    " / m": lambda name, unit: f"{name} / {unit}",
    " in m": lambda name, unit: f"{name} in {unit}",
    "_m": lambda name, unit: f"{name}_{unit}",
    "row below": lambda name, unit: name,
    "row below in brackets": lambda name, unit: name,
    "row below in parentheses": lambda name, unit: name,
}
AROUND: dict[str, Callable[[str], str]] = {
    "": lambda name: name,
    "Latest: ": lambda name: f"Latest: {name}",
    "Data Set 2: ": lambda name: f"Data Set 2: {name}",
    "Video Analysis: ": lambda name: f"Video Analysis: {name}",
    " Run #1": lambda name: f"{name} Run #1",
    ", Run #1": lambda name: f"{name}, Run #1",
    "Run 1: ": lambda name: f"Run 1: {name}",
}
"""What a program puts before or behind a name."""
OBJECTS = (
    ("light", "heavy"),
    ("mass A", "mass B"),
    ("ball", "weight"),
    ("A", "B"),
    ("Kugel grün", "Gewicht"),
    ("point_1", "point_2"),
)
TIMES = ("t", "time", "Time", "Zeit", "temps", "TIME", "times", "timestamp")
MISSING = ("", "NaN", "nan", "NAN", "NA", "N/A", "#N/A", "-", "--", "null", "None", "1.#QNAN")
INDICES = ("", "#", "row", "index", "Nr", "point", "unnamed in the rows alone")
ENCODINGS = ("utf-8", "utf-8-sig", "utf-16", "utf-16-be", "utf-16-le", "latin-1")
DELIMITERS = (",", ";", "\t", "|", " ")
COMMENTS = (
    ("version = pymecavideo 8.0", "lastvideo = clip.mp4", "temps en seconde, positions en mètre"),
    ("Tracker 6.1.3", "video: clip.mp4"),
    ("exported by Kinovea 2023.1", ""),
    ("t, x, y are the columns",),
)
SETTINGS = (("Frame rate [Hz]", 240.0), ("x origin [px]", 640.5), ("y origin [px]", 212.0), ("Scale [px/m]", 655.125))
"""Settings of Motion Ticker, which stand in columns of the table of points."""
IN_SI = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "s": 1.0, "ms": 1e-3}


@dataclass(frozen=True, kw_only=True)
class Form:
    """How a table is written."""

    layout: str = "wide"
    delimiter: str = ","
    decimal_comma: bool = False
    quoted: str = ""
    """"all", "names" or "" for none; numbers with a decimal comma beside comma delimiters are quoted in any case."""
    encoding: str = "utf-8"
    newline: str = "\n"
    separator_line: bool = False
    comments: tuple[str, ...] = ()
    names: str = "object_axis"
    units: str = ""
    length: str = "m"
    time: str = "s"
    around: str = ""
    objects: tuple[str, str] = ("light", "heavy")
    time_name: str = "t"
    index: str | None = None
    """Name of a column of row numbers; None: there is none."""
    time_place: int = 0
    """Number of columns of points before the time."""
    heavy_first: bool = False
    missing: str = ""
    velocities: str = ""
    """"" for none, "empty" or "filled": columns of velocities beside the positions."""
    settings: str = ""
    """"" for none, "own row" or "first row": where the values of `SETTINGS` stand."""
    number: str = "fixed"
    """"fixed" decimals, "short" without zeros at the end, or "exponent" as Tracker writes."""
    length_decimals: int = 6
    """Of a length in metres."""
    time_decimals: int = 6
    """Of a time in seconds."""
    significant: int = 0
    """Digits of every number, in exponents; 0: as the above say."""
    truncated: bool = False
    """Whether further decimals of a time are cut off and not rounded."""

    @property
    def tracks(self) -> dict[str, str]:
        """Mass -> name of its track, as one would take it from the table."""
        if self.names in NUMBERED and self.layout in (
            "wide",
            "force beside",
            "short rows",
            "second run below",
            "statistics below",
        ):
            return {"light": "2", "heavy": "1"} if self.heavy_first else {"light": "1", "heavy": "2"}
        return dict(zip(("light", "heavy"), self.objects, strict=True))

    @property
    def unstated_units(self) -> dict[str, str]:
        """What a study must say of the units, as the table does not."""
        if self.units:
            return {}
        return {kind: unit for kind, unit, usual in (("length", self.length, "m"), ("time", self.time, "s")) if unit != usual}

    @property
    def length_error(self) -> float:
        """Largest error of a length below 1 m by its rounding [m]."""
        if self.significant:
            return 0.51 * 10.0**-self.significant
        return 0.51 * 10.0 ** -min(self.length_decimals, 6) + 1e-9

    def time_text(self, t: float) -> str:
        """Write a time [s]."""
        if self.significant:
            return self._comma(f"{t / IN_SI[self.time]:.{self.significant - 1}E}")
        if self.number == "exponent" and not self.truncated and self.time_decimals >= 6:
            return self._comma(exponent_notation(t / IN_SI[self.time]))
        decimals = max(0, self.time_decimals + round(math.log10(IN_SI[self.time])))
        return self._decimals(t / IN_SI[self.time], decimals, cut=self.truncated)

    def length_text(self, v: float) -> str:
        """Write a length [m]."""
        if np.isnan(v):
            return self.missing
        if self.significant:
            return self._comma(f"{v / IN_SI[self.length]:.{self.significant - 1}E}")
        if self.number == "exponent":
            return self._comma(exponent_notation(v / IN_SI[self.length]))
        return self._decimals(v / IN_SI[self.length], max(0, self.length_decimals + round(math.log10(IN_SI[self.length]))))

    def _decimals(self, value: float, decimals: int, *, cut: bool = False) -> str:
        if cut:
            value = math.floor(value * 10**decimals + 1e-6) / 10**decimals
        text = f"{value:.{decimals}f}"
        if self.number == "short" and "." in text:
            text = text.rstrip("0").rstrip(".")
        return self._comma("0" if text == "-0" else text)

    def _comma(self, text: str) -> str:
        return text.replace(".", ",") if self.decimal_comma else text


@dataclass(frozen=True, kw_only=True)
class Block:
    """A table in the file: names, units and texts of its columns."""

    names: Sequence[str]
    units: Sequence[str]
    rows: Sequence[Sequence[str]]
    titles: Sequence[str] = ()
    """A row above the names, as Tracker has the objects'."""


def table_bytes(film: Film, form: Form, names: Sequence[str] = ()) -> bytes:
    """Return a film's table as a file.

    Parameters
    ----------
    names
        Names of the columns in place of the right ones.
    """
    lines: list[str] = []
    if form.separator_line:
        lines.append(f"sep={form.delimiter}")
    lines += [f"# {comment}" for comment in form.comments]
    for number, block in enumerate(_blocks(film, form)):
        block = dataclasses.replace(block, names=names, units=[""] * len(names)) if names else block
        lines += [""] * bool(number)
        lines += _lines(block, form)
    text = form.newline.join(lines) + form.newline
    if form.encoding in ("utf-16-be", "utf-16-le"):
        text = "\ufeff" + text
    return text.encode(form.encoding, errors="replace")


def _lines(block: Block, form: Form) -> list[str]:
    """Return the lines of a block."""
    lines = []
    if any(block.titles):
        lines.append(_joined(block.titles, form, names=True))
    if any(block.names):
        named = list(block.names)
        if not form.units.startswith("row below"):
            named = [UNIT_STYLES[form.units](n, u) if u else n for n, u in zip(named, block.units, strict=True)]
        named = [AROUND[form.around](n) if n else n for n in named]
        short = form.index == "unnamed in the rows alone"
        lines.append(_joined(named[1:] if short else named, form, names=True))
        if form.units.startswith("row below"):
            left, right = {"row below": ("", ""), "row below in brackets": "[]", "row below in parentheses": "()"}[form.units]
            lines.append(_joined([f"{left}{u}{right}" if u else "" for u in block.units], form, names=True))
    for row in block.rows:
        cells = list(row)
        if form.layout == "short rows":
            cells = [c for c in cells if c]
        lines.append(_joined(cells, form))
    return lines


def _joined(cells: Sequence[str], form: Form, *, names: bool = False) -> str:
    """Join cells by the delimiter, with quotes where they are needed or asked for."""
    everything = form.quoted == "all" or (names and form.quoted == "names")
    return form.delimiter.join(
        f'"{c}"' if everything or (form.delimiter in c and c) or (form.delimiter == " " and c == "") else c for c in cells
    )


def _blocks(film: Film, form: Form) -> list[Block]:
    order = (1, 0) if form.heavy_first else (0, 1)
    times = [form.time_text(v) for v in film.t]
    points = [[form.length_text(v) for v in row] for row in film.written]
    if form.layout == "Tracker":
        return [_tracker(form, order, times, points)]
    if form.layout.startswith("long"):
        return [_long(film, form, order, times, points)]
    if form.layout == "each object beside":
        return [_beside(film, form, order, times, points)]
    if form.layout == "each object below":
        return [_of_one(film, form, i, times, points) for i in order]
    whole = _wide(film, form, order, times, points)
    if form.layout == "force beside":
        extra = [[form._comma(f"{0.05 * k:.2f}"), form._comma("0.98")] for k in range(len(whole.rows))]
        return [
            Block(
                names=[*whole.names, "Time 2", "Force"],
                units=[*whole.units, "s", "N"],
                rows=[[*row, *more] for row, more in zip(whole.rows, extra, strict=True)],
            )
        ]
    if form.layout == "statistics below":
        mean = [form._comma("0.98"), form._comma("0.01")]
        return [whole, Block(names=["Mean", "Deviation"], units=["N", "N"], rows=[mean])]
    if form.layout == "second run below":
        half = [form.length_text(v) for v in film.written[:, 0]]
        other = [[times[k], half[k], *[form.length_text(0.5 * v) for v in film.written[k, 1:]]] for k in range(len(times))]
        second = _wide(film, form, order, times, [row[1:] for row in other])
        return [whole, second]
    if form.layout == "no names":
        rows = [[times[k], *points[k]] for k in range(len(times))]
        return [Block(names=[""] * 5, units=[""] * 5, rows=rows)]
    return [whole]


def _wide(film: Film, form: Form, order: Sequence[int], times: Sequence[str], points: Sequence[Sequence[str]]) -> Block:
    """Return one row for each time, with the columns of both objects."""
    columns: list[tuple[str, str, list[str]]] = []
    count = len(times)
    for number, i in enumerate(order, start=1):
        for j, axis in enumerate("xy"):
            name = NAMES[form.names](form.objects[i], axis, number)
            columns.append((name, form.length, [points[k][2 * i + j] for k in range(count)]))
        for j, axis in enumerate("xy" if form.velocities else ""):
            speed = np.gradient(np.nan_to_num(film.written[:, 2 * i + j]), edge_order=1)
            texts = [form._comma(f"{v:.4f}") if form.velocities == "filled" else "" for v in speed]
            columns.append((NAMES[form.names](form.objects[i], f"v{axis}", number), f"{form.length}/s", texts))
    columns.insert(form.time_place, (form.time_name, form.time, list(times)))
    if form.settings:
        texts = [form._comma(f"{value:.3f}") for _, value in SETTINGS]
        columns += [(name, "", [text] + [""] * (count - 1)) for (name, _), text in zip(SETTINGS, texts, strict=True)]
    if form.index is not None:
        columns.insert(0, (form.index, "", [str(k) for k in range(count)]))
    rows = [[texts[k] for *_, texts in columns] for k in range(count)]
    if form.settings == "own row":
        own = [""] * (len(columns) - len(SETTINGS)) + rows[0][-len(SETTINGS) :]
        rows[0] = rows[0][: -len(SETTINGS)] + [""] * len(SETTINGS)
        rows = [own, *rows]
    return Block(names=[name for name, *_ in columns], units=[unit for _, unit, _ in columns], rows=rows)


def _tracker(form: Form, order: Sequence[int], times: Sequence[str], points: Sequence[Sequence[str]]) -> Block:
    """Return the table as Tracker exports it, with the objects' names above their first columns."""
    titles = ["", *(cell for i in order for cell in (form.objects[i], "")), ""]
    rows = [[times[k], *(points[k][2 * i + j] for i in order for j in (0, 1)), ""] for k in range(len(times))]
    units = [form.time, *([form.length] * 4), ""]
    return Block(names=["t", "x", "y", "x", "y", ""], units=units, rows=rows, titles=titles)


def _long(film: Film, form: Form, order: Sequence[int], times: Sequence[str], points: Sequence[Sequence[str]]) -> Block:
    """Return one row for each object and time; an object that was not seen has no row."""
    keys = [(k, i) for k in range(len(times)) for i in order if np.isfinite(film.written[k, 2 * i : 2 * i + 2]).all()]
    if form.layout == "long by object":
        keys.sort(key=lambda key: order.index(key[1]))
    frames = _frames(film)
    with_frames = form.layout == "long with frames"
    rows = [
        [*points[k][2 * i : 2 * i + 2], form.objects[i], *([str(frames[k])] if with_frames else []), times[k]] for k, i in keys
    ]
    names = ["x", "y", "particle", *(["frame"] if with_frames else []), form.time_name]
    return Block(names=names, units=[form.length, form.length, "", *([""] if with_frames else []), form.time], rows=rows)


def _frames(film: Film) -> list[int]:
    return [round(t * film.rate) for t in np.nanmin(film.taken, axis=1)]


def _of_one(film: Film, form: Form, i: int, times: Sequence[str], points: Sequence[Sequence[str]]) -> Block:
    """Return the table of one object, without rows in which it was not seen."""
    seen = [k for k in range(len(times)) if np.isfinite(film.written[k, 2 * i : 2 * i + 2]).all()]
    return Block(
        # Under a title of its own, a table needs no numbers of objects
        names=[form.time_name, *("xy" if form.names in NUMBERED else (NAMES[form.names](form.objects[i], a, 1) for a in "xy"))],
        units=[form.time, form.length, form.length],
        rows=[[times[k], *points[k][2 * i : 2 * i + 2]] for k in seen],
        titles=[form.objects[i], "", ""] if form.names in NUMBERED else (),
    )


def _beside(film: Film, form: Form, order: Sequence[int], times: Sequence[str], points: Sequence[Sequence[str]]) -> Block:
    """Return two tables side by side, each with its own times and as many rows as its object was seen."""
    parts = [_of_one(film, form, i, times, points) for i in order]
    height = max(len(p.rows) for p in parts)
    gap = [[""]] * height
    rows = [
        [*first, *space, *second]
        for first, space, second in zip(
            *(
                [*parts[0].rows, *[[""] * 3] * (height - len(parts[0].rows))],
                gap,
                [*parts[1].rows, *[[""] * 3] * (height - len(parts[1].rows))],
            ),
            strict=True,
        )
    ]
    titles = [*parts[0].titles, "", *parts[1].titles] if parts[0].titles else ()
    return Block(
        names=[*parts[0].names, "", *parts[1].names], units=[*parts[0].units, "", *parts[1].units], rows=rows, titles=titles
    )


def as_written(film: Film, form: Form) -> tuple[Array, Array]:
    """Return the times and points that the texts of a table say, rounded as they are written."""
    t = np.array([float(form.time_text(v).replace(",", ".")) * IN_SI[form.time] for v in film.t])
    values = np.full_like(film.written, np.nan)
    known = np.isfinite(film.written)
    values[known] = [float(form.length_text(v).replace(",", ".")) * IN_SI[form.length] for v in film.written[known]]
    return t, values
