"""The result object: JSON and back, the same bytes, tolerances, the report, and the files."""

import dataclasses
import json
import math
import os
import sys

import numpy as np
import pytest
from markdown_it import MarkdownIt

from looping_pendulum.compare import compare, write
from looping_pendulum.compare.report import comparison_markdown, render_page
from looping_pendulum.compare.result import ComparisonResult, ToleranceOutcome
from looping_pendulum.compare.trajectories import CSV_HEADER
from looping_pendulum.engines.registry import styles
from looping_pendulum.errors import MissingPackageError
from looping_pendulum.files import write_atomically
from looping_pendulum.pages.palette import COLOURS
from looping_pendulum.runs.trajectory import RunStatus


def without_clock(text):
    tree = json.loads(text)
    del tree["clock"]
    return json.dumps(tree)


def test_json_there_and_back(measured_scenario, reference, make_run, missing, table, limit):
    scenario = dataclasses.replace(measured_scenario, tolerances=(limit("rms_0.7s", 1e-3),))
    odd = make_run(shift=(5e-3, 0.0), settings={"b": (1, 2.0), "a": math.inf, "c": RunStatus.CRASHED, "d": np.float32(0.5)})
    result = compare(scenario, reference, [odd, missing], table)
    text = result.to_json()
    assert ComparisonResult.from_json(text) == result
    assert ComparisonResult.from_json(text).to_json() == text
    tree = json.loads(text)
    assert tree["schema"] == {"id": "looping-pendulum/comparison", "version": 4}
    assert list(tree)[0] == "schema"
    assert list(tree)[-1] == "clock"
    assert "samples" not in tree
    assert tree["engines"][0]["provenance"]["settings"] == {"a": None, "b": [1, 2.0], "c": RunStatus.CRASHED.value, "d": 0.5}


def test_same_input_same_bytes_but_for_the_clock(scenario, reference, make_run):
    first = compare(scenario, reference, [make_run(wall_time=1.0)])
    second = compare(scenario, reference, [make_run(wall_time=2.0)])
    assert first.to_json() != second.to_json()
    assert without_clock(first.to_json()) == without_clock(second.to_json())


def test_json_has_no_nan(scenario, reference, make_run, missing):
    run = make_run(wall_time=math.nan)
    run.string_stretch[:] = np.nan
    text = compare(scenario, reference, [run, missing]).to_json()
    json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} in the JSON"))


def test_a_missing_engine_is_a_gap_that_does_not_fail(scenario, reference, make_run, missing, limit):
    tolerances = (
        limit("rms_0.7s", 1e-9),
        limit("rms_0.7s", 1e-3, engine="pybullet:chain"),
        limit("rms_0.7s", 0.0, engine="x:y"),
    )
    result = compare(dataclasses.replace(scenario, tolerances=tolerances), reference, [make_run(), missing])
    assert [t.outcome for t in result.tolerances] == [ToleranceOutcome.NOT_RUN, ToleranceOutcome.PASSED], (
        "an engine not asked for is left out"
    )
    assert result.within_tolerance
    report = comparison_markdown(result)
    assert report.count("not run: the engine is not installed") == 1
    assert "Not run: pybullet:chain" in report


def test_a_crash_fails_unless_it_is_expected(scenario, reference, make_run, limit):
    crashed = make_run(until=0.5, status=RunStatus.CRASHED, message="segmentation\nfault | `core`")
    kept = dataclasses.replace(scenario, tolerances=(limit("rms_0.35s", 1e-3),))
    result = compare(kept, reference, [crashed])
    assert result.tolerances[0].outcome is ToleranceOutcome.PASSED
    assert not result.within_tolerance
    report = comparison_markdown(result)
    assert "**no**: the engine's process died" in report
    assert "broke off at 0.500 s" in report
    assert "`fault | 'core'`" in report
    expected = dataclasses.replace(scenario, tolerances=(limit("rms_1.0s", 1e-3, "dies at 0.5 s"),))
    assert compare(expected, reference, [crashed]).within_tolerance


def test_the_report_begins_with_the_verdict(measured_scenario, reference, make_run, table):
    report = comparison_markdown(compare(measured_scenario, reference, [make_run(shift=(3e-3, 0.0))], table))
    heads = [line for line in report.splitlines() if line.startswith("#")]
    assert heads[:4] == ["# Made up", "## Verdict", "## Where, when and why", "## Figures"]
    assert heads[-1] == "## Words"
    assert "| pymunk:chain, quick | no limits declared | – | 3 | 3 | 3 | 0.3375 |" in report
    assert "| halting time | s | 0.35 | 0.34 (-11) | 0.3375 (-14) | 0.3375 (-14) |" in report
    assert "| wrap angle at halt | rad | – | 4 | 3.980 (-20) |" in report
    assert "| x1 extremum 99 | s | 0.34 | 0.34 (+0) | – | – |" in report


