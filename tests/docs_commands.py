"""Commands that the documentation shows."""

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

PROJECT = Path(__file__).parents[1]
FENCED = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
PROGRAM = "looping-pendulum"


@dataclass(frozen=True, kw_only=True)
class Command:
    """One line."""

    page: str
    """Path from the project's folder."""
    text: str
    arguments: tuple[str, ...]
    output: str | None = None
    """File that the shell writes what is printed to."""


def pages() -> list[Path]:
    """Every page that a reader sees."""
    example = PROJECT / "looping_pendulum" / "teaching" / "example" / "README.md"
    return [PROJECT / "README.md", *sorted((PROJECT / "docs").rglob("*.md")), example]


def commands() -> list[Command]:
    """Commands in the fenced blocks of all pages, in order; a remark after two blanks or a # is no part of one."""
    result = []
    for page in pages():
        for _, block in FENCED.findall(page.read_text(encoding="utf-8")):
            for line in block.splitlines():
                if line.startswith(f"{PROGRAM} "):
                    result.append(_command(page, line))
    return result


def _command(page: Path, line: str) -> Command:
    text = re.split(r" {2,}|\s#", line)[0].strip()
    words = shlex.split(text)[1:]
    output = None
    if ">" in words:
        place = words.index(">")
        output, words = words[place + 1], words[:place]
    return Command(page=page.relative_to(PROJECT).as_posix(), text=text, arguments=tuple(words), output=output)
