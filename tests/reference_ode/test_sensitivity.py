"""Derivatives of a run, through all its events: against differences of runs, closed forms, and the laws that they obey."""

import math

import numpy as np
import pytest

from looping_pendulum.errors import ParameterError
from looping_pendulum.reference_ode import closed_forms
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.sensitivity import SensitivityError, solve_sensitivities
from looping_pendulum.reference_ode.solution import heavy_mass_position, light_mass_position
from looping_pendulum.reference_ode.solve import solve, solve_at
from looping_pendulum.reference_ode.transitions import Event, Mode
from tests.apparatus import SENSITIVE, TEN_TO_ONE, TWO_TO_ONE, WITHOUT_LOSSES
from tests.reference_ode.test_effects import TYPICAL
from tests.reference_ode.test_solve import random_parameters

heyoka_runs = pytest.importorskip("research.heyoka_runs", reason="heyoka is not installed; on Linux the extra `test` has it")

SIX_TO_ONE = TEN_TO_ONE.replace(light_mass=0.1 / 6, release_angle=math.radians(90))
FOUR_TO_ONE = TEN_TO_ONE.replace(light_mass=0.025, release_angle=math.radians(90))
APPARATUS = ("light_mass", "heavy_mass", "rod_radius", "free_length", "release_angle", "hanging_length")
DRAGS = ("light_drag", "heavy_drag", "string_drag")
DECLARED = (*APPARATUS, "gravity", "kinetic_friction", *DRAGS)
CASES = {"10:1": TEN_TO_ONE, "6:1": SIX_TO_ONE, "4:1": FOUR_TO_ONE, "2.5:1": SENSITIVE, "2:1": TWO_TO_ONE}
AGREEMENT = 1e-6
"""Tolerance, as a fraction of the largest derivative.

The differences are good to some 1e-8: their error falls with the square of their step, down to 1e-9 and less.
"""


def number(p: Parameters, name: str) -> float:
    return p.coefficients[name] if name in p.coefficients else getattr(p, name)


def differences(p: Parameters, t: np.ndarray, name: str):
    """Central differences of runs in 80 bits: of both masses' positions and of the events' times, and where they are smooth.

    Where the two runs are in another mode, an event lies between them.
    """
    h = 1e-7 * number(p, name) if name in APPARATUS else 1e-6 * max(abs(number(p, name)), 1e-2)
    moved = [p.replace(**{name: number(p, name) + k * h}) for k in (1, -1)]
    runs = [heyoka_runs.solve_at(q, t, tolerance=1e-18, precision="80-bit") for q in moved]
    count = min(len(r.t) for r in runs)
    modes = [r.mode[:count] * 2 + r.signs.phase[:count] for r in runs]
    assert len({tuple(e.event for e in r.run.events) for r in runs}) == 1
    width = number(moved[0], name) - number(moved[1], name)  # exact, where 2 h is not
    positions = []
    for function in (light_mass_position, heavy_mass_position):  # in all 80 bits, unlike those of `Samples`
        places = [
            np.stack(np.broadcast_arrays(*function(np, r.state, r.signs.overlap, q.values(), q.effects)), axis=1)[:count]
            for r, q in zip(runs, moved, strict=True)
        ]
        positions.append(((places[0] - places[1]) / width).astype(float))
    times = [np.array([e.time for e in r.run.events], dtype=np.longdouble) for r in runs]
    return positions, ((times[0] - times[1]) / width).astype(float), modes[0] == modes[1]


def disagreement(p: Parameters, wrt: tuple[str, ...], duration: float = 5.0) -> dict[str, float]:
    """Return the largest difference from `differences`, over the largest derivative, for each parameter."""
    t = np.linspace(0, min(solve(p).end_time, duration), 200)[:-1]
    ours = solve_sensitivities(p, t, wrt)
    worst = {}
    for i, name in enumerate(wrt):
        (light, heavy), times, smooth = differences(p, t, name)
        pairs = [(ours.light_position[..., i], light), (ours.heavy_position[..., i], heavy)]
        assert smooth.mean() > 0.9
        actual = [np.abs(a[: len(smooth)] - b)[smooth].max() / max(np.abs(b).max(), 1e-3) for a, b in pairs]
        actual.append(np.abs(ours.event_times[:, i] - times).max() / max(np.abs(times).max(), 1e-3))
        worst[name] = max(actual)
    return worst


