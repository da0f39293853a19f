"""Numbers in README and docs: each is what its stored data say, none is without a source, and a wrong one would be found."""

import json
import re
from pathlib import Path

import pytest

from benchmarks.leaderboard import HEAD
from benchmarks.stored_study import SUMMARY, read
from looping_pendulum.discrepancy.identify import identify
from looping_pendulum.measured.readers import survey
from looping_pendulum.measured.study_io import load as load_study
from looping_pendulum.pages.numbers import GAP
from looping_pendulum.reference_ode.solve import available_integrators
from looping_pendulum.teaching.example_folder import write_example
from looping_pendulum.versions import installed_version
from scripts import docs_numbers, engine_table, measure
from scripts.docs_numbers import Sentence, prose
from tests.discrepancy.blind_study import only_candidates
from tests.discrepancy.real_data import real
from tests.docs_commands import PROJECT

STORED = sorted((PROJECT / "docs" / "data" / "measured").glob("*.json"))
TEST_NAME = re.compile(r"(tests/[\w/]+\.py)::(\w+)")


def test_every_number_is_what_its_source_says_and_every_number_has_one():
    wrong = docs_numbers.problems()
    assert not wrong, "\n".join([*wrong, "to write the numbers again: python -m scripts.docs_numbers"])


def test_the_list_is_no_formality():
    assert len(docs_numbers.sentences()) >= 20
    assert sum(len(s.sources) for s in docs_numbers.sentences()) >= 40


@pytest.mark.parametrize("file", STORED, ids=lambda file: file.stem)
def test_stored_data_say_what_measured_them_when_and_with_which_versions(file):
    tree = json.loads(file.read_text(encoding="utf-8"))
    assert tree["command"] == f"python -m scripts.measure {file.stem}"
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", tree["measured_on"])
    assert {"python", "looping-pendulum", "numpy"} <= set(tree["versions"])
    assert tree["values"]


def test_every_stored_measurement_is_used_and_can_be_made_again():
    names = {source.get("data", "") for s in docs_numbers.sentences() for source in s.sources.values()}
    assert {f"measured/{file.stem}" for file in STORED} == {n for n in names if n.startswith("measured/")}
    assert {file.stem for file in STORED} == set(measure.MEASUREMENTS)


SLOW = ("beads_creep", "example_study", "falling_balls", "newton_tendon", "pymunk_public_calls")
"""Measurements that take more than five seconds of CPU time."""


@pytest.mark.parametrize(
    "name", [pytest.param(m.__name__, marks=pytest.mark.accurate if m.__name__ in SLOW else ()) for m in measure.QUICK]
)
def test_a_measurement_made_again_gives_what_the_pages_say(name):
    """Oracle: the program of today. docs/write-an-engine.md gave a halting time of before its definition had changed."""
    if name == "paper_columns":
        real("paper/trial_10to1.csv")
    stored = json.loads((PROJECT / "docs" / "data" / "measured" / f"{name}.json").read_text(encoding="utf-8"))
    versions = {package: v for package, v in stored["versions"].items() if package != "python"}
    if {package: installed_version(package) for package in versions} != versions:
        pytest.skip("other versions are installed than those that were measured")
    again = measure.MEASUREMENTS[name]()
    used = {
        source["at"]
        for s in docs_numbers.sentences()
        for source in s.sources.values()
        if source.get("data") == f"measured/{name}"
    }
    for at in used:
        # What chains of beads do depends on the last bit of a machine's functions
        assert docs_numbers.value_at(again, at) == pytest.approx(docs_numbers.value_at(stored["values"], at), rel=0.05), at


def test_a_bound_that_a_test_asserts_names_a_test_that_there_is():
    reasons = [reason for entries in docs_numbers.unmeasured_numbers().values() for reason in entries.values()]
    named = [match for reason in reasons for match in TEST_NAME.findall(reason)]
    assert len(named) >= 4
    for file, test in named:
        assert f"def {test}(" in (PROJECT / file).read_text(encoding="utf-8"), test
    assert all(reason.strip() for reason in reasons)


