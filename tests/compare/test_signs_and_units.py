"""What is late is positive, what is further is positive, and a unit in a header is the unit of the numbers below it."""

import csv
import dataclasses
import io

import numpy as np
import pytest

from looping_pendulum.compare import compare
from looping_pendulum.compare.align import align
from looping_pendulum.compare.comparison import judge_tolerance
from looping_pendulum.compare.deviation import DEPARTURE_THRESHOLDS, departures, growth_rate
from looping_pendulum.compare.report import comparison_markdown, value_and_limit, verdict_rows
from looping_pendulum.compare.result import ToleranceOutcome
from looping_pendulum.compare.trajectories import trajectory_csv
from looping_pendulum.reference_ode.transitions import Mode
from looping_pendulum.runs.events import run_landmarks
from looping_pendulum.scenarios.metrics import METRICS

HALF_A_SAMPLE = 0.5e-3
"""[s]; delays are whole samples, so that a detector errs alike with and without one, and by no more than this."""


def cell(result, header):
    """Cell of the only engine in the verdict's table, below the heading that begins so."""
    head, rows = verdict_rows(result)
    (column,) = [i for i, text in enumerate(head) if text.startswith(header)]
    return head[column], rows[1][column]


def further(run, share=0.0, turned=0.0):
    """``run`` with a heavy mass that drops further by a ``share``, and a string that winds ``turned`` [rad/s] faster."""
    height = run.heavy_position[:, 1]
    heavy = np.column_stack([run.heavy_position[:, 0], height[0] + (1 + share) * (height - height[0])])
    return dataclasses.replace(
        run, heavy_position=heavy, heavy_velocity=(1 + share) * run.heavy_velocity, wrap_angle=run.wrap_angle + turned * run.t
    )


@pytest.mark.parametrize("late", [3e-3, -3e-3, 0.0])
def test_what_halts_late_has_a_positive_halting_error(scenario, reference, make_run, late):
    result = compare(scenario, reference, [make_run(delay=late)])
    assert result.engines[0].metrics["halting_time_error"] == pytest.approx(late, abs=HALF_A_SAMPLE)
    heading, shown = cell(result, "halting error")
    assert heading == "halting error [ms]"
    assert float(shown) == pytest.approx(1e3 * late, abs=1e3 * HALF_A_SAMPLE)
    story = result.engines[0].story
    assert {3e-3: "ms late", -3e-3: "ms early", 0.0: "on time"}[late] in story


@pytest.mark.parametrize("share", [0.01, -0.01])
def test_what_drops_further_has_a_positive_drop_error(scenario, reference, make_run, closed_form, share):
    # Oracle: the closed form's drop. Bound: what falls in half a sample while the mass brakes, 40 m/s^2 (0.5 ms)^2 / 2 = 5 um.
    result = compare(scenario, reference, [further(make_run(), share)])
    assert result.engines[0].metrics["drop_error"] == pytest.approx(share * closed_form.drop, abs=1e-5)
    heading, shown = cell(result, "drop error")
    assert heading == "drop error [mm]"
    assert float(shown) == pytest.approx(1e3 * share * closed_form.drop, abs=0.01)


@pytest.mark.parametrize("metric", METRICS)
@pytest.mark.parametrize(("factor", "kept"), [(2.0, False), (-2.0, False), (0.5, True), (-0.5, True), (1.0, True)])
def test_a_limit_holds_for_either_sign(scenario, reference, make_run, limit, metric, factor, kept):
    engine = compare(scenario, reference, [make_run()]).engines[0]
    judged = judge_tolerance(limit(metric, 0.01), dataclasses.replace(engine, metrics=engine.metrics | {metric: 0.01 * factor}))
    if METRICS[metric].has_lower_limit:  # more is better, and a share or a time is not negative
        kept = factor >= 1
    assert judged.outcome is (ToleranceOutcome.PASSED if kept else ToleranceOutcome.FAILED)


