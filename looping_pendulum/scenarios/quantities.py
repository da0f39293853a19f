"""The quantities of an apparatus, of its release and of a record: all that is known about each, in one table.

Schemas of scenarios and studies, maps, files that `new` writes, the plausibility check, docs/keys.md and the live page (its
sliders, its fit and the files that it writes, by way of model.js) take what they need from here. Unit, bounds and meaning of an
effect's coefficient are those of the library of effects; errors of the camera are in `measured.camera.CAMERA`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from looping_pendulum.reference_ode import effects as effect_library
from looping_pendulum.reference_ode.effects import Coefficient
from looping_pendulum.scenarios.units import QuantityKind

_DEGREE = math.radians(1.0)


@dataclass(frozen=True, kw_only=True)
class Slider:
    """Range of a quantity on the live page, in the unit in which the page shows it."""

    unit: str
    """Shown unit, "g/m^2"; '' for a plain number."""
    low: float
    high: float
    step: float


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """One quantity that files or the live page may set."""

    name: str
    """Name of the parameter or coefficient, "rod_radius"."""
    key: str
    """Key in a scenario file, and in a study beside ``effects``: "rod.radius"."""
    kind: QuantityKind
    """SI unit, bounds and example."""
    meaning: str
    """What it is, as a sentence without its full stop."""
    required: bool = False
    """Whether a scenario must give it."""
    if_absent: str = ""
    """What a scenario takes without it, "3 cm if not given"."""
    if_absent_in_study: str = ""
    """What a study takes without it, if that is something else."""
    usual: tuple[float, float] = (-math.inf, math.inf)
    """Range of apparatus that is built [SI]; outside it there is a warning, not an error."""
    usual_error: str = ""
    """Usual standard error, as measured with a kitchen scale, a ruler and a protractor."""
    free_start: float | None = None
    """Initial value of a free coefficient [SI], in the order of magnitude that the paper prints; None: its default."""
    slider: Slider | None = None
    """Its slider on the live page, if it has one."""

    @property
    def group(self) -> str:
        """Return the group of its key, "rod"; '' for a key of the file itself."""
        return self.key.rpartition(".")[0]

    @property
    def last_key(self) -> str:
        """Return its key in that group, "radius"."""
        return self.key.rpartition(".")[2]

    @property
    def measured_example(self) -> str:
        """Return an example with a standard error, "58 cm +/- 1 mm"."""
        return f"{self.kind.example_text} +/- {self.usual_error}"

    def description(self, *, in_study: bool = False) -> str:
        """Return its meaning, and what a file without it means, as a sentence."""
        absent = (in_study and self.if_absent_in_study) or self.if_absent
        return f"{self.meaning}{'; ' if absent else ''}{absent}."


def quantity_kind(c: Coefficient, example: str = "") -> QuantityKind:
    """Return the kind of a coefficient's values: its unit, its bounds, and an ``example`` for messages."""
    return QuantityKind(unit=c.unit, low=c.bounds[0], high=c.bounds[1], example=example)


def _positive(unit: str, example: str = "", high: float = math.inf) -> QuantityKind:
    return QuantityKind(unit=unit, low=0.0, high=high, exclusive_low=True, example=example)


def _coefficient(name: str, key: str = "", **known: Any) -> Quantity:
    """Return the row of an effect's coefficient; without a ``key`` it stands under ``effects``."""
    c = effect_library.COEFFICIENTS[name]
    meaning = c.meaning[0].upper() + c.meaning[1:]
    return Quantity(name=name, key=key or f"effects.{name}", kind=quantity_kind(c), meaning=meaning, **known)