def test_every_row_of_the_verification_page_names_a_test_that_there_is():
    rows = [
        line
        for line in (PROJECT / docs_numbers.VERIFICATION_PAGE).read_text(encoding="utf-8").splitlines()
        if line.startswith("| ")
    ]
    tests = "\n".join(file.read_text(encoding="utf-8") for file in (PROJECT / "tests").rglob("test_*.py"))
    assert len(rows) > 40
    for row in rows[1:]:
        named = re.findall(r"`([^`]+)`", row.rsplit("|", 2)[1]) or (["same"] if "| same |" in row else [])
        assert named, row
        for name in named:
            path, _, function = name.partition("::")
            inside = [PROJECT / path, PROJECT / "looping_pendulum" / path, *(PROJECT / "tests").rglob(Path(path).name)]
            started = (function or path).rstrip("._")
            assert name == "same" or any(p.exists() for p in inside) or f"def {started}" in tests, row


SENTENCE = Sentence(page="x", text="a chain stretches by {size} mm, {share} % of it", sources={})


@pytest.mark.parametrize(
    "text",
    [
        "a chain stretches by 0.13 mm, 40 % of it",
        "a chain\nstretches by 0.13 mm,\n  40 % of it",
        'a chain "\n        "stretches by 0.13 mm, 40 % of it',
    ],
)
def test_a_sentence_is_found_wherever_its_lines_end(text):
    match = SENTENCE.pattern.search(text)
    assert match is not None
    assert (match["size"], match["share"]) == ("0.13", "40")


@pytest.mark.parametrize(
    ("text", "numbers"),
    [
        ("it is 0.13 mm off", ["0.13 mm"]),
        ("RMS of 0.10 / 1.1 / 1.3 mm and 5 %", ["0.10 / 1.1 / 1.3 mm", "5 %"]),
        ("in 4 of 4 seeds", ["4 of 4"]),
        ("0.0129 +/- 0.0006 kg/s", ["0.0129 +/- 0.0006 kg/s"]),
        ("needs 3.2 to 3.8 times that", ["3.2 to 3.8 times"]),
        ("1e-9 m of the 10:1 trial", ["1e-9 m"]),
        ("Python 3.11 to 3.13 and section 2 more", []),
        ("mujoco 4.0.0, seven rows, M1 metres", []),
    ],
)
def test_numbers_with_units_are_seen(text, numbers):
    assert [m[0] for m in docs_numbers.QUANTITY.finditer(text)] == numbers


def test_code_formulas_and_the_written_table_are_no_prose_but_what_a_command_prints_is():
    table = f"{engine_table.BEGIN}\n| 5 mm |\n{engine_table.END}"
    printed = "```text\nit is 7 mm off\n```\n8 mm\n```sh\nrun 9 mm\n```"
    text = f"before $x = 3\\,mm$\n```sh\nrun 4 mm\n```\n$$5 mm$$\n{table}\n6 mm after\n{printed}"
    assert [m[0] for m in docs_numbers.QUANTITY.finditer(prose("x.md", text))] == ["6 mm", "7 mm", "8 mm"]


def test_a_wrong_number_a_lost_sentence_and_a_number_without_source_are_found(tmp_path, monkeypatch):
    """Oracle: a page, data and a list made for this test, with one fault of each kind."""
    (tmp_path / "docs" / "data" / "measured").mkdir(parents=True)
    data = {"values": {"stretch": 1.336e-4, "runs": [{"what": "a", "x": 0.5}, {"what": "b", "x": 262.4}]}}
    (tmp_path / "docs" / "data" / "measured" / "chain.json").write_text(json.dumps(data))
    page = "The chain stretches by 0.2 mm;\nits run b is 262 m off. It took 7 s.\n"
    readme = f"{engine_table.BEGIN}\n{engine_table.END}\n"
    (tmp_path / "docs" / "page.md").write_text(page)
    (tmp_path / "README.md").write_text(readme)
    (tmp_path / "docs" / "rates.md").write_text("")
    listed = """
pages:
  docs/page.md:
    - {text: "stretches by {s} mm", s: {data: measured/chain, at: stretch, times: 1e3}}
    - {text: "its run b is {x} m off", x: {data: measured/chain, at: "runs[what=b]/x"}}
    - {text: "a sentence of {y} mm that is not there", y: {data: measured/chain, at: stretch}}
given: {}
"""
    (tmp_path / "docs" / "data" / "numbers.yaml").write_text(listed)
    monkeypatch.setattr(docs_numbers, "PROJECT", tmp_path)
    monkeypatch.setattr(docs_numbers, "DATA", tmp_path / "docs" / "data")
    monkeypatch.setattr(docs_numbers, "NUMBERS_FILE", tmp_path / "docs" / "data" / "numbers.yaml")
    monkeypatch.setattr(engine_table, "table", lambda: "| table |")
    caches = (docs_numbers._load_numbers_file, docs_numbers._load_data_file, docs_numbers.sentences)
    for cache in caches:
        cache.cache_clear()
    try:
        messages = docs_numbers.problems()
        assert len(messages) == 4
        assert any("says 0.2 for s" in line and "the data say 0.13" in line for line in messages)
        assert any("found no 'a sentence of {y} mm" in line for line in messages)
        assert any("It took 7 s" in line and "no source" in line for line in messages)
        assert any("table of engines" in line for line in messages)
        assert docs_numbers.rewrite() == ["docs/page.md", "README.md"]
        assert (tmp_path / "docs" / "page.md").read_text() == page.replace("0.2 mm", "0.13 mm")
        assert "| table |" in (tmp_path / "README.md").read_text()
        assert len(docs_numbers.problems()) == 2  # the lost sentence and the number without a source stay
    finally:
        for cache in caches:
            cache.cache_clear()


