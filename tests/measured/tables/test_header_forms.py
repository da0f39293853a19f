"""Headers as programs for tracking write them, several lines high; each gives the points that the text was made from.

The headers are those of public files: of DeepLabCut and SLEAP, OptiTrack's Motive, Vicon's Nexus, OpenSim, ImageJ's trackers,
TrackMate, DLTdv, Kinovea and pandas.
"""

import numpy as np
import pytest
from typer.testing import CliRunner

from looping_pendulum.cli.main import app
from looping_pendulum.measured.edits import without_copies
from looping_pendulum.measured.observations import ReadingNotes
from looping_pendulum.measured.tables.readers import DataError, read
from tests.discrepancy.follow_advice import follow_advice, follow_advice_of_look

ROWS = 24
TIME = np.arange(ROWS) / 100
LIGHT = np.stack([0.5 * np.cos(3 * TIME + 2), 0.4 * np.sin(3 * TIME**2 + 0.4)], axis=1)
HEAVY = np.stack([np.full(ROWS, 0.006), -0.05 - 2 * TIME**2], axis=1)
NAMED = {"light": "light", "heavy": "heavy"}
RATE = {"frame_rate": 100.0}


def table(rows, delimiter=","):
    shown = [[f"{cell:.5f}" if isinstance(cell, float) else str(cell) for cell in row] for row in rows]
    return "".join(delimiter.join(row) + "\n" for row in shown)


def beside(scale=1.0, between=(), start=(0,), order=(HEAVY, LIGHT), first=None):
    """Return rows with what begins each, then x and y of each object and what follows those of each."""
    begins = first or (lambda i: start)
    return [(*begins(i), *(c for p in order for c in (*(scale * p[i]).tolist(), *between))) for i in range(ROWS)]


def below(begins, order=(HEAVY, LIGHT), scale=1.0):
    """Return rows of one object below those of the other; ``begins`` gives the first cells for object and row."""
    return [(*begins(k, i), *(scale * p[i]).tolist()) for k, p in enumerate(order) for i in range(ROWS)]


def counted(i):
    return (i,)


def timed(i):
    return (float(TIME[i]),)