def moved_by(p: Parameters, names: tuple[str, ...] = DECLARED) -> tuple[str, ...]:
    """Return those of ``names`` that are not at a bound of theirs, where there are no central differences."""
    return tuple(n for n in names if number(p, n))


@pytest.mark.parametrize("case", CASES)
def test_derivatives_agree_with_differences_through_stop_stick_and_slip(case):
    actual = disagreement(CASES[case], moved_by(CASES[case]))
    assert max(actual.values()) < AGREEMENT, actual


def test_derivatives_at_the_end_follow_the_moving_end():
    """Oracle: central differences of the place where the light mass reaches the rod."""
    t = np.linspace(0, 1.0, 20)
    ours = solve_sensitivities(TEN_TO_ONE, t, ("free_length",), duration=2.0)
    step = 1e-5
    ahead, behind = (
        solve_at(TEN_TO_ONE.replace(free_length=TEN_TO_ONE.free_length + d), t, duration=2.0).and_end() for d in (step, -step)
    )
    differences_at_end = (ahead.light_position[-1] - behind.light_position[-1]) / (2 * step)
    at_end = ours.and_end()
    assert at_end.light_position[-1, :, 0] == pytest.approx(differences_at_end, abs=1e-6)
    assert at_end.samples.t[-1] == ours.samples.run.end_time
    assert np.array_equal(at_end.light_position[:-1], ours.light_position)


def test_static_friction_and_the_light_masses_radius_move_events_only():
    p = FOUR_TO_ONE.replace(static_friction=0.36, light_radius=0.01)
    assert Mode.STICKING in solve(p).modes[1:-2]
    actual = disagreement(p, ("kinetic_friction", "static_friction", "light_radius", "rod_radius"))
    assert max(actual.values()) < AGREEMENT, actual


def test_random_apparatus_through_slack_and_taut():
    seen = set()
    for seed in range(0, 100, 5):
        p = random_parameters(seed)
        seen.update(e.event for e in solve(p, duration=3.0).events)
        actual = disagreement(p, moved_by(p), duration=3.0)
        assert max(actual.values()) < AGREEMENT, (seed, actual)
    assert seen >= {
        Event.STOP,
        Event.SLIP_ONSET_DOWN,
        Event.SLIP_ONSET_UP,
        Event.LOSES_TENSION,
        Event.TAUT,
        Event.LIGHT_REACHES_ROD,
    }


DAILY = ("friction_per_wrap", "string_thickness", "turning_rod")
"""A friction law, a geometry and a rod that turns; each effect takes heyoka seconds to compile in 80 bits."""


def sweep(names, daily=DAILY):
    """Return ``names`` as parameters, those beyond ``daily`` as long ones."""
    return [name if name in daily else pytest.param(name, marks=pytest.mark.long) for name in names]


@pytest.mark.parametrize("name", sweep(sorted(set(TYPICAL) - {"wind"})))
def test_every_effect_of_the_library_can_be_moved(name):
    p = TEN_TO_ONE.replace(**TYPICAL[name])
    own = tuple(n for n in TYPICAL[name] if not n.startswith(("closure_of", "closure_by")))
    actual = disagreement(p, ("light_mass", "rod_radius", "release_angle", "kinetic_friction", *own))
    assert max(actual.values()) < AGREEMENT, actual


@pytest.mark.long
def test_wind():
    # A light mass that drifts with the wind has an almost sharp bend in |v - W|, across which the equations are integrated
    assert disagreement(TEN_TO_ONE.replace(**TYPICAL["wind"]), ("wind_speed",))["wind_speed"] < 1e-5


