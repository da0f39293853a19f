"""The pytest plugin as a user meets it: what it collects, what a failure shows, and what it costs those who do not use it."""

import os
import re
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from looping_pendulum.compare import figures, harness  # noqa: F401, for `_all_is_imported`
from looping_pendulum.engines import registry
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.reference_ode.solve import solve
from looping_pendulum.scenarios import loader
from looping_pendulum.scenarios.units import to_si
from tests.command_line import can_be_interrupted
from tests.compare.conftest import quick_figures  # noqa: F401, for the sessions whose reports are not what a test is about
from tests.engines.faulty import adapter_of

pytest_plugins = "pytester"

ROOT = Path(__file__).parents[1]

TOLERANCES = """
tolerances:
  reference:
    quick:
      rms_0.35s: {limit: 1 mm, reason: a coarser step against a finer one}
      tube_fraction: {limit: 1.5, reason: no share is above 1}
    accurate:
      rms_0.35s: {limit: 1 mm, reason: of the other profile}
"""
EXPECTED = """
tolerances:
  faulty:none:
    quick:
      tube_fraction: {limit: 1.5, reason: no share is above 1, expected_failure: measured 1}
      string_stretch: {limit: 1 mm, reason: there is none, expected_failure: wrongly declared}
"""
OTHERS = """
tolerances:
  faulty:missing:
    quick:
      rms_0.35s: {limit: 1 mm, reason: its package is missing}
  faulty:segfault:
    quick:
      string_stretch: {limit: 1 m, reason: kept before it dies}
"""


HANGING = """
tolerances:
  faulty:hang:
    quick:
      string_stretch: {limit: 1 m, reason: kept before it hangs}
"""


MISSING = """
tolerances:
  faulty:missing:
    quick:
      rms_0.35s: {limit: 1 mm, reason: its package is missing}
"""
BY_NAME = """
tolerances:
  faulty:
    quick:
      string_stretch: {limit: 1 m, reason: of both main variants}
  faulty:other:
    quick:
      string_stretch: {limit: 0 m, reason: "of this one", expected_failure: "wrongly declared"}
"""


def drop(tolerances):
    text = loader.source_text("drop")
    return text[: text.index("tolerances:")] + tolerances.lstrip()


@pytest.fixture(scope="module")
def _all_is_imported():
    """Import what sessions do: each forgets at its end what it was first to import, and NumPy and its like come only once."""
    registry.all_engines(Profile.QUICK)
    solve(loader.load("drop").parameters)
    to_si("1 in", "m")  # pint, whose import replaces finders of packages


@pytest.fixture
def project(pytester, _all_is_imported):
    """A project of somebody else; the arguments are file names and their tolerances."""

    def make(**files):
        for name, tolerances in files.items():
            (pytester.path / f"{name}.scenario.yaml").write_text(drop(tolerances), encoding="utf-8")
        return pytester

    return make


OTHER_PLUGINS = ("hypothesispytest", "zarr", "playwright", "base_url", "anyio")
"""Plugins of the packages around us, blocked but where a test is about them: their imports take longer than a test."""

BLOCKED = [option for name in OTHER_PLUGINS for option in ("-p", f"no:{name}")]


def run(pytester, *arguments, process=False):
    """Run a session: in this process, unless that is what the test is about."""
    method = pytester.runpytest_subprocess if process else pytester.runpytest_inprocess
    return method("-W", "error", "--strict-markers", *BLOCKED, *arguments)


