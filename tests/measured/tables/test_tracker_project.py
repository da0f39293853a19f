"""Project files of Tracker are read as Tracker shows them. Positions and times in the tests are worked out by hand."""

import contextlib
import io
import math
import re
import zipfile
from types import SimpleNamespace

import numpy as np
import pytest

from looping_pendulum.measured.observations import DataError
from looping_pendulum.measured.tables.tracker_project import read_project
from tests.discrepancy.real_data import real

TRACKER = "org.opensourcephysics.cabrillo.tracker"
MEDIA = "org.opensourcephysics.media.core"
MARKS = {0: (100, 200), 1: (110, 190), 2: (120, 170)}


def prop(name, value, kind="double"):
    return f'<property name="{name}" type="{kind}">{value}</property>'


def obj(kind, *properties):
    return f'<object class="{kind}">{"".join(properties)}</object>'


RATE = (prop("delta_t", 20.0),)


def array(name, entries):
    """Return an array as Tracker writes it: indices that are left out are null."""
    return prop(name, "".join(prop(f"[{n}]", entry, "object") for n, entry in entries.items()), "array")


def track(name="A", marks=MARKS, kind="PointMass", mass=1.0):
    points = {n: obj(f"{TRACKER}.PointMass$FrameData", prop("x", x), prop("y", y)) for n, (x, y) in marks.items()}
    return prop(
        "item", obj(f"{TRACKER}.{kind}", prop("mass", mass), prop("name", name, "string"), array("framedata", points)), "object"
    )


def axes(origin=(100, 200), angle=0.0, scale=(10, 10)):
    names = ("xorigin", "yorigin", "angle", "xscale", "yscale")
    values = (*origin, angle, *scale)
    return obj(f"{MEDIA}.ImageCoordSystem$FrameData", *map(prop, names, values))


def project(tracks=None, coords=None, clip=(), video=(), control=RATE, more=(), head='<?xml version="1.0"?>'):
    """Return a project whose frames last 20 ms, with the origin at the first mark of `MARKS` and 10 pixels per metre."""
    parts = (
        prop("semantic_version", "6.2.0", "string"),
        prop("videoclip", obj(f"{MEDIA}.VideoClip", prop("video", obj("XuggleVideo", *video), "object"), *clip), "object"),
        prop("clipcontrol", obj(f"{MEDIA}.StepperClipControl", *control), "object"),
        prop("coords", obj(f"{MEDIA}.ImageCoordSystem", array("framedata", coords or {0: axes()})), "object"),
        prop("tracks", "".join([track()] if tracks is None else tracks), "collection"),
        *more,
    )
    return (head + obj(f"{TRACKER}.TrackerPanel", *parts)).encode()


def archive(members, method=zipfile.ZIP_DEFLATED):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method) as out:
        for name, content in members.items():
            out.writestr(name, content)
    return stream.getvalue()


def read(raw):
    """Return what the table that is made of a project says: its tracks with times, its unit of length, its notes."""
    text = read_project(raw, "trial.trk")
    head, *rows = text.lines
    tracks = []
    for name in dict.fromkeys(row.cells[0] for row in rows):
        t, frame, x, y = np.array([row.values[1:] for row in rows if row.cells[0] == name]).T
        tracks.append(SimpleNamespace(name=name, t=t, frame=frame.astype(int), x=x, y=y))
    unit = head.cells[3].removeprefix("x [").removesuffix("]")
    return SimpleNamespace(tracks=tracks, length_unit=unit, notes=text.notes)


def clip(start=0, step=1, count=100, start_time=0.0):
    return (
        prop("startframe", start, "int"),
        prop("stepsize", step, "int"),
        prop("stepcount", count, "int"),
        prop("starttime", start_time),
    )


def start_times(*times):
    return (prop("start_times", prop("array", "{" + ",".join(map(str, times)) + "}", "string"), "array"),)


