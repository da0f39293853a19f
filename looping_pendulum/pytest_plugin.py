"""pytest plugin: `pytest my.scenario.yaml` runs the tolerances of a scenario file, one test item per engine variant and metric.

pytest loads this in every project where the package is installed, so nothing but pytest is imported before a scenario is met.
"""

from __future__ import annotations

import contextlib
import hashlib
import re
import tempfile
import warnings
from collections.abc import Generator, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from looping_pendulum.compare.result import ComparisonResult, EngineResult, ToleranceResult
    from looping_pendulum.scenarios.scenario import Scenario, Tolerance

SUFFIXES = (".scenario.yaml", ".scenario.yml")
"""Files that are collected wherever pytest looks."""

SCENARIO_KEYS = tuple(re.compile(rf"^{key}\s*:", re.MULTILINE).search for key in ("light", "heavy", "rod", "release"))
"""A YAML file given on the command line that has all of these is a scenario; others are left to other plugins."""

NOTHING_JUDGED = 2
"""Exit status of a session that met scenarios and judged nothing of any.

It is that of `looping-pendulum check`, and pytest's own for a faulty file.
"""

RUN = "run"
"""Item that fails where the engine's run itself broke off, whatever its metrics."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options."""
    group = parser.getgroup("looping-pendulum", "looping-pendulum scenarios (*.scenario.yaml)")
    group.addoption(
        "--lp-engines",
        metavar="NAMES",
        default="",
        help="Only these engines or variants, separated by commas: pymunk,mujoco:capstan. Default: all with tolerances.",
    )
    group.addoption(
        "--lp-profile", choices=("quick", "accurate"), default="quick", help="How much a run may cost. Default: quick."
    )
    group.addoption(
        "--lp-time-limit",
        metavar="SECONDS",
        type=float,
        default=900.0,
        help="Stop an engine's run after this long. Default: 900.",
    )
    group.addoption(
        "--lp-report", metavar="DIR", default="", help="Write every run's report below here. Default: failed ones, temporarily."
    )


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """Collect scenario files by their name, and any that was named on the command line."""
    named = file_path.suffix in (".yaml", ".yml") and parent.session.isinitpath(file_path) and _is_scenario(file_path)
    if file_path.name.endswith(SUFFIXES) or named:
        return ScenarioFile.from_parent(parent, path=file_path)
    return None


def _is_scenario(path: Path) -> bool:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError):
        return False
    return all(search(text) for search in SCENARIO_KEYS)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> Generator[None, Any, Any]:
    """Mark the reports of our items, so that they are known wherever they are counted (under xdist, in another process)."""
    report = yield
    if isinstance(item, (ToleranceItem, NothingToJudge)):
        report.looping_pendulum = True
    if isinstance(item, NothingToJudge) and report.failed:
        report.longrepr = item.sentence  # pytest asks an item how to show its failure, but not that of its setup
    return report


def pytest_configure(config: pytest.Config) -> None:
    """Count in this session what is judged."""
    if not hasattr(config, "workerinput"):
        config.pluginmanager.register(Tally(), "looping-pendulum-tally")


class Tally:
    """How many of our items this session has seen and judged; under xdist, in the process that the reports come to."""

    def __init__(self) -> None:
        self.seen = 0
        self.judged = 0

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Count: a skip, or an error in an item's setup, judges nothing."""
        if getattr(report, "looping_pendulum", False):
            self.seen += report.when == "setup"
            self.judged += report.when == "call"

    def pytest_sessionfinish(self, session: pytest.Session, exitstatus: int) -> None:
        """Leave with `NOTHING_JUDGED` where that is so: pytest calls a session of skips a success."""
        ended = exitstatus in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED)
        if ended and self.seen and not self.judged:
            session.exitstatus = NOTHING_JUDGED

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        """Say so."""
        if self.seen and not self.judged:
            terminalreporter.write_line(
                f"looping-pendulum: nothing was judged: no limit of a scenario is on an engine that runs here; "
                f"exit status {NOTHING_JUDGED}"
            )


class OutsideToleranceError(Exception):
    """A limit is not kept, or there is none to judge; the message says so."""


