"""The report, whole, from a result in which every number is another, and what it says in cases that this one does not have.

`report.md` holds the whole. After a change that is meant, run ``GOLDEN=write python -m pytest tests/compare -k golden``,
read the difference, and commit both.
"""

import dataclasses
import math

import numpy as np
import pytest

from looping_pendulum.compare import compare, report
from looping_pendulum.compare.report import comparison_markdown
from looping_pendulum.compare.result import ToleranceOutcome, WallTime
from looping_pendulum.compare.trajectories import trajectory_csv, trajectory_files
from looping_pendulum.pages.markdown import table as markdown
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.runs.events import RESOLUTIONS, Extremum, HaltingTimeAt, Landmarks
from looping_pendulum.runs.trajectory import RunStatus, Supplier, Supplies, Supply
from looping_pendulum.scenarios.scenario import Inference
from tests.compare.golden import golden
from tests.compare.report_cells import (
    BAD,
    FEARED,
    GOOD,
    ME,
    METRICS,
    OWN,
    TRUE,
    at,
    cells,
    gone,
    limit,
    measured,
    rendered,
    section,
    with_engine,
)


@pytest.fixture
def whole(result):
    """A result with everything that a report may say."""
    (engine,) = result.engines
    makers = {"winding": "engine", "friction_law": "adapter", "stick_slip": "adapter", "drag": "nobody"}
    supplies = Supplies(**{what: Supply(by=Supplier(by), how="by hand") for what, by in makers.items()})
    marks = dataclasses.replace(
        OWN, stops=at(0.2031, 0.3987, 0.6), slip_onsets=(0.2512,), light_reaches_rod=0.9049,
        x1_extrema=(Extremum(time=0.3042, value=0.0),), y1_extrema=(Extremum(time=0.4053, value=0.0),),
    )  # fmt: skip
    known = dataclasses.replace(
        TRUE, stops=at(0.2, 0.4), slip_onsets=(0.25,), light_reaches_rod=0.9,
        x1_extrema=(Extremum(time=0.3, value=0.0),), y1_extrema=(Extremum(time=0.4, value=0.0),),
    )  # fmt: skip
    own = dataclasses.replace(
        engine, landmarks=marks, metrics=METRICS | {"tube_fraction": 0.97654},
        tube=dataclasses.replace(engine.tube, half_time=0.123456, half_width=0.654321),
        departures=(gone(1e-3, 0.1234), gone(1e-2, 0.2345)), growth_rate=12.345,
        story="It lost its way.", message="first\nlast `word`\n", outside_range=("a thick rod", "much drag"),
        additions=("a spring, 3 mm", "a brake"), from_reference=("the length of a step",),
        provenance=dataclasses.replace(
            engine.provenance, supplies=supplies, settings={"dt": 1 / 3, "n": 7}, seed=0, versions={"a": "1", "b": "2"}
        ),
    )  # fmt: skip
    short = dataclasses.replace(
        engine, variant="short", not_comparable="it is short", departures=(gone(1e-2, 0.5),),
        landmarks=dataclasses.replace(OWN, halting_times=(HaltingTimeAt(resolution=1e-5, time=None), *OWN.halting_times[1:])),
        provenance=dataclasses.replace(engine.provenance, supplies=supplies, settings={}, versions={}, seed=12),
    )  # fmt: skip
    gap = dataclasses.replace(engine, variant="gap", available=False, status_sentence="it is not there")
    rows = (
        limit(GOOD), limit(BAD, "tube_fraction", None, "no value: too short"), limit(GOOD, "no_metric_of_ours", 5.0),
        limit(ToleranceOutcome.UNEXPECTED_PASS, "drop_error"), limit(FEARED, "wrap_angle_error", expected_failure="it turns"),
    )  # fmt: skip
    trial = (
        measured(engines=(0.43, 0.44, None)),
        measured(quantity="wrap_angle_at_halt", unit="rad", measured=None, paper_numerical=3.98765, reference=4.0,
                 engines=(None, 4.1, None)),
        measured(quantity="drop_at_halt", unit="m", measured=None, paper_numerical=None, reference=0.25,
                 engines=(0.43, None, None)),
        measured(quantity="x1_extremum", index=2, measured=0.3, paper_numerical=None, reference=None,
                 engines=(0.29, 0.3456, None)),
    )  # fmt: skip
    times = WallTime(
        engine="pymunk:chain", profile="quick", seconds=1.234, per_simulated_second=5.678, cpu_seconds=0.9876,
        cpu_per_simulated_second=4.321,
    )  # fmt: skip
    unknown = dataclasses.replace(times, seconds=None)
    return dataclasses.replace(
        result, engines=(own, short, gap), tolerances=rows, measured=trial, measured_source="a paper",
        reference=dataclasses.replace(result.reference, sampled=known),
        clock=dataclasses.replace(result.clock, written="then", wall_times=(times, unknown, unknown)),
        inferred=(
            Inference(parameters=("mu", "k"), how="Fitted.", script="fit.py"),
            Inference(parameters=("m",), how="Weighed.", script=""),
        ),
    )  # fmt: skip


