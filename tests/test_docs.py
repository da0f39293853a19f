"""The documentation: every command is one, and the quick ones run. `make docs` is strict about pages, links and anchors."""

import re
import shutil
from pathlib import Path
from pydoc import locate

import pytest
import typer
from typer.testing import CliRunner

from looping_pendulum.cli.main import GROUPS, app
from looping_pendulum.teaching.example_folder import write_example
from scripts.docs_math import on_page_markdown
from tests.docs_commands import PROJECT, Command, commands
from tests.pages.conftest import until

DOCS = PROJECT / "docs"
UsageError = typer.BadParameter.__base__
"""Click's, or that of the copy of click that typer brings."""
ELSEWHERE = {
    r"^looping-pendulum new ": "tests/teaching/test_new_and_init.py",
    r"--baseline": "tests/test_cli.py",
    r"conformance my_engine|spring": "tests/engines/test_write_an_engine.py",
    r"^looping-pendulum demo( |$)": "tests/teaching/test_demo.py",
    r"^looping-pendulum live( |$)": "tests/live/test_command.py",
    r"^looping-pendulum maps?( |$)(?!map\.yaml|quick)": "tests/sweep",
    r"^looping-pendulum converge": "tests/compare/test_convergence_study.py",
    r"^looping-pendulum check$": "tests/test_tolerances.py",
    r"--engine mujoco --marks": "tests/compare/test_trial.py, and docs/demo.md with one variant",
    r"^looping-pendulum track |films\.yaml": "tests/measured/film, with rendered films",
    r"--install-completion": "tests/test_completion.py",
}
"""Commands that other tests run, or whose names stand for a reader's own -> which tests."""
SLOW = r"identify|mujoco:documented|report/|pymunk|compare ten_to_one$|demonstrations|^looping-pendulum map "
"""Commands that take more than a few seconds, or need what those write: in a long test."""


def elsewhere(command: Command) -> bool:
    return any(re.search(pattern, command.text) for pattern in ELSEWHERE)


def slow(command: Command) -> bool:
    written = re.search(r"--out (\S+)$", command.text)
    text = command.text.removesuffix(written[0]) if written else command.text
    return re.search(SLOW, text) is not None


def test_every_command_shown_is_one():
    group = typer.main.get_command(app)
    shown = commands()
    assert len(shown) > 40
    for command in shown:
        name, *rest = command.arguments
        if any(name in parameter.opts for parameter in group.params):
            continue
        assert name in group.commands, f"{command.page}: {command.text}"
        try:
            group.commands[name].make_context(name, list(rest))
        except typer.Exit:
            pass  # an option such as --schema, which ends the command
        except UsageError as error:
            pytest.fail(f"{command.page}: {command.text}: {error.format_message()}")


def test_the_help_has_every_command_in_one_group():
    commands = typer.main.get_command(app).commands
    assert sorted(name for names in GROUPS.values() for name in names) == sorted(commands)


