"""The kit: what goes into a page stays text there, the policy allows no request, and the same input gives the same bytes."""

import base64
import dataclasses
import hashlib
import json
import re

import pytest
from markdown_it import MarkdownIt
from markupsafe import Markup

from looping_pendulum.compare.figures import charts
from looping_pendulum.compare.report import render_page
from looping_pendulum.discrepancy.report import figures as identification_figures
from looping_pendulum.discrepancy.report import writing as identification_page
from looping_pendulum.engines import own_labels
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.registry import all_engines, label, main_engines, own_engines, styles
from looping_pendulum.pages import markdown
from looping_pendulum.pages.figures import escaped, on_page, plain
from looping_pendulum.pages.palette import COLOURS, DARK_COLOURS
from looping_pendulum.pages.shell import embedded
from looping_pendulum.teaching import demo
from tests.pages.colour_vision import contrast
from tests.pages.made_up import identification
from tests.pages.small import HOSTILE, hostile_result, small_result, with_points

MOST_BYTES = 6e6  # the limit


@pytest.mark.parametrize("data", [HOSTILE, [HOSTILE], {HOSTILE: 1.5}, "\u2028\u2029", None])
def test_embedded_json_reads_back_and_cannot_end_its_element(data):
    text = embedded(data)
    assert json.loads(text) == data
    assert not set(text) & set("<>&\u2028\u2029")


def test_embedded_json_refuses_what_is_no_json():
    with pytest.raises(ValueError, match="JSON"):
        embedded(float("nan"))


@pytest.mark.parametrize(
    "text",
    ["<script>alert(1)</script>", "<img src=x onerror=alert(1)>", "![x](http://example.org/x.png)", "<http://example.org>"],
)
def test_markdown_makes_no_element_of_what_stands_in_it(text):
    html = markdown.html(f"{text}\n\n| a |\n| --- |\n| {text} |\n")
    assert not re.search(r"<(script|img|a)\b", html)
    assert html.count("<table>") == 1


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("<script>alert(1)</script>", "&lt;script&gt;alert(1)&lt;/script&gt;"),
        ("\\<script>", "\\&lt;script&gt;"),
        ("![x](http://example.org/x.png)", "![x](http://example.org/x.png)"),
        ("[x][y] [y]: http://example.org", "[x][y] [y]: http://example.org"),
        ("C:\\path\\|a|", "C:\\path\\|a|"),
        ("two\n\n# lines", "two # lines"),
        ("rms_0.35s [mm]", "rms_0.35s [mm]"),
    ],
)
def test_escaped_text_is_itself_in_any_renderer(text, shown):
    """Oracle: CommonMark with HTML, links and images, in a paragraph and in a cell of a table."""
    in_table = f"{markdown.escaped(text)}.\n\n{markdown.table(['a', 'b'], [[text, 'end']])}"
    html = MarkdownIt("commonmark").enable("table").render(in_table)
    assert f"<p>{shown}.</p>" in html
    assert f"<td>{shown}</td>" in html
    assert "end</td>" in html


def test_markdown_is_not_escaped_again():
    once = markdown.escaped("a < b")
    assert markdown.escaped(once) == once == "a \\< b"
    assert "**no**" in markdown.table(["a"], [[Markup("**no**")]])


def test_code_cannot_end_its_backticks_or_its_fence():
    assert markdown.code("a `b` | c\nd") == "a 'b' | c d"
    assert markdown.code("a|b", in_table=True) == "a\\|b"
    html = MarkdownIt("commonmark").render(markdown.fenced("x\n````\n<b>", "yaml"))
    assert html == '<pre><code class="language-yaml">x\n````\n&lt;b&gt;\n</code></pre>\n'


def test_colours_of_the_dark_ground_are_as_many_and_can_be_seen():
    assert len(DARK_COLOURS) == len(COLOURS)
    assert all(contrast(colour, "#12161c") >= 4.5 for colour in DARK_COLOURS)  # WCAG 2.2, AA for text; lines need 3


@pytest.mark.parametrize(
    "pair", [("#16191d", "#ffffff"), ("#4d5560", "#f5f6f8"), ("#a9b3bf", "#1b2129"), ("#0b5fa5", "#ffffff")]
)
def test_text_can_be_read(pair):
    assert contrast(*pair) >= 4.5  # WCAG 2.2, AA


