"""The report of a study of convergence, whole (`convergence.md`, as tests/compare/golden.py says), and its sentences."""

import dataclasses
from types import SimpleNamespace

import pytest

from looping_pendulum.compare.convergence import study
from looping_pendulum.compare.convergence.report import (
    convergence_markdown,
    format_setting,
    halting_verdict,
    ladders_table,
    opening,
    splits_table,
    verdict_cell,
)
from looping_pendulum.compare.convergence.result import (
    DROP,
    HALT,
    PATH_END_TIMES,
    QUANTITIES,
    ConvergenceResult,
    ConvergenceVerdict,
    ErrorCause,
    ErrorSplit,
    LadderStudy,
    Rung,
    RunSummary,
    RunTime,
    SequenceKind,
    StartChange,
    StudyClock,
    VariantStudy,
    VariationStudy,
)
from looping_pendulum.compare.convergence.study import reference_target
from looping_pendulum.compare.run_cache import EndedRun
from looping_pendulum.runs.trajectory import Provenance, Supplier, Supplies, Supply
from tests.apparatus import TEN_TO_ONE
from tests.compare.delayed import DelayedEngine
from tests.compare.golden import golden

EARLY, LATE = PATH_END_TIMES
BY_ENGINE, BY_NOBODY = Supply(by=Supplier.ENGINE, how="h"), Supply(by=Supplier.NOBODY, how="h")
SUPPLIES = Supplies(winding=BY_ENGINE, friction_law=BY_NOBODY, stick_slip=BY_NOBODY, drag=BY_NOBODY)


def run(key, i, **fields):
    """A run with an error of ``i`` in each quantity's thousandth, times 1.234567, twice, three times and four times."""
    x = 1.234567e-3 * i
    made = {"status": "FINISHED", "ok": True, "why": "ran", "rms": {EARLY: x, LATE: 2 * x}, "halting_time": 0.4 + x}
    others = {"halting_time_error": -3 * x, "drop_at_halt": 0.3, "drop_error": 4 * x, "string_stretch": 0.0}
    return RunSummary(key=key, **(made | others | fields))


FAILED = {"status": "CRASHED", "ok": False, "why": "it died"}
SKIPPED = {"status": "SKIPPED", "ok": False, "why": "left out"}


def verdict(quantity, kind=SequenceKind.CONVERGES, said=None):
    return ConvergenceVerdict(
        quantity=quantity, unit=QUANTITIES[quantity], kind=kind, why="", rungs=3, used=3, order=1.0, order_uncertainty=None,
        limit=None, uncertainty=1e-4, scatter=None, limit_error=1e-4, sentence=said or f"{quantity} is well",
    )  # fmt: skip


def rung(value, i, key, **fields):
    x = 1.234567e-3 * i
    return Rung(
        value=value, run=run(key, i, **fields), to_finest={EARLY: 5 * x, LATE: 6 * x}, to_limit={EARLY: 7 * x, LATE: 8 * x}
    )


def split(quantity, i, **fields):
    x = 1.23456e-3 * i
    made = {
        "error": x, "numerics": 2 * x, "numerics_uncertainty": 3 * x, "model": 4 * x, "model_uncertainty": 3 * x,
        "choice": 5 * x, "choice_of": "", "spread": 6 * x, "causes": (ErrorCause.MODEL,), "without_limit": (),
    }  # fmt: skip
    return ErrorSplit(quantity=quantity, unit=QUANTITIES[quantity], **(made | fields))


def variation(what, key, **fields):
    change = {EARLY: 1.2345e-3, LATE: 2.3456e-3, HALT: -3.4567e-3, DROP: None}
    return VariationStudy(what=what, ours="o", other="i", effect="e", run=run(key, 9, **fields), change=change)


def variant(name="a", **fields):
    ladder = LadderStudy(
        setting="dt", unit="s", follows="with sweeps", refined_further_by="", own=4e-4,
        rungs=(rung(8e-4, 3, "r8"), rung(4e-4, 2, f"own {name}"), rung(2e-4, 1, "r2", **SKIPPED)),
        verdicts=tuple(verdict(quantity) for quantity in QUANTITIES),
    )  # fmt: skip
    provenance = Provenance(
        versions={"p": "1", "q": "2"},
        settings={"dt": 1 / 3, "n": 7},
        supplies=SUPPLIES,
    )
    made = {
        "engine": "toy", "variant": name, "profile": "quick", "summary": "A toy.", "own": run(f"own {name}", 2),
        "ladders": (ladder,), "starts": (StartChange(what="angle +", run=run("s", 4)),),
        "spread": dict.fromkeys(QUANTITIES, 1.2345e-3), "choices": (variation("c", "c"),), "defaults": (variation("d", "d"),),
        "splits": (split(EARLY, 1), split(LATE, 2), split(HALT, 3)), "provenance": provenance,
    }  # fmt: skip
    return VariantStudy(**(made | fields))