def test_the_readmes_example_prints_what_stands_below_it(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    text = (PROJECT / "README.md").read_text(encoding="utf-8")
    example, printed = re.search(r"```python\n(.*?)```\s*```text\n(.*?)```", text, re.DOTALL).groups()
    exec(compile(example, "README.md", "exec"), {})
    assert capsys.readouterr().out == printed
    assert (tmp_path / "report" / "ten_to_one" / "report.html").exists()


@pytest.mark.parametrize("text", ["run ten_to_one --engin mujoco", "compare", "tracker ten_to_one --fps many"])
def test_a_wrong_command_would_be_found(text):
    group = typer.main.get_command(app)
    name, *rest = text.split()
    with pytest.raises(UsageError):
        group.commands[name].make_context(name, rest)


def copy(source: Path, target: Path) -> None:
    """Copy a file or a folder."""
    target.parent.mkdir(parents=True, exist_ok=True)
    if source.is_dir():
        shutil.copytree(source, target, dirs_exist_ok=True)
    else:
        shutil.copyfile(source, target)


def run_in_example_folder(chosen, folder, monkeypatch):
    """Run commands, each page's in an example folder of its own; what one wrote with --out stands for the same one later."""
    seen: dict[str, Path] = {}
    for page in dict.fromkeys(command.page for command in chosen):
        here = folder / page.replace("/", "-")
        write_example(here)
        monkeypatch.chdir(here)
        for command in (c for c in chosen if c.page == page):
            written = re.search(r"--out (\S+)$", command.text)
            if command.text in seen and command.output is None and (written or "--out" not in command.arguments):
                if written:  # for the commands below it
                    copy(seen[command.text] / written[1], here / written[1])
                continue
            seen[command.text] = here
            done = CliRunner().invoke(app, list(command.arguments), input="\n" * 80)
            assert done.exit_code == 0, f"{page}: {command.text}: {done.output[-2000:]} {done.exception}"
            if command.output is not None:
                Path(command.output).write_text(done.output, encoding="utf-8")
            assert written is None or Path(written[1]).exists(), command.text


def test_the_quick_commands_run_as_they_stand(tmp_path, monkeypatch):
    run_in_example_folder([c for c in commands() if not elsewhere(c) and not slow(c)], tmp_path, monkeypatch)


@pytest.mark.long
def test_every_command_runs_as_it_stands(tmp_path, monkeypatch):
    with_slow = {c.page for c in commands() if slow(c) and not elsewhere(c)}
    run_in_example_folder([c for c in commands() if c.page in with_slow and not elsewhere(c)], tmp_path, monkeypatch)


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md"])
def test_links_of_pages_outside_the_site_lead_to_files(page):
    for target in re.findall(r"\]\(([^)#\s]+)", (PROJECT / page).read_text(encoding="utf-8")):
        assert target.startswith("https://") or (PROJECT / target).exists(), target


def test_the_names_in_code_for_contributors_are_there():
    names = re.findall(r"`([a-z_][\w.]*):([A-Za-z][\w.]*)`", (PROJECT / "CONTRIBUTING.md").read_text(encoding="utf-8"))
    assert len(names) > 60
    for module, name in names:
        folders = ("looping_pendulum", "looping_pendulum.discrepancy.look")
        assert any(locate(f"{folder}.{module}.{name}") is not None for folder in folders), f"{module}:{name}"


def test_formulas_become_pictures_that_say_their_tex_and_code_stays():
    page = on_page_markdown("so $M_1$ and `$M_2$`:\n\n$$\\tfrac12\\,\\rho < 1$$\n\n```sh\necho $A $B\n```\n")
    assert page.count("<svg") == 2
    assert 'aria-label="M_1"' in page
    assert 'aria-label="\\tfrac12\\,\\rho &lt; 1"' in page
    assert "`$M_2$`" in page
    assert "echo $A $B" in page
    assert "$" not in re.sub(r"`[^`]*`|```.*?```|aria-label=\"[^\"]*\"", "", page, flags=re.DOTALL)


# ---- the built site: it asks for nothing from elsewhere, and opened from a folder it is searched like any other


SITE = PROJECT / "site"
SOURCES = (
    "docs/**/*.md",
    "docs/*.css",
    "docs/*.js",
    "mkdocs.yml",
    "scripts/docs_math.py",
    "looping_pendulum/**/*.py",
    "looping_pendulum/live/**/*.js",
)


@pytest.fixture(scope="module")
def site() -> Path:
    if not (SITE / "index.html").exists():
        pytest.skip("there is no site: `make docs` builds it")
    built = (SITE / "index.html").stat().st_mtime
    later = [path.name for pattern in SOURCES for path in PROJECT.glob(pattern) if path.stat().st_mtime > built]
    if later:
        pytest.skip(f"the site is older than {later[0]}: `make docs` builds it")
    return SITE


def test_it_asks_for_nothing_from_elsewhere(site):
    loaded = re.compile(r"<(?:script|img|iframe|source)[^>]+src=\"(https?:|//)|<link[^>]+href=\"(https?:|//)|url\((https?:|//)")
    pages = list(site.rglob("*.html"))
    assert len(pages) > 20
    for page in pages:
        assert not loaded.search(page.read_text(encoding="utf-8")), page.name


def test_the_live_page_is_in_it(site):
    assert 'src="live.html"' in (site / "demo.html").read_text(encoding="utf-8")
    assert 'id="live-data"' in (site / "live.html").read_text(encoding="utf-8")


def test_formulas_are_pictures_and_docstrings_are_there(site):
    formulas = (site / "derivation.html").read_text(encoding="utf-8")
    assert formulas.count('<svg class="tex"') > 100
    assert "$\\" not in formulas
    assert "looping_pendulum.engines.protocol.Engine.simulate" in (site / "api.html").read_text(encoding="utf-8")


@pytest.mark.long
@pytest.mark.parametrize("name", ["index.html", "api.html"])
def test_from_a_folder_it_is_searched_in_a_browser_that_asks_for_nothing_else(site, chromium, name):
    page = chromium.new_page(viewport={"width": 1280, "height": 900})
    errors, asked = [], []
    page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("request", lambda request: asked.append(request.url) if not request.url.startswith("file:") else None)
    page.goto((site / name).as_uri())
    page.fill("input[name=query]", "capstan")
    page.focus("input[name=query]")
    until(page, "document.querySelectorAll('.md-search-result__link').length > 5")
    links = page.evaluate("[...document.querySelectorAll('.md-search-result__link')].map(link => link.href)")
    page.close()
    assert all(link.startswith(site.as_uri()) for link in links)
    assert any("/demonstrations/index.html" in link for link in links)
    assert errors == []
    assert asked == []


@pytest.mark.parametrize("name", ["derivation.html", "demonstrations/index.html"])
def test_a_page_complains_of_nothing(site, chromium, name):
    page = chromium.new_page()
    errors, asked = [], []
    page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
    page.on("request", lambda request: asked.append(request.url) if not request.url.startswith("file:") else None)
    page.goto((site / name).as_uri())
    page.close()
    assert (errors, asked) == ([], [])


@pytest.mark.long
def test_a_click_on_a_heading_sorts_the_variants_and_gaps_stay_last(site, chromium):
    page = chromium.new_page()
    page.goto((site / "accuracy.html").as_uri())
    for descending in (False, True):
        page.get_by_role("button", name="halt [ms]").click()
        cells = page.locator(".sortable tbody tr td:nth-child(5)").all_inner_texts()
        numbers = [float(cell) for cell in cells if re.fullmatch(r"[-+.e\d]+", cell)]
        assert len(numbers) > 5
        assert numbers == sorted(numbers, reverse=descending)
        assert not any(re.fullmatch(r"[-+.e\d]+", cell) for cell in cells[len(numbers) :])
    page.close()