class ScenarioFile(pytest.File):
    """One scenario; below it an `EngineVariant` for each engine that it has tolerances for."""

    def collect(self) -> Iterable[pytest.Item | pytest.Collector]:
        """Read the scenario and group its tolerances."""
        from looping_pendulum.engines.limits import nothing_to_judge, with_variants
        from looping_pendulum.engines.protocol import Profile
        from looping_pendulum.errors import HarnessError
        from looping_pendulum.scenarios import loader

        profile = self.config.getoption("--lp-profile")
        try:
            scenario = with_variants(loader.load(self.path), Profile(profile))
            asked = _asked(self.config.getoption("--lp-engines"), profile)
        except HarnessError as error:
            raise self.CollectError(str(error)) from None
        lacking = nothing_to_judge(scenario, profile, asked)
        if lacking:
            item = NothingToJudge.from_parent(self, name="tolerances", why=lacking)
            if asked is not None:  # whoever leaves engines out leaves scenarios out
                item.add_marker(pytest.mark.skip(reason=lacking))
            yield item
            return
        wanted = [t for t in scenario.tolerances if t.profile == profile and (asked is None or t.engine in asked)]
        gaps = {engine: _gap(engine, profile, scenario) for engine in dict.fromkeys(t.engine for t in wanted)}
        for engine, gap in gaps.items():
            limits = tuple(t for t in wanted if t.engine == engine)
            yield EngineVariant.from_parent(self, name=engine, scenario=scenario, tolerances=limits, gap=gap)
        if all(gaps.values()):
            yield NothingToJudge.from_parent(self, name="tolerances", why="; ".join(gaps.values()))


def _asked(names: str, profile: str) -> set[str] | None:
    """Labels of the engines that --lp-engines means; None without it."""
    if not names.strip():
        return None
    from looping_pendulum.engines.protocol import Profile
    from looping_pendulum.engines.registry import label, select
    from looping_pendulum.errors import EngineError

    try:
        return {
            label(engine) for engine in select([name.strip() for name in names.split(",") if name.strip()], Profile(profile))
        }
    except EngineError as error:
        raise EngineError(str(error).replace("--engine:", "--lp-engines:", 1)) from None


class NothingToJudge(pytest.Item):
    """Says that nothing is judged of a scenario: an error, or a skip where --lp-engines left it out."""

    def __init__(self, *, why: str, **rest: Any) -> None:
        super().__init__(**rest)
        self.why = why

    def setup(self) -> None:
        """Fail before there is anything to run."""
        raise OutsideToleranceError(self.sentence)

    @property
    def sentence(self) -> str:
        """What is wrong, in one line."""
        return f"{self.path.name}: nothing was judged: {self.why}"

    def runtest(self) -> None:
        """Do nothing: `setup` never lets it come so far."""

    def reportinfo(self) -> tuple[Path, int, str]:
        """Where the item is from."""
        return self.path, 0, f"{self.path.name}: {self.name}"


class EngineVariant(pytest.Collector):
    """One engine variant on one scenario: its run, and an item per tolerance."""

    def __init__(self, *, scenario: Scenario, tolerances: tuple[Tolerance, ...], gap: str, **rest: Any) -> None:
        super().__init__(**rest)
        self.gap = gap
        self.scenario = scenario
        self.tolerances = tolerances
        self._result: ComparisonResult | None = None
        self._report: Path | None = None

    def collect(self) -> Iterable[pytest.Item]:
        """One item for the run itself, and one per metric."""
        for metric in (RUN, *(t.metric for t in self.tolerances)):
            item = ToleranceItem.from_parent(self, name=metric)
            if self.gap:
                item.add_marker(pytest.mark.skip(reason=self.gap))
            if self.config.pluginmanager.hasplugin("xdist"):
                item.add_marker(pytest.mark.xdist_group(self.nodeid))
            yield item

    def result(self) -> ComparisonResult:
        """Return the comparison with the reference; the engine runs once per session, in a process of its own.

        The workers of pytest-xdist share the outcome through a file.
        """
        import pickle

        if self._result is None:
            kept = self._folder() / "result.pickle"
            with _locked(kept.with_suffix(".lock")):
                if kept.exists():
                    self._result = pickle.loads(kept.read_bytes())
                else:
                    self._result = self._run()
                    kept.write_bytes(pickle.dumps(self._result))
                    if self.config.getoption("--lp-report"):
                        self._write(self._result)
        return self._result

    def report(self) -> Path:
        """Path of the written report."""
        if self._report is None:
            result = self.result()
            with _locked(self._folder() / "report.lock"):
                self._report = self._report_folder() / "report.md"
                if not self.config.getoption("--lp-report") and not self._report.exists():
                    self._write(result)
        return self._report

    def _run(self) -> ComparisonResult:
        from looping_pendulum.compare.harness import compare_engines

        limit, profile = self.config.getoption("--lp-time-limit"), self.config.getoption("--lp-profile")
        with _warnings_shown():
            result = compare_engines(self.scenario, engines=[self.name], profile=profile, jobs=1, time_limit=limit)
        if result.engines[0].status == "INTERRUPTED":
            raise KeyboardInterrupt  # Ctrl-C, which the run of the engine took for itself
        return result

    def _write(self, result: ComparisonResult) -> None:
        from looping_pendulum.compare import write

        with _warnings_shown():
            write(result, self._report_folder())

    def _report_folder(self) -> Path:
        from looping_pendulum.compare.export import file_stem

        given = self.config.getoption("--lp-report")
        name = self.path.name.removesuffix(self.path.suffix).removesuffix(".scenario")
        base = self.config.invocation_params.dir / given if given else self._folder()
        return base / file_stem(name) / file_stem(self.name, self.config.getoption("--lp-profile"))

    def _folder(self) -> Path:
        """Folder of this session, the same in all workers of pytest-xdist, that is this node's own."""
        key = hashlib.sha256(self.nodeid.encode()).hexdigest()[:16]
        folder = _session_folder(self.config) / f"looping-pendulum-{key}"
        folder.mkdir(parents=True, exist_ok=True)
        return folder


