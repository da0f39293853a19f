"""The range of scenarios over which each variant's accuracy was measured: stored runs, the package's summary, the warning."""

import dataclasses
import json

import pytest

from looping_pendulum.engines.facts import (
    QUANTITIES,
    EngineFacts,
    ErrorDistribution,
    ValidatedRange,
    VariantFacts,
    facts_from_plain,
    facts_path,
    own_facts,
    read_facts,
)
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.pymunk import PymunkChain
from looping_pendulum.engines.registry import select
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios import load
from research import engine_facts, rounded
from research.engine_range import (
    COMMAND,
    MAIN,
    MEASURED,
    SCENARIOS,
    scenarios,
    spread,
    stored,
    summary,
)
from tests.apparatus import TEN_TO_ONE

RANGE = ValidatedRange(
    profile="quick",
    scenarios=40,
    failed=1,
    releases=(Release.LOOPING,),
    bounds={"mass ratio M2/M1": (2.0, 12.0), "rod radius": (3e-3, 15e-3), "kinetic friction": (0.1, 0.6)},
    errors={"rms_0.7s": ErrorDistribution(count=39, median=1e-3, ninety=2e-3, worst=5e-3)},
)
MEASURED_ABILITIES = dataclasses.replace(PymunkChain.abilities, validated=(RANGE,))


def test_a_scenario_inside_the_range_gets_no_warning():
    assert MEASURED_ABILITIES.outside_range("quick", TEN_TO_ONE) == ()


def test_every_quantity_outside_its_bounds_is_named_with_value_and_bounds():
    p = TEN_TO_ONE.replace(heavy_mass=0.3, rod_radius=2e-3)
    assert MEASURED_ABILITIES.outside_range("quick", p) == (
        "mass ratio M2/M1 30 (measured: 2 to 12)",
        "rod radius 2 mm (measured: 3 to 15)",
    )


def test_a_release_that_was_not_measured_is_named():
    assert MEASURED_ABILITIES.outside_range("quick", TEN_TO_ONE.replace(release="vertical")) == (
        "release 'vertical' (measured: looping)",
    )


def test_a_profile_without_a_range_says_nothing():
    assert MEASURED_ABILITIES.outside_range("accurate", TEN_TO_ONE.replace(heavy_mass=0.3)) == ()


def test_a_range_reads_back():
    known = EngineFacts(variants={"beads": VariantFacts(measured=(RANGE,))})
    assert facts_from_plain(json.loads(json.dumps(dataclasses.asdict(known)))) == known


def test_spread_is_of_magnitudes_and_covers_nine_tenths():
    # Oracle: of 1 to 10, nine are at most 9; the sign of an error is no merit.
    assert spread([-value if value % 2 else value for value in range(1, 11)]) == ErrorDistribution(
        count=10, median=6, ninety=10, worst=10
    )
    assert spread([None, None]) is None


def test_scenarios_are_the_same_for_everyone_and_a_longer_list_begins_with_the_shorter():
    # Oracle: the stored parameters that the runs were made with, to the digits that are stored.
    kept = json.loads(MEASURED.read_text(encoding="utf-8"))["scenarios"]
    drawn = {s.name: s.parameters for s in scenarios()}
    assert kept.keys() == drawn.keys()
    for name, parameters in drawn.items():
        assert kept[name]["heavy_mass"] == pytest.approx(parameters.heavy_mass, rel=1e-3)
        assert kept[name]["coefficients"]["light_drag"] == pytest.approx(parameters.coefficients["light_drag"], rel=1e-3)
    assert [s.parameters for s in scenarios(5)] == [s.parameters for s in scenarios()[:5]]


def test_scenarios_reach_what_is_asked_for():
    # Oracle: the study's own terms: ratios of 1.5 to 20, 60 to 130 deg, 3 to 15 mm, friction 0.1 to 0.6, no drag among them.
    drawn = [s.parameters for s in scenarios()]
    assert len(drawn) >= 40
    asked = {
        "mass ratio M2/M1": (1.5, 20),
        "rod radius": (3e-3, 15e-3),
        "kinetic friction": (0.1, 0.6),
        "free length": (0.3, 0.8),
    }
    for quantity in QUANTITIES:
        if quantity.name in asked:
            low, high = asked[quantity.name]
            values = [quantity.of(p) for p in drawn]
            assert low <= min(values) < low + 0.2 * (high - low)
            assert high >= max(values) > high - 0.2 * (high - low)
    assert any(p.coefficients["light_drag"] == 0 for p in drawn)
    assert any(not p.static_equals_kinetic for p in drawn)
    assert sum(p.release is Release.VERTICAL for p in drawn) >= 3


def test_the_package_says_what_the_stored_runs_say():
    for name, ranges in rounded(summary(stored(), {s.name: s.parameters for s in scenarios()})).items():
        engine, _, variant = name.partition(":")
        stated = json.loads(facts_path(engine).read_text(encoding="utf-8"))["variants"][variant]["measured"]
        assert stated == json.loads(json.dumps(ranges)), f"write it again: {COMMAND} --summary"


def test_a_measured_range_is_written_to_its_engines_facts_and_leaves_the_rest_alone(tmp_path, monkeypatch):
    """Oracle: what was there, which stands in the same form."""
    path = tmp_path / "engine.json"
    before = facts_path("mujoco").read_text(encoding="utf-8")
    path.write_text(before, encoding="utf-8")
    shipped = own_facts("mujoco").variant("capstan")
    monkeypatch.setattr(engine_facts, "facts_path", lambda engine: path)
    tree = json.loads(before)["variants"]["beads"]
    engine_facts.write_measured("mujoco:beads", "additions", tree["additions"])
    assert path.read_text(encoding="utf-8") == before
    engine_facts.write_measured("mujoco:beads", "measured", [])
    assert read_facts(path).variant("beads").measured == ()
    assert read_facts(path).variant("capstan") == shipped


@pytest.mark.parametrize("name", MAIN)
def test_every_main_variant_states_its_range(name):
    engine, _, variant = name.partition(":")
    ranges = own_facts(engine).variant(variant).measured
    (stated,) = [each for each in ranges if each.profile == "quick"]
    (engine,) = select([name], Profile.QUICK)
    assert engine.abilities.validated == ranges
    assert 0 < stated.scenarios <= SCENARIOS
    assert engine.abilities.outside_range("quick", load("ten_to_one").parameters) == ()
    assert engine.abilities.outside_range("quick", TEN_TO_ONE.replace(heavy_mass=10.0)) != ()
