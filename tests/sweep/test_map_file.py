"""Map files: what they mean, and one clear line for each fault."""

import dataclasses

import numpy as np
import pytest

from looping_pendulum.errors import ScenarioError
from looping_pendulum.reference_ode.batch import ENDS
from looping_pendulum.reference_ode.effects import COEFFICIENTS
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.scenarios import load as load_scenario
from looping_pendulum.sweep import map_file
from looping_pendulum.sweep.cells import ENDINGS, FIELDS
from looping_pendulum.sweep.map_file import run_count
from looping_pendulum.sweep.quantities import FACTORS, VARIABLES, Axis, columns
from looping_pendulum.sweep.store import attributes
from tests.sweep.maps import LONG, SAMPLE

ANGLE = "release_angle: {from: 60 deg, to: 130 deg, count: 8}"


def written(parameters, *more, scenario="ten_to_one"):
    return "\n".join(["title: A map", f"scenario: {scenario}", "parameters:", *(f"  {p}" for p in parameters), *more])


@pytest.mark.parametrize("name", map_file.shipped())
def test_shipped_maps_load_and_are_possible(name):
    plan = map_file.load(name)
    map_file.refuse_unintended_size(plan)
    assert plan.title
    assert plan.description
    assert not plan.impossible_corners


def test_a_map_is_the_same_map_on_a_processor_whose_powers_differ_in_the_last_place():
    # NumPy's powers differ with AVX-512; a map begun on one machine was another map on the next, and could not be resumed.
    def moved(plan, factor, where):
        axis = plan.axes[0]
        values = axis.values.copy()
        values[where] *= factor
        return plan.model_copy(update={"axes": (dataclasses.replace(axis, values=values),)})

    plan = map_file.load_text(written(["rod_radius: {from: 1 mm, to: 20 mm, count: 8, spacing: log}"]))
    ids = [
        attributes(p)["map_id"]
        for p in (plan, moved(plan, 1 + 4e-16, slice(1, -1)), moved(plan, 1 + 1e-9, -1), moved(plan, 1 + 1e-9, 0))
    ]
    assert ids[0] == ids[1]
    assert len(set(ids)) == 3


def test_every_number_of_an_apparatus_may_be_varied():
    fields = {field.name for field in dataclasses.fields(Parameters)} - {"release", "coefficients", "own_effects"}
    assert set(VARIABLES) == fields | set(COEFFICIENTS) | set(FACTORS)
    assert VARIABLES["release_angle"].kind.unit == "rad"
    assert VARIABLES["light_radius"].kind.low == 0
    assert all(variable.meaning for variable in VARIABLES.values())


def test_the_codes_of_a_batch_are_those_of_a_map():
    assert ENDINGS[: len(ENDS)] == tuple(map(str, ENDS))


def test_no_axis_has_the_name_of_another_array_of_a_map():
    axes = [Axis(quantity=q, written="", values=np.zeros(1)).name for q in VARIABLES.values()]
    assert not ({*FIELDS, "engine", "run"}) & {*axes}
    assert len(axes) == len({*axes})


def test_a_grid_has_every_combination_once_whatever_the_chunks():
    plan = map_file.load_text(LONG.replace("chunk: 12", "chunk: 7"))
    parts = [plan.values_in(region) for region in plan.regions()]
    pairs = [np.column_stack([np.degrees(part["release_angle"]), part["mass_ratio"]]) for part in parts]
    seen = {tuple(pair) for pair in np.concatenate(pairs).round(9)}
    assert seen == {(60.0 + 5 * i, 1.0 + j) for i in range(15) for j in range(12)}
    assert sum(len(part["mass_ratio"]) for part in parts) == plan.runs == 180
    assert max(len(part["mass_ratio"]) for part in parts) <= 7


def test_chunks_of_three_axes_keep_to_their_size():
    text = written([ANGLE, "mass_ratio: [2, 5, 10]", "rod_radius: {from: 4 mm, to: 8 mm, count: 5}"], "chunk: 16")
    plan = map_file.load_text(text)
    assert tuple(plan.chunk_sizes.values()) == (1, 3, 5)
    assert sum(map(run_count, plan.regions())) == plan.runs == 120


@pytest.mark.parametrize("method", ["sobol", "halton"])
def test_a_sample_is_the_same_in_one_piece_and_in_chunks(method):
    plan = map_file.load_text(SAMPLE.replace("sobol", method))
    whole = plan.values_in((slice(0, 100),))
    parts = [plan.values_in(region) for region in plan.regions()]
    for axis in plan.axes:
        assert np.array_equal(whole[axis.name], np.concatenate([part[axis.name] for part in parts]))
        assert axis.values[0] <= whole[axis.name].min() < whole[axis.name].max() <= axis.values[-1]
    # a hundred points in ten equal parts: a low-discrepancy sequence has some in each, and nowhere twice its share
    shares = np.log(whole["rod_radius"] / 1e-3) / np.log(20)
    counts = np.histogram(shares, bins=10, range=(0, 1))[0]
    assert counts.min() > 5
    assert counts.max() < 15


def test_ratios_set_the_masses_and_the_friction():
    base = load_scenario("ten_to_one").parameters
    given = {"mass_scale": np.array([1.0, 3.0]), "mass_ratio": np.array([2.0, 4.0]), "static_ratio": np.array([1.0, 1.5])}
    made = columns(base, given)
    assert made["light_mass"] == pytest.approx([0.01, 0.03])
    assert made["heavy_mass"] == pytest.approx([0.02, 0.12])
    assert made["static_friction"] == pytest.approx([0.3431, 1.5 * 0.3431])
    both = columns(base, {"kinetic_friction": np.array([0.2, 0.5])})
    assert np.array_equal(both["static_friction"], both["kinetic_friction"])  # a static one that follows goes along


