"""One study in the forms in which trackers, spreadsheets and phones deliver points: each gives what the table of forms asks.

The oracle is the form whose times have all digits, `10-time-in-the-last-column`; all were made from the same points.
"""

import dataclasses
import re

import numpy as np
import pytest

from looping_pendulum.discrepancy.look.check import take_first_look
from looping_pendulum.measured import study_io
from looping_pendulum.measured.edits import read_trial
from looping_pendulum.measured.study import read_files
from tests.discrepancy.follow_advice import follow_advice, follow_advice_of_look
from tests.discrepancy.real_data import real

CLICKED = {"light": "1", "heavy": "2"}
PIXEL = {"length": "1.52642 mm"}
"""Of the made-up picture with 655.125 pixels a metre."""


def trials(form, file="study.yaml"):
    study = study_io.load(real(f"forms/{form}/{file}"))
    return study, study.trials


def read(form, **changes):
    """Return what is read of both trials of a form, whose declaration is corrected by ``changes``."""
    study, both = trials(form)
    tracks = changes.pop("tracks", None)
    read_trials = []
    for trial in both:
        files = tuple((path, tracks or known) for path, known in trial.files)
        read_trials.append(read_files(study.folder, dataclasses.replace(trial, files=files, **changes)))
    return read_trials


@pytest.mark.parametrize(
    ("form", "changes", "digits", "said"),
    [
        ("01-times-rounded-to-milliseconds", {}, 1e-4, "times printed to 0.001 s, which is coarse: put back on 240 frames"),
        ("03-browser-tracker-objects-1-and-2", {"tracks": {"light": "2", "heavy": "1"}}, 1e-3, "put back on 240 frames"),
        ("04-quoted-cells-and-a-row-of-settings", {}, 1e-5, "setting in the table left out: Frame rate [Hz] = 240.000"),
        ("06-missing-point-shifts-the-row", {"tracks": CLICKED}, 1e-5, "they have fewer cells than there are names"),
        ("07-slashes-in-names-nan-and-milliseconds", {}, 1e-5, "lengths without a unit taken in cm"),
        ("08-names-with-a-run-before-the-colon", {"tracks": CLICKED}, 1e-5, ""),
        ("10-time-in-the-last-column", {}, 1e-5, ""),
        ("15-sep-line-and-quoted-decimal-commas", {}, 1e-5, ""),
        ("18-tracker-project-file", {}, 1e-5, ""),
        ("25-frame-numbers-named-t-rows-lost", {}, 1e-5, "column 't' has whole numbers without a unit: taken as numbers"),
        ("26-pandas-header-of-two-rows", {}, 1e-5, ""),
        ("30-objects-stacked-names-in-comments", {}, 1e-5, ""),
        ("31-unicode-minus", {}, 1e-5, ""),
        ("33-optitrack", {}, 1e-5, ""),
    ],
)  # fmt: skip
def test_a_form_gives_the_points_of_the_example(form, changes, digits, said):
    for exact, found in zip(read("10-time-in-the-last-column"), read(form, **changes), strict=True):
        assert {c.name for c in found.channels} == {c.name for c in exact.channels}
        for channel in found.channels:
            known = exact.channel(channel.name)
            at = np.searchsorted(known.t, channel.t - 1e-3)
            assert len(channel) > 0.8 * len(known)
            assert channel.t == pytest.approx(known.t[at], abs=1e-5)
            assert np.max(np.abs(channel.value - known.value[at])) < 1.1 * digits
        assert said in found.summary()


def test_three_significant_digits():
    """Times far from 0, to 10 ms: they are put back on the 30 frames of which every eighth of the example's is one."""
    for exact, found in zip(read("10-time-in-the-last-column"), read("02-bom-three-significant-digits"), strict=True):
        known = exact.channel("light_y")
        channel = found.channel("light_y")
        at = np.searchsorted(known.t, channel.t - 1e-3)
        assert channel.t == pytest.approx(known.t[at], abs=1e-5)
        assert "times printed to 0.01 s, which is coarse" in found.summary()
        assert "an export with more decimals" in found.summary()
        # Its own rounding is the least error of a value
        assert np.min(channel.least_sigma(np.zeros(len(channel)))) == pytest.approx(1e-3 / np.sqrt(12))


def test_an_object_that_is_lost_to_the_end():
    for exact, found in zip(read("10-time-in-the-last-column"), read("35-lost-object-as-zeros"), strict=True):
        known, channel = exact.channel("light_x"), found.channel("light_x")
        assert channel.value == pytest.approx(known.value[: len(channel)], abs=1e-5)
        assert "61 not used: light_x: the mark of a lost object" in found.summary()


