"""Run the variants of one engine with each of its releases, some at the same time; every ended release is kept in a file."""

from __future__ import annotations

import contextlib
import dataclasses
import datetime
import hashlib
import json
import platform
import shutil
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from packaging.version import Version

from looping_pendulum import __version__
from looping_pendulum.compare.json_text import dump, load, plain
from looping_pendulum.compare.run_cache import source_digest
from looping_pendulum.engines.memory import MEMORY_LIMIT
from looping_pendulum.engines.protocol import Engine
from looping_pendulum.engines.registry import DISTRIBUTIONS, label
from looping_pendulum.errors import ResultError
from looping_pendulum.files import file_stem, write_atomically
from looping_pendulum.releases.installers import InstallationStopped, ReleaseError, install
from looping_pendulum.releases.measure import (
    EngineElsewhere,
    RunOptions,
    Target,
    interpreter_of,
    measure_variant,
    spread_runs,
    standard_deviations,
    start_change_targets,
    target_of,
)
from looping_pendulum.releases.moves import find_moves
from looping_pendulum.releases.result import ReleaseRow, ReleasesResult, Spread, VariantRow
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.versions import installed_version

PINS = ((f"numpy=={np.__version__}", f"scipy=={installed_version('scipy')}"), ("numpy<2", "scipy"))
"""Requirements beside the engine, tried in turn until all variants run: what adapters import.

The first keeps NumPy and SciPy the same for all releases, so that only the engine differs. Wheels built before NumPy 2 need an
older one, and SciPy one that goes with it.
"""
POLL_INTERVAL = 0.05
"""Time between two looks at the runs [s]; Ctrl-C is noticed in between."""
NOT_KEPT = ("TIME_LIMIT", "MEMORY_LIMIT", "INTERRUPTED")
"""Statuses of runs that another try may bring to their end."""
RECORD, SPREAD_RECORD, RECORD_VERSION = "looping-pendulum/release", "looping-pendulum/release-spread", 1

Install = Callable[[Path, Sequence[str], threading.Event], str]
"""Function that makes an environment in a folder with some requirements, and returns the path of its Python."""
Progress = Callable[[float, str], None]
"""Callback that is given the share of the work that is done, 0 to 1, and what goes on."""
T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class StoredRow:
    """File of one release."""

    task: str
    """Digest of all that the row depends on."""
    row: ReleaseRow


@dataclass(frozen=True, kw_only=True)
class StoredSpread:
    """File of the spread."""

    task: str
    spread: Spread