def result(*variants, **fields):
    made = {
        "scenario": "made_up", "title": "Made up", "parameters": TEN_TO_ONE, "until": 0.7, "budget": None,
        "reference": "reference:exact",
        "reference_values": {HALT: 0.4123456, DROP: 0.3}, "floors": {}, "interrupted": False,
        "clock": StudyClock(written="then", run_times=(RunTime(key="x", seconds=1.4), RunTime(key="y", seconds=None),
                                                       RunTime(key="z", seconds=2.3))),
    }  # fmt: skip
    return ConvergenceResult(variants=variants or (variant(),), **(made | fields))


def cells(text, first, after=""):
    part = text[text.index(after) :] if after else text
    rows = [line.strip("|").split("|") for line in part.splitlines() if line.startswith(f"| {first} |")]
    return [[cell.strip() for cell in row] for row in rows]


NEVER_HALTS = {"halting_time": None, "halting_time_error": None}


def test_the_golden_report():
    """One variant with everything, one that fails, never halts and has nothing, and a figure of each."""
    (ladder,) = variant().ladders
    sizes = {EARLY: 1e-3, LATE: 2e-3, HALT: -3e-3, DROP: 4e-3}
    verdicts = tuple(dataclasses.replace(one, limit_error=sizes[one.quantity]) for one in ladder.verdicts)
    plain = dataclasses.replace(ladder, follows="", own=None, unit="", refined_further_by="time_step")
    starts = (*variant().starts, StartChange(what="angle -", run=run("t", 4, **FAILED)))
    whole = variant("a", ladders=(dataclasses.replace(ladder, verdicts=verdicts), plain), starts=starts)
    bare = variant(
        "b", own=run("o", 1, **NEVER_HALTS), splits=(), ladders=(), starts=(),
        choices=(variation("e", "e", **NEVER_HALTS),), defaults=(variation("f", "f", **FAILED),),
        provenance=Provenance(versions={}, settings={}, supplies=SUPPLIES),
    )  # fmt: skip
    broken = variant("c", own=run("o", 1, **NEVER_HALTS | FAILED), ladders=(), starts=(), splits=(), choices=(), defaults=())
    figures = {"f/a.png": ("toy:b", "Of b."), "f/b.png": ("toy:a", "Of a."), "f/c.png": ("toy:b", "Also b.")}
    made = result(whole, bare, broken)
    golden("convergence.md", convergence_markdown(made, figures) + "\n## Ladders\n\n" + ladders_table(made))


def test_the_opening_says_what_was_run_and_what_was_not():
    assert opening(result()) == (
        "Scenario `made_up`, simulated for 0.7 s and compared with reference:exact. The reference halts at 0.41235 s.\n"
    )
    # Of two variants the same left-out rung is one run.
    text = opening(result(variant("a"), variant("b"), budget=12.5, reference_values={HALT: None, DROP: None}))
    assert text == (
        "Scenario `made_up`, simulated for 0.7 s and compared with reference:exact. 1 run was left out because it "
        "was expected to take more than 12.5 s.\n"
    )
    others = variant(own=run("o", 1, **SKIPPED), choices=(variation("c", "c", **SKIPPED),), defaults=(), starts=(
        StartChange(what="angle +", run=run("s", 4, **SKIPPED)),
    ))  # fmt: skip
    assert " 4 runs were left out because they were expected to take more than 1 s.\n" in opening(result(others, budget=1))
    assert opening(result(interrupted=True)).endswith(
        " **Interrupted**: this report has the runs that had ended by then; run the same command again to continue.\n"
    )


