"""The live model's runs, held to the reference: random apparatuses, the shipped scenarios, and runs just beside a graze."""

import base64
import hashlib
import math
from functools import partial

import numpy as np
import pytest

from looping_pendulum.errors import ParameterError
from looping_pendulum.live.write import live_settings
from looping_pendulum.reference_ode.cartesian import cartesian_force
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.reference_ode.solve import solve
from looping_pendulum.reference_ode.transitions import PHASE_EVENTS
from looping_pendulum.scenarios import load, shipped
from tests.apparatus import SENSITIVE, TEN_TO_ONE
from tests.live.cases import DURATION, FRACTIONS, case_of, compare, hangs_straight, random_apparatus
from tests.reference_ode.core import bits

SEED = 20261201
DAILY, ALL = 40, 500
GRAZING_CHANGE = 1e-9
"""Relative change of the free length within which a reference that grazes an event changes its own sequence."""

solved = partial(solve, duration=DURATION)


def runs_of(engine, apparatuses):
    """Return the runs of the reference and of the live model."""
    references = [solved(p) for p in apparatuses]
    return references, engine([case_of(p, r.end_time) for p, r in zip(apparatuses, references, strict=True)])


def grazes(p):
    """Return whether the reference's own sequence changes with the free length, within `GRAZING_CHANGE`."""
    beside = [p.replace(free_length=p.free_length * factor) for factor in (1 - GRAZING_CHANGE, 1 + GRAZING_CHANGE)]
    return len({solved(q).modes for q in (p, *beside)}) > 1


def hold_to_reference(engine, count):
    """Hold random apparatuses to the reference, but for those that graze; return how many graze and which modes there were."""
    rng = np.random.default_rng(SEED)
    apparatuses = [random_apparatus(rng, place) for place in range(count)]
    references, live = runs_of(engine, apparatuses)
    comparisons = [compare(*pair) for pair in zip(references, live, strict=True)]
    differing = [i for i, comparison in enumerate(comparisons) if not comparison.agrees]
    grazing = [i for i in differing if grazes(apparatuses[i])]
    wrong = {i: (apparatuses[i].release, comparisons[i]) for i in differing if i not in grazing}
    assert not wrong
    return grazing, references, comparisons


def test_random_apparatuses_run_as_the_reference_does(node):
    grazing, references, _ = hold_to_reference(partial(node, "run_cases.mjs"), DAILY)
    assert not grazing
    modes = {mode.name for run in references for mode in run.modes}
    assert {"SLIDING_DOWN", "SLIDING_UP", "STICKING", "SLACK", "CLAMPED", "FALLING"} <= modes


@pytest.mark.accurate
@pytest.mark.parametrize("engine", ["node", "browser"])
def test_all_random_apparatuses_run_as_the_reference_does(engine, request):
    run = request.getfixturevalue(engine)
    grazing, references, comparisons = hold_to_reference(partial(run, "run_cases.mjs"), ALL)
    straight = sum(map(hangs_straight, references))
    print(
        f"\n{engine}: {ALL} apparatuses, {len(grazing)} graze, {straight} hang straight down; largest differences:",
        f"{max(c.time_difference for c in comparisons):.1e} s, {max(c.path_difference for c in comparisons):.1e} m",
    )
    assert len(grazing) <= 0.01 * ALL  # measured: none of 4500


def test_shipped_scenarios_run_as_the_reference_does(node):
    apparatuses = [load(name).parameters for name in shipped()]
    references, live = runs_of(partial(node, "run_cases.mjs"), apparatuses)
    for reference, run in zip(references, live, strict=True):
        assert compare(reference, run).agrees
        assert run["haltingTime"] == (None if reference.halt is None else pytest.approx(reference.halting_time, abs=1e-8))
        assert run["stops"] == pytest.approx(reference.stops, abs=1e-8)


def test_beside_a_graze_the_run_is_that_of_one_of_its_sides(node):
    # Bisection between a run that slips back and one that does not, down to neighbouring doubles
    low, high = SENSITIVE.replace(release_angle=math.radians(60)), SENSITIVE.replace(release_angle=math.radians(100))
    below, above = solved(low).modes, solved(high).modes
    assert below != above
    for _ in range(45):
        middle = low.replace(release_angle=0.5 * (low.release_angle + high.release_angle))
        low, high = (middle, high) if solved(middle).modes == below else (low, middle)
    beside = [low.replace(release_angle=low.release_angle * (1 + step * 1e-15)) for step in range(-3, 4)]
    allowed = {tuple(mode.name.lower() for mode in solved(p).modes) for p in (low, high)}
    assert len(allowed) == 2
    assert any(map(grazes, beside))
    for run in node("run_cases.mjs", [case_of(p, 0.0) for p in beside]):
        modes = [e["modeAfter"] for e in run["events"] if e["event"] not in PHASE_EVENTS]
        assert tuple(modes) in allowed


