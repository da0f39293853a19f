"""Every module of the project is imported and every script compiled, so that no command breaks unseen."""

import importlib
import subprocess
import sys
from pathlib import Path

import pytest

from looping_pendulum.errors import MissingPackageError

PROJECT = Path(__file__).parents[1]
IMPORTED = ("looping_pendulum", "tests", "benchmarks", "scripts", "research")
COMPILED = ("engine_claims",)
"""Folders whose scripts run an engine as soon as they are imported."""
RUNS_ON_IMPORT = {
    "looping_pendulum.engines.worker": "it is the program of an engine's process",
    "looping_pendulum.__main__": "it is the command itself",
}


def files_below(folders):
    return [path for folder in folders for path in sorted((PROJECT / folder).rglob("*.py"))]


def module_names():
    for path in files_below(IMPORTED):
        parts = path.relative_to(PROJECT).with_suffix("").parts
        is_ours = all((PROJECT.joinpath(*parts[:n]) / "__init__.py").exists() for n in range(1, len(parts)))
        if path.name == "__init__.py":
            parts = parts[:-1]
        # A folder without __init__.py at the top is one of scripts; deeper ones hold examples and files of other programs
        # Demonstrations, whose names begin with a digit, run as soon as they are imported; `tests/demonstrations` runs them
        if (is_ours or len(parts) == 2) and path.stem.isidentifier():
            yield ".".join(parts)


@pytest.mark.parametrize("name", [name for name in module_names() if name not in RUNS_ON_IMPORT])
def test_a_module_can_be_imported(name):
    try:
        importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name.partition(".")[0] in IMPORTED:
            raise
        pytest.skip(f"{error.name} is not installed")
    except MissingPackageError as error:
        pytest.skip(str(error))


@pytest.mark.parametrize("path", files_below(COMPILED), ids=lambda path: path.relative_to(PROJECT).as_posix())
def test_a_script_can_be_compiled(path):
    compile(path.read_text(encoding="utf-8"), path.name, "exec")


@pytest.mark.parametrize("name", ["discrepancy.identify", "discrepancy.fit_study", "measured.film_points"])
def test_what_a_search_waits_for_imports_nothing_slow_that_it_does_not_use(name):
    """The import of scipy.stats took a quarter of a second, for the density of Student's t."""
    program = f"import sys, looping_pendulum.{name}; print({{'matplotlib', 'pandas', 'scipy.stats'}}.intersection(sys.modules))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"