def test_without_the_measured_table_the_report_says_how_to_give_it(measured_scenario, scenario, reference, make_run):
    assert "--data DIR" in comparison_markdown(compare(measured_scenario, reference, [make_run()]))
    assert "--data DIR" not in comparison_markdown(compare(scenario, reference, [make_run()]))


def test_every_table_of_the_report_is_rectangular(measured_scenario, reference, make_run, missing, table, limit):
    scenario = dataclasses.replace(measured_scenario, tolerances=(limit("rms_0.7s", 1e-3),))
    report = comparison_markdown(compare(scenario, reference, [make_run(), make_run(profile="accurate"), missing], table))
    widths = [line.replace("\\|", "").count("|") if line.startswith("|") else 0 for line in report.splitlines()]
    assert all(a == b for a, b in zip(widths, widths[1:], strict=False) if a and b)
    assert "pymunk:chain (accurate)" in report


@pytest.mark.long
def test_write_makes_whole_files(tmp_path, measured_scenario, reference, make_run, missing, table):
    result = compare(measured_scenario, reference, [make_run(shift=(3e-3, 0.0)), missing], table)
    report = write(result, tmp_path)
    assert report == tmp_path / "report.md"
    files = sorted(str(p.relative_to(tmp_path)) for p in tmp_path.rglob("*") if p.is_file())
    assert files == [
        "figures/divergence.png",
        "figures/drop.png",
        "figures/events.png",
        "figures/path.png",
        "report.html",
        "report.md",
        "result.json",
        "trajectories/pymunk-chain-quick.csv",
        "trajectories/reference.csv",
    ]
    assert ComparisonResult.from_json((tmp_path / "result.json").read_text()) == result
    assert all(f"({name})" in report.read_text() for name in files if name.startswith("figures"))
    header, *lines = (tmp_path / "trajectories/pymunk-chain-quick.csv").read_text().splitlines()
    assert header.split(",") == CSV_HEADER
    assert len(lines) == 1051
    t, x = (float(cell) for cell in lines[700].split(",")[:2])
    assert t == 0.7
    assert x == pytest.approx(make_run().light_position[700, 0] + 3e-3, abs=1e-9)
    assert lines[700].endswith(",,,"), "unknown tensions and mode are empty cells"


def test_a_result_from_json_can_be_reported(tmp_path, scenario, reference, make_run):
    again = ComparisonResult.from_json(compare(scenario, reference, [make_run()]).to_json())
    assert "without the trajectories" in write(again, tmp_path).read_text()
    assert not (tmp_path / "trajectories").exists()


def test_a_crash_while_writing_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "report.md"
    write_atomically(path, "old")

    def fail(*_):
        raise OSError("disk full")

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(OSError, match="disk full"):
        write_atomically(path, "new")
    assert [p.name for p in tmp_path.iterdir()] == ["report.md"]
    assert path.read_text() == "old"


def test_styles_are_distinct_and_do_not_depend_on_the_order():
    labels = [f"engine:{k}" for k in range(2 * len(COLOURS))]
    look = styles(labels)
    assert look == styles(reversed(labels))
    assert len({(s.colour, s.dashes) for s in look.values()}) == len(labels)
    assert len({s.colour for s in styles(labels[: len(COLOURS)]).values()}) == len(COLOURS)
    assert "#000000" not in COLOURS


def test_metrics_as_rows_and_as_a_table(scenario, reference, make_run, missing, monkeypatch):
    result = compare(scenario, reference, [make_run(shift=(3e-3, 0.0)), missing])
    first, second = result.rows()
    assert (first["engine"], first["profile"], first["status"]) == ("pymunk:chain", "quick", "FINISHED")
    assert first["rms_0.7s"] == pytest.approx(3e-3)
    assert second["rms_0.7s"] is None
    frame = result.to_frame()
    assert list(frame.columns) == list(first)
    assert frame["rms_0.7s"].isna().tolist() == [False, True]
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(MissingPackageError, match=r"to_frame: pandas is not installed; `rows\(\)` gives .*install pandas`"):
        result.to_frame()


HOSTILE = "<script>alert(1)</script> ![x](http://evil/x.png) \\<b> | [y]: http://evil"


def test_what_comes_from_files_is_no_markup(scenario, reference, make_run, limit):
    """Titles with HTML reached the Markdown as they were, which most renderers show."""
    hostile = dataclasses.replace(
        scenario, title=HOSTILE, description=f"{HOSTILE}\n{HOSTILE}",
        tolerances=(dataclasses.replace(limit("rms_0.7s", 1.0), reason=HOSTILE),),
    )  # fmt: skip
    settings = {HOSTILE: HOSTILE}
    result = compare(hostile, reference, [make_run(message=f"x\n`{HOSTILE}", settings=settings)])
    text = comparison_markdown(dataclasses.replace(result, measured_source=HOSTILE))
    rendered = MarkdownIt("commonmark").enable("table").render(text)
    assert "alert(1)" in rendered
    for tag in ("<script", "<b>", "<a ", 'src="http'):
        assert tag not in rendered
    page = render_page(result, [])
    assert "<script>alert" not in page
    assert "<b>" not in page
