"""What `import looping_pendulum` offers: lazily, as the page docs/python.md uses it."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import looping_pendulum as lp
from looping_pendulum.measured.study import read_files
from looping_pendulum.teaching.example_folder import write_example

PAGE = Path(__file__).parents[1] / "docs" / "python.md"


def test_each_name_is_there_and_a_page_has_its_example():
    examples = "\n".join(re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL))
    for name in lp.__all__:
        assert getattr(lp, name) is not None
        assert name == "__version__" or f"lp.{name}(" in examples
    assert set(lp.__all__) == {"__version__", *lp._FROM}
    assert set(lp.__all__) <= set(dir(lp))
    with pytest.raises(AttributeError, match="has no attribute 'nonsense'"):
        lp.nonsense  # noqa: B018


def checked(code, tmp_path):
    """Return what mypy says of a user's script."""
    api = pytest.importorskip("mypy.api", reason="needs the extra dev")
    (tmp_path / "script.py").write_text(code, encoding="utf-8")
    options = ["--strict", "--follow-imports=silent", "--ignore-missing-imports", "--config-file=", "--no-error-summary"]
    said, errors, _ = api.run([*options, f"--cache-dir={tmp_path}", str(tmp_path / "script.py")])
    return said + errors


@pytest.mark.long
def test_type_checkers_know_the_front_door(tmp_path):
    """Without an interpreter: the page's examples have no error, and a name or keyword that is not there is one."""
    examples = "\n".join(re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL))
    assert checked(examples, tmp_path) == ""
    said = checked("import looping_pendulum as lp\nlp.solv(lp.load('ten_to_one'))\nlp.Trial(light_mas=0.01)\n", tmp_path)
    assert 'Module has no attribute "solv"; maybe "solve"?' in said
    assert 'Unexpected keyword argument "light_mas" for "Trial"' in said


def test_the_package_alone_imports_no_numbers():
    code = "import sys, looping_pendulum; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_the_examples_run(tmp_path, monkeypatch, capsys):
    renderer = pytest.importorskip("tests.measured.film.renderer", reason="needs the extra film")
    monkeypatch.chdir(tmp_path)
    write_example(tmp_path / "example")
    renderer.render(tmp_path / "trial.mp4", renderer.Scene(before=0.1, duration=0.6), renderer.looping_motion(0.8))
    names = {}
    for example in re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL):
        exec(compile(example, str(PAGE), "exec"), names)
    assert (tmp_path / "report" / "ten_to_one" / "report.md").exists()
    assert (tmp_path / "report" / "ten_to_one" / "demo.html").exists()
    assert names["run"].halting_time == pytest.approx(0.3814, abs=1e-3)
    assert len(names["batch"].halting_time) == 3
    assert {c.name for c in names["points"].channels} == {"light_x", "light_y", "heavy_x", "heavy_y"}
    measured = {"heavy_mass": "100 g", "release_angle": "112 deg", "free_length": 0.58}
    of_film = read_files(tmp_path, lp.Trial(points=names["points"], **measured))
    for found, tracked in zip(of_film.channels, names["points"].channels, strict=True):
        assert np.array_equal([found.t, found.value], [tracked.t, tracked.value])
    assert of_film.name == "trial"
    assert names["fitted"].values["light_drag"] == pytest.approx(1e-3, rel=0.2)
    assert (tmp_path / "motion.png").exists()
    assert capsys.readouterr().out.count("\n") > 4


def test_what_takes_parameters_takes_a_scenario_too():
    scenario = lp.load("two_to_one")
    p, times, frictions = scenario.parameters, np.array([0.0, 0.1, 0.2]), {"kinetic_friction": np.array([0.2, 0.3])}
    assert lp.solve(scenario).halting_time == lp.solve(p).halting_time
    assert np.array_equal(lp.solve_at(scenario, times).light_position, lp.solve_at(p, times).light_position)
    ends = [lp.solve_batch(given, frictions, duration=0.3).end_time for given in (scenario, p)]
    assert np.array_equal(*ends)
