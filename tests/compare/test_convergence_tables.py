"""The tables of a study of convergence: every cell has a number of its own, so that none can stand in another's place."""

from types import SimpleNamespace

import pytest

from looping_pendulum.compare.convergence.report import (
    choices_table,
    defaults_table,
    format_setting,
    halting_table,
    halting_verdict,
    ladders_table,
    splits_table,
    verdict_cell,
)
from looping_pendulum.compare.convergence.result import DROP, HALT, PATH_END_TIMES, ErrorCause, SequenceKind

EARLY, LATE = PATH_END_TIMES


RUNGS = ((8e-4, "FINISHED"), (2e-4, "FINISHED"), (1e-4, "SKIPPED"))


def a_run(i, *, ok=True, halting_time=0.4, why="", status="FINISHED"):
    """A run whose figures are ``i`` times 1, 2, 3 and 4 thousandths."""
    rms = {EARLY: 1e-3 * i, LATE: 2e-3 * i}
    late = None if halting_time is None else -3e-3 * i
    return SimpleNamespace(ok=ok, why=why, status=status, rms=rms, halting_time=halting_time, halting_time_error=late,
                           drop_error=4e-3 * i)  # fmt: skip


def a_split(name, unit, i):
    return SimpleNamespace(
        quantity=name, unit=unit, error=1e-3 * i, numerics=2e-3 * i, model=3e-3 * i, numerics_uncertainty=4e-3 * i,
        choice=5e-3 * i, spread=6e-3 * i, causes=(ErrorCause.MODEL, ErrorCause.NOT_CONVERGED), without_limit=("dt",),
    )  # fmt: skip


def a_verdict(name, kind=SequenceKind.CONVERGES, scatter=None):
    size = {EARLY: 1e-3, LATE: 2e-3, HALT: -3e-3}[name]
    return SimpleNamespace(quantity=name, kind=kind, scatter=scatter, order=2.0, limit_error=size, uncertainty=abs(size) / 2)


def a_variant(kinds=(SequenceKind.CONVERGES,), own=None, splits=None):
    ladders = [
        SimpleNamespace(
            setting=f"dt{k}", unit="s", own=None, follows="", refined_further_by="",
            rungs=[SimpleNamespace(value=v, run=a_run(1, status=s)) for v, s in RUNGS],
            verdicts=[a_verdict(EARLY), a_verdict(LATE), a_verdict(HALT, kind, 2e-3 * (k + 1))],
        )
        for k, kind in enumerate(kinds)
    ]  # fmt: skip
    names = ((EARLY, "m", 1), (LATE, "m", 2), (HALT, "s", 3))
    return SimpleNamespace(
        label="toy:chain", own=own or a_run(7), ladders=ladders, spread={HALT: 5e-5, EARLY: None, LATE: None, DROP: None},
        splits=[a_split(*name) for name in names] if splits is None else splits, choices=[], defaults=[],
    )  # fmt: skip


def rows(text, first="toy:chain"):
    lines = [line.strip("|").split("|") for line in text.splitlines() if line.startswith(f"| {first} |")]
    return [[cell.strip() for cell in row] for row in lines]


def test_every_quantitys_split_stands_in_its_own_table():
    result = SimpleNamespace(variants=[a_variant()])
    table_rows = rows(splits_table(result))
    cause = f"{ErrorCause.MODEL.value}, then {ErrorCause.NOT_CONVERGED.value} (no limit known for dt)"
    assert table_rows == [["toy:chain", cause, *(str(k * i) for k in range(1, 7))] for i in (1, 2, 3)]
    assert splits_table(result).count("[mm]") == 2
    assert splits_table(result).count("[ms]") == 1


@pytest.mark.parametrize(
    ("own", "said"),
    [
        (a_run(1, halting_time=None), "never halts"),
        (a_run(1), "the reference has no value"),
        (a_run(1, ok=False, why="died"), "died"),
    ],
)
def test_why_there_is_no_split(own, said):
    variant = a_variant(own=own, splits=[])
    assert rows(splits_table(SimpleNamespace(variants=[variant]), [HALT])) == [["toy:chain", said, *["–"] * 6]]
    if own.ok:
        assert rows(splits_table(SimpleNamespace(variants=[variant]), [EARLY]))[0][1] == "the reference has no value"


