"""What changed since another run: every kind of change is seen, what is below the threshold is not, bad files are one line."""

import dataclasses
import enum
import json
import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from looping_pendulum.compare import baseline, compare, json_text, write
from looping_pendulum.compare.baseline import ResultChange, changes_since, read_baseline
from looping_pendulum.compare.json_text import JsonResult, plain
from looping_pendulum.compare.report import comparison_markdown
from looping_pendulum.compare.result import ComparisonResult
from looping_pendulum.errors import ResultError
from looping_pendulum.runs.events import Extremum, Landmarks, Stop
from looping_pendulum.runs.trajectory import Provenance, RunStatus

RUN = "pymunk:chain, quick"


def values_by_change(changes):
    return {(c.run, c.what): (c.before, c.after) for c in changes.changes}


def test_the_same_run_again_changed_nothing(scenario, reference, make_run, missing):
    first = compare(scenario, reference, [make_run(shift=(3e-3, 0.0), wall_time=1.0), missing])
    second = compare(scenario, reference, [make_run(shift=(3e-3, 0.0), wall_time=9.0), missing])
    again = ComparisonResult.from_json(first.to_json())
    changes = changes_since(again, second, source="old/result.json")
    assert changes.changes == ()
    assert changes.heading == f"Nothing changed since old/result.json (written {first.clock.written})."


def test_every_kind_of_change_is_listed(scenario, reference, make_run, missing, limit, no_friction):
    old = dataclasses.replace(scenario, tolerances=(limit("rms_0.7s", 4e-3), limit("rms_1.0s", 9e-3)))
    new = dataclasses.replace(
        scenario,
        tolerances=(limit("rms_0.7s", 4e-3), limit("rms_1.0s", 8e-3)),
        parameters=scenario.parameters.replace(light_mass=2 * scenario.parameters.light_mass),
    )
    run = make_run(shift=(3e-3, 0.0), settings={"dt": 1e-3, "solver": {"sweeps": 10}})
    provenance = Provenance(versions={"pymunk": "7.4"}, settings={"dt": 1e-4, "solver": {"sweeps": 20}}, supplies=no_friction)
    worse = make_run(shift=(6e-3, 0.0), until=1.0, status=RunStatus.CRASHED, provenance=provenance)
    before, after = compare(old, reference, [run, missing]), compare(new, reference, [worse, make_run(engine="mujoco")])
    changes = values_by_change(changes_since(ComparisonResult.from_json(before.to_json()), after))
    mass = scenario.parameters.light_mass
    expected = {
        ("scenario", "light_mass"): (mass, 2 * mass),
        ("pybullet:chain, quick", "status"): ("MISSING", None),
        ("mujoco:chain, quick", "status"): (None, "FINISHED"),
        (RUN, "status"): ("FINISHED", "CRASHED"),
        (RUN, "tolerances: rms_0.7s: outcome"): ("pass", "fail"),
        (RUN, "tolerances: rms_1.0s: limit"): (9e-3, 8e-3),
        (RUN, "provenance: versions: pymunk"): ("7.3", "7.4"),
        (RUN, "provenance: settings: dt"): (1e-3, 1e-4),
        (RUN, "provenance: settings: solver: sweeps"): (10, 20),
        (RUN, "provenance: supplies: friction_law: by"): ("engine", "nobody"),
    }
    assert expected.items() <= changes.items()
    was, now = changes[RUN, "metrics: rms_0.7s"]
    assert (was, now) == (pytest.approx(3e-3, rel=1e-6), pytest.approx(6e-3, rel=1e-6))


@pytest.mark.parametrize(("factor", "seen"), [(1 + 4e-16, False), (1 - 1e-12, False), (1 + 1e-6, True)])
def test_the_last_bits_of_a_computed_setting_are_no_change(scenario, reference, make_run, factor, seen):
    # A contact's friction is solved for, and comes out one unit of the last place apart on another processor.
    before, after = (
        compare(scenario, reference, [make_run(settings={"rod": {"friction": 0.34217 * f}})]) for f in (1.0, factor)
    )
    assert ((RUN, "provenance: settings: rod: friction") in values_by_change(changes_since(before, after))) is seen