@pytest.mark.parametrize("push", [-2.5, 0.5])
def test_a_push_along_the_string_that_goes_slack_or_is_shared(push):
    actual = disagreement(TEN_TO_ONE.replace(push_along=push), ("push_along", "light_mass", "kinetic_friction"))
    assert max(actual.values()) < AGREEMENT, actual


ABSENT = {"side_force": 5e-6, "string_density": 6e-7, "heavy_swing": 1e-3, "push_sideways": 1e-3, "friction_per_wrap": 1e-5}
"""Steps from the null value [SI], about a thousandth of a typical one."""


@pytest.mark.parametrize("name", sweep(ABSENT, ("string_density", "push_sideways")))
def test_an_absent_effect_has_a_derivative_too(name):
    t, h = np.linspace(0, 1.1, 100), ABSENT[name]
    ours = solve_sensitivities(TEN_TO_ONE, t, (name,))
    runs = [heyoka_runs.solve_at(TEN_TO_ONE.replace(**{name: k * h}), t) for k in (1, 2, 3)]
    smooth = np.all([r.mode == ours.samples.mode for r in runs], axis=0)
    for place in ("light_position", "heavy_position"):
        a, b, c = (getattr(r, place) for r in runs)
        ahead = (8 * b - 5 * a - 3 * c) / (2 * h)  # from the side, where the effect is there; second order: 1e-6 and more
        off = np.abs(getattr(ours, place)[..., 0] - ahead)[smooth]
        assert off.max() < 1e-4 * max(np.abs(ahead).max(), 1e-2)


def test_atwood_machine():
    p = TEN_TO_ONE.replace(release="vertical", **dict.fromkeys(DRAGS, 0.0))
    t = np.linspace(0, 0.3, 31)
    names = ("light_mass", "heavy_mass", "gravity", "kinetic_friction", "release_angle")
    ours = solve_sensitivities(p, t, names).state
    for i, name in enumerate(names):
        h = 1e-4 * number(p, name)
        accelerations = [closed_forms.atwood_acceleration(p.replace(**{name: number(p, name) + k * h})) for k in (1, -1)]
        by = (accelerations[0] - accelerations[1]) / (2 * h)
        assert np.abs(ours.free_length[i] - -0.5 * by * t**2).max() < 1e-7 * max(abs(by), 1.0)
        assert np.abs(ours.heavy_speed[i] - -by * t).max() < 1e-7 * max(abs(by), 1.0)


def test_free_fall():
    p = TEN_TO_ONE.replace(release="drop", **WITHOUT_LOSSES)
    t = np.linspace(0, 0.4, 21)
    ours = solve_sensitivities(p, t, ("gravity", "light_mass", "push_across"))
    fall = -0.5 * t**2
    assert np.abs(ours.light_position[:, 1, 0] - fall).max() < 1e-10
    assert np.abs(ours.heavy_position[:, 1, 0] - fall).max() < 1e-10
    assert np.abs(ours.light_position[..., 1]).max() < 1e-10
    across = np.array([-math.cos(p.release_angle), -math.sin(p.release_angle)])  # t1 at release
    assert np.abs(ours.light_position[..., 2] - t[:, None] * across).max() < 1e-9


def test_period_of_a_held_pendulum():
    p = TEN_TO_ONE.replace(release="held", **WITHOUT_LOSSES)
    names = ("free_length", "rod_radius", "release_angle", "gravity", "light_mass")
    ours = solve_sensitivities(p, np.zeros(1), names, duration=2.5)
    turns = [i for i, e in enumerate(ours.samples.run.events) if e.event is Event.ACROSS_REVERSES]
    for i, name in enumerate(names):
        h = 1e-4 * number(p, name)
        periods = [closed_forms.held_period(p.replace(**{name: number(p, name) + k * h})) for k in (1, -1)]
        assert ours.event_times[turns[1], i] == pytest.approx((periods[0] - periods[1]) / (2 * h), abs=2e-6)


