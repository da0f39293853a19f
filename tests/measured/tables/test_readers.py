"""Every form in which measured data comes, good and bad; the oracle is the table that the text was made from."""

import math
import re
import time

import numpy as np
import pytest

from looping_pendulum.errors import HarnessError
from looping_pendulum.measured.observations import Channel, merge, mirrored
from looping_pendulum.measured.tables.readers import DataError, read, survey

LIGHT = {"light": "mass A"}
BOTH = {"light": "mass A", "heavy": "mass B"}


XY = {"light_x": [1.2, -1.4], "light_y": [2.1, 0.5]}
FORMS = {
    "tracker": (",mass A,,\nt,x,y,\n0.0E0,1.2E0,2.1E0,\n1.0E-2,-1.4E0,5.0E-1,\n", {"tracks": LIGHT}),
    "tracker, name above the second column": (",,mass A,\nt,x,y,\n0,1.2,2.1,\n.01,-1.4,.5,\n", {"tracks": LIGHT}),
    "no trailing delimiter": (",mass A,\nt,x,y\n0,1.2,2.1\n.01,-1.4,.5\n", {"tracks": LIGHT}),
    "multi with one track": ("#multi:\n,mass A,,\nt,x,y,\n0,1.2,2.1,\n.01,-1.4,.5,\n", {"tracks": LIGHT}),
    "tabs": ("\tmass A\t\t\nt\tx\ty\t\n0\t1.2\t2.1\t\n.01\t-1.4\t.5\t\n", {"tracks": LIGHT}),
    "semicolons": (";mass A;;\nt;x;y;\n0;1.2;2.1;\n.01;-1.4;.5;\n", {"tracks": LIGHT}),
    "semicolons, decimal comma": (";mass A;;\nt;x;y;\n0;1,2;2,1;\n,01;-1,4E0;5,0E-1;\n", {"tracks": LIGHT}),
    "tabs, decimal comma": ("t\tx\ty\n0\t1,2\t2,1\n0,01\t-1,4\t0,5\n", {"tracks": LIGHT}),
    "spaces, decimal comma": ("t x y\n0 1,2 2,1\n0,01 -1,4 0,5\n", {"tracks": LIGHT}),
    "byte order mark": ("\ufeff,mass A,,\nt,x,y,\n0,1.2,2.1,\n.01,-1.4,.5,\n", {"tracks": LIGHT}),
    "utf-16": (",mass A,,\nt,x,y,\n0,1.2,2.1,\n.01,-1.4,.5,\n".encode("utf-16"), {"tracks": LIGHT}),
    "latin-1 name": (",K\xfcgel,,\nt,x,y,\n0,1.2,2.1,\n.01,-1.4,.5,\n".encode("latin-1"), {"tracks": {"light": "K\xfcgel"}}),
    "CRLF": (",mass A,,\r\nt,x,y,\r\n0,1.2,2.1,\r\n.01,-1.4,.5,\r\n", {"tracks": LIGHT}),
    "CR": (",mass A,,\rt,x,y,\r0,1.2,2.1,\r.01,-1.4,.5,\r", {"tracks": LIGHT}),
    "old: the name alone": ("cm_A\nt,x,y,\n0,1.2,2.1,\n.01,-1.4,.5,\n", {"tracks": {"light": "cm_A"}}),
    "old: the name alone, no columns": ("cm_A\n0\t1.2\t2.1\n.01\t-1.4\t.5\n", {"tracks": {"light": "cm_A"}}),
    "no header": ("0,1.2,2.1\n.01,-1.4,.5\n", {"tracks": LIGHT}),
    "tracks named by numbers": (",1,,2,,\nt,x,y,x,y,\n0,1.2,2.1,,,\n.01,-1.4,.5,,,\n", {"tracks": {"light": "1"}}),
    "no name row": ("t,x,y\n0,1.2,2.1\n.01,-1.4,.5\n", {"tracks": LIGHT}),
    "the only track": (",mass Q,,\nt,x,y,\n0,1.2,2.1,\n.01,-1.4,.5,\n", {"tracks": {"light": ""}}),
    "named as the mass": (",light mass,,\nt,x,y,\n0,1.2,2.1,\n.01,-1.4,.5,\n", {}),
    "tidy": ("t,light_x,light_y\n0,1.2,2.1\n.01,-1.4,.5\n", {}),
    "tidy, units in brackets": ("t [ms],light_x [cm],light_y (mm)\n0,120,2100\n10,-140,500\n", {}),
    "tidy, units as suffix": ("time_s,light_x_cm,light_y_m\n0,120,2.1\n.01,-140,.5\n", {}),
    "numbers in the order of clicking": ("t,x1,y1\n0,1.2,2.1\n.01,-1.4,.5\n", {"tracks": {"light": "1"}}),
    "time in the last column": ("light x (m),light y (m),t (s)\n1.2,2.1,0\n-1.4,.5,.01\n", {}),
    "names in slashes": (
        '"Time";"Light 1/0/X";"Light 1/0/Y"\n"0,0";"1,2";"2,1"\n"0,01";"-1,4";"0,5"\n',
        {"tracks": {"light": "Light 1/0"}},
    ),
    "units behind slashes": ("t/ms;light x/cm;light y / mm\n0;120;2100\n10;-140;500\n", {}),
    "units in the row below": ("t;light x;light y\n(ms);(cm);(mm)\n0;120;2100\n10;-140;500\n", {}),
    "a program's name before the colon": (
        "Latest: Time (s),Latest: X (m),Latest: Y (m)\n0,1.2,2.1\n.01,-1.4,.5\n",
        {"tracks": LIGHT},
    ),
    "words around the axis": ("Video time [s],light position x [m],Y of light [m]\n0,1.2,2.1\n.01,-1.4,.5\n", {}),
    "camel case": ("Time,lightX,lightY\n0,1.2,2.1\n.01,-1.4,.5\n", {}),
    "a line for spreadsheets": ("sep=;\nt;light_x;light_y\n0,0;1,2;2,1\n0,01;-1,4;0,5\n", {}),
    "quoted decimal commas between commas": ('"t","light_x","light_y"\n"0,0","1,2","2,1"\n"0,01","-1,4","0,5"\n', {}),
    "names in a comment": ("# written by hand\n# t light_x light_y\n0 1.2 2.1\n.01 -1.4 .5\n", {}),
    "an index column": (",light_y,light_x,t\n0,2.1,1.2,0\n1,.5,-1.4,.01\n", {}),
    "a row for each object": (
        "frame,x,y,mass,particle\n7,1.2,2.1,14378.45,0\n7,9.0,9.0,9021.7,1\n9,-1.4,.5,14378.45,0\n9,9.0,9.0,9021.7,1\n",
        {"tracks": {"light": "0"}, "frame_rate": 200.0},
    ),
    "one of two runs": (
        "Time (s) Run #1,x (m) Run #1,y (m) Run #1,Time (s) Run #2,x (m) Run #2,y (m) Run #2\n"
        "0,9,9,0,1.2,2.1\n.02,9,9,.01,-1.4,.5\n",
        {"tracks": {"light": ""}, "run": "2"},
    ),
    "the second of two tables": (
        "t,x,y\n0,9,9\n.02,9,9\n\nt,x,y\n0,1.2,2.1\n.01,-1.4,.5\n",
        {"tracks": {"light": ""}, "run": "2"},
    ),
    "a table for each object": (
        "Ball A\nt,x,y\n0,9,9\n.01,9,9\nBall B\nt,x,y\n0,1.2,2.1\n.01,-1.4,.5\n",
        {"tracks": {"light": "Ball B"}},
    ),
    "units given": ("t,light_x,light_y\n0,120,210\n10,-140,50\n", {"units": {"length": "cm", "time": "ms"}}),
    "slow motion, true rate given": ("t,light_x,light_y\n0,1.2,2.1\n.0333,-1.4,.5\n", {"frame_rate": 100.0}),
    "slow motion, every second frame": (
        "t,light_x,light_y\n0,1.2,2.1\n.06667,-1.4,.5\n",
        {"frame_rate": 200.0, "clip_rate": 30},
    ),
    "frame numbers": ("t,frame,light_x,light_y\n0,7,1.2,2.1\n.03,9,-1.4,.5\n", {"frame_rate": 200.0}),
    "frame numbers only": ("frame,light_x,light_y\n7,1.2,2.1\n9,-1.4,.5\n", {"frame_rate": 200.0}),
    "rate given, times right already": ("t,light_x,light_y\n0,1.2,2.1\n.01,-1.4,.5\n", {"frame_rate": 100.3}),
    "numbers in names between tabs": (
        "t\tX\tY\tX 2\tY 2\n0\t1.2\t2.1\t9\t9\n.01\t-1.4\t.5\t9\t9\n",
        {"tracks": {"light": "1"}},
    ),
    "a line that names the tab": (
        "sep=\t\nt\tX\tY\tX 2\tY 2\n0\t1.2\t2.1\t9\t9\n.01\t-1.4\t.5\t9\t9\n",
        {"tracks": {"light": "1"}},
    ),
    "one of two runs of two objects": (
        "run,particle,t,x,y\n1,a,0,9,9\n1,b,0,8,8\n2,a,0,7,7\n2,b,0,1.2,2.1\n1,a,.02,9,9\n1,b,.02,8,8\n2,a,.01,7,7\n2,b,.01,-1.4,.5\n",
        {"tracks": {"light": "b"}, "run": "2"},
    ),
    "one of two runs of which one has no name": (
        "t,x,y,t Run #2,x Run #2,y Run #2\n0,9,9,0,1.2,2.1\n.02,9,9,.01,-1.4,.5\n",
        {"tracks": {"light": ""}, "run": "2"},
    ),
    "a line of a no-break space": ("t x y\n\u00a0\n0 1.2 2.1\n.01 -1.4 .5\n", {"tracks": LIGHT}),
    "quoted names between spaces": ('"t" "light x" "light y"\n0 1.2 2.1\n.01 -1.4 .5\n', {}),
    "a letter for a name, before the axis": (
        "t,mass A x,mass A y,B x,B y\n0,1.2,2.1,9,9\n.01,-1.4,.5,9,9\n",
        {"tracks": LIGHT},
    ),
    "a letter for a name, joined to the axis": (
        "t,A_x,A_y,B_x,B_y\n0,1.2,2.1,9,9\n.01,-1.4,.5,9,9\n",
        {"tracks": {"light": "A"}},
    ),
    "a lone quotation mark": ('t x y\n"\n0 1.2 2.1\n.01 -1.4 .5\n', {"tracks": LIGHT}),
    "comments of MATLAB and gnuplot": ("% by hand\n%t light_x light_y\n0 1.2 2.1\n.01 -1.4 .5\n", {}),
    "a minus of macOS Numbers": ("t,light_x,light_y\n0,1.2,2.1\n.01,\u22121.4,.5\n", {}),
    "a dash for a minus": ("t;light_x;light_y\n0;1,2;2,1\n0,01;\u20131,4;0,5\n", {}),
    "times of a clock": ("t [h:mm:ss.00],light_x,light_y\n0:00:00.00,1.2,2.1\n0:00:00.01,-1.4,.5\n", {}),
    "minutes and seconds with decimal commas": ("t (mm:ss,00);light_x;light_y\n0:00,00;1,2;2,1\n0:00,01;-1,4;0,5\n", {}),
    "comments and blank lines": ("# by hand\n\nt,light_x,light_y\n0,1.2,2.1\n\n# again\n.01,-1.4,.5\n", {}),
}


