"""Conformance checks that every engine must pass, the reference included.

A check is a function of an engine that raises AssertionError; it uses the engine's protocol alone. The checks compare the
engine with closed forms and invariants first, so that the reference is tested like all others, then with the reference. A check
of a law, a release or an effect that an engine declares to lack (a frictionless tendon) is skipped for it: `skip_reason`.
`looping-pendulum conformance ENGINE` runs them on any engine, also one of another package; tests/engines/test_seeded_bugs.py
shows which check catches which bug.
"""

from looping_pendulum.engines.conformance.apparatus import CachedEngine, Check, scenario
from looping_pendulum.engines.conformance.suite import (
    CHECKS,
    CheckOutcome,
    CheckResult,
    IsolatedEngine,
    run_checks,
    skip_reason,
)

__all__ = [
    "CHECKS",
    "Check",
    "CheckOutcome",
    "CheckResult",
    "IsolatedEngine",
    "CachedEngine",
    "run_checks",
    "skip_reason",
    "scenario",
]
