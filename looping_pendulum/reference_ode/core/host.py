"""Carries out runs of traced models in wasmtime, a store for each thread.

The layouts here are those of ``Job``, ``Status``, ``EventRow`` and ``DenseRow`` in `driver.c`. Nothing is kept on disk: a model
is traced and compiled within a tenth of a second, so that there is no cache to be damaged, outdated or too large.
"""

from __future__ import annotations

import atexit
import ctypes
import math
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.resources import files
from itertools import accumulate
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.errors import IntegrationError, MissingPackageError, ParameterError
from looping_pendulum.reference_ode.core import wasm
from looping_pendulum.reference_ode.core.trace import trace
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.reference_ode.state import Effects, Signs, State

NY, NS = len(State._fields), len(Signs._fields)
EVENT_COLUMNS = 3 + NY + NS
"""Numbers of a row of events: code, mode after, time, state after, signs after."""
DENSE_COLUMNS = 3 + 8 * NY
"""Numbers of a row of the dense output: time, length, mode, and the polynomials of all entries of the state."""
MAX_COLUMNS = 128
"""Largest number of derivatives that the driver takes at once."""
STEPS_PER_CALL = 4000
"""Number of steps after which a call returns, so that Ctrl-C is heard within 0.1 s even with `MAX_COLUMNS` derivatives."""
LEAST_TOLERANCE = 1e-13
"""Smallest relative tolerance of a step: below it errors are rounding."""
MAX_MODELS = 100
"""Number of models after which a thread's store is made anew, as a store gives nothing back [10^5 B each]."""
MAX_KEPT_BYTES = 2**28
"""Memory for the results of one call above which the same is done."""
FIRST_EVENTS, FIRST_DENSE = 40, 400
"""Room for events and steps at first, per run; if all runs together need more, they are made once more."""
JOB_FIELDS = (
    "model", "runs", "p", "durations", "times", "starts", "samples", "partials", "status", "events", "event_partials",
    "end_partials", "max_events", "n", "seed_starts", "seed_columns", "seed_weights", "max_steps", "dense", "max_dense",
)  # fmt: skip
"""Fields of ``Job`` in `driver.c` after its relative tolerance: counts, and addresses of what is read and written."""
FAILURES = {
    1: "more than 200000 steps in one mode",
    2: "the integration broke down",
    3: "more than 4000 events within a second",
}
"""What went wrong, by the number in ``Status`` of `driver.c`, whose limits these are."""


_making = threading.RLock()
"""Held while what all threads share is made: modules of two engines do not go together, and nothing is worth making twice."""


# Compared and hashed by identity
@dataclass(frozen=True, kw_only=True, eq=False)
class Model:
    """A traced model as WebAssembly; its graphs, a hundred times as large, are not kept."""

    names: tuple[str, ...]
    """Names of the parameters that it reads, in their order."""
    code: bytes
    """Module of its functions."""
    count: int
    """Number of its functions."""
    table: NDArray[np.int32]
    """`trace.TracedModel.table`."""


def traced(release: Release, effects: Effects, derivatives: bool) -> Model:
    """Return the model of a release with exactly these effects."""
    with _making:
        return _traced(release, effects, derivatives)


@lru_cache(maxsize=256)
def _traced(release: Release, effects: Effects, derivatives: bool) -> Model:
    found = trace(release, effects, derivatives=derivatives)
    return Model(names=found.names, code=wasm.module(found.functions), count=len(found.functions), table=found.table)


@dataclass(frozen=True, kw_only=True)
class Runs:
    """What `Core.carry_out` returns of r runs at m times."""

    samples: Array
    """States, shape (m, 13); past a run's end those of its end."""
    counts: NDArray[np.int32]
    """How many of each run's times lie within it, shape (r,)."""
    failures: NDArray[np.int32]
    """0, or what went wrong (`FAILURES`), shape (r,)."""
    event_counts: NDArray[np.int32]
    """Number of events of each run, release and end included, shape (r,)."""
    events: Array
    """Events of all runs, one run after another, shape (events, `EVENT_COLUMNS`)."""
    dense: Array
    """Steps of all runs, if they were wanted, shape (steps, `DENSE_COLUMNS`)."""
    partials: Array
    """Derivatives of the samples, shape (m, 13, n)."""
    event_partials: Array
    """Derivatives of the times of the events, shape (events, n)."""
    end_partials: Array
    """Derivatives of the states at the runs' ends, whose times move, shape (r, 13, n)."""