@pytest.mark.parametrize("form", FORMS)
def test_every_form_gives_the_same_table(clip, form):
    text, options = FORMS[form]
    observations = read(clip(text), **options)
    assert {c.name: c.value.tolist() for c in observations.channels} == {n: pytest.approx(v, abs=1e-15) for n, v in XY.items()}
    rounding = 2e-3 * 0.01 if "slow" in form else 1e-12  # the clip's own times are printed to three or four digits
    for channel in observations.channels:
        assert channel.t == pytest.approx([0.0, 0.01], abs=rounding)
    # Only whole columns that are no positions, or not asked for
    assert all("column" in d.reason for d in observations.unused)


@pytest.mark.parametrize(
    ("digits", "unit", "cells"),
    [
        ("987 998 1003", "mm", "987 998 1,003"),
        ("987.5 998.2 1003.1", "mm", "987.5 998.2 1,003.1"),
        ("987.5 998.2 1003.1", "mm", "987,5 998,2 1.003,1"),
        ("987.5 998.2 1003.1", "mm", "987.5 998.2 1'003.1"),
        ("987.5 998.2 1003.1", "mm", "987.5 998.2 1\u202f003.1"),
        ("0.987 1.075 1.101", "m", "0,987 1,075 1,101"),
    ],
)
def test_what_separates_thousands_is_told_by_all_cells(clip, digits, unit, cells):
    """'1,003' beside '987' was 1.003, in silence."""
    rows = "".join(f"{i};{x}\n" for i, x in enumerate(cells.split(" ")))
    observations = read(clip(f"frame;light_x [{unit}]\n{rows}"), frame_rate=100.0)
    metres = np.array(digits.split(), dtype=float) / {"mm": 1000, "m": 1}[unit]
    assert observations.channel("light_x").value == pytest.approx(metres, rel=1e-12)


