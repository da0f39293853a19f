"""Many inputs of several kinds, their tally, and what is kept of each fault."""

import contextlib
import hashlib
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from tests.fuzz.judging import CPU_LIMIT, Outcome, Verdict, judge
from tests.fuzz.kinds import InputKind
from tests.fuzz.shrinking import shrink


@dataclass(kw_only=True)
class Tally:
    """What became of the inputs of one kind."""

    kind: str
    outcomes: Counter[Outcome] = field(default_factory=Counter)
    signatures: Counter[str] = field(default_factory=Counter)
    """Of faults."""
    seconds: float = 0.0

    @property
    def tried(self) -> int:
        """Number of inputs."""
        return self.outcomes.total()

    @property
    def faults(self) -> int:
        """How many were neither accepted nor refused as they should be."""
        return sum(count for outcome, count in self.outcomes.items() if outcome.is_fault)


def fuzz(
    kind: InputKind,
    count: int,
    *,
    seed: int,
    failures: Path,
    cpu_limit: float = CPU_LIMIT,
    shrink_seconds: float = 20.0,
    report_progress: Callable[[Tally], None] = lambda _tally: None,
) -> Tally:
    """Try ``count`` inputs of ``kind``; each follows from ``seed`` and its number alone.

    Parameters
    ----------
    failures
        Folder for the failing inputs: ``KIND/HASH.input``, what went wrong beside it in ``HASH.txt``, and of the first of each
        cause the smallest input that does the same in ``HASH.shrunk``.
    """
    tally = Tally(kind=kind.name)
    begin = time.monotonic()
    failures = failures.absolute()
    running = failures / f"{kind.name}.running"
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        seeds = kind.seeds()
        for number in range(count):
            data = kind.generate(Random(f"{seed} {kind.name} {number}"), seeds)
            failures.mkdir(parents=True, exist_ok=True)
            running.write_bytes(data)  # stays behind if it takes the whole process with it
            verdict = judge(kind.run, data, cpu_limit=cpu_limit)
            tally.outcomes[verdict.outcome] += 1
            if verdict.outcome.is_fault:
                is_first = verdict.signature not in tally.signatures
                tally.signatures[verdict.signature] += 1
                keep(kind, data, verdict, failures / kind.name, cpu_limit, shrink_seconds if is_first else 0.0)
            tally.seconds = time.monotonic() - begin
            report_progress(tally)
        running.unlink(missing_ok=True)
    return tally


def keep(kind: InputKind, data: bytes, verdict: Verdict, folder: Path, cpu_limit: float, shrink_seconds: float) -> None:
    """Write a failing input, what it did and, unless there is no time for it, its smallest form."""
    folder.mkdir(parents=True, exist_ok=True)
    stem = folder / hashlib.sha256(data).hexdigest()[:12]
    stem.with_suffix(".input").write_bytes(data)
    stem.with_suffix(".txt").write_text(f"{verdict.signature}\n\n{verdict.report}", encoding="utf-8", errors="backslashreplace")
    if shrink_seconds:

        def is_same_fault(smaller: bytes) -> bool:
            return judge(kind.run, smaller, cpu_limit=cpu_limit).signature == verdict.signature

        stem.with_suffix(".shrunk").write_bytes(shrink(data, is_same_fault, seconds=shrink_seconds))