ONE_HEAVY, ONE_LIGHT = (below(lambda k, i: timed(i), order=(p,)) for p in (HEAVY, LIGHT))
DLC = "scorer,{0}\nindividuals,{1}\nbodyparts,{2}\ncoords,{3}\n"
FORMS = {
    "Vicon": (
        "Trajectories\n100\n,,Take:heavy,,,Take:light\nFrame,Sub Frame,X,Y,Z,X,Y,Z\n,,mm,mm,mm,mm,mm,mm\n"
        + table(beside(1e3, (1.5,), first=lambda i: (i + 101, 0))),
        {**RATE, "tracks": NAMED},
    ),
    "OpenSim": (
        "PathFileType\t4\t(X/Y/Z)\tclip.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame"
        "\tOrigNumFrames\n100.00\t100.00\t24\t2\tmm\t100.00\t1\t24\nFrame#\tTime\theavy\t\t\tlight\t\t\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n\n"
        + table(beside(1e3, (1.5,), first=lambda i: (i + 1, float(TIME[i]))), "\t"),
        {"tracks": NAMED},
    ),
    "OptiTrack 1.25 with a rigid body": (
        "Format Version,1.25,Take Name,Test,Take Notes,,Capture Frame Rate,100.0,Export Frame Rate,100.0,"
        "Rotation Type,Quaternion,Length Units,Centimeters\n\n,Type" + 7 * ",Rigid Body" + 6 * ",Marker" + "\n,Name"
        + 7 * ",rod" + 3 * ",loop:heavy" + 3 * ",loop:light" + "\n,ID" + 7 * ",r" + 3 * ",A1" + 3 * ",B2"
        + "\n,Parent" + 13 * "," + "\n,"
        + 4 * ",Rotation" + 9 * ",Position" + "\nFrame,Time (Seconds),X,Y,Z,W,X,Y,Z,X,Y,Z,X,Y,Z\n"
        + table(beside(1e2, (1.5,), first=lambda i: (i, float(TIME[i]), 0, 0, 0, 1, 5, 5, 5))),
        {"tracks": {"light": "loop:light", "heavy": "loop:heavy"}},
    ),
    "OptiTrack 1.23 with one marker": (
        "Format Version,1.23,Length Units,Millimeters\n\n," + 3 * ",Marker" + "\n," + 3 * ",loop:light" + "\n," + 3 * ",A1"
        + "\n," + 3 * ",Position" + "\nFrame,Time (Seconds),X,Y,Z\n"
        + table(beside(1e3, (1.5,), order=(LIGHT,), first=lambda i: (i, float(TIME[i])))),
        {"tracks": {"light": "light"}},
    ),
    "DeepLabCut, one animal of named points": (
        DLC.format(",".join(6 * ["DLC"]), ",".join(6 * ["one"]), "heavy,heavy,heavy,light,light,light", 2 * "x,y,likelihood,")
        + table(beside(1.0, (0.99,), first=counted)),
        {**RATE, "tracks": NAMED},
    ),
    "DeepLabCut, two animals of one point": (
        DLC.format(",".join(4 * ["DLC"]), "a,a,b,b", "ball,ball,ball,ball", "x,y,x,y") + table(beside(first=counted)),
        {**RATE, "tracks": {"light": "b", "heavy": "a"}},
    ),
    "DeepLabCut, two animals of two points": (
        DLC.format(",".join(8 * ["DLC"]), "a,a,a,a,b,b,b,b", 2 * "ball,ball,pin,pin,", 4 * "x,y,")
        + table(beside(1.0, (1.0, 2.0), first=counted)),
        {**RATE, "tracks": {"light": "b ball", "heavy": "a ball"}},
    ),
    "SLEAP, two tracks": (
        "ball.score,track,frame_idx,instance.score,ball.x,ball.y\n" + table(below(lambda k, i: (0.6, f"track_{k}", i, 0.9))),
        {**RATE, "tracks": {"light": "track_1", "heavy": "track_0"}},
    ),
    "SLEAP, no track": (
        "track,frame_idx,instance.score,heavy.x,heavy.y,heavy.score,light.x,light.y,light.score\n"
        + table(beside(1.0, (0.4,), first=lambda i: ("", i, 0.9))),
        {**RATE, "tracks": NAMED},
    ),
    "DLTdv, whose rows are frames": (
        "pt1_cam1_X,pt1_cam1_Y,pt2_cam1_X,pt2_cam1_Y\n" + table(beside(start=())),
        {**RATE, "tracks": {"light": "pt2_cam1", "heavy": "pt1_cam1"}},
    ),
    "ImageJ, MTrack2": (
        "Frame\tX1\tY1\tFlag1\tX2\tY2\tFlag2\n" + table(beside(1.0, ("*",), first=lambda i: (i + 1,)), "\t"),
        {**RATE, "tracks": {"light": "2", "heavy": "1"}},
    ),
    "ImageJ, manual tracking": (
        " \tTrack n°\tSlice n°\tX\tY\n" + table(below(lambda k, i: (k * ROWS + i + 1, k + 1, i + 1)), "\t"),
        {**RATE, "tracks": {"light": "2", "heavy": "1"}},
    ),
    "ImageJ, MTrackJ": (
        "Nr\tTID\tPID\tt [sec]\tx [m]\ty [m]\n" + table(below(lambda k, i: (i + 1, k + 1, i + 1, float(TIME[i]))), "\t"),
        {"tracks": {"light": "2", "heavy": "1"}},
    ),
    "TrackMate": (
        "LABEL,ID,TRACK_ID,POSITION_T,FRAME,POSITION_X,POSITION_Y\nLabel,Spot ID,Track ID,T,Frame,X,Y\n,,,(sec),,(cm),(cm)\n"
        + table(below(lambda k, i: (f"ID{2 * i + k}", 2 * i + k, k, float(TIME[i]), i), scale=100)),
        {"tracks": {"light": "1", "heavy": "0"}},
    ),
    "numbered objects whose rows are frames": (
        "id,x,y,w,h\n" + table((*row, 0.1, 0.1) for row in below(lambda k, i: (k,))),
        {**RATE, "tracks": {"light": "1", "heavy": "0"}, "box": "centre"},
    ),
    "pandas, two lines and the index's name": (
        ",heavy,heavy,light,light\n,x,y,x,y\nt,,,,\n" + table(beside(first=timed)), {"tracks": NAMED},
    ),
    "pandas, an index without a name": (",heavy,heavy,light,light\n,x,y,x,y\n" + table(beside(first=timed)), {"tracks": NAMED}),
    "pandas, pairs of names": (
        "t,\"('heavy', 'x')\",\"('heavy', 'y')\",\"('light', 'x')\",\"('light', 'y')\"\n" + table(beside(first=timed)),
        {"tracks": NAMED},
    ),
    "names with line breaks": (
        't,"heavy\nx","heavy\ny","light\nx","light\ny"\n' + table(beside(first=timed)), {"tracks": NAMED},
    ),
    "Kinovea's text with names": (
        "#Kinovea Trajectory data export\n#T X Y\n\n# heavy\n" + table(ONE_HEAVY, " ") + "\n\n# light\n"
        + table(ONE_LIGHT, " "),
        {"tracks": NAMED},
    ),
    "Kinovea's text without names": (
        "#Kinovea Trajectory data export\n#T X Y\n" + table(ONE_HEAVY + ONE_LIGHT, " "),
        {"tracks": {"light": "2", "heavy": "1"}},
    ),
    "one object below the other, its name in a cell": (
        "t,x,y\nheavy,,\n" + table(ONE_HEAVY) + "light,,\n" + table(ONE_LIGHT),
        {"tracks": NAMED},
    ),
    "a second table below the first": (
        "heavy,,\nt,x,y\n" + table(ONE_HEAVY) + ",,\nlight,,\nt,x,y\n" + table(ONE_LIGHT),
        {"tracks": NAMED},
    ),
    "two tables side by side": (
        "heavy,,,,light,,\nt,x,y,,t,x,y\n"
        + table((*one, "", *other) for one, other in zip(ONE_HEAVY, ONE_LIGHT, strict=True)),
        {"tracks": NAMED},
    ),
    "two trials side by side": (
        "Trial 1,,,,,,Trial 2,,,,\n" + ",,".join(2 * ["t (s),heavy x (m),heavy y (m),light x (m),light y (m)"]) + "\n"
        + table((*row, "", *timed(0), *(0.1 * i for i in (1, 2, 3, 4))) for row in beside(first=timed)),
        {"run": "Trial 1"},
    ),
    "times by their unit, in any language": (
        "czas [s],heavy_x,heavy_y,light_x,light_y\n" + table(beside(first=timed)), {},
    ),
    "whole numbers that grow, under any name": (
        "próbka,heavy_x,heavy_y,light_x,light_y\n" + table(beside(first=counted)), RATE,
    ),
    "columns without names": (table(beside(first=timed)), {"tracks": {"heavy": "1", "light": "2"}}),
    "columns without names, keys in the other order": (table(beside(first=timed)), {"tracks": {"light": "2", "heavy": "1"}}),
}  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
def test_a_header_gives_the_points_of_each_mass(clip, form):
    text, options = FORMS[form]
    observations = read(clip(text), **options)
    known = {"light": LIGHT, "heavy": HEAVY}
    assert {c.name.partition("_")[0] for c in observations.channels} == set(options.get("tracks", known))
    for channel in observations.channels:
        mass, _, axis = channel.name.partition("_")
        assert channel.t == pytest.approx(TIME, abs=1e-9)
        assert channel.value == pytest.approx(known[mass][:, "xy".index(axis)], abs=1e-5)


