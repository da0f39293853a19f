"""German of what the package says of runs: nothing of its own is left out, and numbers keep their place."""

import ast
import inspect
import re
from importlib.resources import files

import pytest

from looping_pendulum.compare import figures as compare_figures
from looping_pendulum.compare import report as compare_report
from looping_pendulum.compare import stories, trial
from looping_pendulum.compare.landmarks import MIN_REST
from looping_pendulum.compare.stories import EVENT_DESCRIPTIONS, PHYSICS_DESCRIPTIONS, mode_description
from looping_pendulum.discrepancy import verdict_sentence
from looping_pendulum.discrepancy.first_look import check, mistakes, row_times
from looping_pendulum.discrepancy.fit import held_out, residual
from looping_pendulum.discrepancy.report import figures, markdown, next_steps, writing
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.registry import WHERE_IT_INSTALLS, all_engines, how_to_get
from looping_pendulum.engines.trajectory import UNKNOWN_MODE, RunStatus, supplies_as_rows
from looping_pendulum.engines.validated import QUANTITIES, ValidatedRange, outside_range
from looping_pendulum.pages import german
from looping_pendulum.pages import report as pages
from looping_pendulum.pages.figures import on_page
from looping_pendulum.pages.german import german_of, in_german, translated
from looping_pendulum.pages.report import PAGES, glossary
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.reference_ode.transitions import Mode
from looping_pendulum.scenarios import load, shipped
from looping_pendulum.teaching.demo import page_data
from tests.pages import made_up_verdicts
from tests.pages.small import small_result, thick_result

NUMBERS = re.compile(r"\d+(?:[.,]\d+)?")


def digits(text):
    return sorted(number.replace(",", ".") for number in NUMBERS.findall(text))


def of_the_package():
    """Texts that `compare` and `demo` put together from tables, and how each variant supplies friction."""
    yield from (status.value for status in RunStatus)
    yield from EVENT_DESCRIPTIONS.values()
    yield from PHYSICS_DESCRIPTIONS.values()
    yield from (mode_description(mode) for mode in (UNKNOWN_MODE, *Mode))
    yield from (f"get it: {how_to_get(package)}" for package in WHERE_IT_INSTALLS)
    yield from (engine.abilities.supplies.friction_law.how for engine in all_engines(Profile.QUICK))


def test_every_text_of_the_tables_has_its_german():
    assert [text for text in of_the_package() if translated(text) is None] == []
    terms = {text for page in PAGES for term, meaning in glossary(page).items() for text in (term, meaning)}
    assert sorted(terms - german.pieces().keys()) == []


def of_scenarios_and_engines():
    """What a report shows of the shipped scenarios and of the engines, as they say it themselves."""
    for scenario in map(load, shipped()):
        yield from (scenario.title, " ".join(scenario.description.split()), *(i.how for i in scenario.inferred))
        yield from (text for limit in scenario.tolerances for text in (limit.reason, limit.expected_failure) if text)
        if scenario.measured:
            yield scenario.measured.source
    for abilities in (engine.abilities for profile in Profile for engine in all_engines(profile)):
        yield from (text for what, by, how in supplies_as_rows(abilities.supplies) for text in (what, f"**{by}**: {how}"))
        yield from (*abilities.additions, *abilities.from_reference)
    parameters = load("ten_to_one").parameters
    bounds = {quantity.name: (1e-7, 1.5e-6) for quantity in QUANTITIES}
    for releases in (set(Release), {Release.DROP, Release.HELD}):
        measured = ValidatedRange(profile="quick", scenarios=1, failed=0, releases=releases, bounds=bounds, errors={})
        yield "; ".join(outside_range([measured], "quick", parameters))


def test_what_scenarios_and_engines_say_of_themselves_has_its_german_with_the_same_numbers():
    texts = list(dict.fromkeys(of_scenarios_and_engines()))
    assert [text for text in texts if translated(text) is None] == []
    assert [text for text in texts if digits(translated(text)) != digits(text)] == []


def words_of(module):
    """Words that the functions of a module write, without what they put between them."""
    for function in ast.parse(inspect.getsource(module)).body:
        if isinstance(function, ast.FunctionDef):
            for node in (part for statement in function.body for part in ast.walk(statement)):
                text = node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""
                if text != ast.get_docstring(function, clean=False):
                    yield from re.findall(r"\b(?!m[ms]\b)[A-Za-z][A-Za-z ']{4,}", text)  # a unit belongs to its number