def test_a_clock_of_the_day_counts_seconds(clip):
    text = "time,light_x\n2024-05-03T10:22:31.250Z,1\n2024-05-03T10:22:31.260Z,2\n"
    assert read(clip(text)).channel("light_x").t == pytest.approx([37351.25, 37351.26], abs=1e-9)


def test_hundredths_behind_a_third_colon(clip):
    """As Kinovea writes them; up to 59 they could be the frames of a second of film."""
    text = "#T light_x light_y\n0:00:00:04 1.2 2.1\n0:00:00:08 1.3 2.2\n0:00:01:96 1.4 2.3\n"
    assert read(clip(text)).channel("light_x").t == pytest.approx([0.04, 0.08, 1.96])


@pytest.mark.parametrize("sign", "°º˚")
def test_signs_that_stand_for_a_degree(clip, sign):
    observations = read(clip(f"t,angle [{sign}]\n0,180\n.01,90\n"))
    assert observations.channel("angle").value == pytest.approx([np.pi, np.pi / 2])


@pytest.mark.parametrize("name", ["\u017fcore", "\u03f1", "he\u0130ght", "w\u0131dth"])
def test_letters_that_are_others_but_for_their_case(clip, name):
    assert read(clip(f"t,light_x,light_y,{name}\n0,1.2,2.1,3\n.01,-1.4,.5,4\n")).channel("light_x").value.tolist() == [
        1.2,
        -1.4,
    ]


