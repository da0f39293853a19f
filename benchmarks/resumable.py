"""Run many independent tasks and keep each result in a file of its own, so that a run can be ended and continued."""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Protocol

from looping_pendulum.cli.terminal import ProgressBars
from looping_pendulum.files import write_atomically
from looping_pendulum.sweep.executors import in_process, in_processes, on_cluster

Outcome = dict[str, Any]


class Task(Protocol):
    """A frozen dataclass that says all that its outcome depends on."""

    @property
    def name(self) -> str:
        """Name of its file, without ending."""


def run(
    tasks: Sequence[Task],
    solve: Callable[[Any], tuple[str, Outcome]],
    folder: Path,
    *,
    jobs: int = 1,
    cluster: str | None = None,
    title: str = "",
) -> tuple[dict[str, Outcome], bool]:
    """Solve tasks; those that ``folder`` has are not solved again.

    Parameters
    ----------
    solve
        Function of a module that returns a task's name and outcome (plain data).
    jobs
        Number of processes.
    cluster
        Address of a Dask scheduler; None: this machine. Its workers must be able to import this package and ``tests``.

    Returns
    -------
    Name -> outcome of all tasks that are finished, in the order of the tasks, and whether Ctrl-C ended the run.
    """
    known = {task.name: outcome for task in tasks if (outcome := _stored(folder, task)) is not None}
    by_name = {task.name: task for task in tasks}
    interrupted = False
    with ProgressBars(time_left=True, line_every_fraction=0.1) as bars:
        bars.update(title, len(known) / max(len(tasks), 1))
        try:
            for name, outcome in _results(iter([t for t in tasks if t.name not in known]), solve, jobs, cluster):
                known[name] = outcome
                record = {"task": _plain(by_name[name]), "outcome": outcome}
                write_atomically(folder / f"{name}.json", json.dumps(record, indent=1) + "\n")
                bars.update(f"{title}: {name}", len(known) / len(tasks))
        except KeyboardInterrupt:
            interrupted = True
            print(f"interrupted; {len(known)} of {len(tasks)} are kept in {folder}", file=sys.stderr)
    return {task.name: known[task.name] for task in tasks if task.name in known}, interrupted


def _results(tasks: Iterator[Any], solve: Any, jobs: int, cluster: str | None) -> Iterator[Any]:
    if cluster is not None:
        return on_cluster(tasks, solve, cluster)
    return in_process(tasks, solve) if jobs == 1 else in_processes(tasks, solve, jobs)


def _stored(folder: Path, task: Any) -> Outcome | None:
    """Return the stored outcome of a task; None: there is none, or it is that of another task of this name."""
    file = folder / f"{task.name}.json"
    if not file.exists():
        return None
    record = json.loads(file.read_text(encoding="utf-8"))
    return record["outcome"] if record["task"] == _plain(task) else None


def _plain(task: Any) -> Any:
    """Return a task as JSON has it, where a tuple is a list."""
    return json.loads(json.dumps(dataclasses.asdict(task)))
