"""``python -m tests.mutation``: draw mutants, ask the tests, and say which share was caught."""

import argparse
import json
import os
import sys
import time
from pathlib import Path

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

ROOT = Path(__file__).resolve().parents[2]

from tests.mutation import FOLDERS, covering, processes  # noqa: E402
from tests.mutation.mutants import Mutant, all_mutants, changed_lines, mutated, sample, source_hash  # noqa: E402
from tests.mutation.summary import EQUIVALENT, Asked, read_equivalent, summary, verdict_lines  # noqa: E402
from tests.mutation.zygote import NO_PLACE, Zygote, enclosing_function  # noqa: E402

OK, TESTS_FAILED = 0, 1
QUICK = 0.5
"""Processor time of a test that is asked whether all is well without a mutant [s]."""


def main() -> int:
    asked_for = _arguments()
    if asked_for.list:
        for name, (places, _) in FOLDERS.items():
            print(f"{name}: {len(all_mutants(ROOT, places))} mutants in {', '.join(places)}")
        return 0
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    processes.preload()
    asked_for.work.mkdir(parents=True, exist_ok=True)
    caught_enough = True
    for name in [asked_for.only] if asked_for.only else list(FOLDERS):
        asked, population, broken = _run(name, asked_for)
        result = summary(name, asked, population, asked_for.seed, read_equivalent(EQUIVALENT), broken)
        asked_for.out.mkdir(parents=True, exist_ok=True)
        (asked_for.out / f"{name}.json").write_text(json.dumps(result, indent=1, ensure_ascii=False) + "\n")
        print("\n".join(verdict_lines(result)))
        caught_enough &= result["share"] >= asked_for.at_least
    return 0 if caught_enough else 1


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description=sys.modules["tests.mutation"].__doc__)
    parser.add_argument(
        "--sample", type=int, metavar="N", help="mutants per folder, drawn at random (default: all; takes many hours)"
    )
    parser.add_argument(
        "--seed", type=int, default=1, help="of the draw (default 1); a larger sample begins with the smaller one"
    )
    parser.add_argument("--only", choices=FOLDERS, help="one folder")
    parser.add_argument("--at-least", type=float, default=0.9, help="share below which the exit status is 1 (default 0.9)")
    parser.add_argument(
        "--out", type=Path, default=ROOT / "docs/data/mutation", help="folder for the result, one JSON per folder"
    )
    parser.add_argument(
        "--work", type=Path, default=ROOT / ".mutation", help="folder for what is known so far; a second run resumes"
    )
    parser.add_argument(
        "--stop-after", type=float, metavar="MINUTES", help="ask of no further mutant after this time, coverage not counted"
    )
    parser.add_argument("--list", action="store_true", help="count the mutants and stop")
    return parser.parse_args()


def _run(name: str, asked_for: argparse.Namespace) -> tuple[list[Asked], int, list[str]]:
    places, tests = FOLDERS[name]
    population = all_mutants(ROOT, places)
    drawn = sample(population, asked_for.sample, asked_for.seed)
    store = _Store(asked_for.work / f"{name}.jsonl")
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    asked: list[Asked] = []
    with processes.project_copy(ROOT) as copy, Progress(*columns) as progress:
        task = progress.add_task(name, total=len(drawn))
        coverage = covering.measure(
            ROOT, copy, places, tests, asked_for.work / "coverage", lambda text: progress.update(task, description=text)
        )
        asker = _Asker(copy, coverage, asked_for.work / f"{name}.log")
        deadline = time.monotonic() + 60 * (asked_for.stop_after or 1e9)
        survived = 0
        for mutant in drawn:
            if time.monotonic() > deadline:
                break
            known = store.known(mutant, coverage)
            result = known or asker.ask(mutant)
            if not known:
                store.add(result)
            asked.append(result)
            survived += not result.caught
            progress.update(task, advance=1, description=f"{name}: {survived} survived")
        asker.close()
    return asked, len(population), coverage.broken


