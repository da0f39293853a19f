"""The examples of docs/write-an-effect.md, taken from the page: a formula in a study, and an installed package."""

import json
import math
import sys

import pytest
import yaml

from looping_pendulum.discrepancy.identify import identify
from looping_pendulum.discrepancy.result import Verdict
from looping_pendulum.measured.study_io import load
from looping_pendulum.reference_ode.effects.own import COORDINATES, DIRECTIONS
from looping_pendulum.reference_ode.solve import solve
from looping_pendulum.scenarios import load_text
from tests import page_package
from tests.blind import Effects
from tests.blind.cases import CASES
from tests.command_line import here
from tests.discrepancy.blind_study import TWO_RATIOS, WHOLE_LIBRARY, only_candidates, write_study
from tests.docs_commands import PROJECT
from tests.page_package import python
from tests.scenarios.test_errors import GOOD

PAGE = PROJECT / "docs" / "write-an-effect.md"


def blocks(language):
    return page_package.blocks(PAGE, language)


def blind_study(folder, case, extra=""):
    path = write_study(folder, CASES[case], 3, trials=TWO_RATIOS)
    path.write_text(path.read_text(encoding="utf-8") + extra, encoding="utf-8")
    return path


@pytest.mark.long
@pytest.mark.parametrize(
    "library",
    [
        pytest.param(("magnet",), id="alone"),
        pytest.param(WHOLE_LIBRARY, id="whole_library", marks=pytest.mark.accurate),
    ],
)
def test_the_study_names_its_own_magnet(tmp_path, library):
    """Oracle: the magnet of the separate simulator, in Cartesian coordinates; daily the only candidate."""
    with only_candidates(library):
        result = identify(load(blind_study(tmp_path, "magnet", blocks("yaml")[0])))
    assert result.verdict is Verdict.IDENTIFIED
    (effect,) = result.effects
    assert effect.name == "magnet"
    assert abs(effect.value - dict(CASES["magnet"].effects)["magnet"]) < 3 * effect.error
    assert effect.candidate.source == "measured with a spring balance"
    repaired = tmp_path / "repaired.yaml"
    repaired.write_text(result.scenario, encoding="utf-8")
    assert load_text(result.scenario, "repaired").parameters.coefficients["magnet"] == effect.value
    # An engine's run has a process of its own, which gets the formula with the scenario
    done = here("run", str(repaired), "-e", "mujoco:capstan", "--out", str(tmp_path / "runs"))
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_scenario_on_the_page_brakes_the_heavy_mass():
    """Oracle: without friction and drag the brake alone takes energy, and so delays the heavy mass."""
    scenario = load_text(GOOD + blocks("yaml")[1], "braked")
    braked, free = (solve(scenario.parameters.replace(brake=value)) for value in (0.05, 0.0))
    assert scenario.parameters.coefficients["brake"] == 0.05
    assert braked.halting_time != free.halting_time


def test_the_page_names_every_direction_and_quantity():
    for name in (*DIRECTIONS, *COORDINATES):
        assert f"`{name}`" in PAGE.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    return page_package.install(PAGE, "looping_pulse", tmp_path_factory)


@pytest.fixture
def pushed(tmp_path):
    path = tmp_path / "pushed.yaml"
    path.write_text(GOOD + "effects: {pulse: 20 mN, pulse_time: 0.3 s}\n", encoding="utf-8")
    return path


@pytest.mark.long
def test_an_engine_runs_the_package(package, pushed, tmp_path):
    """Daily that it runs, in a process of its own; how well is measured below."""
    done = python(package, "-m", "looping_pendulum", "run", str(pushed), "-e", "mujoco:capstan", "--out", str(tmp_path))
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.accurate
def test_an_engine_has_the_force_of_the_package(package, pushed, tmp_path):
    """Oracle: the reference with SciPy. Without the push this variant is as near; the push moves the light mass by 8 mm."""
    engines = ("-e", "mujoco:capstan", "-e", "reference")
    done = python(package, "-m", "looping_pendulum", "compare", str(pushed), *engines, "--out", str(tmp_path))
    assert done.returncode == 0, done.stdout + done.stderr
    result = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    assert result["parameters"]["coefficients"]["pulse"] == 0.02
    assert all(engine["metrics"]["rms_0.7s"] < 1e-4 for engine in result["engines"])