def test_all_words_of_stories_are_in_a_piece():
    """What a shipped scenario does not make a story say, another one does."""
    known = "\n".join(german.pieces())
    assert [words for words in words_of(stories) if words.strip() not in known] == []


@pytest.mark.parametrize("result", [small_result, thick_result])
def test_what_a_page_says_of_its_runs_has_its_german_with_the_same_numbers(result):
    data = page_data(result())
    translations = data["translations"]["de"]
    texts = [run[key] for run in data["runs"] for key in ("caption", "story") if run[key] and "faulty" not in run["name"]]
    texts += [run["gap"] for run in data["runs"] if run["gap"]]
    texts += [event["words"] for run in data["runs"] for event in run["events"]]
    assert len(texts) > 4
    for text in texts:
        assert digits(translations[text]) == digits(text), text


@pytest.mark.parametrize(
    ("english", "expected"),
    [
        (
            "First deviates by more than 1 mm at 0.273 s, while the string is slack, 12 ms after the halt; by more than 10 mm "
            "at 0.497 s.",
            "Weicht bei 0,273 s zum ersten Mal um mehr als 1 mm ab; dabei: der Faden ist schlaff, 12 ms nach dem Stillstand; "
            "bei 0,497 s um mehr als 10 mm.",
        ),
        (
            f"the run ends at 0.390 s, less than {MIN_REST * 1e3:.0f} ms after the reference halts at 0.385 s",
            f"die Bewegung endet bei 0,390 s, weniger als {MIN_REST * 1e3:.0f} ms nach dem Stillstand der Referenz bei 0,385 s",
        ),
        ("No motion to compare: an adapter's own words.", None),
        ("Halts on time. Und mehr", None),
        (
            "the model does not predict the held-out trial two b.",
            "das Modell sagt den zurückgehaltenen Versuch two b nicht voraus.",
        ),
    ],
)
def test_a_text_is_translated_whole_or_not_at_all(english, expected):
    assert translated(english) == expected


def test_a_note_may_be_escaped_and_begin_with_a_capital():
    note = "- first: used light\\_x 227; 14 not used: light\\_x: empty cell.\n- Lengths without a unit taken in m.\n"
    assert in_german(note) == (
        "- first: verwendet: light\\_x 227; 14 nicht verwendet: light\\_x: leere Zelle.\n"
        "- Längen ohne Einheit in m angenommen.\n"
    )


def test_each_piece_stands_once_and_keeps_its_numbers():
    rows = [
        line
        for line in files("looping_pendulum.pages").joinpath("german.toml").read_text(encoding="utf-8").splitlines()
        if line[:1] == '"'
    ]
    assert len(rows) == len(german.pieces())
    for english, said in german.pieces().items():
        count = len(re.findall(r"\{[nciew]\}", english))
        assert sorted(re.findall(r"\{(\d)\}", said)) == [str(i) for i in range(count)], english


def english_words():
    """Words of English pieces that no German one has."""
    words = re.compile(r"[a-zäöüß]{2,}")
    english, german_ones = (
        {word for piece in texts for word in words.findall(piece.lower())}
        for texts in zip(*german.pieces().items(), strict=True)
    )
    return english - german_ones


OF_NO_LANGUAGE = re.compile(
    "|".join(
        [
            *(rf"\b{re.escape(name)}" for name in sorted(made_up_verdicts.NAMES, key=len, reverse=True)),
            r"`[^`]*`",  # code
            "„[^“]*“",  # keys of a study
            r"\w+_\w+",  # names in code
            r"\b(?:mm|ms|rad|mrad|m|s|kg|N|deg|SI)\b",
            r"looping-pendulum|[a-z]+\.(?:csv|png|md|yaml|json)",
        ]
    )
)
"""What stands in a German report as in an English one: names, keys, units."""


def left_english(text, words):
    """Words of a German text that are English."""
    return [word for word in re.findall(r"[a-zäöüß]{2,}", OF_NO_LANGUAGE.sub(" ", text).lower()) if word in words]


