"""Ways of writing a place, a time and a lost object; the oracle is the motion that the text was made from."""

import re
import time

import numpy as np
import pytest

from looping_pendulum.measured.tables.readers import DataError, read
from tests.discrepancy.follow_advice import follow_advice

ROWS = 60
TIME = np.arange(ROWS) / 100
ANGLE = 3.4 + 4 * TIME**2
LIGHT = np.stack([(0.55 - 0.3 * TIME) * np.cos(ANGLE), (0.55 - 0.3 * TIME) * np.sin(ANGLE)], axis=1)
HEAVY = np.stack([np.full(ROWS, 0.006) + 1e-4 * np.sin(90 * TIME), -0.05 - TIME**2], axis=1)
KNOWN = {"light": LIGHT, "heavy": HEAVY}
SIZE = 0.02 + 0.004 * np.sin(20 * TIME)[:, None] * [1, 0.5]
PIXEL = 0.002
RATE = {"frame_rate": 100.0}
NAMED = {"light": "light", "heavy": "heavy"}


def table(head, columns, digits=6):
    rows = (",".join(c if isinstance(c, str) else f"{c:.{digits}f}" for c in row) for row in zip(*columns, strict=True))
    return "".join(f"{line}\n" for line in (*([head] if head else []), *rows))


def long_table(head, place, first=lambda k, i: f"{i},{('light', 'heavy')[k]}", after=""):
    """Return rows of both masses by turns; ``place`` gives the numbers of a mass in a row."""
    rows = [
        f"{first(k, i)}," + ",".join(f"{v:.6f}" for v in place(points[i], SIZE[i])) + after
        for i in range(ROWS)
        for k, points in enumerate((LIGHT, HEAVY))
    ]
    return "\n".join([*([head] if head else []), *rows]) + "\n"


def corners(p, size):
    return (*(p - size / 2), *(p + size / 2))


def corner(p, size):
    return (*(p - size / 2), *size)


def in_pixels(place):
    return lambda p, size: [v / PIXEL for v in place(p, size)]


def counted(k, i):
    return f"{i + 1},{k + 1}"


