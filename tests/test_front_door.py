"""What `import looping_pendulum` offers: lazily, as the page docs/python.md uses it."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import looping_pendulum as lp
from looping_pendulum.teaching.example_folder import write_example

PAGE = Path(__file__).parents[1] / "docs" / "python.md"


def test_each_name_is_there_and_a_page_has_its_example():
    examples = "\n".join(re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL))
    for name in lp.__all__:
        assert getattr(lp, name) is not None
        assert name == "__version__" or f"lp.{name}(" in examples
    assert set(lp.__all__) <= set(dir(lp))
    with pytest.raises(AttributeError, match="has no attribute 'nonsense'"):
        lp.nonsense  # noqa: B018


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
    assert capsys.readouterr().out.count("\n") > 4


def test_what_takes_parameters_takes_a_scenario_too():
    scenario = lp.load("two_to_one")
    p, times, frictions = scenario.parameters, np.array([0.0, 0.1, 0.2]), {"kinetic_friction": np.array([0.2, 0.3])}
    assert lp.solve(scenario).halting_time == lp.solve(p).halting_time
    assert np.array_equal(lp.solve_at(scenario, times).light_position, lp.solve_at(p, times).light_position)
    ends = [lp.solve_batch(given, frictions, duration=0.3).end_time for given in (scenario, p)]
    assert np.array_equal(*ends)
