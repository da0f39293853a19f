"""Runs scripts for an engine's users as a stranger would: in a process that cannot import this package."""

import ast
import importlib.util
import re
import subprocess
import sys
import sysconfig
from importlib.metadata import version

import pytest
from packaging.version import Version

MODULES = {
    **{engine: engine for engine in ("mujoco", "pymunk", "pybullet", "exudyn", "newton")},
    **{"drake": "pydrake", "box2d": "pyb2d3", "rapier": "rapier3d"},
}
"""Engine -> the module that its scripts import."""
COMPANIONS = {"numpy", "warp"}
"""Further modules that a script may import: NumPy, and Newton's own language."""
SLOW = {"newton"}
"""Engines that compile themselves, which takes minutes: only the accurate tests run their scripts."""
STRANGER = """
import runpy, sys
sys.path.append(sys.argv[2])
sys.modules["looping_pendulum"] = None  # an installed package stands beside the engine
try:
    import looping_pendulum
except ImportError:
    runpy.run_path(sys.argv[1], run_name="__main__")
raise SystemExit(3)
"""
"""Runs a script where no .pth file, no PYTHONPATH, no folder of the project and no installed copy leads to this package."""


def installed(engine):
    return importlib.util.find_spec(MODULES[engine]) is not None


def skip_unless_installed(engine):
    if not installed(engine):
        pytest.skip(f"{MODULES[engine]} is not installed")


def accurate_if_slow(engine):
    return [pytest.mark.accurate] if engine in SLOW else []


def run(script):
    command = [sys.executable, "-I", "-S", "-c", STRANGER, str(script), sysconfig.get_path("platlib")]
    return subprocess.run(command, capture_output=True, text=True, timeout=600)


def written(claim, folder, source=None):
    path = folder / claim.file_name
    path.write_text(source or claim.source, encoding="utf-8")
    return path


def printed(pattern, done):
    """What a script printed last, in the words of ``pattern``; PyBullet prints a line when it is imported, too."""
    found = re.search(pattern + r"\Z", done.stdout)
    assert found is not None, done.stdout + done.stderr
    return found.groups()


def assert_as_its_head_says(claim, pattern, done):
    expected, unit, limit, observed, package, used, verdict = printed(pattern, done)
    assert float(expected) == pytest.approx(claim.expected, abs=1e-5)  # the head's last digit
    assert float(observed) == pytest.approx(claim.observed, abs=claim.spread)
    assert (unit.strip(), float(limit), package, verdict) == (claim.unit, claim.limit, claim.package, "holds")
    # A later release may be installed; the value above says whether it still behaves so.
    assert used == version(claim.package)
    assert Version(used) >= Version(claim.version)


def assert_stands_alone(claim):
    assert len(claim.source.splitlines()) <= 60
    modules = set()
    for node in ast.walk(ast.parse(claim.source)):
        if isinstance(node, ast.Import):
            modules |= {name.name for name in node.names}
        elif isinstance(node, ast.ImportFrom):
            modules.add(node.module)
    foreign = {module.partition(".")[0] for module in modules} - sys.stdlib_module_names
    assert foreign - COMPANIONS == {MODULES[claim.engine]}
