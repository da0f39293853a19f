"""What changed since another run: every kind of change is seen, what is below the threshold is not, bad files are one line."""

from __future__ import annotations

import dataclasses
import json

import pytest

from looping_pendulum.compare import compare, write
from looping_pendulum.compare.baseline import (
    MIN_METRIC_CHANGES,
    ChangeKind,
    changes_since,
    heading,
    read_baseline,
    render,
    rows,
)
from looping_pendulum.compare.report import render as render_report
from looping_pendulum.compare.result import ComparisonResult
from looping_pendulum.engines.trajectory import Provenance, RunStatus
from looping_pendulum.errors import ResultError

RUN = "pymunk:chain, quick"


def values_by_change(changes):
    return {(c.kind, c.run, c.what): (c.before, c.after) for c in changes.changes}


def test_the_same_run_again_changed_nothing(scenario, reference, make_run, missing):
    first = compare(scenario, reference, [make_run(shift=(3e-3, 0.0), wall_time=1.0), missing])
    second = compare(scenario, reference, [make_run(shift=(3e-3, 0.0), wall_time=9.0), missing])
    again = ComparisonResult.from_json(first.to_json())
    changes = changes_since(again, second, source="old/result.json")
    assert changes.changes == ()
    assert heading(changes) == f"Nothing changed since old/result.json (written {first.clock.written})."


def test_a_metric_counts_above_the_fraction_and_above_the_floor(scenario, reference, make_run):
    before = compare(scenario, reference, [make_run(shift=(3e-3, 0.0))])
    shifted = {share: compare(scenario, reference, [make_run(shift=(3e-3 * (1 + share), 0.0))]) for share in (0.009, 0.011)}
    assert not values_by_change(changes_since(before, shifted[0.009]))
    names = {what for _, _, what in values_by_change(changes_since(before, shifted[0.011]))}
    assert {"rms_0.35s", "rms_0.7s", "rms_1.0s"} <= names
    assert {"rms_0.7s"} <= {what for _, _, what in values_by_change(changes_since(before, shifted[0.009], relative=0.005))}
    tiny = [
        compare(scenario, reference, [make_run(shift=(size, 0.0))])
        for size in (0.1 * MIN_METRIC_CHANGES["m"], 0.9 * MIN_METRIC_CHANGES["m"])
    ]
    changed = {c.what for c in changes_since(*tiny).changes if c.unit == "m"}
    assert not changed  # nine times as much, and still nothing that one could see


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
        (ChangeKind.SCENARIO, "", "light_mass"): (mass, 2 * mass),
        (ChangeKind.RUN, "pybullet:chain, quick", "run"): ("MISSING", "not run"),
        (ChangeKind.RUN, "mujoco:chain, quick", "run"): ("not run", "FINISHED"),
        (ChangeKind.STATUS, RUN, "status"): ("FINISHED", "CRASHED"),
        (ChangeKind.TOLERANCE, RUN, "rms_0.7s"): ("pass", "fail"),
        (ChangeKind.TOLERANCE, RUN, "limit of rms_1.0s"): (9e-3, 8e-3),
        (ChangeKind.VERSION, RUN, "pymunk"): ("7.3", "7.4"),
        (ChangeKind.SETTING, RUN, "dt"): (1e-3, 1e-4),
        (ChangeKind.SETTING, RUN, "solver.sweeps"): (10, 20),
        (ChangeKind.SUPPLY, RUN, "friction law"): ("engine", "nobody"),
    }
    assert expected.items() <= changes.items()
    was, now = changes[ChangeKind.METRIC, RUN, "rms_0.7s"]
    assert (was, now) == (pytest.approx(3e-3, rel=1e-6), pytest.approx(6e-3, rel=1e-6))


@pytest.mark.parametrize(("factor", "seen"), [(1 + 4e-16, False), (1 - 1e-12, False), (1 + 1e-6, True)])
def test_the_last_bits_of_a_computed_setting_are_no_change(scenario, reference, make_run, factor, seen):
    # A contact's friction is solved for, and comes out one unit of the last place apart on another processor.
    before, after = (
        compare(scenario, reference, [make_run(settings={"rod": {"friction": 0.34217 * f}})]) for f in (1.0, factor)
    )
    assert ((ChangeKind.SETTING, RUN, "rod.friction") in values_by_change(changes_since(before, after))) is seen


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

    halt, count = (ChangeKind.LANDMARK, RUN, "halting time"), (ChangeKind.LANDMARK, RUN, "number of stops")
    assert halt not in values_by_change(changes_since(result, later(9e-5, 0.0)))
    changes = values_by_change(changes_since(result, later(2e-4, 5e-6)))
    assert changes[halt][1] - changes[halt][0] == pytest.approx(2e-4)
    assert changes[count] == (len(result.engines[0].landmarks.stops), 0)
    assert (ChangeKind.LANDMARK, "reference", "halting time") in changes


def test_the_report_has_a_section_and_the_folder_a_file(tmp_path, scenario, reference, make_run):
    before = compare(scenario, reference, [make_run(shift=(3e-3, 0.0))])
    after = compare(scenario, reference, [make_run(shift=(1.5e-3, 0.0))])
    changes = changes_since(before, after, source="old")
    assert ["pymunk:chain, quick", "metric: rms_0.7s", "3 mm", "1.5 mm", "-50 %"] in rows(changes)
    report = write(after, tmp_path, changes).read_text()
    heads = [line for line in report.splitlines() if line.startswith("##")]
    assert heads[:3] == ["## Verdict", "## Where, when and why", "## Changes since the baseline"]
    assert "| pymunk:chain, quick | metric: rms_0.7s | 3 mm | 1.5 mm | -50 % |" in report
    assert "more than 1 % and more than 0.001 mm" in report
    tree = json.loads((tmp_path / "changes.json").read_text())
    assert tree["schema"] == {"id": "looping-pendulum/changes", "version": 1}
    assert tree["relative"] == 0.01
    assert {"kind": "metric", "run": RUN, "what": "rms_0.7s"}.items() <= next(
        c for c in tree["changes"] if c["what"] == "rms_0.7s"
    ).items()
    assert ComparisonResult.from_json((tmp_path / "result.json").read_text()) == after
    assert "since the baseline" not in render_report(after)
    assert "Nothing changed" in render(changes_since(after, after))


def test_a_baseline_is_a_file_or_its_folder(tmp_path, scenario, reference, make_run):
    result = compare(scenario, reference, [make_run()])
    write(result, tmp_path)
    assert read_baseline(tmp_path, "made_up") == read_baseline(tmp_path / "result.json", "made_up") == result


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda tree: tree["schema"].update(version=99), "needed 3 or less; update looping-pendulum"),
        (lambda tree: tree["schema"].update(id="other"), "needed the id 'looping-pendulum/comparison'"),
        (lambda tree: tree.update(scenario="held"), "found a result of 'held', needed one of 'made_up'"),
        (lambda tree: tree.pop("engines"), "not as documented"),
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
    with pytest.raises(ResultError, match=r"No such file.*looping-pendulum compare made_up"):
        read_baseline(tmp_path / "nowhere.json", "made_up")
    (tmp_path / "bytes").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ResultError, match="not text"):
        read_baseline(tmp_path / "bytes", "made_up")


def test_an_older_file_may_lack_a_key_that_has_a_default(scenario, reference, make_run):
    tree = json.loads(compare(scenario, reference, [make_run()]).to_json())
    del tree["engines"][0]["landmarks"]["slip_onsets"]
    assert ComparisonResult.from_json(json.dumps(tree)).engines[0].landmarks.slip_onsets == ()
