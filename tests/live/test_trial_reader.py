"""Files of tracked points on the live page: the oracle is the reader of `identify`, on good, bad and damaged files alike."""

import base64
import itertools
import re
from pathlib import Path

import numpy as np
import pytest

from looping_pendulum.live.write import live_settings
from looping_pendulum.measured import study_io
from looping_pendulum.measured.readers import DataError, read
from looping_pendulum.teaching.example_folder import write_example
from tests.apparatus import TEN_TO_ONE
from tests.discrepancy import test_tracker_project as tracker
from tests.discrepancy.real_data import real
from tests.discrepancy.test_clock import motion
from tests.discrepancy.test_forms import CLICKED, PIXEL
from tests.discrepancy.test_readers import BAD, FORMS, LIGHT

FILE = "clip.csv"
ROUNDING = 1e-12
DAMAGED = 300
CLOCKS = 80
SEED = 20261123
PATTERNS = ("10", "100", "1000", "10010", "110")
"""Which rows of a film show a new picture, of a camera that is slower than the film."""
NOT_ON_THE_PAGE = re.compile("event|kind")
"""Cases of tables of events, which the page sends to `identify`, and of the kind of a file, which the page does not ask for."""
UNIT_DETAIL = re.compile(r" \('?[^()]*'? is no [^()]*\)")
"""What pint says of a unit that is none."""


@pytest.fixture
def both(node, tmp_path, monkeypatch):
    """Read contents with options by the reader of `identify` and by the page's: pairs of what each read or said."""
    monkeypatch.chdir(tmp_path)

    def outcomes(contents):
        texts = [(c if isinstance(c, bytes) else c.encode(), options) for c, options in contents]
        files = [{"file": FILE, "bytes": base64.b64encode(raw).decode(), "options": options} for raw, options in texts]
        return zip([by_identify(raw, options) for raw, options in texts], node("read_trials.mjs", files), strict=True)

    return outcomes


def by_identify(raw, options):
    Path(FILE).write_bytes(raw)
    try:
        observations = read(FILE, **options)
    except DataError as error:
        return {"message": UNIT_DETAIL.sub("", str(error))}
    return {
        "channels": [{"name": c.name, "t": c.t, "value": c.value} for c in observations.channels],
        "unused": {u.reason: u.count for u in observations.unused},
        "assumptions": list(observations.assumptions),
        "faults": list(observations.faults),
    }


def assert_same(expected, found):
    assert found.get("message") == expected.get("message")
    if "message" in expected:
        return
    assert [c["name"] for c in found["channels"]] == [c["name"] for c in expected["channels"]]
    for mine, theirs in zip(found["channels"], expected["channels"], strict=True):
        assert mine["t"] == pytest.approx(theirs["t"], rel=ROUNDING, abs=ROUNDING)
        assert mine["value"] == pytest.approx(theirs["value"], rel=ROUNDING, abs=ROUNDING)
    for part in ("unused", "assumptions", "faults"):
        assert found[part] == expected[part]


def test_every_form_gives_what_identify_reads(both):
    for expected, found in both(FORMS.values()):
        assert "message" not in expected
        assert_same(expected, found)


def test_a_bad_file_gives_the_message_of_identify(both):
    cases = [(text, dict(*options)) for name, (text, _, *options) in BAD.items() if not NOT_ON_THE_PAGE.search(name)]
    assert len(cases) > 25
    for expected, found in both(cases):
        assert "message" in expected
        assert_same(expected, found)


def test_a_table_of_events_is_sent_to_identify(both):
    [(_, found)] = both([("quantity,index,value,sigma,unit\nstop,1,1,1,s\n", {})])
    assert found["message"] == (
        f"{FILE}: found a table of events, needed tracked points; looping-pendulum identify reads such tables"
    )


@pytest.mark.long
def test_the_forms_of_trackers_and_phones(both):
    """Each file as its study declares it, and with the tracks and the size of a pixel that the files of some forms need."""
    folder = real("forms/README.md").parent
    cases = []
    for file in sorted(folder.glob("**/study.yaml")):
        for trial in study_io.load(file).trials:
            said = {"units": dict(trial.units), "frame_rate": trial.frame_rate, "clip_rate": trial.clip_rate, "run": trial.run}
            for path, tracks in trial.files:
                raw = (file.parent / path).read_bytes()
                objects = {"light": "0", "heavy": "1"}
                cases += [(raw, said | {"tracks": named}) for named in (dict(tracks), {}, CLICKED, objects)]
                cases.append((raw, said | {"tracks": objects, "units": PIXEL}))
    cases.append(((folder / "22-atwood-accelerations" / "atwood.csv").read_bytes(), {}))
    assert len(cases) > 150
    outcomes = list(both(cases))
    assert sum("message" not in expected for expected, _ in outcomes) > 50
    for expected, found in outcomes:
        assert_same(expected, found)


