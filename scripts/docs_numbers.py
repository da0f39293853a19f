"""Write the numbers of README and docs from stored data: `python -m scripts.docs_numbers`; `--check` only lists
faults.

`docs/data/numbers.yaml` lists the sentences with numbers of each page that is written by hand. Each number has a placeholder
and a source: stored data (which record the command, the day and the versions of the measurement), a constant of the code, or a
parameter of a shipped scenario. Numbers that are not measured (definitions, advice, bounds that a test asserts) are listed
there, too, with the reason. A number with a unit in a page that is not in the list is a fault, and so is a listed sentence that
is no longer in its page.

README's table of engines stands between two markers and is written as a whole, from the results in `docs/data/ten_to_one`; so
are the measured rates of docs/rates.md, from `docs/data/calibration.json`.
"""

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

from benchmarks import rates_page
from looping_pendulum.pages.numbers import amount
from looping_pendulum.scenarios import load
from scripts import engine_table

PROJECT = Path(__file__).parents[1]
DATA = PROJECT / "docs" / "data"
NUMBERS_FILE = DATA / "numbers.yaml"
GENERATED_PAGES = (
    "docs/answers.md",
    "docs/engine-study.md",
    "docs/keys.md",
    "docs/leaderboard.md",
    "docs/metrics.md",
    "docs/repro.md",
    "docs/rope-over-a-cylinder.md",
    "docs/support.md",
    "docs/versions.md",
    "docs/demonstrations/",
)
"""Pages that other scripts generate from their own data; each has a test of its own."""
VERIFICATION_PAGE = "docs/verification.md"
"""Page whose tables name, in each row, a bound and the test that asserts it; a test checks that this test exists."""
ENGINE_PAGES = "docs/engines/"
"""Folder of the pages that list what adapters declare; only their limits have measured numbers, which stand in the code."""

NUMBER = r"[-+]?\d+(?:[.,]\d+)*(?:e[-+]?\d+)?"
UNITS = (
    "m|mm|cm|km|µm|um|nm|s|ms|µs|us|kg|g|N|mN|m/s|mm/s|kg/s|kg/m|rad|mrad|deg|degrees|Hz|kHz|fps|%|MB|GB|GiB|MiB|J|"
    "times|joints|minutes|seconds|hours|frames|iterations|of \\d+"
)
QUANTITY = re.compile(rf"(?<![\w./]){NUMBER}(?:(?: to | and | or | / | \+/- |, ){NUMBER})*[ -]?(?:{UNITS})(?![\w/])")
"""Matches a number with a unit, or several numbers that share a unit."""
PLACEHOLDER = re.compile(r"\{(\w+)\}")
WHITESPACE = r'(?:\s|f?")+'
"""Pattern for a blank, which may be the end of a line, also of a string literal that continues on the next line."""


@dataclass(frozen=True)
class Sentence:
    """A piece of a page's text with placeholders."""

    page: str
    text: str
    sources: dict[str, dict[str, Any]]
    """Placeholder -> source of its number."""

    @functools.cached_property
    def pattern(self) -> re.Pattern[str]:
        """Return a pattern that matches the sentence with any numbers and any line breaks."""
        parts = PLACEHOLDER.split(self.text)
        literal = [WHITESPACE.join(re.escape(word) for word in re.split(r"\s+", part)) for part in parts[::2]]
        names = [f"(?P<{name}>{NUMBER})" for name in parts[1::2]]
        return re.compile("".join(a + b for a, b in zip(literal, [*names, ""], strict=True)))

    def expected_numbers(self) -> dict[str, str]:
        """Return the number that each placeholder should have."""
        return {name: _formatted_number(source) for name, source in self.sources.items()}


