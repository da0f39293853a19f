"""Every cell of the report from a number of its own: verdict, detail, tolerances, provenance, wall times."""

import dataclasses
import math

import numpy as np
import pytest

from looping_pendulum.compare import compare, report
from looping_pendulum.compare.report import halting_section as render_halts
from looping_pendulum.compare.report import measured_events_table as render_paper
from looping_pendulum.compare.result import SupplyEntry, ToleranceOutcome, WallTime
from looping_pendulum.compare.trajectories import trajectory_csv, trajectory_files
from looping_pendulum.engines.landmarks import Extremum, HaltingTimeAt, Landmarks, Rebound
from looping_pendulum.engines.string_motion import RESOLUTIONS
from looping_pendulum.engines.trajectory import RunStatus
from looping_pendulum.pages.markdown import table as markdown
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios import metrics
from looping_pendulum.scenarios.scenario import Inference
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
    with_engine,
)


def test_the_verdicts_table_has_every_number_in_its_unit(result):
    head, (true, own) = report.verdict_rows(result)
    assert len(head) == len(true) == len(own) == 10
    assert true == ["reference", "–", "–", "–", "–", "–", "0.5123", "–", "–", "–"]
    assert own == [ME, "no limits declared", "–", "1.1", "2.2", "3.3", "0.4123", "-5.5", "+7.7", "1"]
    assert head[-1] == "CPU time [s per s]"


def test_a_vertical_release_has_a_column_for_its_acceleration(result):
    vertical = with_engine(result, metrics=METRICS | {"acceleration_error": -0.0123})
    head, (true, own) = report.verdict_rows(vertical)
    assert len(head) == len(true) == len(own) == 11
    assert head[-2:] == ["acceleration error [%]", "CPU time [s per s]"]
    assert own[-3:] == ["+7.7", "-1.23", "1"]
    assert true[6:] == ["0.5123", "–", "–", "–", "–"]


def test_a_halt_that_is_not_comparable_has_no_error(result):
    _, (_, own) = report.verdict_rows(with_engine(result, not_comparable="too short"))
    assert own[6:9] == ["0.4123", "not comparable", "+7.7"]


def test_who_helped_a_run_stands_beside_its_verdict(result):
    """A stranger took PyBullet's row for a measurement of PyBullet alone, and that of the capstan fed in for MuJoCo's."""
    supplies = tuple(SupplyEntry(what=what, by=by, how="") for what, by in [
        ("winding", "engine"), ("friction law", "adapter"), ("stick slip", "adapter"), ("drag", "adapter"),
    ])  # fmt: skip
    made = dataclasses.replace(result.engines[0].provenance, supplies=supplies)
    head, (_, own) = report.verdict_rows(with_engine(result, provenance=made, from_reference=("the length of a step",)))
    assert head[2] == "helped by"
    assert own[2] == "the adapter: friction law, stick slip; the reference: the length of a step"
    assert "*Helped by*: laws that the adapter supplies" in report.comparison_markdown(result)


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


def test_what_is_outside_is_listed_and_what_was_not_run_too(result):
    judged = dataclasses.replace(
        result, tolerances=(limit(BAD), limit(ToleranceOutcome.UNEXPECTED_PASS, "drop_error"), limit(GOOD))
    )
    said = "**Outside tolerance:** pymunk:chain (rms_0.7s: fail); pymunk:chain (drop_error: unexpected pass).\n"
    assert said in report.comparison_markdown(judged)
    missing = with_engine(result, available=False, status_sentence="it is not there")
    assert " Not run: pymunk:chain.\n" in report.comparison_markdown(missing)
    assert report.verdict_rows(missing)[1][1][1] == "not run: it is not there"


def test_the_detail_has_every_number_in_its_unit(result):
    text = report.comparison_markdown(result)
    (true, own) = cells(text, "reference", "## Detail")[0], cells(text, ME, "## Detail")[0]
    assert own == [
        ME, "97", "0.123", "0.235", "0.346", "12", "4.4", "0.3123", "5.1235", "-8.8", "0.2123", "+9.9", "1.2",
    ]  # fmt: skip
    assert true == ["reference", *["–"] * 6, "0.6123", "5.1235", "–", "0.2123", "–", "–"]
    assert "The half-widths of the tube are 5 ms and 5 mm." in text
    one = with_engine(result, departures=(gone(1e-2, 0.5),))
    assert cells(report.comparison_markdown(one), ME, "## Detail")[0][3:5] == ["–", "0.500"]
    nobody = dataclasses.replace(result, engines=(), clock=dataclasses.replace(result.clock, wall_times=()))
    assert "No engine was run." in report.comparison_markdown(nobody)