def test_a_students_pendulum():
    raw = real("pendulum_project/pendulum_length1.trk").read_bytes()
    read_back = read(raw)
    (mass,) = read_back.tracks
    assert (mass.name, read_back.length_unit) == ("mass A", "m")
    assert mass.frame.tolist() == list(range(1300, 1700, 5))
    # The file's calibration stick of 0.6096 m lies between (864.5, 1044) and (1226.5, 1043), the origin is at (868.5, 6.5)
    scale = math.hypot(362, 1) / 0.6096
    assert np.allclose([mass.x[0], mass.y[0]], [(1293.5 - 868.5) / scale, (6.5 - 534.5) / scale], rtol=1e-12)
    # Time counts from frame 0, by 16.668... ms
    assert mass.t[0] == pytest.approx(1300 * 16.668018018018017e-3, rel=1e-12)
    assert read_back.notes == ("The project's step size is 5 frames.",)
    # It is a pendulum: on a circle about the origin, with the period 2 pi sqrt(L / g) (1 + a^2 / 16) of its length L. The
    # circle is seen as an oval, 4 % longer than wide, so that the period is uncertain by 2 %.
    length = np.hypot(mass.x, mass.y)
    assert np.ptp(length) < 0.04 * length.mean()
    time, before = mass.t, np.flatnonzero((mass.x[:-1] > 0) & (mass.x[1:] <= 0))
    share = mass.x[before] / (mass.x[before] - mass.x[before + 1])
    period = np.diff(time[before] + share * (time[before + 1] - time[before])).mean()
    amplitude = np.abs(np.arctan2(mass.x, -mass.y)).max()
    assert period == pytest.approx(2 * math.pi * math.sqrt(length.mean() / 9.81) * (1 + amplitude**2 / 16), rel=0.02)


@pytest.mark.parametrize("trial", ["first", "second"])
def test_the_forms_project_equals_its_table(trial):
    project_read = read(real(f"forms/18-tracker-project-file/{trial}.trk").read_bytes())
    table = np.genfromtxt(real(f"forms/10-time-in-the-last-column/{trial}.csv"), delimiter=",", skip_header=1)
    assert [t.name for t in project_read.tracks] == ["light", "heavy"]
    for column, mass in zip((0, 2), project_read.tracks, strict=True):
        # The project writes 'nan' where the table has an empty cell; the table has five digits
        assert mass.frame.tolist() == np.flatnonzero(~np.isnan(table[:, column])).tolist()
        for values, shown in ((mass.x, table[mass.frame, column]), (mass.y, table[mass.frame, column + 1])):
            assert np.all(np.abs(values - shown) <= 0.51e-4 * np.maximum(np.abs(shown), 1e-3))
        # The phone played 240 frames a second at 30: its frame times are eight times the table's, which have five digits
        time = table[mass.frame, -1]
        assert np.all(np.abs(mass.t - 8 * time) <= 8 * 0.51e-4 * np.maximum(time, 1e-3))


def test_positions_have_y_up_and_the_projects_unit():
    read_back = read(project(more=(prop("length_unit", "cm", "string"),)))
    (mass,) = read_back.tracks
    assert mass.x.tolist() == [0, 1, 2]
    assert mass.y.tolist() == [0, 1, 3]
    assert read_back.length_unit == "cm"
    assert read(project()).length_unit == "m"
    assert read_back.notes == ()


def test_a_position_in_rotated_axes():
    # The x axis is turned counterclockwise by 90 deg: it points up, y to the left. A mark 10 px right and 30 px up is 3, -1.
    (mass,) = read(project([track(marks={0: (110, 170)})], {0: axes(angle=90.0)})).tracks
    assert np.allclose([mass.x[0], mass.y[0]], [3, -1])
    # By 30 deg: 2 m along the new x axis is 2 cos 30 right and 2 sin 30 up
    along = (100 + 20 * math.cos(math.pi / 6), 200 - 20 * math.sin(math.pi / 6))
    (mass,) = read(project([track(marks={0: along})], {0: axes(angle=30.0)})).tracks
    assert np.allclose([mass.x[0], mass.y[0]], [2, 0])


def test_each_direction_of_the_picture_has_its_scale():
    (mass,) = read(project(coords={0: axes(scale=(10, 5))})).tracks
    assert mass.x.tolist() == [0, 1, 2]
    assert mass.y.tolist() == [0, 2, 6]


def test_axes_that_change_are_refused_unless_they_are_set_again_as_they_were():
    with pytest.raises(DataError, match="found axes that change with the frame, needed fixed ones; choose fixed origin"):
        read(project(coords={0: axes(), 2: axes(origin=(110, 200))}))
    (mass,) = read(project(coords={0: axes(), 2: axes()})).tracks
    assert mass.x.tolist() == [0, 1, 2]


def test_points_of_null_frames_are_none():
    marks = {0: (100, 200), 3: (110, 200), 4: ("NaN", "NaN")}
    last = prop("[7]", "null", "object")
    raw = project([track(marks=marks).replace("</property></object></property>", f"{last}</property></object></property>")])
    assert b"null" in raw
    (mass,) = read(raw).tracks
    assert mass.frame.tolist() == [0, 3]
    assert mass.x.tolist() == [0, 1]


def test_frames_are_sorted():
    (mass,) = read(project([track(marks={2: (120, 200), 0: (100, 200)})])).tracks
    assert mass.frame.tolist() == [0, 2]
    assert mass.x.tolist() == [0, 2]


