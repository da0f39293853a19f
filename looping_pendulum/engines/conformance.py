"""What every engine must do, the reference included: each check is a function of an engine that raises AssertionError.

Checks hold an engine against closed forms only, so that the reference is examined like the rest. Those of a law or a release
that an engine lacks (a frictionless tendon) are left out for it by its own declaration of who supplies what: `left_out`.
`looping-pendulum conformance ENGINE` runs them on any engine, also one of another package.
"""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np

from looping_pendulum.engines.isolation import TIME_LIMIT, run_isolated
from looping_pendulum.engines.protocol import SAMPLE_INTERVAL, Abilities, Engine, Profile, Recorder
from looping_pendulum.engines.studies import Studies
from looping_pendulum.engines.trajectory import Supplier, Trajectory
from looping_pendulum.reference_ode import closed_forms
from looping_pendulum.reference_ode.geometry import light_position
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.scenarios.scenario import Scenario

Check = Callable[[Engine], None]

FRICTIONLESS = Parameters(light_mass=0.01, heavy_mass=0.1, rod_radius=0.02, free_length=0.4, release_angle=math.radians(112))
ACCELERATION_TOLERANCE = 0.01
"""Relative. A chain's nodes reach and leave the rod one by one: some 0.5 mm of ripple in a drop of 11 to 16 cm."""
START_TOLERANCE = 1e-9
"""[m] A chain's end node stands exactly where the light mass is held."""


def scenario(parameters: Parameters, duration: float) -> Scenario:
    """Wrap ``parameters`` for a check."""
    return Scenario(name="conformance", title="", description="", parameters=parameters, duration=duration)


def makes_nothing_heavy(engine: Engine) -> None:
    """An engine travels to its process as a pickle, so making one may hold no handle of its package."""
    again = pickle.loads(pickle.dumps(engine))
    assert (again.name, again.variant, again.settings) == (engine.name, engine.variant, engine.settings)


def samples_every_millisecond_from_rest(engine: Engine) -> None:
    """Sample times are whole multiples of the sample interval; the first sample is the release, at rest."""
    p = FRICTIONLESS
    run = engine.simulate(scenario(p, 0.02))
    assert np.allclose(run.t, np.arange(21) * SAMPLE_INTERVAL, rtol=0, atol=1e-12), "sample times"
    start = light_position(math, p.free_length, p.release_angle, p.rod_radius)
    assert np.allclose(run.light_position[0], start, rtol=0, atol=START_TOLERANCE), "light mass at release"
    assert np.allclose(run.heavy_position[0], (p.rod_radius, -p.hanging_length), rtol=0, atol=START_TOLERANCE), "heavy mass"
    assert not run.light_velocity[0].any(), "light mass not at rest"
    assert not run.heavy_velocity[0].any(), "heavy mass not at rest"
    arrays = (run.light_position, run.light_velocity, run.heavy_position, run.heavy_velocity, run.free_length, run.wrap_angle)
    assert all(len(a) == len(run.t) and np.isfinite(a).all() for a in arrays), "shapes or values"


def velocity_is_the_rate_of_position(engine: Engine) -> None:
    """Velocities read back are those of the positions, within what a first-order step of a millisecond allows."""
    run = engine.simulate(scenario(FRICTIONLESS, 0.05))
    for position, velocity in ((run.light_position, run.light_velocity), (run.heavy_position, run.heavy_velocity)):
        moved = np.diff(position, axis=0) / SAMPLE_INTERVAL
        middle = 0.5 * (velocity[1:] + velocity[:-1])
        assert np.abs(moved - middle).max() < 2 * 9.81 * SAMPLE_INTERVAL, "velocity against position"


def is_deterministic(engine: Engine) -> None:
    """The same input gives the same bytes."""
    first, second = (engine.simulate(scenario(FRICTIONLESS, 0.03)) for _ in range(2))
    # the same code on the same processor: whatever differs was left over from the first run
    assert first.light_position.tobytes() == second.light_position.tobytes()
    assert first.heavy_position.tobytes() == second.heavy_position.tobytes()