def test_every_limit_is_stated_with_its_value_and_why(result):
    rows = (limit(GOOD), limit(BAD, "tube_fraction", None, "no value: too short"), limit(GOOD, "no_metric_of_ours", 5.0))
    text = report.comparison_markdown(dataclasses.replace(result, tolerances=rows))
    table_rows = cells(text, ME, "## Tolerances")[:3]
    assert table_rows[0] == [ME, "rms_0.7s", "pass", "2.2 mm", "at most 1 mm", "by design", ""]
    assert table_rows[1] == [ME, "tube_fraction", "**fail**", "–", "at least 0.1 %", "by design", "no value: too short"]
    assert table_rows[2][3:5] == ["5 SI", "at most 0.001 SI"]
    assert "The scenario declares no tolerances for these engines and this profile." in report.comparison_markdown(result)


def test_the_stories_begin_with_the_reference(result):
    text = report.comparison_markdown(result)
    assert (
        "- **reference** (reference:closed form): released at 0 s, halt at 0.3375 s, light reaches rod at 1.1000 s.\n" in text
    )
    never = dataclasses.replace(result.reference, landmarks=Landmarks(), events=(("release", 0.0),))
    text = report.comparison_markdown(dataclasses.replace(result, reference=never))
    assert "- **reference** (reference:closed form): released at 0 s, never halts.\n" in text


def test_what_an_engine_said_is_its_last_line_and_no_markup(result):
    said = with_engine(result, story="S.", message="first\nlast `word` " + "x" * 300 + "\n")
    line = next(line for line in report.comparison_markdown(said).splitlines() if line.startswith(f"- **{ME}**"))
    assert line == f"- **{ME}**: S. `last 'word' {'x' * 188}`", "two hundred characters"
    assert report.comparison_markdown(with_engine(result, story="S.", message="")).count(f"- **{ME}**: S.\n") == 1
    assert f"- **{ME}**: S. \n" in report.comparison_markdown(with_engine(result, story="S.", message=" \n"))


def test_a_scenario_outside_the_measured_range_is_a_warning(result):
    warned = with_engine(result, story="S.", outside_range=("a thick rod", "much drag"))
    sentence = "**Its accuracy was not measured for such a scenario:** a thick rod; much drag."
    assert f"- **{ME}**: S. {sentence}\n" in report.comparison_markdown(warned)
    assert "was not measured" not in report.comparison_markdown(result)


def test_who_supplies_the_physics(result):
    text = report.comparison_markdown(with_engine(result, additions=("a spring, 3 mm", "a brake")))
    section = text[text.index("## Who supplies") : text.index("## Tolerances")]
    assert cells(section, ME)[0][1:] == ["**engine**: by closed form"] * 4
    assert cells(section, "reference")[0][1:] == ["**engine**: by closed form"] * 4
    assert f"matters:\n\n- **{ME}**: a spring, 3 mm\n- **{ME}**: a brake\n" in section
    assert "matters:" not in report.comparison_markdown(result)
    (engine,) = result.engines
    less = dataclasses.replace(engine.provenance, supplies=engine.provenance.supplies[1:])
    assert cells(report.comparison_markdown(with_engine(result, provenance=less)), ME, "## Who supplies")[0][1] == "–"