def test_rows_with_numbers_that_have_no_name(clip):
    """R writes one name less than there are columns."""
    rows = "".join(f"{i + 1},{i / 100},{i * i / 7:.4f},{-i / 3:.4f}\n" for i in range(12))
    observations = read(clip("t,light_x,light_y\n" + rows))
    assert observations.channel("light_y").value == pytest.approx(-np.arange(12) / 3, abs=1e-4)


def test_settings_in_the_table_are_named(clip):
    text = '"time [s]";"x position [m]";"y position [m]";"x velocity [m/s]";"Frame rate [Hz]";"Scale [px/m]"\n'
    text += '"";"";"";"";"240,0";"655,1"\n"0";"1,2";"2,1";"";"";""\n"0,01";"-1,4";"0,5";"3,3";"";""\n'
    observations = read(clip(text), tracks={"light": ""})
    assert observations.channel("light_x").value.tolist() == [1.2, -1.4]
    assert observations.assumptions == (
        "setting in the table left out: Frame rate [Hz] = 240.0",
        "setting in the table left out: Scale [px/m] = 655.1",
    )
    assert [(d.count, d.reason) for d in observations.unused] == [(1, "column 'x velocity [m/s]': not a time or a position")]


def test_rows_whose_missing_cells_were_left_out(clip):
    """pymecavideo leaves the cells of a missing point out, so that the second object's stand in the first one's columns."""
    rows = [f"{i / 100:.2f}\t{-0.5 + i / 50:.2f}\t-0.20\t0.01\t{-i / 40:.3f}" for i in range(6)]
    rows[2] = "0.02\t0.01\t-0.050"
    text = "# version = pymecavideo 8.0\nt\tx1\ty1\tx2\ty2\n" + "\n".join(rows).replace(".", ",") + "\n"
    observations = read(clip(text), tracks={"light": "1", "heavy": "2"})
    assert observations.channel("light_x").value == pytest.approx([-0.5, -0.48, -0.44, -0.42, -0.4])
    assert any("left out 1 of 6 rows (line 5)" in said for said in observations.assumptions)
    # At the end of the table the second object's track may have ended, and an editor cut the empty cells off
    ended = (
        text.replace("# version = pymecavideo 8.0\n", "").replace("\t0,01\t-0,125\n", "\n").replace("0,02\t0,01\t-0,050\n", "")
    )
    assert len(read(clip(ended), tracks={"light": "1", "heavy": "2"}).channel("light_x")) == 5


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,x1,y1,x2,y2\n" + "".join(f"{i / 10},0.006,{-i / 20},{i / 30 - 0.5},-0.2\n" for i in range(12)),
         "found the tracks '1', '2', needed to know which mass each is; by their motion, write 'tracks: {light: 2, heavy: 1}'"),
        ("X Y X' Y'\n" + "".join(f"{i * 0.083:.3f} {i % 3} 0.1 0.1\n" for i in range(12)),
         "found no column of times among 'X, Y, X', Y'', needed one; 'X' grows by equal steps: if it is the time, name it 't'"),
        ("t,x,y\n" + "".join(f"{i % 4},{i / 100},{i % 5}\n" for i in range(12)),
         "column x: found values that grow by equal steps from 0.0, as times or numbers of rows do, needed positions"),
        ("m1,m2,a,md\n" + "".join(f"60.{i},59.{i},0.{i},1\n" for i in range(12)), "if each row is a trial"),
    ],
)  # fmt: skip
def test_names_that_do_not_say_enough_or_contradict_the_values(clip, text, message):
    with pytest.raises(DataError) as caught:
        read(clip(text))
    assert message in str(caught.value)


