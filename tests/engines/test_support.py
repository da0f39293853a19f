"""The support table: what the variants declare, and the page in the docs that was written from it."""

from pathlib import Path

from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.registry import ADAPTERS, adapter_packages, all_engines, label
from looping_pendulum.engines.support import COMMAND, YES, effect_table, page, scenario_table
from looping_pendulum.scenarios import loader
from tests.engines.faulty import FaultyEngine

PAGE = Path(__file__).parents[2] / "docs" / "support.md"


def own():
    ours = ADAPTERS.keys() | {name for name, package in adapter_packages().items() if package == "looping-pendulum"}
    return [engine for engine in all_engines(Profile.QUICK) if engine.name in ours]


def test_the_page_in_the_docs_is_up_to_date():
    assert PAGE.read_text(encoding="utf-8") == page(own()), f"docs/support.md is out of date; write it again: {COMMAND}"


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
    assert "reference:scipy" not in cells["string_mass"]["not"]
    assert "light_drag" not in cells, "the paper's own effects reach all, or the variant says so by who supplies them"


def test_every_variant_is_on_the_page():
    text = PAGE.read_text(encoding="utf-8")
    assert all(text.count(f"| {label(engine)} |") >= 2 for engine in own())


def test_what_an_adapter_takes_from_the_reference_is_declared():
    """Oracle: the adapters that solve the reference, by their source; the page of engines names the variants."""
    declared = {label(e): e.abilities.from_reference for e in all_engines(Profile.QUICK) if e.abilities.from_reference}
    assert declared == {"mujoco:frictionloss": ("the size of the friction",), "pybullet:chain": ("the length of a step",)}
    project = PAGE.parents[1]
    folder = project / "looping_pendulum" / "engines"
    solving = {p.relative_to(folder).as_posix() for p in folder.rglob("*.py") if "reference_ode.solve import" in p.read_text()}
    assert solving - {"reference.py", "conformance.py"} == {"mujoco/tendon.py", "pybullet/chain.py"}
    (told,) = (line for line in (project / "docs" / "engines.md").read_text().splitlines() if "reference's own run" in line)
    assert all(f"`{name}`" in told for name in declared)