def test_the_provenance_names_settings_seed_and_what_was_inferred(result):
    (engine,) = result.engines
    made = dataclasses.replace(engine.provenance, settings={"dt": 1 / 3, "n": 7}, seed=0, versions={"a": "1", "b": "2"})
    inferred = (
        Inference(parameters=("mu", "k"), how="Fitted.", script="fit.py"),
        Inference(parameters=("m",), how="Weighed.", script=""),
    )
    text = report.comparison_markdown(dataclasses.replace(with_engine(result, provenance=made), inferred=inferred))
    section = text[text.index("## Provenance") : text.index("## Times")]
    assert cells(section, ME) == [[ME, "a 1, b 2", "dt 0.333333, n 7", "0"]]
    assert cells(section, "reference, reference:closed form")[0][-1] == "–"
    assert "- Inferred, because the source does not print them: mu, k. Fitted. (`fit.py`)\n- Inferred" in section
    assert "them: m. Weighed.\n" in section
    assert "Scenario `made_up`, simulated for 1.05 s. Parameters (SI, radians): " in section
    assert "kinetic_friction 0.34" in section
    assert "; no other effect acts.\n" in section
    assert "_drag" not in section, "none acts"
    assert "coefficients" not in section
    bare = with_engine(result, provenance=dataclasses.replace(made, settings={}, versions={}, seed=12))
    assert cells(report.comparison_markdown(bare), ME, "## Provenance")[0] == [ME, "–", "–", "12"]


def test_times_are_in_seconds_and_per_simulated_second(result):
    values = {"seconds": 1.234, "per_simulated_second": 5.678, "cpu_seconds": 0.9876, "cpu_per_simulated_second": 4.321}
    times = (WallTime(engine="pymunk:chain", profile="quick", **values),)
    timed = dataclasses.replace(result, clock=dataclasses.replace(result.clock, wall_times=times))
    assert cells(report.comparison_markdown(timed), ME, "## Times")[0] == [ME, "0.988", "4.32", "1.23", "5.68"]
    assert report.verdict_rows(timed)[1][1][-1] == "4.3"


def test_the_verdict_shows_the_cost_that_neighbours_do_not_spoil(scenario, reference, make_run):
    busy, idle = (compare(scenario, reference, [make_run(wall_time=wall)]) for wall in (21.0, 2.1))
    assert report.verdict_rows(busy) == report.verdict_rows(idle)


def test_a_run_without_a_profile_is_named_by_its_label(result):
    (engine,) = result.engines
    assert report.name(engine) == ME
    assert report.name(dataclasses.replace(engine, profile="")) == "pymunk:chain"


def test_figures_are_embedded_with_their_captions(result):
    text = report.comparison_markdown(result, {"figures/a.png": "First.", "figures/b.png": "Second."})
    assert "![First.](figures/a.png)\n\n*First.*\n\n![Second.](figures/b.png)\n\n*Second.*\n" in text
    assert "There are none, because this report was made without the trajectories." in report.comparison_markdown(result)


# ---- factors of units: a thousandth more or less turns the last digit of one of these over


THREE = [(1.2345e-3, "1.23"), (1.2355e-3, "1.24")]
TWO = [(1.2495e-3, "1.2"), (1.2505e-3, "1.3")]


@pytest.mark.parametrize(("size", "shown"), THREE)
def test_three_digits_of_a_thousandth(result, size, shown):
    all_alike = with_engine(result, metrics=dict.fromkeys(METRICS, size) | {"acceleration_error": 10 * size})
    _, (_, own) = report.verdict_rows(all_alike)
    assert own[3:6] + own[7:10] == [shown] * 3 + [f"+{shown}"] * 3
    detail = cells(report.comparison_markdown(all_alike), ME, "## Detail")[0]
    assert [detail[6], detail[9], detail[11], detail[12]] == [shown, f"+{shown}", f"+{shown}", shown]
    for metric, (_, factor) in ((name, known.shown_in) for name, known in metrics.METRICS.items()):
        texts = report.value_and_limit(limit(GOOD, metric, 1e3 * size / factor, **{"limit": 1e3 * size / factor}))
        assert [one.split()[-2] for one in texts] == [shown, shown], metric
    text = rendered(result, Landmarks(stops=at(0.2)), Landmarks(stops=at(0.2 + size)))
    assert cells(text, "stop")[0][2] == f"+{shown}"


@pytest.mark.parametrize(("size", "shown"), TWO)
def test_two_digits_of_a_thousandth(result, size, shown):
    own = dataclasses.replace(OWN, halting_time_uncertainty=size, rebound=Rebound(travel=size, speed=size))
    (row,) = cells(render_halts(with_engine(result, landmarks=own))[0], ME)
    assert row[-3:] == [shown] * 3
    assert cells(report.comparison_markdown(with_engine(result, growth_rate=1e3 * size)), ME, "## Detail")[0][5] == shown


