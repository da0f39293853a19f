"""The questions of `new`, and the checks of their answers; `scenarios.quantities` has texts, units, bounds and usual ranges."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from pydantic_core import PydanticCustomError

from looping_pendulum.errors import HarnessError
from looping_pendulum.measured.study_file import MeasuredField
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios.fields import QuantityField
from looping_pendulum.scenarios.quantities import QUANTITIES, Quantity
from looping_pendulum.scenarios.units import show


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


QUESTIONS: Mapping[str, Quantity] = MappingProxyType({q.key: q for q in QUANTITIES.values() if q.question})
"""Key of a scenario file -> the quantity that is asked for, in the order of asking."""


def check_quantity(q: Quantity) -> Check:
    """Return a function that reads an answer such as "12 g", and returns a warning if it is unusual.

    It raises `AnswerError` if it is no quantity of this kind.
    """
    return lambda answer: _warning_if_unusual(q, read(QuantityField(q.kind), answer))


def check_measured(q: Quantity) -> Check:
    """Return a function that reads an answer such as "12 g +/- 1 %", and returns a warning if it is unusual, or has no error.

    It raises `AnswerError` if it is no such quantity.
    """

    def check(answer: str) -> str:
        try:
            estimate = MeasuredField(q.kind).estimate(answer)
        except PydanticCustomError as error:
            raise AnswerError(str(error)) from None
        exact = "" if estimate.uncertain else "taken as exact, as no error was given; write for example '+/- 1 %' behind it"
        return "; ".join(filter(None, (_warning_if_unusual(q, estimate.value), exact)))

    return check


def _warning_if_unusual(q: Quantity, value: float) -> str:
    low, high = q.usual
    if low <= value <= high:
        return ""
    return f"unusual: most are between {show(low, q.kind.unit)} and {show(high, q.kind.unit)}; is the unit right?"


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
