"""Damaged inputs of every kind are accepted, or refused in one line; `make fuzz` tries more of them."""

import os
import warnings
from collections import Counter

import pytest
from hypothesis import HealthCheck, given, settings

from looping_pendulum.errors import HarnessError
from tests.fuzz.judging import was_accepted
from tests.fuzz.kinds import KINDS

ASKED = os.environ.get("FUZZ_EXAMPLES")
"""Number of inputs of each kind, new ones in each run; by default a few that are the same every time."""


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_a_damaged_input_is_accepted_or_refused_in_one_line(kind, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    outcomes = Counter()

    @settings(
        max_examples=int(ASKED or 25), derandomize=not ASKED, deadline=None, database=None,
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    @given(kind.inputs(kind.seeds()))
    def judge(data):
        outcomes[was_accepted(kind.run, data)] += 1

    judge()
    # Whether damage is accepted is chance; if nothing were refused, or no sound input accepted, nothing would be tested
    assert outcomes[False] > 0
    assert any(was_accepted(kind.run, seed) for seed in kind.seeds())


def sevens(data: bytes) -> None:
    if data == b"77":
        raise KeyError("an error that is not ours")
    if data == b"7":
        raise HarnessError("found a seven, needed none")
    if data == b"8":
        warnings.warn("overflow encountered", RuntimeWarning, stacklevel=1)
    while data == b"9":
        pass


def test_a_fault_is_told_from_a_refusal():
    assert was_accepted(sevens, b"1")
    assert not was_accepted(sevens, b"7")
    for data, error in ((b"77", KeyError), (b"8", RuntimeWarning), (b"9", TimeoutError)):
        with pytest.raises(error):
            was_accepted(sevens, data, cpu_limit=0.05)
