"""The errors a user may meet. Each says where, what was found, what was needed, and a way out."""

from __future__ import annotations


class HarnessError(Exception):
    """Base of every error that this package raises on purpose; the command line prints it as one line."""


class ParameterError(HarnessError, ValueError):
    """A physical quantity is impossible, on its own or together with the others."""


class ScenarioError(HarnessError, ValueError):
    """A scenario file cannot be read as a scenario."""


class EngineError(HarnessError, RuntimeError):
    """An engine run failed, or an engine was asked for something that it cannot do."""


class MissingPackageError(HarnessError, ImportError):
    """An optional engine or integrator is not installed."""


class IntegrationError(HarnessError, ArithmeticError):
    """The reference could not be integrated to its end."""


class IntegratorGaveUpError(IntegrationError):
    """One integrator could not go on; another may."""


class HandedOverWarning(UserWarning):
    """Runs of the reference were solved by another integrator, since the usual one gave up."""


def one_line(text: str) -> str:
    """Return ``text`` with whatever could break, colour or reorder a terminal's line shown as an escape."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def shorten(text: str, longest: int = 60) -> str:
    """Cut a long text."""
    return text if len(text) <= longest else text[: longest - 3] + "..."


def printable(text: str) -> str:
    """Return ``text`` of several lines, each as `one_line` has it; tabs stay."""
    return "\n".join("\t".join(map(one_line, line.split("\t"))) for line in text.split("\n"))
