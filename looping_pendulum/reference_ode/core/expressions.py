"""Graphs of expressions: the numbers that the equations and the rules take when they are traced.

Python's operators and a math namespace (`ExpressionMath`) build a graph in which equal expressions are one node. What is
written from it does the same operations on doubles in the same order as Python.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

FUNCTIONS = ("exp", "log", "sin", "cos", "tanh", "sqrt")
"""Functions of one number that an expression may contain."""


class Expression:
    """A node of the graph: a symbol, or an operation on other nodes and numbers."""

    __slots__ = ("graph", "number", "operands", "operation")

    def __init__(self, graph: ExpressionGraph, operation: str, operands: tuple[Any, ...]) -> None:
        self.graph, self.operation, self.operands = graph, operation, operands
        self.number = len(graph.nodes)
        """Place in the order in which the graph was built."""

    def __add__(self, other: Any) -> Any:
        return self.graph.add(self, other)

    def __radd__(self, other: Any) -> Any:
        return self.graph.add(other, self)

    def __sub__(self, other: Any) -> Any:
        return self.graph.subtract(self, other)

    def __rsub__(self, other: Any) -> Any:
        return self.graph.subtract(other, self)

    def __mul__(self, other: Any) -> Any:
        return self.graph.multiply(self, other)

    def __rmul__(self, other: Any) -> Any:
        return self.graph.multiply(other, self)

    def __truediv__(self, other: Any) -> Any:
        return self.graph.divide(self, other)

    def __rtruediv__(self, other: Any) -> Any:
        return self.graph.divide(other, self)

    def __pow__(self, exponent: float) -> Any:
        if exponent == 2:
            return self * self
        if exponent == 0.5:
            return self.graph.node("sqrt", self)
        raise TypeError(f"exponent: found {exponent!r}, needed 2 or 0.5")

    def __neg__(self) -> Any:
        return self.graph.node("neg", self)

    def __abs__(self) -> Any:
        return self.graph.node("abs", self)

    def __lt__(self, other: Any) -> Any:
        return self.graph.node("<", self, other)

    def __le__(self, other: Any) -> Any:
        return self.graph.node("<=", self, other)

    def __gt__(self, other: Any) -> Any:
        return self.graph.node(">", self, other)

    def __ge__(self, other: Any) -> Any:
        return self.graph.node(">=", self, other)

    def __eq__(self, other: object) -> Any:
        return self.graph.equal(self, other)

    def __and__(self, other: Any) -> Any:
        return self.graph.both(self, other)

    __rand__ = __and__

    def __or__(self, other: Any) -> Any:
        return self.graph.either(self, other)

    __ror__ = __or__

    def __hash__(self) -> int:
        return id(self)

    def __bool__(self) -> bool:
        raise TypeError("an expression is neither true nor false: decide by `where`, not by `if`")

    def __format__(self, spec: str) -> str:
        return self.graph.shown(self, spec)


class ExpressionGraph:
    """Makes expressions; equal ones are the same object."""

    def __init__(self) -> None:
        self.nodes: dict[tuple[Any, ...], Expression] = {}

    def shown(self, expression: Expression, spec: str) -> str:
        """Return what stands for an expression in a text that shows its value; a graph that is printed has one."""
        raise TypeError(f"format: found {spec!r}, but expressions of this graph have no text")

    def symbol(self, name: str) -> Expression:
        """Return the symbol ``name``."""
        key = ("symbol", name)
        if key not in self.nodes:
            self.nodes[key] = Expression(self, "symbol", (name,))
        return self.nodes[key]

    def node(self, operation: str, *operands: Any) -> Expression:
        """Return ``operation`` on expressions and numbers."""
        # Expressions are told apart by number, as `==` between them is an expression, too; the sign tells -0.0 from 0.0
        key = (operation, *[x.number if x.__class__ is Expression else repr(_number(x)) for x in operands])
        found = self.nodes.get(key)
        if found is None:
            found = self.nodes[key] = Expression(self, operation, operands)
        return found

    # Terms of absent effects have a coefficient of exactly 0, so that these rules leave nothing of them
    def add(self, a: Any, b: Any) -> Any:
        """Return a + b."""
        if _is(a, 0):
            return b
        return a if _is(b, 0) else self.node("+", a, b)

    def subtract(self, a: Any, b: Any) -> Any:
        """Return a - b."""
        if _is(b, 0):
            return a
        return self.node("neg", b) if _is(a, 0) else self.node("-", a, b)

    def multiply(self, a: Any, b: Any) -> Any:
        """Return a b."""
        if _is(a, 0) or _is(b, 0):
            return 0.0
        if _is(a, 1):
            return b
        return a if _is(b, 1) else self.node("*", a, b)

    def divide(self, a: Any, b: Any) -> Any:
        """Return a / b."""
        if _is(a, 0):
            return 0.0
        return a if _is(b, 1) else self.node("/", a, b)

    def both(self, a: Any, b: Any) -> Any:
        """Return a and b."""
        for x, y in ((a, b), (b, a)):
            if isinstance(x, bool):
                return y if x else False
        return self.node("&&", a, b)

    def either(self, a: Any, b: Any) -> Any:
        """Return a or b."""
        for x, y in ((a, b), (b, a)):
            if isinstance(x, bool):
                return True if x else y
        return self.node("||", a, b)

    def equal(self, a: Expression, b: Any) -> Any:
        """Return whether a equals b; of a choice between constants, the condition under which it does."""
        if a.operation != "?:":
            return self.node("==", a, b)
        condition, *branches = a.operands
        return self.where(condition, *(x == b for x in branches))

    def where(self, condition: Any, a: Any, b: Any) -> Any:
        """Return a where ``condition`` holds, else b."""
        if isinstance(condition, bool):
            return a if condition else b
        if a is b or (not isinstance(a, Expression) and not isinstance(b, Expression) and repr(a) == repr(b)):
            return a
        if a is True and b is False:
            return condition
        return self.node("?:", condition, a, b)


class ExpressionMath:
    """Functions of numbers and expressions, as the equations ask a math namespace for them."""

    def __init__(self, graph: ExpressionGraph) -> None:
        self._graph = graph

    def __getattr__(self, name: str) -> Callable[[Any], Any]:
        if name not in FUNCTIONS:
            raise AttributeError(f"function: found {name!r}, needed one of {', '.join(FUNCTIONS)}")

        def function(x: Any) -> Any:
            return self._graph.node(name, x) if isinstance(x, Expression) else getattr(math, name)(x)

        return function


def possible_values(x: Any) -> tuple[Any, ...]:
    """Return the values among which an expression of nested choices chooses; of a number, itself."""
    if not isinstance(x, Expression):
        return (x,)
    if x.operation != "?:":
        raise TypeError(f"found {x.operation}, needed a choice between constants")
    _, a, b = x.operands
    return tuple(dict.fromkeys((*possible_values(a), *possible_values(b))))


def _number(x: Any) -> Any:
    return x if isinstance(x, bool) else int(x) if isinstance(x, int) else float(x)


def _is(x: Any, value: int) -> bool:
    return x.__class__ is not Expression and bool(x == value)
