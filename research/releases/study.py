"""Run an engine with each of its releases, some at the same time; every ended release is kept in a file.

Each runs a scenario and the static capstan test. Only the engine runs in the environment of a release. The reference is solved
here, once: an environment needs the engine and what adapters import.
"""

from __future__ import annotations

import contextlib
import dataclasses
import datetime
import difflib
import hashlib
import json
import math
import platform
import re
import shutil
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from packaging.version import InvalidVersion, Version

import looping_pendulum
from looping_pendulum import __version__
from looping_pendulum.compare.comparison import compare
from looping_pendulum.compare.convergence.study import START_CHANGES, changed_starts
from looping_pendulum.compare.json_text import JsonResult, plain
from looping_pendulum.engines import MEMORY_LIMIT
from looping_pendulum.engines.isolation import run_isolated
from looping_pendulum.engines.protocol import Engine, Profile
from looping_pendulum.engines.reference import Reference
from looping_pendulum.engines.registry import all_engines, engine_facts, label, unknown_engine_message
from looping_pendulum.engines.static_capstan import FREE_LENGTH, measure_capstan_exponent
from looping_pendulum.errors import EngineError, ResultError, shorten
from looping_pendulum.files import file_stem, write_atomically
from looping_pendulum.processes import Interpreter, ReportShare, run_many
from looping_pendulum.runs.trajectory import RunStatus, Trajectory
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.versions import installed_version, source_digest
from research.releases.installers import InstallationStopped, ReleaseError, install
from research.releases.result import CAPSTAN, QUANTITIES, ReleaseRow, ReleasesResult, Spread, VariantRow, find_moves

MAX_MESSAGE_LENGTH = 200
"""Characters of a run's message that are kept."""
MIN_SPREAD_VALUES = 3
"""Fewest values that give a spread."""
PINS = ((f"numpy=={np.__version__}", f"scipy=={installed_version('scipy')}"), ("numpy<2", "scipy"))
"""Requirements beside the engine, tried in turn until all variants run: what adapters import.

The first keeps NumPy and SciPy the same for all releases, so that only the engine differs. Wheels built before NumPy 2 need an
older one, and SciPy one that goes with it.
"""
NOT_KEPT = ("TIME_LIMIT", "MEMORY_LIMIT", "INTERRUPTED")
"""Statuses of runs that another try may bring to their end."""

Install = Callable[[Path, Sequence[str], threading.Event], str]
"""Function that makes an environment in a folder with some requirements, and returns the path of its Python."""
T = TypeVar("T")


def chosen_variants(engine: str, variants: Iterable[str], profile: Profile) -> list[Engine]:
    """Return the variants of ``engine`` with these names, or without names its main ones; all, if none is a main one.

    Raises
    ------
    EngineError
        If the engine or a variant is not known, or is the reference, which is no engine's release.
    """
    engines = all_engines(profile)
    own = [each for each in engines if each.name == engine and engine != "reference"]
    if not own:
        raise EngineError(unknown_engine_message(engine, [each for each in engines if each.name != "reference"]))
    names = tuple(variants)
    if not names:
        return [each for each in own if each.abilities.main] or own
    by_name = {each.variant: each for each in own} | {label(each): each for each in own}
    for name in names:
        if name not in by_name:
            known = ", ".join(each.variant for each in own)
            raise EngineError(f"--variant: {engine} has no variant {name!r}; it has {known}")
    return [each for each in own if each in [by_name[name] for name in names]]


def chosen_releases(
    package: str,
    available: Sequence[Version],
    *,
    first: str | None = None,
    last: str | None = None,
    listed: str | None = None,
) -> list[Version]:
    """Return the releases from ``first`` to ``last``, both included, or those ``listed`` with commas between, oldest first.

    Raises
    ------
    ReleaseError
        If a word is no version, a listed release does not exist, or none lies between the two.
    """
    if listed is not None:
        if first is not None or last is not None:
            raise ReleaseError("--versions: found it beside --from or --to, needed one of the two ways; leave one out")
        wanted = sorted({_version("--versions", word.strip()) for word in listed.split(",") if word.strip()})
        for version in wanted:
            if version not in available:
                near = difflib.get_close_matches(str(version), [str(v) for v in available], n=3, cutoff=0.3)
                nearest = f"; near it are {', '.join(near)}" if near else ""
                raise ReleaseError(f"--versions: {package} has no release {version}{nearest}; {_range(available)}")
        chosen = wanted
    elif first is None and last is None:
        raise ReleaseError(f"needed --from V, --to V or --versions V,W; {package}: {_range(available)}")
    else:
        low = available[0] if first is None else _version("--from", first)
        high = available[-1] if last is None else _version("--to", last)
        chosen = [version for version in available if low <= version <= high]
        if not chosen:
            raise ReleaseError(f"{package} has no release from {low} to {high}; {_range(available)}")
    if not chosen:
        raise ReleaseError("--versions: found no version, needed one or more with commas between; write 3.1.0,3.2.7")
    return chosen