@pytest.mark.parametrize(
    ("kinds", "own", "said"),
    [
        ((), a_run(1), "the adapter offers no ladder"),
        ((SequenceKind.NEVER, SequenceKind.NEVER), a_run(1), "never halts"),
        ((SequenceKind.CONVERGES,), a_run(1, ok=False), "its run at its own settings does not end properly"),
        ((SequenceKind.CONVERGES, SequenceKind.NEVER), a_run(1, halting_time=None), "no; it halts only with some settings"),
        ((SequenceKind.SCATTERS, SequenceKind.CONVERGES, SequenceKind.SCATTERS), a_run(1), "no; it scatters by ± 6 ms"),
        ((SequenceKind.CONVERGES, SequenceKind.NEVER), a_run(1), "no; it scatters by ± 0 ms"),
        ((SequenceKind.CONVERGES, SequenceKind.UNKNOWN), a_run(1), "along some ladder too few runs halt to tell"),
        (
            (SequenceKind.CONVERGES, SequenceKind.WITHIN_SPREAD),
            a_run(1),
            "only to within ± 12 ms, the spread of small changes of the start",
        ),
        ((SequenceKind.CONVERGES, SequenceKind.SETTLED), a_run(1), "yes, to within ± 12 ms"),
    ],
)
def test_whether_the_halting_time_converges(kinds, own, said):
    assert halting_verdict(a_variant(kinds, own)).startswith(said)
    if kinds == (SequenceKind.CONVERGES, SequenceKind.SETTLED):
        assert halting_verdict(a_variant(kinds, own, splits=[])) == "along some ladder too few runs halt to tell"


def test_a_ladder_that_another_refines_further_does_not_decide():
    """It decided: `mujoco:capstan` was said not to converge for a ladder whose coarse end its time step's ladder passes."""
    variant = a_variant((SequenceKind.CONVERGES, SequenceKind.SCATTERS))
    variant.ladders[1].refined_further_by = "dt0"
    assert halting_verdict(variant) == "yes, to within ± 12 ms"


def test_the_halting_table_has_error_and_spread_in_milliseconds():
    (row,) = rows(halting_table(SimpleNamespace(variants=[a_variant()])))
    assert row[2:4] == ["-21", "0.05"]
    (row,) = rows(halting_table(SimpleNamespace(variants=[a_variant(own=a_run(1, halting_time=None))])))
    assert row[2] == "does not halt"


def test_choices_and_defaults_say_what_moves():
    variant = a_variant()
    change = {EARLY: 1e-3, LATE: 2e-3, HALT: 3e-3}
    one = SimpleNamespace(what="start", ours="now", other="then", effect="lateness", change=change, run=a_run(9))
    variant.choices, variant.defaults = [one], [one]
    result = SimpleNamespace(variants=[variant])
    assert rows(choices_table(result)) == [["toy:chain", "start", "now", "then", "1", "2", "+3", ""]]
    assert rows(defaults_table(result)) == [["toy:chain", "start", "then", "now", "lateness", "+3", "7", "9", ""]]
    one.run = a_run(9, halting_time=None)
    assert rows(choices_table(result))[0][-1] == "never halts"
    one.run = a_run(9, ok=False, why="died")
    assert rows(choices_table(result))[0][-1] == "died"


def test_ladders_are_reported_from_the_first_to_the_last_rung_that_ran():
    (row,) = rows(ladders_table(SimpleNamespace(variants=[a_variant()])))
    assert row == [
        "toy:chain",
        "dt0",
        "0.8 ms",
        "0.2 ms",
        "2 of 3",
        "order 2 → 1 ± 0.5",
        "order 2 → 2 ± 1",
        "order 2 → 3 ± 1.5",
    ]
    head, rule = ladders_table(SimpleNamespace(variants=[a_variant()])).splitlines()[:2]
    assert rule.split("|")[1:-1] == [" --- "] * 8, "words and amounts with their units: all to the left"
    assert len(head.split("|")) == len(rule.split("|"))
    variant = a_variant()
    for rung in variant.ladders[0].rungs:
        rung.run.status = "NOT_RUN"
    assert rows(ladders_table(SimpleNamespace(variants=[variant])))[0][2:5] == ["–", "–", "0 of 3"]


@pytest.mark.parametrize(
    ("kind", "limit", "said"),
    [
        (SequenceKind.CONVERGES, -3e-3, "order 1.5 → 3 ± 1"),
        (SequenceKind.SETTLED, -3e-3, "settled → 3 ± 1"),
        (SequenceKind.SCATTERS, -3e-3, "± 4 about 3 ± 1"),
        (SequenceKind.WITHIN_SPREAD, -3e-3, "± 4 about 3 ± 1, in the spread"),
        (SequenceKind.SCATTERS, None, "halts on some rungs"),
        (SequenceKind.NEVER, None, "never halts"),
        (SequenceKind.UNKNOWN, None, "–"),
    ],
)
def test_a_verdict_fits_a_cell(kind, limit, said):
    assert verdict_cell(SimpleNamespace(kind=kind, order=1.5, limit_error=limit, uncertainty=1e-3, scatter=4e-3)) == said


def test_a_failed_run_is_named_without_its_advice():
    failed = a_variant(own=a_run(1, ok=False, why="the string drifted; shorten the time step"), splits=[])
    assert rows(splits_table(SimpleNamespace(variants=[failed]), [EARLY]))[0][1] == "the string drifted"


def test_angles_stay_in_radians():
    assert format_setting(0.28, "rad") == "0.28 rad"
    assert format_setting(5e-3, "m") == "5 mm"
