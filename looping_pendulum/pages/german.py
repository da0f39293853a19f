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
from textwrap import wrap

from looping_pendulum.pages.markdown import plain, unescaped

LANGUAGES = {"en": "English", "de": "Deutsch"}
"""Language of pages -> its own name; a page without JavaScript is in the first."""
_UNIT = r"(?:1/|[nµmck]?(?:m|s|g|N|J|Hz|rad|deg)\b(?:\^\d)?|°|%)(?:[ /*]?\b(?:k?g|m|s|N|rad)\b(?:\^\d)?)*"
_DIGITS = r"[-+−]?\d+(?:\.\d+)?(?:e[-+]?\d+)?"
PLACES = {
    "{n}": re.compile(rf"(?:{_DIGITS}|\({_DIGITS} \+/- {_DIGITS}\)e-?\d+)(?: {_UNIT})?(?![\w/])"),
    "{c}": re.compile("`[^`]+`"),
    "{i}": re.compile(r"[A-Za-z]\w*(?:[:_][\w.-]*\w)+"),
    "{e}": re.compile(r"[A-Za-z]\w*"),
    "{w}": re.compile(r"[^|;*`]+"),
}
"""What stands in a piece for a number with its unit, code, an identifier, a name of one word, and a name -> what it looks like.

A name goes on to the next words of the piece, and one that ends the piece to the end of the text, but for its full stop.
"""
BREAK = "<br>"
"""Between the lines of a figure's label."""
START = 4
"""Letters by which pieces are looked up: of several hundred that begin with a "t", few are then compared with a text."""
_DECIMAL_POINT = re.compile(r"(?<=\d)\.(?=\d)")


def said(text: str, language: str) -> str:
    """Return a text of the package in one of the `LANGUAGES`; what is not known in German stays English."""
    return (translated(text) or text) if language == "de" else text


@lru_cache(maxsize=4096)  # a table repeats its cells, and a page its captions
def translated(text: str) -> str | None:
    """Return a text in German; None: it has pieces that are not known."""
    # Where each piece so far ends, its German, and what may follow it, the best last
    path = [(0, "", _pieces_at(text, 0))]
    dead_ends = set()
    while path:
        place, _, following = path[-1]
        if place == len(text):
            return "".join(german for _, german, _ in path)
        if not following:
            dead_ends.add(place)
            path.pop()
            continue
        end, german = following.pop()
        if end not in dead_ends:
            path.append((end, german, _pieces_at(text, end)))
    return None


def german_of(texts: Iterable[str]) -> dict[str, str]:
    """Return those of the texts that can be said in German, each with its German."""
    known = {text: translated(text) or _in_lines(text) for text in texts if text}
    return {text: german for text, german in known.items() if german is not None}


def _in_lines(text: str) -> str | None:
    """Return a label of several lines in German: each line by itself or, where a name was cut into lines, cut again."""
    lines = text.split(BREAK)
    if len(lines) == 1:
        return None
    each = [german for line in lines if (german := translated(line)) is not None]
    if len(each) == len(lines):
        return BREAK.join(each)
    german = translated(" ".join(lines))
    return None if german is None else BREAK.join(wrap(german, max(map(len, lines))))


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
    german = _markdown_said(inner)
    if german is None:
        german = " ".join(_markdown_said(sentence) or sentence for sentence in re.split(r"(?<=[.?!:]) ", inner))
    return text.replace(inner, german)


def _markdown_said(text: str) -> str | None:
    """Return a text in German whose special characters may be escaped, and which may be a phrase that begins a sentence."""
    known = translated(text)
    if known is None and "\\" in text:
        known = translated(unescaped(text))
        known = known and plain(known)
    if known is None and text[0].isupper():
        known = translated(text[0].lower() + text[1:])
        known = known and known[0].upper() + known[1:]
    return known


@cache
def pieces() -> dict[str, str]:
    """Return each piece of an English text with the German one, in which {0} is the first number, code or name of the piece."""
    tables = tomllib.loads(files("looping_pendulum.pages").joinpath("german.toml").read_text(encoding="utf-8"))
    return {english: german for table in tables.values() for english, german in table.items()}


def _pieces_at(text: str, place: int) -> list[tuple[int, str]]:
    """Return the end and the German of each piece that stands at a place of the text, the best last.

    That is the one that reaches farthest, and of several the one with most words of its own; a name that goes on to the end of
    the text is taken for one only if nothing else leads there.
    """
    found = []
    starts = {text[place : place + length] for length in range(1, START + 1)}
    starts |= {name for name, pattern in PLACES.items() if pattern.match(text, place)}
    for parts, german in (piece for start in starts for piece in _by_start().get(start, ())):
        end, filled = _filled(parts, text, place)
        # "no" is no piece of "nothing"
        if end > place and not (text[end - 1].isalnum() and text[end : end + 1].isalnum()):
            own = sum(len(part) for part in parts if part not in PLACES)
            found.append((parts[-1] != "{w}", end, own, german.format(*filled)))
    return [(end, german) for _, end, _, german in sorted(found)]


def _filled(parts: list[str], text: str, end: int) -> tuple[int, list[str]]:
    """Return the end of a piece that stands at ``end``, and the German of what is in its places; 0: it does not stand there."""
    filled = []
    for part, words in zip(parts, (*parts[1:], ""), strict=True):
        if part in PLACES:
            limit = len(text) if part != "{w}" else text.find(words, end) if words else len(text.rstrip("."))
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
    """Return the pieces, cut at their places, with their German, by their first letters or place."""
    starts: dict[str, list[tuple[list[str], str]]] = {}
    for piece, german in pieces().items():
        parts = [part for part in re.split(r"(\{\w\})", piece) if part]
        starts.setdefault(parts[0] if parts[0] in PLACES else parts[0][:START], []).append((parts, german))
    return starts


def _in_german(part: str) -> str:
    """Return a number with a decimal comma and German signs; code and names as they are."""
    if not PLACES["{n}"].fullmatch(part):
        return part
    return _DECIMAL_POINT.sub(",", part).replace(" +/- ", " ± ").replace(" deg", "°")
