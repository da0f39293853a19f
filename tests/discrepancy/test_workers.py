"""A pool of worker processes does all items, for any number of processes, whatever becomes of a worker process."""

import os
import signal
import sys
import threading
import time

import numpy as np
import pytest
from threadpoolctl import threadpool_info

from looping_pendulum.discrepancy.workers import Workers, one_blas_thread

HERE = os.getpid()


def square(power, item):
    return item**power


def place(pause, item):
    """Return the number of the process that does an item."""
    time.sleep(pause)
    return os.getpid()


def refuse(shared, item):
    if item > 2:
        raise ValueError(f"item {item}")
    return item


def die_elsewhere(parent, item):
    if os.getpid() != parent:
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.05)
    return item


def wait_for_a_worker_process(workers):
    """Wait until a worker process takes an item, for a minute at most."""
    for _ in range(300):
        if set(workers.map(place, 0.1, range(2))) - {HERE}:
            return
    raise TimeoutError("no worker process took an item")


@pytest.fixture(scope="module")
def two_workers():
    with Workers(2) as workers:
        wait_for_a_worker_process(workers)
        yield workers


def test_without_worker_processes_all_items_are_done_in_order():
    done = []

    def note(shared, item):
        done.append(item)
        return item**shared

    assert Workers().map(note, 2, range(4)) == [0, 1, 4, 9]
    assert done == [0, 1, 2, 3]


@pytest.mark.long
def test_a_worker_process_does_its_share(two_workers):
    done = two_workers.map(place, 0.05, range(6))
    assert len(set(done)) == 2
    assert HERE in done
    assert two_workers.map(square, 3, range(20)) == [i**3 for i in range(20)]


def test_the_exception_of_the_first_item_that_fails_is_raised(two_workers):
    with pytest.raises(ValueError, match="item 3"):
        two_workers.map(refuse, None, [1, 2, 3, 4, 5])
    assert two_workers.map(refuse, None, [0, 1]) == [0, 1]


@pytest.mark.long
def test_what_cannot_be_pickled_is_done_in_this_process():
    with Workers(2) as workers:
        wait_for_a_worker_process(workers)
        assert workers.map(square, 2, [1, 2, 3]) == [1, 4, 9]
        kept = threading.Lock()  # no lock can be pickled
        assert set(workers.map(lambda shared, item: os.getpid(), kept, range(4))) == {HERE}


@pytest.mark.long
def test_the_item_of_a_process_that_dies_is_done_by_another():
    with Workers(2) as workers:
        wait_for_a_worker_process(workers)
        assert workers.map(die_elsewhere, HERE, range(8)) == list(range(8))
        assert set(workers.map(place, 0.0, range(4))) == {HERE}


def count_blas_threads(shared, item):
    time.sleep(0.05)
    return max(library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas")


def test_linear_algebra_takes_one_thread_so_that_two_processes_do_not_wait_for_each_other(two_workers):
    with one_blas_thread():
        assert set(two_workers.map(count_blas_threads, None, range(4))) == {1}


def is_imported(shared, module):
    time.sleep(0.05)
    return os.getpid(), module in sys.modules


@pytest.mark.long
def test_an_idle_worker_imports_what_is_needed_later():
    with Workers(2) as workers:
        workers.import_when_idle(["this"])
        for _ in range(300):
            found = dict(workers.map(is_imported, None, ["this"] * 4))
            if any(found.values()):
                break
    assert found.pop(HERE) is False
    assert list(found.values()) == [True]


@pytest.mark.long
def test_worker_processes_end_with_their_pool():
    with Workers(2) as workers:
        wait_for_a_worker_process(workers)
        (worker_process,) = set(workers.map(place, 0.1, range(4))) - {HERE}
    with pytest.raises(ProcessLookupError):
        os.kill(worker_process, 0)


@pytest.mark.long
@pytest.mark.parametrize(
    "shared",
    [pytest.param(1, id="small", marks=pytest.mark.accurate), pytest.param(np.ones(10**6), id="larger than a pipe holds")],
)
def test_a_pool_ends_while_its_worker_process_is_busy(shared):
    """The executor waited for ever for the rest of an answer whose process was killed while it sent it."""
    for pause in (0.0, 0.003, 0.01):
        with Workers(2) as workers:
            wait_for_a_worker_process(workers)
            workers.begin(square, 2, [shared] * 50)
            time.sleep(pause)


def interrupt_here(parent, item):
    if os.getpid() == parent:
        raise KeyboardInterrupt
    time.sleep(0.1)
    return item


def test_after_an_interrupt_the_next_call_is_complete(two_workers):
    with pytest.raises(KeyboardInterrupt):
        two_workers.map(interrupt_here, HERE, range(4))
    assert two_workers.map(square, 2, range(5)) == [0, 1, 4, 9, 16]
