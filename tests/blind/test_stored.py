"""The stored output of the simulator equals what the simulator makes."""

import re
import zipfile
from pathlib import Path

import pytest

from tests.blind.cases import CASES, simulate_case
from tests.blind.stored import DATA, DIGEST, TABLES, TRACKS, archive_name, digest, stored_or_written
from tests.discrepancy.event_study import simulate_tables

WAY_OUT = "; run `python -m tests.blind.stored`"
NUMBER = re.compile(r"-?\d+\.?\d*(?:e[+-]?\d+)?")


def names():
    return {archive_name("tracks", *film) for film in TRACKS} | {archive_name("tables", *table) for table in TABLES}


def test_all_archives_are_there_and_of_the_present_sources():
    assert {path.stem for path in DATA.glob("*.zip")} == names(), WAY_OUT
    for path in sorted(DATA.glob("*.zip")):
        with zipfile.ZipFile(path) as files:
            assert files.read(DIGEST).decode() == digest(), f"{path.name} is of older sources{WAY_OUT}"


def test_an_old_or_missing_archive_is_simulated_again(tmp_path, monkeypatch):
    def write(folder: Path) -> None:
        (folder / "known.json").write_text("{}")

    stored_or_written("tracks-nothing-0", tmp_path / "missing", write)
    monkeypatch.setattr("tests.blind.stored.digest", lambda: "of other sources")
    stored_or_written("tracks-clean-0", tmp_path / "old", write)
    for folder in ("missing", "old"):
        assert [path.name for path in (tmp_path / folder).iterdir()] == ["known.json"]


def assert_stored_equals_simulated(name, tmp_path, simulate):
    stored_or_written(name, tmp_path / "stored", lambda to: pytest.fail(f"{name} is not stored{WAY_OUT}"))
    (tmp_path / "simulated").mkdir()
    simulate(tmp_path / "simulated")
    stored, simulated = (
        {path.name: path.read_text() for path in (tmp_path / which).iterdir()} for which in ("stored", "simulated")
    )
    assert stored.keys() == simulated.keys()
    for file, text in simulated.items():
        assert NUMBER.sub("#", stored[file]) == NUMBER.sub("#", text)
        # another processor rounds otherwise; the last printed digit of a coordinate is 1e-6 of it
        assert [float(n) for n in NUMBER.findall(stored[file])] == pytest.approx(
            [float(n) for n in NUMBER.findall(text)], rel=1e-5, abs=1e-6
        )


@pytest.mark.parametrize(
    ("name", "seed", "trials"), [pytest.param(*case, marks=[pytest.mark.accurate] * (len(case[2]) > 2)) for case in TABLES]
)
def test_stored_tables_equal_simulated_ones(tmp_path, name, seed, trials):
    assert_stored_equals_simulated(
        archive_name("tables", name, seed, trials), tmp_path, lambda to: simulate_tables(to, CASES[name], seed, trials)
    )


@pytest.mark.accurate
@pytest.mark.parametrize(("name", "seed"), TRACKS)
def test_stored_films_equal_simulated_ones(tmp_path, name, seed):
    assert_stored_equals_simulated(
        archive_name("tracks", name, seed), tmp_path, lambda to: simulate_case(to, CASES[name], seed)
    )