def this_threads_core() -> Core:
    """Return the driver of this thread."""
    core: Core | None = getattr(_of_thread, "core", None)
    if core is None or core.model_count >= MAX_MODELS:
        with _making:
            core = _of_thread.core = Core()
    return core


_of_thread = threading.local()


@atexit.register
def _let_go() -> None:
    """Let go of all that is wasmtime's while its functions are still there; else each object would complain at the end."""
    vars(_of_thread).clear()
    for kept in (_compiled, _engine):
        kept.cache_clear()


def _wasmtime() -> ModuleType:
    """Import wasmtime, on use: it takes a tenth of a second."""
    try:
        import wasmtime
    except (ImportError, OSError, RuntimeError) as error:
        # pip takes a wheel for any system where there is none for this one, and its import fails
        message = (
            f"wasmtime does not run on this system ({error}); it has wheels for Linux, macOS and Windows with a 64-bit Python"
        )
        raise MissingPackageError(f"{message}: see docs/install.md") from error
    return wasmtime


@cache
def _engine(reserves: bool) -> Any:
    """Return the engine whose memories each reserve 4 GB of addresses, or one whose memories reserve nothing."""
    wasmtime = _wasmtime()
    config = wasmtime.Config()
    # Compiled models are kept in the user's folder of caches, which wasmtime tidies: a seventh of the time of an `identify`.
    # Where that folder cannot be written, all goes as before
    with suppress(wasmtime.WasmtimeError):
        config.cache = True
    if not reserves:
        from wasmtime import _bindings as ffi  # `wasmtime.Config` has these settings in its newest releases only

        for setting in ("reservation", "guard_size", "reservation_for_growth"):
            getattr(ffi, f"wasmtime_config_memory_{setting}_set")(config.ptr(), 0)
    return wasmtime.Engine(config)


@lru_cache(maxsize=256)
def _compiled(reserves: bool, code: bytes) -> Any:
    return _wasmtime().Module(_engine(reserves), code)


@contextmanager
def _failures_in_one_sentence() -> Iterator[None]:
    wasmtime = _wasmtime()
    try:
        yield
    except wasmtime.WasmtimeError as error:
        why = " ".join(str(error).split())
        message = f"wasmtime, which carries out runs, failed ({why})"
        raise IntegrationError(f"{message}; where memory is limited, allow more, or use fewer threads") from None


