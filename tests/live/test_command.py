"""The command that writes the live page, and the script that it puts into it."""

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from looping_pendulum.cli.main import app
from looping_pendulum.compare import write
from looping_pendulum.compare.trajectories import stored_result
from looping_pendulum.errors import HarnessError
from looping_pendulum.live.write import render
from looping_pendulum.scenarios import load, shipped
from looping_pendulum.teaching import demo
from tests.compare.conftest import quick_figures  # noqa: F401, a fixture
from tests.pages.small import LABELS, small_result

MAX_SIZE = 650_000
"""Largest page [bytes]: one file that a slow line loads in some seconds, compressed to a third."""


def test_it_writes_one_small_file_with_every_scenario_and_opens_it(tmp_path, monkeypatch):
    opened = []
    monkeypatch.setattr(demo, "show", lambda path: opened.append(path) or True)
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["live", "two_to_one"])
    assert (result.exit_code, result.stdout) == (0, "wrote live.html\n")
    assert result.stderr == (
        f"no engines beside it: {Path('report/two_to_one')} has no result of this scenario; "
        "`looping-pendulum compare two_to_one` makes one\n"
    )
    assert opened == [Path("live.html")]
    page = Path("live.html").read_bytes()
    assert len(page) < MAX_SIZE
    text = page.decode()
    assert '"start":"two_to_one"' in text
    assert '<script type="application/json" id="engine-runs-data">null</script>' in text
    assert all(f'"name":"{name}"' in text for name in shipped())
    assert not re.search(r"""(src|href)=["'](?!data:|#)""", text)


def test_a_scenario_of_ones_own_stays_in_its_own_language():
    mine = replace(load("ten_to_one"), title="Meines", description="A pencil, and a nut.")
    page = render(mine)
    data = json.loads(re.search(r'id="live-data">(.*?)</script>', page, re.DOTALL)[1])
    assert {preset["name"] for preset in data["presets"] if preset["shipped"]} == set(shipped()) - {"ten_to_one"}


@pytest.mark.long
@pytest.mark.usefixtures("quick_figures")
def test_runs_of_a_stored_comparison_are_taken_and_named(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(small_result(), Path("report/two_to_one"))
    result = CliRunner().invoke(app, ["live", "two_to_one", "--no-open"])
    assert (result.exit_code, result.output) == (
        0,
        f"wrote live.html, with the runs of {', '.join(LABELS)} from {Path('report/two_to_one')}\n",
    )
    stored = stored_result(Path("report/two_to_one"), load("two_to_one"), None)
    assert Path("live.html").read_text(encoding="utf-8") == demo.demo_page(stored)
    Path("report").rename("elsewhere")
    Path("live.html").unlink()  # a file that is there is left as it is
    result = CliRunner().invoke(app, ["live", "two_to_one", "--no-open", "--results", "elsewhere/two_to_one"])
    assert "with the runs of" in result.output
    Path("live.html").unlink()
    for arguments in (
        ["live", "ten_to_one", "--results", "elsewhere/two_to_one"],
        ["live", "two_to_one", "--results", "nowhere"],
    ):
        result = CliRunner().invoke(app, [*arguments, "--no-open"])
        assert isinstance(result.exception, HarnessError)
        assert str(result.exception).startswith(
            f"--results: found no result of this scenario in {Path(arguments[-1])}, needed "
        )


def test_without_a_browser_it_says_where_the_page_is(tmp_path, monkeypatch):
    monkeypatch.setattr(demo, "show", lambda path: False)
    file = tmp_path / "page.html"
    result = CliRunner().invoke(app, ["live", "--out", str(file)])
    assert result.output.splitlines()[-1] == f"no browser was found; open {file.as_uri()} in one"
    assert "no browser" not in CliRunner().invoke(app, ["live", "--no-open", "--out", str(file)]).output
