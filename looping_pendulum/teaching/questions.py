"""The questions of `new`, as data, and their answers: asked once, checked as they come, kept when another is asked again.

Unit and bounds of each key are those of the scenario file's schema.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, TypeVar

import yaml
from pydantic_core import PydanticCustomError

from looping_pendulum.errors import FileKeyError, HarnessError
from looping_pendulum.measured.study_file import MeasuredField
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios.fields import QuantityField
from looping_pendulum.scenarios.quantities import QUANTITIES, Quantity
from looping_pendulum.scenarios.units import show

Tree = dict[str, Any]
"""Content of a YAML file, or a group in it."""
T = TypeVar("T")


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


class Answers:
    """Asks for answers, except for those that were given beforehand, which are checked in the same way.

    Parameters
    ----------
    ask
        How to ask; see `Ask`.
    given
        Key of a question -> answer, which is then not asked: "light.mass" -> "12 g".
    tell
        Called with a line for the user, such as what a file says of itself.
    asks_again
        Whether a fault leads back to its question; otherwise it is raised.
    """

    def __init__(
        self, ask: Ask, given: Mapping[str, str], *, tell: Callable[[str], None] = lambda line: None, asks_again: bool = False
    ) -> None:
        self._ask = ask
        self._given = dict(given)
        self._tell = tell
        self._told: set[str] = set()
        self._asks_again = asks_again
        self._former: dict[str, str] = {}
        """Key -> answer that has to be asked again, and is then the default."""
        self.known: dict[str, str] = {}
        """Key -> answer that passed its check."""
        self.asked: list[str] = []
        """Keys of the questions that were asked, as no answer was given beforehand."""

    def __call__(self, key: str, words: str, default: str, check: Check) -> str:
        """Return the answer to a question, which is asked if it is not known."""
        if key in self.known:
            return self.known[key]
        answer = self.optional(key, check)
        if answer is None:
            answer = self._ask(words, self._former.get(key, default), check)
            self.asked.append(key)
        self.known[key] = answer
        return answer

    def optional(self, key: str, check: Check) -> str | None:
        """Return an answer that was given beforehand, to a question that is not asked; None if it was not given."""
        if key in self.known:
            return self.known[key]
        if key not in self._given:
            return None
        try:
            check(self._given[key])
        except AnswerError as error:
            fault = AnswerError(f"--set {key}: {error}", keys=(key,))
            if not self._asks_again:
                raise fault from None
            self._tell(f"  {fault}")
            del self._given[key]
            return None
        self.known[key] = self._given.pop(key)
        return self.known[key]

    @property
    def unused(self) -> dict[str, str]:
        """Return the answers that were given beforehand and belong to no question so far."""
        return self._given

    @property
    def so_far(self) -> dict[str, str]:
        """Return all answers, those that were to be asked again among them."""
        return self._former | self._given | self.known

    def tell(self, line: str) -> None:
        """Show a line to the user, once."""
        if line not in self._told:
            self._told.add(line)
            self._tell(line)

    def write(self, make: Callable[[Answers], T]) -> T:
        """Return what ``make`` makes of the answers; a fault in these leads back to the questions that it is about.

        Raises
        ------
        AnswerError, FileKeyError
            A fault, where it does not lead back, or is the same after the same answers: it lies elsewhere, as in a file.
        """
        last: tuple[str, dict[str, str]] | None = None
        while True:
            try:
                return make(self)
            except (AnswerError, FileKeyError) as error:
                keys = error.keys if isinstance(error, AnswerError) else question_keys(error.path)
                before, last = last, (str(error), self.known | self._given)
                if last == before or not (self._asks_again and self._forget(keys)):
                    raise
                self._tell(f"  {error}")

    def _forget(self, keys: tuple[str, ...]) -> bool:
        """Have the questions asked again whose key is among ``keys`` or in one of these groups; without keys, have all.

        Returns whether there is anything to ask again. The answers so far are then the defaults.
        """
        have = self.known | self._given
        at_fault = [key for key in have if any(key == k or key.startswith(f"{k}.") for k in keys)] if keys else list(self.known)
        for key in at_fault:
            self._former[key] = have[key]
            self.known.pop(key, None)
            self._given.pop(key, None)
        return bool(at_fault)


def question_keys(path: tuple[str | int, ...]) -> tuple[str, ...]:
    """Return the keys of the questions about a place in a scenario or a study.

    ("trials", 0, "release", "angle") is asked as "trials.1.release.angle", and ("apparatus", "rod") as "rod".
    """
    if path[:1] == ("trials",) and len(path) > 1:
        trial = f"trials.{int(path[1]) + 1}"
        if path[2:] in (("name",), ("file",)):
            return (f"{trial}.file",)
        # A trial as a whole contradicts the apparatus
        return (".".join([trial, *map(str, path[2:])]),) if path[2:] else (f"{trial}.release", f"{trial}.heavy", "light", "rod")
    key = ".".join(str(part) for part in path if part != "apparatus")
    return (key.partition(".")[0],) if key.startswith("effects") else (key,) if key else ()


def get(tree: Tree, key: str) -> Any:
    """Return the value of a dotted key, or None."""
    value: Any = tree
    for part in key.split("."):
        value = value.get(part) if isinstance(value, dict) else None
    return value


def put(tree: Tree, key: str, value: Any) -> None:
    """Set the value of a dotted key, adding the groups that it needs."""
    *groups, last = key.split(".")
    for group in groups:
        if not isinstance(tree.get(group), dict):
            tree[group] = {}
        tree = tree[group]
    tree[last] = value


def yaml_text(tree: Tree, order: tuple[str, ...]) -> str:
    """Return a tree as YAML, its first keys in the given order."""
    ordered = {key: tree[key] for key in order if key in tree} | tree
    return str(yaml.dump(_plain(ordered), Dumper=yaml.SafeDumper, sort_keys=False, allow_unicode=True, width=100))


def _plain(value: Any) -> Any:
    """Convert texts of numbers and flags to numbers and flags, as YAML would put the texts in quotes."""
    if isinstance(value, dict):
        return {
            key: inner if key in ("title", "name", "file", "tracks", "run") else _plain(inner) for key, inner in value.items()
        }
    if isinstance(value, list):
        return [_plain(inner) for inner in value]
    if value in ("true", "false"):
        return value == "true"
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value
