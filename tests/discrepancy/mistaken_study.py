"""Make a study wrong as its author would: by a mistake of filming, in the files, or by one of declaration, in the study."""

import copy
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from looping_pendulum.scenarios.units import to_si

Row = list[float | None]
"""Time, x and y of the light mass, x and y of the heavy one; None: not tracked."""
Tree = dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class Mistake:
    """A mistake and the keys that mend it."""

    keys: frozenset[str]
    """Top-level keys of the trial or of the apparatus that a message must name."""
    row: Callable[[Row], Row] = lambda row: row
    """What it does to a row of a tracked file."""
    study: Callable[[Tree], None] = lambda tree: None
    """What it does to the tree of a study file."""


def _scaled(factor: float, *columns: int) -> Callable[[Row], Row]:
    return lambda row: [v if v is None or i not in columns else factor * v for i, v in enumerate(row)]


def pictured(change: Callable[[float, float], tuple[float, float]]) -> Callable[[Row], Row]:
    """Return what a picture that shows (x, y) elsewhere does to the points of both masses."""

    def edit(row: Row) -> Row:
        edited: Row = row[:1]
        for x, y in (row[1:3], row[3:5]):
            edited += (None, None) if x is None or y is None else change(x, y)
        return edited

    return edit


SYMMETRIES = {
    "mirrored": (lambda x, y: (-x, y), "mirrored: true"),
    "y downwards": (lambda x, y: (x, -y), "mirrored: true' and 'camera: {tilt: 180 deg}"),
    "half a turn": (lambda x, y: (-x, -y), "camera: {tilt: 180 deg}"),
    "a quarter turn to the left": (lambda x, y: (-y, x), "camera: {tilt: 90 deg}"),
    "a quarter turn to the right": (lambda x, y: (y, -x), "camera: {tilt: -90 deg}"),
    "x and y exchanged": (lambda x, y: (y, x), "mirrored: true' and 'camera: {tilt: 90 deg}"),
    "x and y exchanged and reversed": (lambda x, y: (-y, -x), "mirrored: true' and 'camera: {tilt: -90 deg}"),
}
"""All symmetries of the square but the identity, each with the keys that undo it."""


def _every_value(group: str, key: str, change: Callable[[str], str]) -> Callable[[Tree], None]:
    """Change a value in the apparatus and in every trial that states it."""

    def edit(tree: Tree) -> None:
        for place in (tree["apparatus"], *tree["trials"]):
            if key in place.get(group, {}):
                place[group][key] = change(place[group][key])

    return edit


def _angle(change: Callable[[float], float]) -> Callable[[Tree], None]:
    def in_degrees(text: str) -> str:
        degrees = math.degrees(to_si(text.partition("+/-")[0], "rad"))
        return f"{change(degrees)} deg +/- 0.5 deg"

    return _every_value("release", "angle", in_degrees)


def _exchange_masses(tree: Tree) -> None:
    light, heavy = (tree["apparatus"].get(mass, {}).get("mass") for mass in ("light", "heavy"))
    for trial in tree["trials"]:
        own_light, own_heavy = (trial.get(mass, {}).get("mass", known) for mass, known in (("light", light), ("heavy", heavy)))
        trial["light"], trial["heavy"] = {"mass": own_heavy}, {"mass": own_light}


def _exchange_tracks(tree: Tree) -> None:
    for trial in tree["trials"]:
        trial["tracks"] = {"light": trial["tracks"]["heavy"], "heavy": trial["tracks"]["light"]}


def _exchange_all(tree: Tree) -> None:
    _exchange_masses(tree)
    _exchange_tracks(tree)


def _in_kg(tree: Tree) -> None:
    for mass in ("light", "heavy"):
        _every_value(mass, "mass", _thousandfold)(tree)


def _thousandfold(text: str) -> str:
    return f"{1e3 * to_si(text.partition('+/-')[0], 'kg')} kg +/- 0.5 %"


def _a_tenth(text: str) -> str:
    return f"{0.1 * to_si(text.partition('+/-')[0], 'kg')} kg +/- 0.5 %"


def _another_length(metres: float) -> Callable[[Tree], None]:
    return _every_value("release", "free_length", lambda _: f"{metres} m +/- 1 mm")


def _diameter(text: str) -> str:
    return f"{2e3 * to_si(text.partition('+/-')[0], 'm')} mm +/- 1 %"