def test_samples_are_those_of_the_reference(node):
    further = {"light_linear_drag": 2e-3, "wind_speed": 1.0, "side_force": 0.01, "static_friction": 0.4}
    p = TEN_TO_ONE.replace(**further)
    reference = solved(p)
    # At the end the light mass turns at 1500 rad/s, so that 1e-9 s there are 4e-6 m/s
    until = 0.9 * reference.end_time
    (run,) = node("run_cases.mjs", [case_of(p, until)])
    samples = reference.sample(FRACTIONS * until)

    def live(*names):
        values = run["samples"]
        for name in names:
            values = [value[name] for value in values]
        return np.array(values)

    def close(values, expected, what=""):
        # The paths differ by some 1e-9 m at up to 100 rad/s; a formula that differs shows at once
        np.testing.assert_allclose(values, expected, rtol=0, atol=1e-6 * np.max(np.abs(expected)) + 1e-12, err_msg=what)

    for name, values in (
        ("lightVelocity", samples.light_velocity),
        ("heavyVelocity", samples.heavy_velocity),
        ("wrapAngle", samples.state.wrap_angle),
        ("freeLength", samples.state.free_length),
        ("slack", samples.state.slack),
        ("lightTension", samples.tensions[0]),
        ("heavyTension", samples.tensions[1]),
    ):
        close(live(name), values, name)
    kinetic = 0.5 * p.light_mass * np.sum(samples.light_velocity**2, axis=1)
    kinetic += 0.5 * p.heavy_mass * np.sum(samples.heavy_velocity**2, axis=1)
    close(live("energies", "kinetic"), kinetic)
    whole = sum(live("energies", name) for name in ("kinetic", "potential", "lost"))
    close(whole, whole[0])
    # The tension of a string that sticks or slides obeys the friction that is asked of it
    ratio = np.abs(np.log(samples.tensions[1] / samples.tensions[0]))
    close(live("holding", "needed"), ratio)
    close(live("holding", "bound"), 0.4 * samples.state.wrap_angle)
    # All forces but gravity, as engines are given them, less the side force
    force = cartesian_force(p)
    rows = zip(samples.t, samples.light_position, samples.light_velocity, samples.heavy_velocity, strict=True)
    drag = [force(t, *position, *velocity, heavy[1])[:2] for t, position, velocity, heavy in rows]
    close(live("dragForce"), np.array(drag) - (0.01, 0.0))


IMPOSSIBLE = [
    {"light_mass": -1.0},
    {"release_angle": 7.0},
    {"kinetic_friction": 0.5, "static_friction": 0.4},
    {"free_length": 1e-3},
    {"wind_speed": 21.0},
    {"light_drag": 2.0},
]


def test_what_is_impossible_is_refused_in_the_words_of_the_reference(node):
    base = live_settings(TEN_TO_ONE)
    runs = node("run_cases.mjs", [{"settings": base | change, "duration": 1.0, "times": []} for change in IMPOSSIBLE])
    for change, run in zip(IMPOSSIBLE, runs, strict=True):
        with pytest.raises(ParameterError) as refusal:
            TEN_TO_ONE.replace(**change)
        assert run == {"error": str(refusal.value)}


def test_an_effect_that_the_live_model_lacks_is_named():
    with pytest.raises(
        ParameterError, match="^effects: found string_mass, which the live model does not have; it has capstan, "
    ):
        live_settings(TEN_TO_ONE.replace(string_density=1e-3))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mass": 1.0}, "mass: no such setting"),
        ({"light_mass": "heavy"}, "light_mass: found heavy, needed a number"),
        ({"release": "thrown"}, "release: found thrown, needed one of looping, vertical, held, drop"),
        ({"light_mass": None}, "light_mass: found null, needed a number"),
    ],
)
def test_wrong_settings_are_named(node, change, message):
    case = {"settings": live_settings(TEN_TO_ONE) | change, "duration": 1.0, "times": []}
    assert node("run_cases.mjs", [case]) == [{"error": message}]


def test_settings_left_open_are_those_of_parameters(node):
    given = {"light_mass": 0.01, "heavy_mass": 0.1, "rod_radius": 0.006, "free_length": 0.5, "release_angle": 1.0}
    p = Parameters(**given, release=Release.VERTICAL, coefficients={"kinetic_friction": 0.3})
    reference = solved(p)
    settings = given | {"release": "vertical", "kinetic_friction": 0.3}
    case = case_of(p, reference.end_time) | {"settings": settings}
    assert compare(reference, node("run_cases.mjs", [case])[0]).agrees


def test_a_page_runs_the_script_as_node_runs_the_modules(node, browser):
    cases = [case_of(p, 1.0) for p in (TEN_TO_ONE, SENSITIVE)]
    assert browser("run_cases.mjs", cases) == node("run_cases.mjs", cases)


@pytest.mark.parametrize("engine", ["node", "browser"])
def test_runs_and_their_derivatives_have_the_bits_that_wasmtime_gives(engine, request):
    stored = bits.cases()
    results = request.getfixturevalue(engine)("bits.mjs", [bits.job(parameters) for parameters, _ in stored])
    digests = [hashlib.sha256(base64.b64decode(result)).hexdigest() for result in results]
    assert digests == [digest for _, digest in stored]
