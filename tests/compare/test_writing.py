"""Finished work is never lost to a name, a figure or a folder; a complete report is not written over by an interrupted one."""

import dataclasses
import json
import os
import stat

import numpy as np
import pytest
from typer.testing import CliRunner

from looping_pendulum.cli import common as cli_common
from looping_pendulum.cli import main as cli
from looping_pendulum.compare import compare, figures, write
from looping_pendulum.compare.result import ComparisonResult
from looping_pendulum.discrepancy.report import figures as identify_figures
from looping_pendulum.discrepancy.report import writing
from looping_pendulum.files import (
    OutputError,
    SkippedOutputWarning,
    file_stem,
    file_stems,
    prepare_output_folder,
    utf8,
    write_atomically,
)
from looping_pendulum.pages.drawing import MAX_LABEL_LENGTH
from looping_pendulum.runs.trajectory import RunStatus
from tests.pages import made_up

HOSTILE = ("[/x]", "[bold", "$\\frac{", "$a$", "a" * 260, "_hidden", "half a pair: \ud800", "line\nbreak", "<script>", "|")
"""Names that ended a command after its work: markup of rich, formulas of matplotlib, too long, no characters at all."""


@pytest.mark.long
def test_all_these_names_in_one_report_of_identify(tmp_path):
    """With the figures as they are: names beside the bars, below the axes, and in several lines."""
    each = [made_up.identification(name) for name in HOSTILE]
    of_trials = {what: sum((getattr(one, what) for one in each), ()) for what in ("errors", "events", "trial_figures")}
    name = " ".join(HOSTILE)
    explanations = tuple(one.explanations[1] for one in each)
    whole = dataclasses.replace(each[0], study=name, title=name, explanations=explanations, **of_trials)
    writing.write(whole, tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir() if path.is_file()) == sorted(writing.FILES)
    assert json.loads((tmp_path / "verdict.json").read_text())["study"] == utf8(name).decode()
    assert [path.name for path in (tmp_path / "figures").iterdir()] == ["motion.png"]  # the page has them all
    assert (tmp_path / "report.html").read_text(encoding="utf-8").count("<figure>") == 4 + len(each)


def test_all_these_names_in_one_report_of_compare(tmp_path, scenario, reference, make_run):
    """With the figures as they are: names in titles and legends, each of several lines."""
    short = [name for name in HOSTILE if len(name) < MAX_LABEL_LENGTH]
    assert len(" ".join(short)) > MAX_LABEL_LENGTH - 5  # a title shows all of them, or nearly
    title = " ".join(short)
    runs = [make_run(engine="toy", variant=n, settings={"how": n}, message=n, status=RunStatus.FAILED) for n in HOSTILE]
    result = compare(dataclasses.replace(scenario, name=title, title=title, description=title), reference, runs)
    write(result, tmp_path)
    back = ComparisonResult.from_json((tmp_path / "result.json").read_text())
    assert back.title == utf8(title).decode()
    assert [one.message for one in back.engines] == [utf8(run.message).decode() for run in runs]
    assert len(list((tmp_path / "figures").iterdir())) == 3
    assert len(list((tmp_path / "trajectories").iterdir())) == 1 + len(runs)
    assert (tmp_path / "report.html").exists()


@pytest.mark.usefixtures("quick_figures")
def test_names_that_look_alike_have_files_of_their_own(tmp_path, scenario, reference, make_run):
    """`a/b` beside `a-b`: the second figure, and the second trajectory, was written over the first."""
    runs = [make_run(engine="toy", variant=name, shift=(1e-3 * i, 0.0)) for i, name in enumerate(("a/b", "a-b", "A-b"))]
    write(compare(scenario, reference, runs), tmp_path)
    assert len({path.read_text() for path in (tmp_path / "trajectories").iterdir()}) == 4  # and the reference
    one, other = (made_up.identification(name) for name in ("a/b", "a-b"))
    both = dataclasses.replace(one, trial_figures=one.trial_figures + other.trial_figures, errors=one.errors + other.errors)
    assert len({chart.id for chart in identify_figures.charts(both) if "trial" in chart.id}) == 2