def test_who_does_not_use_it_pays_nothing():
    """It imports no module but its own: 4 ms, where NumPy alone takes a hundred."""
    program = (
        "import sys, pytest; before = set(sys.modules); import looping_pendulum.pytest_plugin;"
        "print(sorted(name for name in set(sys.modules) - before if name.split('.')[0] not in sys.stdlib_module_names))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "['looping_pendulum', 'looping_pendulum.pytest_plugin']"


@pytest.mark.long
def test_a_project_without_scenarios_stays_light(pytester):
    pytester.makepyfile("""
        import sys
        def test_mine():
            assert "looping_pendulum.pytest_plugin" in sys.modules
            assert not {"numpy", "yaml", "pydantic", "looping_pendulum.scenarios"} & set(sys.modules)
    """)
    (pytester.path / "values.yaml").write_text("light: on\n")
    (pytester.path / "mine.yaml").write_text(drop(TOLERANCES))
    # Neither file is named so, or on the command line. (zarr brings a plugin of its own, which imports numpy.)
    done = pytester.runpytest_subprocess("-W", "error", "--strict-markers", "-p", "no:zarr")
    done.assert_outcomes(passed=1)


def test_limits_are_items_and_a_failure_shows_the_judgement(project):
    pytester = project(mine=TOLERANCES)
    done = run(pytester, "mine.scenario.yaml", "-v", "--junitxml=junit.xml")
    done.assert_outcomes(passed=2, failed=1)
    done.stdout.fnmatch_lines(
        [
            "mine.scenario.yaml::reference::run PASSED*",
            "mine.scenario.yaml::reference::rms_0.35s PASSED*",
            "mine.scenario.yaml::reference::tube_fraction FAILED*",
            "mine.scenario.yaml, reference, quick: tube_fraction is 100 %, limit at least 150 %",
            "*why this limit: no share is above 1",
            "*where and why: Stays within 1 mm of the reference*",
            "*the run: *ran for the scenario's whole duration",
            "*report: *report.md",
        ]
    )
    assert "Traceback" not in done.stdout.str()
    assert "pytest_plugin.py" not in done.stdout.str()
    report = re.search(r"report: +(.*report\.md)", done.stdout.str())[1]
    assert "tube_fraction" in Path(report).read_text(encoding="utf-8")
    cases = list(ElementTree.parse(pytester.path / "junit.xml").iter("testcase"))
    assert [(case.get("classname"), case.get("name")) for case in cases] == [
        ("mine.scenario.yaml.reference", name) for name in ("run", "rms_0.35s", "tube_fraction")
    ]
    assert "150 %" in cases[2].find("failure").text
    one = run(pytester, "mine.scenario.yaml::reference::rms_0.35s")
    one.assert_outcomes(passed=1)


def test_any_scenario_named_on_the_command_line_is_collected_and_other_yaml_is_not(pytester):
    (pytester.path / "plain.yaml").write_text(drop(TOLERANCES))
    (pytester.path / "other.yaml").write_text("a: 1\n")
    done = run(pytester, "plain.yaml", "--collect-only", "-q", "-k", "rms")
    done.stdout.fnmatch_lines(["plain.yaml::reference::rms_0.35s"])
    assert "tube_fraction" not in done.stdout.str()
    assert run(pytester, "other.yaml").ret == pytest.ExitCode.USAGE_ERROR


@pytest.mark.parametrize("option", ["--setup-plan", "--setup-only"])
def test_a_session_that_only_shows_setups_is_a_success_though_nothing_is_judged(pytester, option):
    (pytester.path / "mine.scenario.yaml").write_text(drop(TOLERANCES))
    done = run(pytester, "mine.scenario.yaml", option)
    assert done.ret == pytest.ExitCode.OK
    done.stdout.fnmatch_lines(["*mine.scenario.yaml::reference::rms_0.35s*"])
    assert "nothing was judged" not in done.stdout.str()


@pytest.mark.long
@pytest.mark.usefixtures("quick_figures")
def test_expected_failures_are_strict(project, offer):
    pytester = project(mine=EXPECTED)
    offer(faulty=adapter_of("FaultyEngine('none', releases=Release)"))
    done = run(pytester, "-rx")
    done.assert_outcomes(passed=1, xfailed=1, failed=1)
    done.stdout.fnmatch_lines(
        ["*string_stretch is *", "*passes although a failure is expected*", "XFAIL *tube_fraction - measured 1"]
    )
    run(pytester, "--runxfail").assert_outcomes(passed=1, failed=2)


@pytest.mark.usefixtures("quick_figures")
def test_engines_that_are_not_here_are_skips_with_the_way_to_get_them_and_crashes_fail_one_item(project, offer):
    pytester = project(mine=OTHERS)
    engines = (
        "FaultyEngine('missing', packages=('no_such_package',), releases=Release)",
        "FaultyEngine('segfault', releases=Release)",
    )
    offer(faulty=adapter_of(*engines))
    done = run(pytester, "-rs")
    done.assert_outcomes(skipped=2, failed=1, passed=1)
    done.stdout.fnmatch_lines_random(
        [
            "*faulty:segfault, quick: its run broke off: the engine's process died*",
            "*killed by signal SIGSEGV",
            "SKIPPED *no_such_package is not installed; to get it: `*pip install *no_such_package`",
        ]
    )
    assert "Traceback" not in done.stdout.str()
    assert done.ret == pytest.ExitCode.TESTS_FAILED


@pytest.mark.long
def test_a_session_that_judges_nothing_is_no_success(project, offer):
    pytester = project(gap=MISSING, bare="tolerances: {}", mine=TOLERANCES)
    offer(faulty=adapter_of("FaultyEngine('missing', packages=('no_such_package',), releases=Release)"))
    done = run(pytester, "gap.scenario.yaml", "-rs")
    done.assert_outcomes(skipped=2, errors=1)  # the gap stays visible
    assert done.ret == pytest.ExitCode.TESTS_FAILED
    done.stdout.fnmatch_lines_random(
        [
            "SKIPPED *no_such_package is not installed; to get it: `*pip install *no_such_package`",
            "gap.scenario.yaml: nothing was judged: faulty:missing: no_such_package is not installed*",
        ]
    )
    done = run(pytester, "bare.scenario.yaml")
    done.assert_outcomes(errors=1)
    assert done.ret == pytest.ExitCode.TESTS_FAILED
    done.stdout.fnmatch_lines(
        ["bare.scenario.yaml: nothing was judged: no tolerances for profile quick: add some under `tolerances:`"]
    )
    done = run(pytester, "mine.scenario.yaml", "--lp-engines", "pymunk", "-rs")
    done.assert_outcomes(errors=1)
    done.stdout.fnmatch_lines(["mine.scenario.yaml: nothing was judged: *asked for: it has them for reference"])
    done = run(pytester, "bare.scenario.yaml", "mine.scenario.yaml", "-k", "tolerances or rms")
    done.assert_outcomes(errors=1, passed=1)  # the other file is judged all the same
    assert done.ret == pytest.ExitCode.TESTS_FAILED
    assert run(pytester, "bare.scenario.yaml", "--collect-only").ret == pytest.ExitCode.OK


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("pymunk:chian", "no engine is called 'pymunk:chian'; did you mean 'pymunk:chain'?*"),
        ("drake", "'drake' has no main variant; write one of drake:chain"),
    ],
)
def test_an_unknown_engine_in_a_tolerance_is_an_error(project, name, message):
    pytester = project(mine=TOLERANCES.replace("reference", name))
    done = run(pytester, "mine.scenario.yaml")
    done.assert_outcomes(errors=1)
    assert done.ret == pytest.ExitCode.INTERRUPTED  # the number 2, as of `check`
    done.stdout.fnmatch_lines([f"mine.scenario: tolerances: {message}"])
    assert "Traceback" not in done.stdout.str()


