"""What the name of a column says: one table of roles, and the reading of names that programs and people write above columns.

A name has what a program puts before it ("Latest:", "Run #1"), the tracked object, the quantity, and a unit: in brackets,
behind a slash, after "in" or an underscore, or in the row below. The object may stand behind the quantity ("x1", "Y 2").
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.measured.tables.delimited import TableLine
from looping_pendulum.reference_ode.geometry import Array

ROLES = {
    "t": "t time times timestamp zeit temps tiempo tempo",
    "frame": "frame frames framenumber bild bildnummer image slice img",
    "x": "horizontal xc cx x_center x_centre center_x centre_x", "y": "vertical yc cy y_center y_centre center_y centre_y",
    "height": "height h höhe hauteur altura box_height bbox_height bb_height bbox_h box_h bb_h",
    "angle": "angle theta θ ϑ phi φ ϕ winkel azimuth", "radius": "radius r rho ρ",
    "angle_rate": "omega ω gyroscope gyroskop gyro winkelgeschwindigkeit",
    "left": "left x_min min_x bb_left bbox_left box_left xtl", "top": "top y_min min_y bb_top bbox_top box_top ytl",
    "right": "right x_max max_x bb_right bbox_right box_right xbr",
    "bottom": "bottom y_max max_y bb_bottom bbox_bottom box_bottom ybr",
    "width": "width w bb_width bbox_width box_width bbox_w box_w bb_w",
    "score": "likelihood score confidence conf probability",
}  # fmt: skip
"""What a column holds -> the words that say so, in lower case; "_" is anything that joins two. Axes x, y, z are read apart."""
WHOLE_NAMES = {
    "run": "drop run",
    "object": "particle object objekt objet track trackid tid id trajectory point marker class label",
    "setting": "framerate fps xorigin yorigin originx originy origin scale",
}
"""What a column is whose whole name says so: the number of a run, the name of an object, a setting of the program."""
CLOCK_ROLES = ("t", "frame")
BOX_ROLES = ("left", "top", "right", "bottom")
LENGTH_ROLES = ("x", "y", "z", "height", "radius", "width", *BOX_ROLES)
POSITION_ROLES = ("x", "y", "height", "angle", "angle_rate", *BOX_ROLES)
"""Roles that show where something is, or how fast it turns."""
ERROR_SUFFIX = "_error"
"""What the name of a column of standard errors has behind that of the values."""
RATE_WORDS = frozenset({"rate", "velocity", "speed", "vitesse", "geschwindigkeit", "velocidad"})
DERIVED_WORDS = RATE_WORDS | {
    "vx", "vy", "ax", "ay", "acceleration", "beschleunigung", "accélération", "force", "kraft", "energy", "momentum",
    "pixelx", "pixely", "error", "err", "sigma", "uncertainty", "std", "origin", "scale", "absolute", "step",
    "sub", "rotation", "quaternion",
}  # fmt: skip
"""Words of quantities that are computed from positions, or are none."""
FILLING_WORDS = frozenset(
    {"position", "pos", "coordinate", "coord", "center", "centre", "centroid", "axis", "video", "elapsed", "bbox", "bb", "box"}
)
"""Words that say nothing more beside a quantity."""
UNIT_WORDS = {
    "seconds": "s", "second": "s", "sekunden": "s", "secondes": "s", "milliseconds": "ms", "minutes": "min", "hours": "h",
    "days": "day", "meters": "m", "metres": "m", "meter": "m", "centimeters": "cm", "centimetres": "cm", "millimeters": "mm",
    "millimetres": "mm", "degrees": "deg", "radians": "rad",
}  # fmt: skip
"""Word for a unit, in lower case -> unit."""
TIME_UNITS = frozenset({"s", "sec", "ms", "us", "µs", "min", "h", "day"})
PIXELS = frozenset({"px", "pixel", "pixels"})
RATE_UNITS = frozenset({"rad/s", "deg/s", "°/s"})
UNITS = TIME_UNITS | PIXELS | RATE_UNITS | {
    "m", "cm", "mm", "dm", "km", "um", "µm", "in", "inch", "ft", "rad", "deg", "°", "º", "˚", "m/s", "cm/s", "mm/s", "px/s",
    "m/s^2", "m/s²", "px/m", "hz", "n", "kg", "g",
}  # fmt: skip
"""Units, in lower case, that are recognised in names without brackets."""
MAX_NAME = 200
"""Longest text that is read as a name [characters]; the time that this takes grows with its square."""
MAX_WORDS = 3
"""Largest number of words of a name whose quantity may stand anywhere in it."""
RUN = re.compile(r"[,:]?\s*\b(?:run|lauf|essai|série)\s*#?\s*([0-9]+)\b\s*[,:]?", re.IGNORECASE)
_ROLE_OF_WORD = {word.replace("_", ""): role for role, words in ROLES.items() for word in words.split()}
_ROLE_OF_NAME = {word: role for role, words in WHOLE_NAMES.items() for word in words.split()}
_NUMBERING = frozenset({"id", "idx", "index", "number", "nr", "no", "n°", "nº", "#", ""})
# "time (hh:mm:ss)" is read in seconds
_CLOCK_UNIT = re.compile(r"\s*[\[(]h*:?m+:s+[^\])]*[\])]", re.IGNORECASE)
_AXIS = re.compile(r"(?:(.*?)[ _./-]+)?([xyz])(?:[ _]?([0-9]+)|[ _./-]+(.*))?", re.IGNORECASE)
# pandas writes the names of several lines so where it writes one
_TUPLE = re.compile(r"\('[^']*'(?:, '[^']*')*\)")
# "lightX", "lightx"
_BEFORE_JOINED_AXIS = re.compile(r"(?<=[a-z0-9])(?=[XYZ]$)|(?<=light|heavy)(?=[xyz]$)")
_BETWEEN_WORDS = re.compile(r"[\s_./-]+")
# The last words of a name, with what stands before them: "light bb_left" is an edge of light's box, "r2" the radius of 2
_LAST_ROLES = ("height", "angle", "radius", "width", "score", *BOX_ROLES)
_LAST_WORDS = sorted((word for role in _LAST_ROLES for word in ROLES[role].split()), key=len, reverse=True)
_ANY_LAST = "|".join(_LAST_WORDS).replace("_", "[ _./-]*")
_LAST = re.compile(rf"(?:(.*?)[\s_./-]+)?({_ANY_LAST})[\s_./-]*([0-9]*)\W*", re.IGNORECASE)
_UNIT_NAMES = "|".join(map(re.escape, sorted(UNITS, key=len, reverse=True)))
# "x [cm]", "x (cm)"; "x/cm", "x in cm", "x, cm"; "x_cm"
_UNIT = re.compile(
    rf"(.*?)[\s/]*[\[(]([^\[\]()]*)[\])]|(.+?)\s*(?:/| in |,)\s*((?i:{_UNIT_NAMES}))"
    r"|(.*?)_(s|ms|m|cm|mm|rad|deg|m_per_s|rad_per_s)"
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Column:
    """Quantity, track and unit of one column, with the rows that it stands in and its numbers."""

    index: int = 0
    label: str = ""
    """Name for messages, track included: "x (mass A)"."""
    role: str = ""
    """A key of `ROLES` or `WHOLE_NAMES`, an axis, or one of these and `ERROR_SUFFIX`; '' if none."""
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
    value: Array = field(default_factory=lambda: np.empty(0))
    """Values in the file's unit, shape (n,); not a number: none."""
    digit: float = 0.0
    """What one unit of the values' last digit is worth, in the file's unit; 0: it is that of its cells, or not known."""
    factor: float = 1.0
    """The file's unit [SI]."""
    error: Array | None = None
    """Standard error that the file states of each value [SI], shape (n,); 0: none."""

    @property
    def has_values(self) -> NDArray[np.bool_]:
        """Return in which rows it has a value, shape (n,)."""
        return np.asarray(np.isfinite(self.value))

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
        return self.role in LENGTH_ROLES


