"""German of what the package writes in English: reports and their figures, what is said of runs, words of the glossary.

`german.toml` beside this file has it piece by piece. A text is translated only if every piece of it is known: what a reader's
scenario, study or engine says of itself stays as it is.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable
from functools import cache, lru_cache
from importlib.resources import files

_UNIT = r"(?:1/|[nµmck]?(?:m|s|g|N|J|Hz|rad|deg)\b(?:\^\d)?|°|%)(?:[ /]?\b(?:k?g|m|s|rad)\b(?:\^\d)?)*"
_NUMBER = rf"[-+−]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?: {_UNIT})?(?![\w/])"
PLACES = {
    "{n}": rf"({_NUMBER}|\({_NUMBER} \+/- {_NUMBER}\)e-?\d+(?: {_UNIT})?)",
    "{c}": "(`[^`]+`)",
    "{i}": r"([A-Za-z]\w*(?:[:_][\w.-]*\w)+)",
    "{w}": r"([^|;*`]+?)",
}
"""What stands in a piece for a number with its unit, for code, for an identifier, and for any name -> its pattern."""
_DECIMAL_POINT = re.compile(r"(?<=\d)\.(?=\d)")


def translated(text: str) -> str | None:
    """Return a text in German; None: it has pieces that are not known."""
    done, place = "", 0
    while place < len(text):
        starts = _pieces()
        candidates = [*starts.get(text[place], ()), *starts[""]]
        matches = [(match, german) for pattern, german in candidates if (match := pattern.match(text, place))]
        if not matches:
            return None
        match, german = max(matches, key=lambda one: one[0].end())
        done += german.format(*map(_in_german, match.groups()))
        place = match.end()
    return done


def german_of(texts: Iterable[str]) -> dict[str, str]:
    """Return those of the texts that can be said in German, each with its German."""
    known = {text: translated(text) for text in texts if text}
    return {text: german for text, german in known.items() if german is not None}


def in_german(markdown: str) -> str:
    """Return a section of a report in German: its headings, paragraphs, entries of lists, and cells of tables.

    Where a paragraph is not known as a whole, each of its sentences that is known is German.
    """
    return "\n".join(map(_line, markdown.split("\n")))


def _line(line: str) -> str:
    if line.startswith("|"):
        return "|".join(_whole_or_sentences(cell) for cell in re.split(r"(?<!\\)\|", line))
    start, text = re.fullmatch(r"(#+ |- |\d+\. |)(.*)", line).groups()  # type: ignore[union-attr]
    return start + _whole_or_sentences(text)


def _whole_or_sentences(text: str) -> str:
    inner = text.strip()
    if not inner:
        return text
    german = translated(inner) or " ".join(translated(sentence) or sentence for sentence in re.split(r"(?<=[.?!:]) ", inner))
    return text.replace(inner, german)


@cache
def pieces() -> dict[str, str]:
    """Return each piece of an English text with the German one, in which {0} is the first number, code or name of the piece."""
    tables = tomllib.loads(files("looping_pendulum.pages").joinpath("german.toml").read_text(encoding="utf-8"))
    return {english: german for table in tables.values() for english, german in table.items()}


@cache
def _pieces() -> dict[str, list[tuple[re.Pattern[str], str]]]:
    """Return the patterns of all pieces with their German, by the first letter; "": those that begin with a place."""
    starts: dict[str, list[tuple[re.Pattern[str], str]]] = {"": []}
    for piece, german in pieces().items():
        parts = re.split(r"(\{\w\})", piece)
        end = r"(?!\w)" if piece[-1].isalnum() else ""
        pattern = re.compile("".join(PLACES.get(part, re.escape(part)) for part in parts) + end)
        starts.setdefault(parts[0][:1], []).append((pattern, german))
    return starts


def _in_german(part: str) -> str:
    """Return a number with a decimal comma and German signs; code and names as they are."""
    if not re.fullmatch(PLACES["{n}"], part):
        return part
    return _DECIMAL_POINT.sub(",", part).replace(" +/- ", " ± ").replace(" deg", "°")
