"""Measure one engine variant by the Python of another environment: a scenario's metrics and the static capstan test.

Only the engine runs there. The reference is solved here, once: an environment needs the engine and what adapters import.
"""

from __future__ import annotations

import math
import re
import sys
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import looping_pendulum
from looping_pendulum.compare.comparison import compare
from looping_pendulum.compare.convergence.study import START_CHANGES, changed_starts
from looping_pendulum.engines.isolation import run_isolated
from looping_pendulum.engines.memory import MEMORY_LIMIT
from looping_pendulum.engines.protocol import Engine
from looping_pendulum.engines.reference import Reference
from looping_pendulum.engines.registry import label
from looping_pendulum.engines.tension import FREE_LENGTH, measure_capstan_exponent
from looping_pendulum.engines.trajectory import RunStatus, Trajectory
from looping_pendulum.errors import EngineError, shorten
from looping_pendulum.processes import Interpreter
from looping_pendulum.releases.result import CAPSTAN, QUANTITIES, VariantRow
from looping_pendulum.scenarios.scenario import Scenario

MAX_MESSAGE_LENGTH = 200
"""Characters of a run's message that are kept."""
MIN_SPREAD_VALUES = 3
"""Fewest values that give a spread."""


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Limits of each run, and what ends all."""

    time_limit: float
    """[s]."""
    memory_limit: int = MEMORY_LIMIT
    """[bytes]."""
    cancelled: threading.Event = field(default_factory=threading.Event)


def interpreter_of(python: str, engines: Sequence[Engine]) -> Interpreter:
    """Return the Python at the path ``python`` with this package and the adapters of ``engines``, and nothing else of ours."""
    names = {looping_pendulum.__name__, *(type(engine).__module__.partition(".")[0] for engine in engines)}
    return Interpreter(executable=python, folders=(), modules={name: _folder_of(name) for name in sorted(names)})


def _folder_of(name: str) -> str:
    """Return the folder from which a top-level module, which is imported, was found."""
    file = Path(str(sys.modules[name].__file__))
    return str(file.parent.parent if file.name == "__init__.py" else file.parent)


@dataclass(frozen=True, kw_only=True)
class EngineElsewhere:
    """An engine whose runs are made by another Python, as the static capstan test needs one: it only simulates."""

    engine: Engine
    interpreter: Interpreter
    options: RunOptions

    def simulate(self, scenario: Scenario) -> Trajectory:
        """Run ``scenario`` by the other Python; the status says how it ended."""
        return run_isolated(
            self.engine,
            scenario,
            time_limit=self.options.time_limit,
            memory_limit=self.options.memory_limit,
            cancelled=self.options.cancelled,
            interpreter=self.interpreter,
        )


@dataclass(frozen=True, kw_only=True)
class Target:
    """A scenario with its reference."""

    scenario: Scenario
    reference: Reference


def target_of(scenario: Scenario) -> Target:
    """Return ``scenario`` with its reference."""
    return Target(scenario=scenario, reference=Reference(scenario))


# One comparison at a time: they are short, and the integrator of a reference is not known to be safe among threads
_comparing = threading.Lock()


def measure_variant(elsewhere: EngineElsewhere, target: Target) -> tuple[VariantRow, dict[str, str]]:
    """Return a variant's row, and the versions of the packages that it ran with."""
    run = elsewhere.simulate(target.scenario)
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
    values |= metrics_of(run, target)
    values[CAPSTAN.name], note = capstan_error(elsewhere)
    return replace(row, values=values, capstan_note=note), versions


def _why(run: Trajectory) -> str:
    """Return in one line how a run failed."""
    # Without the places of files in an environment that is gone
    message = re.sub(r" \((/|[A-Z]:\\)[^)]*\)", "", " ".join(run.message.split()))
    return shorten(f"{run.status.value}: {message}" if message else run.status.value, MAX_MESSAGE_LENGTH)


def metrics_of(run: Trajectory, target: Target) -> dict[str, float | None]:
    """Return the metrics of a run that are in `QUANTITIES`."""
    with _comparing:
        result = compare(target.scenario, target.reference, [run])
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


def start_change_targets(scenario: Scenario) -> tuple[Target, ...]:
    """Return ``scenario`` with each of the engine study's small changes of the start, each with a reference of its own."""
    return tuple(target_of(changed) for _, changed in changed_starts(scenario))


def spread_runs(elsewhere: EngineElsewhere, targets: Sequence[Target]) -> list[Callable[[], dict[str, float | None]]]:
    """Return calls, each of which makes one run with a changed start and returns its values by name in `QUANTITIES`."""
    changes = {name: size for name, size, _ in START_CHANGES}
    starts = [{"wrap_angle": math.pi + sign * changes["release_angle"]} for sign in (1, -1)]
    starts += [{"free_length": FREE_LENGTH + sign * changes["free_length"]} for sign in (1, -1)]

    def metrics_run(target: Target) -> Callable[[], dict[str, float | None]]:
        def make() -> dict[str, float | None]:
            run = elsewhere.simulate(target.scenario)
            # No values of a run that broke off for another reason than the engine's numbers
            return metrics_of(run, target) if run.status is not RunStatus.INTERRUPTED and len(run.t) else {}

        return make

    def capstan_run(start: dict[str, float]) -> Callable[[], dict[str, float | None]]:
        return lambda: {CAPSTAN.name: capstan_error(elsewhere, **start)[0]}

    return [*(metrics_run(target) for target in targets), *(capstan_run(start) for start in starts)]


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