def test_the_golden_report(whole):
    text = report.comparison_markdown(whole, {"figures/a.png": "First.", "figures/b.png": "Second."})
    golden("report.md", text.partition("\n## Words")[0])  # of the glossary


def test_a_vertical_release_has_a_column_for_its_acceleration(result):
    vertical = with_engine(result, metrics=METRICS | {"acceleration_error": -0.0123})
    head, (true, own) = report.verdict_rows(vertical)
    assert len(head) == len(true) == len(own) == 11
    assert head[-2:] == ["acceleration error [%]", "CPU time [s per s]"]
    assert own[-3:] == ["+7.7", "-1.23", "1"]
    assert true[6:] == ["0.5123", "–", "–", "–", "–"]


@pytest.mark.parametrize(
    ("outcomes", "said"),
    [
        ((), "no limits declared"),
        ((GOOD, GOOD), "yes"),
        ((GOOD, FEARED), "yes; 1 expected failure"),
        ((GOOD, FEARED, FEARED), "yes; 2 expected failures"),
        ((FEARED,), "as expected, no; 1 expected failure"),
        ((FEARED, FEARED), "as expected, no; 2 expected failures"),
        ((BAD, GOOD), "no (1 of 2 limits)"),
        ((BAD, ToleranceOutcome.UNEXPECTED_PASS, FEARED), "no (2 of 3 limits); 1 expected failure"),
    ],
)
def test_whether_it_is_within_tolerance(result, outcomes, said):
    judged = dataclasses.replace(result, tolerances=tuple(limit(outcome) for outcome in outcomes))
    assert report.verdict_rows(judged)[1][1][1] == said
    text = report.comparison_markdown(judged)
    shown = f"**no**{said[2:]}" if said.startswith("no (") else said
    assert cells(text, ME)[0][1] == shown
    assert ("**Outside tolerance:**" in text) is (BAD in outcomes)
    assert ("**Within tolerance.**" in text) is (set(outcomes) == {GOOD})
    assert ("**No unexpected result**" in text) is (FEARED in outcomes and BAD not in outcomes)
    assert ("**No limits are declared**" in text) is (not outcomes)


def test_a_run_that_broke_off_is_no_and_says_why(result):
    broken = with_engine(result, ok=False, status="CRASHED", status_sentence="it died")
    assert report.verdict_rows(broken)[1][1][1] == "no: it died"
    assert "| **no**: it died |" in report.comparison_markdown(broken)
    assert "**Outside tolerance:** pymunk:chain (it died)." in report.comparison_markdown(broken)
    feared = dataclasses.replace(broken, tolerances=(limit(FEARED, expected_failure="dies"),))
    assert report.verdict_rows(feared)[1][1][1] == "as expected, no; 1 expected failure"
    assert report.verdict_rows(dataclasses.replace(broken, tolerances=(limit(FEARED),)))[1][1][1].startswith(
        "no: it died; 1 exp"
    )


