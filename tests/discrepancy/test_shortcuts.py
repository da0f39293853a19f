"""Shortcuts of a fit change no result: parameters that are only partly checked."""

import dataclasses
import math

import pytest

from looping_pendulum.errors import ParameterError
from looping_pendulum.reference_ode.effects import COEFFICIENTS
from looping_pendulum.reference_ode.parameters import Parameters, Release
from tests.apparatus import TEN_TO_ONE

FIELDS = [f.name for f in dataclasses.fields(Parameters) if f.name not in ("release", "coefficients", "own_effects")]


def made_by_constructor(base, **changes):
    """The same parameters by the constructor, which checks everything."""
    data = {f.name: getattr(base, f.name) for f in dataclasses.fields(Parameters)}
    given = {n: v for n, v in base.coefficients.items() if n != "static_friction" or not base.static_equals_kinetic}
    given |= {n: changes.pop(n) for n in list(changes) if n in COEFFICIENTS}
    return Parameters(**(data | changes | {"coefficients": given}))


@pytest.mark.parametrize("name", [*FIELDS, *COEFFICIENTS])
@pytest.mark.parametrize("release", Release)
def test_a_copy_with_another_number_is_what_the_constructor_makes(name, release):
    base = TEN_TO_ONE.replace(release=release)
    if name in COEFFICIENTS:
        low, high = COEFFICIENTS[name].bounds
        value = max(low + 0.3 * (high - low), base.coefficients["kinetic_friction"] if name == "static_friction" else low)
    else:
        value = 1.01 * getattr(base, name) or 1e-3
    assert base.effects  # what is remembered of the base must not reach the copy
    copy, constructed = base.replace(**{name: value}), made_by_constructor(base, **{name: value})
    assert copy == constructed
    assert copy.effects == constructed.effects
    assert vars(copy.values()) == vars(constructed.values())
    back = getattr(base, name) if name not in COEFFICIENTS else base.coefficients[name]
    restored = copy.replace(**{name: back})
    assert restored.effects == base.effects
    if name != "static_friction":  # given by itself, it does not follow any more
        assert restored == base


@pytest.mark.parametrize(
    "changes",
    [
        {"light_mass": -1.0},
        {"free_length": math.nan},
        {"release_angle": 7.0},
        {"light_drag": 2.0},
        {"light_drag": math.inf},
        {"kinetic_friction": 0.5, "static_friction": 0.4},
        {"rod_mobility": 1.0, "string_compliance": 1e-3},
        {"light_radius": 10.0},
    ],
)
def test_a_copy_that_cannot_be_is_refused_as_by_the_constructor(changes):
    with pytest.raises(ParameterError) as by_constructor:
        made_by_constructor(TEN_TO_ONE, **changes)
    with pytest.raises(ParameterError) as by_copy:
        TEN_TO_ONE.replace(**changes)
    assert str(by_copy.value) == str(by_constructor.value)