def test_two_tracks_with_the_same_column_names(clip):
    text = "#multi:\n,mass A,,mass B,,\nt,x,y,x,y,\n0,1,2,3,4,\n.01,,,3.5,4.5,\n.02,1.2,2.2,,,\n"
    observations = read(clip(text), tracks=BOTH)
    assert observations.channel("light_x").t.tolist() == [0, 0.02]
    assert observations.channel("light_y").value.tolist() == [2, 2.2]
    assert observations.channel("heavy_y").value.tolist() == [4, 4.5]
    assert {d.reason: d.count for d in observations.unused} == {
        "light_x: empty cell": 1,
        "light_y: empty cell": 1,
        "heavy_x: empty cell": 1,
        "heavy_y: empty cell": 1,
    }


def test_frame_numbers_of_each_track_are_its_own(clip):
    head = "#multi:\n,mass A,,,,,mass B,,,,,\nt,frame,x,y,pixelx,pixely,frame,x,y,pixelx,pixely,\n"
    rows = "0,10,.1,.2,500,600,,,,,,\n.033,,,,,,12,.3,.4,5,6,\n.066,14,.5,.6,1,2,14,.7,.8,3,4,\n"
    observations = read(clip(head + rows), tracks=BOTH, frame_rate=200.0)
    assert observations.channel("light_x").t.tolist() == [0, 0.02]
    assert observations.channel("heavy_x").t.tolist() == [0.01, 0.02]
    assert {d.count for d in observations.unused if "pixel" in d.reason} == {8}


def test_columns_of_the_tool_that_imports_them(clip):
    observations = read(clip("t,heavyx,heavyy,lightx,lighty\n0,1,2,3,4\n.01,5,6,7,8\n"))
    assert {c.name: c.value[0] for c in observations.channels} == {"heavy_x": 1, "heavy_y": 2, "light_x": 3, "light_y": 4}


@pytest.mark.parametrize("mark", ["", "-", "\u2013", "NaN", "n/a", "NA", " "])
def test_a_missing_mark_is_missing_and_counted(clip, mark):
    observations = read(clip(f"t,light_x,light_y\n0,1,2\n.01,{mark},3\n.02,4,5\n"))
    assert observations.channel("light_x").value.tolist() == [1, 4]
    assert observations.channel("light_y").value.tolist() == [2, 3, 5]
    assert observations.used == 5
    assert "1 not used: light_x: empty cell" in observations.summary()


def test_what_is_not_used_is_counted(clip):
    observations = read(clip("t,light_x,light_y,vx\n0,1,2,9\n.01,1,3,\n.01,1,3,8\n.02,,,7\n,4,4,1\n"))
    assert {d.reason: d.count for d in observations.unused} == {
        "light_x: the row before repeated": 1,
        "light_y: the row before repeated": 1,
        "light_x: empty cell": 1,
        "light_y: empty cell": 1,
        "light_x: a value without a time": 1,
        "light_y: a value without a time": 1,
        "column 'vx': not a time or a position": 4,
    }


