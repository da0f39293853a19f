"""The page's tables of texts: the same keys and values in each language, none unused, none missing."""

import re
from pathlib import Path

import pytest

import looping_pendulum.live
from looping_pendulum.live.models import live_effects
from looping_pendulum.reference_ode.effects import LIBRARY
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios import shipped

ASSETS = Path(looping_pendulum.live.__file__).parent / "assets"
PREFERENCES = [["de-AT", "en"], ["fr", "de"], ["en-GB", "de"], ["zh"], []]


@pytest.fixture(scope="module")
def texts(node):
    return node("texts.mjs", PREFERENCES)


@pytest.fixture(scope="module")
def sources():
    """The page's own sources without the tables."""
    files = [*ASSETS.glob("*.html"), *(path for path in ASSETS.rglob("*.js") if path.parent.name != "texts")]
    return "\n".join(path.read_text(encoding="utf-8") for path in files)


def of_scenarios(keys):
    return {key for key in keys if key.startswith("scenario.")}


def placeholders(words):
    return sorted(set(re.findall(r"\{(\w+)\}", words)))


def test_every_language_has_the_same_keys_with_the_same_values(texts):
    english = texts["languages"]["en"]
    assert len(texts["languages"]) >= 2
    # The English words about a scenario are those of its file
    assert not of_scenarios(english)
    of_shipped = {f"scenario.{name}.{part}" for name in shipped() for part in ("title", "description")}
    for language, table in texts["languages"].items():
        expected = english.keys() | (of_shipped if language != "en" else set())
        assert table.keys() == expected, language
        for key, words in english.items():
            assert placeholders(table[key]) == placeholders(words), (language, key)
        assert all(words.strip() for words in table.values()), language


def test_no_text_is_unused_and_none_is_missing(texts, sources):
    keys = set(texts["languages"]["en"])
    columns = re.findall(r'"(\w+)"', re.search(r"for column in \(([^)]*)\)", sources)[1])
    absent = {effect.name for effect in LIBRARY} - {effect.name for release in Release for effect in live_effects(release)}
    families = texts["families"] | {"column": columns, "effect": sorted(absent)}
    members = {f"{family}.{member}" for family, names in families.items() for member in names}
    assert all(f"{family}.${{" in sources for family in texts["families"])
    assert members <= keys
    assert {key for key in keys if key.partition(".")[0] in families and "." in key} == members
    written = set(re.findall(r'"([\w.]+)"', sources)) | {"decimalSign", "language"}
    assert keys - members - written == set()
    of_elements = re.findall(r'data-(?:text|label|tip|hint)="([^"{]+)"', sources)
    in_scripts = re.findall(r'\btext\("([^"]+)"', sources)
    assert len(of_elements) > 50
    assert len(in_scripts) > 50
    assert {*of_elements, *in_scripts} <= keys


def test_the_first_language_that_a_reader_prefers_and_the_page_has(texts):
    assert texts["preferred"] == ["de", "de", "en", "en", "en"]