class Core:
    """An instance of the driver, and the models that were loaded into it. It is for one thread.

    Raises
    ------
    MissingPackageError
        If wasmtime does not start on this system.
    IntegrationError
        If there is not enough memory.
    """

    def __init__(self) -> None:
        wasmtime = _wasmtime()
        # With 4 GB of addresses reserved, no access needs a check of its bounds: runs are faster by a fifth, derivatives by two
        # fifths. Where a limit (`ulimit -v`, a cluster's) does not allow that, the same bits come with checks
        self._reserves = True
        try:
            exports = self._instantiated_driver()
        except wasmtime.WasmtimeError:
            self._reserves = False
            with _failures_in_one_sentence():
                exports = self._instantiated_driver()
        self._memory, self._table = exports["memory"], exports["__indirect_function_table"]
        self._maths = [exports[f"w_{name}"] for name in wasm.IMPORTED]
        exports["_initialize"](self._store)
        self._room, self._release_room, self._begin, self._advance = (
            _fast_call(self._store, exports[name]) for name in ("room", "release_room", "begin", "advance")
        )
        self._models: dict[Model, int] = {}

    def _instantiated_driver(self) -> Any:
        """Make the store, and return what the driver exports."""
        wasmtime = _wasmtime()
        self._store = wasmtime.Store(_engine(self._reserves))
        driver = _compiled(self._reserves, files(__package__).joinpath("driver.wasm").read_bytes())
        return wasmtime.Instance(self._store, driver, []).exports(self._store)

    @property
    def model_count(self) -> int:
        """Number of models that were loaded."""
        return len(self._models)

    def carry_out(
        self,
        model: Model,
        p: Array,
        durations: Array,
        times: Array,
        starts: NDArray[np.int32],
        *,
        tolerance: float,
        max_steps: int = 0,
        seeds: Array | None = None,
        dense: bool = False,
    ) -> Runs:
        """Carry out r runs.

        Parameters
        ----------
        model
            From `traced`; with derivatives, if there are ``seeds``.
        p
            Values of `Model.names`, shape (r, names).
        durations
            Limits on the simulated time [s], shape (r,).
        times, starts
            Sample times of all runs [s], ascending in each, shape (m,), and where each run's begin, shape (r + 1,).
        tolerance
            Relative tolerance of a step, `LEAST_TOLERANCE` at least; 0.1 of it is the absolute one.
        max_steps
            Number of steps in one mode after which a run fails; 0: the driver's own limit.
        seeds
            Derivatives of the parameters by the n numbers by which derivatives are wanted, shape (names, n); n is at most
            `MAX_COLUMNS`.
        dense
            Whether all steps are wanted.

        Raises
        ------
        ParameterError
            If a limit is no number, or below 0.
        IntegrationError
            If there is not enough memory.
        """
        if not np.all(durations >= 0):
            raise ParameterError(f"duration: found {float(np.min(durations)):g} s, needed 0 or more")
        if not tolerance > 0:
            raise ParameterError(f"tolerance: found {tolerance:g}, needed a number above 0, such as 1e-9")
        rtol, columns = max(tolerance, LEAST_TOLERANCE), 0 if seeds is None else seeds.shape[1]
        inputs: dict[str, NDArray[Any]] = {"p": p, "durations": durations, "times": times, "starts": starts}
        if seeds is not None:
            inputs |= _seed_arrays(seeds)
        events, steps = FIRST_EVENTS * len(p), FIRST_DENSE * len(p) if dense else 0
        while True:
            runs, needed = self._carried_out(model, inputs, columns, rtol, max_steps, events, steps)
            if needed[0] <= events and (needed[1] <= steps or not dense):
                return runs
            events, steps = max(needed[0], events), max(needed[1], steps) if dense else 0

    def _carried_out(
        self, model: Model, inputs: Mapping[str, NDArray[Any]], columns: int, rtol: float, max_steps: int,
        most_events: int, most_dense: int,
    ) -> tuple[Runs, tuple[int, int]]:  # fmt: skip
        """Return the runs, and how many events and steps they have, for which there may have been no room."""
        loaded = self._loaded(model)  # before any room of this call, which is given back
        r, m, n = len(inputs["p"]), len(inputs["times"]), (columns + 3) & ~3
        outputs = {
            "samples": (m, NY), "partials": (m, NY, n), "events": (most_events, EVENT_COLUMNS),
            "event_partials": (most_events, n), "end_partials": (r, NY, n), "dense": (most_dense, DENSE_COLUMNS),
            "status": (r, 2),
        }  # fmt: skip
        sizes = {name: array.nbytes for name, array in inputs.items()}
        sizes |= {name: 8 * math.prod(shape) for name, shape in outputs.items()} | {"job": 8 + 4 * len(JOB_FIELDS) + 4}
        rooms = [(size + 15) & ~15 for size in sizes.values()]
        needed = sum(rooms)
        block = self._room(needed) & 0xFFFFFFFF if needed < 2**32 else 0  # a larger number would wrap around
        if not block:
            raise IntegrationError(
                "runs: found no memory for their results; ask for fewer samples, derivatives or runs at once"
            )
        try:
            at = dict(zip(sizes, accumulate(rooms, initial=block), strict=False))
            memory = self._view()
            for name, array in inputs.items():
                memory[at[name] : at[name] + array.nbytes] = np.ascontiguousarray(array).view(np.uint8).ravel()
            given = at | {"model": loaded, "runs": r, "n": n, "max_steps": max_steps, "max_events": most_events}
            given |= {"max_dense": most_dense} if most_dense else {"dense": 0}
            job = memory[at["job"] :]
            job[:8].view(np.float64)[0] = rtol
            job[8 : 8 + 4 * len(JOB_FIELDS)].view(np.uint32)[:] = [given.get(name, 0) for name in JOB_FIELDS]
            self._begin(at["job"])
            while not self._advance(STEPS_PER_CALL):
                pass
            memory = self._view()

            def result(name: str) -> Array:
                return memory[at[name] : at[name] + sizes[name]].view(np.float64).reshape(outputs[name])

            status = memory[at["status"] : at["status"] + sizes["status"]].view(np.int32).reshape(r, 4)
            failures, event_counts, counts, step_counts = status.T.copy()
            events, steps = int(event_counts.sum()), int(step_counts.sum())
            found = Runs(
                samples=result("samples").copy(),
                counts=counts,
                failures=failures,
                event_counts=event_counts,
                events=result("events")[:events].copy(),
                dense=result("dense")[:steps].copy(),
                partials=result("partials")[:, :, :columns].copy(),
                event_partials=result("event_partials")[:events, :columns].copy(),
                end_partials=result("end_partials")[:, :, :columns].copy(),
            )
            return found, (events, steps)
        finally:
            self._release_room(block)
            if needed > MAX_KEPT_BYTES:
                _of_thread.core = None

    def _loaded(self, model: Model) -> int:
        """Return the address of the driver's ``Model``; load the model on its first use."""
        if model not in self._models:
            wasmtime = _wasmtime()
            with _failures_in_one_sentence():
                first = self._table.grow(self._store, model.count, None)
                kind = wasmtime.GlobalType(wasmtime.ValType.i32(), False)
                place = wasmtime.Global(self._store, kind, wasmtime.Val.i32(first))
                with _making:
                    module = _compiled(self._reserves, model.code)
                wasmtime.Instance(self._store, module, [*self._maths, self._memory, self._table, place])
            jacobian, table = 16, 16 + 8 * int(model.table[4])
            address = self._room(table + model.table.nbytes) & 0xFFFFFFFF
            if not address:
                raise IntegrationError("model: found no memory for it")
            memory = self._view()[address:]
            memory[:12].view(np.int32)[:] = [first, address + table, address + jacobian]
            memory[table : table + model.table.nbytes] = model.table.view(np.uint8)
            self._models[model] = address
        return self._models[model]

    def _view(self) -> NDArray[np.uint8]:
        """Return the memory, which may lie elsewhere after any growth."""
        size = self._memory.data_len(self._store)
        base = ctypes.addressof(self._memory.data_ptr(self._store).contents)
        return np.ctypeslib.as_array((ctypes.c_uint8 * size).from_address(base))


