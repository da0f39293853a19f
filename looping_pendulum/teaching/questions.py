"""The questions of `new`, as data: their order, their texts and the usual range of the answers.

Unit and bounds of each key are those of the scenario file's schema.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from pydantic_core import PydanticCustomError

from looping_pendulum.errors import HarnessError
from looping_pendulum.measured.study_fields import MeasuredField
from looping_pendulum.reference_ode import effects as effect_library
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios.fields import QuantityField
from looping_pendulum.scenarios.scenario import FILE_KEYS
from looping_pendulum.scenarios.units import QuantityKind, show


class AnswerError(HarnessError, ValueError):
    """An answer cannot be used; the message says what was found, what was needed and an example."""

    def __init__(self, message: str, *, keys: tuple[str, ...] = ()) -> None:
        super().__init__(message)
        self.keys = keys
        """Keys of the questions, or groups of questions, that have to be asked again; empty: all, or the one being asked."""


Check = Callable[[str], str]
"""Takes an answer; returns a warning to be shown, or nothing; raises `AnswerError` if it cannot be used."""
Ask = Callable[[str, str, Check], str]
"""Called with a question, its default and its check; returns an answer that passes."""


@dataclass(frozen=True, kw_only=True)
class Question:
    """A question for one quantity of a scenario or study."""

    key: str
    """Key of the quantity in the file, "light.mass"."""
    text: str
    """Text of the question."""
    unit: str
    """SI unit; '' for a plain number."""
    usual: tuple[float, float]
    """Range of apparatus that fits on a table at school or at home [SI]; outside it there is a warning, not an error."""
    positive: bool = True
    """Whether the value must be above 0; otherwise 0 is allowed."""
    maximum: float = float("inf")
    """Largest value that the file allows [SI]."""

    def check(self, answer: str) -> str:
        """Read an answer such as "12 g"; return a warning if it is unusual.

        Raises
        ------
        AnswerError
            If it is no quantity of this kind.
        """
        return self._warning_if_unusual(read(QuantityField(self._kind), answer))

    def check_measured(self, answer: str) -> str:
        """Read an answer such as "12 g +/- 1 %"; return a warning if it is unusual, or has no error.

        Raises
        ------
        AnswerError
            If it is no such quantity.
        """
        try:
            estimate = MeasuredField(self._kind, start=None).estimate(answer)
        except PydanticCustomError as error:
            raise AnswerError(str(error)) from None
        exact = "" if estimate.uncertain else "taken as exact, as no error was given; write for example '+/- 1 %' behind it"
        return "; ".join(filter(None, (self._warning_if_unusual(estimate.value), exact)))

    @property
    def _kind(self) -> QuantityKind:
        return QuantityKind(unit=self.unit, low=0.0, high=self.maximum, exclusive_low=self.positive)

    def _warning_if_unusual(self, value: float) -> str:
        low, high = self.usual
        if low <= value <= high:
            return ""
        return f"unusual: most are between {show(low, self.unit)} and {show(high, self.unit)}; is the unit right?"


def read(quantity: QuantityField, answer: str) -> float:
    """Return the value [SI] of an answer.

    Raises
    ------
    AnswerError
        If it is no quantity of this kind.
    """
    try:
        return quantity.read(answer)
    except PydanticCustomError as error:
        raise AnswerError(str(error)) from None


def _coefficient(name: str, text: str, usual: tuple[float, float]) -> Question:
    c = effect_library.COEFFICIENTS[name]
    return Question(key=FILE_KEYS[name], text=text, unit=c.unit, usual=usual, positive=False, maximum=c.bounds[1])


_DEGREE = 0.017453292519943295
QUESTIONS: Mapping[str, Question] = MappingProxyType(
    {
        q.key: q
        for q in (
            Question(key="light.mass", text="Light mass M1, which loops around the rod", unit="kg", usual=(1e-3, 0.2)),
            Question(key="heavy.mass", text="Heavy mass M2, which falls", unit="kg", usual=(5e-3, 2.0)),
            Question(key="rod.radius", text="Radius of the rod (half its diameter)", unit="m", usual=(5e-4, 0.05)),
            _coefficient("kinetic_friction", "Friction coefficient of the string on the rod", (0.05, 1.0)),
            _coefficient("static_friction", "Friction coefficient of the string before it slides", (0.05, 1.5)),
            _coefficient("light_drag", "Air drag of the light mass (C rho A / 2)", (0.0, 0.01)),
            _coefficient("heavy_drag", "Air drag of the heavy mass", (0.0, 0.02)),
            _coefficient("string_drag", "Air drag of the string, per length", (0.0, 0.01)),
            Question(
                key="release.angle",
                text="Angle of the string at release (90 deg is level, 180 deg straight down)",
                unit="rad",
                usual=(30 * _DEGREE, 150 * _DEGREE),
                maximum=360 * _DEGREE,
            ),
            Question(key="release.free_length", text="String from the rod to the light mass", unit="m", usual=(0.1, 3.0)),
            Question(key="release.hanging_length", text="String from the rod to the heavy mass", unit="m", usual=(5e-3, 1.0)),
            Question(key="duration", text="How long to watch", unit="s", usual=(0.2, 10.0), maximum=3600.0),
        )
    }
)
"""Key of a scenario file -> its question, in the order of asking."""

RELEASES = {
    Release.LOOPING.value: "the demonstration: both free",
    Release.VERTICAL.value: "both hang, the heavy one falls",
    Release.HELD.value: "the heavy one is held, the light one swings",
    Release.DROP.value: "no string, both fall",
}
"""Kind of release -> its description."""


def check_release(answer: str) -> str:
    """Check a kind of release.

    Raises
    ------
    AnswerError
        If there is no such kind.
    """
    if answer not in RELEASES:
        raise AnswerError(f"expected one of {', '.join(RELEASES)}, got '{answer}'")
    return ""


def check_text(answer: str) -> str:
    """Check that an answer is a text of one line.

    Raises
    ------
    AnswerError
        If it is empty or has unprintable characters.
    """
    if not answer.strip() or not answer.isprintable():
        raise AnswerError("expected a few words on one line, got nothing readable")
    return ""
