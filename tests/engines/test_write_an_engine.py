"""The worked example of docs/write-an-engine.md: its code is taken from the page, installed and held against the suite."""

import re
import sys

import pytest

from looping_pendulum.engines.conformance import (
    CHECKS,
    LOSSLESS,
    CachedEngine,
    error_is_covered_by_refinement,
    scenario,
    skip_reason,
)
from looping_pendulum.engines.protocol import Engine, Profile
from looping_pendulum.engines.studies import Studies
from looping_pendulum.errors import EngineError
from tests import page_package
from tests.command_line import here
from tests.engines.faulty import forget_adapters
from tests.engines.page_example import PAGE, blocks, module
from tests.page_package import python


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    return page_package.install(PAGE, "looping_spring", tmp_path_factory)


@pytest.fixture(scope="module")
def spring():
    return module("looping_spring", blocks("python")[0])


@pytest.fixture(scope="module")
def engine(spring):
    (made,) = spring.engines(Profile.QUICK)
    return CachedEngine(made)


@pytest.fixture
def installed(package, monkeypatch):
    """Return the package's engine, offered in this process as in a new one."""
    monkeypatch.syspath_prepend(str(package))
    monkeypatch.delitem(sys.modules, "looping_spring", raising=False)
    forget_adapters()
    yield
    forget_adapters()
    sys.modules.pop("looping_spring", None)


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_the_example_passes_every_check(engine, check):
    assert isinstance(engine, Engine)
    if skip_reason(check, engine):  # an effect of a kind that it does not declare
        assert "effect" in skip_reason(check, engine)
        return
    check(engine)


@pytest.mark.accurate  # the test above makes the same checks daily
def test_the_command_examines_it(package):
    done = python(package, "-m", "looping_pendulum", "conformance", "spring")
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("  pass ") > 30
    assert "  fail" not in done.stdout


@pytest.mark.long
@pytest.mark.usefixtures("installed")
def test_the_list_says_where_it_is_from():
    done = here("engines")
    assert "spring:euler" in done.stdout
    assert "of the package looping-spring" in re.sub(r"\s+", " ", done.stdout)
    assert done.stderr == ""


@pytest.mark.long
@pytest.mark.usefixtures("installed")
def test_compare_runs_it_beside_the_others(tmp_path):
    done = here("compare", "ten_to_one", "-e", "spring", "-e", "reference", "--out", str(tmp_path))
    assert done.returncode == 0, done.stdout + done.stderr
    assert "spring:euler" in (tmp_path / "report.md").read_text()
    assert "looping-spring 0.1" in (tmp_path / "report.md").read_text()


def test_its_studies_are_ladders_that_run(engine, spring):
    studies = engine.studies()
    assert [(one.setting, len(one.values)) for one in studies.ladders] == [("time_step", 4), ("stiffness", 4)]
    coarsest, *others = (*(one.changes[0] for one in studies.ladders), *(choice.changes for choice in studies.choices))
    assert engine.with_settings(**coarsest).settings == engine.settings
    for changes in others:
        changed = engine.with_settings(**changes)
        assert changed.simulate(scenario(LOSSLESS, 0.002)).status.ok
        assert changed.settings != engine.settings


@pytest.mark.parametrize("left", [9, 11])
def test_a_reading_of_another_length_says_what_it_needs(spring, left):
    # It was a bare "IndexError: tuple index out of range", from a line of ours.
    class Misread(spring.SpringRig):
        def read(self):
            return (*super().read(), 0.0, 0.0)[:left]

    class MisreadEngine(spring.SpringEngine):
        rig = Misread

    with pytest.raises(EngineError, match=rf"a sample: found {left + 1} values .*needed 11: t, light_x, .*read\(\) gives all"):
        MisreadEngine().simulate(scenario(LOSSLESS, 0.002))


@pytest.mark.accurate
def test_converge_refines_its_ladders(package, tmp_path):
    done = python(
        package, "-m", "looping_pendulum", "converge", "ten_to_one", "-e", "spring", "--until", "0.36", "--out", str(tmp_path)
    )
    assert done.returncode == 0, done.stdout + done.stderr
    report = (tmp_path / "convergence.md").read_text()
    assert "Refining `time_step`" in report
    assert "Refining `stiffness`" in report
    assert "no ladder" not in report


def test_the_error_of_an_engine_without_a_ladder_names_the_page_that_has_one(spring):
    class Plain(spring.SpringEngine):
        def studies(self):
            return Studies()

    page = "studies(), in docs/write-an-engine.md"
    assert skip_reason(error_is_covered_by_refinement, Plain()) == f"it offers no ladder: {page}"


def test_the_pages_test_snippet_runs(package, tmp_path):
    (tmp_path / "test_spring.py").write_text(blocks("python")[1])
    without = [option for name in ("hypothesispytest", "zarr", "cacheprovider") for option in ("-p", f"no:{name}")]
    asked = ["-m", "pytest", "-q", *without, "-k", "heavy or rest or supplies", str(tmp_path)]
    done = python(package, *asked, folder=tmp_path)
    assert done.returncode == 0, done.stdout
    assert "passed" in done.stdout
