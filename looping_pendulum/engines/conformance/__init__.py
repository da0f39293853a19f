"""What every engine must do, the reference included: each check is a function of an engine that raises AssertionError.

Checks use the engine's protocol alone. They hold it against closed forms and invariants first, so that the reference is
examined like the rest, then against the reference. Those of a law, a release or an effect that an engine lacks (a frictionless
tendon) are left out for it by its own declaration: `left_out`. `looping-pendulum conformance ENGINE` runs them on any engine,
also one of another package; tests/engines/test_seeded_bugs.py shows which of them catch which bug.
"""

from looping_pendulum.engines.conformance.apparatus import Check, Remembering, scenario
from looping_pendulum.engines.conformance.suite import CHECKS, CheckOutcome, CheckResult, Isolated, examine, left_out

__all__ = ["CHECKS", "Check", "CheckOutcome", "CheckResult", "Isolated", "Remembering", "examine", "left_out", "scenario"]
