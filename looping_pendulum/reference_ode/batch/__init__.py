"""Solve many runs of the hybrid model at once and return their results as arrays."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Iterable, Sequence
from concurrent.futures.process import BrokenProcessPool

import numpy as np

from looping_pendulum.errors import HarnessError, IntegratorFallbackWarning, ParameterError
from looping_pendulum.processes import process_pool
from looping_pendulum.reference_ode.batch.runs import (
    ENDS,
    FAILED,
    Batch,
    BatchResult,
    BatchRuns,
    Columns,
    Progress,
    column_names,
    parameters_of_run,
    sequence_hash,
    summary,
)
from looping_pendulum.reference_ode.batch.samples import BatchSamples
from looping_pendulum.reference_ode.batch.schedule import Schedule
from looping_pendulum.reference_ode.batch.steps import supports_batch
from looping_pendulum.reference_ode.effects import EFFECTS, Effect, EffectKind
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import HasParameters, Parameters, Release, parameters_of
from looping_pendulum.reference_ode.solve import DURATION, TOLERANCE, available_integrators, solve_without_warning

__all__ = [
    "ENDS",
    "FAILED",
    "BatchResult",
    "BatchSamples",
    "Progress",
    "compiled_alone",
    "sample_batch",
    "sequence_hash",
    "solve_batch",
    "supports",
]


def solve_batch(
    base: Parameters | HasParameters,
    columns: Columns,
    *,
    duration: float = DURATION,
    tolerance: float = TOLERANCE,
    processes: int = 1,
    progress: Progress | None = None,
) -> BatchResult:
    """Integrate many runs that share ``base`` but for ``columns``; each result equals that of `solve`.

    With heyoka, all runs are stepped together, unless the rod turns or the string stretches; otherwise they are solved one
    after another. A run at which heyoka gives up is handed to SciPy and marked (`BatchResult.handed_over`), with one
    `IntegratorFallbackWarning` for all.
    A result does not depend, in any bit, on the other runs, on their order, or on the process that computes it.

    Parameters
    ----------
    base
        Parameters that the runs have in common; or a scenario, which has them.
    columns
        Parameters that differ between the runs: fields of `Parameters` or coefficients of effects, by name; arrays of
        shape (n,), SI.
    duration
        Limit on the simulated time [s].
    tolerance
        Relative tolerance of a step.
    processes
        Number of processes that share the work.
    progress
        Called now and then with the number of runs that have ended and the number of all runs.

    Raises
    ------
    ParameterError
        If a column has an unknown name or another length than the others. A run whose values are impossible, or that breaks
        down, is marked as failed and does not disturb the others.
    """
    base = parameters_of(base)
    n = _checked_length(base, columns)
    columns = {name: np.asarray(values, dtype=float) for name, values in columns.items()}
    if processes < 1:
        raise ParameterError(f"processes: found {processes}, needed 1 or more")
    worker_count = max(1, min(processes, n))  # a process without a run would only cost its start
    batch = Batch(base=base, columns=columns, n=n, durations=np.full(n, duration), tolerance=tolerance)
    result = _solved(batch, progress) if worker_count == 1 else _solved_together(batch, worker_count, progress)
    count = int(np.count_nonzero(result.handed_over))
    if count:
        warnings.warn(IntegratorFallbackWarning(f"heyoka gave up at {count} of {n} runs, so SciPy solved these"), stacklevel=2)
    return result


def sample_batch(
    base: Parameters,
    columns: Columns,
    times: Sequence[Array],
    *,
    duration: float | Array = DURATION,
    tolerance: float = TOLERANCE,
) -> BatchSamples:
    """Return samples of the runs of `solve_batch`, each at ascending times of its own [s], from the steps that the batch takes.

    If an effect acts beyond those of the paper's model, so do all others that a batch supports, at their null values: one
    compiled model then serves all of them, which takes seconds to compile.

    Parameters
    ----------
    duration
        Limit on the simulated time [s], for all runs or for each, shape (n,).

    Raises
    ------
    ParameterError
        As `solve_batch` does, or if there are not as many times as runs.
    """
    n = _checked_length(base, columns)
    columns = {name: np.asarray(values, dtype=float) for name, values in columns.items()}
    if len(times) != n:
        raise ParameterError(f"times: found those of {len(times)} runs, needed {n}")
    samples = BatchSamples.at([np.asarray(t, dtype=float) for t in times])
    acting = _compiled_together(base, columns)
    durations = np.broadcast_to(np.asarray(duration, dtype=float), n)
    batch = Batch(base=base, columns=columns, n=n, durations=durations, tolerance=tolerance, acting=acting)
    _solved(batch, samples=samples)
    return samples


def supports(base: Parameters, names: Collection[str]) -> bool:
    """Return whether runs with these coefficients, beside those of ``base``, are stepped together, not one after another."""
    return "heyoka" in available_integrators() and supports_batch(base.effects_with(names))


def compiled_alone(effects: Iterable[Effect]) -> tuple[str, ...]:
    """Return the names of the effects that add state variables or wind the string on itself.

    They are compiled in where they act alone: all in one model would make every run slower.
    """
    return tuple(effect.name for effect in effects if effect.variables or effect.watches_first_turn)


def _compiled_together(base: Parameters, columns: Columns) -> frozenset[str]:
    """Return coefficients whose effects are compiled in, whether they act or not."""
    effects = base.effects_with([name for name in columns if name in base.coefficients])
    further = (effect for effect in effects if not effect.in_base_model)
    if not supports_batch(effects) or not any(_is_common(effect) or effect.kind is EffectKind.CLOSURE for effect in further):
        return frozenset()
    # At rest the speed of air that does not move has no derivative, and a swing comes to rest again and again
    left_out = {"wind"} if base.release is Release.HELD else set()
    common = [effect for effect in EFFECTS.values() if _is_common(effect) and effect.name not in left_out]
    return frozenset(c.name for effect in common for c in effect.coefficients)


def _is_common(effect: Effect) -> bool:
    """Return whether an effect is compiled in beside any other.

    One from elsewhere is not, nor a closure, which is large, nor those of `compiled_alone`.
    """
    return not (effect.package or effect.kind in (EffectKind.CLOSURE, EffectKind.RELEASE) or compiled_alone((effect,)))


def _checked_length(base: Parameters, columns: Columns) -> int:
    """Check the names and shapes of the columns and return the number of runs."""
    if not columns:
        raise ParameterError("columns: found none, needed at least one array of values, one value per run")
    lengths: dict[str, int] = {}
    for name, values in columns.items():
        if name not in column_names(base):
            raise ParameterError(f"columns: found {name!r}, needed one of {', '.join(column_names(base))}")
        shape = np.shape(values)
        if len(shape) != 1:
            raise ParameterError(f"columns: {name}: found shape {shape}, needed one value per run, shape (n,)")
        lengths[name] = shape[0]
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise ParameterError(f"columns: found lengths {listed}, needed the same for all")
    return next(iter(lengths.values()))


def _solved(batch: Batch, progress: Progress | None = None, samples: BatchSamples | None = None) -> BatchResult:
    """Return the results of all runs, and fill in their samples if any are wanted."""
    runs = BatchRuns(batch, progress)
    effects = batch.base.effects_with(batch.acting.union(name for name in batch.columns if name in batch.base.coefficients))
    if "heyoka" in available_integrators() and supports_batch(effects):
        Schedule(runs, effects, samples).run()
    # What failed there is solved once more by itself, where SciPy may take over from heyoka
    for i in np.flatnonzero(runs.result.end == FAILED).tolist():
        try:
            run = solve_without_warning(
                parameters_of_run(batch.base, batch.columns, i), duration=float(batch.durations[i]), tolerance=batch.tolerance
            )
        except (HarnessError, ArithmeticError):
            pass  # the run stays marked as failed
        else:
            if samples is not None:
                times = samples.t[samples.part(i)]
                samples.put(i, run.sample(times[times <= run.end_time]))
            for name, value in summary(run).items():
                getattr(runs.result, name)[i] = value
        runs.report_ended(1)
    return runs.result


def _solved_together(batch: Batch, processes: int, progress: Progress | None) -> BatchResult:
    """Do the same as `_solved` in several processes. The share of a process that dies is solved in this one."""
    # Neighbours cost alike, so that equal shares take alternate runs
    shares = [np.arange(start, batch.n, processes) for start in range(processes)]
    result, ended = BatchResult.empty(batch.n), 0

    def report(ended_of_share: int, _: int) -> None:
        if progress is not None:
            progress(ended + ended_of_share, batch.n)

    # One fewer, as this process works, too
    with process_pool(processes - 1) as pool:
        others = [pool.submit(_solved, batch.part(share)) for share in shares[1:]]
        for share, other in zip(shares, [None, *others], strict=True):
            try:
                part = _solved(batch.part(share), report) if other is None else other.result()
            except BrokenProcessPool:
                part = _solved(batch.part(share), report)
            result.put(share, part)
            ended += len(share)
            report(0, batch.n)
    return result