def test_file_names_are_short_distinct_and_as_they_were():
    assert file_stem("pymunk:chain", "quick") == "pymunk-chain-quick"
    stems = file_stems([("a/b",), ("a-b",), ("A-b",), ("b",), ("x" * 300,), ("x" * 301,), ("\ud800",), ("",)])
    assert len({stem.lower() for stem in stems}) == len(stems)
    assert stems[3] == "b"
    assert all(0 < len(f".{stem}.0123456789ab.part.png") < 255 for stem in stems)
    assert stems == file_stems([("a/b",), ("a-b",), ("A-b",), ("b",), ("x" * 300,), ("x" * 301,), ("\ud800",), ("",)])


@pytest.mark.usefixtures("quick_figures")
def test_a_figure_that_cannot_be_made_is_a_warning_and_the_rest_is_there(tmp_path, monkeypatch, scenario, reference, make_run):
    def fail(*_):
        raise ValueError("no such font")

    monkeypatch.setattr(figures, "drop_chart", fail)
    monkeypatch.setattr("looping_pendulum.compare.report.render_page", fail)
    with (
        pytest.warns(SkippedOutputWarning, match="drop.png is left out: ValueError: no such font"),
        pytest.warns(match="report.html"),
    ):
        report = write(compare(scenario, reference, [make_run()]), tmp_path / "compare")
    assert "path.png" in report.read_text()
    assert "drop.png" not in report.read_text()
    monkeypatch.setattr(identify_figures, "trial_chart", fail)
    with pytest.warns(SkippedOutputWarning, match="trial-one.png"):
        writing.write(made_up.identification("one"), tmp_path / "identify")
    assert [path.name for path in (tmp_path / "identify" / "figures").iterdir()] == ["motion.png"]
    page = (tmp_path / "identify" / "report.html").read_text()
    assert 'id="explanations"' in page
    assert 'id="trial-one"' not in page


@pytest.mark.parametrize("stop", [MemoryError, KeyboardInterrupt])
def test_the_verdict_is_written_before_anything_is_drawn(tmp_path, monkeypatch, stop):
    def fail(*_):
        raise stop

    monkeypatch.setattr(identify_figures, "charts", fail)
    with pytest.raises(stop):
        writing.write(made_up.identification("one"), tmp_path)
    assert {"repaired.yaml", "verdict.json"} <= {path.name for path in tmp_path.iterdir()}


def test_a_figure_that_cannot_be_drawn_is_a_warning_and_the_report_is_there(tmp_path):
    """Here the motion of a trial with fewer points by the model than it has."""
    whole = made_up.identification("one")
    t = np.arange(50.0)
    picture = made_up.tracked("one", {"height": t}, t)
    broken = dataclasses.replace(picture, predicted={"before": t[1:], "after": t[1:]})
    with pytest.warns(SkippedOutputWarning, match="trial-one.png is left out: "):
        report = writing.write(dataclasses.replace(whole, trial_figures=(broken,)), tmp_path).read_text()
    assert "trial-one.png" not in report
    assert "## What to do next" in report


def test_a_link_planted_at_a_temporary_name_is_not_followed(tmp_path):
    """The name was `.result.json.PID.part`, and what it pointed to was written over."""
    victim = tmp_path / "victim"
    victim.write_text("mine")
    (tmp_path / f".result.json.{os.getpid()}.part").symlink_to(victim)
    (tmp_path / "result.json").symlink_to(victim)
    before = os.umask(0o022)
    try:
        write_atomically(tmp_path / "result.json", "{}")
    finally:
        os.umask(before)
    assert victim.read_text() == "mine"
    assert (tmp_path / "result.json").read_text() == "{}"
    assert stat.S_IMODE((tmp_path / "result.json").lstat().st_mode) == 0o644