def test_keys_of_scenario_files_are_understood():
    plan = map_file.load_text(written(["release.angle: [75 deg, 75.1 deg]", "rod.radius: [6.25 mm]"]))
    assert tuple(plan.sizes) == ("release_angle", "rod_radius")
    assert plan.axes[0].values == pytest.approx(np.radians([75, 75.1]), rel=1e-15)
    assert plan.axes[0].written == "deg"


def test_a_scenario_may_be_a_file_beside_the_map(tmp_path):
    from looping_pendulum.scenarios.loader import source_text

    (tmp_path / "mine.yaml").write_text(source_text("drop"))
    (tmp_path / "map.yaml").write_text(written([ANGLE], scenario="mine.yaml"))
    assert map_file.load(tmp_path / "map.yaml").scenario.name == "mine"


FAULTS = {
    "unknown parameter": (["relase_angle: [60 deg]"], [], ":4: parameters.relase_angle:", "did you mean 'release_angle'?"),
    "wrong dimension": (
        ["release_angle: {from: 60 cm, to: 130 deg, count: 3}"],
        [],
        "release_angle.from: expected an angle",
        "60 cm",
    ),
    "no unit": (["rod_radius: [6.25]"], [], "expected a length", "the unit is missing"),
    "no values": (["mass_ratio: []"], [], "empty grid", "write for example '[2.5]'"),
    "no count": (["mass_ratio: {from: 1, to: 2}"], [], "mass_ratio.count: missing", "write for example"),
    "count of 0": (
        ["mass_ratio: {from: 1, to: 2, count: 0}"],
        [],
        "mass_ratio.count: expected a whole number from 1, got '0'",
        "'50'",
    ),
    "no parameters": (["{}"], [], "parameters: found 0 quantities", "one to 3"),
    "four parameters": (
        [ANGLE, "mass_ratio: [2]", "rod_radius: [5 mm]", "gravity: [9.81 m/s^2]"],
        [],
        "parameters: found 4 quantities",
        "one to 3",
    ),
    "ends swapped": (["mass_ratio: {from: 3, to: 2, count: 5}"], [], "mass_ratio.to:", "swap them"),
    "twice": (["mass_ratio: [2, 2]"], [], "out of order or twice", "sort them"),
    "out of bounds": (["mass_ratio: [-2]"], [], "a plain number above 0", "'-2'"),
    "range and list": (["mass_ratio: {values: [2], count: 3}"], [], "mass_ratio.count: found beside 'values'", "delete one"),
    "log from 0": (["kinetic_friction: {from: 0, to: 1, count: 3, spacing: log}"], [], "above 0 with 'spacing: log'", "from"),
    "two that meet": (["mass_ratio: [2]", "heavy_mass: [20 g]"], [], "also sets heavy_mass", "leave one out"),
    "count in a sample": ([ANGLE], ["sample: {count: 10}"], "release_angle.count: found it in a sample", "under 'sample'"),
    "empty sample": (
        ["mass_ratio: {from: 1, to: 2}"],
        ["sample: {count: 0}"],
        "sample.count: expected a whole number",
        "'50'",
    ),
    "method": (
        ["mass_ratio: {from: 1, to: 2}"],
        ["sample: {count: 9, method: sobel}"],
        "sample.method",
        "did you mean 'sobol'?",
    ),
    "unknown key": ([ANGLE], ["tolerence: 1e-9"], ":5: tolerence: found an unknown key", "did you mean 'tolerance'?"),
    "unknown engine": ([ANGLE], ["engine: mujuco"], "engine: no engine is called 'mujuco'", "did you mean 'mujoco'?"),
    "nothing possible": (
        ["static_friction: [0.1, 0.2]"],
        [],
        "found no possible apparatus",
        "needed at least kinetic_friction",
    ),
}


@pytest.mark.parametrize("case", FAULTS)
def test_a_fault_is_one_line_with_place_and_way_out(case):
    parameters, more, *expected = FAULTS[case]
    with pytest.raises(ScenarioError) as caught:
        map_file.load_text(written(parameters, *more), file="mine.yaml")
    message = str(caught.value)
    assert message.startswith("mine.yaml")
    assert "\n" not in message
    for part in expected:
        assert part in message


def test_other_faults_of_a_map_file(tmp_path):
    with pytest.raises(ScenarioError, match="shipped: angle_and_ratio"):
        map_file.load(tmp_path / "none.yaml")
    with pytest.raises(ScenarioError, match="did you mean 'quick'"):
        map_file.load("quik")
    with pytest.raises(ScenarioError, match="scenario: ten_to_on: .*did you mean 'ten_to_one'"):
        map_file.load_text(written([ANGLE], scenario="ten_to_on"))
    with pytest.raises(ScenarioError, match="a vertical release hangs at 180 deg"):
        map_file.load_text(written([ANGLE], scenario="atwood"))


def test_a_typo_in_a_count_is_refused_with_the_size():
    text = written(["release_angle: {from: 60 deg, to: 130 deg, count: 70001}", "mass_ratio: {from: 1, to: 12, count: 1111}"])
    plan = map_file.load_text(text)  # of that size nothing is made yet
    with pytest.raises(
        ScenarioError, match=r"found 77771111 runs \(release_angle 70001 x mass_ratio 1111\).*--max-runs 77771111"
    ):
        map_file.refuse_unintended_size(plan)
    map_file.refuse_unintended_size(plan, most=77771111)
