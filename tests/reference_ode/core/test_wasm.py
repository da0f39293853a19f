"""Functions written as WebAssembly: operations that round exactly have the bits that Python gives them."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
import wasmtime

from looping_pendulum.reference_ode.core import wasm
from looping_pendulum.reference_ode.core.expressions import ExpressionGraph, ExpressionMath
from looping_pendulum.reference_ode.transitions import Mode

P, OUT = 0, 64
"""Addresses of the inputs and of the outputs."""


def outputs_of(expressions, points):
    """Return what the function of ``expressions`` of p0 and p1 stores, for each of ``points``."""
    store = wasmtime.Store()
    f64 = wasmtime.ValType.f64()
    maths = [wasmtime.Func(store, wasmtime.FuncType([f64], [f64]), getattr(math, name)) for name in wasm.IMPORTED]
    memory = wasmtime.Memory(store, wasmtime.MemoryType(wasmtime.Limits(1, None)))
    table = wasmtime.Table(store, wasmtime.TableType(wasmtime.ValType.funcref(), wasmtime.Limits(3, None)), None)
    first = wasmtime.Global(store, wasmtime.GlobalType(wasmtime.ValType.i32(), False), wasmtime.Val.i32(2))
    module = wasmtime.Module(store.engine, wasm.module([expressions]))
    wasmtime.Instance(store, module, [*maths, memory, table, first])
    results = []
    for point in points:
        memory.write(store, np.array(point).tobytes(), P)
        table.get(store, 2)(store, 0.0, P, P, P, OUT)
        results.append(np.frombuffer(memory.read(store, OUT, OUT + 8 * len(expressions))).tolist())
    return results


FORMULAS = {
    "order of operations": lambda xp, x, y: x - (y - x) - (x - y) / (y / x) - x * (y * x),
    "signs": lambda xp, x, y: -(x - y) - -1.5 * y - abs(-x),
    "powers": lambda xp, x, y: (x + y) ** 2 - (x * y) ** 0.5,
    "functions": lambda xp, x, y: xp.sqrt(x) * xp.sqrt(y + x) + xp.exp(-x) * xp.log(y) - xp.sin(x) / xp.cos(y) + xp.tanh(x),
    "terms without effect": lambda xp, x, y: 0.0 * y + 1.0 * x - 0.0 + x / 1.0 + 0.0 / y,
    "small and large numbers": lambda xp, x, y: x * 1e-300 + y * 1e20 + x * 1e300,
    "shared": lambda xp, x, y: (x + y) * (x + y) + (x + y),
}


def test_formulas_have_the_bits_of_python():
    graph = ExpressionGraph()
    x, y = graph.symbol("p0"), graph.symbol("p1")
    points = np.random.default_rng(2).uniform(0.1, 10.0, (20, 2)).tolist()
    results = outputs_of([formula(ExpressionMath(graph), x, y) for formula in FORMULAS.values()], points)
    assert results == [[formula(math, *point) for formula in FORMULAS.values()] for point in points]


CHOICES = {
    "less": lambda s, x, y: s.where(x < y, x, y),
    "nested": lambda s, x, y: s.where((x < 1) | (x > 5), s.where(y < 5, 1, 2), s.where((y >= 3) & (x <= 4), 3.5, -x)),
    "mode": lambda s, x, y: s.where(s.where(x < y, Mode.SLACK, Mode.STICKING) == Mode.SLACK, x, 2 * y),
    "either mode": lambda s, x, y: s.where((s.where(x < y, 1, 2) == 1) | (s.where(x < 3, 1, 2) == 1), 1.0, 0.0),
    "a condition": lambda s, x, y: s.where(x < y, y < 3, x < 3),
}


def test_choices_are_those_of_python():
    graph = ExpressionGraph()
    x, y = graph.symbol("p0"), graph.symbol("p1")
    points = np.random.default_rng(3).uniform(0.0, 6.0, (40, 2)).tolist()
    results = outputs_of([choice(graph, x, y) for choice in CHOICES.values()], points)
    numbers = SimpleNamespace(where=lambda condition, a, b: a if condition else b)
    expected = [[choice(numbers, *point) for choice in CHOICES.values()] for point in points]
    assert results == expected
    assert all(len(set(values)) > 1 for values in zip(*expected, strict=True))


def test_an_expression_refuses_to_be_decided_by_if():
    x = ExpressionGraph().symbol("x")
    with pytest.raises(TypeError, match="by `where`, not by `if`"):
        bool(x < 1)