def _version(option: str, word: str) -> Version:
    try:
        return Version(word)
    except InvalidVersion:
        raise ReleaseError(f"{option}: found {word!r}, needed a version; write for example 3.1.0") from None


def _range(available: Sequence[Version]) -> str:
    return f"it has {len(available)} releases, {available[0]} to {available[-1]}"


@dataclass(frozen=True, kw_only=True)
class StoredRecord(JsonResult):
    """File of one release, or of the spread."""

    SCHEMA_ID = "looping-pendulum/release"
    SCHEMA_VERSION = 2

    task: str
    """Digest of all that its content depends on."""
    row: ReleaseRow | None = None
    spread: Spread | None = None


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
        progress: ReportShare | None = None,
        make_environment: Install | None = None,
    ) -> None:
        self.engines, self.folder, self.jobs, self.progress = tuple(engines), folder, jobs, progress
        self.scenario = dataclasses.replace(scenario, tolerances=())
        self.cancelled = threading.Event()
        self._run = partial(run_isolated, time_limit=time_limit, memory_limit=memory_limit, cancelled=self.cancelled)
        self.make_environment = make_environment or install
        self.distribution = distribution_of(engines[0])
        self.interrupted = False
        self._ended, self._total = 0, 1
        self._going: list[str] = []

    def run(self, releases: Sequence[Version]) -> ReleasesResult:
        """Run all ``releases``; those that ``folder`` has are not run again. After Ctrl-C, return what there is."""
        stored = {release: self._read(self._file(str(release)), self._task(str(release))) for release in releases}
        rows = {release: one.row for release, one in stored.items() if one is not None and one.row is not None}
        waiting = [release for release in releases if release not in rows]
        spread_calls = len(self.engines) * 10  # as `spread_runs`: six of the scenario, four of the capstan test
        self._total, self._ended = len(releases) * len(self.engines) + spread_calls, len(rows) * len(self.engines)
        reference = Reference(self.scenario)
        ended = self._in_threads([(release, partial(self._row, release, reference)) for release in waiting])
        rows |= {release: row for release, row in ended.items() if row is not None}
        in_order = tuple(rows[release] for release in sorted(rows))
        spread = None if self.interrupted else self._spread(in_order)
        if self.progress is not None:
            self.progress("", 1.0 if not self.interrupted else self._share())
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

    def _row(self, release: Version, reference: Reference) -> ReleaseRow | None:
        """Return the row of a release and keep it; None if the user interrupted it."""
        best: ReleaseRow | None = None
        errors: list[str] = []
        for pins in PINS:
            if (row := self._try(release, pins, reference, errors)) is None:
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
            record = StoredRecord(task=self._task(str(release)), row=best)
            write_atomically(self._file(str(release)), record.to_json())
        return best

    def _try(self, release: Version, pins: tuple[str, ...], reference: Reference, errors: list[str]) -> ReleaseRow | None:
        """Return the row of a release with some pins; None if the user interrupted it."""
        environment = self.folder / "environments" / file_stem(str(release), *pins)
        requirements = (f"{self.distribution}=={release}", *pins)
        try:
            with self._shown(f"{self.distribution} {release}: installing", steps=0):
                python = self.make_environment(environment, requirements, self.cancelled)
            interpreter = interpreter_of(python, self.engines)
            variants: list[VariantRow] = []
            packages: dict[str, str] = {}
            for engine in self.engines:
                with self._shown(f"{release}: {label(engine)}"):
                    variant, versions = measure_variant(self._elsewhere(engine, interpreter), reference)
                if self.cancelled.is_set():
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

    def _spread(self, rows: Sequence[ReleaseRow]) -> Spread | None:
        """Return how far changed starts move the numbers of the newest release of which most variants run."""
        ran = [row for row in rows if row.ran]
        if not ran:
            return None
        newest = max(ran, key=lambda row: (_ran(row), Version(row.release)))
        file, task = self.folder / "spread.json", self._task(f"spread {newest.release}")
        if (stored := self._read(file, task)) is not None:
            return stored.spread
        environment = self.folder / "environments" / "spread"
        try:
            with self._shown(f"{self.distribution} {newest.release}: installing for the spread", steps=0):
                requirements = (f"{self.distribution}=={newest.release}", *(PINS[1] if newest.pins else PINS[0]))
                # In a thread, as the main one has to notice Ctrl-C
                made = self._in_threads([("", partial(self.make_environment, environment, requirements, self.cancelled))])
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
        write_atomically(file, StoredRecord(task=task, spread=spread).to_json())
        return spread

    def _spread_values(self, row: ReleaseRow, interpreter: Interpreter) -> dict[str, list[dict[str, float | None]]]:
        """Return the values of the runs with changed starts of each variant that runs, its own start's among them."""

        def shown(name: str, call: Callable[[], T]) -> T:
            with self._shown(f"changed starts: {name}"):
                return call()

        references = [Reference(changed) for _, changed in changed_starts(self.scenario)]
        values: dict[str, list[dict[str, float | None]]] = {}
        calls = []
        for engine in self.engines:
            own = row.variant(label(engine))
            if own is None:
                continue
            values[label(engine)] = [own.values]
            runs = spread_runs(self._elsewhere(engine, interpreter), references)
            calls += [((label(engine), number), partial(shown, label(engine), run)) for number, run in enumerate(runs)]
        for (name, _), one in self._in_threads(calls).items():
            values[name].append(one)
        return values

    def _elsewhere(self, engine: Engine, interpreter: Interpreter) -> EngineElsewhere:
        return EngineElsewhere(engine=engine, run=partial(self._run, interpreter=interpreter))

    def _in_threads(self, calls: Sequence[tuple[Any, Callable[[], T]]]) -> dict[Any, T]:
        """Make calls, `jobs` at a time, and return key -> result of those that had begun; Ctrl-C cancels all others."""

        def report(_: Mapping[int, T]) -> None:
            if self.progress is not None:
                self.progress("; ".join(self._going[:3]), self._share())

        results = run_many([call for _, call in calls], self.jobs, cancelled=self.cancelled, meanwhile=report)
        self.interrupted = self.interrupted or self.cancelled.is_set()
        return {calls[i][0]: result for i, result in results.items()}

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
            "scenario": [plain(self.scenario.parameters), self.scenario.duration],
            "versions": [__version__, platform.python_version(), PINS],
        }
        return hashlib.sha256(json.dumps(about, sort_keys=True).encode()).hexdigest()[:20]

    @staticmethod
    def _read(file: Path, task: str) -> StoredRecord | None:
        """Return the record of a task; None if there is none."""
        try:
            stored = StoredRecord.from_json(file.read_text(encoding="utf-8"))
        # Of another version of this program, or damaged: it is made again
        except (OSError, ValueError, ResultError):
            return None
        return stored if stored.task == task else None