def test_landmarks_have_bands_of_their_own(scenario, reference, make_run):
    result = compare(scenario, reference, [make_run()])

    def later(halt, truly):
        engine, true = result.engines[0], result.reference
        marks = dataclasses.replace(engine.landmarks, halting_time=engine.landmarks.halting_time + halt, stops=())
        known = dataclasses.replace(true.landmarks, halting_time=true.landmarks.halting_time + truly)
        return dataclasses.replace(
            result,
            engines=(dataclasses.replace(engine, landmarks=marks),),
            reference=dataclasses.replace(true, landmarks=known),
        )

    halt, count = (RUN, "landmarks: halting_time"), (RUN, "landmarks: stops: how many")
    assert halt not in values_by_change(changes_since(result, later(9e-5, 0.0)))
    changes = values_by_change(changes_since(result, later(2e-4, 5e-6)))
    assert changes[halt][1] - changes[halt][0] == pytest.approx(2e-4)
    assert changes[count] == (len(result.engines[0].landmarks.stops), 0)
    assert ("reference", "landmarks: halting_time") in changes


@pytest.mark.long
def test_the_report_has_a_section_and_the_folder_a_file(tmp_path, scenario, reference, make_run):
    before = compare(scenario, reference, [make_run(shift=(3e-3, 0.0))])
    after = compare(scenario, reference, [make_run(shift=(1.5e-3, 0.0))])
    changes = changes_since(before, after, source="old")
    assert ["pymunk:chain, quick", "metrics: rms_0.7s", "3 mm", "1.5 mm", "-50 %", "0.03 mm"] in changes.table()[1]
    report = write(after, tmp_path, changes).read_text()
    heads = [line for line in report.splitlines() if line.startswith("##")]
    assert heads[:3] == ["## Verdict", "## Where, when and why", "## Changes since the baseline"]
    assert "| pymunk:chain, quick | metrics: rms_0.7s | 3 mm | 1.5 mm | -50 % | 0.03 mm |" in report
    tree = json.loads((tmp_path / "changes.json").read_text())
    assert tree["schema"] == {"id": "looping-pendulum/changes", "version": 2}
    assert tree["relative"] == 0.01
    assert {(c["run"], c["what"]) for c in tree["changes"]} >= {(RUN, "metrics: rms_0.7s")}
    assert ComparisonResult.from_json((tmp_path / "result.json").read_text()) == after
    assert "since the baseline" not in comparison_markdown(after)
    assert "Nothing changed" in comparison_markdown(after, changes=changes_since(after, after))


def test_a_baseline_is_a_file_or_its_folder(tmp_path, scenario, reference, make_run):
    result = compare(scenario, reference, [make_run()])
    write(result, tmp_path)
    assert read_baseline(tmp_path, "made_up") == read_baseline(tmp_path / "result.json", "made_up") == result


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda tree: tree["schema"].update(version=99), "needed 4 or less; update looping-pendulum"),
        (lambda tree: tree["schema"].update(id="other"), "needed the id 'looping-pendulum/comparison'"),
        (lambda tree: tree.update(scenario="held"), "found a result of 'held', needed one of 'made_up'"),
        (lambda tree: tree.pop("engines"), "not as documented"),
        (lambda tree: tree["parameters"].pop("light_mass"), "parameters: .*light_mass"),
        (lambda tree: tree["parameters"].update(rod_radius=-1.0), "parameters: .*rod_radius"),
        (lambda tree: tree["parameters"].update(rod_radius="thin"), "parameters: "),
        (lambda tree: tree["parameters"].update(coefficients=[1]), "parameters: "),
    ],
)
def test_what_is_no_baseline_is_one_line(tmp_path, scenario, reference, make_run, edit, message):
    tree = json.loads(compare(scenario, reference, [make_run()]).to_json())
    edit(tree)
    path = tmp_path / "old.json"
    path.write_text(json.dumps(tree))
    with pytest.raises(ResultError, match=message) as caught:
        read_baseline(path, "made_up")
    assert str(caught.value).startswith(f"--baseline: {path}: ")
    assert "\n" not in str(caught.value)


