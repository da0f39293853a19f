"""pytest plugin: `pytest my.scenario.yaml` judges the tolerances of a scenario file, an item per engine variant and metric.

pytest loads it in every project where the package is installed, so only pytest is imported until a scenario is collected.
"""

from __future__ import annotations

import contextlib
import hashlib
import re
import tempfile
import warnings
from collections.abc import Iterable, Iterator
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import pytest

if TYPE_CHECKING:
    from looping_pendulum.compare.result import ComparisonResult, EngineResult, ToleranceResult
    from looping_pendulum.scenarios.scenario import Scenario, Tolerance

SUFFIXES = (".scenario.yaml", ".scenario.yml")
"""Endings of the names of files that are always collected."""

SCENARIO_KEYS = tuple(re.compile(rf"^{key}\s*:", re.MULTILINE).search for key in ("light", "heavy", "rod", "release"))
"""Searches for keys that a scenario has: a YAML file on the command line with all of them is collected as a scenario."""

RUN = "run"
"""Name of the item that fails if the engine's run broke off, whatever its metrics."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the plugin's command-line options."""
    group = parser.getgroup("looping-pendulum", "looping-pendulum scenarios (*.scenario.yaml)")
    group.addoption(
        "--lp-engines",
        metavar="NAMES",
        default="",
        help="Judge only these engines or variants, separated by commas: pymunk,mujoco:capstan. Default: all with tolerances.",
    )
    group.addoption(
        "--lp-profile", choices=("quick", "accurate"), default="quick", help="Settings of the engines. Default: quick."
    )
    group.addoption(
        "--lp-time-limit",
        metavar="SECONDS",
        type=float,
        default=900.0,
        help="Stop an engine's run after this time. Default: 900.",
    )
    group.addoption(
        "--lp-report",
        metavar="DIR",
        default="",
        help="Write every run's report into this folder. Default: only reports of failures, into a temporary folder.",
    )


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """Collect scenario files by their name, and any that was named on the command line."""
    is_named_scenario = (
        file_path.suffix in (".yaml", ".yml") and parent.session.isinitpath(file_path) and _is_scenario(file_path)
    )
    if file_path.name.endswith(SUFFIXES) or is_named_scenario:
        return ScenarioFileCollector.from_parent(parent, path=file_path)
    return None