def _ran(row: ReleaseRow) -> int:
    return sum(v.ran for v in row.variants)


def _another_numpy_may_help(row: ReleaseRow) -> bool:
    if row.variants:
        return any(v.status in ("FAILED", "CRASHED") for v in row.variants)
    return "numpy" in row.error.lower()


def distribution_of(engine: Engine) -> str:
    """Return the package of an engine, as pip names it."""
    package = engine.abilities.packages[0]
    known = engine_facts(engine.name).packages
    return known[package].pip if package in known else str(getattr(engine, "distribution", package))


def interpreter_of(python: str, engines: Sequence[Engine]) -> Interpreter:
    """Return the Python at the path ``python`` with this package and the adapters of ``engines``."""
    names = {looping_pendulum.__name__, *(type(engine).__module__.partition(".")[0] for engine in engines)}
    files = [Path(str(sys.modules[name].__file__)) for name in sorted(names)]
    folders = (str(file.parent.parent if file.name == "__init__.py" else file.parent) for file in files)
    return Interpreter(executable=python, folders=tuple(folders))


@dataclass(frozen=True, kw_only=True)
class EngineElsewhere:
    """An engine whose runs are made by another Python, as the static capstan test needs one: it only simulates."""

    engine: Engine
    run: Callable[[Engine, Scenario], Trajectory]
    """`run_isolated` by that Python, with the limits of the study."""

    def simulate(self, scenario: Scenario) -> Trajectory:
        """Run ``scenario`` by the other Python; the status says how it ended."""
        return self.run(self.engine, scenario)


