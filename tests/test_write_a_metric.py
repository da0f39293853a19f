"""The example of docs/write-a-metric.md, taken from the page and installed; and metrics of other packages that are faulty."""

import json
import os
from functools import partial

import pytest

from looping_pendulum.compare import compare
from looping_pendulum.compare.metrics import metric
from looping_pendulum.errors import ScenarioError
from looping_pendulum.pages.numbers import DisplayUnit
from looping_pendulum.scenarios import load_text
from looping_pendulum.scenarios.metrics import METRICS, MetricWarning
from looping_pendulum.scenarios.scenario import Tolerance
from tests import page_package
from tests.compare.conftest import closed_form, make_run, reference, scenario, times  # noqa: F401, fixtures
from tests.docs_commands import PROJECT
from tests.scenarios.test_errors import GOOD

PAGE = PROJECT / "docs" / "write-a-metric.md"


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    return page_package.install(PAGE, "looping_heavy", tmp_path_factory)


@pytest.fixture(scope="module")
def python(package):
    return partial(page_package.python, package)


@pytest.fixture
def limited(tmp_path):
    """The scenario with the page's limit."""
    path = tmp_path / "mine.scenario.yaml"
    path.write_text(GOOD + page_package.blocks(PAGE, "yaml")[0], encoding="utf-8")
    return path


@pytest.mark.long
def test_a_comparison_has_it_in_every_place(python, limited, tmp_path):
    """One function: its value, its column, its limit, and what editors and the page of metrics show of it."""
    done = python("-m", "looping_pendulum", "compare", str(limited), "-e", "mujoco:capstan", "--out", str(tmp_path))
    assert done.returncode == 0, done.stdout + done.stderr
    result = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    value = result["engines"][0]["metrics"]["heavy_mass_distance"]
    assert 0 < value < 5e-3
    (judged,) = result["tolerances"]
    assert (judged["metric"], judged["limit"], judged["value"], judged["outcome"]) == (
        "heavy_mass_distance",
        5e-3,
        value,
        "pass",
    )
    report = (tmp_path / "report.md").read_text(encoding="utf-8")
    assert "| stretch [mm] | heavy mass off by [mm] |" in report
    assert "| heavy_mass_distance | pass |" in report
    assert "heavy mass off by [mm]" in (tmp_path / "report.html").read_text(encoding="utf-8")
    said = python("-c", "from looping_pendulum.scenarios import json_schema; print(json_schema())")
    assert "Largest distance of the heavy mass's height from the reference's." in said.stdout
    pages = python("-c", "from scripts.written_pages import metrics_page; print(metrics_page())")
    assert "| `heavy_mass_distance` | m | mm | at most | Largest distance" in pages.stdout


@pytest.mark.long
def test_check_and_pytest_judge_it(python, limited):
    limited.write_text(limited.read_text().replace("limit: 5 mm", "limit: 1 nm"))
    done = python("-m", "looping_pendulum", "check", str(limited))
    assert done.returncode == 1
    assert "heavy_mass_distance" in done.stdout
    done = python("-m", "pytest", "-q", "-p", "no:cacheprovider", "-c", os.devnull, str(limited))
    assert done.returncode == 1
    assert "heavy_mass_distance is " in done.stdout
    assert "1 failed, 1 passed" in done.stdout


def test_without_its_package_the_limit_is_refused(limited):
    with pytest.raises(ScenarioError, match="heavy_mass_distance"):
        load_text(limited.read_text(), "mine")
    with pytest.raises(ScenarioError, match="did you mean 'drop_error'"):
        load_text(limited.read_text().replace("heavy_mass_distance", "drop_eror"), "mine")


@pytest.fixture
def registry(monkeypatch):
    """The registry, which forgets afterwards what a test has added."""
    monkeypatch.setattr(METRICS, "_metrics", dict(METRICS))
    return METRICS


def test_a_decorated_function_is_enough_in_a_script(registry, scenario, reference, make_run):  # noqa: F811
    @metric("share", unit="", heading="share", shown_in=DisplayUnit("1", 1.0), has_lower_limit=True, table="verdict")
    def first(run):
        """Share of something.

        At length.
        """
        return 0.25

    (engine,) = compare(scenario, reference, [make_run()]).engines
    assert engine.metrics["share"] == 0.25
    assert list(engine.metrics) == list(registry)
    assert registry["share"].description == "Share of something."
    assert registry["share"].quantity(0.25) == "0.25 1"
    assert Tolerance(engine="a", profile="quick", metric="share", limit=0.1, reason="r").limit == 0.1


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (lambda run: 1 / 0, "ZeroDivisionError: division by zero"),
        (lambda run: "far", "ValueError: could not convert string to float: 'far'"),
        (lambda run: run.no_such, "'ComparedRun' object has no attribute 'no_such'"),
    ],
)
def test_a_function_that_fails_costs_its_own_value(registry, scenario, reference, make_run, value, said):  # noqa: F811
    value.__doc__ = "Something."
    metric("faulty", unit="m", heading="faulty")(value)
    with pytest.warns(MetricWarning, match=said):
        (engine,) = compare(scenario, reference, [make_run()]).engines
    assert engine.metrics["faulty"] is None
    assert engine.metrics["rms_0.7s"] is not None


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_what_is_not_finite_is_no_value(registry, scenario, reference, make_run, value):  # noqa: F811
    @metric(unit="m", heading="h")
    def odd(run):
        """Something."""
        return value

    assert compare(scenario, reference, [make_run()]).engines[0].metrics["odd"] is None


def test_a_name_is_taken_once(registry):
    def another(run):
        """Something."""

    with pytest.raises(ScenarioError, match=r"metric 'rebound': the name is taken by looping_pendulum.compare.metrics.rebound"):
        metric("rebound", unit="m", heading="h")(another)
    metric("mine", unit="m", heading="h")(another)
    metric("mine", unit="m", heading="h")(another)  # a notebook's cell that is run again
    another.__doc__ = ""
    with pytest.raises(ScenarioError, match="'another': found no docstring"):
        metric(unit="m", heading="h")(another)


@pytest.mark.parametrize(
    ("module", "said"),
    [
        ("import sys\nsys.exit(3)\n", "SystemExit: 3"),
        ("raise ValueError('no\\nmore')\n", "ValueError: no more"),
        (
            "from looping_pendulum.compare.metrics import metric\n\n"
            "@metric(unit='m', heading='h')\ndef one(run):\n    'One.'\n\n"
            "@metric(unit='m', heading='h')\ndef rebound(run):\n    'Two.'\n",
            "metric 'rebound': the name is taken by looping_pendulum.compare.metrics.rebound; needed another name",
        ),
    ],
)
def test_a_faulty_package_is_left_out_whole(tmp_path, module, said):
    (tmp_path / "faulty_metrics.py").write_text(module)
    info = tmp_path / "faulty_metrics-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: faulty-metrics\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[looping_pendulum.metrics]\nfaulty = faulty_metrics\n")
    script = "from looping_pendulum.scenarios.metrics import METRICS; print(*METRICS)"
    done = page_package.python(tmp_path, "-c", script)
    assert done.stdout.split() == list(METRICS)
    assert (
        f"the metrics of faulty_metrics of the package faulty-metrics are left out: {said}; correct or uninstall" in done.stderr
    )