def test_a_missing_or_odd_file_is_one_line(tmp_path):
    with pytest.raises(ResultError, match=r"No such file.*looping-pendulum compare`"):
        read_baseline(tmp_path / "nowhere.json", "made_up")
    (tmp_path / "bytes").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ResultError, match="not text"):
        read_baseline(tmp_path / "bytes", "made_up")


def test_an_older_file_may_lack_a_key_that_has_a_default(scenario, reference, make_run):
    tree = json.loads(compare(scenario, reference, [make_run()]).to_json())
    del tree["engines"][0]["landmarks"]["slip_onsets"]
    assert ComparisonResult.from_json(json.dumps(tree)).engines[0].landmarks.slip_onsets == ()


ME = "pymunk:chain, quick"


@pytest.fixture
def result(scenario, reference, make_run):
    return compare(scenario, reference, [make_run(shift=(3e-3, 0.0))])


def edited(result, *, reference=None, **engine):
    (one,) = result.engines
    true = dataclasses.replace(result.reference, **(reference or {}))
    return dataclasses.replace(result, engines=(dataclasses.replace(one, **engine),), reference=true)


def listed(before, after, **more):
    return [(c.run, c.what, c.unit, c.before, c.after) for c in changes_since(before, after, **more).changes]


def made(*changes, **fields):
    known = {"scenario": "s", "baseline": "old", "baseline_written": "then", "relative": 0.01}
    return baseline.ResultChanges(changes=tuple(changes), **(known | fields))


def change(before, after, unit="m", tolerance=1e-6):
    return ResultChange(run=ME, what="x", unit=unit, before=before, after=after, tolerance=tolerance)


@pytest.mark.parametrize(
    ("one", "row"),
    [
        (change(-2e-3, -3e-3), [ME, "x", "-2 mm", "-3 mm", "-50 %", "0.001 mm"]),
        (change(0.1234567, 0.1, "s"), [ME, "x", "123.457 ms", "100 ms", "-19 %", "0.001 ms"]),
        (change(1.0, 2.0, "rad"), [ME, "x", "1000 mrad", "2000 mrad", "+100 %", "0.001 mrad"]),
        (change(0.0, 0.75, "", 0.0), [ME, "x", "0", "0.75", "", "0"]),
        (change(None, 0.75, ""), [ME, "x", "–", "0.75", "", "1e-6"]),
        (change(0.75, None, "s"), [ME, "x", "750 ms", "–", "", "0.001 ms"]),
        (change(True, False, ""), [ME, "x", "True", "False", "", ""]),
        (change("a", 2.0, ""), [ME, "x", "a", "2", "", "1e-6"]),
        (change(1e-300, 1e300, ""), [ME, "x", "1e-300", "1e300", "", "1e-6"]),
    ],
)
def test_a_row_has_both_values_in_their_unit_and_the_share(one, row):
    assert made(one).table()[1] == [row]


@pytest.mark.parametrize(("count", "said"), [(0, "Nothing changed"), (1, "1 change"), (2, "2 changes"), (11, "11 changes")])
def test_the_heading_counts(result, count, said):
    changes = made(*[change(1, 2)] * count)
    assert changes.heading == f"{said} since old (written then)."
    assert dataclasses.replace(changes, baseline="").heading == f"{said} since the baseline (written then)."
    text = comparison_markdown(result, changes=changes)
    assert f"\n\n{said} since old (written then).\n" in text
    assert text.count(f"| {ME} | x | ") == count


