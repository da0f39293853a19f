"""Tables against arithmetic: event quantities, differences from the measured values, moments, and what a halt was read from."""

import dataclasses

import pytest

from looping_pendulum.compare import compare
from looping_pendulum.compare.report import comparison_markdown
from looping_pendulum.measured.tables.events import MeasuredEventRow
from looping_pendulum.runs.events import EVENT_QUANTITIES, Extremum, Landmarks, Stop, event_value, quantity_label
from tests.compare.report_cells import section

LANDMARKS = Landmarks(
    stops=(Stop(time=0.4, height_change=-0.3), Stop(time=0.7, height_change=-0.2), Stop(time=0.9, height_change=-0.25)),
    slip_onsets=(0.5, 0.75, 0.95),
    halting_time=0.9,
    drop_at_halt=0.25,
    wrap_angle_at_halt=8.0,
    free_length_at_halt=0.1,
    light_reaches_rod=1.4,
    x1_extrema=(Extremum(time=0.21, value=0.1), Extremum(time=0.41, value=-0.1)),
    y1_extrema=(Extremum(time=0.31, value=0.2), Extremum(time=0.51, value=-0.2)),
)
SAID = {
    ("x1_extremum", 1): 0.21, ("x1_extremum", 2): 0.41, ("y1_extremum", 1): 0.31, ("y1_extremum", 2): 0.51,
    ("stop_time", 1): 0.4, ("stop_time", 3): 0.9, ("height_change_at_stop", 2): -0.2, ("height_change_at_stop", 3): -0.25,
    ("slip_onset_time", 1): 0.5, ("slip_onset_time", 3): 0.95,
    ("t_A", 1): 0.4, ("height_change_at_A", 1): -0.3, ("t_B", 1): 0.7, ("height_change_at_B", 1): -0.2, ("t_C", 1): 0.75,
    ("halting_time", 1): 0.9, ("height_change_at_halt", 1): -0.25, ("drop_at_halt", 1): 0.25,
    ("wrap_angle_at_halt", 1): 8.0, ("free_length_at_halt", 1): 0.1, ("time_light_reaches_rod", 1): 1.4,
}  # fmt: skip
"""(quantity, which) -> what it is of `LANDMARKS`; C is the last slip onset before the halt, so not the one at 0.95 s."""


@pytest.mark.parametrize(("quantity", "index"), SAID)
def test_every_event_quantity_is_read_from_its_landmark(quantity, index):
    assert event_value(LANDMARKS, quantity, index) == SAID[quantity, index]
    assert event_value(Landmarks(), quantity, index) is None
    assert event_value(LANDMARKS, quantity, 0) is None
    assert EVENT_QUANTITIES[quantity].several is (quantity in {q for q, i in SAID if i > 1})


def test_every_event_quantity_is_examined():
    assert set(EVENT_QUANTITIES) == {quantity for quantity, _ in SAID}
    assert event_value(LANDMARKS, "colour", 1) is None


@pytest.mark.parametrize("quantity", [q for q, known in EVENT_QUANTITIES.items() if known.several])
def test_one_more_than_there_are_is_none(quantity):
    last = max(i for i in range(1, 9) if event_value(LANDMARKS, quantity, i) is not None)
    assert event_value(LANDMARKS, quantity, last + 1) is None
    assert quantity_label(quantity, last) == f"{quantity.replace('_', ' ')} {last}"


def test_a_slip_needs_a_halt_to_be_before():
    assert event_value(dataclasses.replace(LANDMARKS, halting_time=None), "t_C", 1) is None
    assert event_value(dataclasses.replace(LANDMARKS, slip_onsets=(0.95,)), "t_C", 1) is None
    assert quantity_label("t_C", 1) == "t C"


@pytest.mark.parametrize(("kind", "unit"), [("time", "s"), ("angle", "rad"), ("height", "m"), ("drop", "m"), ("length", "m")])
def test_units_of_event_quantities(kind, unit):
    assert {q.unit for q in EVENT_QUANTITIES.values() if q.kind == kind} == {unit}


@pytest.fixture
def measured(measured_scenario, reference, make_run):
    rows = [
        ("halting_time", 0.3512, 0.34, "s"), ("drop_at_halt", 0.25, 0.26, "m"), ("wrap_angle_at_halt", None, 3.9995, "rad"),
        ("time_light_reaches_rod", 1.0955, None, "s"), ("t_B", 0.6, None, "s"),
    ]  # fmt: skip
    names = ("quantity", "measured", "paper_numerical", "unit")
    table = [MeasuredEventRow(index=1, **dict(zip(names, row, strict=True))) for row in rows]
    runs = [make_run(delay=2e-3), make_run(engine="mujoco", until=0.3)]
    return compare(measured_scenario, reference, runs, table)


def cells(text, first):
    (line,) = [line for line in text.splitlines() if line.startswith(f"| {first} |")]
    return [cell.strip() for cell in line.strip("|").split("|")]


def test_differences_from_the_measured_values_are_in_thousandths(measured, closed_form):
    text = section(comparison_markdown(measured), "Against the measured events")
    shown = cells(text, "halting time")
    assert shown[2:4] == ["0.35", "0.34 (-11)"]
    assert shown[4].endswith(f"({round(1e3 * (closed_form.halt - 0.3512)):+d})")
    assert float(shown[4].split()[0]) == pytest.approx(closed_form.halt, abs=6e-4)
    assert float(shown[5].split()[0]) == pytest.approx(closed_form.halt + 2e-3, abs=6e-4)
    assert shown[6] == "–"
    assert cells(text, "drop at halt")[3] == "0.26 (+10)"
    angle = cells(text, "wrap angle at halt")
    assert angle[2:4] == ["–", "3.999"] or angle[2:4] == ["–", "4"]
    assert int(angle[4].split("(")[1].strip(")")) == round(1e3 * (closed_form.wrap_angle - 3.9995))
