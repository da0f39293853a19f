"""Every cell of the report's tables of halts, events and measured values from a number of its own."""

from __future__ import annotations

import dataclasses
import math

import pytest

from looping_pendulum.compare.report import halting_section as render_halts
from looping_pendulum.compare.report import measured_events_table as render_paper
from looping_pendulum.engines.landmarks import Extremum, HaltingTimeAt, Landmarks
from looping_pendulum.engines.string_motion import RESOLUTIONS
from tests.compare.report_cells import (
    ME,
    OWN,
    TRUE,
    at,
    cells,
    measured,
    rendered,
    with_engine,
)

# ---- halts


def test_the_table_of_halts_has_every_resolution(result):
    (section,) = render_halts(result)
    (own,), (true,) = cells(section, ME), cells(section, "reference")
    assert own == [ME, "0.4000", "0.4100", "0.4200", "0.4300", "0.4400", "2.5", "3.5", "46"]
    assert true == ["reference", "0.4000", "0.4100", "0.4200", "0.4300", "0.4400", "–", "–", "–"]
    assert "| run | halts, to within 0.01 mm [s] | halts, to within 0.03 mm [s] | halts, to within 0.1 mm [s] |" in section
    assert "again until the light mass" in section
    assert "how far it moves if the 0.1 mm are taken a quarter larger or smaller" in section
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