@pytest.mark.parametrize(
    ("form", "digits"),
    [("27-thousands-separators-in-pixels", 1e-3), ("29-sleap-analysis", 2e-5), ("34-deeplabcut", 2e-5)],
)
def test_pixels_of_networks_and_whole_pixels(form, digits):
    """The axes of these pictures point against those of the example."""
    for exact, found in zip(read("10-time-in-the-last-column"), read(form), strict=True):
        for name in ("light_x", "light_y", "heavy_x", "heavy_y"):
            known, channel = exact.channel(name), found.channel(name)
            assert channel.t == pytest.approx(known.t, abs=1e-5)
            assert np.ptp(channel.value + known.value) < digits


@pytest.mark.long
def test_a_long_table_with_pixels():
    for exact, found in zip(
        read("10-time-in-the-last-column"),
        read("11-long-table-with-particle-numbers", tracks={"light": "0", "heavy": "1"}, units=PIXEL),
        strict=True,
    ):
        known, channel = exact.channel("light_x"), found.channel("light_x")
        assert channel.t == pytest.approx(known.t, abs=1e-5)
        assert np.ptp(channel.value - known.value) < 2e-5


@pytest.mark.parametrize("form", ["12-every-third-frame-is-new", "controls/triple"])
def test_pictures_that_are_stored_three_times_are_kept_once(form):
    study, both = trials(form)
    for found in (read_trial(study, trial) for trial in both):
        assert "every picture is stored 3 times: one row of each is kept" in found.summary()
        assert np.diff(found.channels[0].t).min() == pytest.approx(1 / 80, rel=1e-5)


@pytest.mark.long
def test_times_to_milliseconds_of_a_clean_study():
    for exact, found in zip(read("controls/plain"), read("controls/ms"), strict=True):
        assert found.channels[0].t == pytest.approx(exact.channels[0].t, abs=1e-6)


def test_the_rates_of_a_phone_that_swings():
    [found] = read("20-gyroscope-of-a-phone")
    assert [c.name for c in found.channels] == ["angle_rate"]
    assert "rates about 3 axes: taken about the one (1.00" in found.summary()


def files_of_forms():
    forms = real("forms/10-time-in-the-last-column/study.yaml").parents[1]
    others = (".yaml", ".md", ".mp4")
    return sorted(path for path in forms.glob("[0-9]*/*") if path.suffix not in others and path.name != "atwood.csv")


def says_how_to_export(message):
    """Two kinds of damage that no key undoes: times with too few decimals, and numbers turned into dates."""
    return "export them with more decimals" in message or "import the measured table again" in message


@pytest.mark.parametrize("is_declared", [False, True])
def test_advice_that_is_followed_leads_to_points_or_names_the_export(is_declared):
    """'columns without names' and 'write tracks' alternated for ever."""
    for path in files_of_forms():
        options = {}
        if is_declared:
            if not (path.parent / "study.yaml").exists():
                continue
            declared = [t for t in trials(path.parent.name)[1] if path.name in dict(t.files)]
            if not declared:
                continue
            [trial] = declared
            options = {"tracks": dict(trial.files)[path.name], "units": trial.units, "frame_rate": trial.frame_rate}
        observations, said = follow_advice(path, **options)
        assert observations is not None or says_how_to_export(said[-1])


def test_advice_of_look_is_typed_as_it_stands():
    for path in files_of_forms():
        [*_, last] = follow_advice_of_look(path)
        assert f"{path.stem}: used " in last or says_how_to_export(last)


@pytest.mark.long
@pytest.mark.parametrize(
    ("form", "named"),
    [
        (
            "23-clean-smoothed-over-5-frames",
            "averaged over 5 frames, .* needed the points as they were tracked",
        ),
        ("24-both-masses-exchanged-for-20-frames", "exchanged in rows from 0.4167 s to 0.4958 s; needed each mass in its own"),
        ("28-clean-frames-interpolated", "found points that were interpolated: one frame of 4 shows a new picture, "),
    ],
)
def test_points_that_are_not_as_tracked_are_named(form, named):
    """Each was searched: "identified: light_inertia" of the first and the last, a side force of the second."""
    study, all_trials = trials(form)
    check = take_first_look(dataclasses.replace(study, trials=all_trials[:1]))
    assert not check.warnings
    (mistake,) = check.mistakes
    assert re.search(named, mistake.text), mistake.text


@pytest.mark.long
def test_points_as_tracked_are_not_said_to_be_smoothed():
    assert not take_first_look(trials("controls/plain")[0]).mistakes
