"""Which tests run which line, how long each takes, and so which to ask about a mutant."""

import ast
import hashlib
import json
import os
import signal
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from tests.mutation import processes
from tests.mutation.mutants import Mutant, source_hash

BUDGET = 40.0
"""A mutant is asked of tests that take this much processor time together [s], the covering ones first."""

LONGEST = 3000.0
"""Time limit of one file's tests under coverage [s]."""

PYTEST = ["-q", "-x", "-p", "no:cacheprovider", "-W", "ignore::pytest.PytestAssertRewriteWarning", "--tb=line", "--no-header"]


@dataclass
class Coverage:
    """What the tests of some files run."""

    durations: dict[str, float] = field(default_factory=dict)
    """Passing test -> processor time [s] under coverage, with the fixtures that it was the first to ask for."""
    broken: list[str] = field(default_factory=list)
    """Tests that fail without a mutant: they are not asked."""
    lines: dict[str, dict[int, list[str]]] = field(default_factory=dict)
    """File -> line -> tests that run it."""
    imported: dict[str, list[int]] = field(default_factory=dict)
    """File -> lines that run when it is imported."""

    def plan(self, root: Path, mutant: Mutant) -> list[str]:
        """Tests to ask about ``mutant``, the fast ones first; none if no test runs the statement."""
        by_line = self.lines.get(mutant.path, {})
        start, end, whole = statement(root, mutant)
        here = {t for line in range(start, end + 1) for t in by_line.get(line, ())}
        if whole or any(start <= line <= end for line in self.imported.get(mutant.path, ())):
            # What an import made is seen by whoever uses the file, not only by the tests that happen to import it again.
            here |= {t for tests in by_line.values() for t in tests} | self._structural()
        files = {t.partition("::")[0] for t in here}
        # A result that is cached or a fixture that is shared runs the line in the first test that asks; others see it too.
        beside = [t for t in self.durations if t not in here and t.partition("::")[0] in files]
        chosen, spent = [], 0.0
        for test in [*self._fast_first(here), *self._fast_first(beside)]:
            if not chosen or spent + self.durations[test] <= BUDGET:
                chosen.append(test)
                spent += self.durations[test]
        return chosen

    def _structural(self) -> set[str]:
        """Tests that call nothing of the folder, so look at what is defined in it."""
        calling = {t for lines in self.lines.values() for tests in lines.values() for t in tests}
        return set(self.durations) - calling

    def _fast_first(self, tests: Iterable[str]) -> list[str]:
        """One case of every test function before the second of any, and the fast ones first."""
        ordered, seen = [], Counter[str]()
        for test in sorted((t for t in tests if t in self.durations), key=lambda t: (round(self.durations[t], 2), t)):
            function = test.partition("[")[0]
            ordered.append((seen[function], test))
            seen[function] += 1
        return [test for _, test in sorted(ordered, key=lambda pair: pair[0])]


@cache
def _statements(path: Path) -> list[tuple[int, int, bool]]:
    """First and last line of every simple statement and of every compound one's head, and whether it runs on import."""
    statements = []

    def visit(body: list[ast.stmt], on_import: bool) -> None:
        for node in body:
            inner = [child for name in ("body", "orelse", "finalbody", "handlers") for child in getattr(node, name, [])]
            first = min([node.lineno, *(d.lineno for d in getattr(node, "decorator_list", []))])
            last = min((child.lineno for child in inner), default=(node.end_lineno or 0) + 1) - 1
            statements.append((first, max(first, last), on_import))
            is_function = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
            visit(inner, on_import and not is_function)

    visit(ast.parse(path.read_text(encoding="utf-8")).body, True)
    return statements


def statement(root: Path, mutant: Mutant) -> tuple[int, int, bool]:
    """First and last line of the shortest statement that holds the mutant, and whether it runs on import."""
    holding = [s for s in _statements(root / mutant.path) if s[0] <= mutant.line <= s[1]]
    return min(holding, key=lambda s: s[1] - s[0], default=(mutant.line, mutant.line, True))


def measure(
    root: Path, copy: Path, places: Iterable[str], tests: Iterable[str], cache_folder: Path, tell: Callable[[str], None]
) -> Coverage:
    """Run each test file once under coverage, or take what an earlier call on the same files found."""
    package = sorted((root / "looping_pendulum").rglob("*.py"))
    sources = "".join(source_hash(p) for p in package)
    helpers = "".join(source_hash(p) for p in sorted((root / "tests").rglob("*.py")) if _is_helper(p.relative_to(root)))
    cache_folder.mkdir(parents=True, exist_ok=True)
    total = Coverage()
    for file in _test_files(root, tests):
        key = _digest(f"{places} {sources} {helpers} {source_hash(root / file)}")
        stored = cache_folder / f"{file.replace('/', '-')}-{key}.json"
        if not stored.exists():
            tell(f"which lines {file} runs")
            _measure_file(copy, places, file, stored)
        _add(total, json.loads(stored.read_text()))
    return total


