"""What the figures of ladders show: errors against a setting, limits, spreads, and what has no place on a log axis."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from looping_pendulum.compare.convergence import report as convergence_plots
from looping_pendulum.compare.convergence.result import HALT, PATH_END_TIMES, SequenceKind

EARLY, LATE = PATH_END_TIMES


def ladder(values, halts=True, own=4e-4, rms=lambda v: 10 * v, kind=SequenceKind.CONVERGES, spread=2e-5, unit="s"):
    rungs = [
        SimpleNamespace(
            value=v,
            run=SimpleNamespace(rms={EARLY: rms(v), LATE: rms(v) and 2 * rms(v)}, halting_time_error=-3 * v if halts else None),
            to_limit={EARLY: 0.5 * v, LATE: None},
        )
        for v in values
    ]
    verdicts = [
        SimpleNamespace(quantity=name, kind=kind, order=None, limit_error=None, uncertainty=None)
        for name in (EARLY, LATE, HALT)
    ]
    made = SimpleNamespace(rungs=rungs, verdicts=verdicts, setting="step", unit=unit, own=own)
    v = SimpleNamespace(label="toy:chain", profile="quick", spread={EARLY: spread, LATE: spread, HALT: spread}, ladders=(made,))
    return v, made


STEPS = (8e-4, 4e-4, 2e-4)


def lines(axes):
    return {line.get_label(): np.array(line.get_data()) for line in axes.lines}


def test_errors_along_a_ladder_are_in_millimetres_and_finer_is_to_the_right():
    figure = convergence_plots.ladder_figure(*ladder(STEPS))
    top, below = figure.axes
    drawn = lines(top)
    np.testing.assert_allclose(drawn["from the reference, to 0.35 s"], [STEPS, [8, 4, 2]])
    np.testing.assert_allclose(drawn["from the reference, to 0.7 s"], [STEPS, [16, 8, 4]])
    np.testing.assert_allclose(drawn["from its own limit, to 0.35 s"], [STEPS, [0.4, 0.2, 0.1]])
    assert drawn["from its own limit, to 0.7 s"].shape == (2, 0)
    np.testing.assert_allclose(drawn["spread of small changes, to 0.7 s"][1], 0.02)
    np.testing.assert_allclose(drawn["the variant's own setting"][0], 4e-4)
    (bars,) = below.containers
    np.testing.assert_allclose(bars.lines[0].get_data(), [STEPS, [-2.4, -1.2, -0.6]])
    ends = [segment[:, 1] for segment in bars.lines[2][0].get_segments()]
    np.testing.assert_allclose(np.diff(ends).ravel(), 0.08)  # twice the spread of 0.02 ms to either side
    assert below.get_xlim()[0] > below.get_xlim()[1]
    assert (below.get_xlabel(), below.get_xscale(), top.get_xlabel()) == ("step [s], finer to the right", "log", "")


def test_iterations_grow_to_the_right_and_have_no_unit():
    last = convergence_plots.ladder_figure(*ladder((10, 20, 40), unit="")).axes[-1]
    assert last.get_xlim()[0] < last.get_xlim()[1]
    assert last.get_xlabel() == "step, finer to the right"


def test_a_ladder_without_any_halt_has_one_panel():
    figure = convergence_plots.ladder_figure(*ladder(STEPS, halts=False))
    (axes,) = figure.axes
    assert axes.get_xlabel() == "step [s], finer to the right"
    assert figure.get_size_inches()[1] < convergence_plots.ladder_figure(*ladder(STEPS)).get_size_inches()[1]


def test_a_setting_of_zero_or_less_has_no_place_on_a_log_axis():
    """A tolerance of 0 ends a ladder; -1 stands for "off" with some engines."""
    figure = convergence_plots.ladder_figure(*ladder((4e-4, 2e-4, 0.0, -1.0)))
    assert len(lines(figure.axes[0])["from the reference, to 0.35 s"][0]) == 2
    assert len(figure.axes[1].containers[0].lines[0].get_xdata()) == 2
    assert figure.axes[1].get_xlim()[0] > figure.axes[1].get_xlim()[1]


def test_an_error_of_nothing_has_no_place_on_a_log_axis():
    drawn = lines(convergence_plots.ladder_figure(*ladder(STEPS, rms=lambda v: 0.0 if v == 4e-4 else None)).axes[0])
    assert drawn["from the reference, to 0.35 s"].shape == (2, 0)


@pytest.mark.parametrize(
    ("kind", "shown"), [(SequenceKind.SETTLED, True), (SequenceKind.SCATTERS, False), (SequenceKind.WITHIN_SPREAD, False)]
)
def test_the_distance_from_a_limit_is_drawn_where_there_is_one(kind, shown):
    drawn = lines(convergence_plots.ladder_figure(*ladder(STEPS, kind=kind)).axes[0])
    assert ("from its own limit, to 0.35 s" in drawn) is shown


def test_without_a_spread_or_an_own_value_there_is_no_line_of_it():
    for spread in (None, 0.0):
        figure = convergence_plots.ladder_figure(*ladder(STEPS, spread=spread, own=None))
        assert not [label for label in lines(figure.axes[0]) if "spread" in label or "own setting" in label]
    figure = convergence_plots.ladder_figure(*ladder(STEPS, spread=None))
    assert not figure.axes[1].containers[0].has_yerr


def test_the_limit_of_a_halting_time_is_a_band():
    v, made = ladder(STEPS)
    made.verdicts[2].limit_error, made.verdicts[2].uncertainty = 1e-4, 3e-4
    figure = convergence_plots.ladder_figure(v, made)
    (band,) = figure.axes[1].patches
    corners = band.get_path().get_extents(band.get_patch_transform())
    assert (corners.y0, corners.y1) == (pytest.approx(-0.2), pytest.approx(0.4))
    made.verdicts[2].uncertainty = None
    assert not convergence_plots.ladder_figure(v, made).axes[1].patches


@pytest.mark.parametrize(
    ("values", "rms", "count"),
    [(STEPS, lambda v: v, 1), (STEPS[:2], lambda v: v, 1), (STEPS[:1], lambda v: v, 0), ((1e-3, 0.0), lambda v: v, 0),
     (STEPS, lambda v: None, 0), (STEPS, lambda v: v if v == 8e-4 else None, 0)],
)  # fmt: skip
def test_a_ladder_is_drawn_if_two_of_its_rungs_have_an_error(monkeypatch, values, rms, count):
    monkeypatch.setattr(convergence_plots, "png", lambda figure: b"")
    v, _ = ladder(values, rms=rms)
    figures = convergence_plots.draw(SimpleNamespace(variants=[v]))
    assert list(figures) == ["toy-chain-quick-step.png"] * count
    assert all(label == "toy:chain" and "as step is refined to the right" in caption for label, caption, _ in figures.values())
