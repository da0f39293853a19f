"""The built site: it asks for nothing from elsewhere, and opened from a folder it is searched like any other.

`make docs` builds it, strictly, in an environment of its own; .ci/run does so before the tests.
"""

import re
from pathlib import Path

import pytest

from tests.docs_commands import PROJECT
from tests.pages.conftest import until

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
    assert len(pages) > 30
    for page in pages:
        assert not loaded.search(page.read_text(encoding="utf-8")), page.name


def test_the_live_page_is_in_it(site):
    assert 'src="live.html"' in (site / "try.html").read_text(encoding="utf-8")
    assert 'id="live-data"' in (site / "live.html").read_text(encoding="utf-8")


def test_formulas_are_pictures_and_docstrings_are_there(site):
    formulas = (site / "derivation.html").read_text(encoding="utf-8")
    assert formulas.count('<svg class="tex"') > 100
    assert "$\\" not in formulas
    assert "looping_pendulum.engines.protocol.Engine.simulate" in (site / "api" / "engines.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["index.html", "api/engines.html"])
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
    assert any("/demonstrations/constant-friction.html" in link for link in links)
    assert errors == []
    assert asked == []


@pytest.mark.parametrize("name", ["derivation.html", "demonstrations/polygon.html"])
def test_a_page_complains_of_nothing(site, chromium, name):
    page = chromium.new_page()
    errors, asked = [], []
    page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
    page.on("request", lambda request: asked.append(request.url) if not request.url.startswith("file:") else None)
    page.goto((site / name).as_uri())
    page.close()
    assert (errors, asked) == ([], [])
