"""Runs whose every bit is the same wherever WebAssembly runs: `python -m tests.reference_ode.core.bits` writes `digests.json`.

The file holds the parameters of 20 runs of all kinds, as numbers that every machine reads alike, and the SHA-256 sums of their
results with derivatives. wasmtime here (`test_bits`), node and a browser (`tests/live`) must give the same.
"""

import base64
import hashlib
import json
from pathlib import Path

import numpy as np

from looping_pendulum.reference_ode.core.host import this_threads_core, traced
from looping_pendulum.reference_ode.parameters import Parameters, parameters_from

FILE = Path(__file__).with_name("digests.json")
COLUMNS = 12
"""Number of derivatives, a multiple of 4, which the driver takes as they are."""
DURATION, RTOL = 2.0, 1e-9
TIMES = np.arange(200) * 0.0078125  # sums of powers of 2, which need no rounding


def job(parameters):
    """Return all that a host of the driver needs for a run, as plain data."""
    model, values = traced(parameters.release, parameters.effects, True), vars(parameters.values())
    starts = np.minimum(np.arange(len(model.names) + 1), COLUMNS)  # the first parameters, one each
    return {
        "functions": base64.b64encode(model.code).decode(),
        "count": model.count,
        "table": model.table.tolist(),
        "p": [values[name] for name in model.names],
        "duration": DURATION,
        "rtol": RTOL,
        "times": TIMES.tolist(),
        "n": COLUMNS,
        "seed_starts": starts.tolist(),
        "seed_columns": list(range(COLUMNS)),
        "seed_weights": [1.0] * COLUMNS,
    }


def carried_out(parameters):
    """Return the run, as wasmtime carries it out."""
    model, given = traced(parameters.release, parameters.effects, True), job(parameters)
    return this_threads_core().carry_out(
        model,
        np.array([given["p"]]),
        np.array([DURATION]),
        TIMES,
        np.array([0, len(TIMES)], dtype=np.int32),
        tolerance=RTOL,
        seeds=np.eye(len(model.names), COLUMNS),
    )


def digest(runs):
    """Return the SHA-256 sum of samples, events, and derivatives of samples, event times and end, in that order."""
    parts = (runs.samples, runs.events, runs.partials, runs.event_partials, runs.end_partials)
    return hashlib.sha256(b"".join(np.ascontiguousarray(part, dtype="<f8").tobytes() for part in parts)).hexdigest()


def cases():
    """Return (parameters, digest) of each stored run."""
    stored = json.loads(FILE.read_text(encoding="utf-8"))
    return [(parameters_from(case["parameters"]), case["digest"]) for case in stored]


def main():
    """Write the file: the paper's two trials, and random apparatus of every kind without derivatives that do not exist."""
    from tests.apparatus import TEN_TO_ONE, TWO_TO_ONE
    from tests.oracles.random_apparatus import of_any_kind

    kept = []
    for drawn in (TEN_TO_ONE, TWO_TO_ONE, *map(of_any_kind, range(60))):
        # Three digits: the logarithms and powers of the draw round as this machine's do
        short = json.loads(json.dumps(drawn.as_dict()), parse_float=lambda x: float(f"{float(x):.3g}"))
        parameters: Parameters = parameters_from(short)
        runs = carried_out(parameters)
        if len(kept) < 20 and not runs.failures[0] and np.isfinite(runs.event_partials).all():
            kept.append({"parameters": short, "digest": digest(runs)})
    FILE.write_text("[\n" + ",\n".join(map(json.dumps, kept)) + "\n]\n", encoding="utf-8")


if __name__ == "__main__":
    main()