def test_a_project_without_a_scale_is_in_pixels():
    read_back = read(project(coords={0: axes(scale=(1.0, 1.0))}, more=(prop("length_unit", "m", "string"),)))
    assert read_back.length_unit == "px"
    assert read_back.tracks[0].y.tolist() == [0, 10, 30]
    assert read_back.notes == ("The project is not calibrated: positions are in pixels.",)


def test_several_tracks_and_their_names():
    tracks = [
        track("light &amp; small"),
        track('<![CDATA[the "heavy" <one>]]>', marks={1: (100, 150)}),
        track("cm", kind="CenterOfMass"),
        track("fall", kind="DynamicParticle"),
        track("v", kind="Vector"),
        track("stick", kind="TapeMeasure"),
        track("empty", marks={}),
    ]
    read_back = read(project(tracks))
    assert [(t.name, len(t.frame)) for t in read_back.tracks] == [
        ("light & small", 3),
        ('the "heavy" <one>', 1),
    ]
    left_out = "'cm' (CenterOfMass), 'fall' (DynamicParticle), 'v' (Vector), 'empty' (no points in the clip)"
    assert read_back.notes == (f"Tracks that were left out: {left_out}.",)


def test_a_reference_frame_is_named():
    assert read(project(more=(prop("referenceframe", "B", "string"),))).notes == (
        "The project shows positions relative to 'B'; they are read in fixed axes instead.",
    )


def test_time_counts_from_the_start_frame_and_its_time():
    read_back = read(project([track(marks={2: (1, 1), 6: (1, 1)})], clip=clip(start=2, step=2, start_time=500.0)))
    # 20 ms per frame, 0.5 s at frame 2
    assert np.allclose(read_back.tracks[0].t, [0.5, 0.58])
    assert read_back.notes == ("The project's step size is 2 frames.", "The project's clock reads 0.5 s at frame 2.")


def test_points_between_steps_are_kept_and_those_outside_the_clip_are_not():
    marks = dict.fromkeys(range(10), (100, 200))
    read_back = read(project([track(marks=marks)], clip=clip(start=2, step=3, count=2)))
    # Steps at frames 2 and 5
    assert read_back.tracks[0].frame.tolist() == [2, 3, 4, 5]
    assert read_back.notes[0] == "Points of 'A' outside the project's clip (frames 2 to 5) were left out: 6."


def test_the_films_own_times_are_used():
    times = (7.0, 40.0, 75.0, 106.0, 140.0)
    # The mean of frames 1 to 4 lasts (140 - 40) / 3 ms
    marked = [track(marks=dict.fromkeys(range(5), (100, 200)))]
    clock = {"video": start_times(*times), "control": (prop("delta_t", 100 / 3),)}
    read_back = read(project(marked, clip=clip(start=1, count=4), **clock))
    assert np.allclose(read_back.tracks[0].t, [0, 0.035, 0.066, 0.1])
    assert read_back.notes == ("Points of 'A' outside the project's clip (frames 1 to 4) were left out: 1.",)


def test_the_films_own_times_are_stretched_to_the_projects_rate():
    # The film plays at 25 frames a second, the user has set 250
    read_back = read(project(video=start_times(0, 41, 80, 119, 160), control=(prop("delta_t", 4.0),)))
    assert np.allclose(read_back.tracks[0].t, [0, 0.0041, 0.008])
    assert read_back.notes == ("A frame lasts 4 ms by the project's clock, which is used, and 40 ms by the film's.",)


def test_short_arrays_and_projects_without_a_rate():
    video = (prop("start_times", prop("[0]", 0.0) + prop("[1]", 10.0) + prop("[2]", 30.0), "array"),)
    read_back = read(project(video=video, control=()))
    assert np.allclose(read_back.tracks[0].t, [0, 0.01, 0.03])
    # A folder of pictures as a film
    assert np.allclose(read(project(video=(prop("delta_t", 50.0),), control=())).tracks[0].t, [0, 0.05, 0.1])


@pytest.mark.parametrize("times", [(0, 20), (0, 20, 20), (0, "NaN", 40), (0, 1e300, 2e300)])
def test_frame_times_that_lack_frames_or_do_not_rise_are_not_used(times):
    read_back = read(project(video=start_times(*times)))
    assert np.allclose(read_back.tracks[0].t, [0, 0.02, 0.04])
    assert read_back.notes == ("The film's times lack frames or do not rise, so that its frames are taken at equal steps.",)


def test_an_archive_with_a_project():
    raw = archive(
        {"videos/clip.mp4": b"film", "html/info.html": b"text", "trial.TRK": project(), "__MACOSX/._trial.trk": b"shadow"}
    )
    assert read(raw).tracks[0].x.tolist() == [0, 1, 2]