@pytest.mark.long
def test_a_package_whose_effect_does_not_act_changes_no_key_and_no_result(package, pushed):
    """Installing one gave every run of every scenario another key and a coefficient that no baseline had."""
    script = """
import sys
from looping_pendulum.compare.run_cache import run_key
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.registry import select
from looping_pendulum.reference_ode.parameters import parameters_from
from looping_pendulum.scenarios import load
(engine,) = select(["mujoco:capstan"], Profile.QUICK)
scenario = load(sys.argv[1])
data = scenario.parameters.as_dict()
assert parameters_from(data) == scenario.parameters
print(run_key(engine, scenario), sorted(data["coefficients"].items()))
"""
    done = [python(folder, "-c", script, "ten_to_one") for folder in (package, PROJECT)]
    assert done[0].stdout == done[1].stdout != "", done[0].stderr + done[1].stderr
    acts = python(package, "-c", script, str(pushed)).stdout
    assert "('pulse', 0.02), ('pulse_time', 0.3)" in acts


def test_a_module_of_the_package_may_be_imported_first(package):
    script = (
        "import looping_pulse; from looping_pendulum.reference_ode import effects as e; print('pulse' in e.EFFECTS, e.FAULTS)"
    )
    done = python(package, "-c", script)
    assert done.stdout == "True ()\n", done.stderr


IDENTIFY = """
import json, sys
from pathlib import Path
from looping_pendulum.measured.study_io import load
from looping_pendulum.discrepancy.identify import identify
from tests.discrepancy.blind_study import only_candidates
with only_candidates(("pulse", "wind_speed")):
    result = identify(load(Path(sys.argv[1])))
(effect,) = result.effects
print(json.dumps([effect.name, effect.value, effect.error, effect.companions, result.provenance]))
"""


@pytest.mark.accurate
def test_the_package_is_identified(package, tmp_path):
    """Oracle: the thrust of the separate simulator."""
    done = python(package, "-c", IDENTIFY, str(blind_study(tmp_path, "thrust")))
    assert done.returncode == 0, done.stderr
    name, value, error, companions, provenance = json.loads(done.stdout)
    assert name == "pulse"
    assert abs(value - dict(CASES["thrust"].effects)["thrust"]) < 3 * error
    ((companion, time, _),) = companions
    assert companion == "pulse_time"
    assert math.isclose(time, Effects.thrust_time, abs_tol=0.01)
    assert provenance["looping-pulse"] == "0.1"


FAULTY = {
    'name="pulse",\n    kind': ('name="wind",\n    kind', "wind: found the name 'wind', which something else has already"),
    'unit="N"': ('unit="mN"', "pulse: pulse: unit: found 'mN', needed an SI unit"),
    "return -push * u / speed, push * w / speed": ("return 1.0, 0.0", "pulse: found an effect that does not vanish"),
    "xp.exp(-0.5 * since * since)": ("max(since, 0.0)", "pulse: found abs(), a comparison or a branch"),
    "since * since": ("since ** 2", "pulse: found a power, needed products"),
    "return [PULSE]": ("return PULSE.unknown", "AttributeError"),
}


@pytest.mark.parametrize("original", FAULTY)
def test_a_faulty_package_is_left_out_with_one_line(original, monkeypatch, tmp_path):
    from looping_pendulum.reference_ode.effects import LIBRARY, own

    changed, message = FAULTY[original]
    (tmp_path / "looping_pulse.py").write_text(blocks("python")[0].replace(original, changed), encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "looping_pulse", raising=False)
    point = own.entry_points(group="none")
    assert not point

    class Point:
        name, value = "pulse", "looping_pulse"
        dist = type("Distribution", (), {"name": "looping-pulse"})

    monkeypatch.setattr(own, "entry_points", lambda group: [Point])
    effects, (fault,) = own.installed_effects(LIBRARY)
    sys.modules.pop("looping_pulse", None)
    assert effects == ()
    assert message in fault
    assert fault.startswith("the effects of looping_pulse of the package looping-pulse are left out: ")
    assert "\n" not in fault


def test_a_faulty_package_is_warned_of_where_a_file_is_read(monkeypatch):
    from looping_pendulum.reference_ode import effects
    from looping_pendulum.reference_ode.effects.own import EffectWarning

    monkeypatch.setattr(effects, "FAULTS", ("the effects of one are left out",))
    with pytest.warns(EffectWarning, match="the effects of one are left out"):
        load_text(GOOD, "any")


def test_the_page_is_valid_yaml():
    assert [list(yaml.safe_load(block)) for block in blocks("yaml")] == [["candidates"], ["own_effects", "effects"]]
