"""Write the numbers of README and docs from stored data: `python -m scripts.docs_numbers`; `--check` only says what is wrong.

`docs/data/numbers.yaml` lists, for each page that is written by hand, the sentences that hold numbers, with a placeholder for
each number and where it comes from: stored data (which say the command, the day and the versions that measured them), a
constant of the code, or a parameter of a shipped scenario. Numbers that nothing measures (definitions, advice, bounds that a
test asserts) are listed there, too, with the reason. A number with a unit that stands in a page and not in that list is a
problem, as is a sentence that its page has lost.

README's table of engines stands between two markers and is written whole, from the results in `docs/data/ten_to_one`.
"""

from __future__ import annotations

import argparse
import functools
import importlib
import json
import re
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from looping_pendulum.pages.numbers import amount
from looping_pendulum.scenarios import load
from scripts import engine_table

PROJECT = Path(__file__).parents[1]
DATA = PROJECT / "docs" / "data"
LIST = DATA / "numbers.yaml"
GENERATED = ("docs/answers.md", "docs/engine-study.md", "docs/support.md", "docs/demonstrations/")
"""Pages that other scripts write whole from their own data, each with a test of its own."""
TESTED = "docs/verification.md"
"""The page whose tables give a bound and the test that asserts it in each row; a test checks that there is such a test."""
DECLARED = "docs/engines/"
"""Pages of what the adapters declare: only their limits say what was measured, and those sentences stand in the code."""

NUMBER = r"[-+]?\d+(?:[.,]\d+)*(?:e[-+]?\d+)?"
UNITS = (
    "m|mm|cm|km|µm|um|nm|s|ms|µs|us|kg|g|N|mN|m/s|mm/s|kg/s|kg/m|rad|mrad|deg|degrees|Hz|kHz|fps|%|MB|GB|GiB|MiB|J|"
    "times|joints|minutes|seconds|hours|frames|iterations|of \\d+"
)
MEASURED = re.compile(rf"(?<![\w./]){NUMBER}(?:(?: to | and | or | / | \+/- |, ){NUMBER})*[ -]?(?:{UNITS})(?![\w/])")
"""A number with a unit, or several that share one."""
PLACEHOLDER = re.compile(r"\{(\w+)\}")
SPACE = r'(?:\s|f?")+'
"""What may stand for a blank: a line's end, also of a text in the code that goes on in the next line."""


@dataclass(frozen=True)
class Sentence:
    """A piece of a page's text with placeholders."""

    page: str
    text: str
    sources: dict[str, dict[str, Any]]
    """Placeholder -> where its number comes from."""

    @functools.cached_property
    def pattern(self) -> re.Pattern[str]:
        """Match the sentence whatever its numbers are and wherever its lines end."""
        parts = PLACEHOLDER.split(self.text)
        literal = [SPACE.join(re.escape(word) for word in re.split(r"\s+", part)) for part in parts[::2]]
        names = [f"(?P<{name}>{NUMBER})" for name in parts[1::2]]
        return re.compile("".join(a + b for a, b in zip(literal, [*names, ""], strict=True)))

    def written(self) -> dict[str, str]:
        """Placeholder -> the number that should stand there."""
        return {name: _text(source) for name, source in self.sources.items()}


@functools.cache
def sentences() -> tuple[Sentence, ...]:
    """Every sentence of the list that holds numbers."""
    found = []
    for page, entries in _list()["pages"].items():
        for entry in entries:
            sources = {name: source for name, source in entry.items() if name != "text"}
            asked = PLACEHOLDER.findall(entry["text"])
            if sorted(asked) != sorted(sources):
                raise ValueError(f"{LIST.name}: {page}: {entry['text']!r}: placeholders {asked}, but sources {list(sources)}")
            found.append(Sentence(page=page, text=entry["text"], sources=sources))
    return tuple(found)


def given() -> dict[str, dict[str, str]]:
    """Page -> its numbers that nothing measures, each with the reason."""
    found: dict[str, dict[str, str]] = _list()["given"]
    return found


def rewrite() -> list[str]:
    """Write all numbers; return the files that changed."""
    changed = []
    for page in dict.fromkeys([*(s.page for s in sentences()), "README.md"]):
        file = PROJECT / page
        before = file.read_text(encoding="utf-8")
        after = _rewritten(page, before)
        if after != before:
            file.write_text(after, encoding="utf-8")
            changed.append(page)
    return changed


def problems() -> list[str]:
    """Everything that is wrong, one line each: lost sentences, numbers that the data do not give, numbers without a source."""
    found = []
    for page in dict.fromkeys(s.page for s in sentences()):
        text = (PROJECT / page).read_text(encoding="utf-8")
        for sentence in (s for s in sentences() if s.page == page):
            if not sentence.pattern.search(text):
                found.append(f"{page}: has lost {sentence.text!r}; correct docs/data/numbers.yaml")
            for match in sentence.pattern.finditer(text):
                for name, right in sentence.written().items():
                    if match[name] != right:
                        found.append(f"{page}: says {match[name]} for {name} of {sentence.text!r}, the data say {right}")
    for page in ("README.md",):
        text = (PROJECT / page).read_text(encoding="utf-8")
        if engine_table.replaced(text) != text:
            found.append(f"{page}: the table of engines is not what docs/data/ten_to_one says")
    for page in hand_written():
        found += [f"{page}: {where!r}: no source in docs/data/numbers.yaml" for where in uncovered(page)]
    for page, entries in given().items():
        text = _plain((PROJECT / page).read_text(encoding="utf-8"))
        found += [f"{page}: has lost {words!r}" for words in entries if not _literal(words).search(text)]
    return found


