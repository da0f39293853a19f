"""Shortcuts of a fit change no result: parameters that are only partly checked, runs that are only partly sampled."""

import dataclasses
import math

import numpy as np
import pytest

from looping_pendulum.compare.landmarks import EVENT_QUANTITIES
from looping_pendulum.discrepancy.fit import event_prediction as prediction
from looping_pendulum.errors import ParameterError
from looping_pendulum.measured.camera import Camera
from looping_pendulum.measured.observations import EventObservation
from looping_pendulum.reference_ode.effects import COEFFICIENTS
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.scenarios import loader
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


def row(quantity, index=1, value=0.0):
    return EventObservation(quantity=quantity, index=index, value=value, sigma=0.01, unit=EVENT_QUANTITIES[quantity].unit)


@pytest.mark.parametrize("name", ["ten_to_one", "two_to_one"])
def test_a_run_that_is_sampled_in_part_tells_of_the_same_events(name):
    parameters = loader.load(name).parameters
    whole = prediction.run_for_events(parameters)
    count = len(prediction.landmarks(whole, Camera()).x1_extrema)
    rows = [row("x1_extremum", i) for i in range(1, count + 2)] + [row("halting_time"), row("drop_at_halt")]
    exact = prediction.measured_values(prediction.landmarks(whole, Camera()), Camera(), rows)
    assert np.isnan(exact).tolist() == [False] * count + [True, False, False]  # one turn more than there are
    first_rows, all_turns = rows[: (count + 1) // 2], rows[:count]
    for requested, table_ends in (
        (first_rows, exact[len(first_rows) - 1]),
        (all_turns, 0.3 * exact[count - 1]),
        (rows, 0.3 * exact[count - 1]),
    ):
        timed = [dataclasses.replace(r, value=float(table_ends)) for r in requested]
        run = prediction.EventRun(parameters, timed)
        expected = [exact[rows.index(r)] for r in requested]
        assert run.predict(Camera()) == pytest.approx(expected, rel=1e-10, nan_ok=True)
        tilted = Camera(tilt=0.1)  # another camera sees other turns of the same run
        expected = prediction.measured_values(prediction.landmarks(whole, tilted), tilted, requested)
        assert run.predict(tilted) == pytest.approx(expected, rel=1e-10, nan_ok=True)
        assert run.samples.t[-1] == pytest.approx(whole.t[-1])


def test_only_what_a_table_covers_is_sampled_at_first():
    parameters = loader.load("two_to_one").parameters
    first = prediction.landmarks(prediction.run_for_events(parameters), Camera()).x1_extrema[0].time
    run = prediction.EventRun(parameters, [row("x1_extremum", value=first)])
    assert run.predict(Camera()) == pytest.approx([first], rel=1e-10)
    assert run._samples.t[-1] == pytest.approx(prediction.SAMPLING_MARGIN * first, abs=prediction.SAMPLE_STEP)
    assert run._samples.run.end_time > 1.01 * prediction.SAMPLING_MARGIN * first
