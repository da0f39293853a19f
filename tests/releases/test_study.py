"""A study of releases with a fake installer: rows, errors, pins, moves, resumption and interruption."""

import os
from dataclasses import replace

import pytest
from packaging.version import Version

from looping_pendulum.releases.result import CAPSTAN, QUANTITIES, ReleaseRow, ReleasesResult, Spread, VariantRow, find_moves
from looping_pendulum.releases.study import PINS, ReleaseStudy
from looping_pendulum.scenarios import load
from tests.releases.released import FakeInstaller, ReleasedEngine

pytestmark = pytest.mark.skipif(os.name == "nt", reason="the fake environments are shell scripts")
LABEL = "released:only"


@pytest.fixture
def no_spread(monkeypatch):
    """Leave out the runs with changed starts, where a test is not about them."""
    monkeypatch.setattr("looping_pendulum.releases.study.spread_runs", lambda *_: [])


def study(folder, installer, **options):
    # Long enough for the metric that is judged, RMS to 0.35 s
    return ReleaseStudy(
        [ReleasedEngine()], replace(load("ten_to_one"), duration=0.36), folder, make_environment=installer, **options
    )


def releases(*words):
    return [Version(word) for word in words]


@pytest.mark.long
def test_the_release_that_moved_a_number_is_named_and_failures_are_rows(tmp_path):
    installer = FakeInstaller()
    result = study(tmp_path, installer).run(releases("1.0", "2.0", "2.5", "2.6", "3.0", "3.1"))
    rows = {row.release: row for row in result.releases}
    assert rows["1.0"].error == "released-engine==1.0 has no usable wheels"
    (failed,) = rows["2.0"].variants
    assert (failed.ran, failed.status) == (False, "FAILED")
    assert failed.error == "the engine raised an error: ValueError: no rod in this release"
    # The older NumPy was tried for the one that it helps and for the one that it does not, and is named where it helped
    assert [made[1:] for made in installer.made if made[0].endswith(("==2.0", "==2.5"))].count(PINS[1]) == 2
    assert rows["2.0"].pins == rows["2.5"].pins == ("numpy<2",)
    assert rows["2.6"].pins == ()
    assert rows["2.6"].packages == {"released-engine": "2.6"}
    # Only 3.0 holds the light mass elsewhere, 10 mm aside, where small changes of the start move the number by 0.1 mm
    moved = [(m.release, m.since, m.quantity) for m in result.moves]
    assert ("3.0", "2.6", "rms_0.35s") in moved
    assert {release for release, *_ in moved} == {"3.0"}
    assert result.spread is not None
    assert result.spread.release == "3.1"
    assert 1e-6 < result.spread.values[LABEL]["rms_0.35s"] < 1e-3
    assert all(row.variant(LABEL).cpu_time >= 0 for row in result.releases if row.ran)
    assert not list((tmp_path / "environments").iterdir()), "each environment is removed once its runs have ended"
    assert ReleasesResult.from_json(result.to_json()) == result


@pytest.mark.long
def test_ended_releases_are_not_run_again_and_others_are(tmp_path, no_spread):
    first = FakeInstaller()
    study(tmp_path, first).run(releases("1.0", "2.6"))
    again = FakeInstaller()
    result = study(tmp_path, again).run(releases("1.0", "2.6", "3.0"))
    # One that could not be installed may have lacked a network only; the spread is that of another newest release
    assert sorted(made[0] for made in again.made) == [f"released-engine=={v}" for v in ("1.0", "3.0", "3.0")]
    assert [row.release for row in result.releases] == ["1.0", "2.6", "3.0"]
    assert {m.release for m in result.moves} == {"3.0"}
    third = FakeInstaller()
    assert study(tmp_path, third).run(releases("2.6", "3.0")).moves == result.moves
    assert third.made == []


@pytest.mark.long
def test_a_damaged_file_and_one_of_other_settings_are_made_again(tmp_path, no_spread):
    study(tmp_path, FakeInstaller()).run(releases("2.6"))
    (file,) = (tmp_path / "releases").iterdir()
    kept = file.read_text()
    file.write_text(kept[: len(kept) // 2])
    installer = FakeInstaller()
    study(tmp_path, installer).run(releases("2.6"))
    assert [made[0] for made in installer.made] == ["released-engine==2.6"]
    study(tmp_path, installer).run(releases("2.6"))
    assert len(installer.made) == 1, "the file was mended"
    file.write_text(kept.replace('"task": "', '"task": "x'))
    study(tmp_path, installer).run(releases("2.6"))
    assert len(installer.made) == 2


@pytest.mark.long
def test_an_interrupt_keeps_what_has_ended(tmp_path, no_spread):
    interrupts = 0

    def interrupt_after_the_first(_, share):
        nonlocal interrupts
        if share > 0 and not interrupts and (tmp_path / "releases").exists():
            interrupts += 1
            raise KeyboardInterrupt

    installer = FakeInstaller()
    wanted = releases("2.6", "2.7", "2.8", "3.0")
    result = study(tmp_path, installer, jobs=1, progress=interrupt_after_the_first).run(wanted)
    assert interrupts == 1
    assert result.interrupted
    assert result.spread is None
    assert 1 <= len(result.releases) < len(wanted)
    assert len(list((tmp_path / "releases").iterdir())) == len(result.releases)
    assert not list((tmp_path / "environments").iterdir())
    made = len(installer.made)
    complete = study(tmp_path, installer).run(wanted)
    assert [row.release for row in complete.releases] == ["2.6", "2.7", "2.8", "3.0"]
    # Those that had ended were not made again; one environment more is for the spread
    assert len(installer.made) - made == len(wanted) - len(result.releases) + 1


def row(release, status="FINISHED", **values):
    variant = VariantRow(label=LABEL, status=status, ok=True, values=dict.fromkeys(QUANTITIES) | values)
    return ReleaseRow(release=release, packages={}, variants=(variant,))


def test_a_move_is_larger_than_the_spread_or_makes_a_value_appear():
    rows = [
        row("1", halting_time_error=1e-3),
        row("2", halting_time_error=1.9e-3),  # within the spread of 1 ms
        row("3", "CRASHED"),  # nothing to compare with
        row("4", halting_time_error=3e-3),  # 1.1 ms after release 2
        row("5"),
        row("6", halting_time_error=3e-3, static_capstan_error=0.1),
    ]
    spread = Spread(release="6", values={LABEL: {"halting_time_error": 1e-3}})
    found = [(m.release, m.since, m.quantity, m.spreads) for m in find_moves(rows, spread)]
    assert found == [
        ("4", "2", "halting_time_error", pytest.approx(1.1)),
        ("5", "4", "halting_time_error", None),
        ("6", "5", "halting_time_error", None),
        ("6", "5", CAPSTAN.name, None),
    ]


def test_changes_below_a_micron_are_not_named_whatever_the_spread():
    rows = [row("1", drop_error=1e-3), row("2", drop_error=1e-3 + 0.9e-6), row("3", drop_error=1e-3 + 2e-6)]
    spread = Spread(release="3", values={LABEL: {"drop_error": 1e-12}})
    assert [m.release for m in find_moves(rows, spread)] == ["3"]