def test_a_document_type_is_no_obstacle():
    raw = project(head='<?xml version="1.0" encoding="UTF-8"?><!DOCTYPE object SYSTEM "osp10.dtd">')
    assert read(raw).tracks[0].x.tolist() == [0, 1, 2]


BOMB = '<!DOCTYPE a [<!ENTITY b "bbbb"><!ENTITY c "&b;&b;&b;">]>'
TAB = prop("[0]", "/home/a.trk", "string") + prop("[1]", "a.trk", "string")
TABSET = obj(f"{TRACKER}.TFrame", prop("tabs", prop("[0]", TAB, "array"), "array")).encode()
ENCRYPTED = bytearray(archive({"a.trk": project()}))
ENCRYPTED[ENCRYPTED.index(b"PK\x01\x02") + 8] |= 1


@pytest.mark.parametrize(
    ("raw", "message"),
    [
        (b"<svg/>", "found 0 projects of Tracker in the XML, needed one project"),
        (b"<a>" + project(head="") + project(head="") + b"</a>", "found 2 projects of Tracker in the XML, needed one project"),
        (TABSET, "found 0 projects of Tracker in the XML, needed one project"),
        (project()[:-40], "found damaged XML (no element found: line 1, column "),
        (b'<?xml version="1.0" encoding="klingon"?><a/>', "found damaged XML (unknown encoding"),
        (project(head=BOMB), "found damaged XML (EntitiesForbidden"),
        (project(head='<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]>'), "found damaged XML (EntitiesForbidden"),
        (archive({"a.txt": b""}), "found 0 .trk files, needed a .trz with one .trk; give"),
        (
            archive({"a.trk": project(), "b.trk": project()}),
            "found 2 .trk files ('a.trk', 'b.trk'), needed a .trz with one .trk; give"),
        (archive({"a.trk": project()}, zipfile.ZIP_BZIP2), "found an archive that cannot be unpacked, needed a .trz"),
        (archive({"a.trk": project()})[:-60], "found an archive that cannot be unpacked, needed a .trz"),
        (bytes(ENCRYPTED), "found an archive that cannot be unpacked, needed a .trz"),
        (archive({"a.trk": b"\0" * (21 * 1024**2)}), "found a project of more than 20 MiB"),
        (b" " * (20 * 1024**2 + 1), "found a project of more than 20 MiB"),
        (b"<a/>" * 1_000_001, "found a project of more than 20 MiB or 1000000 tags"),
        (project([]), "found no point mass with points, needed one"),
        (project([track("v", kind="Vector")]), "found no point mass with points but 'v' (Vector), needed one"),
        (project(clip=clip(start=50)), "found no point mass with points but 'A' (no points in the clip), needed one"),
        (project([track(marks={999_999_999: (1, 1)})]), "found no point mass with points but 'A' (no points in the clip)"),
        (project([track(), track()]), "found two tracks named 'A', needed different names"),
        (project([track(marks={3: ("left", 1)})]), "x: found 'left', needed a plausible number"),
        (project([track(marks={3: ("", 1)})]), "x: found '', needed a plausible number"),
        (project(coords={0: axes(scale=(10, 0))}), "found a scale of 0 pixels per unit"),
        (project(coords={0: axes(scale=("NaN", 10))}), "xscale: found 'NaN', needed a plausible number"),
        (project(coords={0: axes(origin=(1e300, 0))}), "xorigin: found '1e+300', needed a plausible number"),
        (project(coords={0: "null"}), "found no axes, needed origin and scale"),
        (project(control=()), "found a frame duration (delta_t) of 0 ms"),
        (project(video=start_times(0, "soon")), "start_times: found '0,soon', needed numbers"),
        (project().replace(b'name="videoclip"', b'name="other"'), "found no video clip"),
    ],
)  # fmt: skip
def test_faults_are_named_in_one_line(raw, message):
    with pytest.raises(DataError) as raised:
        read(raw)
    text = str(raised.value)
    assert text.startswith(f"trial.trk: {message}")
    assert "\n" not in text
    assert re.search(r"; \w+", text), "no way out is named"


def test_damage_of_any_kind_is_a_data_error():
    random = np.random.default_rng(18)
    sources = [project(video=start_times(0, 20, 40), clip=clip()), archive({"a.trk": project()})]
    for _ in range(300):
        for source in sources:
            damaged = bytearray(source)
            for place in random.integers(len(damaged), size=random.integers(1, 4)):
                damaged[place] = random.integers(256)
            with contextlib.suppress(DataError):
                read(bytes(damaged))
