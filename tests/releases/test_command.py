"""The command `versions`, and the stored study that docs/ropes-and-releases.md tells."""

import json
import sys
from dataclasses import replace
from importlib.metadata import version

import pytest
from packaging.version import Version

from looping_pendulum.engines.isolation import run_isolated
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.reference import Reference
from looping_pendulum.engines.registry import select
from looping_pendulum.pages.drawing import png
from looping_pendulum.releases import installers, study
from looping_pendulum.releases.figure import figure
from looping_pendulum.releases.installers import ReleaseError, list_releases
from looping_pendulum.releases.result import FILE, ReleasesResult, find_moves
from looping_pendulum.releases.study import metrics_of
from looping_pendulum.scenarios import load
from scripts.versions_page import read_causes, read_stored
from tests.command_line import here

STORED = {result.engine: result for result in read_stored()}
LEAST_RELEASES = {"mujoco": 20, "pymunk": 6, "drake": 4}
"""Engine -> fewest releases that ran in the stored study (issue 17)."""


@pytest.fixture
def releases_of_this_mujoco(monkeypatch):
    """Offer two releases of MuJoCo, both of which are the one that is installed."""
    monkeypatch.setattr(installers, "list_releases", lambda package: (Version("1.0"), Version("2.0")))
    monkeypatch.setattr(study, "install", lambda *_: sys.executable)
    # The runs with changed starts are tested with the study; here they would take half of the time
    monkeypatch.setattr(study, "spread_runs", lambda *_: [])


@pytest.mark.long
def test_the_command_writes_its_files_and_says_that_nothing_moved(releases_of_this_mujoco, tmp_path):
    pytest.importorskip("mujoco")
    done = here("versions", "mujoco", "--variant", "capstan", "--from", "1", "--out", str(tmp_path), "--json")
    assert done.returncode == 0, done.stderr
    printed = json.loads(done.stdout)
    result = ReleasesResult.from_json((tmp_path / FILE).read_text())
    assert printed["file"] == str(tmp_path / FILE)
    assert [row["release"] for row in printed["result"]["releases"]] == ["1.0", "2.0"]
    assert (tmp_path / "versions.png").read_bytes()[1:4] == b"PNG"
    assert [row.packages for row in result.releases] == [{"mujoco": version("mujoco")}] * 2
    assert result.moves == ()
    again = here("versions", "mujoco", "--variant", "capstan", "--from", "1", "--out", str(tmp_path))
    assert "No number moved by more than its spread." in again.stdout


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("mujco", "--from", "1"), "did you mean 'mujoco'"),
        (("mujoco",), "needed --from V"),
        (("mujoco", "--versions", "3.0"), "mujoco has no release 3.0"),
        (("mujoco", "--from", "1", "--variant", "rope"), "has no variant 'rope'"),
        (("mujoco", "--from", "1", "--scenario", "ten"), "ten_to_one"),
    ],
)
def test_a_mistake_is_one_line_with_a_way_out(releases_of_this_mujoco, arguments, words):
    done = here("versions", *arguments)
    assert (done.returncode, done.stdout) == (2, "")
    assert words in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


@pytest.mark.parametrize("engine", LEAST_RELEASES)
def test_the_stored_study_has_enough_releases_and_its_moves_follow_from_its_numbers(engine):
    result = STORED[engine]
    assert sum(row.ran for row in result.releases) >= LEAST_RELEASES[engine]
    assert not result.interrupted
    again = {(m.release, m.label, m.quantity) for m in find_moves(result.releases, result.spread)}
    assert again == {(m.release, m.label, m.quantity) for m in result.moves}


def test_every_cause_is_of_a_release_in_the_study():
    for engine, release in read_causes():
        assert release in {row.release for row in STORED[engine].releases}


@pytest.mark.long
@pytest.mark.parametrize("label", ["mujoco:documented", "mujoco:capstan"])
def test_stored_numbers_are_those_of_the_installed_release(label):
    # Oracle: the stored row of the same release; six digits are stored, and other processors round otherwise.
    pytest.importorskip("mujoco")
    stored = next((r for r in STORED["mujoco"].releases if r.release == version("mujoco")), None)
    if stored is None:
        pytest.skip("the installed MuJoCo is not in the stored study: `looping-pendulum versions mujoco` adds it")
    reference = Reference(replace(load("ten_to_one"), tolerances=()))
    (engine,) = select([label], Profile.QUICK)
    measured = metrics_of(run_isolated(engine, reference.scenario), reference)
    for name in ("rms_0.35s", "rms_0.7s"):
        assert measured[name] == pytest.approx(stored.variant(label).values[name], rel=1e-2, abs=1e-8), name


@pytest.mark.long
def test_the_figure_has_a_row_for_each_engine_and_a_ring_for_each_move_that_it_shows():
    mujoco = STORED["mujoco"]
    picture = figure([mujoco])
    rings = [line for line in picture.axes[0].lines if line.get_markersize() == 10]
    drawn = sum(len(line.get_xdata()) for line in rings)
    assert drawn == sum(move.quantity == "rms_0.35s" for move in mujoco.moves)
    assert png(picture)[1:4] == b"PNG"


@pytest.mark.accurate
def test_the_release_that_changed_mujocos_tendons_is_named(tmp_path):
    # 3.17.0 lays a tendon round the other side of the rod for some wrap angles; 4.0.0 does not (docs/ropes-and-releases.md)
    try:
        list_releases("mujoco")
    except ReleaseError as error:
        pytest.skip(f"needs a package index: {error}")
    wanted = "2.2.0,3.16.0,3.17.0,4.0.0"
    done = here("versions", "mujoco", "--variant", "capstan", "--versions", wanted, "--out", str(tmp_path), "--json")
    assert done.returncode == 0, done.stderr
    result = ReleasesResult.from_json((tmp_path / FILE).read_text())
    assert {move.release for move in result.moves} == {"4.0.0"}
    stored = {row.release: row for row in STORED["mujoco"].releases}
    for row in result.releases[1:]:
        assert row.variant("mujoco:capstan").values["rms_0.35s"] == pytest.approx(
            stored[row.release].variant("mujoco:capstan").values["rms_0.35s"], rel=1e-2
        )
