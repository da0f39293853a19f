"""What a shell is offered at a press of Tab."""

import os
import subprocess
import sys

import pytest

from looping_pendulum.cli.common import engine_names, map_names, scenario_names
from looping_pendulum.engines import registry
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.scenarios import loader
from looping_pendulum.sweep import map_file

COMPLETE = """
import sys
sys.argv = ["looping-pendulum"]
from looping_pendulum.cli.main import main
try:
    main()
finally:
    print(*sorted({"numpy", "scipy", "pint", "yaml"} & set(sys.modules)), file=sys.stderr)
"""


def completed(line):
    """What bash is offered for the last word of a line, and which heavy packages were imported for it."""
    words = line.split(" ")
    asked = {"_LOOPING_PENDULUM_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(len(words) - 1)}
    done = subprocess.run([sys.executable, "-c", COMPLETE], capture_output=True, text=True, timeout=60, env=os.environ | asked)
    assert done.returncode == 0, done.stderr
    return done.stdout.split(), done.stderr.strip()


@pytest.mark.long
@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("looping-pendulum comp", ["compare"]),
        ("looping-pendulum compare ten", ["ten_to_one"]),
        ("looping-pendulum run drop --engine pymunk:c", ["pymunk:chain"]),
        ("looping-pendulum map qu", ["quick"]),
        ("looping-pendulum new st", ["study"]),
        ("looping-pendulum identify --sch", ["--schema"]),
        ("looping-pendulum identify stud", []),  # a file: the shell's own completion takes over
    ],
)
def test_names_are_completed_without_a_heavy_import(line, offered):
    assert completed(line) == (offered, "")


def test_the_names_are_those_of_the_registries():
    assert scenario_names() == loader.shipped()
    assert map_names() == map_file.shipped()
    engines = [engine for engine in registry.all_engines(Profile.QUICK) if engine.name in registry.own_engines()]
    assert {registry.label(engine) for engine in engines} <= set(engine_names())
    assert {adapter.name for adapter in registry.adapter_modules()} <= set(engine_names())
    assert registry.ALL_VARIANTS in engine_names()