def test_the_parts_of_an_error_are_stated_to_two_digits():
    table_rows = cells(splits_table(result()), "toy:a")
    assert table_rows[0] == ["toy:a", "different model", "1.2", "2.5", "4.9", "3.7", "6.2", "7.4"]
    assert table_rows[2] == ["toy:a", "different model", "3.7", "7.4", "15", "11", "19", "22"]
    unknown = variant(splits=(split(EARLY, 1, causes=(ErrorCause.UNKNOWN,), without_limit=("dt",)),))
    assert cells(splits_table(result(unknown), [EARLY]), "toy:a")[0][1] == "–"
    two = variant(splits=(split(EARLY, 1, causes=(ErrorCause.MODEL, ErrorCause.NOT_CONVERGED), without_limit=("dt",)),))
    cause = f"{ErrorCause.MODEL.value}, then {ErrorCause.NOT_CONVERGED.value} (no limit known for dt)"
    assert cells(splits_table(result(two), [EARLY]), "toy:a")[0][1] == cause
    nothing = result(variant(splits=()))
    assert "error [mm]" in splits_table(nothing, [EARLY])
    assert "error [ms]" in splits_table(nothing, [HALT])
    assert "error [mm]" in splits_table(nothing, [DROP])


@pytest.mark.parametrize(
    ("own", "quantity", "said"),
    [
        (run("o", 1, **NEVER_HALTS), HALT, "never halts"),
        (run("o", 1, **NEVER_HALTS), EARLY, "the reference has no value"),
        (run("o", 1), HALT, "the reference has no value"),
        (run("o", 1, **FAILED), HALT, "it died"),
        (run("o", 1, **FAILED | {"why": "the string drifted; shorten the time step"}), EARLY, "the string drifted"),
    ],
)
def test_why_there_is_no_split(own, quantity, said):
    made = result(variant(own=own, splits=()))
    assert cells(splits_table(made, [quantity]), "toy:a") == [["toy:a", said, *["–"] * 6]]


def with_kinds(*kinds, **fields):
    """A variant with a ladder for each kind, whose halting times scatter by 2, 4, 6, ... ms."""
    ladders = [
        dataclasses.replace(
            variant().ladders[0],
            setting=f"dt{k}",
            verdicts=(dataclasses.replace(verdict(HALT, kind), scatter=2e-3 * (k + 1)),),
        )
        for k, kind in enumerate(kinds)
    ]
    return variant(ladders=tuple(ladders), **fields)


CONVERGES, NEVER, SCATTERS = SequenceKind.CONVERGES, SequenceKind.NEVER, SequenceKind.SCATTERS


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (with_kinds(), "the adapter offers no ladder"),
        (with_kinds(NEVER, NEVER), "never halts"),
        (with_kinds(CONVERGES, own=run("o", 1, **FAILED)), "its run at its own settings does not end properly"),
        (with_kinds(CONVERGES, NEVER, own=run("o", 1, **NEVER_HALTS)), "no; it halts only with some settings"),
        (with_kinds(SCATTERS, CONVERGES, SCATTERS), "no; it scatters by ± 6 ms"),
        (with_kinds(CONVERGES, NEVER), "no; it scatters by ± 0 ms"),
        (with_kinds(CONVERGES, SequenceKind.UNKNOWN), "along some ladder too few runs halt to tell"),
        (with_kinds(CONVERGES, SequenceKind.SETTLED, splits=()), "along some ladder too few runs halt to tell"),
        (
            with_kinds(CONVERGES, SequenceKind.WITHIN_SPREAD),
            "only to within ± 11 ms, the spread of small changes of the start",
        ),
        (with_kinds(CONVERGES, SequenceKind.SETTLED), "yes, to within ± 11 ms"),
    ],
)
def test_whether_the_halting_time_converges(made, said):
    assert halting_verdict(made).startswith(said)


def test_a_ladder_that_another_refines_further_does_not_decide():
    """It decided: `mujoco:capstan` was said not to converge for a ladder whose coarse end its time step's ladder passes."""
    decides, other = with_kinds(CONVERGES, SCATTERS).ladders
    ladders = (decides, dataclasses.replace(other, refined_further_by="dt0"))
    assert halting_verdict(variant(ladders=ladders)) == "yes, to within ± 11 ms"


