"""Adapters of other packages: a broken one is one clear line and stops none of the others."""

import sys
import warnings

import pytest

from looping_pendulum.engines import registry
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.registry import (
    AdapterWarning,
    all_engines,
    label,
    load_engines,
    main_engines,
    missing_packages,
    select,
)
from looping_pendulum.errors import EngineError
from tests.command_line import here
from tests.engines.faulty import FaultyEngine

GOOD = """
from tests.engines.faulty import FaultyEngine

class Good(FaultyEngine):
    name = "good"

def engines(profile):
    return [Good("none")]
"""
BROKEN = {
    "raises": ("raise ValueError('no\\nlicence')\n", "ValueError: no licence"),
    "exits": ("import sys\nsys.exit(3)\n", "SystemExit: 3"),
    "empty": ("\n", "has no attribute 'engines'"),
    "lists_nothing_known": (
        "def engines(profile):\n    return [object()]\n",
        "gave object without name, variant, profile, abilities, settings, simulate, studies",
    ),
    "calls_itself_else": (GOOD, "gave one called 'good'; needed the entry point's name, 'calls_itself_else'"),
    "doubles": (
        GOOD.replace('"good"', '"doubles"').replace("[Good", "2 * [Good"),
        "gave two of one name among doubles:none, doubles:none",
    ),
    "settled": (
        GOOD.replace('"good"', '"settled"') + "    # never reached\n" + "class Odd(Good):\n    pass\n"
        "def engines(profile):\n    odd = Odd('none')\n    odd.settings = {}\n    return [odd]\n",
        "settled:none: settings are dict, needed a frozen dataclass",
    ),
    "pymunk": (GOOD.replace('"good"', '"pymunk"'), "the name 'pymunk' is taken"),
}


@pytest.fixture
def offer(tmp_path, monkeypatch):
    """Install adapters of another package: name -> source."""

    def install(**adapters):
        points = "[looping_pendulum.engines]\n"
        for name, source in adapters.items():
            module = f"adapter_{name}"
            monkeypatch.delitem(sys.modules, module, raising=False)
            if source is not None:
                (tmp_path / f"{module}.py").write_text(source)
            points += f"{name} = {module}\n"
        info = tmp_path / "elsewhere-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: elsewhere\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(points)
        monkeypatch.syspath_prepend(str(tmp_path))
        registry.adapter_modules.cache_clear()
        return tmp_path

    yield install
    registry.adapter_modules.cache_clear()


def test_another_packages_engine_is_one_of_the_main_engines(offer):
    offer(good=GOOD)
    assert "good:none" in [label(engine) for engine in main_engines(Profile.QUICK)]
    assert [label(engine) for engine in select(["good"], Profile.QUICK)] == ["good:none"]
    assert registry.adapter_packages()["good"] == "elsewhere"


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_adapter_is_one_line_and_stops_no_other(offer, name):
    before = [label(engine) for engine in all_engines(Profile.QUICK)]
    source, why = BROKEN[name]
    offer(**{name: source, "good": GOOD})
    with pytest.warns(AdapterWarning) as caught:
        engines = all_engines(Profile.QUICK)
    assert sorted(map(label, engines)) == sorted([*before, "good:none"])
    (message,) = {str(warning.message) for warning in caught}
    assert message.startswith(f"engine {name!r} is left out: adapter adapter_{name} of the package elsewhere: ")
    assert why in message
    assert message.endswith("; mend or uninstall that package")
    assert "\n" not in message
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert [label(engine) for engine in select(["good"], Profile.QUICK)] == ["good:none"]  # not asked for: not spoken of
        if name != "pymunk":
            with pytest.raises(EngineError, match=f"--engine: engine '{name}' is left out"):
                select([f"{name}:x"], Profile.QUICK)
    with pytest.warns(AdapterWarning):
        select(["all"], Profile.QUICK)


def test_a_module_that_is_not_there_is_a_broken_adapter(offer):
    offer(nowhere=None)
    faults = load_engines(Profile.QUICK)[1]
    assert "ModuleNotFoundError: No module named 'adapter_nowhere'" in faults["nowhere"]


def test_on_the_command_line_a_broken_adapter_is_a_warning_and_a_gap_in_the_list(offer, tmp_path):
    offer(raises=BROKEN["raises"][0])
    line = "engine 'raises' is left out: adapter adapter_raises of the package elsewhere: ValueError: no licence"
    done = here("engines")
    assert done.returncode == 0
    assert "broken" in done.stdout
    assert line in done.stdout
    done = here("engines", "--support")
    assert done.returncode == 0
    assert [text for text in done.stderr.splitlines() if text] == [f"warning: {line}; mend or uninstall that package"]
    done = here("compare", "drop", "-e", "raises", "--out", str(tmp_path / "out"))
    assert done.returncode == 2
    assert [text for text in done.stderr.splitlines() if text] == [f"error: --engine: {line}; mend or uninstall that package"]


def test_a_package_inside_one_that_is_missing_is_missing():
    assert missing_packages(FaultyEngine("none", packages=("no_such.part", "numpy"))) == ("no_such.part",)