BAD = {
    "text": ("t,light_x,light_y\n0,1,2\n.01,abc,3\n", r":3: column light_x: found 'abc', needed a finite number .*; "),
    "infinite": ("t,light_x,light_y\n0,1e999,2\n.01,1,3\n", r":2: column light_x: found '1e999'"),
    "ragged": ("t,light_x,light_y\n0,1,2\n.01,1,2,5\n", r":3: found 4 cells, needed 3; if .*decimal commas"),
    "cut off": ("t,light_x,light_y\n0,1,2\n.01,1\n.02,1\n", r":3: found 2 cells, needed 3; complete or delete"),
    "times go back": ("t,light_x,light_y\n0,1,2\n.02,1,2\n.01,1,3\n", r":4: column t: found 0.01 after 0.02 \(line 3\)"),
    "pixels": ("t,light_x,light_y\n0,300,200\n.01,534,2\n", r":3: column light_x: found 534 m, needed at most 20; .*units"),
    "degrees": ("t,angle\n0,40\n.01,39\n", r":2: column angle: found 40 rad.*\{angle: deg\}"),
    "milliseconds": ("t,light_x,light_y\n0,1,2\n4.2,1,2\n8.3,1,2\n", r":2: column t: found a row every 4.* s.*time: ms"),
    "no unit of length": ("t,light_x [kg],light_y\n0,1,2\n", r":1: column light_x \[kg\]: found the unit 'kg'"),
    "pixels without a size": (
        "t,light_x [px],light_y\n0,1,2\n",
        r": column light_x \[px\]: found lengths in pixels, needed the size of one; say so by 'units: {length: ",
    ),
    "mixed decimals": ("t;x;y\n0,1;1.5;2,2\n", r":2: column x: found '1.5' among .*decimal comma", {"tracks": LIGHT}),
    "decimal commas": ("t,x,y\n0,00,1,5,2,3\n", r":2: found 6 cells, needed 3; if these are decimal commas", {"tracks": LIGHT}),
    "which mass": (
        "#multi:\n,mass A,,mass B,,\nt,x,y,x,y,\n0,1,2,3,4,\n",
        r".*found the tracks 'mass A', 'mass B', .*\{light: mass B, heavy: mass A\}",
    ),
    "another track": (
        ",mass B,,\nt,x,y,\n0,1,2,\n",
        r".*found the tracks 'mass B', needed 'mass A'; by their motion, write 'tracks: {light: mass B}'",
        {"tracks": LIGHT},
    ),
    "one column twice": ("t,light_x,light_x\n0,1,2\n", r".*column light_x: found light_x a second time"),
    "no marks": ("t,light_x,light_y\n0,,2\n.01,,3\n", r".*column light_x: found no values at all"),
    "misspelt": ("t,heigth\n0,1\n", r":1: found columns .*did you mean 'height' by 'heigth'\?"),
    "misspelt mass": ("t,ligth_x,ligth_y\n0,1,2\n", r": found the tracks 'ligth', .*\{light: ligth\}"),
    "no times": (
        "particle,x,y\na,0,1\na,0,2\nb,3,1\n",
        r":2: found no column of times among 'x .a., y .a., x .b., y .b.', needed one; name it 't'",
    ),
    "neither times nor a rate": ("light_x,light_y\n0,1\n0,2\n", r": found frame numbers but no times, .*'frame_rate'"),
    "six columns": ("0,1,2,3,4,5\n", r":1: found 6 columns without names, needed a line of names above"),
    "frames without rate": ("frame,light_x,light_y\n7,1,2\n9,1,2\n", r".*found frame numbers but no times, .*'frame_rate'"),
    "frames that are times": (
        "frame,light_x\n0,1\n0.0333,2\n",
        r":3: column frame: found no whole number, needed a frame's; if these are times, name the column 't'",
        {"frame_rate": 30.0},
    ),
    "frames go back": ("t,frame,light_x\n0,9,1\n.1,7,2\n", r":3: column frame: found 7 after 9", {"frame_rate": 30.0}),
    "empty": ("", r": found no rows"),
    "only names": ("t,light_x,light_y\n", r":1: found no table of numbers"),
    "spreadsheet": (b"PK\x03\x04rest", r": found a zip archive .*File > Export > Data"),
    "XML": (b"<?xml version='1.0'?>", r": found XML, needed a text table"),
    "JSON": ('[\n{"t": 0}]', r": found JSON, needed a text table; .*in Kinovea: Tools"),
    "Logger Pro": ("<Document>\n</Document>", r": found XML, needed a text table; .*in Logger Pro: File > Export As > CSV"),
    "hundredths or frames": (
        "t,light_x\n" + "".join(f"0:00:00:{i:02d},{i % 7}\n" for i in range(4)),
        r":2: column t: found '0:00:00:00', whose last part may count frames or hundredths, needed seconds; export",
    ),
    "binary": (b"\x00\x01\x02", r": found binary data"),
    "one track for both": (
        "t,light_x\n0,1\n",
        r": tracks: found 'light' for both masses",
        {"tracks": {"light": "light", "heavy": "light"}},
    ),
    "which drop": ("drop,time,height\n1,0,9\n2,0,9\n", r": found the runs 1, 2, needed one trial; choose by 'run: 1'"),
    "no such drop": ("drop,time,height\n1,0,9\n2,0,9\n", r": found the runs 1, 2, needed run '3'", {"run": "3"}),
    "no drops": ("t,height\n0,9\n", r".*found a single run without a number, needed run '1'", {"run": "1"}),
    "one time for two rows": (
        "t,light_x,light_y\n0,1,2\n0,1.5,2\n",
        r":3: column t: found 0 after 0 \(line 2\), needed times that grow; export them with more decimals",
    ),
    "values without times": (
        "t,light_x,light_y\n,1,2\n0,,\n",
        r": column light_x: found no values at all, needed light_x\(t\); export that track again",
    ),
    "rates of which no row is complete": (
        "t,gyroscope x,gyroscope y\n0,1,\n.1,,2\n",
        r": column gyroscope x: found no values at all, needed angle_rate; export",
    ),
    "rates of two objects": (
        "t,particle,gyroscope x,gyroscope y\n" + "".join(f"{i // 2 / 10},{'ab'[i % 2]},{i},2\n" for i in range(7)),
        r": column gyroscope x \(b\): found angle_rate a second time, .*'tracks: {light: b}' which",
    ),
    "rates of two groups": (
        "t,a: gyroscope x,b: gyroscope x\n0,1,2\n.1,2,3\n",
        r": column b: gyroscope x: found angle_rate a second time",
    ),
    "rates about no axis": ("t,omega,omega 2\n0,1,2\n.1,2,3\n", r": column omega 2: found angle_rate a second time"),
    "a run without times": (
        "t Run 1,x Run 1,y Run 1,x Run 2,y Run 2\n0,1,2,3,4\n.1,1,2,3,4\n",
        r": column x Run 2: found no column of times among 'x Run 2', needed one; name it 't'",
        {"tracks": LIGHT, "run": "2"},
    ),
    "two rows at minus zero": ("t,light_x\n-0.0,1\n-0.0,2\n", r":3: column t: found 0 after 0 \(line 2\)"),
    "times without a difference": (
        "t,angle,omega\n" + "".join(f"{i}e-320,{i},{i}\n" for i in range(6)),
        r":3: column t: found 0 after 0 \(line 2\)",
        {"frame_rate": 30.0},
    ),
    "rates that are none": ("t,gyroscope x,gyroscope y\n0,1e90,1\n.1,1,2\n", r".*found .*e\+90 rad/s, needed at most 1000"),
    "a number that is too large": ("t,light_x\n0,1e301\n", r":2: column light_x: found '1e301', needed a finite number"),
    "a run without a name": (
        "t,x,y,t Run 2,x Run 2,y Run 2\n0,1,2,0,3,4\n",
        r": found the runs one without a name, 2, needed one trial; choose by 'run: 2'",
        {"tracks": LIGHT},
    ),
    "many tracks": (
        "t,particle,x,y\n" + "".join(f"{i // 20 / 10},p{i % 20},{i % 7},2\n" for i in range(40)),
        r": found the tracks 'p0', 'p1', 'p2', 'p3', 'p4' and 15 more, needed to know which mass each is",
    ),
    "event twice": ("quantity,index,value,sigma,unit\nstop,1,1,1,s\nstop,1,2,1,s\n", r":3: column index: found stop 1 again"),
    "event without error": ("quantity,index,value,sigma,unit\nstop,1,1,,s\n", r":2: column sigma: found nothing"),
    "event unit": ("quantity,index,value,sigma,unit\nstop,1,1,1,K\n", r":2: column unit: found 'K'"),
    "event columns": (
        "quantity,value\nstop,1\nstop,2\n",
        r".*found columns 'quantity,value', needed 'quantity,index",
        {"kind": "events"},
    ),
}
"""Name -> text, what is said behind the file's name, and options."""


