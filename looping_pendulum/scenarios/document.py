"""Read YAML text into plain data whose scalars are still text, with the line number of every key.

It is stricter than YAML: it allows no anchors (so no alias bombs), no tags and no duplicate keys, and it limits size and
nesting.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import takewhile
from typing import Any

import yaml

from looping_pendulum.errors import ScenarioError, shorten
from looping_pendulum.files import read_file

MAX_FILE_SIZE = 64 * 1024
"""Largest file that is read [bytes]: many times a long scenario, and still read within a second or two."""
MAX_DEPTH = 12
"""Largest number of nesting levels; a scenario needs five."""
QUOTE_COMMENT_SIGN = "'#' begins a comment: put a value that has it in quotes"
"""Way out where a part of a value was taken for a comment."""
_NULLS = frozenset({"", "~", "null", "Null", "NULL"})
_TAGS = {
    yaml.ScalarNode: "tag:yaml.org,2002:str",
    yaml.SequenceNode: "tag:yaml.org,2002:seq",
    yaml.MappingNode: "tag:yaml.org,2002:map",
}

Path = tuple[str | int, ...]
"""Keys and list indices that lead to a value of a document."""


class EmptyValue:
    """Value of a key that has none in the file."""


EMPTY_VALUE = EmptyValue()


@dataclass(frozen=True, kw_only=True)
class Document:
    """A file's content, with the line number of each value."""

    file: str
    """Name of the file in error messages."""
    data: dict[str, Any]
    """Content; every scalar is text."""
    lines: dict[Path, int] = field(repr=False)
    """Path of a value -> its line, from 1."""
    text: str = field(repr=False)
    """The file itself."""

    def line_of(self, path: Path) -> str:
        """Return the line of the file in which the value at ``path`` begins; '' if it has none."""
        return self.text.splitlines()[self.lines[path] - 1] if path in self.lines else ""

    def error(self, path: Path, message: str) -> ScenarioError:
        """Return an error about the key at ``path``, with the line of it or of the nearest group around it."""
        nearest = next((path[:n] for n in range(len(path), 0, -1) if path[:n] in self.lines), ())
        line = f":{self.lines[nearest]}" if nearest else ""
        key = f" {key_text(path)}:" if path else ""
        return ScenarioError(f"{self.file}{line}:{key} {message}", path, message)


def key_text(path: Path) -> str:
    """Return a path as text: ("inferred", 0, "how") as "inferred[0].how"."""
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{shorten(part)}" if text else shorten(part)
    return text


def quote(value: object) -> str:
    """Return a value of a file as error messages name it."""
    if isinstance(value, EmptyValue):
        return "nothing"
    if isinstance(value, dict):
        return "a group of keys"
    if isinstance(value, list):
        return "a list"
    return f"'{shorten(str(value))}'"


def read(path: str | os.PathLike[str]) -> bytes:
    """Return a file's bytes; of one that is too large, one more than is allowed, which `parse` refuses.

    Raises
    ------
    ScenarioError
        If it cannot be read.
    """
    try:
        return read_file(path, MAX_FILE_SIZE)
    except (OSError, ValueError) as error:  # ValueError: a name with a null character
        raise _refused(os.fspath(path), None, f"cannot be read: {getattr(error, 'strerror', error)}") from None


def parse(raw: bytes, file: str, needed: str = "a scenario; start from a copy of a shipped one") -> Document:
    """Read YAML; ``needed`` is what an empty file lacks.

    Raises
    ------
    ScenarioError
        If it is not YAML with keys at its top level; the message has the file and, if known, the line.
    """
    text = _decode(raw, file)
    try:
        node = _Loader(text, file).get_single_node()
    except yaml.MarkedYAMLError as error:
        raise _yaml_error(error, file, text) from None
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        message = f"found the character {chr(error.character)!a}, needed plain text; delete it"
        raise _refused(file, line, message) from None
    if node is None or (isinstance(node, yaml.ScalarNode) and node.value in _NULLS):
        raise _refused(file, None, f"found an empty file, needed {needed}")
    if not isinstance(node, yaml.MappingNode):
        what = "a list" if isinstance(node, yaml.SequenceNode) else f"'{shorten(node.value)}'"
        raise _refused(file, None, f"found {what}, needed keys with values; write for example 'title: Ten to one'")
    lines: dict[Path, int] = {}
    return Document(file=file, data=_plain(node, (), lines, file), lines=lines, text=text)


def _refused(file: str, line: int | None, message: str) -> ScenarioError:
    """Return an error about a line of a file."""
    return ScenarioError(f"{file}: {message}" if line is None else f"{file}:{line}: {message}")


def _decode(raw: bytes, file: str) -> str:
    """Return the text of a file, which must be small and in UTF-8."""
    if len(raw) > MAX_FILE_SIZE:
        size = f"more than {MAX_FILE_SIZE // 1024} KiB"
        raise _refused(file, None, f"found {size}, needed a scenario of a few KiB; keep data in a file of its own")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        message = f"found the byte 0x{raw[error.start]:02x}, needed UTF-8 text; save the file as UTF-8"
        raise _refused(file, line, message) from None