@pytest.mark.parametrize("tracks", [None, {"light": "A", "heavy": "B"}, {"light": "B: #2, [x]", "heavy": "light"}])
@pytest.mark.parametrize("form", FORMS)
def test_advice_that_is_followed_leads_to_points(clip, form, tracks):
    observations, said = follow_advice(clip(FORMS[form][0]), tracks=tracks)
    assert observations is not None or "columns without names, needed a line of names" in said[-1]


@pytest.mark.parametrize("form", FORMS)
def test_advice_of_look_is_typed_as_it_stands(clip, form):
    """It named keys of a study, which a table has not."""
    said = follow_advice_of_look(clip(FORMS[form][0]))
    assert "light_x" in said[-1] or "columns without names, needed a line of names" in said[-1]


def test_look_takes_no_keys_beside_a_study(tmp_path):
    done = CliRunner().invoke(app, ["look", str(tmp_path / "study.yaml"), "--set", "frame_rate=240 Hz"])
    assert "--set: found it beside a study, needed a table" in str(done.exception)


def test_a_name_with_signs_of_yaml_is_advised_in_quotes(clip):
    path = clip("t;{A}, #1 x;{A}, #1 y;B: 2 x;B: 2 y\n" + table(beside(first=timed), ";"))
    observations, said = follow_advice(path)
    assert len(observations.channels) == 4
    assert "'tracks: {light: " in said[0]