def test_hundreds_of_thousandths(result):
    rows = (measured(measured=0.1, paper_numerical=0.7, reference=0.7, engines=(0.7,)),)
    text = render_paper(dataclasses.replace(result, measured=rows))
    assert cells(text, "halting time")[0][3:] == ["0.70 (+600)", "0.7000 (+600)", "0.7000 (+600)"]
    assert cells(text, "RMS difference of the times")[0][3:] == ["600.0 (1 of 1)"] * 3
    wide = dataclasses.replace(result.engines[0].tube, half_time=0.123456, half_width=0.654321)
    section = report.comparison_markdown(with_engine(result, tube=wide, metrics=METRICS | {"tube_fraction": 0.97654}))
    assert "The half-widths of the tube are 123.456 ms and 654.321 mm" in section
    assert cells(section, ME, "## Detail")[0][1] == "97.7"


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


def test_columns_of_words_are_to_the_left_and_numbers_to_the_right(result):
    text = report.comparison_markdown(dataclasses.replace(result, tolerances=(limit(GOOD),), measured=(measured(),)))
    lines = text.splitlines()
    rules = [line for line in lines if line.startswith("| ---")]
    # Verdict, paper, halts, detail, who supplies what, tolerances, provenance, wall times.
    assert [rule.split("|").count(" --- ") for rule in rules] == [3, 2, 1, 1, 5, 7, 4, 1]


def test_a_status_that_is_not_run_is_no_failure(scenario, reference, make_run):
    for status in RunStatus:
        run = make_run(until=0.5, status=status)
        available = compare(scenario, reference, [run]).engines[0].available
        assert available is (status not in (RunStatus.MISSING, RunStatus.UNSUPPORTED, RunStatus.INTERRUPTED))


# ---- halts


def test_the_table_of_halts_has_every_resolution(result):
    (section,) = render_halts(result)
    (own,), (true,) = cells(section, ME), cells(section, "reference")
    assert own == [ME, "0.4000", "0.4100", "0.4200", "0.4300", "0.4400", "2.5", "3.5", "46"]
    unsure = dataclasses.replace(OWN, halting_times=(HaltingTimeAt(resolution=1e-5, time=None), *OWN.halting_times[1:]))
    (cut,) = cells(render_halts(with_engine(result, landmarks=unsure))[0], ME)
    assert (cut[1], cut[6]) == ("–", "at least 2.5")
    assert true == ["reference", "0.4000", "0.4100", "0.4200", "0.4300", "0.4400", "–", "–", "–"]
    assert "| run | halts, to within 0.01 mm [s] | halts, to within 0.03 mm [s] | halts, to within 0.1 mm [s] |" in section
    assert "again until the light mass" in section
    assert "the largest distance of these times from that to within 0.1 mm; *at least*: to within the finest" in section
    assert "from which on it stays within 1 mm" in section
    assert "not comparable" not in section
    gap = render_halts(with_engine(result, not_comparable="it is short"))[0]
    assert f"- {ME}: not comparable: it is short.\n\n| run |" in gap


def test_without_any_halt_there_is_no_section_on_it(result):
    never = dataclasses.replace(OWN, halting_times=tuple(HaltingTimeAt(resolution=r, time=None) for r in RESOLUTIONS))
    nobody = dataclasses.replace(result, reference=dataclasses.replace(result.reference, sampled=never))
    assert render_halts(with_engine(nobody, landmarks=never)) == []
    assert len(render_halts(nobody)) == len(render_halts(with_engine(result, landmarks=never))) == 1
    assert cells(render_halts(with_engine(result, landmarks=never))[0], ME)[0][1:6] == ["–"] * 5
    (alone,) = render_halts(with_engine(result, landmarks=Landmarks()))
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
    assert said in render_halts(dataclasses.replace(result, reference=true))[0]


# ---- moments