def test_nothing_that_a_report_of_identify_says_stays_english(monkeypatch):
    """Names stay as they are, and no sentence is taken for one."""
    english, left, sections = english_words(), set(), {}
    whole_or_sentences = german._whole_or_sentences

    def spy(text):
        inner = text.strip()
        if inner and translated(inner) is None:
            left.update(s for s in re.split(r"(?<=[.?!:]) ", inner) if translated(s) is None)
        return whole_or_sentences(text)

    monkeypatch.setattr(german, "_whole_or_sentences", spy)
    for result in made_up_verdicts.identifications():
        for section in (*markdown.before_figures(result), *markdown.after_figures(result)):
            if section not in sections:
                sections[section] = in_german(section)
    assert {one for one in left if OF_NO_LANGUAGE.sub("", one).strip(" .-:+/*0123456789")} == set()
    assert {word: text for text in sections.values() for word in left_english(text, english)} == {}


def test_all_that_a_sentence_or_remark_of_identify_says_has_its_german(monkeypatch):
    monkeypatch.setattr(mistakes, "_header_unit", lambda undone: "cm")
    monkeypatch.setattr(mistakes, "row_shift", lambda declared: row_times.RowShift(columns="light", rows=2))
    english = english_words()
    texts = {*made_up_verdicts.verdict_sentences(), *made_up_verdicts.notes(), *made_up_verdicts.DATA}
    assert len(texts) > 800
    assert [text for text in texts if translated(text) is None] == []
    assert {word: text for text in texts for word in left_english(translated(text), english)} == {}
    assert [text for text in texts if digits(translated(text)) != digits(text)] == []


def test_all_words_of_the_figures_of_identify_are_german():
    english, texts = english_words(), set()
    for result in made_up_verdicts.identifications():
        for chart in figures.charts(result):
            figure = on_page(chart)
            texts |= {figure.caption, *pages._texts(figure.as_dict())}
    known = german_of(texts)
    assert {text for text in texts - known.keys() if not STRUCTURE.fullmatch(text)} == {
        made_up_verdicts.TRIAL,
        made_up_verdicts.OWN,
    }
    assert {word: text for text in known.values() for word in left_english(text, english)} == {}


STRUCTURE = re.compile(
    r"|(?:faint )?var\(--[\w-]+\)|[xy]\d*(?: domain)?|[xy] \[m\]|[\d.]+px,[\d.]+px|%\{text\}|\(%\{customdata.*|domain|"
    r"independent|scatter|lines|markers|lines\+markers|bar|h|left|bottom|below|solid|dot|rect|skip|tonexty"
)
"""Keywords of plotly, and axes of one name in both languages."""


NOT_SHOWN = {
    # Keys of charts, files, commands in code
    "colour", "dashes", "label", "marker", "standardised", "always", "identification", "candidates",
    "files", "engine mujoco", "out compared", "pendulum compare repaired", "pendulum identify", "pendulum run repaired",
    "tracks", "yaml ",
    "LOOPING", "data DIR", "set 'camera", "symlog",
    # Words and titles of pictures in report.md
    "There are none", "because this report was made without the trajectories", "Words", "divergence", "event times",
    "path of the light mass", "error of each trial", "motion of the ", "points and declared motion",
    # Names of mistakes, values of keys, and trials that a first look leaves out
    "axes exchanged", "axes exchanged and reversed", "columns exchanged", "half turn", "light and heavy exchanged",
    "masses exchanged", "quarter turn to the left", "quarter turn to the right", "release place", "rod radius times ",
    "rows shifted", "tracks exchanged", "unit of length", "and '", "free from ", "as its camera's ", "it has events only",
    "may be far from ", "not looked at",
    # What pieces cut elsewhere
    "found the rod's centre near x ", "s by the file's clock",
}  # fmt: skip
"""Words of these modules that no page shows as they are."""


def test_all_words_of_reports_are_in_a_piece():
    """What no made-up result makes a report say, another one does."""
    known = "\n".join(german.pieces())
    modules = (markdown, next_steps, figures, writing, verdict_sentence, check, mistakes, row_times, residual, held_out)
    modules += (compare_report, compare_figures, trial)
    words = {text for module in modules for text in words_of_all(module) if text.strip() not in known}
    assert words - NOT_SHOWN == set()


def words_of_all(module):
    """Words of a module, also those of its tables."""
    tree = ast.parse(inspect.getsource(module))
    docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docstrings:
            yield from re.findall(r"\b(?!m[ms]\b)[A-Za-z][A-Za-z ']{4,}", node.value)
