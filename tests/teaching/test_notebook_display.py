"""What a notebook shows of results: their numbers, and hostile text as text."""

import dataclasses
from importlib import import_module

import pytest

from looping_pendulum import notebook
from looping_pendulum.compare.comparison import compare
from looping_pendulum.discrepancy.result import Verdict
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.reference import Reference
from looping_pendulum.engines.registry import select
from looping_pendulum.notebook import FORMATTERS
from looping_pendulum.reference_ode.solve import solve
from looping_pendulum.scenarios import load
from tests.pages.made_up import identification

HOSTILE = "<script>alert(1)</script> | [x](javascript:alert(2)) `<b>` <img src=x onerror=alert(3)>"
SCENARIO = load("ten_to_one")


@pytest.fixture(scope="module")
def run():
    return select(["mujoco:capstan"], Profile.QUICK)[0].simulate(SCENARIO)


def harmless(page):
    assert "<script" not in page
    assert "<img" not in page
    assert "<b>" not in page
    assert "<a " not in page
    return page


def test_a_scenario_shows_its_numbers_with_units():
    page = harmless(notebook.scenario(dataclasses.replace(SCENARIO, title=HOSTILE, description=HOSTILE)))
    assert "<td>light.mass</td>\n<td>10 g</td>" in page
    assert "<td>release.angle</td>\n<td>113.08 deg</td>" in page
    assert "alert(3)" in page
    assert page.count("<tr>") > 20  # tolerances too


def test_an_exact_run_shows_its_events():
    page = notebook.reference_run(solve(SCENARIO.parameters))
    assert "halts after 0.381" in page
    assert page.count("<tr>") == 1 + 3  # release, stop, and the light mass reaches the rod
    assert "never halts" in notebook.reference_run(solve(load("frictionless").parameters))


def test_an_engines_run_shows_how_it_ended_and_who_supplied_what(run):
    page = harmless(notebook.trajectory(dataclasses.replace(run, message=HOSTILE)))
    assert "mujoco:capstan on ten_to_one, quick" in page
    assert "1051 samples" in page or "samples to 1.050 s" in page
    assert "<td>friction law</td>\n<td>adapter</td>" in page
    nothing = dataclasses.replace(run, t=run.t[:0], heavy_position=run.heavy_position[:0])
    assert "samples" not in notebook.trajectory(nothing)


def test_a_comparison_shows_its_verdict(run):
    scenario = dataclasses.replace(SCENARIO, title=HOSTILE)
    page = harmless(notebook.comparison(compare(scenario, Reference(scenario), [run])))
    assert "Within tolerance" in page
    assert "mujoco:capstan" in page


def test_a_verdict_shows_its_sentence_and_errors():
    made = identification(HOSTILE)
    result = dataclasses.replace(
        made, verdict=Verdict.NO_MISSING_EFFECT, sentence="Nothing was added.", effects=(), explanations=(), unlisted=None
    )
    page = harmless(notebook.identification(result))
    assert "Nothing is missing" in page
    assert "Nothing was added." in page


def test_every_class_that_is_shown_is_where_ipython_looks_for_it():
    for module, name in FORMATTERS:
        assert hasattr(import_module(module), name)
