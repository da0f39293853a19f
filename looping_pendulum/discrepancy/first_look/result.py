"""Result of a first look, as plain data for messages and the picture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from looping_pendulum.discrepancy.first_look.misfit import Distance
from looping_pendulum.measured.observations import DataError, Observations
from looping_pendulum.pages.numbers import quantity


class DeclarationError(DataError):
    """Tracked points and declaration contradict each other; `check` says how."""

    def __init__(self, check: DeclarationCheck) -> None:
        super().__init__("; ".join(m.text for m in check.mistakes))
        self.check = check


@dataclass(frozen=True, kw_only=True, eq=False)
class NamedMistake:
    """A mistake that the points show."""

    trials: tuple[str, ...]
    names: tuple[str, ...]
    """Names of `mistakes.Mistake`; several if the points do not tell which of them was made."""
    keys: str
    """Keys of the study that mend it, with their values in the first of these trials."""
    text: str
    """One line: where, what was found, what was needed, and the key that mends it."""
    corrected: Mapping[str, Distance] = field(default_factory=dict)
    """Trial -> distance of its points without the mistake; empty: only the origin is elsewhere."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrialCheck:
    """Comparison of one trial."""

    trial: str
    distance: Distance | None
    """Distance of its points from the declared motion; None: the trial was not looked at."""
    reason: str = ""
    """Why it was not looked at."""
    reading: tuple[str, ...] = ()
    """What was assumed or put right when its files were read."""

    @property
    def text(self) -> str:
        """Return in one line how near the points are."""
        if self.distance is None:
            return f"trial '{self.trial}': not looked at, {self.reason}"
        return (
            f"trial '{self.trial}': in the first {quantity(self.distance.window, 's')} the points are "
            f"{self.distance.text} from the declared motion, before anything is fitted"
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class DeclarationCheck:
    """Result of a first look at a study."""

    trials: tuple[TrialCheck, ...]
    mistakes: tuple[NamedMistake, ...] = ()
    """What looks wrong."""
    warnings: tuple[str, ...] = ()
    """Declared values of unusual size, in one line each; they do not contradict the points."""
    observations: Mapping[str, Observations] = field(default_factory=dict, repr=False, compare=False)
    """Trial -> what its files hold, read as they are declared."""

    @property
    def notes(self) -> tuple[str, ...]:
        """Return everything that looks wrong or unusual, in one sentence each."""
        return tuple(f"At first look: {text}." for text in (*(m.text for m in self.mistakes), *self.warnings))

    def refuse_mistakes(self) -> None:
        """Raise what looks wrong, if anything does.

        Raises
        ------
        DeclarationError
            If there is a mistake; its message is one line.
        """
        if self.mistakes:
            raise DeclarationError(self)