@pytest.mark.parametrize("case", BAD)
def test_a_bad_file_gives_one_clear_line(clip, case):
    text, pattern, *options = BAD[case]
    with pytest.raises(DataError) as caught:
        read(clip(text), **dict(*options))
    message = str(caught.value)
    assert re.match(rf"clip\.csv{pattern}", message), message
    assert "\n" not in message


def test_two_columns_of_one_name_are_counted_both(clip):
    observations = read(clip("t,x (A),x (A),light_x,light_y\n0,1,2,3,4\n.1,1,2,3,4\n"))
    assert [(d.count, d.reason) for d in observations.unused] == [(4, "column 'x (A)': track not asked for")]


def test_rows_that_are_all_the_same(clip):
    assert survey(clip("t,light_x,light_y\n.1,1,2\n.1,1,2\n")).time_step == 0
    observations = read(clip("t,light_x,light_y\n" + 30 * ".1,1,2\n"))
    assert observations.channel("light_x").value.tolist() == [1]
    assert {d.count for d in observations.unused} == {29}


def test_one_step_and_one_gap_are_put_to_the_stated_rate(clip):
    """The mean of no steps was not a number, so that the rate was ignored."""
    observations = read(clip("t,light_x,light_y\n.02,1,2\n.04,1.1,2\n.12,1.2,2\n"), frame_rate=240.0)
    assert observations.channel("light_x").t == pytest.approx(np.array([1, 2, 6]) / 240)
    assert any("times made for 50 frames a second were put to 240" in said for said in observations.assumptions)


@pytest.mark.long
def test_many_short_rows_take_no_time_for_each_pair_of_rows(clip):
    """8000 rows with every third cut short took 4 s; the time grew with the square."""
    rows = "".join(f"{i / 100},{i % 13},2\n" if i % 3 else f"{i / 100},1\n" for i in range(20_000))
    start = time.process_time()
    assert len(read(clip("t,light_x,light_y\n" + rows)).channel("light_x")) == 13_333
    assert time.process_time() - start < 10