def test_only_what_is_good_when_large_has_a_least_value():
    assert {name for name, metric in METRICS.items() if metric.has_lower_limit} == {"tube_fraction", "simulated_time"}


@pytest.mark.parametrize(
    ("metric", "value", "shown"),
    [
        ("rms_0.35s", 4e-4, "0.4 mm"), ("rms_0.7s", 4e-4, "0.4 mm"), ("rms_1.0s", 4e-4, "0.4 mm"), ("rms_halt", 4e-4, "0.4 mm"),
        ("rebound", 2e-3, "2 mm"), ("halting_time_error", 3e-3, "3 ms"), ("drop_error", 2e-3, "2 mm"),
        ("wrap_angle_error", 5e-3, "5 mrad"),
        ("free_length_error", 2e-3, "2 mm"), ("string_stretch", 1e-4, "0.1 mm"), ("acceleration_error", 3e-3, "0.3 %"),
        ("tube_fraction", 0.99, "99 %"), ("simulated_time", 1.25, "1.25 s"),
    ],
)  # fmt: skip
def test_limits_are_stated_in_the_unit_of_the_paper(scenario, reference, make_run, limit, metric, value, shown):
    judged = judge_tolerance(limit(metric, value), compare(scenario, reference, [make_run()]).engines[0])
    texts = value_and_limit(dataclasses.replace(judged, value=value / 2))
    assert texts[1] == f"{'at least' if METRICS[metric].has_lower_limit else 'at most'} {shown}"
    number, unit = texts[0].split()
    assert float(number) == pytest.approx(float(shown.split()[0]) / 2, rel=5e-3)
    assert unit == shown.split()[1]


def test_every_column_of_the_exported_samples_is_what_its_heading_says(make_run):
    """Oracle: the trajectory. Every column gets values of its own, so that no two could be exchanged."""
    run = make_run(mode=np.full(1051, Mode.SLIDING_DOWN, dtype=np.int8))
    own = np.random.default_rng(1)
    pairs = {
        name: own.normal(size=(1051, 2)) for name in ("light_position", "light_velocity", "heavy_position", "heavy_velocity")
    }
    single = {
        name: own.normal(size=1051)
        for name in ("free_length", "wrap_angle", "string_stretch", "light_tension", "heavy_tension")
    }
    run = dataclasses.replace(run, **pairs, **single)
    expected = {"t [s]": run.t}
    for name, short, unit in (
        ("light_position", "light_{}", "m"), ("light_velocity", "light_v{}", "m/s"),
        ("heavy_position", "heavy_{}", "m"), ("heavy_velocity", "heavy_v{}", "m/s"),
    ):  # fmt: skip
        for i, axis in enumerate("xy"):
            expected[f"{short.format(axis)} [{unit}]"] = pairs[name][:, i]
    for name, unit in zip(single, ("m", "rad", "m", "N", "N"), strict=True):
        expected[f"{name} [{unit}]"] = single[name]
    rows = list(csv.DictReader(io.StringIO(trajectory_csv(run))))
    assert set(rows[0]) >= {*expected, "mode"}
    assert {row["mode"] for row in rows} == {"sliding_down"}
    for name, values in expected.items():
        np.testing.assert_allclose([float(row[name]) for row in rows], values, rtol=1e-8, atol=1e-12, err_msg=name)


def test_the_report_tells_the_errors_at_halt_in_their_units(scenario, reference, make_run, closed_form):
    run = further(make_run(), 0.01, 0.1)
    report = comparison_markdown(compare(scenario, reference, [dataclasses.replace(run, free_length=run.free_length + 2e-3)]))
    (head,) = [line.split("|") for line in report.splitlines() if line.startswith("| engine | in tube")]
    (row,) = [line.split("|") for line in report.splitlines() if line.startswith("| pymunk:chain, quick | 100 ")]
    cells = dict(zip([h.strip() for h in head[:-4]], row, strict=False))
    assert float(cells["drop at halt [m]"]) == pytest.approx(1.01 * closed_form.drop, abs=1e-4)
    angles = [float(c) for h, c in zip(head, row, strict=True) if h.strip() == "error [mrad]"]
    lengths = [float(c) for h, c in zip(head, row, strict=True) if h.strip() == "error [mm]"]
    assert angles == [pytest.approx(1e3 * 0.1 * closed_form.halt, abs=3)]
    assert lengths == [pytest.approx(2, abs=0.1)]


