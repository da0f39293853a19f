"""German of what the package writes in English: reports and their figures, what is said of runs, words of the glossary.

`german.toml` beside this file has it piece by piece. A text is translated only if every piece of it is known: what a reader's
scenario, study or engine says of itself stays as it is.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Iterator
from functools import cache, lru_cache
from importlib.resources import files

_UNIT = r"(?:1/|[nµmck]?(?:m|s|g|N|J|Hz|rad|deg)\b(?:\^\d)?|°|%)(?:[ /]?\b(?:k?g|m|s|rad)\b(?:\^\d)?)*"
_DIGITS = r"[-+−]?\d+(?:\.\d+)?(?:e[-+]?\d+)?"
PLACES = {
    "{n}": re.compile(rf"(?:{_DIGITS}|\({_DIGITS} \+/- {_DIGITS}\)e-?\d+)(?: {_UNIT})?(?![\w/])"),
    "{c}": re.compile("`[^`]+`"),
    "{i}": re.compile(r"[A-Za-z]\w*(?:[:_][\w.-]*\w)+"),
    "{w}": re.compile(r"[^|;*`]+"),
}
"""What stands in a piece for a number with its unit, for code, for an identifier, and for a name -> what it looks like.

A name goes on to the next words of the piece.
"""
_DECIMAL_POINT = re.compile(r"(?<=\d)\.(?=\d)")


@lru_cache(maxsize=4096)  # a table repeats its cells, and a page its captions
def translated(text: str) -> str | None:
    """Return a text in German; None: it has pieces that are not known."""
    done, place = "", 0
    while place < len(text):
        # The longest piece that stands here
        place, german = max(_pieces_at(text, place), default=(0, ""))
        if not place:
            return None
        done += german
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


def _pieces_at(text: str, place: int) -> Iterator[tuple[int, str]]:
    """Yield the end and the German of each piece that stands at a place of the text."""
    for start in (text[place], *(name for name, pattern in PLACES.items() if pattern.match(text, place))):
        for parts, german in _by_start().get(start, ()):
            end, filled = _filled(parts, text, place)
            # "no" is no piece of "nothing"
            if end > place and not (text[end - 1].isalnum() and text[end : end + 1].isalnum()):
                yield end, german.format(*filled)


def _filled(parts: list[str], text: str, end: int) -> tuple[int, list[str]]:
    """Return the end of a piece that stands at ``end``, and the German of what is in its places; 0: it does not stand there."""
    filled = []
    for part, words in zip(parts, (*parts[1:], ""), strict=True):
        if part in PLACES:
            limit = text.find(words, end) if part == "{w}" and words else len(text)
            match = PLACES[part].match(text, end, limit)
            if match is None:
                return 0, []
            filled.append(_in_german(match[0]))
            end = match.end()
        elif text.startswith(part, end):
            end += len(part)
        else:
            return 0, []
    return end, filled


@cache
def _by_start() -> dict[str, list[tuple[list[str], str]]]:
    """Return the pieces, cut at their places, with their German, by the first letter or place."""
    starts: dict[str, list[tuple[list[str], str]]] = {}
    for piece, german in pieces().items():
        parts = [part for part in re.split(r"(\{\w\})", piece) if part]
        starts.setdefault(parts[0] if parts[0] in PLACES else parts[0][0], []).append((parts, german))
    return starts


def _in_german(part: str) -> str:
    """Return a number with a decimal comma and German signs; code and names as they are."""
    if not PLACES["{n}"].fullmatch(part):
        return part
    return _DECIMAL_POINT.sub(",", part).replace(" +/- ", " ± ").replace(" deg", "°")
