"""The JavaScript engines in which the live model runs."""

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from scripts.live_page import bundle
from tests.live.cases import IN_PAGE

FOLDER = Path(__file__).parent


@pytest.fixture(scope="session")
def node():
    """
    Run a module of this folder in Node: ``node(name, data)`` gives it JSON and returns the JSON that it prints.

    In a single thread, as Node may wait for ever for its own compiling threads when it ends (nodejs/node#54918).
    """
    path = shutil.which("node")
    if path is None:
        pytest.skip("Node is not installed (Debian: apt install nodejs)")

    def run(module: str, data: Any) -> Any:
        command = [path, "--single-threaded", FOLDER / module]
        done = subprocess.run(command, input=json.dumps(data), capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return run


@pytest.fixture(scope="module")
def browser(chromium, esbuild):
    """Run a module of this folder in Chromium, by a script that esbuild makes as the page's: what `node` does."""
    page = chromium.new_page()
    exported = "\n".join(f'export * from "./{name}.js";' for name in ("model", "core", "run"))
    name = "loopingPendulum"
    page.evaluate(bundle(exported, f"--global-name={name}", f"--footer:js=globalThis.{name} = {name};"))
    page.evaluate("loopingPendulum.ready")
    yield lambda module, data: page.evaluate(IN_PAGE[module], data)
    page.close()