@pytest.mark.parametrize("p", [TEN_TO_ONE, TWO_TO_ONE, random_parameters(25)])
def test_a_heavier_apparatus_in_thicker_air_moves_the_same(p):
    """Euler: the motion is homogeneous, of degree 0, in all masses and drags."""
    names = ("light_mass", "heavy_mass", *DRAGS)
    ours = solve_sensitivities(p, np.linspace(0, solve(p, duration=3.0).end_time, 100), names, duration=3.0)
    terms = ours.light_position * [number(p, n) for n in names]
    assert np.abs(terms.sum(axis=2)).max() < 1e-8 * np.abs(terms).max()


@pytest.mark.parametrize("p", [TEN_TO_ONE, TWO_TO_ONE, random_parameters(25)])
def test_a_larger_apparatus_moves_the_same_but_slower(p):
    """Euler: all lengths times s, drags per length and per area accordingly, is the motion times s at times t sqrt(s)."""
    powers = {"rod_radius": 1, "free_length": 1, "hanging_length": 1, "light_drag": -1, "heavy_drag": -1, "string_drag": -2}
    t = np.linspace(0, solve(p, duration=3.0).end_time, 100)[:-1]
    ours = solve_sensitivities(p, t, tuple(powers), duration=3.0)
    terms = ours.light_position * [k * number(p, n) for n, k in powers.items()]
    samples = ours.samples
    left = terms.sum(axis=2) + 0.5 * t[:, None] * samples.light_velocity - samples.light_position
    assert np.abs(left).max() < 1e-8 * max(np.abs(terms).max(), 1.0)


def test_the_run_is_the_plain_one():
    t = np.linspace(0, 1.5, 151)
    plain, ours = solve_at(TWO_TO_ONE, t), solve_sensitivities(TWO_TO_ONE, t, DECLARED).samples
    assert np.array_equal(plain.light_position, ours.light_position)
    assert [(e.event, e.time) for e in plain.run.events] == [(e.event, e.time) for e in ours.run.events]
    assert solve_sensitivities(TWO_TO_ONE, t, ()).light_position.shape == (len(plain.t), 2, 0)
    assert all(isinstance(v, float) for e in ours.run.events for v in (e.time, *e.state))


def test_what_has_no_derivative_is_refused():
    t = np.linspace(0, 1, 11)
    with pytest.raises(ParameterError, match="wrt: found 'mass', needed one of"):
        solve_sensitivities(TEN_TO_ONE, t, ("mass",))
    with pytest.raises(ParameterError, match="wrt: found 'gravity' more than once"):
        solve_sensitivities(TEN_TO_ONE, t, ("gravity", "gravity"))
    for name in ("push_along", "light_radius", "rod_mobility", "string_compliance"):
        with pytest.raises(SensitivityError, match=f"wrt {name}: no derivative"):
            solve_sensitivities(TEN_TO_ONE, t, (name,))


def test_an_event_that_is_only_grazed_is_refused():
    breaks, holds = FOUR_TO_ONE.light_mass, SIX_TO_ONE.light_mass  # the string does, and does not, slip once more

    def slips(light_mass: float) -> bool:
        return Mode.SLIDING_DOWN in solve(FOUR_TO_ONE.replace(light_mass=light_mass)).modes[1:]

    assert slips(breaks)
    assert not slips(holds)
    for _ in range(60):
        middle = 0.5 * (breaks + holds)
        breaks, holds = (middle, holds) if slips(middle) else (breaks, middle)
    with pytest.raises(SensitivityError, match="slip_onset_down is grazed, not crossed"):
        solve_sensitivities(FOUR_TO_ONE.replace(light_mass=breaks), np.zeros(1), ("light_mass",))
    for off in (-1e-6, 1e-6):
        beside = FOUR_TO_ONE.replace(light_mass=breaks * (1 + off))
        assert np.isfinite(solve_sensitivities(beside, np.zeros(1), ("light_mass",)).event_times).all()