@pytest.mark.parametrize(
    ("was", "now", "seen"),
    [(0.5, 0.5049, False), (0.5, 0.5051, True), (-0.5, -0.5051, True), (-0.5, -0.5049, False), (None, 0.1, True),
     (0.1, None, True), (None, None, False), (0.0, 0.9e-6, False), (0.0, 1.1e-6, True)],
)  # fmt: skip
def test_a_metric_moves_by_one_percent_of_what_it_was_and_by_its_floor(result, was, now, seen):
    known = result.engines[0].metrics
    before, after = (edited(result, metrics=known | {"tube_fraction": value}) for value in (was, now))
    changes = listed(before, after)
    assert changes == ([(ME, "metrics: tube_fraction", "", was, now)] if seen else [])


MARKS = Landmarks(
    stops=(Stop(time=0.2, height_change=-0.1), Stop(time=0.4, height_change=-0.3)),
    slip_onsets=(0.3,),
    halting_time=0.5,
    drop_at_halt=0.25,
    wrap_angle_at_halt=4.0,
    free_length_at_halt=0.3,
    light_reaches_rod=0.9,
    x1_extrema=(Extremum(time=0.1, value=0.2),),
)


@pytest.mark.parametrize(
    ("moved", "what", "unit", "pair"),
    [
        ({"halting_time": 0.50011}, "halting_time", "s", (0.5, 0.50011)),
        ({"halting_time": 0.50009}, None, "", ()),
        ({"drop_at_halt": 0.25011}, "drop_at_halt", "m", (0.25, 0.25011)),
        ({"free_length_at_halt": 0.30009}, None, "", ()),
        ({"wrap_angle_at_halt": 4.0011}, "wrap_angle_at_halt", "rad", (4.0, 4.0011)),
        ({"wrap_angle_at_halt": 4.0009}, None, "", ()),
        ({"light_reaches_rod": None}, "light_reaches_rod", "s", (0.9, None)),
        ({"halting_confirmed": True}, "halting_confirmed", "", (False, True)),
        ({"slip_onsets": ()}, "slip_onsets: how many", "", (1, 0)),
        ({"slip_onsets": (0.3002,)}, "slip_onsets: 1", "s", (0.3, 0.3002)),
        ({"stops": (MARKS.stops[1],)}, "stops: how many", "", (2, 1)),
        ({"stops": (MARKS.stops[0], Stop(time=0.4, height_change=-0.3002))}, "stops: 2: height_change", "m", (-0.3, -0.3002)),
        ({"stops": (Stop(time=0.2002, height_change=-0.1), MARKS.stops[1])}, "stops: 1: time", "s", (0.2, 0.2002)),
        ({"x1_extrema": (Extremum(time=0.1, value=0.2002),)}, "x1_extrema: 1: value", "m", (0.2, 0.2002)),
    ],
)
def test_every_landmark_has_its_unit_and_floor(result, moved, what, unit, pair):
    before, after = (edited(result, landmarks=marks) for marks in (MARKS, dataclasses.replace(MARKS, **moved)))
    assert listed(before, after) == ([] if what is None else [(ME, f"landmarks: {what}", unit, *pair)])


def test_the_references_landmarks_have_finer_floors(result):
    later = dataclasses.replace(result.reference.landmarks, halting_time=result.reference.landmarks.halting_time + 2e-6)
    changes = listed(result, edited(result, reference={"landmarks": later}))
    assert [change[:2] for change in changes] == [("reference", "landmarks: halting_time")]


def test_settings_and_seeds_that_come_and_go_are_changes(result):
    (engine,) = result.engines

    def having(settings, seed=None, versions=None):
        provenance = dataclasses.replace(engine.provenance, settings=settings, seed=seed, versions=versions or {"a": "1"})
        return edited(result, provenance=provenance)

    assert listed(having({"a": 1, "b": {"c": 2}}), having({"b": {"c": 3, "d": 4}}, seed=7)) == [
        (ME, "provenance: settings: b: c", "", 2, 3), (ME, "provenance: settings: b: d", "", None, 4),
        (ME, "provenance: seed", "", None, 7), (ME, "provenance: settings: a", "", 1, None),
    ]  # fmt: skip
    assert listed(having({}, seed=0), having({}, seed=0)) == []
    assert listed(having({"x": 1.0}), having({"x": 1.0 + 2e-9})) == [(ME, "provenance: settings: x", "", 1.0, 1.0 + 2e-9)]
    assert listed(having({"x": 1.0}), having({"x": 1.0 + 0.5e-9})) == []
    assert listed(having({"x": 1.0}), having({"x": 1})) == []
    assert listed(having({"x": True}), having({"x": 1.0})) == []