@pytest.mark.parametrize("sign", [1, -1])
def test_a_departure_says_how_far_and_to_which_side(reference, make_run, sign):
    # Oracle: what was added. The threshold is passed in the sample after 0.1 s; everything else is read off there.
    run = make_run()
    on = (run.t > 0.1 + 1e-9).astype(float)
    outward = run.light_position / np.linalg.norm(run.light_position, axis=1)[:, None]
    off = dataclasses.replace(
        run,
        light_position=run.light_position + sign * 2e-3 * on[:, None] * outward,
        free_length=run.free_length + sign * 2e-3 * on,
        wrap_angle=run.wrap_angle + sign * 5e-3 * on,
        heavy_position=run.heavy_position + np.outer(on, [0.0, sign * 3e-3]),
        string_stretch=-1e-4 * np.arange(len(run.t)) / len(run.t),
    )
    (departure,) = departures(align(off, reference), reference(run.t).events, np.abs(off.string_stretch))
    assert (departure.threshold, departure.after, departure.after_time) == (1e-3, "release", 0.0)
    assert departure.time == pytest.approx(0.101, abs=1e-9)
    assert departure.along == pytest.approx(sign * 2e-3, rel=1e-9)
    assert departure.across == pytest.approx(sign * 5e-3 * run.free_length[101], rel=1e-9)
    assert departure.heavy == pytest.approx(sign * 3e-3, rel=1e-9)
    assert departure.stretch == pytest.approx(1e-4 * 101 / len(run.t), rel=1e-9)
    assert growth_rate((departure,)) is None


def test_a_distance_of_just_the_threshold_is_no_departure(reference, make_run):
    aligned = align(make_run(shift=(DEPARTURE_THRESHOLDS[0] * (1 - 1e-9), 0.0)), reference)
    assert departures(aligned, ()) == ()
    assert len(departures(align(make_run(shift=(DEPARTURE_THRESHOLDS[0] * (1 + 1e-9), 0.0)), reference), ())) == 1


def test_the_rms_at_halt_is_averaged_up_to_the_references_halt(scenario, reference, make_run, closed_form):
    run = make_run()
    drifting = dataclasses.replace(run, light_position=run.light_position + np.outer(0.01 * run.t, [1.0, 0.0]))
    until = run.t[run.t <= closed_form.halt + 1e-4]
    rms = compare(scenario, reference, [drifting]).engines[0].metrics["rms_halt"]
    assert rms == pytest.approx(0.01 * np.sqrt(np.mean(until**2)), rel=4e-3)  # one sample more or less: 1 in 300


def test_the_stretch_is_the_largest_of_either_sign(scenario, reference, make_run):
    run = make_run()
    run.string_stretch[:] = np.linspace(-2e-3, 1e-3, len(run.t))
    run.string_stretch[5] = np.nan
    result = compare(scenario, reference, [run]).engines[0]
    assert result.metrics["string_stretch"] == pytest.approx(2e-3, rel=1e-12)
    assert result.metrics["simulated_time"] == run.t[-1]


@pytest.mark.parametrize(("samples", "enough"), [(2, False), (3, True), (4, True)])
def test_landmarks_need_three_samples(make_run, closed_form, samples, enough):
    landmarks = run_landmarks(make_run(until=1e-3 * (samples - 1)), closed_form.parameters)
    assert (landmarks.halting_times != ()) is enough
