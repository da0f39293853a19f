"""Formulas as a user writes them, ``"-k * across_speed * exp(-time / 0.2)"``, checked and evaluated without Python's ``eval``.

A formula is parsed by Python's `ast`, and only the few kinds of node below are taken over: whatever else stands in the text,
a call of another function, an attribute, a comparison, is refused before anything of it is evaluated.
"""

from __future__ import annotations

import ast
import difflib
import math
import operator
import warnings
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any

from looping_pendulum.errors import HarnessError, shorten

FUNCTIONS = ("sin", "cos", "exp", "log", "sqrt", "tanh")
"""Functions of one argument that a formula may call: analytic ones that every math namespace of the equations has."""
CONSTANTS = MappingProxyType({"pi": math.pi})
"""Numbers that a formula may name."""
OPERATORS: Mapping[type[ast.operator], Callable[[Any, Any], Any]] = MappingProxyType(
    {ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv}
)
"""Operators between two terms; powers are repeated products."""
MAX_LENGTH = 500
"""Longest formula that is read [characters]."""
MAX_DEPTH = 40
"""Largest number of operations inside one another; Python itself allows many more."""
MAX_POWER = 12
"""Largest whole number that may stand behind ``**``."""

Values = Mapping[str, Any]
"""Name in a formula -> number, array or expression."""
_Evaluate = Callable[[Any, Values], Any]


class FormulaError(HarnessError, ValueError):
    """A text is not a formula that can be evaluated; the message says what was found and what was needed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ParsedFormula:
    """A formula that has been checked."""

    text: str
    names: frozenset[str]
    """Names of the quantities that it depends on."""
    evaluate: _Evaluate

    def __call__(self, xp: Any, values: Values) -> Any:
        """Return its value, with the functions of the math namespace ``xp`` and the ``values`` of its names."""
        return self.evaluate(xp, values)


def parse(text: str, known: Collection[str]) -> ParsedFormula:
    """Check a formula whose names must be among ``known``.

    Raises
    ------
    FormulaError
        If the text is no formula.
    """
    if len(text) > MAX_LENGTH:
        raise FormulaError(f"found a formula of {len(text)} characters, needed at most {MAX_LENGTH}")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # what Python doubts, as '1if', is no formula; the warning becomes a SyntaxError
            tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise FormulaError(f"found {shorten(text)!r}, needed a formula; write for example '-2 * k * time'") from None
    used: set[str] = set()
    evaluate = _built(tree, text.strip(), known, used, 0)
    return ParsedFormula(text=" ".join(text.split()), names=frozenset(used), evaluate=evaluate)


def _built(node: ast.expr, text: str, known: Collection[str], used: set[str], depth: int) -> _Evaluate:
    """Return the function that evaluates ``node``; the names that it reads are added to ``used``."""
    if depth > MAX_DEPTH:
        raise FormulaError(f"found more than {MAX_DEPTH} operations inside one another, needed fewer; write it shorter")

    def built(inner: ast.expr) -> _Evaluate:
        return _built(inner, text, known, used, depth + 1)

    match node:
        # bool is a kind of int in Python, and True is no number in a formula
        case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
            number = _finite(value, text)
            return lambda xp, values: number
        case ast.Name(id=name) if name in CONSTANTS:
            return lambda xp, values: CONSTANTS[name]
        case ast.Name(id=name) if name in known:
            used.add(name)
            return lambda xp, values: values[name]
        case ast.Name(id=name):
            near = difflib.get_close_matches(name, known, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise FormulaError(f"found {shorten(name)!r}, needed one of: {', '.join(known)}{hint}")
        case ast.UnaryOp(op=ast.UAdd() | ast.USub() as sign, operand=operand):
            inside = built(operand)
            return inside if isinstance(sign, ast.UAdd) else lambda xp, values: -inside(xp, values)
        case ast.BinOp(op=ast.Pow(), left=base, right=exponent):
            return partial(_power, built(base), _whole_number(exponent, text))
        case ast.BinOp(op=op, left=left, right=right) if type(op) in OPERATORS:
            operate, a, b = OPERATORS[type(op)], built(left), built(right)
            return lambda xp, values: operate(a(xp, values), b(xp, values))
        case ast.Call(func=ast.Name(id=function), args=[argument], keywords=[]) if function in FUNCTIONS:
            return partial(_call, function, built(argument))
    raise FormulaError(
        f"found {shorten(_source(node, text))!r}, needed numbers, names, + - * / **, brackets and the functions "
        f"{', '.join(FUNCTIONS)} of one argument"
    )


def _source(node: ast.expr, text: str) -> str:
    return ast.get_source_segment(text, node) or text


def _finite(value: int | float, text: str) -> float:
    """Return a number as a float, so that integers grow no larger than floats do."""
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise FormulaError(f"found a number that is too large in {shorten(text)!r}, needed finite ones")
    return number


def _whole_number(node: ast.expr, text: str) -> int:
    """Return the exponent of a power, a whole number that is written out."""
    sign = -1 if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) else 1
    inner = node.operand if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd) else node
    value = inner.value if isinstance(inner, ast.Constant) else None
    if isinstance(value, int) and not isinstance(value, bool) and value <= MAX_POWER:
        return sign * value
    raise FormulaError(
        f"found the exponent {shorten(_source(node, text))!r}, needed a whole number up to {MAX_POWER}; write other "
        "powers with sqrt(), or as exp(a * log(x))"
    )


def _power(base: _Evaluate, exponent: int, xp: Any, values: Values) -> Any:
    """Return a power as repeated products, which every kind of number has, and which are never complex."""
    x = base(xp, values)
    power = x if exponent else 1.0
    for _ in range(abs(exponent) - 1):
        power = power * x
    return 1.0 / power if exponent < 0 else power


def _call(function: str, argument: _Evaluate, xp: Any, values: Values) -> Any:
    x = argument(xp, values)
    # Some quantities are numbers in some modes, and not the functions of every namespace take numbers
    return getattr(math if isinstance(x, int | float) else xp, function)(x)