def _seed_arrays(seeds: Array) -> dict[str, NDArray[Any]]:
    """Return the entries of ``seeds`` that are not 0, in the order of the parameters."""
    rows, columns = np.nonzero(seeds)
    starts = np.searchsorted(rows, np.arange(len(seeds) + 1))
    arrays = {"seed_starts": starts.astype(np.int32), "seed_columns": columns.astype(np.int32)}
    return arrays | {"seed_weights": np.ascontiguousarray(seeds[rows, columns])}


def _fast_call(store: Any, function: Any) -> Callable[[int], int]:
    """Return a function of one i32 without wasmtime's conversions of each call, which take as long as a tenth of a run.

    It uses a private function of wasmtime, so that without it, in another version, the public way is taken.
    """
    try:
        from wasmtime import _bindings as ffi

        context, raw, trap = store._context(), (ffi.wasmtime_val_raw_t * 1)(), ctypes.POINTER(ffi.wasm_trap_t)()
        handle, call = ctypes.byref(function._func), ffi._wasmtime_func_call_unchecked
    except (ImportError, AttributeError):
        return lambda x: function(store, x) or 0

    def fast(x: int) -> int:
        raw[0].i64 = x
        if call(context, handle, raw, 1, ctypes.byref(trap)) or trap:
            raise IntegrationError("the driver trapped, which is a fault of this package; please report it")
        return int(raw[0].i32)

    return fast