METRES = {**RATE, "units": {"length": "m"}}
PIXELS = {**RATE, "units": {"length": f"{PIXEL * 1000:g} mm"}}
NUMBERED = {**PIXELS, "tracks": {"light": "1", "heavy": "2"}}
SEEN = [f"{v:.6f}" for v in TIME]
R, TURN = np.hypot(*LIGHT.T), np.unwrap(np.arctan2(*LIGHT.T[::-1])) % (2 * np.pi)
R_HEAVY, TURN_HEAVY = np.hypot(*HEAVY.T), np.arctan2(*HEAVY.T[::-1])
BOTH_POLAR = [SEEN, R, TURN, R_HEAVY, TURN_HEAVY]
FORMS = {
    "a corner and the size": (long_table("frame,id,x,y,w,h", in_pixels(corner)), {**PIXELS, "box": "corner"}),
    "the middle and the size": (
        long_table("frame,id,x,y,w,h", lambda p, size: (*p, *size)), {**METRES, "box": "centre"},
    ),
    "the middle, said so, and the size": (long_table("frame,id,xc,yc,width,height", lambda p, size: (*p, *size)), METRES),
    "x_center and size": (long_table("frame,id,x_center,y_center,w,h", lambda p, size: (*p, *size)), METRES),
    "bbox_x and size": (long_table("frame,id,bbox_x,bbox_y,bbox_w,bbox_h", corner), {**METRES, "box": "corner"}),
    "two corners": (long_table("frame,id,x1,y1,x2,y2", in_pixels(corners)), PIXELS),
    "two corners of a class": (long_table("frame,class,x1,y1,x2,y2", in_pixels(corners)), PIXELS),
    "edges by a label": (long_table("frame,label,xtl,ytl,xbr,ybr", in_pixels(corners)), PIXELS),
    "two corners from 0": (long_table("frame,id,x0,y0,x1,y1", in_pixels(corners)), PIXELS),
    "xmin to ymax": (long_table("frame,id,xmin,ymin,xmax,ymax", in_pixels(corners)), PIXELS),
    "x_min to y_max": (long_table("frame,id,x_min,y_min,x_max,y_max", in_pixels(corners)), PIXELS),
    "edges": (long_table("frame,id,left,top,right,bottom,conf", in_pixels(corners), after=",0.9"), PIXELS),
    "names of MOT": (long_table("frame,id,bb_left,bb_top,bb_width,bb_height", in_pixels(corner)), PIXELS),
    "MOT, ten columns": (long_table("", in_pixels(corner), counted, ",1,-1,-1,-1"), NUMBERED),
    "MOT, no confidence": (long_table("", in_pixels(corner), counted, ",-1,-1,-1,-1"), NUMBERED),
    "boxes side by side": (
        table(
            "t," + ",".join(f"{m}_{edge}" for m in NAMED for edge in ("xmin", "ymin", "xmax", "ymax")),
            [SEEN, *(LIGHT - SIZE / 2).T, *(LIGHT + SIZE / 2).T, *(HEAVY - SIZE / 2).T, *(HEAVY + SIZE / 2).T],
        ),
        {"units": {"length": "m"}},
    ),
    "polar": (table("t (s),light r (m),light θ (rad),heavy r (m),heavy θ (rad)", BOTH_POLAR), {}),
    "polar, in words": (table("t,light radius,light angle,heavy radius,heavy angle", BOTH_POLAR), {}),
    "polar, below names": (
        ",light,,heavy,\n" + table("t,r,theta,r,theta", BOTH_POLAR), {},
    ),
    "polar, numbered": (
        table("t,r1,theta1,r2,theta2", BOTH_POLAR), {"tracks": {"light": "1", "heavy": "2"}},
    ),
    "polar, degrees": (
        table("t,light_r,light_theta [deg],heavy_r,heavy_theta [deg]",
              [SEEN, R, np.degrees(TURN), R_HEAVY, np.degrees(TURN_HEAVY)]), {},
    ),
    "polar, degrees without a unit": (
        table("t,light_r,light_theta,heavy_r,heavy_theta", [SEEN, R, np.degrees(TURN), R_HEAVY, np.degrees(TURN_HEAVY)]),
        {"units": {"angle": "deg"}},
    ),
    "polar, after some turns": (
        table("t,r [m],theta [deg]", [SEEN, R, np.degrees(TURN) + 360 * np.floor(10 * TIME)]), {"tracks": {"light": ""}},
    ),
    "polar, one mass": (table("t,r,theta", [SEEN, R, TURN]), {"tracks": {"light": ""}}),
    "x and z": (
        table("t," + ",".join(f"{m} {a}" for m in NAMED for a in "XYZ"),
              [SEEN, LIGHT[:, 0], 0.012 + 0.001 * LIGHT[:, 1], LIGHT[:, 1], HEAVY[:, 0], 0 * TIME, HEAVY[:, 1]]),
        {"plane": "xz"},
    ),
    "x and z, no y": (
        table("t,light X,light Z,heavy X,heavy Z", [SEEN, *LIGHT.T, *HEAVY.T]), {"plane": "xz"},
    ),
    "z and y": (
        table("t," + ",".join(f"{m} {a}" for m in NAMED for a in "XYZ"),
              [SEEN, 0.012 + 0.001 * LIGHT[:, 1], LIGHT[:, 1], LIGHT[:, 0], 0 * TIME, HEAVY[:, 1], HEAVY[:, 0]]),
        {"plane": "zy"},
    ),
    "two masses that are no corners": (
        table("t,x1,y1,x2,y2", [SEEN, *LIGHT.T, *HEAVY.T]), {"tracks": {"light": "1", "heavy": "2"}},
    ),
    "fractions of a day": (
        table("Time,light_x,light_y,heavy_x,heavy_y", [[f"{t / 86400:.10f}" for t in TIME], *LIGHT.T, *HEAVY.T]),
        {"units": {"time": "day"}},
    ),
    "days of a calendar": (
        table("Time,light_x,light_y,heavy_x,heavy_y", [[f"{45123.25 + t / 86400:.10f}" for t in TIME], *LIGHT.T, *HEAVY.T]),
        {"units": {"time": "day"}},
    ),
    "minutes": (
        table("Time,light_x,light_y,heavy_x,heavy_y", [[f"{t / 60:.8f}" for t in TIME], *LIGHT.T, *HEAVY.T]),
        {"units": {"time": "min"}},
    ),
    "hours by name": (
        table("Time [h],light_x,light_y,heavy_x,heavy_y", [[f"{t / 3600:.10f}" for t in TIME], *LIGHT.T, *HEAVY.T]), {},
    ),
}  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
def test_a_form_gives_the_points_of_each_mass(clip, form):
    text, options = FORMS[form]
    observations = read(clip(text), **options)
    assert {c.name.partition("_")[0] for c in observations.channels} == set(options.get("tracks", KNOWN))
    for channel in observations.channels:
        mass, _, axis = channel.name.partition("_")
        # A last digit of 1e-10 days is 9 us
        assert channel.t == pytest.approx(TIME, abs=5e-6)
        assert channel.value == pytest.approx(KNOWN[mass][:, "xy".index(axis)], abs=3e-6)


