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
from looping_pendulum.live import write as bundles
from looping_pendulum.live.write import bundle
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
    page = bundles.render(mine)
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


def modules(tmp_path, monkeypatch, **sources):
    for name, source in sources.items():
        (tmp_path / f"{name}.js").write_text(source, encoding="utf-8")
    monkeypatch.setattr(bundles, "files", lambda package: tmp_path)


def test_a_module_stands_once_and_before_those_that_import_it(tmp_path, monkeypatch):
    low = "export const a = 1;\nexport function* numbers() {}\n"
    modules(
        tmp_path,
        monkeypatch,
        main='import { a } from "./low.js";\nimport { b } from "./middle.js";\nglobalThis.sum = a + b;\n',
        middle='import { a } from "./low.js";\nexport const b = a + 1;\n',
        low=low,
    )
    script = bundle("main.js")
    assert [script.count(f"const module_{name}=") for name in ("low", "middle", "main")] == [1, 1, 1]
    assert script.index("module_low=") < script.index("module_middle=") < script.index("module_main=")
    assert "import" not in script
    assert "return{a,numbers};" in script


def test_comments_stay_in_the_source_and_what_is_between_quotes_is_kept(tmp_path, monkeypatch):
    kept = "`a\n  b ${ globalThis.c } // no comment`", '"https://example.org /** no */"', '/[/"] \\//'
    lines = "".join(f"const kept{i} = {literal}; // of a line\n" for i, literal in enumerate(kept))
    modules(tmp_path, monkeypatch, main=f"/** What\n * it is. */\n  // Why\n{lines}/** What */\n")
    script = bundle("main.js")
    for literal in kept:
        assert literal in script
    for comment in ("What", "Why", "of a line"):
        assert comment not in script


@pytest.mark.parametrize(
    ("sources", "message"),
    [
        ({"main": 'import * as all from "./low.js";\n', "low": ""}, "main.js: found 'import * as all"),
        ({"main": "const words = `a ${b ? `c` : d}`;\n"}, "main.js: found '`a ${b ? `', needed no template within a template"),
        ({"main": "export default 1;\n"}, "main.js: found 'export default 1;', needed imports and exports by names"),
        (
            {"main": 'import { a } from "./low.js";\n', "low": 'import { b } from "./main.js";\n'},
            "main.js: found a circle of imports: main.js -> low.js -> main.js",
        ),
    ],
)
def test_what_cannot_be_joined_is_refused(tmp_path, monkeypatch, sources, message):
    modules(tmp_path, monkeypatch, **sources)
    with pytest.raises(ValueError, match=re.escape(message)):
        bundle("main.js")
