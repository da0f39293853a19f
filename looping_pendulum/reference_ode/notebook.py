"""An exact run in a notebook: what happened when."""

from __future__ import annotations

from looping_pendulum.pages.notebook import shown, table
from looping_pendulum.reference_ode.solution import Run
from looping_pendulum.reference_ode.transitions import PHASE_EVENTS


def html(run: Run) -> str:
    """HTML of a run."""
    halt = "never halts" if run.halt is None else f"halts at {run.halt.time:.6f} s"
    note = f"The heavy mass {halt}; the run ends at {run.end_time:.6f} s. {run.integrator}, tolerance {run.tolerance:g}."
    rows = [
        [
            f"{e.time:.6f}",
            "release" if e.event is None else str(e.event).replace("_", " "),
            e.mode_after.name.lower().replace("_", " "),
            f"{float(run.heavy_drop(e.state)):.4f}",
            f"{float(e.state.wrap_angle):.4f}",
            f"{float(e.state.free_length):.4f}",
        ]
        for e in run.events
        if e.event not in PHASE_EVENTS
    ]
    head = ["time [s]", "event", "mode after it", "M2 has fallen by [m]", "wrap angle [rad]", "free length [m]"]
    return shown("Exact reference", note, table(head, rows))