# One comparison at a time: they are short, and the integrator of a reference is not known to be safe among threads
_comparing = threading.Lock()


def measure_variant(elsewhere: EngineElsewhere, reference: Reference) -> tuple[VariantRow, dict[str, str]]:
    """Return a variant's row, and the versions of the packages that it ran with."""
    run = elsewhere.simulate(reference.scenario)
    values: dict[str, float | None] = dict.fromkeys(QUANTITIES)
    row = VariantRow(
        label=label(elsewhere.engine),
        status=run.status.name,
        ok=run.status.ok,
        error="" if run.status.ok else _why(run),
        values=values,
        cpu_time=run.cpu_time if math.isfinite(run.cpu_time) else None,
    )
    versions = dict(run.provenance.versions)
    if not row.ran:
        return row, versions
    values |= metrics_of(run, reference)
    values[CAPSTAN.name], note = capstan_error(elsewhere)
    return replace(row, values=values, capstan_note=note), versions


def _why(run: Trajectory) -> str:
    """Return in one line how a run failed."""
    # Without the places of files in an environment that is gone
    message = re.sub(r" \((/|[A-Z]:\\)[^)]*\)", "", " ".join(run.message.split()))
    return shorten(f"{run.status.value}: {message}" if message else run.status.value, MAX_MESSAGE_LENGTH)


def metrics_of(run: Trajectory, reference: Reference) -> dict[str, float | None]:
    """Return the metrics of a run that are in `QUANTITIES`."""
    with _comparing:
        result = compare(reference.scenario, reference, [run])
    return {name: value for name, value in result.engines[0].metrics.items() if name in QUANTITIES}


def capstan_error(
    elsewhere: EngineElsewhere, *, wrap_angle: float = math.pi, free_length: float = FREE_LENGTH
) -> tuple[float | None, str]:
    """Return the relative error of the static capstan test's exponent; otherwise None and why, in one line."""
    try:
        # It asks for no more of an engine than to simulate
        point = measure_capstan_exponent(elsewhere, wrap_angle=wrap_angle, free_length=free_length)  # type: ignore[arg-type]
    except EngineError as error:
        return None, shorten(" ".join(str(error).split()), MAX_MESSAGE_LENGTH)
    return point.error, ""


def spread_runs(elsewhere: EngineElsewhere, references: Sequence[Reference]) -> list[Callable[[], dict[str, float | None]]]:
    """Return calls, each of which makes one run with a changed start, as the references have it.

    Each returns its values by name in `QUANTITIES`.
    """
    changes = {name: size for name, size, _ in START_CHANGES}
    starts = [{"wrap_angle": math.pi + sign * changes["release_angle"]} for sign in (1, -1)]
    starts += [{"free_length": FREE_LENGTH + sign * changes["free_length"]} for sign in (1, -1)]

    def metrics_run(reference: Reference) -> dict[str, float | None]:
        run = elsewhere.simulate(reference.scenario)
        # No values of a run that broke off for another reason than the engine's numbers
        return metrics_of(run, reference) if run.status is not RunStatus.INTERRUPTED and len(run.t) else {}

    def capstan_run(start: dict[str, float]) -> dict[str, float | None]:
        return {CAPSTAN.name: capstan_error(elsewhere, **start)[0]}

    return [*(partial(metrics_run, each) for each in references), *(partial(capstan_run, start) for start in starts)]


def standard_deviations(values: Sequence[dict[str, float | None]]) -> dict[str, float | None]:
    """Return the standard deviation of each quantity over the runs that have it; None for fewer than `MIN_SPREAD_VALUES`."""
    spreads: dict[str, float | None] = {}
    for name in QUANTITIES:
        known = [value for one in values if (value := one.get(name)) is not None]
        if len(known) < MIN_SPREAD_VALUES:
            spreads[name] = None
            continue
        mean = sum(known) / len(known)
        spreads[name] = math.sqrt(sum((value - mean) ** 2 for value in known) / (len(known) - 1))
    return spreads