def test_a_folder_is_tried_before_the_work(tmp_path):
    assert prepare_output_folder(tmp_path / "new" / "folder", files=("report.md",)) == tmp_path / "new" / "folder"
    assert list((tmp_path / "new" / "folder").iterdir()) == []
    (tmp_path / "report.md").mkdir()
    (tmp_path / "figures").write_text("")
    for files, folders in ((("report.md",), ()), ((), ("figures",))):
        with pytest.raises(OutputError, match=r"^--out: [^\n]* found a \w+, needed room for a \w+ of that name"):
            prepare_output_folder(tmp_path, files=files, folders=folders)
    for bad in (tmp_path / "figures" / "below", tmp_path / ("x" * 300), tmp_path / "\0"):
        with pytest.raises((OutputError, ValueError)):
            prepare_output_folder(bad)


@pytest.mark.parametrize(
    "command",
    [
        ["compare", "ten_to_one", "--out", "DIR"],
        ["run", "ten_to_one", "--out", "FILE"],
        ["converge", "ten_to_one", "--out", "FILE"],
        ["demo", "--no-open", "--out", "DIR"],
        ["identify", "STUDY", "--out", "DIR"],
        ["demonstrations", "--out", "FILE"],
        ["tracker", "ten_to_one", "--out", "DIR"],
    ],
    ids=lambda command: command[0],
)
def test_commands_notice_before_the_work_that_they_cannot_write(tmp_path, monkeypatch, command):
    """`identify` found out after minutes of fitting that its folder was a file."""

    def work(*_, **__):
        raise AssertionError("the work was begun")

    for place in (
        "looping_pendulum.cli.common.run_and_compare",
        # Before what it imports: a module that is first imported here would keep the patched function after this test
        "looping_pendulum.compare.harness.run_all",
        "looping_pendulum.engines.isolation.run_all",
        "looping_pendulum.compare.convergence.study.study_convergence",
        "looping_pendulum.discrepancy.identify.identify",
        "looping_pendulum.demonstrations.runner.run_demonstration",
        "looping_pendulum.teaching.tracker.find_motion",
    ):
        monkeypatch.setattr(place, work)
    (tmp_path / "dir" / "report.md").mkdir(parents=True)
    (tmp_path / "file").write_text("")
    (tmp_path / "study.yaml").write_text(
        "title: t\napparatus: {light: {mass: 10 g}, heavy: {mass: 100 g}, rod: {radius: 6 mm}}\n"
        "trials: [{file: a.csv, release: {angle: 112 deg, free_length: 58 cm}}]\n"
    )
    places = {"DIR": str(tmp_path / "dir"), "FILE": str(tmp_path / "file"), "STUDY": str(tmp_path / "study.yaml")}
    done = CliRunner().invoke(cli.app, [places.get(word, word) for word in command])
    assert isinstance(done.exception, OutputError), done.output


@pytest.mark.long
@pytest.mark.usefixtures("quick_figures")
def test_an_interrupted_comparison_goes_beside_a_complete_one(tmp_path, monkeypatch, scenario, reference, make_run):
    """Ctrl-C while `compare` ran again left the interrupted report in place of the complete one."""
    whole = compare(scenario, reference, [make_run()])
    cut = compare(scenario, reference, [make_run(until=0.2, status=RunStatus.INTERRUPTED)])
    for result, status in ((whole, 0), (cut, 130), (cut, 130), (whole, 0)):
        monkeypatch.setattr(cli_common, "load_scenario", lambda _: scenario)
        monkeypatch.setattr(cli_common, "run_and_compare", lambda *_, result=result, **__: result)
        done = CliRunner().invoke(cli.app, ["compare", "made_up", "--out", str(tmp_path)])
        assert done.exit_code == status, done.output
        kept = ComparisonResult.from_json((tmp_path / "result.json").read_text())
        assert kept == whole
    assert ComparisonResult.from_json((tmp_path / "interrupted" / "result.json").read_text()) == cut