def test_what_an_engine_said_is_its_last_line_and_no_markup(result):
    said = with_engine(result, story="S.", message="first\nlast `word` " + "x" * 300 + "\n")
    line = next(line for line in report.comparison_markdown(said).splitlines() if line.startswith(f"- **{ME}**"))
    assert line == f"- **{ME}**: S. `last 'word' {'x' * 188}`", "two hundred characters"
    assert report.comparison_markdown(with_engine(result, story="S.", message="")).count(f"- **{ME}**: S.\n") == 1
    assert f"- **{ME}**: S. \n" in report.comparison_markdown(with_engine(result, story="S.", message=" \n"))


def test_the_verdict_shows_the_cost_that_neighbours_do_not_spoil(scenario, reference, make_run):
    busy, idle = (compare(scenario, reference, [make_run(wall_time=wall)]) for wall in (21.0, 2.1))
    assert report.verdict_rows(busy) == report.verdict_rows(idle)


def test_a_run_without_a_profile_is_named_by_its_label(result):
    (engine,) = result.engines
    assert report.name(engine) == ME
    assert report.name(dataclasses.replace(engine, profile="")) == "pymunk:chain"


# ---- what the result is made of


def test_times_per_second_need_two_samples(scenario, reference, make_run):
    runs = [make_run(), make_run(until=0.0), make_run(until=1e-3), make_run(wall_time=math.nan, cpu_time=math.nan)]
    times = compare(scenario, reference, runs).clock.wall_times
    assert [w.seconds for w in times] == [2.1, 2.1, 2.1, None]
    assert [w.per_simulated_second for w in times] == [pytest.approx(2.0), None, pytest.approx(2100.0), None]
    assert [w.cpu_seconds for w in times] == [1.05, 1.05, 1.05, None]
    assert [w.cpu_per_simulated_second for w in times] == [pytest.approx(1.0), None, pytest.approx(1050.0), None]


def test_a_result_says_when_each_side_ends(scenario, reference, make_run, missing):
    result = compare(scenario, reference, [make_run(until=0.5), missing])
    assert [e.end_time for e in result.engines] == [pytest.approx(0.5), None]
    assert [e.samples for e in result.engines] == [501, 0]
    assert result.reference.end_time == pytest.approx(1.05)
    early = compare(scenario, lambda t: reference(t, end=0.8), [make_run()])
    assert early.reference.end_time == pytest.approx(0.8)
    assert [e.available for e in result.engines] == [True, False]


def test_a_vertical_release_has_an_acceleration_error(scenario, reference, make_run):
    vertical = dataclasses.replace(scenario, parameters=scenario.parameters.replace(release=Release.VERTICAL))
    (engine,) = compare(vertical, reference, [make_run()]).engines
    assert engine.metrics["acceleration_error"] is not None
    assert compare(scenario, reference, [make_run()]).engines[0].metrics["acceleration_error"] is None


def test_names_of_trajectories_are_in_the_order_of_the_engines(scenario, reference, make_run):
    result = compare(scenario, reference, [make_run(engine=name) for name in ("b", "a", "reference")])
    assert trajectory_files(result) == ["b-chain-quick.csv", "a-chain-quick.csv", "reference-chain-quick.csv"]


def test_what_is_not_known_is_an_empty_cell(make_run):
    run = make_run(until=2e-3)
    run.string_stretch[1] = np.nan
    head, *rows = [line.split(",") for line in trajectory_csv(run).splitlines()]
    at_stretch = head.index("string_stretch [m]")
    assert [row[at_stretch] for row in rows] == ["0", "", "0"]
    assert {(row[-1], row[-2], row[-3], row[-4]) for row in rows} == {("", "", "", "")}
    assert rows[1][0] == "0.001"


