"""--json prints one document and nothing else on standard output; --quiet prints errors only."""

import inspect
import json

import pytest

from looping_pendulum.cli.main import app
from looping_pendulum.reference_ode.solve import solve
from looping_pendulum.scenarios import load
from tests.command_line import here
from tests.compare.conftest import quick_figures  # noqa: F401, a fixture

MAP = "title: Three\nscenario: ten_to_one\nparameters:\n  mass_ratio: [2, 5, 10]\n"


def document(*arguments, status=0):
    """The results of a command with --json; reading them fails if anything else is printed, or a number is not finite."""
    done = here(*arguments, "--json")
    assert done.returncode == status, done.stderr
    return json.loads(done.stdout, parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))


def test_lists_are_the_same_as_in_their_tables():
    for command in ("scenarios", "map", "engines"):
        (rows,) = [rows for rows in document(command).values() if isinstance(rows, list)]
        table = here(command).stdout
        assert len(rows) > 3
        for row in rows:
            assert row[command.removesuffix("s")] in table
    assert {len(rows) > 0 for rows in document("engines", "--support")["tables"]} == {True}


def test_a_scenario_as_json_is_its_file():
    assert document("scenarios", "drop")["light"]["mass"] == "10 g"
    assert document("map", "quick", "--print")["scenario"] == "ten_to_one"


def test_a_run_as_json_has_its_events_in_si_units():
    (run,) = document("run", "two_to_one")["runs"]
    reference = solve(load("two_to_one").parameters)
    (halt,) = [event["time"] for event in run["events"] if event["name"] == "halt"]
    assert halt == pytest.approx(reference.halting_time, abs=1e-9)
    assert run["status"] == "FINISHED"


@pytest.mark.long
def test_a_check_as_json_has_every_limit_and_its_outcome(tmp_path):
    limit = "tolerances: {reference: {quick: {tube_fraction: {limit: %s, reason: a test}}}}\n"
    text = here("scenarios", "drop").stdout
    path = tmp_path / "mine.yaml"
    path.write_text(text[: text.index("tolerances:")] + limit % "1.5")
    results = document("check", str(path), status=1)
    assert results["within_tolerance"] is False
    (judged,) = results["tolerances"]["mine"]
    assert (judged["metric"], judged["limit"], judged["outcome"]) == ("tube_fraction", 1.5, "fail")
    path.write_text(text[: text.index("tolerances:")])
    assert document("check", str(path), status=2)["within_tolerance"] is None


@pytest.mark.usefixtures("quick_figures")
def test_a_comparison_as_json_is_the_result_file(tmp_path):
    results = document("compare", "drop", "-e", "reference", "--out", str(tmp_path))
    stored = json.loads((tmp_path / "result.json").read_text())
    del stored["schema"]
    assert results["result"] == stored
    assert results["report"] == str(tmp_path / "report.md")


def test_a_map_as_json_counts_its_runs_and_quiet_leaves_out_its_progress(tmp_path):
    (tmp_path / "map.yaml").write_text(MAP)
    arguments = ("map", str(tmp_path / "map.yaml"), "--out", str(tmp_path / "out"), "--no-figures", "--jobs", "1")
    done = here(*arguments, "--json", "--quiet")
    assert (done.returncode, done.stderr) == (0, "")
    outcome = json.loads(done.stdout)["outcome"]
    assert outcome["runs_now"] == 3
    assert outcome["summaries"][0]["runs"] == 3
    assert "3 runs" in here(*arguments).stderr  # what quiet left out; the runs are stored already


@pytest.mark.long
def test_quiet_prints_nothing_but_errors():
    done = here("run", "drop", "--quiet")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    done = here("run", "drop", "--quiet", "--engine", "nope")
    assert (done.returncode, done.stdout) == (2, "")
    assert "no engine is called 'nope'" in done.stderr
    # The choice ends with its command, also where the next one in the same process has no such option
    assert here("--version").stdout.startswith("looping-pendulum ")
    assert "drop" in here("scenarios", "drop").stdout


def test_every_command_with_results_offers_json():
    offering = {
        command.name or command.callback.__name__.strip("_")
        for command in app.registered_commands
        if "as_json" in inspect.signature(command.callback).parameters
    }
    assert offering == {
        "scenarios", "engines", "run", "compare", "check", "conformance", "converge", "map", "track", "identify",
    }  # fmt: skip