_APPARATUS = (
    # Usual masses: from a tenth of a gram to what a hand lets go without danger
    Quantity(
        name="light_mass", key="light.mass", kind=_positive("kg"), meaning="Its mass M1", required=True,
        usual=(1e-4, 1.0), usual_error="0.5 %",
        slider=Slider(unit="g", low=1, high=100, step=1),
    ),
    Quantity(
        name="light_radius", key="light.radius", kind=QuantityKind(unit="m", low=0.0, example="5 mm"),
        meaning="Its radius: the run ends when its surface touches the rod", if_absent="a point if not given",
        usual_error="0.1 mm", slider=Slider(unit="mm", low=0, high=20, step=0.5),
    ),
    Quantity(
        name="heavy_mass", key="heavy.mass", kind=_positive("kg", "100 g"), meaning="Its mass M2", required=True,
        usual=(1e-3, 10.0), usual_error="0.5 %",
    ),
    # From a knitting needle to a drainpipe
    Quantity(
        name="rod_radius", key="rod.radius", kind=_positive("m"), meaning="Its radius R: half the diameter", required=True,
        usual=(2e-4, 0.1), usual_error="1 %",
        slider=Slider(unit="mm", low=1, high=40, step=0.25),
    ),
)  # fmt: skip
_BASE_COEFFICIENTS = (
    _coefficient(
        "kinetic_friction", "string.kinetic_friction",
        usual=(0.05, 1.0), free_start=0.3, slider=Slider(unit="", low=0, high=1, step=0.01),
    ),
    _coefficient(
        "static_friction", "string.static_friction",
        usual=(0.05, 1.5), free_start=0.3, slider=Slider(unit="", low=0, high=1, step=0.01),
    ),
    _coefficient(
        "light_drag", "light.drag", usual=(0.0, 0.01), free_start=1e-3,
        slider=Slider(unit="g/m", low=0, high=5, step=0.05),
    ),
    _coefficient(
        "heavy_drag", "heavy.drag", usual=(0.0, 0.02), free_start=1e-3,
        slider=Slider(unit="g/m", low=0, high=5, step=0.05),
    ),
    _coefficient(
        "string_drag", "string.drag", usual=(0.0, 0.01), free_start=1e-3,
        slider=Slider(unit="g/m^2", low=0, high=10, step=0.05),
    ),
    _coefficient(
        "gravity", "gravity", if_absent="9.81 m/s^2 if not given", slider=Slider(unit="m/s^2", low=1, high=25, step=0.01)
    ),
)  # fmt: skip
_RELEASE = (
    Quantity(
        name="release_angle", key="release.angle", kind=_positive("rad", high=2 * math.pi),
        meaning="Angle of the string to the light mass: 0 deg is straight up, 90 deg is level, 180 deg is straight down",
       
        usual=(30 * _DEGREE, 150 * _DEGREE), usual_error="0.5 deg", slider=Slider(unit="deg", low=5, high=175, step=1),
    ),
    # From a palm's length to a stairwell's height
    Quantity(
        name="free_length", key="release.free_length", kind=_positive("m", "58 cm"), required=True,
        meaning="String from the rod to the light mass",
        usual=(0.03, 5.0), usual_error="1 mm", slider=Slider(unit="cm", low=10, high=150, step=1),
    ),
    Quantity(
        name="hanging_length", key="release.hanging_length", kind=_positive("m", "3 cm"),
        meaning="String from the rod to the heavy mass", if_absent="3 cm if not given",
        if_absent_in_study="fitted if not given",
        usual=(5e-3, 1.0), usual_error="1 mm",
        slider=Slider(unit="cm", low=1, high=30, step=0.5),
    ),
)  # fmt: skip
_FURTHER = (
    _coefficient("light_linear_drag", slider=Slider(unit="g/s", low=0, high=10, step=0.1)),
    _coefficient("heavy_linear_drag", slider=Slider(unit="g/s", low=0, high=10, step=0.1)),
    _coefficient("wind_speed", slider=Slider(unit="m/s", low=-3, high=3, step=0.1)),
    _coefficient("side_force", slider=Slider(unit="mN", low=-20, high=20, step=0.5)),
    _coefficient("push_across", slider=Slider(unit="m/s", low=-3, high=3, step=0.05)),
    _coefficient("push_along", slider=Slider(unit="m/s", low=-3, high=3, step=0.05)),
    # An hour, far beyond any trial, so that a typing error does not keep an engine busy for days
    Quantity(
        name="duration", key="duration", kind=_positive("s", "1.05 s", high=3600.0), required=True,
        meaning="How long to watch; a run ends sooner if the light mass reaches the rod",
        usual=(0.2, 10.0),
    ),
    Quantity(
        name="mass_ratio", key="", kind=_positive("", "2.5"), meaning="Heavy over light mass M2/M1, the light one kept",
        slider=Slider(unit="", low=1, high=20, step=0.1),
    ),
    Quantity(name="frame_rate", key="", kind=_positive("Hz", "240 Hz"), meaning="True frame rate of the camera"),
)  # fmt: skip

QUANTITIES = MappingProxyType({q.name: q for q in (*_APPARATUS, *_BASE_COEFFICIENTS, *_RELEASE, *_FURTHER)})
"""Quantity by name, in the order of a scenario file."""
APPARATUS = tuple(q.name for q in _APPARATUS)
"""Parameters of the apparatus."""
FILE_KEYS = MappingProxyType(
    {q.name: q.key for q in (*_APPARATUS, *_BASE_COEFFICIENTS)}
    | {"release": "release.kind"}
    | {q.name: q.key for q in _RELEASE}
)
"""Name of a parameter or coefficient -> where a scenario file writes it; any other coefficient stands under ``effects``."""


def file_key(parameter: str) -> str:
    """Return the key of a parameter or coefficient in a scenario file: "release_angle" -> "release.angle"."""
    return FILE_KEYS.get(parameter, f"effects.{parameter}")


def group_of(group: str) -> tuple[Quantity, ...]:
    """Return the quantities whose keys stand in a group of a scenario file."""
    return tuple(q for q in QUANTITIES.values() if q.group == group)