MISTAKES = {
    "30 for 240 frames a second": Mistake(keys=frozenset({"frame_rate"}), row=_scaled(8, 0)),
    "mirrored": Mistake(keys=frozenset({"mirrored"}), row=_scaled(-1, 1, 3)),
    "tracks exchanged": Mistake(keys=frozenset({"tracks"}), study=_exchange_tracks),
    "masses exchanged": Mistake(keys=frozenset({"light", "heavy"}), study=_exchange_masses),
    "pixels": Mistake(keys=frozenset({"units"}), row=_scaled(700, 1, 2, 3, 4)),
    "radians as degrees": Mistake(keys=frozenset({"release"}), study=_angle(math.radians)),
    "angle from straight down": Mistake(keys=frozenset({"release"}), study=_angle(lambda degrees: 180 - degrees)),
    "diameter": Mistake(keys=frozenset({"rod"}), study=_every_value("rod", "radius", _diameter)),
    "grams as kilograms": Mistake(keys=frozenset({"light", "heavy"}), study=_in_kg),
    "light and heavy exchanged": Mistake(keys=frozenset({"light", "heavy", "tracks"}), study=_exchange_all),
}
"""Five mistakes of filming, then five of declaration."""
FURTHER = {
    # 700 pixels a metre, the picture's corner the origin
    "pixels, y downwards": Mistake(
        keys=frozenset({"units", "mirrored", "camera"}), row=pictured(lambda x, y: (900 + 700 * x, 900 - 700 * y))
    ),
    "pixels of a film on its side": Mistake(
        keys=frozenset({"units", "camera"}), row=pictured(lambda x, y: (900 - 700 * y, 400 + 700 * x))
    ),
    "centimetres": Mistake(keys=frozenset({"units"}), row=_scaled(100, 1, 2, 3, 4)),
    "30 for 240 and mirrored": Mistake(
        keys=frozenset({"frame_rate", "mirrored"}), row=lambda row: _scaled(8, 0)(_scaled(-1, 1, 3)(row))
    ),
    "origin": Mistake(
        keys=frozenset({"camera"}), row=lambda row: [row[0], *(None if v is None else v + 0.5 for v in row[1:])]
    ),
    "light mass in kilograms": Mistake(keys=frozenset({"light"}), study=_every_value("light", "mass", _thousandfold)),
    "a tenth of the heavy mass": Mistake(keys=frozenset({"heavy"}), study=_every_value("heavy", "mass", _a_tenth)),
    "angle from the horizontal": Mistake(keys=frozenset({"release"}), study=_angle(lambda degrees: degrees - 90)),
    "length and angle of another trial": Mistake(
        keys=frozenset({"release"}),
        study=lambda tree: (_another_length(0.9)(tree), _angle(lambda degrees: degrees - 25)(tree)),
    ),
    "a tenth of the length": Mistake(keys=frozenset({"release"}), study=_another_length(0.05)),
    "angle on the other side": Mistake(keys=frozenset({"release"}), study=_angle(lambda degrees: 360 - degrees)),
}  # fmt: skip


def mistaken(study: Path, folder: Path, mistake: Mistake, *, trials: int | None = None) -> Path:
    """Write a study and its files with a mistake into ``folder``; only its first ``trials``, if their number is given."""
    tree = yaml.safe_load(study.read_text(encoding="utf-8"))
    tree["trials"] = tree["trials"][:trials]
    for trial in tree["trials"]:
        target = folder / trial["file"]
        target.parent.mkdir(parents=True, exist_ok=True)
        lines = (study.parent / trial["file"]).read_text(encoding="utf-8").splitlines()
        target.write_text("\n".join(changed(line, mistake) for line in lines) + "\n", encoding="utf-8")
    tree = copy.deepcopy(tree)  # YAML's aliases are one object, which would be changed twice
    mistake.study(tree)
    path = folder / "study.yaml"
    path.write_text(yaml.safe_dump(tree, sort_keys=False), encoding="utf-8")
    return path


def changed(line: str, mistake: Mistake) -> str:
    if not line[:1].isdigit():
        return line
    row = [float(cell) if cell.strip() else None for cell in line.split(",")[:5]]
    return ",".join("" if v is None else f"{v:.6E}" for v in mistake.row(row)) + ","


def mended(study: Path, keys: str) -> Path:
    """Put the keys that a message names into the apparatus or into every trial of a study; return its path."""
    tree = yaml.safe_load(study.read_text(encoding="utf-8"))
    for text in keys.split("' and '"):
        ((key, value),) = yaml.safe_load(text).items()
        for place in (tree["apparatus"],) if key == "rod" else tree["trials"]:
            place[key] = {**place.get(key, {}), **value} if isinstance(value, dict) else value
    path = study.with_name("mended.yaml")
    path.write_text(yaml.safe_dump(tree, sort_keys=False), encoding="utf-8")
    return path


def named_keys(keys: str) -> frozenset[str]:
    """Return the top-level keys that a message names."""
    return frozenset(text.partition(":")[0] for text in keys.split("' and '"))