def _gap(wanted: str, profile: str, scenario: Scenario) -> str:
    """Why there is no run of an engine variant here, and the way to get it; empty: there is one."""
    from looping_pendulum.engines.protocol import Profile
    from looping_pendulum.engines.registry import how_to_get, label, loaded, missing_packages

    (engine,) = (engine for engine in loaded(Profile(profile))[0] if label(engine) == wanted)
    missing = missing_packages(engine)
    if missing:
        return f"{wanted}: {missing[0]} is not installed; to get it: {how_to_get(missing[0])}"
    unsupported = engine.abilities.unsupported(scenario.parameters)
    return f"{wanted} cannot represent {unsupported}" if unsupported else ""


class ToleranceItem(pytest.Item):
    """One limit of one engine variant, or its run itself."""

    parent: EngineVariant

    def runtest(self) -> None:
        """Judge; an expected failure is a strict xfail."""
        from looping_pendulum.errors import HarnessError

        try:
            result = self.parent.result()
        except HarnessError as error:
            raise OutsideToleranceError(f"{self.path.name}: tolerances: {str(error).removeprefix('--engine: ')}") from None
        engine = result.engines[0]
        if self.name == RUN:
            if result.broke_off(engine):
                raise OutsideToleranceError(self._story(f"its run broke off: {engine.status_sentence}", engine))
            return
        (judged,) = (t for t in result.judged(engine) if t.metric == self.name)
        if judged.expected_failure and not judged.outcome.good:
            raise OutsideToleranceError(self._story(_judgement(judged), engine))
        if judged.expected_failure:
            pytest.xfail(judged.expected_failure)  # does nothing under --runxfail
        if judged.expected_failure or not judged.outcome.good:
            raise OutsideToleranceError(self._story(_judgement(judged), engine))

    def _story(self, judgement: str, engine: EngineResult) -> str:
        said = f"{engine.status_sentence}. {engine.message}".strip().rstrip(".")
        return "\n".join(
            [
                f"{self.path.name}, {engine.label}, {engine.profile}: {judgement}",
                f"  where and why: {engine.story}",
                f"  the run:       {said}",
                f"  report:        {self.parent.report()}",
            ]
        )

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """Show the judgement without a traceback; anything unexpected with one."""
        if isinstance(excinfo.value, OutsideToleranceError):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, int, str]:
        """Where the item is from, and how a failure is headed."""
        return self.path, 0, f"{self.path.name}: {self.parent.name}: {self.name}"


def _judgement(t: ToleranceResult) -> str:
    from looping_pendulum.compare.report import limit_and_value

    limit, value = limit_and_value(t)
    told = f"{t.metric} is {value}, limit {limit}"
    lines = [told, f"  why this limit: {t.reason}", f"  remark:        {t.explanation}" if t.explanation else ""]
    return "\n".join(line for line in lines if line)


@contextlib.contextmanager
def _warnings_shown() -> Iterator[None]:
    """Let warnings of our own libraries be shown and not raised, whatever the project makes of its own."""
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        yield


def _session_folder(config: pytest.Config) -> Path:
    """Return a temporary folder of this test session; pytest clears old ones away."""
    factory = getattr(config, "_tmp_path_factory", None)
    if factory is None:  # -p no:tmpdir
        return Path(tempfile.gettempdir()) / f"looping-pendulum-{config.stash.setdefault(_SESSION, _new_name())}"
    base = Path(factory.getbasetemp())
    return base.parent if hasattr(config, "workerinput") else base


_SESSION = pytest.StashKey[str]()


def _new_name() -> str:
    return Path(tempfile.mkdtemp(prefix="looping-pendulum-")).name.removeprefix("looping-pendulum-")


@contextlib.contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Hold a lock among processes; where there is none (Windows), an engine may run once per worker instead of once."""
    try:
        import fcntl
    except ImportError:
        yield
        return
    with path.open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
