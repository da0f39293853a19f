"""The notebooks run from top to bottom, and the repository has them without outputs."""

import json
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

import looping_pendulum

NOTEBOOKS = sorted((Path(__file__).parents[1] / "notebooks").glob("*.ipynb"))
RUN = """
import sys, nbformat
from nbclient import NotebookClient
notebook = nbformat.read(sys.argv[1], as_version=4)
NotebookClient(notebook, timeout=240, kernel_name="python3", resources={"metadata": {"path": sys.argv[2]}}).execute()
nbformat.write(notebook, sys.argv[3])
"""
"""In a process of its own: Jupyter's packages warn of one another, and here a warning is an error."""

needs_jupyter = pytest.mark.skipif(find_spec("nbclient") is None or find_spec("ipykernel") is None, reason="no Jupyter here")


def executed(path, tmp_path):
    """Cells' outputs of a notebook that was run."""
    done = tmp_path / path.name
    command = [sys.executable, "-c", RUN, str(path), str(tmp_path), str(done)]
    process = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert process.returncode == 0, process.stderr[-3000:]
    cells = json.loads(done.read_text(encoding="utf-8"))["cells"]
    return [output for cell in cells if cell["cell_type"] == "code" for output in cell["outputs"]]


def pages(outputs):
    return ["".join(o["data"]["text/html"]) for o in outputs if "text/html" in o.get("data", {})]


def pictures(outputs):
    return sum("image/png" in o.get("data", {}) for o in outputs)


def printed(outputs):
    return "".join("".join(o["text"]) for o in outputs if o["output_type"] == "stream" and o["name"] == "stdout")


def test_there_are_three_without_outputs():
    assert len(NOTEBOOKS) == 3
    for path in NOTEBOOKS:
        for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
            assert cell.get("outputs", []) == []
            assert cell.get("execution_count") is None


@needs_jupyter
def test_a_search_shows_how_far_it_is(tmp_path):
    """In one line, which is replaced: of 20 s of nothing a student knows not what they are."""
    from nbformat.v4 import new_code_cell, new_notebook

    study = Path(looping_pendulum.__file__).parent / "teaching" / "example" / "study.yaml"
    source = f"import looping_pendulum as lp\nfound = lp.identify(lp.load_study({str(study)!r}))"
    (tmp_path / "search.ipynb").write_text(json.dumps(new_notebook(cells=[new_code_cell(source)])), encoding="utf-8")
    (line,) = executed(tmp_path / "search.ipynb", tmp_path)
    assert "".join(line["data"]["text/plain"]) == "97 %: reporting"


@pytest.mark.accurate  # daily, its calls are those of tests/test_cli.py and tests/compare
@needs_jupyter
def test_first_run(tmp_path):
    outputs = executed(NOTEBOOKS[0], tmp_path)
    scenario, run, result = pages(outputs)
    assert "<td>light.mass</td>\n<td>10 g</td>" in scenario
    assert "halts at 0.3814" in run
    assert "mujoco:documented" in result
    assert pictures(outputs) == 2


@needs_jupyter
@pytest.mark.accurate
def test_scenario_and_tolerance(tmp_path):
    outputs = executed(NOTEBOOKS[1], tmp_path)
    output = printed(outputs)
    assert "expected a mass, got '5 cm'" in output
    assert "did you mean 'radius'" in output
    assert "the unit is missing" in output
    assert "expected failure" in output
    assert len(pages(outputs)) == 3


@needs_jupyter
@pytest.mark.accurate
def test_from_marks_to_the_missing_effect(tmp_path):
    outputs = executed(NOTEBOOKS[2], tmp_path)
    verdict, repaired = pages(outputs)
    assert "A missing effect was found" in verdict
    assert "side_force" in verdict
    assert "effects.side_force" in repaired
    assert "t,heavyx,heavyy,lightx,lighty" in printed(outputs)