@functools.cache
def sentences() -> tuple[Sentence, ...]:
    """Return every listed sentence that contains numbers."""
    result = []
    for page, entries in _load_numbers_file()["pages"].items():
        for entry in entries:
            sources = {name: source for name, source in entry.items() if name != "text"}
            placeholders = PLACEHOLDER.findall(entry["text"])
            if sorted(placeholders) != sorted(sources):
                mismatch = f"found placeholders {placeholders}, needed one for each of {list(sources)}"
                raise ValueError(f"{NUMBERS_FILE.name}: {page}: {entry['text']!r}: {mismatch}")
            result.append(Sentence(page=page, text=entry["text"], sources=sources))
    return tuple(result)


def unmeasured_numbers() -> dict[str, dict[str, str]]:
    """Return page -> its numbers that are not measured, each with the reason."""
    given: dict[str, dict[str, str]] = _load_numbers_file()["given"]
    return given


def rewrite() -> list[str]:
    """Write all numbers, and return the files that have changed."""
    changed = []
    for page in dict.fromkeys([*(s.page for s in sentences()), "README.md", rates_page.PAGE]):
        file = PROJECT / page
        before = file.read_text(encoding="utf-8")
        after = _with_current_numbers(page, before)
        if after != before:
            file.write_text(after, encoding="utf-8")
            changed.append(page)
    return changed


def problems() -> list[str]:
    """Return all faults, one line each: lost sentences, numbers that differ from the data, numbers without a source."""
    messages = []
    for page in dict.fromkeys(s.page for s in sentences()):
        text = (PROJECT / page).read_text(encoding="utf-8")
        for sentence in (s for s in sentences() if s.page == page):
            if not sentence.pattern.search(text):
                messages.append(f"{page}: found no {sentence.text!r}; correct docs/data/numbers.yaml")
            for match in sentence.pattern.finditer(text):
                for name, right in sentence.expected_numbers().items():
                    if match[name] != right:
                        messages.append(f"{page}: says {match[name]} for {name} of {sentence.text!r}, the data say {right}")
    for page in ("README.md",):
        text = (PROJECT / page).read_text(encoding="utf-8")
        if engine_table.with_current_table(text) != text:
            messages.append(f"{page}: the table of engines is not what docs/data/ten_to_one says")
    page = rates_page.PAGE
    text = (PROJECT / page).read_text(encoding="utf-8")
    if rates_page.with_current_rates(text) != text:
        messages.append(f"{page}: the measured rates are not what docs/data/calibration.json says")
    for page in hand_written():
        messages += [f"{page}: {where!r}: no source in docs/data/numbers.yaml" for where in numbers_without_source(page)]
    for page, entries in unmeasured_numbers().items():
        text = _without_code_and_formulas((PROJECT / page).read_text(encoding="utf-8"))
        messages += [
            f"{page}: found no {words!r}; correct docs/data/numbers.yaml"
            for words in entries
            if not _literal_pattern(words).search(text)
        ]
    return messages


def hand_written() -> list[str]:
    """Return the pages that are written by hand, whose numbers the list must cover."""
    pages = ["README.md", *(p.relative_to(PROJECT).as_posix() for p in sorted((PROJECT / "docs").rglob("*.md")))]
    return [page for page in pages if not page.startswith(GENERATED_PAGES)]


def numbers_without_source(page: str) -> list[str]:
    """Return the numbers with units in the prose of ``page`` that are not listed, each with the text around it."""
    text = prose(page, (PROJECT / page).read_text(encoding="utf-8"))
    spans = [m.span() for s in sentences() if _applies_to(s.page, page) for m in s.pattern.finditer(text)]
    spans += [m.span() for words in unmeasured_numbers().get(page, {}) for m in _literal_pattern(words).finditer(text)]
    return [
        " ".join(text[max(0, m.start() - 30) : m.end() + 20].split())
        for m in QUANTITY.finditer(text)
        if not any(start <= m.start() and m.end() <= end for start, end in spans)
    ]