def test_the_scenario_changes_with_its_duration(result):
    assert listed(result, dataclasses.replace(result, duration=2.0)) == [("scenario", "duration", "", 1.05, 2.0)]


def test_engines_come_first_as_they_are_now_and_then_those_that_are_gone(scenario, reference, make_run):
    old, new = ([make_run(engine=name) for name in names] for names in ("abc", "dcb"))
    before, after = compare(scenario, reference, old), compare(scenario, reference, new)
    changes = [(run, before, after) for run, _, _, before, after in listed(before, after)]
    assert changes == [("d:chain, quick", None, "FINISHED"), ("a:chain, quick", "FINISHED", None)]
    bare = compare(scenario, reference, [make_run(profile="")])
    assert listed(bare, compare(scenario, reference, [])) == [("pymunk:chain", "status", "", "FINISHED", None)]


def test_a_limit_that_is_new_or_gone_is_reported(scenario, reference, make_run, limit):
    one = dataclasses.replace(scenario, tolerances=(limit("rms_0.7s", 4e-3),))
    before, after = compare(one, reference, [make_run()]), compare(scenario, reference, [make_run()])
    gone = [
        (ME, "tolerances: rms_0.7s: limit", "m", 4e-3, None),
        (ME, "tolerances: rms_0.7s: outcome", "", "pass", None),
    ]
    assert listed(before, after) == gone
    assert listed(after, before) == [(*row[:3], row[4], row[3]) for row in gone]
    wider = compare(dataclasses.replace(scenario, tolerances=(limit("rms_0.7s", 5e-3),)), reference, [make_run()])
    assert listed(before, wider) == [(ME, "tolerances: rms_0.7s: limit", "m", 4e-3, 5e-3)]


# ---- files


def test_a_file_that_is_far_too_large_is_not_read(tmp_path, monkeypatch):
    assert json_text.MAX_BYTES == 64 * 2**20
    monkeypatch.setattr(json_text, "MAX_BYTES", 3 * 2**20)
    path = tmp_path / "big.json"
    path.write_bytes(b" " * (3 * 2**20 + 1))
    with pytest.raises(ResultError, match="found more than 3 MiB, needed a result.json"):
        read_baseline(path, "made_up")
    path.write_bytes(b" " * (3 * 2**20))
    with pytest.raises(ResultError, match="line 1"):
        read_baseline(path, "made_up")


def test_an_error_of_a_baseline_names_its_file_once(tmp_path):
    path = tmp_path / "result.json"
    path.write_text("[]")
    for given in (path, tmp_path):
        with pytest.raises(ResultError) as caught:
            read_baseline(given, "made_up")
        assert str(caught.value).startswith(f"--baseline: {path}: schema: found ")
        assert str(caught.value).count("result.json") == 1
    with pytest.raises(ResultError, match=r"Is a directory|No such file"):
        read_baseline(Path("/nowhere"), "made_up")


class Colour(enum.Enum):
    RED = "red"
    BLUE = 2


@dataclass(frozen=True, kw_only=True)
class Inner:
    number: float
    maybe: int | None = None


@dataclass(frozen=True, kw_only=True)
class Outer(JsonResult):
    SCHEMA_ID = "ours"
    SCHEMA_VERSION = 3
    name: str
    flag: bool = False
    pair: tuple[str, float] = ("", 0.0)
    many: tuple[Inner, ...] = ()
    group: dict[str, float | None] = field(default_factory=dict)
    hidden: int = field(default=0, compare=False)


