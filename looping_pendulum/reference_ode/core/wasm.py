"""Writes graphs of expressions as a WebAssembly module (https://webassembly.github.io/spec/core/binary)."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from typing import Any

from looping_pendulum.reference_ode.core.expressions import Expression

IMPORTED = ("exp", "log", "sin", "cos", "tanh")
"""Functions that WebAssembly does not have: the driver brings them, so that they round alike on every machine."""
_I32, _F64 = 0x7F, 0x7C
_BINARY = {
    "+": 0xA0, "-": 0xA1, "*": 0xA2, "/": 0xA3,
    "==": 0x61, "<": 0x63, ">": 0x64, "<=": 0x65, ">=": 0x66, "&&": 0x71, "||": 0x72,
}  # fmt: skip
_UNARY = {"abs": 0x99, "neg": 0x9A, "sqrt": 0x9F}
_CONDITIONS = frozenset({"==", "<", ">", "<=", ">=", "&&", "||"})
_LOCAL_GET, _LOCAL_SET, _CALL, _SELECT, _LOAD, _STORE, _END = 0x20, 0x21, 0x10, 0x1B, 0x2B, 0x39, 0x0B
_I32_CONST, _F64_CONST, _F64_FROM_I32 = 0x41, 0x44, 0xB8
# Arguments of every function of a model: (t: f64, y, s, p, out: addresses)
_ARGUMENTS = {"t": 0, "y": 1, "s": 2, "p": 3}
_OUT, _FIRST_LOCAL = 4, 5


def module(functions: Iterable[Sequence[Any]]) -> bytes:
    """Return the module of functions, each given by its outputs, which it stores one after another.

    Inputs are symbols ``t``, ``y0``, ``y1`` ..., ``s0`` ... and ``p0`` .... The module puts its functions into the table that
    it imports, from the place that it imports as ``first`` on.
    """
    written = [_function(outputs) for outputs in functions]
    # What ends a run, and much else, is the same in several modes
    bodies = list(dict.fromkeys(written))
    places = {body: len(IMPORTED) + i for i, body in enumerate(bodies)}
    types = [
        b"\x60" + _vector([bytes([kind]) for kind in (_F64, _I32, _I32, _I32, _I32)]) + _vector([]),
        b"\x60" + _vector([bytes([_F64])]) + _vector([bytes([_F64])]),
    ]
    imports = [_name("m") + _name(f) + b"\x00" + _unsigned(1) for f in IMPORTED]
    imports += [_name("m") + _name("memory") + b"\x02\x00" + _unsigned(1)]
    imports += [_name("m") + _name("table") + b"\x01\x70\x00" + _unsigned(1)]
    imports += [_name("m") + _name("first") + b"\x03" + bytes([_I32]) + b"\x00"]
    elements = _vector([_unsigned(places[body]) for body in written])
    placed = b"\x00\x23" + _unsigned(0) + bytes([_END]) + elements  # at the value of the global `first`
    sections = {1: _vector(types), 2: _vector(imports), 3: _vector([_unsigned(0)] * len(bodies)), 9: _vector([placed])}
    sections |= {10: _vector([_unsigned(len(body)) + body for body in bodies])}
    return b"\0asm\x01\0\0\0" + b"".join(bytes([n]) + _unsigned(len(body)) + body for n, body in sections.items())


def _function(outputs: Sequence[Any]) -> bytes:
    """Return the locals and the code of a function."""
    writer = _Writer()
    nodes, uses = _nodes_of(outputs)
    code = bytearray()
    for number in sorted(nodes):
        node = nodes[number]
        if uses[number] > 1:
            code += writer.code(node) + bytes([_LOCAL_SET]) + _unsigned(writer.keep(node))
    for i, x in enumerate(outputs):
        code += bytes([_LOCAL_GET, _OUT]) + writer.number(x) + bytes([_STORE, 3]) + _unsigned(8 * i)
    groups = [_unsigned(len(list(same))) + bytes([kind]) for kind, same in groupby(writer.kinds)]
    return _vector(groups) + bytes(code) + bytes([_END])


class _Writer:
    """Writes expressions as code that leaves their value on the stack; kept nodes are read from their locals."""

    def __init__(self) -> None:
        self.kinds: list[int] = []
        self._locals: dict[int, int] = {}

    def keep(self, node: Expression) -> int:
        """Return the local in which the value of ``node`` is kept from here on."""
        self._locals[node.number] = _FIRST_LOCAL + len(self.kinds)
        self.kinds.append(_I32 if _is_condition(node) else _F64)
        return self._locals[node.number]

    def number(self, x: Any) -> bytes:
        """Return the code of an f64; a condition is 1 where it holds, else 0."""
        return self.code(x) + (bytes([_F64_FROM_I32]) if _is_condition(x) else b"")

    def code(self, x: Any) -> bytes:
        """Return the code of a number or an expression."""
        if isinstance(x, bool):
            return bytes([_I32_CONST, int(x)])
        if not isinstance(x, Expression):
            return bytes([_F64_CONST]) + struct.pack("<d", float(x))
        if x.number in self._locals:
            return bytes([_LOCAL_GET]) + _unsigned(self._locals[x.number])
        operation, operands = x.operation, x.operands
        if operation == "symbol":
            (name,) = operands
            read = bytes([_LOCAL_GET, _ARGUMENTS[name[0]]])
            return read if name == "t" else read + bytes([_LOAD, 3]) + _unsigned(8 * int(name[1:]))
        if operation == "?:":
            condition, a, b = operands
            both = self.code if _is_condition(x) else self.number
            return both(a) + both(b) + self.code(condition) + bytes([_SELECT])
        code = b"".join(map(self.code, operands))
        if operation in IMPORTED:
            return code + bytes([_CALL]) + _unsigned(IMPORTED.index(operation))
        return code + bytes([_UNARY[operation] if operation in _UNARY else _BINARY[operation]])


def _is_condition(x: Any) -> bool:
    if not isinstance(x, Expression):
        return isinstance(x, bool)
    return x.operation in _CONDITIONS or (x.operation == "?:" and all(map(_is_condition, x.operands[1:])))


def _nodes_of(outputs: Sequence[Any]) -> tuple[dict[int, Expression], dict[int, int]]:
    """Return the nodes that ``outputs`` need, by number, and how often each is used."""
    nodes: dict[int, Expression] = {}
    uses: dict[int, int] = {}
    waiting = [x for x in outputs if isinstance(x, Expression)]
    while waiting:
        node = waiting.pop()
        uses[node.number] = uses.get(node.number, 0) + 1
        if node.number not in nodes:
            nodes[node.number] = node
            waiting += [x for x in node.operands if isinstance(x, Expression)]
    return nodes, uses


def _unsigned(n: int) -> bytes:
    """Return a whole number as LEB128, as WebAssembly has them."""
    return bytes(_groups_of_seven_bits(n))


def _groups_of_seven_bits(n: int) -> Iterator[int]:
    while n > 0x7F:
        yield n & 0x7F | 0x80
        n >>= 7
    yield n


def _vector(items: Sequence[bytes]) -> bytes:
    return _unsigned(len(items)) + b"".join(items)


def _name(text: str) -> bytes:
    return _unsigned(len(text)) + text.encode()
