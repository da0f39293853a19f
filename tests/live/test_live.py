"""The live model's runs have the bits of the reference's: random apparatuses of all kinds, and the shipped scenarios."""

import base64
import hashlib
from functools import partial

import numpy as np
import pytest

from looping_pendulum.errors import ParameterError
from looping_pendulum.live.write import live_settings
from looping_pendulum.reference_ode.cartesian import cartesian_force
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.reference_ode.solve import solve
from looping_pendulum.scenarios import load, shipped
from tests.apparatus import TEN_TO_ONE, TWO_TO_ONE
from tests.live.cases import DURATION, FRACTIONS, case_of, random_apparatus
from tests.reference_ode.core import bits

SEED = 20261201
RANDOM = 200
"""Number of random apparatuses."""

solved = partial(solve, duration=DURATION)


def events_of(run):
    """Return the events of a run of the reference, as the page has them."""
    modes = [(e.mode_before.name.lower(), e.mode_after.name.lower()) for e in run.events]
    return [
        {"time": e.time, "event": e.event, "modeBefore": before, "modeAfter": after}
        for e, (before, after) in zip(run.events, modes, strict=True)
    ]


def test_runs_have_the_bits_of_the_reference(node):
    # The page's model has all its effects, the reference's those that act: the others must add exactly 0
    rng = np.random.default_rng(SEED)
    apparatuses = [*(load(name).parameters for name in shipped()), *(random_apparatus(rng, i) for i in range(RANDOM))]
    references = [solved(p) for p in apparatuses]
    runs = node("run_cases.mjs", [case_of(p, r.end_time) for p, r in zip(apparatuses, references, strict=True)])
    for reference, run in zip(references, runs, strict=True):
        assert run["events"] == events_of(reference)
        assert (run["haltingTime"], run["stops"]) == (reference.halting_time, list(reference.stops))
        state = reference.sample(FRACTIONS * reference.end_time).state
        assert [sample["wrapAngle"] for sample in run["samples"]] == state.wrap_angle.tolist()
        assert [sample["heavyVelocity"][1] for sample in run["samples"]] == state.heavy_speed.tolist()
    modes = {mode.name for run in references for mode in run.modes}
    assert modes >= {"SLIDING_DOWN", "SLIDING_UP", "STICKING", "SLACK", "CLAMPED", "CLAMPED_SLACK", "FALLING"}


def test_a_long_run_gets_the_room_that_it_needs(node):
    p = load("held").parameters
    reference = solve(p, duration=150.0)
    case = {"settings": live_settings(p), "duration": 150.0, "times": [149.0]}
    (run,) = node("run_cases.mjs", [case])
    assert len(run["events"]) > 128
    assert run["events"] == events_of(reference)
    assert run["samples"][0]["wrapAngle"] == reference.sample(np.array([149.0])).state.wrap_angle[0]


def test_a_run_that_hardly_ends_is_given_up(node):
    case = {"settings": live_settings(load("held").parameters), "duration": 1e6, "times": []}
    assert node("run_cases.mjs", [case]) == [{"error": "duration: found more than 200000 steps, needed a shorter run"}]


def test_samples_are_those_of_the_reference(node):
    further = {"light_linear_drag": 2e-3, "wind_speed": 1.0, "side_force": 0.01, "static_friction": 0.4}
    p = TEN_TO_ONE.replace(**further)
    reference = solved(p)
    (run,) = node("run_cases.mjs", [case_of(p, reference.end_time)])
    samples = reference.sample(FRACTIONS * reference.end_time)

    def live(*names):
        values = run["samples"]
        for name in names:
            values = [value[name] for value in values]
        return np.array(values)

    def close(values, expected, what=""):
        # Sums are rounded in another order, and NumPy's sines and logarithms by themselves
        np.testing.assert_allclose(values, expected, rtol=0, atol=1e-13 * np.max(np.abs(expected)) + 1e-15, err_msg=what)

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


@pytest.mark.parametrize("name", ["ten_to_one", "two_to_one", "held", "atwood", "drop"])
def test_accelerations_are_forces_divided_by_masses(node, name):
    """The forces are weight, those that engines are given, and the reference's tensions along the string."""
    p = load(name).parameters
    reference = solved(p)
    (run,) = node("run_cases.mjs", [case_of(p, reference.end_time)])
    samples = reference.sample(FRACTIONS * reference.end_time)
    force = cartesian_force(p) or (lambda *instant: (0.0, 0.0, 0.0))  # Atwood's machine has neither air nor friction
    rows = zip(samples.t, samples.light_position, samples.light_velocity, samples.heavy_velocity, strict=True)
    forces = np.array([force(t, *position, *velocity, heavy[1]) for t, position, velocity, heavy in rows])
    angle = samples.state.wrap_angle
    towards_rod = np.column_stack([np.sin(angle), -np.cos(angle)])
    light = (forces[:, :2] + samples.tensions[0][:, None] * towards_rod) / p.light_mass - (0.0, p.coefficients["gravity"])
    np.testing.assert_allclose([s["lightAcceleration"] for s in run["samples"]], light, rtol=1e-9, atol=1e-9)
    heavy = (forces[:, 2] + samples.tensions[1]) / p.heavy_mass - p.coefficients["gravity"]
    moves = np.array([s["mode"] not in ("sticking", "clamped", "clamped_slack") for s in run["samples"]])
    accelerations = np.array([s["heavyAcceleration"] for s in run["samples"]])
    np.testing.assert_allclose(accelerations[:, 1], np.where(moves, heavy, 0.0), rtol=1e-9, atol=1e-9)
    assert not accelerations[:, 0].any()


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
    assert node("run_cases.mjs", [case])[0]["events"] == events_of(reference)


def test_a_page_runs_the_script_as_node_runs_the_modules(node, browser):
    cases = [case_of(p, 1.0) for p in (TEN_TO_ONE, TWO_TO_ONE)]
    assert browser("run_cases.mjs", cases) == node("run_cases.mjs", cases)


@pytest.mark.parametrize("engine", ["node", "browser"])
def test_runs_and_their_derivatives_have_the_bits_that_wasmtime_gives(engine, request):
    stored = bits.cases()
    results = request.getfixturevalue(engine)("bits.mjs", [bits.job(parameters) for parameters, _ in stored])
    digests = [hashlib.sha256(base64.b64decode(result)).hexdigest() for result in results]
    assert digests == [digest for _, digest in stored]