@pytest.mark.parametrize("form", FORMS)
def test_advice_that_is_followed_leads_to_points(clip, form):
    observations, _ = follow_advice(clip(FORMS[form][0]))
    assert len(observations.channels) >= 2


@pytest.mark.parametrize(
    ("form", "without", "said"),
    [
        ("a corner and the size", "box", "if its corner of smallest x and y, write 'box: corner'"),
        ("two corners", "units", "found lengths in pixels, needed the size of one"),
        ("x and z", "plane", "found that y hardly moves (0.000"),
        ("x and z", "plane", "if these are its axes, to the right and up, write 'plane: xz'"),
        ("z and y", "plane", "write 'plane: zy'"),
        ("fractions of a day", "units", "fractions of a day, as spreadsheets have them, say so: 'units: {time: day}'"),
        ("polar, degrees without a unit", "units", "if the file is in another unit, say so: 'units: {angle: deg}'"),
    ],
)  # fmt: skip
def test_what_a_table_does_not_say_is_asked(clip, form, without, said):
    text, options = FORMS[form]
    path = clip(text)
    with pytest.raises(DataError) as caught:
        read(path, **{key: value for key, value in options.items() if key != without})
    message = str(caught.value)
    assert said in message


@pytest.mark.parametrize("rows", [(7,), (20, 41), (30, 31, 32), range(8), range(50, 60)])
@pytest.mark.parametrize(
    ("mark", "unit", "size"), [(-9999, "mm", 1e3), (-9999, "m", 1), (999, "cm", 100), (99999, "px", 500), (-1000, "mm", 1e3)]
)
def test_any_mark_of_a_lost_object_is_one_in_any_unit(clip, rows, mark, unit, size):
    light = size * LIGHT
    light[list(rows)] = mark
    path = clip(table(f"t [s],light_x [{unit}],light_y [{unit}]", [SEEN, *light.T], digits=4))
    observations = read(path, units={"length": "2 mm"} if unit == "px" else None)
    assert observations.channel("light_x").value == pytest.approx(np.delete(LIGHT[:, 0], list(rows)), abs=1e-4)
    assert f"{len(rows)} not used: light_x: the mark of a lost object" in observations.summary()


@pytest.mark.parametrize("rows", [(20, 41), (30, 31, 32), range(50, 60)])
def test_a_place_far_away_that_comes_again_is_a_mark(clip, rows):
    """(-1, -1) in pixels, which the program has put into its axes."""
    light = LIGHT.copy()
    light[list(rows)] = (-2.3157, 1.2841)
    path = clip(table("t [s],light_x [m],light_y [m]", [SEEN, *light.T]))
    assert read(path).channel("light_y").value == pytest.approx(np.delete(LIGHT[:, 1], list(rows)), abs=1e-6)


def test_one_coordinate_may_be_lost(clip):
    light = LIGHT.copy()
    light[[12, 40], 0] = -999
    observations = read(clip(table("t [s],light_x [m],light_y [m]", [SEEN, *light.T])))
    assert [len(c) for c in observations.channels] == [ROWS - 2, ROWS]


def test_a_mass_that_rests_and_then_moves_is_not_lost(clip):
    light = np.concatenate([np.repeat(LIGHT[:1], 20, axis=0), LIGHT[5:45]])
    assert "lost" not in read(clip(table("t [s],light_x [m],light_y [m]", [SEEN, *light.T]))).summary()


