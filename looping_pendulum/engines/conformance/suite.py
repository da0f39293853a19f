"""All checks, which of them say anything of an engine, and what became of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from looping_pendulum.engines.conformance import against_reference, form, motion
from looping_pendulum.engines.conformance.apparatus import NEEDS, Check, Needs, Remembering
from looping_pendulum.engines.isolation import TIME_LIMIT, run_isolated
from looping_pendulum.engines.protocol import STATIC_FRICTION, Abilities, Engine, Profile, Recorder
from looping_pendulum.engines.studies import Studies
from looping_pendulum.engines.trajectory import Trajectory
from looping_pendulum.errors import EngineError
from looping_pendulum.scenarios.scenario import Scenario

CHECKS: tuple[Check, ...] = (
    form.makes_nothing_heavy,
    form.samples_every_millisecond_from_rest,
    form.velocity_is_the_rate_of_position,
    form.free_length_and_wrap_angle_are_those_of_the_position,
    form.is_deterministic,
    form.runs_to_its_end,
    form.says_who_supplies_what,
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
    against_reference.errs_no_more_than_refining_it_changes,
    *against_reference.EFFECT_CHECKS.values(),
)


def left_out(check: Check, engine: Engine) -> str:
    """Return why ``check`` says nothing of ``engine``, by its own declaration; empty: it does."""
    need = NEEDS.get(check, Needs(parameters=()))
    for p in need.parameters:
        beyond, lacking = engine.abilities.unsupported(p), engine.abilities.lacks(p)
        if beyond:
            return f"{beyond} is not among its abilities"
        if need.laws and lacking:
            what = lacking[0].replace("_", " ")
            return f"it declares no {what} of its own" if lacking[0] == STATIC_FRICTION else f"nobody supplies its {what}"
    if need.ladders and not against_reference.usable_ladders(engine):
        return "it offers no ladder: studies(), in docs/write-an-engine.md"
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
    isolated = Remembering(Isolated(engine, time_limit=time_limit))
    for check in checks:
        why = left_out(check, engine)
        if why:
            yield CheckResult(check=check.__name__, outcome=CheckOutcome.LEFT_OUT, why=why)
            continue
        expected = engine.abilities.known_failures.get(check.__name__, "")
        outcome = CheckOutcome.UNEXPECTED_PASS if expected else CheckOutcome.PASSED
        try:
            check(isolated)
        except (AssertionError, EngineError) as error:  # a run that breaks off is a failure like another, expected or not
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
        """Ladders of the engine, each rung in a process of its own too."""
        ladders = tuple(
            dataclasses.replace(ladder, engines=tuple(Isolated(rung, time_limit=self.time_limit) for rung in ladder.engines))
            for ladder in self.engine.studies().ladders
        )
        return Studies(ladders=ladders)
