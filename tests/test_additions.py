"""One of each kind, added in a copy of the package where CONTRIBUTING says, is found by all that follows from it.

An effect, an error of the camera, a metric, a variable of maps, a word in a table's head, an engine and a language.
"""

import json
import os
import shutil
import subprocess
import sys
import textwrap

import pytest

from tests import page_package
from tests.docs_commands import PROJECT

EFFECTS, CAMERA = "reference_ode/effects/library.py", "measured/camera.py"
ADDED = {
    "an effect": [
        (
            EFFECTS,
            "LIBRARY = (\n",
            """
            LIFT = Effect(
                name="lift", kind=EffectKind.FORCE, formula="F = lambda |v1| w e1", source="none", acts_on="light mass",
                depends_on=("light_mass_speed", "across_speed"),
                coefficients=(_coefficient("lift", "kg/m", (-1.0, 1.0), "lift coefficient lambda"),),
                force_on_light_mass=lambda xp, k, p: (p.lift * k.light_mass_speed * k.across_speed, 0.0),
            )
            LIBRARY = (
                LIFT,
            """,
        )
    ],
    "an error of the camera": [
        (
            CAMERA,
            "    scale: float = _coefficient(\n",
            """
                sag: float = _coefficient("1/m", 0.0, (-1.0, 1.0), "how the picture hangs", error=0.01, reach=0.3)
                scale: float = _coefficient(
            """,
        ),
        (
            CAMERA,
            "        turned[..., 1] += self.origin_y\n",
            "        turned[..., 1] += self.origin_y - self.sag * turned[..., 0] ** 2\n",
        ),
    ],
    "a metric": [
        (
            "scenarios/metrics.py",
            "            Metric(\n                name=\"rebound\",\n",
            """
                        Metric(
                            name="last_sample", unit="s", shown_in=_SECONDS, heading="last",
                            description="Time of the last sample.",
                            value=attrgetter("simulated_time"),
                        ),
                        Metric(
                            name="rebound",
            """,
        )
    ],
    "a variable of maps": [
        (
            "reference_ode/batch/runs.py",
            "    stops: NDArray[np.int32] = ",
            '    across_speed: Array = _at_end("m/s", "speed of the light mass across the string", "across_speed")\n'
            "    stops: NDArray[np.int32] = ",
        )
    ],
    "a word of a head": [("measured/columns.py", 'ROLES = {\n', 'ROLES = {\n    "vrijeme": "t",\n')],
    "a language": [
        ("live/assets/texts.js", "export const LANGUAGES = { en, de };", "export const LANGUAGES = { en, de, hr };"),
        ("live/assets/texts.js", 'import { en } from', 'import { hr } from "./texts/hr.js";\nimport { en } from'),
    ],
    "an engine": [
        ("engines/registry.py", "ADAPTERS = {\n", 'ADAPTERS = {\n    "spring": "looping_pendulum.engines.spring",\n'),
    ],
}  # fmt: skip
"""What is added -> (file, what stands there, what stands there then) for each place."""


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """Return a folder with a copy of the package to which one of each kind was added."""
    folder = tmp_path_factory.mktemp("added")
    package = folder / "looping_pendulum"
    shutil.copytree(PROJECT / "looping_pendulum", package, ignore=shutil.ignore_patterns("__pycache__"))
    (package / "engines" / "spring.py").write_text(page_package.blocks(PROJECT / "docs/write-an-engine.md", "python")[0])
    texts = package / "live" / "assets" / "texts"
    croatian = (
        (texts / "de.js").read_text(encoding="utf-8").replace("const de =", "const hr =").replace('"Deutsch"', '"Hrvatski"')
    )
    (texts / "hr.js").write_text(croatian, encoding="utf-8")
    for places in ADDED.values():
        for file, there, then in places:
            text = (package / file).read_text(encoding="utf-8")
            assert text.count(there) == 1, f"{file}: {there}"
            if then.startswith("\n"):
                then = textwrap.dedent(then).lstrip("\n").rstrip(" ")
                indent = " " * (len(there) - len(there.lstrip(" ")))
                then = textwrap.indent(then, indent)
            (package / file).write_text(text.replace(there, then), encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def found(copy, tmp_path_factory):
    """Return what a process that imports the copy says of what was added."""
    work = tmp_path_factory.mktemp("work")
    path = os.pathsep.join([str(copy), str(PROJECT)])
    process = subprocess.run(
        [sys.executable, "-P", "-c", SCRIPT, str(work)], capture_output=True, text=True, cwd=work,
        env=os.environ | {"PYTHONPATH": path}, timeout=240,
    )  # fmt: skip
    assert process.returncode == 0, process.stderr
    return json.loads(process.stdout.splitlines()[-1])


SCRIPT = """
import json, sys
from pathlib import Path
import numpy as np
import looping_pendulum as lp
from looping_pendulum.discrepancy.fit.problem import Problem, predict_requests
from looping_pendulum.discrepancy.inputs import read_inputs
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.registry import all_engines, label
from looping_pendulum.live.write import render
from looping_pendulum.measured.readers import read
from looping_pendulum.measured.study_file import StudyFile
from looping_pendulum.measured.study_io import load
from looping_pendulum.scenarios.schema import file_model
from looping_pendulum.sweep.cells import FIELDS
from scripts import keys_page, metrics_page
from tests.blind.cases import CASES
from tests.discrepancy.blind_study import write_study

work = Path(sys.argv[1])
found = {"package": lp.__file__}
found["scenario schema"] = json.dumps(file_model().model_json_schema())
found["study schema"] = json.dumps(StudyFile.model_json_schema())
found["keys"], found["metrics"] = keys_page.page(), metrics_page.page()
found["fields"] = [f.name for f in FIELDS]
found["engines"] = [label(e) for e in all_engines(Profile.QUICK)]

scenario = lp.load("ten_to_one")
run = lp.solve(scenario.parameters)
lifted = lp.solve(scenario.parameters.replace(lift=1e-3))
found["lifted"] = lifted.halt.time - run.halt.time
batch = lp.solve_batch(scenario.parameters, {"lift": np.array([0.0, 1e-3])})
found["map"] = batch.across_speed.tolist(), [run.end.state.across_speed, lifted.end.state.across_speed]

inputs = read_inputs(load(write_study(work / "study", CASES["clean_varied"], 3, trials=["ten_a"])))
problem = Problem(inputs.study, inputs.training, inputs.free_parameters)
found["changes"] = {}
for c in inputs.library:
    if c.name in ("lift", "sag"):
        extended = problem.with_parameters(c.free_parameter(1e-3))
        (rows,) = predict_requests([(extended, np.vstack([np.zeros(len(extended.names)), np.eye(len(extended.names))[-1]]))])
        found["changes"][c.name] = float(np.nanmax(np.abs(rows[1] - rows[0])))

table = work / "table.csv"
table.write_text("vrijeme,x,y\\n" + "".join(f"{0.01 * i},{0.4 + 0.001 * i},0.1\\n" for i in range(30)))
found["table"] = read(table, tracks={"light": ""}).channels[0].t.tolist()

lp.write(lp.compare_engines(scenario, engines=["spring"], jobs=1), work / "report")
for name in ("result.json", "report.md", "report.html"):
    (path,) = (work / "report").rglob(name)
    found[name] = path.read_text(encoding="utf-8")
found["live"] = render()
print(json.dumps(found))
"""


def test_the_copy_is_what_is_asked(copy, found):
    assert found["package"].startswith(str(copy))


def test_an_effect_is_found_in_schemas_pages_runs_and_fits(found):
    """One row in one file: single runs and batches move alike, and a study has it among its candidates."""
    assert '"lift"' in found["scenario schema"]
    assert "lift coefficient lambda" in found["keys"]
    assert found["lifted"] != 0
    assert found["changes"]["lift"] > 1e-6


def test_an_error_of_the_camera_is_found_in_the_schema_the_page_of_keys_and_fits(found):
    """Oracle: 1e-3 of it moves a point at most 0.5 m beside the rod down by less than 1 mm, and one somewhere by 0.01 mm."""
    assert '"sag"' in found["study schema"]
    assert "how the picture hangs" in found["keys"]
    assert 1e-5 < found["changes"]["sag"] < 1e-3


def test_a_metric_is_found_in_the_schema_its_page_and_results(found):
    assert '"last_sample"' in found["scenario schema"]
    assert "| `last_sample` | s | s | at most | Time of the last sample. |" in found["metrics"]
    result = json.loads(found["result.json"])
    (run,) = result["engines"]
    assert run["metrics"]["last_sample"] == run["metrics"]["simulated_time"]


def test_a_variable_of_maps_is_computed_by_batches_as_by_single_runs(found):
    batch, single = found["map"]
    assert batch == pytest.approx(single, rel=1e-9)
    assert "across_speed" in found["fields"]
    assert "| `across_speed` | m/s | speed of the light mass across the string at the end of the run |" in found["metrics"]


def test_a_word_of_a_tables_head_is_read(found):
    assert found["table"] == pytest.approx([0.01 * i for i in range(30)])


def test_an_engine_runs_and_is_reported(found):
    assert "spring:euler" in found["engines"]
    assert "spring" in found["report.md"]
    assert "spring" in found["report.html"]


def test_a_language_is_offered_by_the_page(found):
    assert "Hrvatski" in found["live"]