def prose(page: str, text: str) -> str:
    """Return a page's prose: the text, output of commands included, without code, formulas and tables that a script writes."""
    if page.startswith(ENGINE_PAGES):
        return "\n\n".join(re.findall(r"^### Limits\n(.*?)(?=^#|\Z)", text, re.DOTALL | re.MULTILINE))
    if page == VERIFICATION_PAGE:
        text = re.sub(r"^\|.*$", "", text, flags=re.MULTILINE)
    return _without_code_and_formulas(rates_page.without_rates(engine_table.without_table(text)))


def _without_code_and_formulas(text: str) -> str:
    # Blocks of text stay: they show what a command prints, which its next version may print otherwise
    block = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
    text = block.sub(lambda match: match[2] if match[1] == "text" else "", text)
    text = re.sub(r"\$\$.*?\$\$", "", text, flags=re.DOTALL)
    return re.sub(r"\$[^$\n]*\$", "", text)


def _applies_to(source: str, page: str) -> bool:
    """Return whether sentences of ``source`` may occur in ``page``: its own, and those of adapters in the engines' pages."""
    return source == page or (page.startswith(ENGINE_PAGES) and source.startswith("looping_pendulum/engines/"))


def _literal_pattern(text: str) -> re.Pattern[str]:
    return re.compile(WHITESPACE.join(re.escape(word) for word in text.split()))


def _with_current_numbers(page: str, text: str) -> str:
    if page == "README.md":
        text = engine_table.with_current_table(text)
    if page == rates_page.PAGE:
        text = rates_page.with_current_rates(text)
    for sentence in (s for s in sentences() if s.page == page):
        right = sentence.expected_numbers()

        def put(match: re.Match[str], right: dict[str, str] = right) -> str:
            whole, start = match[0], match.start()
            for name, new in sorted(right.items(), key=lambda item: -match.start(item[0])):
                whole = whole[: match.start(name) - start] + new + whole[match.end(name) - start :]
            return whole

        text = sentence.pattern.sub(put, text)
    return text


def _formatted_number(source: dict[str, Any]) -> str:
    """Format a number as the page prints it: to ``digits`` significant digits (default 2) or to ``decimals``."""
    value = abs(_value(source) * float(source.get("times", 1)))
    if "decimals" in source:
        return f"{value:.{source['decimals']}f}"
    return amount(value, digits=source.get("digits", 2))


def _value(source: dict[str, Any]) -> float:
    if "code" in source:
        module, _, name = source["code"].partition(":")
        value = getattr(importlib.import_module(module), name)
        value = value[source["at"]] if "at" in source else value
    elif "scenario" in source:
        parameters = load(source["scenario"]).parameters
        value = parameters.coefficients.get(source["at"]) or getattr(parameters, source["at"])
    else:
        value = value_at(_load_data_file(source["data"]), source["at"])
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{NUMBERS_FILE.name}: {source}: found {value!r}, needed a number")
    return value


def value_at(tree: Any, path: str) -> Any:
    """Look up a value in stored data; a part like [what=lagged;...] selects an entry of a list by its keys."""
    for part in path.split("/"):
        key, _, choice = part.partition("[")
        tree = tree[key] if key else tree
        if choice:
            wanted = [pair.split("=", 1) for pair in choice.rstrip("]").split(";")]
            (tree,) = (entry for entry in tree if all(str(entry[k]) == v for k, v in wanted))
    return tree


@functools.cache
def _load_data_file(name: str) -> Any:
    tree = json.loads((DATA / f"{name}.json").read_text(encoding="utf-8"))
    return tree["values"] if name.startswith("measured/") else tree


@functools.cache
def _load_numbers_file() -> Any:
    return yaml.safe_load(NUMBERS_FILE.read_text(encoding="utf-8"))


def main() -> None:
    """Write the numbers, or with `--check` only check them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="check the numbers without writing them")
    if not parser.parse_args().check:
        for page in rewrite():
            print(f"wrote {page}")
    wrong = problems()
    print("\n".join(wrong) or "all numbers of README and docs agree with their sources")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
