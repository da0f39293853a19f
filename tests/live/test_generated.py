"""The generated JavaScript: it is what the generator writes, and calculates what the same formulas do in Python."""

import math
from importlib.resources import files
from types import SimpleNamespace

import numpy as np
import pytest

from looping_pendulum.live.expressions import written
from looping_pendulum.live.generate import model_source
from looping_pendulum.live.symbols import MODES, SIGNS, STATE
from looping_pendulum.live.write import render
from looping_pendulum.reference_ode.core.expressions import ExpressionGraph, ExpressionMath
from looping_pendulum.reference_ode.equations import Equations
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.reference_ode.state import Signs, full_state, variables
from looping_pendulum.reference_ode.transitions import Mode
from scripts.live_page import PAGE
from tests.apparatus import TEN_TO_ONE
from tests.live.cases import OF_FURTHER_EFFECTS

FOLDER = files("looping_pendulum.live")


def test_the_file_is_what_the_generator_writes():
    assert (FOLDER / "model.js").read_text(encoding="utf-8") == model_source(), "run `python -m looping_pendulum.live.generate`"


def test_the_page_that_is_shipped_is_what_the_package_writes():
    assert PAGE.read_text(encoding="utf-8") == render(), "run `python -m scripts.live_page`"


@pytest.mark.parametrize("effect", ["", *OF_FURTHER_EFFECTS])
def test_equations_are_those_of_the_reference(node, effect):
    # With each further effect alone, and with signs that are not those of the speeds, as in a step that passes an event
    rng = np.random.default_rng(1)
    changes = {effect: OF_FURTHER_EFFECTS[effect][1]} if effect else {}
    instants, expected = [], []
    for mode in MODES:
        release = Release.DROP if mode is Mode.FALLING else Release.LOOPING
        p = TEN_TO_ONE.replace(release=release, static_friction=0.4, **changes)
        equations = Equations(math, p.values(), p.effects)
        for _ in range(5):
            values = dict(zip(STATE, rng.uniform(0.1, 2.0, len(STATE)) * (1, 5, -1, 1, -1, 0.1), strict=True))
            names = variables(mode, p.effects)
            y = full_state(mode, **{name: values[name] for name in names})
            signs = Signs(*rng.choice([-1.0, 1.0], 3), phase=float(rng.integers(2)))
            numbers = {name: value for name, value in vars(p.values()).items() if isinstance(value, float)}
            instants.append(
                {
                    "mode": mode.value,
                    "p": numbers,
                    "t": 0.1,
                    "z": [getattr(y, name) for name in names],
                    "y": y[: len(STATE)],
                    "signs": dict(zip(SIGNS, signs, strict=False)),
                }
            )
            rates = equations.rates(mode, 0.1, y, signs)
            functions = equations.event_functions(mode, 0.1, y, signs)
            expected.append(
                {
                    "integrated": [STATE.index(name) for name in names],
                    "rates": [getattr(rates, name) for name in names],
                    "events": list(functions.values()),
                    "tensions": list(equations.tensions(mode, 0.1, y, signs)),
                }
            )
    for result, reference in zip(node("equations.mjs", instants), expected, strict=True):
        assert result["integrated"] == reference["integrated"]
        for what in ("rates", "events", "tensions"):
            # Only the last digits of sines and exponentials may differ, and what is lost where terms cancel
            np.testing.assert_allclose(result[what], reference[what], rtol=1e-11, atol=1e-13, err_msg=what)


FORMULAS = {
    "right operands keep their parentheses": lambda xp, x, y: x - (y - x) - (x - y) / (y / x) - x * (y * x),
    "signs": lambda xp, x, y: -(x - y) - -1.5 * y - abs(-x),
    "powers": lambda xp, x, y: (x + y) ** 2 - (x * y) ** 0.5,
    "functions": lambda xp, x, y: xp.sqrt(x) * xp.sqrt(y + x),
    "terms without effect": lambda xp, x, y: 0.0 * y + 1.0 * x - 0.0 + x / 1.0 + 0.0 / y,
    "small and large numbers": lambda xp, x, y: x * 1e-300 + y * 1e20 + x * 1e300,
    "shared": lambda xp, x, y: (x + y) * (x + y) + (x + y),
}


@pytest.mark.parametrize("formula", FORMULAS.values(), ids=FORMULAS.keys())
def test_printed_formulas_have_the_bits_of_python(node, formula):
    graph = ExpressionGraph()
    lines, (text,) = written([formula(ExpressionMath(graph), graph.symbol("x"), graph.symbol("y"))])
    body = "\n".join([*lines, f"return {text};"])
    points = np.random.default_rng(2).uniform(0.1, 10.0, (20, 2)).tolist()
    results = node("evaluate.mjs", [[body, *point] for point in points])
    # These operations are exactly rounded in both languages
    assert results == [formula(math, *point) for point in points]


CHOICES = {
    "less": lambda s, x, y: s.where(x < y, x, y),
    "nested": lambda s, x, y: s.where((x < 1) | (x > 5), s.where(y < 5, 1, 2), s.where((y >= 3) & (x <= 4), 3.5, -x)),
    "mode": lambda s, x, y: s.where(s.where(x < y, Mode.SLACK, Mode.STICKING) == Mode.SLACK, x, 2 * y),
    "either mode": lambda s, x, y: s.where((s.where(x < y, 1, 2) == 1) | (s.where(x < 3, 1, 2) == 1), 1.0, 0.0),
}


@pytest.mark.parametrize("choice", CHOICES.values(), ids=CHOICES.keys())
def test_printed_choices_are_those_of_python(node, choice):
    graph = ExpressionGraph()
    lines, (text,) = written([choice(graph, graph.symbol("x"), graph.symbol("y"))])
    body = "\n".join([*lines, f"return {text};"])
    points = np.random.default_rng(3).uniform(0.0, 6.0, (40, 2)).tolist()
    numbers = SimpleNamespace(where=lambda condition, a, b: a if condition else b)
    results = node("evaluate.mjs", [[body, *point] for point in points])
    expected = [choice(numbers, *point) for point in points]
    assert results == expected
    assert len(set(expected)) > 1


def test_an_expression_refuses_to_be_decided_by_if():
    x = ExpressionGraph().symbol("x")
    with pytest.raises(TypeError, match="by `where`, not by `if`"):
        bool(x < 1)