def test_a_mark_in_a_lone_column(clip):
    height = 30 - 4.9 * TIME**2
    height[[5, 33]] = -9999
    assert len(read(clip(table("time,height", [SEEN, height]))).channel("height")) == ROWS - 2


@pytest.mark.parametrize(
    "date",
    ["08. Aug", "08.Aug", "8-Aug", "2026-08-08", "2026-08-08 00:00:00", "08.08.2026", "05. Mai", "05. Mrz", "Dez 34"],
)
def test_a_number_that_a_spreadsheet_turned_into_a_date_names_its_cause(clip, date):
    path = clip(f"t,light_x [cm]\n0,8.05\n0.01,{date}\n0.02,8.11\n")
    said = rf":3: column light_x \[cm\]: found '{date}', needed a finite number .* empty it; if a spreadsheet made a date of a"
    with pytest.raises(DataError, match=said):
        read(path)
    path = clip("t,light_x [cm]\n0,8.05\n0.01,\n0.02,8.11\n")
    assert len(read(path).channel("light_x")) == 2


def test_an_angle_that_is_asked_for_needs_no_places(clip):
    path = clip(table("t [s],x,y,w,h,angle [rad]", [SEEN, *LIGHT.T, *SIZE.T, ANGLE - np.pi]))
    assert read(path, kind="angle").channel("angle").value == pytest.approx(ANGLE - np.pi, abs=1e-6)


def test_an_angle_without_a_unit_is_in_radians_and_said_so(clip):
    path = clip(table("time,angle", [SEEN, 2.5 * np.cos(4 * TIME)]))
    assert "angles without a unit taken in rad; if they are in degrees, say so by 'units: {angle: deg}'" in read(path).summary()
    path = clip(table("time,angle", [SEEN, 10 * np.cos(4 * TIME)]))
    with pytest.raises(DataError, match=r"found 10 rad at the beginning, needed at most 3.142; .*'units: {angle: deg}'"):
        read(path)
    assert read(path, units={"angle": "deg"}).channel("angle").value[0] == pytest.approx(np.radians(10))


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("t,light_x\n" + "".join(f"{i}e-6,{i / 9}\n" for i in range(30)), "found 1e+06 rows a second, needed at most 50000"),
        ("t [s],light_x\n0,1\n0.01,2\n0.02,3\n1e9,4\n", "needed at most 1000000 of one trial"),
        ("frame,light_x\n0,1\n1,2\n2,3\n1e9,4\n", "found frames from 0 to 1e+09, needed at most 1000000"),
    ],
)
def test_times_that_no_film_has_are_refused(clip, content, said):
    path = clip(content)
    with pytest.raises(DataError, match=re.escape(said)):
        read(path, frame_rate=240.0 if content.startswith("frame") else None)


MANY = {
    "lines of one letter": b"a\n" * 8000,
    "text": b"one two three\n" * 4000,
    "names again and again": b"t,x\n0,1\n" * 4000,
    "blocks of rows": b"".join(b"# a\n" + b"".join(b"%d,1,2\n" % i for i in range(12)) for _ in range(4000)),
    "objects": b"t,id,x,y\n" + b"".join(b"%d,%d,1,2\n" % (i // 2, i // 2) for i in range(40_000)),
    "columns": b",".join(b"x%d" % i for i in range(20_000)) + b"\n" + b",".join([b"1"] * 20_000),
    "comments": b"# t x y\n" * 60_000 + b"0,1,2\n" * 30_000,
    "newlines": b"\n" * (20 * 1024**2),
    "commas": (b"," * 90_000 + b"\n") * 200,
    "digits": b"1" * (20 * 1024**2),
    "quotation marks": b'"a\n' * 90_000,
    "noise": np.random.default_rng(1).integers(1, 256, 20 * 1024**2, dtype=np.uint8).tobytes(),
    "numbers": b"".join(b"%.4f,%.4f,%.4f\n" % (i / 240, i / 3e5, 1) for i in range(800_000)),
}


@pytest.mark.parametrize("case", MANY)
def test_much_of_anything_is_refused_in_time(clip, case):
    """8000 lines of text, 16 kB, took 60 s: the names of all lines above were read again at each line."""
    path = clip(MANY[case][: 20 * 1024**2])
    start = time.process_time()
    with pytest.raises(DataError):
        read(path)
    assert time.process_time() - start < 10