class _Loader(yaml.BaseLoader):
    """PyYAML's composer that refuses anchors, tags and deep nesting; it constructs no objects."""

    def __init__(self, text: str, file: str) -> None:
        super().__init__(text)
        self.file = file
        self.depth = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        composer: Any = self  # PyYAML's type stubs leave its parser untyped
        event = composer.peek_event()
        line = event.start_mark.line + 1
        if getattr(event, "anchor", None) is not None:
            sign = "*" if isinstance(event, yaml.AliasEvent) else "&"
            name = f"{sign}{shorten(event.anchor)}"
            message = f"found the YAML anchor or alias '{name}', needed the value itself; write it out"
            raise _refused(self.file, line, message)
        # Counted while composing: the depth of a hostile file must not reach Python's recursion limit first
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise _refused(self.file, line, f"found more than {MAX_DEPTH} levels of nesting, needed at most five")
        node = super().compose_node(parent, index)
        self.depth -= 1
        if node is not None and node.tag != _TAGS[type(node)]:
            message = f"found the YAML tag '{shorten(node.tag)}', needed a plain value; leave the tag out"
            raise _refused(self.file, line, message)
        return node


def _plain(node: yaml.Node, path: Path, lines: dict[Path, int], file: str) -> Any:
    """Return the data of a node, and store the line of everything below it in ``lines``."""
    if isinstance(node, yaml.ScalarNode):
        _check_surrogates(node, file)
        # Without quotes (no style): a quoted "null" is a text
        return EMPTY_VALUE if node.style is None and node.value in _NULLS else node.value
    if isinstance(node, yaml.SequenceNode):
        for i, item in enumerate(node.value):
            lines[*path, i] = item.start_mark.line + 1
        return [_plain(item, (*path, i), lines, file) for i, item in enumerate(node.value)]
    data: dict[str, Any] = {}
    assert isinstance(node, yaml.MappingNode)
    for i, (key, value) in enumerate(node.value):
        line = key.start_mark.line + 1
        if not isinstance(key, yaml.ScalarNode):
            raise _refused(file, line, "found a list or group as a key, needed a word")
        _check_surrogates(key, file)
        if (
            key.value[:1] == "<" and key.value[-1:] == ">"
        ):  # such a name of a field is no key of any file (`fields.in_brackets`)
            raise _refused(file, line, f"found the unknown key '{shorten(key.value)}', needed one without brackets")
        here = (*path, key.value)
        before, whole = node.value[max(i - 1, 0)]
        is_number = bool(node.flow_style) and key.value[:1].isdigit() and key.style is None
        if is_number and i and isinstance(whole, yaml.ScalarNode):
            # In braces, {mass: 0,5 g +/- 0,1 g} has the keys "mass", "5 g +/- 0" and "1 g"
            rest = takewhile(lambda text: text[:1].isdigit(), (str(after.value) for after, _ in node.value[i:]))
            parts = [whole.value, *rest]
            found = f"found a comma inside '{','.join(parts)}', needed a decimal point"
            where = key_text((*path, before.value))
            raise _refused(file, line, f"{where}: {found}; write '{'.'.join(parts)}'")
        if key.value in data:
            found = f"found this key twice (first on line {lines[here]})"
            raise _refused(file, line, f"{key_text(here)}: {found}, needed it once; delete one")
        lines[here] = line
        data[key.value] = _plain(value, here, lines, file)
    return data


def _check_surrogates(node: yaml.ScalarNode, file: str) -> None:
    r"""Refuse lone surrogates, which YAML can write as "\ud800": text with one cannot be written to a UTF-8 file."""
    surrogate = next((c for c in node.value if "\ud800" <= c <= "\udfff"), None)
    if surrogate is not None:
        message = f"found {surrogate!a}, which is half a character, needed text; delete it"
        raise _refused(file, node.start_mark.line + 1, message)


def _yaml_error(error: yaml.MarkedYAMLError, file: str, text: str) -> ScenarioError:
    """Return PyYAML's error for the author of the file."""
    mark = error.problem_mark or error.context_mark
    line = mark.line + 1 if mark else None
    problem = " ".join((error.problem or error.context or "no YAML").split())
    if "'\\t'" in problem:
        return _refused(file, line, "found a tab, needed spaces; indent with spaces")
    if "another document" in problem or "single document" in str(error.context):
        return _refused(file, line, "found a second document ('---'), needed one scenario per file")
    advice = "check the indentation, the quotes and brackets, and that a space follows each colon"
    if mark and any(" #" in each for each in text.splitlines()[(error.context_mark or mark).line : mark.line + 1]):
        advice = f"{advice}; {QUOTE_COMMENT_SIGN}"
    return _refused(file, line, f"found no readable YAML ({problem}), needed 'key: value' lines; {advice}")


class _Dumper(yaml.SafeDumper):
    """PyYAML's dumper, but with unprintable text in double quotes.

    Outside them it writes some line breaks that YAML folds on reading, so that the text would change.
    """


def _text_node(dumper: yaml.SafeDumper, text: str) -> yaml.Node:
    """Return the YAML node of a text."""
    unprintable = not text.replace("\n", " ").isprintable()
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style='"' if unprintable else None)


_Dumper.add_representer(str, _text_node)


def to_yaml(keys: Mapping[str, Any]) -> str:
    """Return nested keys and texts as YAML."""
    return str(yaml.dump(keys, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=100))