@pytest.mark.parametrize(
    ("kind", "limit", "said"),
    [
        (CONVERGES, -3e-3, "order 1.5 → 3 ± 1"),
        (SequenceKind.SETTLED, -3e-3, "settled → 3 ± 1"),
        (SCATTERS, -3e-3, "± 4 about 3 ± 1"),
        (SequenceKind.WITHIN_SPREAD, -3e-3, "± 4 about 3 ± 1, in the spread"),
        (SCATTERS, None, "halts on some rungs"),
        (NEVER, None, "never halts"),
        (SequenceKind.UNKNOWN, None, "–"),
    ],
)
def test_a_verdict_fits_a_cell(kind, limit, said):
    assert verdict_cell(SimpleNamespace(kind=kind, order=1.5, limit_error=limit, uncertainty=1e-3, scatter=4e-3)) == said


def test_angles_stay_in_radians():
    assert format_setting(0.28, "rad") == "0.28 rad"
    assert format_setting(5e-3, "m") == "5 mm"


def test_a_result_comes_back_from_its_file_and_the_report_is_beside_it(tmp_path, monkeypatch):
    drawn = {"x.png": ("toy:a", "A figure.", b"png")}
    monkeypatch.setattr("looping_pendulum.compare.convergence.report.draw", lambda _: drawn)
    whole = result()
    report = study.write(whole, tmp_path)
    assert report == tmp_path / "convergence.md"
    assert "![A figure.](figures/x.png)" in report.read_text(encoding="utf-8")
    assert (tmp_path / "figures" / "x.png").read_bytes() == b"png"
    text = (tmp_path / "convergence.json").read_text(encoding="utf-8")
    assert ConvergenceResult.from_json(text) == whole
    assert '"id": "looping-pendulum/convergence",\n    "version": 4' in text


@pytest.mark.parametrize(("halt", "duration"), [(None, 0.7), (0.5, 0.7), (0.65, 0.75), (0.8123456, 0.912), (2.0, 1.05)])
def test_a_study_is_watched_to_a_tenth_of_a_second_after_the_halt(scenario, monkeypatch, halt, duration):
    """And to the last of the marks, 0.7 s, at least; but no longer than the scenario lasts."""
    monkeypatch.setattr(study, "Reference", lambda scenario: None)
    monkeypatch.setattr(study, "reference_target", lambda *_: SimpleNamespace(numbers={HALT: halt}))
    assert study.cut_to_watched(scenario, None).duration == pytest.approx(duration)


class Exact:
    """A reference that says which engine it is of."""

    def __init__(self, reference):
        self._reference, self.engine = reference, DelayedEngine()

    def __call__(self, t):
        return self._reference(t)


def test_a_study_makes_every_run_of_every_engine_once(tmp_path, scenario, reference, make_run, monkeypatch):
    """Oracle: the plan itself. Time limits are cut to twice a budget: what takes longer would be left out anyway."""
    asked = []

    class Recorder:
        def __init__(self, kept, **limits):
            asked.append((kept.folder, limits))
            self.cancelled = SimpleNamespace(is_set=lambda: False)

        def run(self, tasks):
            asked.append([task.key for task in tasks])
            return {task.key: EndedRun(run=make_run(), seconds=float(k)) for k, task in enumerate(tasks)}

    monkeypatch.setattr(study, "Runner", Recorder)
    monkeypatch.setattr(study, "Reference", lambda _: None)
    monkeypatch.setattr(
        study,
        "reference_target",
        lambda where, _: dataclasses.replace(reference_target(where, reference), reference=Exact(reference)),
    )
    engines = [DelayedEngine(), DelayedEngine(order=2.0)]
    study_result = study.study_convergence(scenario, engines, tmp_path, until=1.05, budget=3.0, jobs=1, time_limit=10.0)
    (folder, limits), keys = asked
    assert folder == tmp_path / "runs"
    assert (limits["time_limit"], limits["budget"], limits["jobs"]) == (6.0, 3.0, 1)
    assert [v.label for v in study_result.variants] == ["delayed:exact"] * 2
    assert [one.key for one in study_result.clock.run_times] == sorted(set(keys))
    assert (study_result.until, study_result.budget, study_result.reference, study_result.interrupted) == (
        1.05,
        3.0,
        "delayed:exact",
        False,
    )
    assert study_result.reference_values[HALT] == pytest.approx(0.3375, abs=1e-6)
    asked.clear()
    study.study_convergence(scenario, [], tmp_path, until=1.05, budget=8.0, jobs=1, time_limit=10.0)
    assert asked[0][1]["time_limit"] == 10.0
    asked.clear()
    study.study_convergence(scenario, [], tmp_path, until=1.05, jobs=1, time_limit=10.0)
    assert asked[0][1]["time_limit"] == 10.0
