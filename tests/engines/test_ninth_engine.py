"""An engine is one folder: one from outside is found in every table, in help and in reports, with its colour and its range."""

import dataclasses
import json
import pickle
import re

import pytest

from looping_pendulum.cli.common import engine_names
from looping_pendulum.compare.run_cache import run_key
from looping_pendulum.engines.facts import EngineFacts
from looping_pendulum.engines.isolation import run_isolated
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.registry import engine, engine_facts, how_to_get, select, styles
from looping_pendulum.pages.palette import COLOUR_NAMES, COLOURS
from looping_pendulum.runs.trajectory import RunStatus
from looping_pendulum.scenarios import load
from scripts.written_pages import engine_facts_page
from tests.apparatus import TEN_TO_ONE
from tests.command_line import here
from tests.engines.bad_engines import GoodEngine
from tests.engines.page_example import blocks, module

ADAPTER = """
from pathlib import Path

from looping_pendulum.engines.facts import read_facts
from looping_pendulum.engines.studies import Ladder, Studies
from tests.engines.bad_engines import GoodEngine

FACTS = read_facts(Path(__file__).with_name("engine.json"))


class Ninth(GoodEngine):
    name = "ninth"
    variant = "rest"

    def studies(self):
        return Studies(ladders=(Ladder("time_step", "s", (1e-3, 5e-4)),))


def engines(profile):
    return [Ninth("rest", profile)]
"""
FACTS = {
    "title": "The Ninth",
    "packages": {"ninth_physics": {"pip": "ninth-physics", "systems": "everywhere but on Mars"}},
    "variants": {
        "rest": {
            "colour": "purple",
            "symbol": "s",
            "additions": [{"what": "a nudge", "errors": [1e-3, 2e-3], "errors_without": None}],
            "measured": [
                {
                    "profile": "quick",
                    "scenarios": 12,
                    "failed": 2,
                    "releases": ["looping"],
                    "bounds": {"mass ratio M2/M1": [2.0, 8.0]},
                    "errors": {"rms_0.7s": {"count": 10, "median": 0.011, "ninety": 0.022, "worst": 0.033}},
                }
            ],
        }
    },
}


@pytest.fixture
def ninth(offer, tmp_path):
    """Install the ninth engine with its facts."""
    (tmp_path / "engine.json").write_text(json.dumps(FACTS))
    offer(ninth=ADAPTER)


@pytest.mark.usefixtures("ninth")
def test_it_is_found_in_every_table_and_help():
    assert "ninth" in engine_names()  # what a shell completes
    listed = here("engines").stdout
    assert "ninth:rest" in listed
    assert "of the package elsewhere" in re.sub(r"\s+", " ", listed)
    support = re.sub(r"[\s│┃]+", " ", here("engines", "--support").stdout)
    assert "10 of 12" in support  # ended properly
    assert "2 to 8" in support
    assert "11 / 22 / 33" in support
    assert "a nudge: without it" in support
    page = engine_facts_page()
    assert "## The Ninth" in page
    assert "### ninth:rest" in page
    assert "a nudge: without it ten_to_one does not come to its proper end" in page
    assert "pip install ninth-physics` (everywhere but on Mars)" in how_to_get("ninth_physics", anywhere=True)


@pytest.mark.usefixtures("ninth")
def test_reports_have_its_colour_and_its_measured_range(tmp_path):
    slot = COLOUR_NAMES.index("purple")
    style = styles(["ninth:rest", "pymunk:chain"])["ninth:rest"]
    assert (style.colour, style.slot) == (COLOURS[slot], slot)
    assert engine_facts("ninth").variant("rest").symbol == style.marker == "s"
    done = here("compare", "ten_to_one", "-e", "ninth", "--out", str(tmp_path / "out"))
    assert done.returncode == 0, done.stderr
    assert "mass ratio M2/M1 10 (measured: 2 to 8)" in (tmp_path / "out" / "report.md").read_text()
    page = (tmp_path / "out" / "report.html").read_text()
    traces = set(re.findall(r'"color":\s*"var\(--run-(\d)\)"', page))
    assert traces == {str(slot)}


@pytest.mark.usefixtures("ninth")
def test_a_user_who_asks_for_it_has_the_engine_itself():
    (stand_in,) = select(["ninth"], Profile.QUICK)
    own = engine("ninth")
    assert isinstance(own, GoodEngine)
    assert not isinstance(stand_in, GoodEngine)
    assert stand_in.abilities.outside_range("quick", TEN_TO_ONE) == ("mass ratio M2/M1 10 (measured: 2 to 8)",)
    assert vars(stand_in.settings) == vars(own.settings)


@pytest.mark.usefixtures("ninth")
def test_a_rung_of_its_ladder_runs_and_is_cached_as_what_it_is():
    (stand_in,) = select(["ninth"], Profile.QUICK)
    (steps,) = stand_in.studies().ladders
    scenario = dataclasses.replace(load("drop"), duration=0.02)
    rungs = [stand_in.with_settings(**changes) for changes in steps.changes]
    run = run_isolated(rungs[1], scenario)
    assert run.status is RunStatus.FINISHED, run.message
    assert run.provenance.settings == {"time_step": 5e-4}
    keys = [run_key(each, scenario) for each in (stand_in, *rungs)]
    assert keys[0] == keys[1] != keys[2]
    assert run_key(pickle.loads(pickle.dumps(stand_in)), scenario) == keys[0]


def test_the_pages_facts_are_facts():
    facts = module("page_of_facts", blocks("python")[-1]).FACTS
    assert isinstance(facts, EngineFacts)
    assert facts.variant("euler").colour in COLOUR_NAMES
