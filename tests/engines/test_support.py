"""The support tables: what the variants declare."""

from pathlib import Path

from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.registry import all_engines, label, own_engines
from looping_pendulum.engines.support import YES, effect_table, scenario_table
from looping_pendulum.scenarios import loader
from tests.engines.faulty import FaultyEngine

PROJECT = Path(__file__).parents[2]


def own():
    return [engine for engine in all_engines(Profile.QUICK) if engine.name in own_engines()]


def test_a_gap_says_which_release_is_missing():
    header, rows = scenario_table([*own(), FaultyEngine("none")])
    cells = dict(zip(header, rows[-1], strict=True))
    assert cells["ten_to_one"] == YES
    assert cells["drop"] == "no: release 'drop'"
    assert cells["kind"] == "main"
    assert header[2:] == loader.shipped()
    assert dict(zip(header, rows[0], strict=True))["kind"] == "reference"


def test_effects_say_whom_they_do_not_reach():
    header, rows = effect_table(own())
    cells = {row[0]: dict(zip(header, row, strict=True)) for row in rows}
    assert cells["wind"]["reaches"] == "all"
    assert "pymunk:chain" in cells["string_mass"]["not"]
    assert "reference" not in cells["string_mass"]["not"]
    assert "light_drag" not in cells, "the paper's own effects reach all, or the variant says so by who supplies them"


def test_what_an_adapter_takes_from_the_reference_is_declared():
    """Oracle: the adapters that solve the reference, by their source."""
    declared = {label(e): e.abilities.from_reference for e in all_engines(Profile.QUICK) if e.abilities.from_reference}
    assert declared == {"mujoco:frictionloss": ("the size of the friction",), "pybullet:chain": ("the length of a step",)}
    folder = PROJECT / "looping_pendulum" / "engines"
    solving = {p.relative_to(folder).as_posix() for p in folder.rglob("*.py") if "reference_ode.solve import" in p.read_text()}
    assert solving - {"reference/__init__.py", "conformance.py"} == {"mujoco/tendon.py", "pybullet/chain.py"}
