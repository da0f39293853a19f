"""Effects of a study's own: formulas are checked and give the right numbers, and travel with the parameters."""

import dataclasses
import json
import math
import pickle

import numpy as np
import pytest
import sympy

from looping_pendulum.errors import ParameterError
from looping_pendulum.reference_ode.batch import solve_batch
from looping_pendulum.reference_ode.effects import COEFFICIENTS, EFFECTS, EffectKind, own
from looping_pendulum.reference_ode.effects.formula import MAX_LENGTH, FormulaError, parse
from looping_pendulum.reference_ode.effects.own import RESERVED, OwnEffect, effect_of, multiplied_coefficient
from looping_pendulum.reference_ode.parameters import Parameters, parameters_from
from looping_pendulum.reference_ode.sensitivity import solve_sensitivities
from looping_pendulum.reference_ode.solve import solve, solve_at
from tests.apparatus import TEN_TO_ONE
from tests.oracles import scipy_runs
from tests.oracles.agreement import assert_same_run


def effect(name="k", bounds=(-1.0, 1.0), unit="N", **force):
    return OwnEffect(name=name, unit=unit, bounds=bounds, force=tuple(force.items()))


def with_effect(made, value):
    return Parameters(**{**TEN_TO_ONE.as_dict(), "own_effects": (made,)}).replace(**{made.name: value})


EVERYTHING = effect(
    light_along_string="k * 0.02 * tanh(across_speed) * log(1 + free_length)",
    light_vertical="-k * 0.01 * sin(wrap_angle) * cos(light_x)**2",
    heavy_vertical="-k * 0.1 * tanh(heavy_speed) * exp(-time) / sqrt(1 + light_y**2)",
)
"""A force with every function that a formula may call."""


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2 + 3 * x", 3.5),
        ("-x**2", -0.25),  # as in Python and in print, the power binds more tightly than the sign
        ("x**-2", 4.0),
        ("x**0", 1.0),
        ("1 / (1 + x) / 2", 1 / 3),
        (
            "sqrt(x) * log(x) + tanh(sin(x)) - cos(pi * x) * exp(+x)",
            math.sqrt(0.5) * math.log(0.5) + math.tanh(math.sin(0.5)) - math.cos(math.pi / 2) * math.exp(0.5),
        ),
    ],
)
def test_a_formula_has_the_value_that_python_gives(text, value):
    formula = parse(text, ("x",))
    assert formula(math, {"x": 0.5}) == pytest.approx(value, abs=1e-15)
    assert formula(np, {"x": np.full(2, 0.5)}) == pytest.approx(np.full(2, value), abs=1e-15)
    assert float(sympy.sympify(formula(sympy, {"x": sympy.Symbol("x")})).subs("x", 0.5)) == pytest.approx(value, abs=1e-15)


@pytest.mark.parametrize(
    "text",
    [
        *("__import__('os').system('true')", "x.real", "x if x > 0 else 0", "abs(x)", "max(x, 0)", "[x]", "'a' * x", "True"),
        *("lambda: x", "x := 3", "f'{x}'", "x @ x", "x // 2", "x % 2", "not x", "x < 3", "sqrt(*x)", "sin(x, 2)", "sin(y=x)"),
        *("sin", "y", "x + 1j", "x\0", "x * (", "", "x ** 0.5", "x ** x", "x ** 99", "x ** True", "1e999 * x"),
        *(
            "9" * 400,
            "-" * 400 + "x",
            "(" * 230 + "x" + ")" * 230,
            "x" * (MAX_LENGTH + 1),
            "(x for x in x)",
            "x; x",
            "exp(exp)",
            "0x1for x in x",
        ),
    ],
)
def test_what_is_no_formula_is_refused_with_one_line(text):
    with pytest.raises(FormulaError, match="^found .*needed") as caught:
        parse(text, ("x",))
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 250


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (effect(heavy_vertical="1 + k"), "does not vanish where k is 0"),
        (effect(heavy_vertical="time"), "found 'time' without 'k', needed the coefficient in it"),
        (effect(heavy_vertical="k / time"), "found no finite value (float division by zero) at release"),
        (effect(heavy_vertical="k * log(light_x)"), "found no finite value"),
        (effect(heavy_vertical="k * heavy_sped"), "found 'heavy_sped', needed one of: k, time,"),
        (effect(unit="mN", heavy_vertical="k"), "found 'mN', needed an SI unit without a prefix"),
        (effect(bounds=(1.0, 2.0), heavy_vertical="k"), "needed both equal and within the bounds 1 to 2"),
        (effect(bounds=(0.0, math.inf), heavy_vertical="k"), "needed two finite ones in order"),
        (effect(sideways="k"), "found 'sideways', needed some of light_along_string"),
        (effect(), "found 'no force', needed some of"),
        *(
            (effect(name=n, heavy_vertical=n), "something else has")
            for n in ("wind", "wind_speed", "light_mass", "time", "sin")
        ),
        (effect(name="K", heavy_vertical="K"), "found the name 'K', needed small letters"),
    ],
)
def test_a_faulty_effect_is_refused(made, message):
    with pytest.raises(ParameterError) as caught:
        with_effect(made, 0.1)
    assert str(caught.value).startswith("own_effects: ")
    assert message in str(caught.value)


def test_two_effects_of_one_name_are_refused():
    twice = (effect(heavy_vertical="k"), effect(light_vertical="k"))
    with pytest.raises(ParameterError, match="found the name 'k', which something else has already"):
        Parameters(**{**TEN_TO_ONE.as_dict(), "own_effects": twice})


