"""Engines that do every bad thing we thought of cost their own row, with a sentence that says why, and never another's."""

import json
import re
import sys
import time

import psutil
import pytest

from looping_pendulum.engines import other_packages
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.registry import AdapterWarning, load_engines, main_engines
from looping_pendulum.runs.trajectory import RunStatus
from tests.command_line import here
from tests.engines.bad_engines import ADAPTERS, AFTER, BEFORE, CHATTY, LEFT, MEMORY_LIMIT
from tests.engines.faulty import adapters_of_another_package

BAD = BEFORE | AFTER
SCENARIO = """
title: Short
light: {mass: 10 g}
heavy: {mass: 100 g}
rod: {radius: 6.25 mm}
release: {angle: 112 deg, free_length: 58 cm}
duration: 50 ms
"""
linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="what has lost its parent is only found on Linux")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Return a folder with a distribution of adapters, on the path of this process."""
    folder = tmp_path_factory.mktemp("site")
    (folder / "short.yaml").write_text(SCENARIO)
    good = "from tests.engines.bad_engines import GoodEngine\ndef engines(profile):\n    return [GoodEngine('rest', profile)]\n"
    with adapters_of_another_package(folder, {"bad": "from tests.engines.bad_engines import engines\n", "good": good}):
        yield folder


@pytest.fixture(scope="module")
def compared(site, tmp_path_factory):
    """Return the command that runs all bad engines and a good one, and engine -> its row in result.json."""
    out = tmp_path_factory.mktemp("out") / "report"
    limits = ("--time-limit", "6 s", "--memory-limit", "200 MiB")
    done = here("compare", str(site / "short.yaml"), "-e", "good", "-e", "bad", *limits, "--out", str(out))
    rows = json.loads((out / "result.json").read_text())["engines"]
    return done, {row["variant"]: row for row in rows}, (out / "report.md").read_text()


@pytest.mark.long
@linux
def test_the_good_engines_result_is_there(compared):
    done, rows, _ = compared
    assert done.returncode == 1, done.stderr  # runs broke off
    assert rows.keys() == {*BAD, "rest"}
    assert rows["rest"]["status"] == RunStatus.FINISHED.name
    assert any(rows["rest"]["metrics"].values())


@pytest.mark.long
@linux
@pytest.mark.parametrize("name", BAD)
def test_a_bad_engines_row_says_what_it_did(compared, name):
    _, rows, report = compared
    _, statuses, sentence = BAD[name]
    row = rows[name]
    assert row["status"] in statuses, row["message"]
    assert re.search(sentence, row["message"]), row["message"]
    assert len(row["message"].splitlines()) <= 1
    assert len(row["message"]) <= 500
    assert f"bad:{name}" in report


@pytest.mark.long
@linux
@pytest.mark.usefixtures("compared")
def test_nothing_that_they_started_is_left():
    assert not [
        process for process in psutil.process_iter(["cmdline"]) if any(LEFT in word for word in process.info["cmdline"] or ())
    ]


@pytest.mark.long
@pytest.mark.usefixtures("site")
def test_without_a_result_the_command_says_so():
    done = here("check", "drop", "-e", "bad:exits", "--time-limit", "3 s")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1


# ---- adapters


@pytest.fixture
def adapters(offer, monkeypatch):
    """Install every bad adapter, and a chatty one."""
    monkeypatch.setattr(other_packages, "TIME_LIMIT", 10.0)
    monkeypatch.setattr(other_packages, "MEMORY_LIMIT", MEMORY_LIMIT)
    offer(**{name: source for name, (source, _) in ADAPTERS.items()}, chatty=CHATTY)


@pytest.mark.long
@pytest.mark.usefixtures("adapters")
def test_bad_adapters_cost_their_own_row():
    engines, faults = load_engines(Profile.QUICK)
    assert {"chatty", "mujoco"} <= {engine.name for engine in engines}
    assert faults.keys() == ADAPTERS.keys()
    for name, (_, sentence) in ADAPTERS.items():
        assert sentence in faults[name], faults[name]
        assert "\n" not in faults[name]
    done = here("engines")  # all is known by now
    assert done.returncode == 0
    assert all(fault in done.stdout for fault in faults.values())
    with pytest.warns(AdapterWarning):
        assert main_engines(Profile.QUICK)


@pytest.mark.usefixtures("adapters")
def test_an_engine_that_is_asked_for_never_waits_for_another_packages_adapter():
    """A hanging adapter hung every command; one that exits ended `check` with status 0 and no output."""
    started = time.perf_counter()
    done = here("check", "drop", "-e", "pymunk")
    assert done.returncode == 0
    assert "pymunk:chain" in done.stdout
    assert "left out" not in done.stderr
    assert not other_packages.DESCRIBED
    done = here("run", "drop", "-e", "exits")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "its import ended: exit status 0" in done.stderr
    assert time.perf_counter() - started < 60