def _is_scenario(path: Path) -> bool:
    try:
        # -sig, because editors on Windows may begin a file with a byte-order mark
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError):
        return False
    return all(search(text) for search in SCENARIO_KEYS)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip the scenarios that --lp-engines left out; where nothing else is judged they fail: skips are a success."""
    is_judged = any(isinstance(item, ToleranceItem) and item.get_closest_marker("skip") is None for item in items)
    for item in items:
        if is_judged and isinstance(item, NothingToJudge) and item.was_left_out:
            item.add_marker(pytest.mark.skip(reason=item.reason))


_SESSION = pytest.StashKey[Path]()
"""Folder of a session in which pytest itself keeps none."""


class ScenarioFileCollector(pytest.File):
    """A scenario file, which collects an `EngineVariant` for each engine that it has tolerances for."""

    def collect(self) -> Iterable[pytest.Item | pytest.Collector]:
        """Read the scenario, and group its tolerances by engine variant."""
        from looping_pendulum.engines.protocol import Profile
        from looping_pendulum.engines.registry import expand_tolerances, why_no_tolerances
        from looping_pendulum.errors import HarnessError
        from looping_pendulum.scenarios import loader

        profile = self.config.getoption("--lp-profile")
        try:
            scenario = expand_tolerances(loader.load(self.path), Profile(profile))
            requested = _requested_engines(self.config.getoption("--lp-engines"), profile)
        except HarnessError as error:
            raise self.CollectError(str(error)) from None
        reason = why_no_tolerances(scenario, profile, requested)
        if reason:
            yield NothingToJudge.from_parent(self, name="tolerances", reason=reason, was_left_out=requested is not None)
            return
        wanted = [t for t in scenario.tolerances if t.profile == profile and (requested is None or t.engine in requested)]
        reasons_not_run = {
            engine: _why_not_run(engine, profile, scenario) for engine in dict.fromkeys(t.engine for t in wanted)
        }
        for engine, why_not_run in reasons_not_run.items():
            limits = tuple(t for t in wanted if t.engine == engine)
            yield EngineVariant.from_parent(self, name=engine, scenario=scenario, tolerances=limits, why_not_run=why_not_run)
        if all(reasons_not_run.values()):
            yield NothingToJudge.from_parent(self, name="tolerances", reason="; ".join(reasons_not_run.values()))


def _requested_engines(names: str, profile: str) -> set[str] | None:
    """Return the labels of the engines that --lp-engines names; None without that option."""
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
    """Item of a scenario of which nothing is judged: an error, or a skip if --lp-engines left it out."""

    def __init__(self, *, reason: str, was_left_out: bool = False, **rest: Any) -> None:
        super().__init__(**rest)
        self.reason = reason
        self.was_left_out = was_left_out

    def setup(self) -> None:
        """Fail: an error in the setup, not a failed test, as nothing was judged."""
        pytest.fail(f"{self.path.name}: nothing was judged: {self.reason}", pytrace=False)

    def runtest(self) -> None:
        """Do nothing: `setup` fails before."""

    def reportinfo(self) -> tuple[Path, int, str]:
        """Return file, line and heading of the item."""
        return self.path, 0, f"{self.path.name}: {self.name}"


class EngineVariant(pytest.Collector):
    """One engine variant on one scenario: an item for its run, and one per tolerance."""

    def __init__(self, *, scenario: Scenario, tolerances: tuple[Tolerance, ...], why_not_run: str, **rest: Any) -> None:
        super().__init__(**rest)
        self.why_not_run = why_not_run
        self.scenario = scenario
        self.tolerances = tolerances

    def collect(self) -> Iterable[pytest.Item]:
        """Yield one item for the run itself, and one per metric."""
        for metric in (RUN, *(t.metric for t in self.tolerances)):
            item = ToleranceItem.from_parent(self, name=metric)
            if self.why_not_run:
                item.add_marker(pytest.mark.skip(reason=self.why_not_run))
            yield item

    @cached_property
    def result(self) -> ComparisonResult:
        """The comparison with the reference; the engine runs once per session, in a process of its own.

        The workers of pytest-xdist share the outcome through a file.
        """
        import pickle

        from filelock import FileLock

        stored = self._folder / "result.pickle"
        with FileLock(stored.with_suffix(".lock")):
            if not stored.exists():
                result = self._run()
                stored.write_bytes(pickle.dumps(result))
                if self.config.getoption("--lp-report"):
                    self._write(result)
            made: ComparisonResult = pickle.loads(stored.read_bytes())
            return made

    @cached_property
    def report(self) -> Path:
        """The path of the report, which is written first if need be."""
        from filelock import FileLock

        path = self._report_folder / "report.md"
        with FileLock(self._folder / "report.lock"):
            if not self.config.getoption("--lp-report") and not path.exists():
                self._write(self.result)
        return path

    def _run(self) -> ComparisonResult:
        from looping_pendulum.compare.harness import compare_engines

        limit, profile = self.config.getoption("--lp-time-limit"), self.config.getoption("--lp-profile")
        with _warnings_shown():
            result = compare_engines(self.scenario, engines=[self.name], profile=profile, jobs=1, time_limit=limit)
        if result.interrupted:
            raise KeyboardInterrupt  # Ctrl-C, which the run of the engine took for itself
        return result

    def _write(self, result: ComparisonResult) -> None:
        from looping_pendulum.compare import write

        with _warnings_shown():
            write(result, self._report_folder)

    @property
    def _report_folder(self) -> Path:
        from looping_pendulum.files import file_stem

        report_option = self.config.getoption("--lp-report")
        name = self.path.name.removesuffix(self.path.suffix).removesuffix(".scenario")
        # A path on the command line is relative to where pytest was started, not to its root folder
        base = self.config.invocation_params.dir / report_option if report_option else self._folder
        return base / file_stem(name) / file_stem(self.name, self.config.getoption("--lp-profile"))

    @cached_property
    def _folder(self) -> Path:
        """Folder of this node in this session, the same in all workers of pytest-xdist."""
        key = hashlib.sha256(self.nodeid.encode()).hexdigest()[:16]
        folder = _session_folder(self.config) / f"looping-pendulum-{key}"
        folder.mkdir(parents=True, exist_ok=True)
        return folder


def _why_not_run(wanted: str, profile: str, scenario: Scenario) -> str:
    """Return why an engine variant cannot run here, and how to install it; empty if it can run."""
    from looping_pendulum.engines.protocol import Profile
    from looping_pendulum.engines.registry import how_to_get, label, load_engines, missing_packages

    engines, _ = load_engines(Profile(profile), {wanted.partition(":")[0]})
    (engine,) = (engine for engine in engines if label(engine) == wanted)
    missing = missing_packages(engine)
    if missing:
        return f"{wanted}: {missing[0]} is not installed; to get it: {how_to_get(missing[0])}"
    unsupported = engine.abilities.unsupported(scenario.parameters)
    return f"{wanted} cannot represent {unsupported}" if unsupported else ""


class ToleranceItem(pytest.Item):
    """One limit of an engine variant, or its run itself."""

    parent: EngineVariant

    def runtest(self) -> None:
        """Judge the limit; an expected failure is a strict xfail."""
        from looping_pendulum.errors import HarnessError

        try:
            result = self.parent.result
        except HarnessError as error:
            pytest.fail(f"{self.path.name}: tolerances: {str(error).removeprefix('--engine: ')}", pytrace=False)
        engine = result.engines[0]
        if self.name == RUN:
            if result.broke_off(engine):
                self._fail(f"its run broke off: {engine.status_sentence}", engine)
            return
        (judged,) = (t for t in result.judged(engine) if t.metric == self.name)
        if judged.expected_failure and judged.outcome.good:
            pytest.xfail(judged.expected_failure)  # does nothing under --runxfail
        if judged.expected_failure or not judged.outcome.good:
            self._fail(_judgement(judged), engine)

    def _fail(self, judgement: str, engine: EngineResult) -> NoReturn:
        run_message = f"{engine.status_sentence}. {engine.message}".strip().rstrip(".")
        lines = [
            f"{self.path.name}, {engine.label}, {engine.profile}: {judgement}",
            f"  where and why: {engine.story}",
            f"  the run:       {run_message}",
            f"  report:        {self.parent.report}",
        ]
        pytest.fail("\n".join(lines), pytrace=False)

    def reportinfo(self) -> tuple[Path, int, str]:
        """Return file, line and the heading of a failure."""
        return self.path, 0, f"{self.path.name}: {self.parent.name}: {self.name}"


def _judgement(t: ToleranceResult) -> str:
    from looping_pendulum.compare.report import value_and_limit

    value, limit = value_and_limit(t)
    first_line = f"{t.metric} is {value}, limit {limit}"
    lines = [first_line, f"  why this limit: {t.reason}", f"  remark:        {t.explanation}" if t.explanation else ""]
    return "\n".join(line for line in lines if line)


@contextlib.contextmanager
def _warnings_shown() -> Iterator[None]:
    """Print warnings of our own libraries instead of raising them, whatever the project's own warning filters are."""
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        yield


def _session_folder(config: pytest.Config) -> Path:
    """Return a temporary folder of this test session; pytest clears old ones away."""
    factory = getattr(config, "_tmp_path_factory", None)
    if factory is None:  # -p no:tmpdir
        return config.stash.setdefault(_SESSION, Path(tempfile.mkdtemp(prefix="looping-pendulum-")))
    base = Path(factory.getbasetemp())
    return base.parent if hasattr(config, "workerinput") else base
