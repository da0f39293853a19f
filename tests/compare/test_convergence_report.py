"""The report of a study of convergence, whole (`convergence.md`, as tests/compare/golden.py says), and what it escapes."""

import dataclasses
import re
from types import SimpleNamespace

import pytest

from looping_pendulum.compare.convergence import study
from looping_pendulum.compare.convergence.report import convergence_markdown
from looping_pendulum.compare.convergence.result import (
    DROP,
    HALT,
    PATH_END_TIMES,
    QUANTITIES,
    ConvergenceResult,
    LadderStudy,
    QuantityVerdict,
    Rung,
    RunSummary,
    StudyClock,
    VariantStudy,
    VariationStudy,
    Verdict,
)
from looping_pendulum.compare.convergence.study import reference_target
from looping_pendulum.compare.convergence.verdict import RESOLUTION, format_setting
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
    errors = {EARLY: x, LATE: 2 * x, HALT: -3 * x, DROP: 4 * x}
    made = {"status": "FINISHED", "ok": True, "why": "ran", "errors": errors, "halting_time": 0.4 + x}
    return RunSummary(key=key, **(made | fields))


FAILED = {"status": "CRASHED", "ok": False, "why": "it died"}
NEVER_HALTS = {"halting_time": None, "errors": {EARLY: 1e-3, LATE: None, HALT: None, DROP: None}}


def verdict(quantity, i=1, **fields):
    x = 1.23456e-3 * i
    made = {"refinement": 2 * x, "limit_error": 4 * x, "uncertainty": 3 * x, "sentence": f"another limit: {quantity} is so"}
    return QuantityVerdict(quantity=quantity, verdict=Verdict.ANOTHER_LIMIT, **(made | fields))


def rung(value, i, key, **fields):
    x = 1.234567e-3 * i
    return Rung(value=value, run=run(key, i, **fields), to_limit={EARLY: 7 * x, LATE: 8 * x, HALT: None, DROP: None})


def variation(what, key, **fields):
    change = {EARLY: 1.2345e-3, LATE: 2.3456e-3, HALT: -3.4567e-3, DROP: None}
    return VariationStudy(what=what, ours="o", other="i", effect="e", run=run(key, 9, **fields), change=change)


def variant(name="a", **fields):
    ladder = LadderStudy(
        setting="time_step", unit="s", follows="with sweeps", refined_further_by="", own=4e-4,
        rungs=(rung(8e-4, 3, "r8"), rung(4e-4, 2, f"own {name}"), rung(2e-4, 1, "r2", **FAILED)),
        verdicts=tuple(verdict(quantity) for quantity in QUANTITIES),
    )  # fmt: skip
    provenance = Provenance(
        versions={"p": "1", "q": "2"},
        settings={"time_step": 1 / 3, "n": 7},
        supplies=SUPPLIES,
    )
    made = {
        "engine": "toy", "variant": name, "profile": "quick", "summary": "A toy.", "own": run(f"own {name}", 2),
        "ladders": (ladder,), "spread": dict.fromkeys(QUANTITIES, 1.2345e-3),
        "choices": (variation("c", "c"),), "defaults": (variation("d", "d"),),
        "verdicts": (verdict(EARLY, 1), verdict(LATE, 2), verdict(HALT, 3)), "provenance": provenance,
    }  # fmt: skip
    return VariantStudy(**(made | fields))


def result(*variants, **fields):
    made = {
        "scenario": "made_up", "title": "Made up", "parameters": TEN_TO_ONE, "until": 0.7, "time_limit": 60.0,
        "reference": "reference:exact", "reference_values": {HALT: 0.4123456, DROP: 0.3}, "resolution": RESOLUTION,
        "interrupted": False, "clock": StudyClock(written="then", run_times={"x": 1.4, "y": None, "z": 2.3}),
    }  # fmt: skip
    return ConvergenceResult(variants=variants or (variant(),), **(made | fields))


def test_the_golden_report():
    """One variant with everything, one that never halts and has nothing, one that fails, and a figure of each."""
    (ladder,) = variant().ladders
    plain = dataclasses.replace(ladder, follows="", own=None, unit="", refined_further_by="stiffness")
    whole = variant("a", ladders=(ladder, plain))
    bare = variant(
        "b", own=run("o", 1, **NEVER_HALTS), ladders=(), choices=(variation("e", "e", **NEVER_HALTS),),
        defaults=(variation("f", "f", **FAILED),), provenance=Provenance(versions={}, settings={}, supplies=SUPPLIES),
        verdicts=(verdict(HALT, refinement=None, limit_error=None, uncertainty=None),),
    )  # fmt: skip
    broken = variant("c", own=run("o", 1, **NEVER_HALTS | FAILED), ladders=(), verdicts=(), choices=(), defaults=())
    figures = {"f/a.png": ("toy:b", "Of b."), "f/b.png": ("toy:a", "Of a."), "f/c.png": ("toy:b", "Also b.")}
    golden("convergence.md", convergence_markdown(result(whole, bare, broken), figures))