def test_every_variant_of_this_package_has_a_style_of_its_own_whatever_else_is_shown():
    labels = [label(engine) for engine in all_engines(Profile.QUICK) if engine.name in own_engines()]
    assert sorted(labels) == sorted(own_labels()), "a new variant needs a colour and a symbol in its engine.json"
    together = styles([*labels, "another:engine"])
    assert all(styles([one])[one] == style for one, style in together.items())
    assert len({(style.colour, style.dashes) for style in together.values()}) == len(together)
    main = [label(engine) for engine in main_engines(Profile.QUICK)]
    assert len({together[one].colour for one in main}) == len(main)


def identified_page(name):
    result = identification(name)
    return identification_page.identification_page(result, identification_figures.charts(result))


def comparison_page(result):
    return render_page(result, charts(result))


PAGES = {
    "comparison": lambda: comparison_page(small_result()),
    "comparison with points": lambda: comparison_page(with_points(small_result())),
    "identification": lambda: identified_page("calm"),
    "demo": lambda: demo.demo_page(small_result()),
    "demo with points": lambda: demo.demo_page(with_points(small_result())),
}


@pytest.mark.long
@pytest.mark.parametrize("name", PAGES)
def test_pages_are_small_whole_and_the_same_again(name):
    html = PAGES[name]()
    assert len(html.encode()) < (1.5e6 if name == "demo" else MOST_BYTES)
    assert html == PAGES[name]()
    assert not re.search(r"<(script|link|img|iframe)[^>]*\b(src|href)=\"(?!data:)", html)


@pytest.mark.parametrize("name", PAGES)
def test_only_our_own_scripts_run(name):
    html = PAGES[name]()
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', html)[1].replace("&#39;", "'")
    allowed = set(re.findall(r"'sha256-([^']*)'", policy))
    run = re.findall(r"<script>(.*?)</script>", html, re.DOTALL)
    assert {base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in run} == allowed
    assert "'unsafe-eval'" not in policy
    assert ("'wasm-unsafe-eval'" in policy) == name.startswith("demo")  # the live page's model
    assert "script-src 'unsafe-inline'" not in policy
    assert policy.startswith("default-src 'none'")


def test_a_script_that_would_end_its_element_is_refused(monkeypatch):
    from looping_pendulum.pages import shell

    with pytest.raises(ValueError, match="end its element early"):
        shell.page(shell.SHARED_PACKAGE, "report.html", title="t", scripts=["'</script>'"])


@pytest.mark.long
@pytest.mark.parametrize("name", ["comparison", "identification"])
def test_plotly_knows_every_key_of_our_figures(name):
    from plotly.graph_objects import Figure as Plotly

    made = charts(small_result()) if name == "comparison" else identification_figures.charts(identification("calm"))
    figures = [on_page(chart) for chart in made]
    for figure in figures:
        traces = [_with_plain_colours(trace) for trace in figure["traces"]]
        assert Plotly({"data": traces, "layout": _with_plain_colours(figure["layout"])}).data
    assert len({figure["id"] for figure in figures}) == len(figures)


def _with_plain_colours(value):
    """Names of colours are the page's own; plotly's check knows hex."""
    if isinstance(value, dict):
        return {key: _with_plain_colours(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_with_plain_colours(inner) for inner in value]
    return "#123456" if isinstance(value, str) and value.startswith(("var(--", "faint var(--")) else value


def test_figures_have_no_nan_and_escape_names():
    assert plain([1.23456789, float("nan"), float("inf")]) == [1.23457, None, None]
    assert escaped("<b>&") == "&lt;b&gt;&amp;"
    assert json.loads(embedded({"y": plain([1.0, float("nan")])})) == {"y": [1.0, None]}


@pytest.mark.long
def test_hostile_names_stand_in_no_page_as_they_are():
    for html in (demo.demo_page(hostile_result()), comparison_page(hostile_result())):
        assert "<script>alert(1)</script>" not in html
        assert "<img src=x" not in html
    assert "<img src=x" not in identified_page(HOSTILE)


def test_a_page_without_trajectories_still_has_its_tables():
    html = comparison_page(dataclasses.replace(small_result(), samples=None))
    assert "Plotly" not in html
    assert html.count("<table>") > 3
