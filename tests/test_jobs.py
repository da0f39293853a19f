"""The loop of many jobs: as many at a time as asked for, each once, and in order after Ctrl-C."""

import os
import threading
from functools import partial

import pytest

from looping_pendulum.processes import core_count, run_many


class Jobs:
    """Calls that note how many go on at once, and that end early once they are cancelled.

    The first ``together`` of them end only when all of these have begun.
    """

    def __init__(self, seconds: float, together: int = 1) -> None:
        self.seconds, self.cancelled = seconds, threading.Event()
        self.first = threading.Barrier(together)
        self.going_on = self.most = 0
        self.begun: list[int] = []
        self._lock = threading.Lock()

    def call(self, number: int) -> str:
        with self._lock:
            self.begun.append(number)
            self.going_on += 1
            self.most = max(self.most, self.going_on)
        if number < self.first.parties:
            self.first.wait(60)
        stopped = self.cancelled.wait(self.seconds)
        with self._lock:
            self.going_on -= 1
        return f"{number} stopped" if stopped else str(number)


@pytest.mark.parametrize("jobs", [1, 3])
def test_each_call_is_made_once_and_no_more_at_a_time_than_asked_for(jobs):
    many, seen = Jobs(0.0, together=jobs), []
    results = run_many(map(partial(partial, many.call), range(7)), jobs, cancelled=many.cancelled, meanwhile=seen.append)
    assert results == {i: str(i) for i in range(7)}
    assert many.begun == sorted(many.begun)
    assert many.most == jobs
    assert all(early.items() <= results.items() for early in seen)


def test_without_calls_there_is_nothing_to_wait_for():
    assert run_many([], 2, cancelled=threading.Event()) == {}


def test_ctrl_c_begins_no_further_call_and_keeps_the_results_of_those_that_go_on():
    many, interrupts = Jobs(0.2), []

    def interrupt_once(results):
        if len(results) >= 2 and not interrupts:
            interrupts.append(len(results))
            raise KeyboardInterrupt

    results = run_many(map(partial(partial, many.call), range(50)), 2, cancelled=many.cancelled, meanwhile=interrupt_once)
    assert sorted(results) == sorted(many.begun)
    assert 2 <= len(results) < 50
    # Which of two calls ends first is not said
    ended = {i: word for i, word in results.items() if "stopped" not in word}
    assert len(ended) >= interrupts[0] >= 2
    assert ended == {i: str(i) for i in ended}


def test_what_a_call_raises_is_raised_and_the_others_are_made():
    made = []

    def fails():
        raise OSError("no space left")

    calls = [fails, *(partial(made.append, i) for i in range(4))]
    with pytest.raises(OSError, match="no space left"):
        run_many(calls, 2, cancelled=threading.Event())
    assert made == [0, 1, 2, 3]


def test_the_caller_is_called_while_jobs_go_on():
    called, enough = [], threading.Event()

    def meanwhile(results):
        called.append(results)
        if len(called) == 3:
            enough.set()

    assert run_many([partial(enough.wait, 60)], 1, cancelled=threading.Event(), meanwhile=meanwhile) == {0: True}


def test_cores_are_those_that_this_process_may_use(monkeypatch):
    if hasattr(os, "sched_getaffinity"):
        assert core_count() == len(os.sched_getaffinity(0))
        monkeypatch.delattr(os, "sched_getaffinity")
    monkeypatch.setattr(os, "cpu_count", lambda: 5)
    assert core_count() == 5
    monkeypatch.setattr(os, "cpu_count", lambda: None)
    assert core_count() == 1
