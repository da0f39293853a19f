"""A heavy mass that reaches the rod, or a string that leaves it, ends the model: `run` and `compare` end there, and say so."""

import json
import re
from pathlib import Path

import pytest

from tests.command_line import here

APPARATUS = """title: Ends early
light: {mass: 60 g}
heavy: {mass: 30 g}
rod: {radius: 6 mm}
string: {kinetic_friction: 0.01}
duration: 5 s
"""
CASES = {
    "the heavy mass reached the rod": (
        "release: {kind: looping, angle: 95 deg, free_length: 50 cm, hanging_length: 2 cm}\n",
        "the reference's heavy mass reaches the rod",
        "heavy reaches rod",
    ),
    "the string left the rod": (
        "release: {kind: looping, angle: 20 deg, free_length: 50 cm, hanging_length: 30 cm}\neffects: {push_across: -2 m/s}\n",
        "the reference's string leaves the rod",
        "unwrapped",
    ),
}


@pytest.mark.parametrize("ended", CASES)
def test_what_ends_the_model_is_named_with_its_time(ended, tmp_path, monkeypatch):
    release, clause, event = CASES[ended]
    monkeypatch.chdir(tmp_path)
    Path("ends.yaml").write_text(APPARATUS + release)
    alone = json.loads(here("run", "ends.yaml", "--json").stdout)["runs"][0]
    assert alone["ended"] == f"ran until {ended}, where the model ends; the scenario lasts 5 s"
    end = alone["end_time"]
    assert 0.01 < end < 1
    engine = json.loads(here("run", "ends.yaml", "--json", "--engine", "mujoco:documented").stdout)["runs"][0]
    assert engine["end_time"] > end
    assert re.search(rf"; at {end:.2f}\d s {clause} and the model ends$", engine["ended"]), "an engine knows no such end"

    done = here("compare", "ends.yaml", "--engine", "mujoco:capstan", "--engine", "mujoco:documented")
    assert done.returncode == 0
    # An engine that departs before that says when; none says anything about the time beyond
    assert f"up to {end:.3f} s, where {clause} and the model ends." in done.stdout
    said = [line for line in done.stdout.splitlines() if line.startswith("- mujoco")]
    assert len(said) == 2
    assert all(float(t) <= end for line in said for t in re.findall(r"(\d+\.\d+) s\b", line))
    report = Path("report/ends/report.md").read_text()
    (exact,) = re.findall(rf"^- \*\*reference\*\*: .*{event} at (\S+) s, where it ends without a halt\.", report, re.M)
    assert end <= float(exact) < end + 1.1e-3  # `end` is the last sample before it, and the report has four decimals
    engines = json.loads(Path("report/ends/result.json").read_text())["engines"]
    assert all(engine["end_time"] <= end and engine["ok"] for engine in engines)