@pytest.mark.parametrize("lost", [(7,), (3, 4, 5, 11)])
@pytest.mark.parametrize(("high", "low"), [(0.99, 0.01), (0.4, 0.1)])
def test_points_of_which_the_tracker_is_not_sure_are_lost(clip, lost, high, low):
    rows = [(i, *HEAVY[i].tolist(), *LIGHT[i].tolist(), low if i in lost else high) for i in range(ROWS)]
    observations = read(clip("frame,heavy_x,heavy_y,light_x,light_y,light_likelihood\n" + table(rows)), **RATE)
    assert observations.channel("light_y").value == pytest.approx(np.delete(LIGHT[:, 1], lost), abs=1e-5)
    assert len(observations.channel("heavy_y")) == ROWS
    assert f"{len(lost)} not used: light_x: the tracker's score is low" in observations.summary()


@pytest.mark.parametrize("rows", [range(18, 24), range(9, 12), range(4)], ids=["end", "middle", "start"])
@pytest.mark.parametrize(("mark", "unit"), [(0, "m"), (-1, "px")])
def test_a_lost_object_that_is_written_as_a_place_is_lost(clip, rows, mark, unit):
    light = [(mark, mark) if i in rows else LIGHT[i].tolist() for i in range(ROWS)]
    path = clip(f"t,light_x [{unit}],light_y [{unit}]\n" + table((*timed(i), *light[i]) for i in range(ROWS)))
    observations = read(path, units={"length": "1 m"} if unit == "px" else None)
    assert observations.channel("light_x").value == pytest.approx(np.delete(LIGHT[:, 0], list(rows)), abs=1e-5)


def test_a_mass_that_begins_at_the_origin_is_not_lost(clip):
    path = clip("t,heavy_x,heavy_y\n" + table((float(t), 0, round(-2 * t * t, 5)) for t in TIME))
    assert read(path).channel("heavy_y").value[0] == 0


def test_an_angle_beside_pixels_needs_no_size_of_them(clip):
    path = clip(
        "t [s],x [px],y [px],angle [deg]\n" + table((float(t), 300 + i, 200, 60 * float(t)) for i, t in enumerate(TIME))
    )
    assert read(path).channel("angle").value == pytest.approx(np.radians(60 * TIME), abs=1e-6)


def test_two_runs_one_below_the_other_are_asked_for(clip):
    path = clip("t,light_x,light_y\n" + table(below(lambda k, i: timed(i), (HEAVY, LIGHT))))
    with pytest.raises(DataError, match=r"found the runs 1, 2, needed one trial; choose by 'run: 1'"):
        read(path)
    assert read(path, run="2").channel("light_x").value == pytest.approx(LIGHT[:, 0], abs=1e-5)


def test_rows_that_are_frames_count_those_without_points(clip):
    """A line of tabs was taken for a blank line, and all later rows came a frame too early."""
    rows = [row if i != 7 else ("", "", "", "") for i, row in enumerate(beside(start=()))]
    header = "heavy_x\theavy_y\tlight_x\tlight_y\n"
    path = clip(header + table(rows, "\t"))
    assert read(path, **RATE).channel("light_x").t == pytest.approx(np.delete(TIME, 7))
    path = clip(header + table(rows, "\t").replace("\n\t\t\t\n", "\n\n"))
    with pytest.raises(DataError, match="found no column of times"):
        read(path, **RATE)


def test_an_object_that_is_lost_stays_at_its_last_place(clip):
    def seen(light):
        rows = ((float(t), *place) for t, place in zip(TIME, light.tolist(), strict=True))
        return without_copies(read(clip("t,light_x,light_y\n" + table(rows))).channels, notes)[0]

    notes = ReadingNotes()
    noise = np.random.default_rng(1).normal(0, 1e-3, (ROWS, 2))
    light = np.round(LIGHT + noise, 4)
    light[14:] = light[13]
    assert seen(light).value == pytest.approx(light[:14, 0])
    assert notes.unused["light_x: a copy of the point before"] == 10
    # A mass at rest whose noise is far below the last digit is seen to rest
    still = np.round(LIGHT, 2)
    still[14:] = still[13]
    assert len(seen(still)) == ROWS