class _Asker:
    """Asks the tests about mutants of one folder."""

    def __init__(self, copy: Path, coverage: covering.Coverage, log: Path) -> None:
        self.copy, self.coverage, self.log = copy, coverage, log
        self._zygote: Zygote | None = None

    def _ready(self) -> Zygote:
        """Return the process that forks for mutants; when it starts, the quick tests must pass in it without one."""
        if self._zygote is None:
            durations = self.coverage.durations
            self._zygote = Zygote(self.copy, sorted({t.partition("::")[0] for t in durations}), durations, self.log)
            quick = sorted(t for t, seconds in durations.items() if seconds < QUICK)
            status, _, by = self._zygote.ask("", "", "", quick, 600.0, self.log)
            if status != OK:
                raise SystemExit(f"{by} fails without a mutant (status {status}); see {self.log}")
        return self._zygote

    def ask(self, mutant: Mutant) -> Asked:
        """Run the tests that may notice ``mutant``."""
        before, after = changed_lines(ROOT, mutant)
        tests = self.coverage.plan(ROOT, mutant)
        outcome, by, seconds = "no test runs it", "", 0.0
        if tests:
            status, seconds, by = self._status(mutant, tests)
            outcome = _outcome(status, by)
        return Asked(
            key=mutant.key,
            path=mutant.path,
            line=mutant.line,
            operator=mutant.operator.removeprefix("core/"),
            before=before,
            after=after,
            outcome=outcome,
            by="" if outcome == "survived" else by,
            tests=len(tests),
            seconds=round(seconds, 2),
            source=source_hash(ROOT / mutant.path),
            test_source=_test_sources(tests, by if outcome != "survived" else ""),
        )

    def _status(self, mutant: Mutant, tests: list[str]) -> tuple[int, float, str]:
        path, text, function = self.copy / mutant.path, mutated(ROOT, mutant), enclosing_function(ROOT, mutant)
        if covering.runs_on_import(ROOT, mutant, self.coverage):
            function = ""
        if function:
            self._ready()
        self.log.unlink(missing_ok=True)
        original, times = path.read_bytes(), path.stat()
        path.write_text(text, encoding="utf-8")  # for processes that the tests start
        try:
            if function:
                module = mutant.path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
                limit = covering.wall_limit(tests, self.coverage.durations)
                status, seconds, by = self._ready().ask(module, function, text, tests, limit, self.log)
                if status != NO_PLACE:
                    return status, seconds, by
            return covering.ask(self.copy, tests, self.coverage.durations, self.log)
        finally:
            path.write_bytes(original)
            os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))  # its compiled file is then as good as before

    def close(self) -> None:
        if self._zygote is not None:
            self._zygote.close()


def _outcome(status: int, by: str) -> str:
    if status == OK:
        return "survived"
    if status in processes.TIME_OUTS:
        return "time limit"
    if status == TESTS_FAILED:
        return "test failed"
    return "process died" if by else "does not import"


def _test_sources(tests: list[str], by: str) -> str:
    """Hash of the test files that an outcome rests on: the one that caught it, or all that did not."""
    files = {by.partition("::")[0]} if by else {t.partition("::")[0] for t in tests}
    return "".join(source_hash(ROOT / f) for f in sorted(files))


class _Store:
    """Outcomes of earlier runs, one JSON object per line."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._known: dict[str, Asked] = {}
        if path.exists():
            for line in path.read_text(encoding="utf-8").splitlines():
                one = Asked(**json.loads(line))
                self._known[one.key] = one

    def known(self, mutant: Mutant, coverage: covering.Coverage) -> Asked | None:
        """Return the stored outcome, if neither the file nor the tests that it rests on have changed since."""
        one = self._known.get(mutant.key)
        if one is None or one.source != source_hash(ROOT / mutant.path):
            return None
        if one.by and one.by not in coverage.durations:
            return None
        tests = [] if one.by else coverage.plan(ROOT, mutant)
        return one if one.test_source == _test_sources(tests, one.by) else None

    def add(self, one: Asked) -> None:
        self._known[one.key] = one
        with self._path.open("a", encoding="utf-8") as out:
            out.write(json.dumps(vars(one), ensure_ascii=False) + "\n")


if __name__ == "__main__":
    sys.exit(main())