def test_the_opening_says_where_the_reference_halts_and_that_a_study_was_interrupted():
    text = convergence_markdown(result())
    assert "Scenario `made_up`, simulated for 0.7 s and compared with reference:exact." in text
    assert "The reference halts at 0.41235 s." in text
    assert "Interrupted" not in text
    text = convergence_markdown(result(reference_values={HALT: None, DROP: None}, interrupted=True))
    assert "halts at" not in text
    assert "**Interrupted**: this report has the runs that had ended by then; run the same command again to continue." in text


def test_what_others_wrote_cannot_become_markup():
    bad = "<script>x</script> | *a* `b`\n# c"
    (ladder,) = variant().ladders
    made = variant(
        "a", summary=bad, own=run("o", 1, why=bad), choices=(variation(bad, "c", why=bad, ok=False),),
        ladders=(dataclasses.replace(ladder, follows=bad, setting=bad),),
        verdicts=(verdict(EARLY, sentence=bad),),
        provenance=Provenance(versions={bad: bad}, settings={bad: bad}, supplies=SUPPLIES),
    )  # fmt: skip
    text = convergence_markdown(result(made, title=bad, scenario=bad), {"f.png": ("toy:a", bad)})
    shown = re.sub(r"`[^`\n]*`", "", text)  # in code, nothing is markup
    assert "script" in shown
    assert "<script" not in shown.replace("\\<", "")
    assert "\n# c" not in text
    for line in text.splitlines():
        if line.startswith("| toy:a"):
            head = next(row for row in text[: text.index(line)].splitlines()[::-1] if row.startswith("| variant"))
            assert line.replace("\\|", "").count("|") == head.count("|")


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
    assert '"id": "looping-pendulum/convergence",\n    "version": 5' in text


@pytest.mark.parametrize(("halt", "duration"), [(None, 0.7), (0.5, 0.7), (0.65, 0.75), (0.8123456, 0.912), (2.0, 1.05)])
def test_a_study_is_watched_to_a_tenth_of_a_second_after_the_halt(scenario, monkeypatch, halt, duration):
    """And to the last of the marks, 0.7 s, at least; but no longer than the scenario lasts."""
    monkeypatch.setattr(study, "Reference", lambda scenario: None)
    monkeypatch.setattr(study, "reference_target", lambda *_: SimpleNamespace(numbers={HALT: halt}))
    assert study.cut_to_watched(scenario, None).duration == pytest.approx(duration)
    assert study.cut_to_watched(scenario, 0.4).duration == 0.4


class Exact:
    """A reference that says which engine it is of."""

    def __init__(self, reference):
        self._reference, self.engine = reference, DelayedEngine()

    def __call__(self, t):
        return self._reference(t)


def test_a_study_makes_every_run_of_every_engine_once(tmp_path, scenario, reference, make_run, monkeypatch):
    """Oracle: the plan itself."""
    asked = []

    def made(tasks, folder, *, cancelled, **limits):
        asked.append(({task.key for task in tasks}, folder, limits))
        return {task.key: make_run() for task in tasks}

    monkeypatch.setattr(study, "make_runs", made)
    monkeypatch.setattr(study, "Reference", lambda _: None)
    monkeypatch.setattr(
        study,
        "reference_target",
        lambda where, _: dataclasses.replace(reference_target(where, reference), reference=Exact(reference)),
    )
    engines = [DelayedEngine(), DelayedEngine(order=2.0)]
    study_result = study.study_convergence(scenario, engines, tmp_path, until=1.05, jobs=1, time_limit=10.0)
    ((keys, folder, limits),) = asked
    assert folder == tmp_path / "runs"
    assert (limits["time_limit"], limits["jobs"]) == (10.0, 1)
    assert [v.label for v in study_result.variants] == ["delayed:exact"] * 2
    assert study_result.clock.run_times.keys() == keys
    assert (study_result.until, study_result.time_limit, study_result.reference, study_result.interrupted) == (
        1.05,
        10.0,
        "delayed:exact",
        False,
    )
    assert study_result.reference_values[HALT] == pytest.approx(0.3375, abs=1e-6)
