"""Writes graphs of expressions as a WebAssembly module (https://webassembly.github.io/spec/core/binary)."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from functools import lru_cache
from itertools import groupby
from typing import Any

from looping_pendulum.reference_ode.core.expressions import Expression

IMPORTED = ("exp", "log", "sin", "cos", "tanh")
"""Functions that WebAssembly does not have: the driver brings them, so that they round alike on every machine."""
_I32, _F64 = 0x7F, 0x7C
_OPERATIONS = {
    "+": b"\xa0", "-": b"\xa1", "*": b"\xa2", "/": b"\xa3",
    "==": b"\x61", "<": b"\x63", ">": b"\x64", "<=": b"\x65", ">=": b"\x66", "&&": b"\x71", "||": b"\x72",
    "abs": b"\x99", "neg": b"\x9a", "sqrt": b"\x9f",
} | {name: bytes([0x10, i]) for i, name in enumerate(IMPORTED)}  # fmt: skip
"""Code of each operation; an imported function is called by its number."""
_CONDITIONS = frozenset({"==", "<", ">", "<=", ">=", "&&", "||"})
_LOCAL_GET, _LOCAL_SET, _SELECT, _END = b"\x20", b"\x21", b"\x1b", b"\x0b"
# Of numbers at multiples of 2^3 bytes
_LOAD, _STORE = b"\x2b\x03", b"\x39\x03"
_I32_CONST, _F64_CONST, _F64_FROM_I32 = b"\x41", b"\x44", b"\xb8"
# Arguments of every function of a model: (t: f64, y, s, p, out: addresses)
_ARGUMENTS = {"t": 0, "y": 1, "s": 2, "p": 3}
_OUT, _FIRST_LOCAL = 4, 5


def module(functions: Sequence[Sequence[Any]]) -> bytes:
    """Return the module of functions, each given by its outputs, which it stores one after another.

    Inputs are symbols ``t``, ``y0``, ``y1`` ..., ``s0`` ... and ``p0`` .... The module puts its functions into the table that
    it imports, from the place that it imports as ``first`` on.
    """
    # What ends a run, and much else, is the same in several modes: each is written once
    outputs_of = {tuple(map(_identity, outputs)): outputs for outputs in functions}
    body_of = {same: _function(outputs) for same, outputs in outputs_of.items()}
    written = [body_of[tuple(map(_identity, outputs))] for outputs in functions]
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
    placed = b"\x00\x23" + _unsigned(0) + _END + elements  # at the value of the global `first`
    sections = {1: _vector(types), 2: _vector(imports), 3: _vector([_unsigned(0)] * len(bodies)), 9: _vector([placed])}
    sections |= {10: _vector([_unsigned(len(body)) + body for body in bodies])}
    return b"\0asm\x01\0\0\0" + b"".join(bytes([n]) + _unsigned(len(body)) + body for n, body in sections.items())


def _function(outputs: Sequence[Any]) -> bytes:
    """Return the locals and the code of a function."""
    writer, (nodes, uses) = _Writer(), _nodes_of(outputs)
    for number in sorted(number for number, count in uses.items() if count > 1):
        writer.keep(nodes[number])
    for i, x in enumerate(outputs):
        writer.store(x, i)
    groups = [_unsigned(len(list(same))) + bytes([kind]) for kind, same in groupby(writer.kinds)]
    return _vector(groups) + bytes(writer.code) + _END


class _Writer:
    """Writes expressions as code that leaves their value on the stack; kept nodes are read from their locals."""

    def __init__(self) -> None:
        self.code = bytearray()
        self.kinds: list[int] = []
        self._locals: dict[int, bytes] = {}
        """Number of a kept node -> code that reads its local."""

    def keep(self, node: Expression) -> None:
        """Write ``node``, and keep its value in a local from here on."""
        self._write(node)
        place = _unsigned(_FIRST_LOCAL + len(self.kinds))
        self.kinds.append(_I32 if _is_condition(node) else _F64)
        self.code += _LOCAL_SET + place
        self._locals[node.number] = _LOCAL_GET + place

    def store(self, x: Any, place: int) -> None:
        """Write a number or an expression, and store it as the output at ``place``."""
        self.code += _LOCAL_GET + _unsigned(_OUT)
        self._write_number(x)
        self.code += _STORE + _unsigned(8 * place)

    def _write_number(self, x: Any) -> None:
        """Write an f64; a condition is 1 where it holds, else 0."""
        self._write(x)
        if _is_condition(x):
            self.code += _F64_FROM_I32

    def _write(self, x: Any) -> None:
        """Write a number or an expression."""
        if isinstance(x, bool):
            self.code += _I32_CONST + bytes([x])
            return
        if not isinstance(x, Expression):
            self.code += _F64_CONST + struct.pack("<d", float(x))
            return
        kept = self._locals.get(x.number)
        if kept is not None:
            self.code += kept
            return
        operation, operands = x.operation, x.operands
        if operation == "symbol":
            (name,) = operands
            self.code += _LOCAL_GET + _unsigned(_ARGUMENTS[name[0]])
            if name != "t":
                self.code += _LOAD + _unsigned(8 * int(name[1:]))
        elif operation == "?:":
            condition, a, b = operands
            write = self._write if _is_condition(x) else self._write_number
            write(a)
            write(b)
            self._write(condition)
            self.code += _SELECT
        else:
            for operand in operands:
                self._write(operand)
            self.code += _OPERATIONS[operation]


def _identity(x: Any) -> int | str:
    """Return what is the same for the same expression or number, and for no other."""
    # Not the expression itself, as `==` between two makes a third
    return id(x) if isinstance(x, Expression) else repr(x)


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
        number = node.number
        if number in uses:
            uses[number] += 1
        else:
            nodes[number], uses[number] = node, 1
            waiting += [x for x in node.operands if isinstance(x, Expression)]
    return nodes, uses


@lru_cache(maxsize=1024)
def _unsigned(n: int) -> bytes:
    """Return a whole number as LEB128, as WebAssembly has them."""
    return bytes([n]) if n <= 0x7F else bytes([n & 0x7F | 0x80]) + _unsigned(n >> 7)


def _vector(items: Sequence[bytes]) -> bytes:
    return _unsigned(len(items)) + b"".join(items)


def _name(text: str) -> bytes:
    return _unsigned(len(text)) + text.encode()