def drop_is_free_fall(engine: Engine) -> None:
    """Without a string both masses fall g t^2 / 2, but for a first-order step's g t dt."""
    run = engine.simulate(scenario(FRICTIONLESS.replace(release=Release.DROP), 0.1))
    fallen = closed_forms.free_fall(run.t, mass=1.0, drag=0.0, gravity=9.81)
    bound = 9.81 * run.t * step_of(engine) + 1e-9
    for position in (run.light_position, run.heavy_position):
        assert (np.abs(position[0, 1] - position[:, 1] - fallen) <= bound).all(), "free fall"
    assert np.isnan(run.wrap_angle).all(), "a wrap angle without a string"


def frictionless_vertical_release_is_an_atwood_machine(engine: Engine) -> None:
    """Both masses hanging, no friction: a = g (M2 - M1) / (M2 + M1)."""
    _atwood(engine, FRICTIONLESS.replace(release=Release.VERTICAL))


def vertical_release_obeys_the_capstan_law(engine: Engine) -> None:
    """Both masses hanging, friction: a = g (M2 - M1 e^{mu pi}) / (M2 + M1 e^{mu pi})."""
    _atwood(engine, FRICTIONLESS.replace(release=Release.VERTICAL, kinetic_friction=0.3))


def _atwood(engine: Engine, p: Parameters) -> None:
    run = engine.simulate(scenario(p, 0.2))
    found = fitted_acceleration(run)
    exact = closed_forms.atwood_acceleration(p)
    assert abs(found / exact - 1) < ACCELERATION_TOLERANCE, f"acceleration {found:.4f}, exact {exact:.4f} m/s^2"


def held_pendulum_swings_to_the_other_side(engine: Engine) -> None:
    """Heavy mass clamped: it stays, and the light mass crosses the lowest point after a quarter of its period."""
    p = FRICTIONLESS.replace(release=Release.HELD, free_length=0.15, release_angle=math.radians(150))
    run = engine.simulate(scenario(p, 0.5))
    assert np.abs(run.heavy_position - run.heavy_position[0]).max() < 1e-4, "the clamped mass moved"
    rising = run.light_velocity[:, 1] > 0
    turns = run.t[rising & (run.t > 0.05)]
    assert turns.size, "the light mass never rises"
    turn = turns[0]
    half = closed_forms.held_period(p) / 2
    assert 0.3 * half < turn < 0.7 * half, f"lowest point at {turn:.3f} s, half a period is {half:.3f} s"
    speed = np.hypot(*run.light_velocity.T)
    fall = run.light_position[0, 1] - run.light_position[:, 1]
    energy = 0.5 * speed**2 - 9.81 * fall
    assert np.abs(energy).max() < 0.02 * 9.81 * fall.max(), "energy of the held pendulum"


def string_keeps_its_length(engine: Engine) -> None:
    """The light mass stays on the taut string: l + R theta + h is the string's length within 1 mm."""
    p = FRICTIONLESS
    run = engine.simulate(scenario(p, 0.15))
    path = run.free_length + p.rod_radius * run.wrap_angle - run.heavy_position[:, 1]
    assert np.abs(path - p.string_length).max() < 1e-3, f"string off by {1e3 * np.abs(path - p.string_length).max():.2f} mm"


def says_who_supplies_what(engine: Engine) -> None:
    """Versions, settings and suppliers are all there."""
    run = engine.simulate(scenario(FRICTIONLESS, 0.002))
    assert run.provenance.versions, "no versions"
    assert run.provenance.settings, "no settings"
    assert all(s.how for s in vars(run.provenance.supplies).values()), "a supplier without a how"
    assert (run.engine, run.variant, run.profile) == (engine.name, engine.variant, engine.profile.value)


CHECKS: tuple[Check, ...] = (
    makes_nothing_heavy,
    samples_every_millisecond_from_rest,
    velocity_is_the_rate_of_position,
    is_deterministic,
    drop_is_free_fall,
    frictionless_vertical_release_is_an_atwood_machine,
    vertical_release_obeys_the_capstan_law,
    held_pendulum_swings_to_the_other_side,
    string_keeps_its_length,
    says_who_supplies_what,
)