def test_plain_is_what_json_knows():
    encoded = plain({"b": (1, 2.5), 3: {2, 1}, "n": math.nan, "i": -math.inf, "a": np.array([1.0, math.nan]), "e": Colour.BLUE})
    assert encoded == {"3": [1, 2], "a": [1.0, None], "b": [1, 2.5], "e": 2, "i": None, "n": None}
    assert list(encoded) == ["3", "a", "b", "e", "i", "n"]
    assert plain([np.float64(2.0), np.int64(3), np.bool_(True), True, None, "x", Colour]) == [
        2.0, 3, True, True, None, "x", str(Colour),
    ]  # fmt: skip
    assert plain("\ud800") == "\\ud800"
    assert plain(Outer(name="n", hidden=7)) == {"name": "n", "flag": False, "pair": ["", 0.0], "many": [], "group": {}}
    assert plain(Inner) == str(Inner), "a class is no value"


def text(version=1, **tree):
    return json.dumps({"schema": {"id": "ours", "version": version}} | tree)


def read(content):
    return Outer.from_json(content, "f.json")


def test_there_and_back():
    whole = Outer(name="ä", flag=True, pair=("p", 2.0), many=(Inner(number=1.0, maybe=3), Inner(number=0.5)), group={"g": None})
    assert read(whole.to_json()) == whole
    assert whole.to_json().startswith('{\n  "schema": {\n    "id": "ours",\n    "version": 3\n  },\n  "name": "ä",')
    assert whole.to_json().endswith("}\n")
    assert read(text(name="n", many=[{"number": 2}])).many[0] == Inner(number=2.0)
    assert isinstance(read(text(name="n", many=[{"number": 2}])).many[0].number, float)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("{", "f.json: EOF while parsing an object at line 1 column 1; write it again"),
        ("{\n\n x}", "at line 3 column 2"),
        (text(version=4, name="n"), "f.json: schema: found version '4', needed 3 or less; update looping-pendulum"),
        (text(version=0, name="n"), "found version '0', needed 3"),
        (text(version="1", name="n"), "needed 3 or less"),
        ('{"schema": {"id": "others", "version": 1}}', "needed the id 'ours'"),
        ('{"schema": "ours"}', "needed the id 'ours'"),
        ("3", "needed the id 'ours'"),
        (
            text(),
            "f.json: not as documented: name: found a group of keys; field required; write it ",
        ),
        (text(name=3), "not as documented: name: found '3'; input should be a valid string"),
        (text(name="n", flag=1), "flag: found '1'; input should be a valid boolean"),
        (text(name="n", pair=["a", True]), "pair.1: found 'True'; input should be a valid number"),
        (text(name="n", pair={}), "pair: found a group of keys; input should be a valid"),
        (text(name="n", many=[{"number": "x"}]), "many.0.number: found 'x'; input should be a valid number"),
        (text(name="n", many=[{"number": 1, "maybe": 1.5}]), "many.0.maybe: found '1.5'; input should be a valid integer"),
        (text(name="n", group={"g": "x"}), "group.g: found 'x'; input should be a valid number"),
        (text(name="n")[:-1] + ', "group": {"g": 1e999}}', "group.g: found 'inf'; input should be a finite number"),
        (text(name="n")[:-1] + ', "x": NaN}', "f.json: expected value at line 1"),
        (text(name="\ud800"), "f.json: "),
        (text(name="n", x=[{"y": "\udc00"}]), "f.json: "),
        (text(name="n")[:-1] + f', "other": {"[" * 300}{"]" * 300}}}', "recursion limit"),
        (text(name="n")[:-1] + f', "other": {"[" * 10**5}', "recursion limit"),
        (text(name="n")[:-1] + f', "other": {"1" * 10**4}}}', "f.json: "),
    ],
)
def test_what_is_not_as_documented_says_where_and_what_was_needed(content, said):
    with pytest.raises(ResultError) as caught:
        read(content)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