class ReleaseStudy:
    """The study of some releases of one engine.

    Parameters
    ----------
    engines
        Its variants.
    folder
        Where each ended release is kept, and where the environments stand while they are needed.
    jobs
        Number of environments, and of runs, at the same time.
    make_environment
        What stands in for `installers.install`.
    """

    def __init__(
        self,
        engines: Sequence[Engine],
        scenario: Scenario,
        folder: Path,
        *,
        jobs: int = 2,
        time_limit: float = 900.0,
        memory_limit: int = MEMORY_LIMIT,
        progress: Progress | None = None,
        make_environment: Install | None = None,
    ) -> None:
        self.engines, self.folder, self.jobs, self.progress = tuple(engines), folder, jobs, progress
        self.scenario = dataclasses.replace(scenario, tolerances=())
        self.options = RunOptions(time_limit=time_limit, memory_limit=memory_limit)
        self.make_environment = make_environment or install
        self.distribution = distribution_of(engines[0])
        self.interrupted = False
        self._ended, self._total = 0, 1
        self._going: list[str] = []
        self._lock = threading.Lock()

    def run(self, releases: Sequence[Version]) -> ReleasesResult:
        """Run all ``releases``; those that ``folder`` has are not run again. After Ctrl-C, return what there is."""
        rows = {release: row for release in releases if (row := self._stored_row(release)) is not None}
        waiting = [release for release in releases if release not in rows]
        spread_calls = len(self.engines) * 10  # as `spread_runs`: six of the scenario, four of the capstan test
        self._total, self._ended = len(releases) * len(self.engines) + spread_calls, len(rows) * len(self.engines)
        target = target_of(self.scenario)
        ended = self._in_threads([(release, partial(self._row, release, target)) for release in waiting])
        rows |= {release: row for release, row in ended.items() if row is not None}
        in_order = tuple(rows[release] for release in sorted(rows))
        spread = None if self.interrupted else self._spread(in_order, target)
        if self.progress is not None:
            self.progress(1.0 if not self.interrupted else self._share(), "")
        return ReleasesResult(
            engine=self.engines[0].name,
            distribution=self.distribution,
            scenario=self.scenario.name,
            profile=self.engines[0].profile.value,
            python=platform.python_version(),
            date=datetime.datetime.now(datetime.UTC).date().isoformat(),
            interrupted=self.interrupted,
            releases=in_order,
            spread=spread,
            moves=() if spread is None else find_moves(in_order, spread),
        )

    def _row(self, release: Version, target: Target) -> ReleaseRow | None:
        """Return the row of a release and keep it; None if the user interrupted it."""
        best: ReleaseRow | None = None
        errors: list[str] = []
        for pins in PINS:
            if (row := self._try(release, pins, target, errors)) is None:
                return None
            # The first environment in which most variants run; where none does, the last, which suits an old release best
            if row.variants and (best is None or not best.ran or _ran(row) > _ran(best)):
                best = row
            if not _another_numpy_may_help(row):
                break
        if best is None:
            # Not kept: it costs seconds to try again, perhaps with a network
            return ReleaseRow(release=str(release), error=errors[0], packages={})
        if not any(v.status in NOT_KEPT for v in best.variants):
            self._store(self._file(str(release)), StoredRow(task=self._task(str(release)), row=best), RECORD)
        return best

    def _try(self, release: Version, pins: tuple[str, ...], target: Target, errors: list[str]) -> ReleaseRow | None:
        """Return the row of a release with some pins; None if the user interrupted it."""
        environment = self.folder / "environments" / file_stem(str(release), *pins)
        requirements = (f"{self.distribution}=={release}", *pins)
        try:
            with self._shown(f"{self.distribution} {release}: installing", steps=0):
                python = self.make_environment(environment, requirements, self.options.cancelled)
            interpreter = interpreter_of(python, self.engines)
            variants: list[VariantRow] = []
            packages: dict[str, str] = {}
            for engine in self.engines:
                with self._shown(f"{release}: {label(engine)}"):
                    variant, versions = measure_variant(
                        EngineElsewhere(engine=engine, interpreter=interpreter, options=self.options), target
                    )
                if self.options.cancelled.is_set():
                    return None
                packages |= versions
                variants.append(variant)
            named_pins = () if pins == PINS[0] else pins[:1]
            return ReleaseRow(release=str(release), packages=packages, pins=named_pins, variants=tuple(variants))
        except InstallationStopped:
            return None
        except ReleaseError as error:
            errors.append(str(error))
            return ReleaseRow(release=str(release), error=str(error), packages={})
        finally:
            shutil.rmtree(environment, ignore_errors=True)

    def _spread(self, rows: Sequence[ReleaseRow], target: Target) -> Spread | None:
        """Return how far changed starts move the numbers of the newest release of which most variants run."""
        ran = [row for row in rows if row.ran]
        if not ran:
            return None
        newest = max(ran, key=lambda row: (_ran(row), Version(row.release)))
        file, task = self.folder / "spread.json", self._task(f"spread {newest.release}")
        stored = self._read(file, StoredSpread, SPREAD_RECORD)
        if stored is not None and stored.task == task:
            return stored.spread
        environment = self.folder / "environments" / "spread"
        try:
            with self._shown(f"{self.distribution} {newest.release}: installing for the spread", steps=0):
                requirements = (f"{self.distribution}=={newest.release}", *(PINS[1] if newest.pins else PINS[0]))
                # In a thread, as the main one has to notice Ctrl-C
                made = self._in_threads(
                    [("", partial(self.make_environment, environment, requirements, self.options.cancelled))]
                )
            if self.interrupted:
                return None
            values = self._spread_values(newest, interpreter_of(made[""], self.engines))
        except InstallationStopped:
            self.interrupted = True
        finally:
            shutil.rmtree(environment, ignore_errors=True)
        if self.interrupted:
            return None
        spread = Spread(release=newest.release, values={name: standard_deviations(each) for name, each in values.items()})
        self._store(file, StoredSpread(task=task, spread=spread), SPREAD_RECORD)
        return spread

    def _spread_values(self, row: ReleaseRow, interpreter: Any) -> dict[str, list[dict[str, float | None]]]:
        """Return the values of the runs with changed starts of each variant that runs, its own start's among them."""
        targets = start_change_targets(self.scenario)
        values: dict[str, list[dict[str, float | None]]] = {}
        calls = []
        for engine in self.engines:
            own = row.variant(label(engine))
            if own is None:
                continue
            values[label(engine)] = [own.values]
            elsewhere = EngineElsewhere(engine=engine, interpreter=interpreter, options=self.options)
            for number, call in enumerate(spread_runs(elsewhere, targets)):

                def shown(name: str = label(engine), call: Callable[[], Any] = call) -> Any:
                    with self._shown(f"changed starts: {name}"):
                        return call()

                calls.append(((label(engine), number), shown))
        for (name, _), one in self._in_threads(calls).items():
            values[name].append(one)
        return values

    def _in_threads(self, calls: Sequence[tuple[Any, Callable[[], T]]]) -> dict[Any, T]:
        """Make calls, `jobs` at a time, and return key -> result of those that had begun; Ctrl-C cancels all others."""
        queue, results = iter(calls), dict[Any, T]()

        def work() -> None:
            while not self.options.cancelled.is_set():
                with self._lock:
                    key, call = next(queue, (None, None))
                if call is None:
                    return
                results[key] = call()

        # Threads suffice: each only waits for processes
        with ThreadPoolExecutor(max_workers=self.jobs) as pool:
            futures = [pool.submit(work) for _ in range(self.jobs)]
            while not all(future.done() for future in futures):
                try:
                    time.sleep(POLL_INTERVAL)
                    if self.progress is not None:
                        self.progress(self._share(), "; ".join(self._going[:3]))
                except KeyboardInterrupt:
                    self.options.cancelled.set()
            for future in futures:
                future.result()
        self.interrupted = self.interrupted or self.options.cancelled.is_set()
        return results

    @contextlib.contextmanager
    def _shown(self, words: str, *, steps: int = 1) -> Iterator[None]:
        """Show a step as going on; it counts as ``steps`` of the whole work."""
        self._going.append(words)
        try:
            yield
        finally:
            self._going.remove(words)
            self._ended += steps

    def _share(self) -> float:
        return min(0.999, self._ended / self._total)

    def _file(self, release: str) -> Path:
        return self.folder / "releases" / f"{file_stem(self.distribution, release)}.json"

    def _task(self, what: str) -> str:
        """Return a digest of all that a row depends on; code that adapters share counts as this package's version."""
        about = {
            "what": what,
            "engines": [
                [label(e), e.profile.value, plain(e.settings), source_digest(type(e).__module__)] for e in self.engines
            ],
            "scenario": [plain(self.scenario.parameters.as_dict()), self.scenario.duration],
            "versions": [__version__, platform.python_version(), PINS],
        }
        return hashlib.sha256(json.dumps(about, sort_keys=True).encode()).hexdigest()[:20]

    def _stored_row(self, release: Version) -> ReleaseRow | None:
        stored = self._read(self._file(str(release)), StoredRow, RECORD)
        return stored.row if stored is not None and stored.task == self._task(str(release)) else None

    @staticmethod
    def _read(file: Path, kind: type[T], schema: str) -> T | None:
        try:
            return load(kind, file.read_text(encoding="utf-8"), schema, RECORD_VERSION, file=file.name)
        # Of another version of this program, or damaged: it is made again
        except (OSError, ValueError, ResultError):
            return None

    @staticmethod
    def _store(file: Path, record: StoredRow | StoredSpread, schema: str) -> None:
        write_atomically(file, dump(record, schema, RECORD_VERSION))


def _ran(row: ReleaseRow) -> int:
    return sum(v.ran for v in row.variants)


def _another_numpy_may_help(row: ReleaseRow) -> bool:
    if row.variants:
        return any(v.status in ("FAILED", "CRASHED") for v in row.variants)
    return "numpy" in row.error.lower()


def distribution_of(engine: Engine) -> str:
    """Return the package of an engine, as pip names it."""
    package = engine.abilities.packages[0]
    return str(getattr(engine, "distribution", DISTRIBUTIONS.get(package, package)))
