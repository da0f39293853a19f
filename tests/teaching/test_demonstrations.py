"""The demonstrations: what a page says is what a run shows, and a page whose run shows something else says so."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from looping_pendulum.cli.main import app
from looping_pendulum.scenarios import loader
from looping_pendulum.teaching.demonstrations import page as demonstrations_page
from looping_pendulum.teaching.demonstrations.demonstration import Claim, DemonstrationError, JudgedClaim, run_demonstration
from looping_pendulum.teaching.demonstrations.page import (
    DEMONSTRATIONS,
    MADE_WITH,
    NOT_BORNE_OUT,
    find_demonstrations,
    html,
    index,
    markdown,
    write_pages,
)

COMMITTED = Path(__file__).parents[2] / "docs" / "demonstrations"
NUMBER = re.compile(r"[+-]?\d+(?:\.\d+)?(?:e[+-]?\d+)?")
QUICK = ("drag-and-spiral", "break-away")
"""Demonstrations with the reference alone: a second together."""


def words_and_numbers(page):
    """Text of a page without the line of versions, its numbers apart."""
    text = "\n".join(line for line in page.splitlines() if not line.startswith(MADE_WITH))
    return NUMBER.sub("#", text), [float(n) for n in NUMBER.findall(text)]


def rerun(name):
    result = run_demonstration(DEMONSTRATIONS[name])
    assert result.all_claims_hold, [s.text for s in result.answer if not s.holds]
    words, numbers = words_and_numbers(markdown(result))
    kept_words, kept_numbers = words_and_numbers((COMMITTED / f"{name}.md").read_text(encoding="utf-8"))
    assert words == kept_words, f"docs/demonstrations/{name}.md is out of date: looping-pendulum demonstrations --no-html --out"
    # Numbers are printed to 2 to 4 digits; a chain's differ by rounding errors from machine to machine. Below 1e-2 they are
    # rounding errors themselves.
    assert np.allclose(numbers, kept_numbers, rtol=0.05, atol=1e-2)


@pytest.mark.parametrize("name", QUICK)
def test_a_page_in_the_docs_is_what_a_run_shows(name):
    rerun(name)


@pytest.mark.accurate
@pytest.mark.parametrize("name", [n for n in DEMONSTRATIONS if n not in QUICK])
def test_every_other_page_in_the_docs_is_what_a_run_shows(name):
    rerun(name)


def test_the_list_in_the_docs_is_up_to_date():
    assert (COMMITTED / "index.md").read_text(encoding="utf-8") == index()
    assert {p.stem for p in COMMITTED.glob("*.png")} == set(DEMONSTRATIONS)


@pytest.mark.parametrize("name", DEMONSTRATIONS)
def test_what_a_page_asks_to_change_makes_a_scenario(name):
    d = DEMONSTRATIONS[name]
    tree = yaml.load(loader.source_text(d.scenario), yaml.BaseLoader)
    for group, changes in yaml.load(d.change, yaml.BaseLoader).items():
        tree[group] = tree.get(group, {}) | changes
    changed = loader.load_text(yaml.safe_dump(tree), "mine.yaml")
    assert changed.parameters != loader.load(d.scenario).parameters


def with_claim(words, holds):
    d = DEMONSTRATIONS["break-away"]
    return dataclasses.replace(d, claims=(Claim(words=words, holds=holds), *d.claims))


@pytest.mark.long
def test_a_claim_that_the_numbers_do_not_bear_out_is_shown_as_such(tmp_path, monkeypatch):
    wrong = with_claim("It slips again at {away[r1.2]:.3f} s, before it did.", lambda n: n["away"]["r1.2"] < n["away"]["r1.0"])
    result = run_demonstration(wrong)
    assert not result.all_claims_hold
    assert result.answer[0].text.startswith("It slips again at 0.6")
    assert f"**{NOT_BORNE_OUT}** It slips again" in markdown(result)
    monkeypatch.setattr(demonstrations_page, "DEMONSTRATIONS", {"break-away": wrong})
    done = CliRunner().invoke(app, ["demonstrations", "break-away", "--out", str(tmp_path)])
    assert done.exit_code == 1
    assert NOT_BORNE_OUT in done.output
    page = (tmp_path / "break-away.html").read_text()
    assert page.count(NOT_BORNE_OUT) == 1


def test_a_claim_about_a_number_that_is_not_there_does_not_break_the_page():
    d = DEMONSTRATIONS["break-away"]
    never = with_claim("It reaches {away[r1.0]:.3f} s.", lambda n: n["away"]["r1.0"] is not None)
    away = next(q for q in d.quantities if q.key == "away")
    nothing = dataclasses.replace(away, measure=lambda runs, key: None)
    quantities = tuple(nothing if q is away else q for q in d.quantities)
    result = run_demonstration(dataclasses.replace(never, quantities=quantities, claims=never.claims[:1]))
    assert result.answer == (JudgedClaim(text="It reaches {away[r1.0]:.3f} s.", holds=False),)
    assert all(row[3] == "–" for row in result.rows)


def test_hostile_text_stays_text(tmp_path):
    hostile = "<script>alert(1)</script><img src=x onerror=alert(2)>"
    d = DEMONSTRATIONS["break-away"]
    picture = dataclasses.replace(d.picture, x=hostile)
    page = html(run_demonstration(dataclasses.replace(d, title=hostile, question=hostile, change=hostile, picture=picture)))
    assert "<script>alert" not in page
    assert "<img src=x" not in page
    assert page.count("&lt;script&gt;alert") >= 4


def test_a_page_stands_alone(tmp_path):
    files = write_pages(run_demonstration(DEMONSTRATIONS["drag-and-spiral"]), tmp_path)
    ends = ("png", "md", "html")
    assert [f.name for f in files] == [f"drag-and-spiral.{end}" for end in ends]
    page = files[-1].read_text()
    assert len(page) < 200_000
    assert not re.search(r"(src|href)=\"(?!data:|#|index\.html)", page)
    assert '<div role="img" tabindex="0" aria-label="' in page
    assert page.count("<th scope=") == 3 + 8


@pytest.mark.long
def test_the_list_leads_to_the_pages_that_are_there(tmp_path):
    done = CliRunner().invoke(app, ["demonstrations", "break-away", "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    assert re.findall(r'<a href="([^"#]+)"', (tmp_path / "index.html").read_text()) == ["break-away.html"]
    assert not (tmp_path / "index.md").exists()


def test_an_unknown_name_is_refused_with_the_known_ones():
    with pytest.raises(DemonstrationError, match="did you mean 'polygon'.*known: tendon-without-friction"):
        find_demonstrations(["polygone"])