@pytest.mark.parametrize(
    ("file", "options"),
    [
        ("falling_balls/baseball.csv", [{}, {"run": "1"}, {"run": "2"}, {"run": "3"}]),
        ("pendulum/free_decay_65cm.txt", [{}]),
        ("pendulum_project/q4b_data1.txt", [{}, {"tracks": {"light": ""}}]),
        ("pendulum_project/pendulum_length1.trk", [{}, {"tracks": LIGHT}, {"tracks": LIGHT, "frame_rate": 60.0}]),
    ],
)  # fmt: skip
def test_other_real_files(both, file, options):
    raw = real(file).read_bytes()
    for expected, found in both((raw, said) for said in options):
        assert_same(expected, found)


@pytest.mark.long
def test_a_clock_with_faults_is_put_right_or_named_alike(both):
    rng = np.random.default_rng(SEED)
    outcomes = list(both([faulty_clock(rng, i) for i in range(CLOCKS)]))
    said = " ".join(words for expected, _ in outcomes for words in (*expected["assumptions"], *expected["faults"]))
    for sentence in (
        "put back on", "is an error of each time", "as in equal ones", "is stored 3 times", "rows show", "were put to",
        "was taken as 0", "pictures are lost", "stored again there", "frames in turn last",
    ):  # fmt: skip
        assert sentence in said
    for expected, found in outcomes:
        assert_same(expected, found)


