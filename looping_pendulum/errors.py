"""Errors that a user may see. Each message says where, what was found, what was needed, and a way out."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class WayOut:
    """How to put a fault right by keys of a file, which a command line may give as options."""

    words: str
    """What to do, with "{}" where the keys stand: "choose by {}"."""
    keys: Mapping[str, str]
    """Key -> value, "tracks.light" -> "mass A"."""
    is_example: bool = False
    """Whether the values are examples, which the author of a file is not shown."""
    alternative: WayOut | None = None
    """The other way out of a fault that may be either of two."""

    def in_file(self) -> str:
        """Return the words for the author of a file: "choose by 'run: 2'"."""
        shown = []
        for group in dict.fromkeys(key.partition(".")[0] for key in self.keys):
            inside = [f"{key.partition('.')[2]}: {_in_yaml(v)}" for key, v in self.keys.items() if key.startswith(f"{group}.")]
            value = f"{{{', '.join(inside)}}}" if inside else _in_yaml(self.keys[group])
            shown.append(f"'{group}'" if self.is_example else f"'{group}: {value}'")
        other = [self.alternative.in_file()] if self.alternative else []
        return "; ".join([self.words.format(" and ".join(shown)), *other])

    def as_options(self, option: str) -> str:
        """Return the words for a command line whose ``option`` takes KEY=VALUE: "choose by --marks-set run=2"."""
        shown = " ".join(f"{option} {shlex.quote(f'{key}={value}')}" for key, value in self.keys.items())
        other = [self.alternative.as_options(option)] if self.alternative else []
        return "; ".join([self.words.format(shown), *other])


def _in_yaml(value: str) -> str:
    """Return a value as it is written in YAML, in quotes where a sign of it means something there."""
    is_plain = value == value.strip() and not re.search(r"^[-?!&*|>%@`'\"]|[,\[\]{}#]|:(?:\s|$)", value)
    return value if value and is_plain else json.dumps(value, ensure_ascii=False)


class HarnessError(Exception):
    """Base of every error that this package raises on purpose; its message is one line, whatever the names in it have."""

    def __init__(self, message: str = "") -> None:
        super().__init__(one_line(message))


class ParameterError(HarnessError, ValueError):
    """A physical quantity is impossible, on its own or together with the others."""


class FileKeyError(HarnessError, ValueError):
    """A file that the user wrote has a fault."""

    def __init__(self, message: str, path: tuple[str | int, ...] = (), problem: str = "") -> None:
        super().__init__(message)
        self.path = path
        """Keys and list indices that lead to the fault in the file; empty if it is in no key."""
        self.problem = problem
        """What was found and needed, and a way out, without the place."""


class ScenarioError(FileKeyError):
    """A scenario file cannot be read as a scenario."""


class EngineError(HarnessError, RuntimeError):
    """An engine run failed, or an engine was asked for something that it cannot do."""


class MissingPackageError(HarnessError, ImportError):
    """A package is not installed, or does not run on this system."""


class IntegrationError(HarnessError, ArithmeticError):
    """The reference could not be integrated to its end."""


class ResultError(HarnessError, ValueError):
    """A file is not a result that this version can read."""


def one_line(text: str) -> str:
    """Return ``text`` with every unprintable character, which could break or colour a line of a terminal, as its escape."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def shorten(text: str, max_length: int = 60) -> str:
    """Return ``text``, cut to ``max_length`` characters with "..." at its end if it is longer."""
    return text if len(text) <= max_length else text[: max_length - 3] + "..."


def printable(text: str) -> str:
    """Return ``text`` of several lines with each line made printable by `one_line`; tabs and line ends stay."""
    return "\n".join("\t".join(map(one_line, line.split("\t"))) for line in text.split("\n"))
