"""The fuzzer itself: it counts what there is to count, it sees faults, and a short run of it finds none."""

import warnings

import pytest

from looping_pendulum.errors import HarnessError
from tests.fuzz.__main__ import shares
from tests.fuzz.judging import Outcome, judge
from tests.fuzz.kinds import KINDS, InputKind
from tests.fuzz.session import fuzz

COUNT = 200


@pytest.mark.parametrize("name", list(KINDS))
def test_a_short_run_finds_nothing(name, tmp_path):
    tally = fuzz(KINDS[name], shares(COUNT, list(KINDS))[name], seed=12, failures=tmp_path / "failures")
    kept = [path.read_text() for path in tmp_path.rglob("*.txt")]
    assert tally.faults == 0, "\n".join(kept)
    assert tally.tried >= COUNT // len(KINDS)
    # Inputs that are all refused, or all accepted, would test nothing behind the first look at them.
    assert tally.outcomes[Outcome.ACCEPTED] > 0
    assert tally.outcomes[Outcome.CLEAN_ERROR] > 0


def refuses_sevens(data: bytes) -> None:
    if b"77" in data:
        raise ZeroDivisionError
    if b"7" in data:
        raise HarnessError("found a seven, needed none")
    if b"8" in data:
        while True:
            pass


@pytest.mark.long
def test_a_planted_fault_is_found_shrunk_and_kept(tmp_path):
    kind = InputKind(name="sevens", seeds=lambda: [b"1 2 3 77 5\n" * 5, b"1 2 7 4\n", b"123"], run=refuses_sevens)
    tally = fuzz(kind, 40, seed=0, failures=tmp_path, cpu_limit=0.05, shrink_seconds=2.0)
    assert tally.faults == tally.outcomes[Outcome.TRACEBACK] + tally.outcomes[Outcome.HANG] > 0
    assert tally.outcomes[Outcome.CLEAN_ERROR] > 0
    assert tally.outcomes[Outcome.ACCEPTED] > 0
    kept = {path.read_bytes() for path in (tmp_path / "sevens").glob("*.shrunk")}
    assert b"77" in kept
    assert not (tmp_path / "sevens.running").exists()


@pytest.mark.parametrize(
    ("data", "outcome"),
    [
        (b"1", Outcome.ACCEPTED),
        (b"7", Outcome.CLEAN_ERROR),
        (b"77", Outcome.TRACEBACK),
        (b"8", Outcome.HANG),
    ],
)
def test_each_outcome_is_distinguished(data, outcome):
    assert judge(refuses_sevens, data, cpu_limit=0.05).outcome is outcome


def two_lines(_data: bytes) -> None:
    raise HarnessError("one\ntwo")


def warns(_data: bytes) -> None:
    warnings.warn("overflow encountered", RuntimeWarning, stacklevel=1)


@pytest.mark.parametrize("run", [two_lines, warns])
def test_a_warning_or_a_second_line_is_a_fault(run):
    assert judge(run, b"").outcome is Outcome.TRACEBACK
