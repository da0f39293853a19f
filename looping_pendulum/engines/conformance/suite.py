"""The list of all checks, the rule by which they apply to an engine, and their outcomes."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from looping_pendulum.engines.conformance import against_reference, data_format, motion
from looping_pendulum.engines.conformance.apparatus import REQUIREMENTS, CachedEngine, Check, Requirements
from looping_pendulum.engines.isolation import TIME_LIMIT, run_isolated
from looping_pendulum.engines.protocol import STATIC_FRICTION, Abilities, Engine, Profile, Recorder
from looping_pendulum.engines.studies import Studies
from looping_pendulum.engines.trajectory import Trajectory
from looping_pendulum.errors import EngineError
from looping_pendulum.scenarios.scenario import Scenario

CHECKS: tuple[Check, ...] = (
    data_format.can_be_pickled,
    data_format.samples_every_millisecond_from_rest,
    data_format.velocity_is_the_rate_of_position,
    data_format.free_length_and_wrap_angle_are_those_of_the_position,
    data_format.is_deterministic,
    data_format.runs_to_its_end,
    data_format.provenance_is_complete,
    motion.drop_is_free_fall,
    motion.frictionless_vertical_release_is_an_atwood_machine,
    motion.vertical_release_obeys_the_capstan_law,
    motion.friction_holds_the_string_of_a_small_overweight,
    motion.static_friction_holds_what_kinetic_friction_would_not,
    motion.held_pendulum_swings_to_the_other_side,
    motion.a_slack_string_pulls_nothing,
    motion.string_keeps_its_length,
    motion.heavy_mass_falls_straight_down,
    motion.release_has_the_exact_acceleration,
    motion.release_against_friction_has_the_exact_acceleration,
    motion.energy_is_kept_without_losses,
    motion.energy_never_grows_with_losses,
    against_reference.follows_the_reference_without_losses,
    against_reference.follows_the_reference_past_the_halt_and_a_full_turn,
    against_reference.error_is_covered_by_refinement,
    *against_reference.EFFECT_CHECKS.values(),
)
"""All checks, in the order in which they run."""


def skip_reason(check: Check, engine: Engine) -> str:
    """Return why ``check`` does not apply to ``engine``, from the engine's own declarations; empty: it applies."""
    required = REQUIREMENTS.get(check, Requirements(parameters=()))
    for p in required.parameters:
        unsupported, lacking = engine.abilities.unsupported(p), engine.abilities.lacks(p)
        if unsupported:
            return f"{unsupported} is not among its abilities"
        if required.laws and lacking:
            piece = lacking[0].replace("_", " ")
            return f"it declares no {piece} of its own" if lacking[0] == STATIC_FRICTION else f"nobody supplies its {piece}"
    if required.ladders and not against_reference.usable_ladders(engine):
        return "it offers no ladder: studies(), in docs/write-an-engine.md"
    return ""


class CheckOutcome(StrEnum):
    """Outcome of one check."""

    PASSED = "pass"
    FAILED = "fail"
    EXPECTED_FAILURE = "expected failure"
    UNEXPECTED_PASS = "unexpected pass"
    LEFT_OUT = "left out"

    @property
    def acceptable(self) -> bool:
        """Return whether the engine is in order; an unexpected pass is not, because the declared reason is out of date."""
        return self not in (CheckOutcome.FAILED, CheckOutcome.UNEXPECTED_PASS)


@dataclass(frozen=True, kw_only=True)
class CheckResult:
    """Result of one check of one engine."""

    check: str
    """Name of the check."""
    outcome: CheckOutcome
    why: str = ""
    """Why it failed or was left out; empty if it passed."""


def run_checks(engine: Engine, *, checks: Sequence[Check] = CHECKS, time_limit: float = TIME_LIMIT) -> Iterator[CheckResult]:
    """Run ``checks`` on ``engine`` and yield the results; each run has its own process and at most ``time_limit`` [s]."""
    # Cached outside, so that a run that crashes its process is not repeated for the next check either
    isolated = CachedEngine(IsolatedEngine(engine, time_limit=time_limit))
    for check in checks:
        why = skip_reason(check, engine)
        if why:
            yield CheckResult(check=check.__name__, outcome=CheckOutcome.LEFT_OUT, why=why)
            continue
        expected = engine.abilities.known_failures.get(check.__name__, "")
        outcome = CheckOutcome.UNEXPECTED_PASS if expected else CheckOutcome.PASSED
        try:
            check(isolated)
        except (
            AssertionError,
            EngineError,
        ) as error:  # EngineError: a run that did not end properly may also be an expected failure
            outcome = CheckOutcome.EXPECTED_FAILURE if expected else CheckOutcome.FAILED
            why = str(error).partition("\n")[0] or "it does not hold"
        except Exception as error:  # a bug in the engine's code is never expected
            outcome, why = CheckOutcome.FAILED, " ".join(f"{type(error).__name__}: {error}".split())
        yield CheckResult(check=check.__name__, outcome=outcome, why="; ".join(part for part in (why, expected) if part))


@dataclass
class IsolatedEngine:
    """An engine that simulates in a new process each time; a run that fails raises `EngineError`."""

    engine: Engine
    time_limit: float = field(default=TIME_LIMIT, kw_only=True)
    """Time limit of one run [s]."""

    def __post_init__(self) -> None:
        """Copy the attributes of the `Engine` protocol."""
        self.name: str = self.engine.name
        self.variant: str = self.engine.variant
        self.profile: Profile = self.engine.profile
        self.abilities: Abilities = self.engine.abilities
        self.settings: Any = self.engine.settings

    def simulate(self, scenario: Scenario, recorder: Recorder | None = None) -> Trajectory:
        """Run ``scenario`` in a process of its own; samples come back with the trajectory, not through ``recorder``."""
        return run_isolated(self.engine, scenario, time_limit=self.time_limit).raise_if_failed()

    def studies(self) -> Studies:
        """Return the ladders of the engine, with each rung isolated, too."""
        ladders = tuple(
            dataclasses.replace(
                ladder, engines=tuple(IsolatedEngine(rung, time_limit=self.time_limit) for rung in ladder.engines)
            )
            for ladder in self.engine.studies().ladders
        )
        return Studies(ladders=ladders)