def _is_helper(path: Path) -> bool:
    return not path.name.startswith("test_") and path.parts[1] != "mutation"


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _test_files(root: Path, tests: Iterable[str]) -> list[str]:
    files: list[Path] = []
    for name in tests:
        path = root / name
        files += sorted(path.rglob("test_*.py")) if path.is_dir() else [path]
    return [path.relative_to(root).as_posix() for path in files]


def _add(total: Coverage, part: dict[str, Any]) -> None:
    total.durations |= part["durations"]
    total.broken += part["broken"]
    for path, lines in part["lines"].items():
        mine = total.lines.setdefault(path, {})
        for line, tests in lines.items():
            mine.setdefault(int(line), []).extend(part["tests"][i] for i in tests)
    for path, lines in part["imported"].items():
        total.imported[path] = sorted({*total.imported.get(path, []), *lines})


def _processor_time() -> float:
    """Time that this process and its finished children used [s]."""
    return sum(os.times()[:4])


class _Watch:
    """Pytest plugin: one coverage context per test, its outcome and its processor time."""

    def __init__(self, coverage: Any) -> None:
        self.coverage = coverage
        self.durations: dict[str, float] = {}
        self.outcomes: dict[str, set[str]] = {}

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Any:
        self.coverage.switch_context(item.nodeid)
        start = _processor_time()
        try:
            return (yield)
        finally:
            self.durations[item.nodeid] = _processor_time() - start
            self.coverage.switch_context("")

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.outcomes.setdefault(report.nodeid, set()).add(report.outcome)


def _measure_file(copy: Path, places: Iterable[str], file: str, out: Path) -> None:
    def work() -> int:
        import coverage

        files = [str(copy / place) if place.endswith(".py") else f"{copy / place}/*" for place in places]
        measured = coverage.Coverage(data_file=None, config_file=False, include=files, data_suffix=False)
        measured.start()
        watch = _Watch(measured)
        status = pytest.main([*(a for a in PYTEST if a != "-x"), file], plugins=[watch])
        measured.stop()
        data = measured.get_data()
        good = [t for t, outcomes in watch.outcomes.items() if outcomes == {"passed"}]
        place = {test: i for i, test in enumerate(good)}
        lines, imported = {}, {}
        for name in data.measured_files():
            path = Path(name).relative_to(copy).as_posix()
            contexts = data.contexts_by_lineno(name)
            lines[path] = {n: [place[t] for t in tests if t in place] for n, tests in contexts.items()}
            imported[path] = [n for n, tests in contexts.items() if "" in tests]
        broken = [t for t, outcomes in watch.outcomes.items() if "failed" in outcomes]
        record = {"tests": good, "durations": {t: watch.durations[t] for t in good}, "broken": broken}
        out.write_text(json.dumps(record | {"lines": lines, "imported": imported}))
        return int(status)

    log = out.with_suffix(".log")
    status, seconds = processes.run_child(copy, log, work, LONGEST)
    if not out.exists():
        raise SystemExit(f"{file}: no coverage after {seconds:.0f} s (status {status}); see {log}")


class Limits:
    """Pytest plugin: a test that uses five times its processor time ends the process; the one that runs is noted."""

    def __init__(self, durations: dict[str, float], note: Path) -> None:
        self.durations, self.note = durations, note

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Any:
        self.note.write_text(item.nodeid)
        signal.signal(signal.SIGPROF, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_PROF, 5 + 5 * self.durations.get(item.nodeid, 1.0))
        try:
            return (yield)
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)


def wall_limit(tests: Iterable[str], durations: dict[str, float]) -> float:
    """Wall time after which tests that wait, and use no processor, are ended [s]."""
    return 120 + 20 * sum(durations[t] for t in tests)


def runs_on_import(root: Path, mutant: Mutant, coverage: Coverage) -> bool:
    """Whether the mutant's statement runs when its file or another is imported."""
    start, end, whole = statement(root, mutant)
    return whole or any(start <= line <= end for line in coverage.imported.get(mutant.path, ()))


def ask(copy: Path, tests: list[str], durations: dict[str, float], log: Path) -> tuple[int, float, str]:
    """Run ``tests`` until one fails.

    Returns
    -------
    int
        Pytest's exit status (0: no test minds), or minus the signal that ended the process.
    float
        Wall time [s].
    str
        The test that was running at the end, empty if pytest did not come so far.
    """
    note = log.with_suffix(".test")
    note.unlink(missing_ok=True)

    def work() -> int:
        processes.forget_bytecode()
        return int(pytest.main([*PYTEST, *tests], plugins=[Limits(durations, note)]))

    status, seconds = processes.run_child(copy, log, work, wall_limit(tests, durations))
    return status, seconds, note.read_text() if note.exists() else ""