def test_the_table_of_engines_has_a_row_per_variant_and_profile():
    lines = engine_table.table().splitlines()
    assert len(lines) == 2 + sum(len(profiles) for _, profiles in engine_table.ROWS.values())
    assert len({line.count("|") for line in lines}) == 1
    assert "never halts" in next(line for line in lines if "tendon as documented" in line)


@pytest.mark.long
def test_readme_leaderboard_and_study_state_one_cost_and_one_error_per_variant():
    """README had 6.8 CPU s per simulated second for pymunk:chain, the leaderboard 4.6 and the page of releases 9 per run."""
    readme = {}
    for line in (PROJECT / "README.md").read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if cells[1:2] == ["quick"]:
            readme[cells[0]] = cells[-1]
    board = (PROJECT / "docs" / "leaderboard.md").read_text(encoding="utf-8")
    costs = {}
    for row in re.findall("<tr>(.*)</tr>", board)[1:]:
        cells = re.findall("<td[^>]*>([^<]*)</td>", row)
        costs[cells[0]] = cells[HEAD.index("cost")]
    agree = [name for name, (title, _) in engine_table.ROWS.items() if costs[name] == readme[title]]
    assert {name for name in engine_table.ROWS if costs[name] != GAP} <= set(agree)
    assert len(agree) >= 8
    assert "CPU [s]" not in (PROJECT / "docs" / "versions.md").read_text(encoding="utf-8")
    quick = json.loads((engine_table.FOLDER / "quick.json").read_text(encoding="utf-8"))["engines"]
    study = {v.label: v.own for v in read(SUMMARY.read_text(encoding="utf-8")).convergence.variants}
    for name in agree:
        metrics, own = quick[name]["metrics"], study[name]
        pairs = (metrics["rms_0.7s"], own.rms["path_0.7s"]), (metrics["halting_time_error"], own.halting_time_error)
        for found, other in pairs:
            assert (found is None and other is None) or found == pytest.approx(other, rel=1e-3), name


@pytest.mark.long
@pytest.mark.skipif("heyoka" not in available_integrators(), reason="these fits would take many minutes with SciPy")
def test_the_verdict_that_the_page_on_tracker_shows_is_todays(tmp_path):
    """Only `-m accurate` repeats the whole search; the page said 0.00511 when it had become 0.00508.

    What is fitted and said of the effect that is found does not need the other candidates.
    """
    write_example(tmp_path / "example")
    with only_candidates(("side_force",)):
        result = identify(load_study(tmp_path / "example" / "study.yaml"))
    page = " ".join((PROJECT / "docs" / "tracker.md").read_text(encoding="utf-8").split())
    assert f"{result.verdict.value}: {result.sentence}" in page


def test_the_tracks_of_plain_tables_are_those_that_the_first_steps_name(tmp_path):
    page = " ".join((PROJECT / "docs" / "start.md").read_text(encoding="utf-8").split())
    for columns, said in (
        ("x1 y1 x2 y2", "a plain table with the columns `x1`, `y1`, `x2`, `y2` has the tracks {}"),
        ("red_x red_y", "one with `red_x`, `red_y` the track {}"),
        ("light_x light_y", "contains the word {} or `heavy`, as in the columns `light_x`, `light_y`"),
    ):
        names = columns.split()
        rows = [",".join(["t", *names]), *(",".join([str(t), *["1.5"] * len(names)]) for t in (0.0, 0.1, 0.2))]
        (tmp_path / "table.csv").write_text("\n".join(rows))
        tracks = " and ".join(f"`{track.name}`" for track in survey(tmp_path / "table.csv").tracks)
        assert said.format(tracks) in page
