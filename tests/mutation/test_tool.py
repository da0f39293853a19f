"""The mutation tool itself: what it draws, what it changes, and the interval that it states."""

import importlib
import sys

import pytest
from scipy.stats import binomtest

pytest.importorskip("cosmic_ray", reason="the extra `mutation` is not installed")

from tests.mutation.mutants import Mutant, all_mutants, changed_lines, mutated, sample
from tests.mutation.summary import Asked, summary, wilson
from tests.mutation.zygote import enclosing_function, lay

SOURCE = """\
from __future__ import annotations


def share(part: int | None, *, whole: float = 2.0) -> float | None:
    if part is None:
        return None
    return part / (whole - 1)
"""


@pytest.fixture
def project(tmp_path):
    (tmp_path / "package").mkdir()
    (tmp_path / "package" / "share.py").write_text(SOURCE)
    return tmp_path


def asked(caught, line=7):
    return Asked(
        key=f"{caught} {line}", path="package/share.py", line=line, operator="AddNot", before="a", after="b",
        outcome="test failed" if caught else "survived", by="", tests=1, seconds=1.0, source="", test_source="",
    )  # fmt: skip


@pytest.mark.parametrize(("caught", "of"), [(0, 7), (7, 7), (58, 60), (180, 200), (1, 1)])
def test_the_interval_is_wilsons(caught, of):
    exact = binomtest(caught, of).proportion_ci(method="wilson")
    assert wilson(caught, of) == pytest.approx((exact.low, exact.high), abs=1e-6)


def test_mutants_change_code_and_neither_annotations_nor_signatures(project):
    mutants = all_mutants(project, ["package"])
    changes = {changed_lines(project, m) for m in mutants}
    before = "return part / (whole - 1)"
    assert (before, "return part * (whole - 1)") in changes
    assert (before, "return part / (whole + 1)") in changes
    assert {after for b, after in changes if b.startswith("def")} == {
        "def share(part: int | None, *, whole: float = 3.0) -> float | None:",
        "def share(part: int | None, *, whole: float = 1.0) -> float | None:",
    }
    assert all(mutated(project, m) != SOURCE for m in mutants)
    for mutant in mutants:
        compile(mutated(project, mutant), "share.py", "exec")


def test_a_larger_sample_begins_with_the_smaller_one(project):
    mutants = all_mutants(project, ["package"])
    assert sample(mutants, 5, seed=3) == sample(mutants, 10, seed=3)[:5]
    assert sample(mutants, 10, seed=3) != sample(mutants, 10, seed=4)
    assert sorted(sample(mutants, None, seed=3)) == sorted(mutants)


def test_every_mutant_is_drawn_equally_often(project):
    # Oracle: a binomial count of 2000 draws; bound: 5 standard deviations, for fewer than a hundred mutants together.
    mutants = all_mutants(project, ["package"])
    counts = dict.fromkeys(mutants, 0)
    for seed in range(2000):
        (one,) = sample(mutants, 1, seed)
        counts[one] += 1
    p = 1 / len(mutants)
    assert all(abs(n - 2000 * p) < 5 * (2000 * p * (1 - p)) ** 0.5 for n in counts.values())


def test_equivalent_mutants_are_counted_apart():
    result = summary("x", [asked(True), asked(True, 8), asked(False)], 10, 1, {("package/share.py", "a", "b"): "same"}, [])
    assert (result["caught"], result["share"], result["share_without_equivalent"]) == (2, 0.6667, 1.0)
    assert result["survivors"][0]["equivalent"] == "same"


LIVE = """\
import functools


@functools.lru_cache
def half(x):
    return x / 2


class Number:
    @property
    def third(self):
        return [x / 3 for x in (self.value,)][0]

    value = 6.0
"""


@pytest.fixture
def live(tmp_path, monkeypatch):
    (tmp_path / "live_numbers.py").write_text(LIVE)
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path, importlib.import_module("live_numbers")
    del sys.modules["live_numbers"]


def test_a_mutant_is_laid_into_what_is_imported_already(live):
    folder, module = live
    half, number = module.half, module.Number()
    assert lay("live_numbers", "half", LIVE.replace("x / 2", "x * 2"))
    assert half(3) == 6
    assert lay("live_numbers", "Number.third", LIVE.replace("x / 3", "x + 3"))
    assert number.third == 9
    assert not lay("live_numbers", "Number.fourth", LIVE)
    assert not lay("live_numbers", "half", "\n" + LIVE), "another line: not the function that was asked for"


def test_only_what_runs_when_a_function_is_called_can_be_laid(live):
    folder, _ = live

    def function(line):
        return enclosing_function(folder, Mutant(path="live_numbers.py", operator="core/AddNot", occurrence=0, line=line))

    assert [function(line) for line in (4, 6, 12, 14)] == ["", "half", "Number.third", ""]