def test_no_effect_may_be_called_as_a_parameter():
    assert set(vars(TEN_TO_ONE.values())) <= RESERVED | {c.name for e in EFFECTS.values() for c in e.coefficients}


def test_parameters_take_their_effects_with_them():
    p = with_effect(EVERYTHING, 0.5)
    for copy in (pickle.loads(pickle.dumps(p)), parameters_from(json.loads(json.dumps(p.as_dict()))), p.replace(k=0.5)):
        assert copy == p
        assert copy.effects == p.effects  # the same objects, so that nothing is compiled twice
    assert p != with_effect(effect(heavy_vertical="k"), 0.5)
    assert p.replace(k=0.0).without_absent_own_effects() == TEN_TO_ONE
    assert "own_effects" not in TEN_TO_ONE.as_dict()


LINEAR_DRAG = effect("drag", (0.0, 1.0), "kg/s", light_along_velocity="-drag * light_mass_speed")
SIDE_FORCE = effect("side", light_horizontal="side")
SIDE_SPRING = effect("spring", unit="N/m", light_horizontal="spring * light_x")
WEIGHT = effect("weight", light_vertical="-weight", heavy_vertical="-10 * weight")
ACROSS = effect(
    "across", unit="kg/s", light_across_string="-across * across_speed", light_along_string="across * retreat_speed"
)
VELOCITY = effect("v", unit="kg/s", light_horizontal="-v * light_vx", light_vertical="-v * light_vy")


@pytest.mark.parametrize(
    ("made", "value", "listed", "bound"),
    [
        # Rounding the direction of the velocity off below 1 mm/s costs this much
        (LINEAR_DRAG, 2e-3, {"light_linear_drag": 2e-3}, 1e-6),
        (ACROSS, 2e-3, {"light_linear_drag": 2e-3}, 1e-9),
        (VELOCITY, 2e-3, {"light_linear_drag": 2e-3}, 1e-9),
        (SIDE_FORCE, 5e-3, {"side_force": 5e-3}, 1e-9),
        (SIDE_SPRING, 0.02, {"side_stiffness": 0.02}, 1e-9),
        (WEIGHT, 0.001 * TEN_TO_ONE.light_mass, {"gravity": TEN_TO_ONE.coefficients["gravity"] + 0.001}, 1e-9),
    ],
    ids=lambda value: value.name if isinstance(value, OwnEffect) else "",
)
def test_a_formula_moves_the_masses_as_the_effect_of_the_library_does(made, value, listed, bound):
    """Oracle: the effect of the library with the same force, each direction and coordinate once."""
    t = np.linspace(0.05, 0.7, 20)
    ours, theirs = (solve_at(p, t, duration=1.0).state for p in (with_effect(made, value), TEN_TO_ONE.replace(**listed)))
    for name in ("free_length", "wrap_angle"):
        np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), rtol=0, atol=bound)


def test_scipy_gives_the_same_motion():
    """Oracle: SciPy, which evaluates the formulas in floats."""
    p, t = with_effect(EVERYTHING, 0.5), np.linspace(0, 0.6, 61)
    assert_same_run(*(solver(p, t, duration=1.0) for solver in (solve_at, scipy_runs.solve_at)))


def test_batches_and_derivatives_give_the_same_motion():
    """Oracles: single runs, and their differences."""
    p, t = with_effect(EVERYTHING, 0.5), np.linspace(0.1, 0.6, 6)
    batch = solve_batch(p, {"k": np.array([0.5, 2.0, 0.0])})
    assert batch.halting_time[0] == pytest.approx(solve(p).halting_time, abs=1e-10)
    assert batch.halting_time[2] == pytest.approx(solve(TEN_TO_ONE).halting_time, abs=1e-10)
    assert math.isnan(batch.halting_time[1])  # beyond its bounds
    step = 1e-4
    ahead, behind = (solve_at(p.replace(k=0.5 + by), t, duration=1.0).state.free_length for by in (step, -step))
    exact = solve_sensitivities(p, t, ("k",), duration=1.0).state.free_length[0]
    np.testing.assert_allclose(exact, (ahead - behind) / (2 * step), rtol=1e-5)


def test_a_force_of_the_string_is_absent_without_one():
    assert effect_of(effect(light_along_string="k")).needs_string
    assert effect_of(effect(light_vertical="k * wrap_angle")).needs_string
    assert not effect_of(effect(light_vertical="k * light_vy")).needs_string


def test_an_effect_says_what_it_is():
    made = effect_of(EVERYTHING)
    assert made.acts_on == "both masses"
    assert set(made.depends_on) <= set(own.COORDINATES)
    assert made.depends_on[:3] == ("time", "light_x", "light_y")
    assert made.formula.startswith("light_along_string = k * 0.02 * tanh(across_speed)")


def test_what_an_effect_multiplies_is_found_from_its_terms():
    nulls = {name: c.null for name, c in COEFFICIENTS.items()}
    forms = (e for e in EFFECTS.values() if not e.in_base_model and e.kind is not EffectKind.CLOSURE)
    multiplied = {e.name: name for e in forms if (name := multiplied_coefficient(e, nulls))}
    assert multiplied == {
        "attitude_drag": "light_drag",
        "wind": "light_drag",
        "friction_per_speed": "kinetic_friction",
        "friction_per_wrap": "kinetic_friction",
    }
    divides = dataclasses.replace(EFFECTS["side_force"], force_on_heavy_mass=lambda xp, k, p: p.side_force / p.light_drag)
    assert not multiplied_coefficient(divides, nulls)
    # Beside a linear drag, wind does something without a quadratic one
    assert not multiplied_coefficient(EFFECTS["wind"], nulls | {"light_linear_drag": 1e-3})