@lru_cache(maxsize=10_000)
def read_name(cell: str) -> Column:
    """Split the name of a column: "Latest: light x [cm], Run #2" -> x of light in cm, run 2.

    Its label is what is left without unit, run and program, in lower case.
    """
    if len(cell) > MAX_NAME:
        return Column(label=cell)
    if _TUPLE.fullmatch(cell):
        cell = " ".join(re.findall(r"'([^']*)'", cell))
    run = RUN.search(cell)
    group, _, text = _CLOCK_UNIT.sub("", RUN.sub("", cell)).rpartition(":")
    unit_match = _UNIT.fullmatch(text.strip())
    text, unit = (part for part in unit_match.groups() if part is not None) if unit_match else (text.strip(), "")
    unit = unit.strip().replace("_per_", "/")
    name = Column(label=text.lower(), unit=UNIT_WORDS.get(unit.lower(), unit), run=run[1] if run else "", group=group.strip())
    words = [word.strip("#") for word in _BETWEEN_WORDS.split(text) if word]
    tokens = [word.lower() for word in words]
    whole = _ROLE_OF_NAME.get("".join(t for t in tokens if t not in _NUMBERING) or name.label)
    if whole:
        return replace(name, role=whole)
    axis = _AXIS.fullmatch(_BEFORE_JOINED_AXIS.sub(" ", text))
    said = [role for t in tokens if (role := _ROLE_OF_WORD.get(t))]
    is_rate = "angle_rate" in said or (("angle" in said or "angular" in tokens) and bool(RATE_WORDS & set(tokens)))
    if is_rate or (axis and unit.lower() in RATE_UNITS):
        return replace(name, role="angle_rate", axis=axis[2].lower() if axis else "")
    # "light_x_error" beside "light_x", as `track` writes them
    if text.lower().endswith(ERROR_SUFFIX) and (of := read_name(text[: -len(ERROR_SUFFIX)])).is_position:
        return replace(name, role=of.role + ERROR_SUFFIX, track=of.track)
    # "v x" is a velocity, "A x" the object A
    is_derived = DERIVED_WORDS & set(tokens) or ({"v", "a"} & set(_BETWEEN_WORDS.split(text)) and len(tokens) <= 2)
    if is_derived or ("/" in unit and unit.lower() in UNITS):
        return name
    last = _LAST.fullmatch(text)
    # A long s matches an s, but is no lower case of one
    role = _ROLE_OF_WORD.get(_BETWEEN_WORDS.sub("", last[2].lower()), "") if last else ""
    if last and (role in ("angle", "radius") or (role and not last[3])):
        return replace(name, role=role, track=without_filling(last[1] or "") or last[3])
    if axis:
        track = " ".join(filter(None, (without_filling(axis[1] or ""), without_filling(axis[4] or ""), axis[3])))
        return replace(name, role=axis[2].lower(), track=track)
    return replace(name, role=said[0] if said and len(tokens) <= MAX_WORDS and said[0] != "score" else "")


def without_filling(text: str) -> str:
    """Return an object's name without words such as "position"; nothing else of it is changed."""
    if not FILLING_WORDS & set(_BETWEEN_WORDS.split(text.lower())):
        return text
    return " ".join(t for t in re.split(r"[\s_]+", text) if t.lower() not in FILLING_WORDS)


def bare_unit(cell: str) -> str:
    """Return a unit without its brackets."""
    return cell.strip("[]() ")