@pytest.mark.long
@pytest.mark.usefixtures("quick_figures")
def test_an_engines_name_means_its_main_variants(project, offer):
    pytester = project(mine=BY_NAME)
    engines = (
        "FaultyEngine('one', releases=Release)",
        "FaultyEngine('other', releases=Release)",
        "FaultyEngine('study', releases=Release, main=False)",
    )
    offer(faulty=adapter_of(*engines))
    done = run(pytester, "mine.scenario.yaml", "-v")
    node_names = [
        line.partition("::")[2].partition(" ")[0] for line in done.stdout.lines if line.startswith("mine.scenario.yaml::")
    ]
    assert node_names == [f"faulty:{name}::{metric}" for name in ("one", "other") for metric in ("run", "string_stretch")]
    done.assert_outcomes(passed=3, failed=1)  # 0 m of stretch: the limit under the variant's own name counts
    done.stdout.fnmatch_lines(["*faulty:other, quick: string_stretch is 0 mm, limit at most 0 mm"])


def test_faults_of_files_and_options_are_one_line_each(project):
    pytester = project(mine=TOLERANCES)
    broken = (pytester.path / "mine.scenario.yaml").read_text().replace("10 g", "10 mm", 1)
    (pytester.path / "broken.scenario.yaml").write_text(broken)
    done = run(pytester, "broken.scenario.yaml")
    done.assert_outcomes(errors=1)
    done.stdout.fnmatch_lines(["*broken.scenario.yaml:*: light.mass: expected a mass, got '10 mm'; write for example '10 g'"])
    assert "Traceback" not in done.stdout.str()
    done = run(pytester, "mine.scenario.yaml", "--lp-engines", "refrence")
    done.stdout.fnmatch_lines(["--lp-engines: no engine is called 'refrence'; did you mean 'reference'?*"])
    assert done.ret == pytest.ExitCode.INTERRUPTED


@pytest.mark.accurate  # two further sessions of pytest; daily, one process shares its runs
def test_workers_share_one_run_of_an_engine(project):
    pytest.importorskip("xdist")
    pytester = project(mine=TOLERANCES)
    done = run(pytester, "-n", "2", "--lp-report", "out", "--basetemp", "base", process=True)
    done.assert_outcomes(passed=2, failed=1)
    assert len(list((pytester.path / "base").rglob("result.pickle"))) == 1
    assert (pytester.path / "out/mine/reference-quick/report.md").exists()
    done.stdout.fnmatch_lines([f"*report: *{pytester.path}/out/mine/reference-quick/report.md"])


@pytest.mark.usefixtures("quick_figures")
def test_profile_and_time_limit_are_passed_on(project):
    pytester = project(mine=TIME_LIMITED)
    done = run(pytester, "--lp-profile", "accurate", "--lp-time-limit", "0.01")
    done.assert_outcomes(failed=2)
    done.stdout.fnmatch_lines(["*reference, accurate: *", "*limit 0.01 s"])


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
def test_an_interrupt_ends_the_session_and_is_no_failed_limit(project, offer, tmp_path):
    pytester = project(mine=HANGING)
    offer(faulty=adapter_of("FaultyEngine('hang', releases=Release)"))
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    path = os.pathsep.join([str(tmp_path), str(ROOT)])
    process = subprocess.Popen(
        [sys.executable, "-m", "pytest", *BLOCKED, "-k", "hang", "--basetemp", str(tmp_path / "base")],
        cwd=pytester.path,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=os.environ | {"TMPDIR": str(scratch), "PYTHONPATH": path},
        preexec_fn=can_be_interrupted,
    )
    deadline = time.monotonic() + 180
    while not any(file.stat().st_size for file in scratch.glob("*/samples.bin")) and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=180)
    assert process.returncode == pytest.ExitCode.INTERRUPTED, output
    assert "KeyboardInterrupt" in output
    assert " failed" not in output


TIME_LIMITED = """
tolerances:
  reference:
    accurate:
      rms_0.35s: {limit: 1 mm, reason: exact}
"""