RELEASES: dict[Check, Release] = {check: Release.LOOPING for check in CHECKS} | {
    drop_is_free_fall: Release.DROP,
    frictionless_vertical_release_is_an_atwood_machine: Release.VERTICAL,
    vertical_release_obeys_the_capstan_law: Release.VERTICAL,
    held_pendulum_swings_to_the_other_side: Release.HELD,
}
"""Check -> the release that it needs."""


def left_out(check: Check, engine: Engine) -> str:
    """Return why ``check`` says nothing of ``engine``, by its own declaration; empty: it does."""
    if RELEASES[check] not in engine.abilities.releases:
        return f"release {RELEASES[check].value!r} is not among its abilities"
    if check is vertical_release_obeys_the_capstan_law and engine.abilities.supplies.friction_law.by is Supplier.NOBODY:
        return "nobody supplies its friction law"
    return ""


class CheckOutcome(StrEnum):
    """What became of one check."""

    PASSED = "pass"
    FAILED = "fail"
    EXPECTED_FAILURE = "expected failure"
    UNEXPECTED_PASS = "unexpected pass"
    LEFT_OUT = "left out"

    @property
    def good(self) -> bool:
        """Whether it says nothing against the engine. An unexpected pass does: the reason it declares is out of date."""
        return self not in (CheckOutcome.FAILED, CheckOutcome.UNEXPECTED_PASS)


@dataclass(frozen=True, kw_only=True)
class CheckResult:
    """One check of one engine."""

    check: str
    outcome: CheckOutcome
    why: str = ""


def examine(engine: Engine, *, checks: Sequence[Check] = CHECKS, time_limit: float = TIME_LIMIT) -> Iterator[CheckResult]:
    """Run ``checks`` on ``engine``, each run of at most ``time_limit`` [s] in its own process, and say what became of them."""
    isolated = Isolated(engine, time_limit=time_limit)
    for check in checks:
        why = left_out(check, engine)
        if why:
            yield CheckResult(check=check.__name__, outcome=CheckOutcome.LEFT_OUT, why=why)
            continue
        expected = engine.abilities.known_failures.get(check.__name__, "")
        outcome = CheckOutcome.UNEXPECTED_PASS if expected else CheckOutcome.PASSED
        try:
            check(isolated)
        except AssertionError as error:
            outcome = CheckOutcome.EXPECTED_FAILURE if expected else CheckOutcome.FAILED
            why = str(error).partition("\n")[0] or "it does not hold"
        except Exception as error:  # of the engine's code, whatever it is
            outcome, why = CheckOutcome.FAILED, " ".join(f"{type(error).__name__}: {error}".split())
        yield CheckResult(check=check.__name__, outcome=outcome, why="; ".join(part for part in (why, expected) if part))


@dataclass
class Isolated:
    """An engine whose every run has its own process; a run that fails raises `EngineError`."""

    engine: Engine
    time_limit: float = field(default=TIME_LIMIT, kw_only=True)
    """[s]"""

    def __post_init__(self) -> None:
        """Look like the engine itself."""
        self.name: str = self.engine.name
        self.variant: str = self.engine.variant
        self.profile: Profile = self.engine.profile
        self.abilities: Abilities = self.engine.abilities
        self.settings: Any = self.engine.settings

    def simulate(self, scenario: Scenario, recorder: Recorder | None = None) -> Trajectory:
        """Run ``scenario`` in a process of its own; samples come back with the trajectory, not through ``recorder``."""
        return run_isolated(self.engine, scenario, time_limit=self.time_limit).raise_if_failed()

    def studies(self) -> Studies:
        """What can be varied of the engine."""
        return self.engine.studies()


def step_of(engine: Engine) -> float:
    """Time step of ``engine`` [s]; the reference has none and gets zero."""
    return float(getattr(engine.settings, "time_step", 0.0))


def fitted_acceleration(run: Trajectory) -> float:
    """Acceleration a of the heavy mass's drop a t^2 / 2, by least squares [m/s^2]."""
    square = 0.5 * run.t**2
    return float(square @ run.heavy_drop / (square @ square))
