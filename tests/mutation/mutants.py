"""Every mutant of a folder: where it is and what it changes. Cosmic Ray's operators, less those that prove nothing."""

import ast
import hashlib
import random
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator, operator_names

ARITHMETIC = frozenset({"Add", "Sub", "Mul", "Div", "FloorDiv", "Mod", "Pow"})
BITWISE = frozenset({"BitOr", "BitAnd", "BitXor", "RShift", "LShift"})
IDENTITY = frozenset({"Is", "IsNot"})


def is_telling(operator: str) -> bool:
    """Whether an operator's mutants say something about tests.

    Left out are a bitwise operator for an arithmetic one and a comparison of size for one of identity, which raise TypeError
    in the first test that passes, and those that need arguments (`VariableReplacer`, `VariableInserter`).
    """
    kind, _, change = operator.removeprefix("core/").partition("_")
    if kind.startswith("Variable"):
        return False
    before, _, after = change.partition("_")
    if kind == "ReplaceBinaryOperator":
        return {before, after} <= ARITHMETIC or {before, after} <= BITWISE
    if kind == "ReplaceComparisonOperator":
        return (before in IDENTITY) == (after in IDENTITY)
    return True


OPERATORS = tuple(name for name in operator_names() if is_telling(name))


@dataclass(frozen=True, order=True)
class Mutant:
    """One change of one file."""

    path: str
    """Below the project's folder, "looping_pendulum/compare/align.py"."""
    operator: str
    """Cosmic Ray's name, "core/NumberReplacer"."""
    occurrence: int
    """Which of the places that the operator can change, from 0."""
    line: int
    """Line of that place, from 1."""

    @property
    def key(self) -> str:
        """Name of the mutant as long as its file stays the same."""
        return f"{self.path} {self.operator} {self.occurrence}"


def all_mutants(root: Path, places: Iterable[str]) -> list[Mutant]:
    """Every mutant of the files and folders ``places`` below ``root``, in an order that depends on the files alone."""
    paths = {path for place in places for path in ([root / place] if place.endswith(".py") else (root / place).rglob("*.py"))}
    files = sorted(path.relative_to(root).as_posix() for path in paths)
    return [mutant for path in files for mutant in _of_file(root, path)]


def sample(mutants: list[Mutant], size: int | None, seed: int) -> list[Mutant]:
    """Draw ``size`` of ``mutants`` without replacement, each equally likely; a larger sample begins with the smaller one."""
    drawn = random.Random(seed).sample(mutants, len(mutants))
    return drawn[:size]


def _of_file(root: Path, path: str) -> Iterator[Mutant]:
    source = (root / path).read_text(encoding="utf-8")
    nodes = list(ast_nodes(get_ast(source)))
    places = _Places(source)
    for name in OPERATORS:
        operator = get_operator(name)()
        occurrence = 0
        for node in nodes:
            for start, end in operator.mutation_positions(node):
                if places.can_change(name, start, end):
                    yield Mutant(path=path, operator=name, occurrence=occurrence, line=start[0])
                occurrence += 1


class _Places:
    """Which places of a file hold code that runs: an annotation is text, and a ``*`` before a name is no product."""

    def __init__(self, source: str) -> None:
        tree = ast.parse(source)
        lines = source.splitlines(keepends=True)

        def character(line: int, byte: int) -> tuple[int, int]:
            return line, len(lines[line - 1].encode()[:byte].decode())

        def span(node: ast.expr) -> tuple[tuple[int, int], tuple[int, int]]:
            return character(node.lineno, node.col_offset), character(node.end_lineno or 0, node.end_col_offset or 0)

        annotations = [
            note
            for node in ast.walk(tree)
            for note in (getattr(node, "annotation", None), getattr(node, "returns", None))
            if note is not None
        ]
        self._annotations = [span(note) for note in annotations]
        self._gaps = [(span(n.left)[1], span(n.right)[0]) for n in ast.walk(tree) if isinstance(n, ast.BinOp)]

    def can_change(self, operator: str, start: tuple[int, int], end: tuple[int, int]) -> bool:
        if any(low <= start and end <= high for low, high in self._annotations):
            return False
        if operator.startswith("core/ReplaceBinaryOperator"):
            return any(low <= start and end <= high for low, high in self._gaps)
        return True


@cache
def source_hash(path: Path) -> str:
    """First 16 digits of a file's SHA-256."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


def mutated(root: Path, mutant: Mutant) -> str:
    """Text of the mutant's file."""
    source = (root / mutant.path).read_text(encoding="utf-8")
    text = mutate_code(source, get_operator(mutant.operator)(), mutant.occurrence)
    assert text is not None, f"{mutant.key}: Cosmic Ray changes nothing"
    return str(text)


def changed_lines(root: Path, mutant: Mutant) -> tuple[str, str]:
    """Return the changed line before and after, without its indentation."""
    before = (root / mutant.path).read_text(encoding="utf-8").splitlines()
    after = mutated(root, mutant).splitlines()
    if len(before) != len(after):  # a decorator that is gone
        return before[mutant.line - 1].strip(), "(removed)"
    place = next((i for i, pair in enumerate(zip(before, after, strict=True)) if pair[0] != pair[1]), mutant.line - 1)
    return before[place].strip(), after[place].strip()