def test_moments_are_numbered_where_there_are_several(result):
    text = rendered(result, Landmarks(stops=at(0.2, 0.4)), Landmarks(stops=at(0.203, 0.398, 0.6)))
    assert cells(text, "stop 1") == [["stop 1", "0.2000", "+3"]]
    assert cells(text, "stop 2") == [["stop 2", "0.4000", "-2"]]
    assert cells(text, "stop 3") == [["stop 3", "–", "at 0.6000 s"]]
    alone = rendered(result, Landmarks(stops=at(0.2)), Landmarks(stops=at(0.203)))
    assert cells(alone, "stop") == [["stop", "0.2000", "+3"]]
    assert "| event | reference [s] | pymunk:chain [ms later] |" in alone


def test_every_kind_of_moment_has_its_rows(result):
    def marks(off):
        return Landmarks(
            stops=at(0.1 + off), slip_onsets=(0.2 + off,), light_reaches_rod=0.9 + off,
            x1_extrema=(Extremum(time=0.3 + off, value=0.0),), y1_extrema=(Extremum(time=0.4 + off, value=0.0),),
        )  # fmt: skip

    text = rendered(result, marks(0.0), marks(0.005))
    names = [line.split("|")[1].strip() for line in text.splitlines() if line.startswith("|")][2:]
    assert names == ["stop", "slip onset", "x1 extremum", "y1 extremum", "light mass reaches rod"]
    assert [cells(text, name)[0][1:] for name in names] == [[f"{t:.4f}", "+5"] for t in (0.1, 0.2, 0.3, 0.4, 0.9)]
    without = rendered(result, dataclasses.replace(marks(0.0), light_reaches_rod=None), marks(0.005))
    assert "reaches rod" not in without, "the reference's end is not in a report of an engine alone"
    assert cells(
        rendered(result, marks(0.0), dataclasses.replace(marks(0.0), light_reaches_rod=None)), "light mass reaches rod"
    ) == [["light mass reaches rod", "0.9000", "–"]]
    assert rendered(result, Landmarks(), Landmarks()) == ""


@pytest.mark.parametrize(("end", "said"), [(0.39, "after its end"), (0.4, "–"), (0.5, "–"), (None, "after its end")])
def test_a_moment_after_the_end_of_a_run_is_reported_as_such(result, end, said):
    assert cells(rendered(result, Landmarks(stops=at(0.4)), Landmarks(), end), "stop") == [["stop", "0.4000", said]]


def test_the_paper_table_compares_with_the_measured_value_or_else_with_the_papers(result):
    rows = (
        measured(),
        measured(
            quantity="wrap_angle_at_halt", unit="rad", measured=None, paper_numerical=3.98765, reference=4.0, engines=(None,)
        ),
        measured(quantity="drop_at_halt", unit="m", measured=None, paper_numerical=None, reference=0.25),
        measured(quantity="x1_extremum", index=2, measured=0.3, paper_numerical=None, reference=None, engines=(0.29,)),
    )
    text = render_paper(dataclasses.replace(result, measured=rows, measured_source="a paper"))
    assert text.startswith("Source: a paper.\n\nIn brackets: ")
    assert cells(text, "halting time") == [["halting time", "s", "0.40", "0.41 (+10)", "0.4200 (+20)", "0.4300 (+30)"]]
    assert cells(text, "wrap angle at halt") == [["wrap angle at halt", "rad", "–", "3.988", "4.000 (+12)", "–"]]
    assert cells(text, "drop at halt") == [["drop at halt", "m", "–", "–", "0.2500", "0.4300"]]
    assert cells(text, "x1 extremum 2") == [["x1 extremum 2", "s", "0.30", "–", "–", "0.2900 (-10)"]]
    # Roots of the mean squares of (10), (20) and (30, -10) ms.
    rms = f"{math.sqrt((30**2 + 10**2) / 2):.1f}"
    wanted = ["RMS difference of the times", "ms", "–", "10.0 (1 of 2)", "20.0 (1 of 2)", f"{rms} (2 of 2)"]
    assert cells(text, "RMS difference of the times") == [wanted]
    assert not render_paper(dataclasses.replace(result, measured=rows, measured_source="")).startswith("Source")


def test_the_paragraph_that_says_how_to_give_the_measurements(result):
    text = render_paper(dataclasses.replace(result, measured=(), measured_source="a trial"))
    assert text.startswith("This trial was measured (a trial), but its table")
    assert "`--data DIR`" in text
