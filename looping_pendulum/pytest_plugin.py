"""pytest plugin: `pytest my.scenario.yaml` runs the tolerances of a scenario file, one test item per engine variant and metric.

pytest loads this in every project where the package is installed, so nothing but pytest is imported before a scenario is met.
"""

from __future__ import annotations

import contextlib
import hashlib
import re
import tempfile
import warnings
from collections.abc import Iterable, Iterator
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


class OutsideToleranceError(Exception):
    """A limit is not kept; the message is the judgement."""


class ScenarioFile(pytest.File):
    """One scenario; below it an `EngineVariant` for each engine that it has tolerances for."""

    def collect(self) -> Iterable[pytest.Item | pytest.Collector]:
        """Read the scenario and group its tolerances."""
        from looping_pendulum.errors import HarnessError
        from looping_pendulum.scenarios import loader

        profile = self.config.getoption("--lp-profile")
        try:
            scenario = loader.load(self.path)
            asked = _asked(self.config.getoption("--lp-engines"), profile)
        except HarnessError as error:
            raise self.CollectError(str(error)) from None
        own = [t for t in scenario.tolerances if t.profile == profile]
        wanted = [t for t in own if asked is None or t.engine in asked]
        for engine in dict.fromkeys(t.engine for t in wanted):
            limits = tuple(t for t in wanted if t.engine == engine)
            yield EngineVariant.from_parent(self, name=engine, scenario=scenario, tolerances=limits)
        if not wanted:
            have = ", ".join(dict.fromkeys(t.engine for t in own))
            why = f"it has them for {have}" if own else "add some under `tolerances:`"
            item = NothingToJudge.from_parent(self, name="tolerances")
            item.add_marker(pytest.mark.skip(reason=f"no tolerances for profile {profile}: {why}"))
            yield item


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
    """Says that a scenario has no tolerances, as a skip that is seen."""

    def runtest(self) -> None:
        """Do nothing: the item is always skipped."""

    def reportinfo(self) -> tuple[Path, int, str]:
        """Where the item is from."""
        return self.path, 0, f"{self.path.name}: {self.name}"


class EngineVariant(pytest.Collector):
    """One engine variant on one scenario: its run, and an item per tolerance."""

    def __init__(self, *, scenario: Scenario, tolerances: tuple[Tolerance, ...], **rest: Any) -> None:
        super().__init__(**rest)
        self.scenario = scenario
        self.tolerances = tolerances
        self._result: ComparisonResult | None = None
        self._report: Path | None = None

    def collect(self) -> Iterable[pytest.Item]:
        """One item for the run itself, and one per metric."""
        gap = _gap(self.name, self.config.getoption("--lp-profile"), self.scenario)
        for metric in (RUN, *(t.metric for t in self.tolerances)):
            item = ToleranceItem.from_parent(self, name=metric)
            if gap:
                item.add_marker(pytest.mark.skip(reason=gap))
            if self.config.pluginmanager.hasplugin("xdist"):
                item.add_marker(pytest.mark.xdist_group(self.nodeid))
            yield item

    def result(self) -> ComparisonResult:
        """Return the comparison with the truth; the engine runs once per session, in a process of its own.

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
    """Why there is no run of an engine here, and the way to get it; empty: there is one, or its failure will say why not."""
    from looping_pendulum.engines.protocol import Profile
    from looping_pendulum.engines.registry import how_to_get, label, loaded, missing_packages, offers

    name = wanted.partition(":")[0]
    if name not in {offer.name for offer in offers()}:
        return f"no installed package offers the engine {name!r}; install the one that does, or correct the name"
    engine = next((engine for engine in loaded(Profile(profile))[0] if label(engine) == wanted), None)
    if engine is None:
        return ""
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
        judged = next(t for t in result.judged(engine) if t.metric == self.name)
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