ROWS = np.arange(240)
FILMS = {
    "a lost picture at 480 a second": (480, np.arange(480) + (np.arange(480) >= 200), "as where pictures are lost"),
    "three lost pictures": (240, ROWS + 3 * (ROWS >= 150), "(at the first place 3)"),
    "lost pictures in four places": (
        120,
        ROWS + 2 * np.searchsorted([50, 100, 150, 200], ROWS, "right"),
        " s and 1 more on the",
    ),
    "a picture that is stored again": (240, ROWS - (ROWS >= 150), "stored again there"),
    "a picture that is stored instead of the next one": (240, ROWS - (ROWS == 150), "a tracker slips: left out"),
    "the same at 20 a second": (20, ROWS[:40] - (ROWS[:40] == 25), "a tracker slips: left out"),
    "every picture four times": (240, ROWS // 4 * 4, "every picture is stored 4 times"),
    "24 pictures a second in a film of 60": (60, ROWS * 24 // 60 * 2.5, "5 rows show 2 pictures"),
    "frames in turn": (240, ROWS + np.where(ROWS % 2, 0.2, -0.2), "frames in turn last"),
    "uneven frames": (60, ROWS + np.random.default_rng(SEED).uniform(-0.4, 0.4, 240), "pictures were taken unevenly"),
    "a part in slow motion": (240, np.minimum(ROWS, 120 + (ROWS - 120) / 4), "a row lasts 1/4 as long"),
    "a part that is faster": (120, np.maximum(ROWS, 120 + (ROWS - 120) * 2), "a row lasts 2 times as long"),
    "right times": (240, ROWS, ""),
}
"""Name -> rows a second, number of the picture that each row shows, and a part of what is said."""


@pytest.mark.long
@pytest.mark.parametrize("has_gaps", [False, True])
def test_films_whose_rows_are_displaced_are_judged_alike(both, has_gaps):
    """With gaps, rows are missing, and in others the heavy mass."""
    rng = np.random.default_rng(SEED)
    cases = []
    for rate, taken, _ in FILMS.values():
        values = motion(taken / len(taken)) + 3e-4 * rng.standard_normal((len(taken), 4))
        lines = [[f"{row / rate:.6f}", *(f"{v:.6f}" for v in points)] for row, points in enumerate(values)]
        if has_gaps:
            lines = [[*line[:3], "", ""] if rng.random() < 0.2 else line for line in lines if rng.random() > 0.05]
        cases.append(("t,light_x,light_y,heavy_x,heavy_y\n" + "".join(",".join(line) + "\n" for line in lines), {}))
    for (name, (*_, said)), (expected, found) in zip(FILMS.items(), both(cases), strict=True):
        assert has_gaps or said in " ".join((*expected["assumptions"], *expected["faults"])), name
        assert_same(expected, found)


@pytest.mark.long
def test_times_that_were_cut_off_or_have_gaps(both):
    cases = []
    for rate, decimals, gone in itertools.product((30, 50, 90, 240, 1000), (2, 3, 6), ((), (21,), (30, 31, 32))):
        frame = np.delete(np.arange(100), gone)
        values = motion(frame / 100) + 2e-4 * np.random.default_rng(SEED).standard_normal((len(frame), 4))
        unrest = np.random.default_rng(rate).uniform(-0.3, 0.3, len(frame))
        for number in (frame, frame + 7, frame + unrest):
            times = (f"{np.floor(k * 10**decimals / rate + 1e-6) / 10**decimals:.6f}" for k in number)
            rows = "".join(f"{t},{','.join(f'{v:.5f}' for v in row)}\n" for t, row in zip(times, values, strict=True))
            cases.append(("t,light_x,light_y,heavy_x,heavy_y\n" + rows, {"frame_rate": float(rate)} if decimals == 3 else {}))
    outcomes = list(both(cases))
    assert sum("message" not in expected for expected, _ in outcomes) > 100
    for expected, found in outcomes:
        assert_same(expected, found)


def faulty_clock(rng, kind):
    """Return a table of a made-up motion with a fault of its clock, one of ten kinds in turn, and what is said of it."""
    rate = float(rng.choice([24, 30, 60, 120, 240, 480]))
    count = int(rng.integers(60, 240))
    picture = np.arange(count)
    taken = picture.copy().astype(float)
    shown = picture / rate
    decimals, noise = 6, float(rng.choice([1e-5, 2e-4, 1e-3]))
    match kind % 10:
        case 0 | 1:  # rounded times, as coarse as they may be
            decimals = int(rng.integers(2, 5))
        case 2:  # rows are missing
            decimals = int(rng.integers(3, 7))
        case 3 | 4:  # pictures are stored again
            pattern = [int(sign) for sign in rng.choice(PATTERNS)] if kind % 20 < 10 else [1, 0, 0]
            # Not on round times, of which every third or fourth is as even by the file as by the rows
            shown = shown * 1.0012345
            picture = np.maximum.accumulate(np.where(np.resize(pattern, count), picture, 0))
        case 5:  # a program wrote times of its own
            shown = shown + rng.uniform(-0.2, 0.2, count) / rate
        case 6:  # frames were uneven, and the times have it
            taken = taken + rng.uniform(-0.3, 0.3, count)
            shown, decimals = taken / rate, 4
        case 7:  # uneven in turn, and the times have it not
            taken = taken + np.where(picture % 2, 0.2, -0.2)
        case 8:  # one picture is lost
            taken = taken + (picture >= count // 2)
        case 9:  # one picture is stored again
            picture = picture - (picture >= count // 2)
    values = motion(taken / count)[picture] + noise * rng.standard_normal((count, 4))
    if kind % 10 in (3, 4):
        values = values[picture]
    if kind % 10 == 9:
        values[count // 2] = values[count // 2 - 1]
    start = float(rng.choice([0, 0, 0.357, 5.4]))
    kept = np.flatnonzero(rng.random(count) > 0.1) if kind % 10 == 2 else np.arange(count)
    rows = (",".join([f"{shown[i] + start:.{decimals}f}", *(f"{v:.5f}" for v in values[i])]) for i in kept)
    options = [{}, {}, {"frame_rate": rate}, {"frame_rate": 4 * rate}, {"frame_rate": 4 * rate, "clip_rate": 30.0}]
    return "t,light_x,light_y,heavy_x,heavy_y\n" + "\n".join(rows) + "\n", options[int(rng.integers(len(options)))]


def test_projects_of_tracker(both):
    tracks = [tracker.track("light"), tracker.track("heavy", {0: (1, 2), 1: ("NaN", "NaN"), 3: (4, 5)})]
    kinds = [tracker.track("V", kind="Vector"), tracker.track("C", kind="CenterOfMass"), tracker.track("E", marks={})]
    project, prop, axes = tracker.project, tracker.prop, tracker.axes
    projects = [
        project(),
        project(tracks=[*tracks, *kinds]),
        project(tracks=kinds),
        project(tracks=[]),
        project(tracks=[tracker.track("A &amp; <![CDATA[<B>]]>")], head='<?xml version="1.0"?><!-- <object> -->'),
        project(more=(prop("length_unit", "cm", "string"), prop("referenceframe", "mass A", "string"))),
        project(more=(prop("length_unit", "parsec", "string"),)),
        project(coords={0: axes(scale=(1, 1))}),
        project(coords={0: axes(angle=30.0), 2: axes(origin=(1, 2), scale=(10, 20))}),
        project(clip=tracker.clip(start=1, step=2, count=1, start_time=-500.0)),
        project(video=tracker.start_times(0, 33.3), control=()),
        project(video=tracker.start_times(0, 33.3, 66.7, 100)),
        project(video=tracker.start_times(0, 0, 66.7)),
    ]
    said = [{}, {"tracks": {"light": ""}}, {"tracks": {"light": "light"}}, {"tracks": {"light": ""}, "frame_rate": 100.0}]
    said.append({"tracks": {"light": ""}, "units": {"length": "1.4 mm"}})
    outcomes = list(both((raw, options) for raw in projects for options in said))
    assert 15 < sum("message" not in expected for expected, _ in outcomes) < 50
    for expected, found in outcomes:
        assert_same(expected, found)


@pytest.mark.parametrize(
    ("raw", "message"),
    [
        (tracker.archive({"trial.trk": tracker.project()}),
         "found an archive of Tracker (.trz), which this page cannot read, needed the .trk in it; unpack it, or let "
         "looping-pendulum identify read it"),
        (tracker.archive({"sheet.xml": b""}),
         "found a zip archive (a spreadsheet?), needed a text table; export it as text (in Tracker: File > Export > Data)"),
        *((damaged, "found a damaged project of Tracker, or none, needed one with axes and a film clip; save it again in "
           "Tracker, or see what looping-pendulum look says of it")
          for damaged in (tracker.project()[:-30], tracker.project(control=()), tracker.project(tracks=[tracker.track()] * 2),
                          tracker.project(coords={0: tracker.axes(scale=(0, 1))}))),
    ],
)  # fmt: skip
def test_what_the_page_does_not_read_of_projects(node, raw, message):
    [found] = node("read_trials.mjs", [{"file": FILE, "bytes": base64.b64encode(raw).decode(), "options": {}}])
    assert found == {"message": f"{FILE}: {message}"}


def test_the_pages_study_names_the_run_and_has_the_files_own_clock(node):
    camera = {"origin_x": 0.0, "origin_y": 0.0, "clock_offset": -0.05}
    said = {"tracks": {}, "length": "1.4 mm", "time": "s", "rate": None, "run": "2", "mirrored": False, "start": 5.4}
    trial = {"file": FILE, "camera": camera, "known": {}, **said}
    [written] = node("write_studies.mjs", [{"settings": live_settings(TEN_TO_ONE), "trial": trial}])
    [read_back] = study_io.load_text(written, FILE).trials
    assert (read_back.run, dict(read_back.units)["length"]) == ("2", "1.4 mm")
    # 50 ms before the release, the page's clock is 0 and the file's 5.4 s
    assert read_back.camera["clock_offset"].value == pytest.approx(-5.45)


@pytest.mark.long
def test_damaged_files_are_read_or_refused_alike(both, tmp_path):
    rng = np.random.default_rng(SEED)
    [path] = [p for p in write_example(tmp_path / "example") if p.name == "first.csv"]
    whole = path.read_text(encoding="utf-8").splitlines(keepends=True)[:30]
    outcomes = list(both([("".join(damaged(rng, whole)), {}) for _ in range(DAMAGED)]))
    refused = sum("message" in expected for expected, _ in outcomes)
    assert 0.2 < refused / DAMAGED < 0.9
    for expected, found in outcomes:
        assert_same(expected, found)


def damaged(rng, lines):
    """Return lines with one to three faults as people and programs make them."""
    lines = list(lines)
    for _ in range(rng.integers(1, 4)):
        i = int(rng.integers(len(lines)))
        line = lines[i]
        place = int(rng.integers(max(len(line), 1)))
        faults = [
            lambda line=line, place=place: line[:place] + line[place + 1 :],
            lambda line=line, place=place: line[:place] + str(rng.choice(list(';,\t x-.9E"#'))) + line[place:],
            lambda line=line: line.replace(".", ","),
            lambda line=line: line.replace(",", ";"),
            lambda line=line: line * 2,
            lambda: "",
        ]
        lines[i] = faults[int(rng.choice(len(faults), p=[0.3, 0.4, 0.05, 0.05, 0.1, 0.1]))]()
    return lines
