"""German of what the package says of runs: nothing of its own is left out, and numbers keep their place."""

import ast
import inspect
import re

import pytest

from looping_pendulum.compare import stories
from looping_pendulum.compare.landmarks import MIN_REST
from looping_pendulum.compare.stories import EVENT_DESCRIPTIONS, PHYSICS_DESCRIPTIONS, mode_description
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.registry import WHERE_IT_INSTALLS, all_engines, how_to_get
from looping_pendulum.engines.trajectory import UNKNOWN_MODE, RunStatus, supplies_as_rows
from looping_pendulum.engines.validated import QUANTITIES, ValidatedRange, outside_range
from looping_pendulum.pages import german
from looping_pendulum.pages.german import translated
from looping_pendulum.pages.report import PAGES, glossary
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.reference_ode.transitions import Mode
from looping_pendulum.scenarios import load, shipped
from looping_pendulum.teaching.demo import page_data
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
    ],
)
def test_a_text_is_translated_whole_or_not_at_all(english, expected):
    assert translated(english) == expected


def test_each_piece_keeps_its_numbers():
    for english, said in german.pieces().items():
        count = len(re.findall(r"\{[ncwi]\}", english))
        assert sorted(re.findall(r"\{(\d)\}", said)) == [str(i) for i in range(count)], english