def test_a_missing_file_says_so(tmp_path):
    with pytest.raises(DataError, match=r"none.csv: cannot be read: No such file"):
        read(tmp_path / "none.csv")
    assert issubclass(DataError, HarnessError)
    assert issubclass(DataError, ValueError)


def test_angles_with_and_without_names(clip):
    t = np.arange(40) * 0.05
    angle, rate = 0.5 * np.cos(4 * t), -2 * np.sin(4 * t)
    rows = "\n".join(f"{a} {b} {c}" for a, b, c in zip(t, angle, rate, strict=True))
    bare = read(clip(rows))
    assert [c.name for c in bare.channels] == ["angle"]
    assert bare.channels[0].value == pytest.approx(angle)
    assert bare.assumptions == ("columns without names: taken as t [s], angle [rad], rate [rad/s]",)
    named = read(clip("t,theta [deg]\n" + "\n".join(f"{a},{math.degrees(b)}" for a, b in zip(t, angle, strict=True))))
    assert named.channel("angle").value == pytest.approx(angle)
    assert named.assumptions == ("times without a unit taken in s",)


def test_a_rate_beside_an_angle_is_left_out_as_it_tells_nothing_more(clip):
    rows = "\n".join(f"{i / 20} {0.5 * math.cos(i / 5)} {0.3 * math.cos(i / 5)}" for i in range(40))
    observations = read(clip(rows))
    assert [c.name for c in observations.channels] == ["angle"]
    assert (observations.unused[0].count, observations.unused[0].reason) == (
        40, "column '3 (angle_rate)': not a time or a position"
    )  # fmt: skip


@pytest.mark.parametrize(
    ("values", "share"), [((0, 0), "(1.00, 0.00) that has 100 % of them"), ((3, 4), "(0.60, 0.80) that has 100 %")]
)
def test_rates_about_two_axes(clip, values, share):
    x, y = values
    observations = read(clip("t,gyroscope x,gyroscope y\n" + "".join(f"{i / 10},{x * i},{y * i}\n" for i in range(4))))
    assert observations.channel("angle_rate").value == pytest.approx(math.hypot(x, y) * np.arange(4))
    assert share in observations.summary()


@pytest.mark.parametrize("name", ["a", "b"])
def test_rates_of_one_of_two_objects(clip, name):
    rows = "".join(f"{i // 2 / 10},{'ab'[i % 2]},{3 * i},{4 * i}\n" for i in range(7))
    observations = read(clip("t,particle,gyroscope x,gyroscope y\n" + rows), tracks={"light": name})
    assert observations.channel("angle_rate").value == pytest.approx(5 * np.arange(7)["ab".index(name) :: 2])
    assert "track not asked for" in observations.summary()


def test_tidy_events(clip):
    observations = read(clip("quantity,index,value,sigma,unit\nstop,1,310,8,ms\ndrop_at_halt,1,37,1,cm\nstop,2,,8,ms\n"))
    first, second = observations.events
    assert (first.quantity, first.index, first.unit) == ("stop", 1, "s")
    assert (first.value, first.sigma) == pytest.approx((0.31, 0.008))
    assert (second.value, second.sigma, second.unit) == (pytest.approx(0.37), pytest.approx(0.01), "m")
    assert observations.unused[0].reason == "not measured: stop 2"


def test_merge_and_mirror(clip):
    light = read(clip("t,x,y\n0,1,2\n.01,3,4\n"), tracks={"light": ""})
    heavy = read(clip("t,x,y\n0,5,6\n.01,7,8\n"), tracks={"heavy": ""})
    both = merge("a", (light, heavy))
    assert [c.name for c in both.channels] == ["light_x", "light_y", "heavy_x", "heavy_y"]
    assert set(both.bodies()) == {"light", "heavy"}
    with pytest.raises(DataError, match="found light_x again"):
        merge("a", (light, light))
    assert mirrored(both).channel("light_x").value.tolist() == [-1, -3]
    assert mirrored(both).channel("light_y").value.tolist() == [2, 4]
    with pytest.raises(DataError, match="found no angle, only light_x"):
        both.channel("angle")


@pytest.mark.parametrize(("name", "t"), [("light_z", [0.0, 1.0]), ("light_x", [1.0, 1.0]), ("light_x", [0.0, np.nan])])
def test_a_channel_refuses_what_it_cannot_be(name, t):
    with pytest.raises(DataError):
        Channel(name=name, t=np.array(t), value=np.zeros(2))
