"""Expressions that are printed as JavaScript, in the order in which they were built: the same operations in the same order."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

from looping_pendulum.reference_ode.core.expressions import FUNCTIONS, Expression, ExpressionGraph

MAX_INLINE_LENGTH = 88
"""Longest text of an expression that is written where it is used, if it is used once; a longer one gets a name."""
# As in JavaScript; what binds tighter has the larger number
_TERNARY, _OR, _AND, _EQUALITY, _COMPARISON, _SUM, _PRODUCT, _UNARY, _ATOM = range(9)
_BINARY = {
    "||": _OR,
    "&&": _AND,
    "==": _EQUALITY,
    "<": _COMPARISON,
    "<=": _COMPARISON,
    ">": _COMPARISON,
    ">=": _COMPARISON,
    "+": _SUM,
    "-": _SUM,
    "*": _PRODUCT,
    "/": _PRODUCT,
}


class PrintedGraph(ExpressionGraph):
    """A graph whose expressions have a text in messages."""

    def shown(self, expression: Expression, spec: str) -> str:
        """Return the placeholder of a JavaScript template that shows the value as Python's ``:g`` does."""
        if spec != "g":
            raise TypeError(f"format: found {spec!r}, needed 'g'")
        return f"${{general({_Printer(()).text(expression, _TERNARY)})}}"


def written(outputs: Sequence[Any]) -> tuple[list[str], list[str]]:
    """Return the lines that define what ``outputs`` need, and the text of each output."""
    printer = _Printer(x for x in outputs if isinstance(x, Expression))
    return printer.definitions, [printer.text(x, _TERNARY) for x in outputs]


def literal(x: float) -> str:
    """Return a number, or whether something holds, as JavaScript."""
    if isinstance(x, bool):
        return str(x).lower()
    if math.isinf(x):
        return "Infinity" if x > 0 else "-Infinity"
    return str(int(x)) if x == int(x) and abs(x) < 1e15 and repr(float(x)) != "-0.0" else repr(float(x))


class _Printer:
    """Writes expressions; those that are used more than once, or are long, get a name."""

    def __init__(self, outputs: Iterable[Expression]) -> None:
        self.definitions: list[str] = []
        self._texts: dict[int, tuple[str, int]] = {}
        """Number of the node -> its text, and how tightly that binds."""
        uses: dict[int, int] = {}
        nodes: dict[int, Expression] = {}
        waiting = list(outputs)
        while waiting:
            node = waiting.pop()
            uses[node.number] = uses.get(node.number, 0) + 1
            if node.number not in nodes:
                nodes[node.number] = node
                waiting += [x for x in node.operands if isinstance(x, Expression)]
        for number in sorted(nodes):
            node = nodes[number]
            text, binding = self._operation(node)
            if node.operation != "symbol" and (uses[number] > 1 or len(text) > MAX_INLINE_LENGTH):
                name = f"a{len(self.definitions)}"
                self.definitions.append(f"const {name} = {text};")
                text, binding = name, _ATOM
            self._texts[number] = text, binding

    def text(self, x: Any, binding: int) -> str:
        """Return the text of ``x``, in parentheses if it binds less tightly than ``binding``."""
        if not isinstance(x, Expression):
            text, own = literal(x), _UNARY if x < 0 else _ATOM
        else:
            text, own = self._texts[x.number] if x.number in self._texts else self._operation(x)
        return text if own >= binding else f"({text})"

    def _operation(self, node: Expression) -> tuple[str, int]:
        operation, operands = node.operation, node.operands
        if operation == "symbol":
            return operands[0], _ATOM
        if operation == "neg":
            return f"-{self.text(operands[0], _ATOM)}", _UNARY
        if operation == "?:":
            condition, a, b = (self.text(x, _OR) for x in operands)
            return f"{condition} ? {a} : {b}", _TERNARY
        if operation in _BINARY:
            binding = _BINARY[operation]
            # Sums and products of doubles are not associative, so that only the left operand may go without parentheses
            left, right = self.text(operands[0], binding), self.text(operands[1], binding + 1)
            return f"{left} {'===' if operation == '==' else operation} {right}", binding
        if operation not in (*FUNCTIONS, "abs"):
            raise ValueError(f"operation: found {operation!r}, which has no JavaScript")
        return f"Math.{operation}({self.text(operands[0], _TERNARY)})", _ATOM
