"""Plain tables on the live page: the oracle is the reader of `identify`; others are refused, with a way to such a table."""

import base64
from pathlib import Path

import numpy as np
import pytest

from looping_pendulum.live.write import live_settings
from looping_pendulum.measured import study_io
from looping_pendulum.measured.edits import without_copies
from looping_pendulum.measured.observations import ReadingNotes
from looping_pendulum.measured.tables.plain_table import plain_table
from looping_pendulum.measured.tables.readers import DataError, read
from looping_pendulum.teaching.example_folder import write_example
from tests.apparatus import TEN_TO_ONE
from tests.discrepancy.real_data import real
from tests.measured.tables import test_tracker_project as tracker
from tests.measured.tables.test_readers import BAD, FORMS, LIGHT
from tests.measured.test_clock import motion

FILE = "clip.csv"
WAY_OUT = f"this page reads plain tables only: use looping-pendulum look '{FILE}' --write plain.csv, which writes a plain table"
ROUNDING = 1e-12
DAMAGED = 300
SEED = 20261123
PLAIN = (
    "tracker", "multi with one track", "tabs", "semicolons", "semicolons, decimal comma",
    "byte order mark", "utf-16", "CRLF", "tracks named by numbers", "named as the mass",
    "tidy", "tidy, units in brackets", "time in the last column",
)  # fmt: skip
"""The forms of test_readers that are plain tables."""


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
        return read(FILE, **options).channels
    except DataError:
        return None


def assert_same(expected, found):
    assert "message" not in found, found
    assert [c["name"] for c in found["channels"]] == [c.name for c in expected]
    for mine, theirs in zip(found["channels"], expected, strict=True):
        assert mine["t"] == pytest.approx(theirs.t, rel=ROUNDING, abs=ROUNDING)
        assert mine["value"] == pytest.approx(theirs.value, rel=ROUNDING, abs=ROUNDING)


def is_refused(found):
    """Return whether a file was refused in one line, with the way to a plain table or the field of the page that helps."""
    message = found.get("message", "")
    assert "\n" not in message
    return bool(message) and (message.endswith(WAY_OUT) or found["field"].startswith("trial-"))


def test_plain_tables_are_read_and_of_other_forms_none_is_read_wrongly(both):
    # The page has no field for runs and clip rates
    forms = {name: form for name, form in FORMS.items() if not {"run", "clip_rate"} & form[1].keys()}
    for form, (expected, found) in zip(forms, both(forms.values()), strict=True):
        if form in PLAIN or not is_refused(found):
            assert_same(expected, found)


def test_columns_of_errors_are_read_as_those_of_their_values(both):
    head = "t [s],light_x [cm],light_y [cm],light_x_error [mm],light_y_error [mm],flag\n"
    rows = "0.00,-58.0,1.0,0.5,0.25,\n0.01,-57.9,0.9,,0.5,light streak\n0.02,-57.5,0.5,2,0.25,\n"
    text = head + rows
    [(expected, found)] = both([(text, {})])
    assert_same(expected, found)
    assert [c["error"] for c in found["channels"]] == [pytest.approx([5e-4, 0, 2e-3]), pytest.approx([2.5e-4, 5e-4, 2.5e-4])]
    for mine, theirs in zip(found["channels"], expected, strict=True):
        assert theirs.stated_error[0] == pytest.approx(theirs.t)
        assert mine["error"] == pytest.approx(theirs.stated_error[1])
    [(refused, found)] = both([(text.replace("0.5,light", "-0.5,light"), {})])
    assert refused is None
    assert found["message"].startswith(f"{FILE}:3: column 'light_y_error': found '-0.5', needed a standard error, 0 or more")


def test_points_of_a_mass_at_rest_that_are_copies_are_left_out(both):
    """Trackers write a mass at rest so; each copy counted as a measurement of its own, and the fit missed something."""
    t = np.arange(90) / 120
    points = motion(t) + 2e-4 * np.random.default_rng(1).standard_normal((len(t), 4))
    points[50:, 2:] = points[50, 2:]
    rows = "".join(",".join(f"{x:.6f}" for x in (time, *row)) + "\n" for time, row in zip(t, points, strict=True))
    [(expected, found)] = both([("t,light_x,light_y,heavy_x,heavy_y\n" + rows, {})])
    kept = without_copies(expected, ReadingNotes())
    assert [len(c) for c in kept] == [90, 90, 51, 51]
    assert_same(kept, found)


def test_the_only_track_is_that_of_the_chosen_mass(both):
    for expected, found in both(
        [("t\tx\ty\n0\t1,2\t2,1\n0,01\t-1,4\t0,5\n", {"tracks": {mass: ""}}) for mass in ("light", "heavy")]
    ):
        assert_same(expected, found)