def hand_written() -> list[str]:
    """Pages whose numbers this list answers for."""
    pages = ["README.md", *(p.relative_to(PROJECT).as_posix() for p in sorted((PROJECT / "docs").rglob("*.md")))]
    return [page for page in pages if not page.startswith(GENERATED)]


def uncovered(page: str) -> list[str]:
    """Numbers with units in the prose of ``page`` that no sentence and no reason covers, each with its surroundings."""
    text = prose(page, (PROJECT / page).read_text(encoding="utf-8"))
    spans = [m.span() for s in sentences() if _speaks_of(s.page, page) for m in s.pattern.finditer(text)]
    spans += [m.span() for words in given().get(page, {}) for m in _literal(words).finditer(text)]
    return [
        " ".join(text[max(0, m.start() - 30) : m.end() + 20].split())
        for m in MEASURED.finditer(text)
        if not any(start <= m.start() and m.end() <= end for start, end in spans)
    ]


def prose(page: str, text: str) -> str:
    """Return the part of a page that says something in numbers: no code, no formulas, no table that a script writes."""
    if page.startswith(DECLARED):
        return "\n\n".join(re.findall(r"^### Limits\n(.*?)(?=^#|\Z)", text, re.DOTALL | re.MULTILINE))
    if page == TESTED:
        text = re.sub(r"^\|.*$", "", text, flags=re.MULTILINE)
    return _plain(engine_table.removed(text))


def _plain(text: str) -> str:
    for pattern in (r"^```.*?^```$", r"\$\$.*?\$\$"):
        text = re.sub(pattern, "", text, flags=re.DOTALL | re.MULTILINE)
    return re.sub(r"\$[^$\n]*\$", "", text)


def _speaks_of(source: str, page: str) -> bool:
    """Whether the sentences of ``source`` may stand in ``page``: its own, or those of the adapters in their pages."""
    return source == page or (page.startswith(DECLARED) and source.startswith("looping_pendulum/engines/"))


def _literal(text: str) -> re.Pattern[str]:
    return re.compile(SPACE.join(re.escape(word) for word in text.split()))


def _rewritten(page: str, text: str) -> str:
    if page == "README.md":
        text = engine_table.replaced(text)
    for sentence in (s for s in sentences() if s.page == page):
        right = sentence.written()

        def put(match: re.Match[str], right: dict[str, str] = right) -> str:
            whole, start = match[0], match.start()
            for name, new in sorted(right.items(), key=lambda item: -match.start(item[0])):
                whole = whole[: match.start(name) - start] + new + whole[match.end(name) - start :]
            return whole

        text = sentence.pattern.sub(put, text)
    return text


def _text(source: dict[str, Any]) -> str:
    """Return a number as the page writes it: to ``digits`` significant digits (2) or to ``decimals``."""
    value = abs(_value(source) * float(source.get("times", 1)))
    if "decimals" in source:
        return f"{value:.{source['decimals']}f}"
    return amount(value, digits=source.get("digits", 2))


def _value(source: dict[str, Any]) -> float:
    if "code" in source:
        module, _, name = source["code"].partition(":")
        value = getattr(importlib.import_module(module), name)
    elif "scenario" in source:
        parameters = load(source["scenario"]).parameters
        value = parameters.coefficients.get(source["at"]) or getattr(parameters, source["at"])
    else:
        value = _stored(source["data"], source["at"])
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{LIST.name}: {source}: found {value!r}, needed a number")
    return value


def _stored(name: str, path: str) -> Any:
    """Look up a value in a file of docs/data; a part like [what=lagged, ...] chooses from a list by its entries' keys."""
    tree = _file(name)
    for part in path.split("/"):
        key, _, choice = part.partition("[")
        tree = tree[key] if key else tree
        if choice:
            wanted = [pair.split("=", 1) for pair in choice.rstrip("]").split(";")]
            (tree,) = (entry for entry in tree if all(str(entry[k]) == v for k, v in wanted))
    return tree


@functools.cache
def _file(name: str) -> Any:
    tree = json.loads((DATA / f"{name}.json").read_text(encoding="utf-8"))
    return tree["values"] if name.startswith("measured/") else tree


@functools.cache
def _list() -> Any:
    return yaml.safe_load(LIST.read_text(encoding="utf-8"))


def main() -> None:
    """Write the numbers, or only check them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="change nothing")
    if not parser.parse_args().check:
        for page in rewrite():
            print(f"wrote {page}")
    wrong = problems()
    print("\n".join(wrong) or "all numbers of README and docs are what their sources say")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
