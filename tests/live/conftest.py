"""The JavaScript engines in which the live model runs."""

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from looping_pendulum.live.write import bundle
from tests.live.cases import RUN_IN_PAGE

FOLDER = Path(__file__).parent


@pytest.fixture(scope="session")
def node():
    """Run a module of this folder in Node: ``node(name, data)`` gives it JSON and returns the JSON that it prints."""
    path = shutil.which("node")
    if path is None:
        pytest.skip("Node is not installed (Debian: apt install nodejs)")

    def run(module: str, data: Any) -> Any:
        done = subprocess.run([path, FOLDER / module], input=json.dumps(data), capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return run


@pytest.fixture(scope="module")
def browser(chromium):
    """Run cases in Chromium, by the script that a page embeds."""
    page = chromium.new_page()
    page.evaluate(bundle("run.js") + "\nglobalThis.loopingPendulum = { ...module_model, ...module_run };\nmodule_run.ready")

    def run(cases: list[dict[str, Any]]) -> list[dict[str, Any]]:
        runs: list[dict[str, Any]] = page.evaluate(RUN_IN_PAGE, cases)
        return runs

    yield run
    page.close()
