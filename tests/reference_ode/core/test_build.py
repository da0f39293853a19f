"""The driver in the package is what its sources give."""

import hashlib
import importlib.util
import shutil
from importlib.resources import files
from pathlib import Path

import pytest

from looping_pendulum.reference_ode.core import build

CORE = Path(str(files("looping_pendulum.reference_ode.core")))
needs_compiler = pytest.mark.skipif(
    importlib.util.find_spec("ziglang") is None, reason="the compiler is not installed: `pip install ziglang==0.17.1`"
)


def digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def test_the_stages_are_those_of_scipys_method():
    assert (CORE / "stages.h").read_text(encoding="utf-8") == build.stages()


@pytest.mark.long
@needs_compiler
def test_the_driver_compiled_anew_has_the_same_bytes(tmp_path):
    for name in ("driver.c", "stages.h"):
        shutil.copy(CORE / name, tmp_path / name)
    build.compile_driver(tmp_path, tmp_path / "driver.wasm")
    again = "run `python -m looping_pendulum.reference_ode.core.build`, and commit what it writes"
    assert digest(tmp_path / "driver.wasm") == digest(CORE / "driver.wasm"), again