def test_a_bad_file_is_refused_with_the_way_to_a_plain_table(both):
    # The page offers the two masses that there are, and no runs
    bad = {name: case for name, case in BAD.items() if name != "no such mass" and "run" not in dict(*case[2:])}
    cases = [(text, dict(*options)) for text, _, *options in bad.values()]
    for name, (_, found) in zip(bad, both(cases), strict=True):
        assert is_refused(found), name


def test_what_look_writes_of_any_form_is_read(node, both):
    plain = []
    for content, options in FORMS.values():
        Path(FILE).write_bytes(content if isinstance(content, bytes) else content.encode())
        plain.append((plain_table(read(FILE, **options)), {}))
    outcomes = list(both(plain))
    assert len(outcomes) > 40
    for expected, found in outcomes:
        assert_same(expected, found)


@pytest.mark.parametrize("file", ["pendulum_project/pendulum_length1.trk", "pendulum/free_decay_65cm.txt"])
def test_real_files_of_other_forms_are_refused(both, file):
    [(_, found)] = both([(real(file).read_bytes(), {})])
    assert found["message"].endswith(WAY_OUT)


def test_projects_and_archives_are_refused(both):
    archive = tracker.archive({"trial.trk": tracker.project()})
    for _, found in both([(tracker.project(), {"tracks": LIGHT}), (archive, {}), (b"%PDF-1.4\n%\xe2\xe3", {}), (b"", {})]):
        assert found["message"].endswith(WAY_OUT)


def test_trackers_export_with_a_clock_that_began_before_the_release_and_in_slow_motion(both):
    t, points = np.arange(60) / 50 + 5.4, motion(np.linspace(0, 1, 60))
    points = points + 2e-4 * np.random.default_rng(SEED).standard_normal(points.shape)
    export = ",ball,,,bob,,\nt,x,y,t,x,y,\n" + "".join(
        f"{time:.9f},{row[0]:.9f},{row[1]:.9f},{time:.9f},{row[2]:.9f},{row[3]:.9f},\n"
        for time, row in zip(t, points, strict=True)
    )
    named = {"tracks": {"light": "ball", "heavy": "bob"}}
    outcomes = list(both([(export, named), (export, named | {"frame_rate": 200.0})]))
    for expected, found in outcomes:
        assert_same(expected, found)
    assert outcomes[0][1]["start"] == pytest.approx(5.4)


def test_a_value_that_is_too_large_and_a_track_without_a_mass_point_to_their_field(both):
    slow = "t,light_x,light_y\n" + "".join(f"{i},.5,-.2\n" for i in range(9))
    cases = [("t,light_x,light_y\n0,55,-20\n.01,56,-21\n", {}), (slow, {}), ("t,A_x,A_y\n0,.5,-.2\n.01,.5,-.2\n", {})]
    [(_, large), (_, rare), (_, nameless)] = both(cases)
    assert rare == {
        "message": f"{FILE}: found a row every 1 s, needed many a second; choose another unit of time",
        "field": "trial-clock",
    }
    assert large == {
        "message": f"{FILE}: found light_x = 55 m, needed at most 20 m; choose another unit",
        "field": "trial-length",
    }
    assert nameless == {
        "message": f"{FILE}: found 'A', needed to know which mass each track is; choose them",
        "field": "trial-light",
    }


def test_the_pages_study_has_the_files_own_clock(node):
    camera = {"origin_x": 0.0, "origin_y": 0.0, "clock_offset": -0.05}
    said = {"tracks": {}, "length": "cm", "time": "s", "rate": None, "mirrored": False, "start": 5.4}
    trial = {"file": FILE, "camera": camera, "known": {}, **said}
    [written] = node("write_studies.mjs", [{"settings": live_settings(TEN_TO_ONE), "trial": trial}])
    [read_back] = study_io.load_text(written, FILE).trials
    assert dict(read_back.units)["length"] == "cm"
    # 50 ms before the release, the page's clock is 0 and the file's 5.4 s
    assert read_back.camera["clock_offset"].value == pytest.approx(-5.45)


@pytest.mark.long
def test_damaged_files_are_read_alike_or_refused(both, tmp_path):
    rng = np.random.default_rng(SEED)
    [path] = [p for p in write_example(tmp_path / "example") if p.name == "first.csv"]
    whole = path.read_text(encoding="utf-8").splitlines(keepends=True)[:30]
    outcomes = list(both([("".join(damaged(rng, whole)), {}) for _ in range(DAMAGED)]))
    refused = 0
    for expected, found in outcomes:
        if is_refused(found):
            refused += 1
        elif expected is not None:
            assert_same(expected, found)
    assert 0.2 < refused / DAMAGED < 0.9


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