@pytest.mark.parametrize(
    ("left", "rule"), [(1, "| --- | ---: | ---: |"), (2, "| --- | --- | ---: |"), (0, "| ---: | ---: | ---: |")]
)
def test_a_tables_numbers_are_to_the_right(left, rule):
    text = markdown(["a", "b", "c"], [["x  y\nz", "p|q", "1"]], left=left)
    assert text == f"| a | b | c |\n{rule}\n| x y z | p\\|q | 1 |\n"


def test_a_status_that_is_not_run_is_no_failure(scenario, reference, make_run):
    for status in RunStatus:
        run = make_run(until=0.5, status=status)
        available = compare(scenario, reference, [run]).engines[0].available
        assert available is (status not in (RunStatus.MISSING, RunStatus.UNSUPPORTED, RunStatus.INTERRUPTED))


# ---- halts


def halts(result):
    return section(comparison_markdown(result), "When does it halt?")


def test_without_any_halt_there_is_no_section_on_it(result):
    never = dataclasses.replace(OWN, halting_times=tuple(HaltingTimeAt(resolution=r, time=None) for r in RESOLUTIONS))
    nobody = dataclasses.replace(result, reference=dataclasses.replace(result.reference, sampled=never))
    assert halts(with_engine(nobody, landmarks=never)) == ""
    assert halts(nobody)
    assert cells(halts(with_engine(result, landmarks=never)), ME)[0][1:6] == ["–"] * 5
    alone = halts(with_engine(result, landmarks=Landmarks()))
    assert alone
    assert cells(alone, ME) == [], "a run without samples has no row"


@pytest.mark.parametrize(
    ("exact", "seen", "said"),
    [
        (None, None, "The reference's exact events contain no halt either."),
        (0.5, 0.5003, "By its exact events the reference halts at 0.500000 s, so reading samples has an error of 0.3 ms here."),
        (0.5003, 0.5, "By its exact events the reference halts at 0.500300 s, so reading samples has an error of 0.3 ms here."),
        (0.5, 0.4, "By its exact events the reference halts at 0.5000 s: until then it slides by less"),
        (0.5, 0.4994, "By its exact events the reference halts at 0.5000 s: until"),
        (0.5, None, "By its exact events the reference halts at 0.5000 s: until"),
        (None, 0.4, "By its exact events the reference does not halt: until then it slides"),
    ],
)
def test_what_samples_say_is_held_against_the_references_events(result, exact, seen, said):
    true = dataclasses.replace(
        result.reference,
        landmarks=dataclasses.replace(result.reference.landmarks, halting_time=exact),
        sampled=dataclasses.replace(TRUE, halting_time=seen),
    )
    assert said in halts(dataclasses.replace(result, reference=true))


# ---- moments


def test_moments_are_numbered_where_there_are_several(result):
    text = rendered(result, Landmarks(stops=at(0.2, 0.4)), Landmarks(stops=at(0.203, 0.398, 0.6)))
    assert cells(text, "stop 1") == [["stop 1", "0.2000", "+3"]]
    assert cells(text, "stop 2") == [["stop 2", "0.4000", "-2"]]
    assert cells(text, "stop 3") == [["stop 3", "–", "at 0.6000 s"]]
    alone = rendered(result, Landmarks(stops=at(0.2)), Landmarks(stops=at(0.203)))
    assert cells(alone, "stop") == [["stop", "0.2000", "+3"]]
    assert "| event | reference [s] | pymunk:chain [ms later] |" in alone


@pytest.mark.parametrize(("end", "said"), [(0.39, "after its end"), (0.4, "–"), (0.5, "–"), (None, "after its end")])
def test_a_moment_after_the_end_of_a_run_is_reported_as_such(result, end, said):
    assert cells(rendered(result, Landmarks(stops=at(0.4)), Landmarks(), end), "stop") == [["stop", "0.4000", said]]


def test_the_paragraph_that_says_how_to_give_the_measurements(result):
    unknown = dataclasses.replace(result, measured=(), measured_source="a trial")
    text = section(comparison_markdown(unknown), "Against the measured events")
    assert "\n\nThis trial was measured (a trial), but its table" in text
    assert "`--data DIR`" in text
