"""Items done by several processes: all are done, by any number of them, whatever becomes of a helper."""

from __future__ import annotations

import os
import signal
import threading
import time

import pytest

from looping_pendulum.discrepancy.workers import Workers

HERE = os.getpid()


def square(power, item):
    return item**power


def place(pause, item):
    """Process that does an item."""
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


def until_a_helper_is_ready(workers):
    """Wait until a helper takes an item, for a minute at most."""
    for _ in range(300):
        if set(workers.map(place, 0.1, range(2))) - {HERE}:
            return
    raise TimeoutError("no helper took an item")


@pytest.fixture(scope="module")
def pair():
    with Workers(2) as workers:
        until_a_helper_is_ready(workers)
        yield workers


def test_without_helpers_all_is_done_here_in_order():
    told = []
    assert Workers().map(square, 2, range(4), about=list("abcd"), told=told.append) == [0, 1, 4, 9]
    assert told == list("abcd")


def test_a_helper_does_its_share(pair):
    done = pair.map(place, 0.05, range(6))
    assert len(set(done)) == 2
    assert HERE in done
    assert pair.map(square, 3, range(20)) == [i**3 for i in range(20)]


def test_a_worker_gets_again_what_it_was_about(pair):
    names = [f"thing {i}" for i in range(6)]
    first = pair.map(place, 0.1, range(6), about=names)
    again = pair.map(place, 0.1, range(6), about=names)
    assert sum(a == b for a, b in zip(first, again, strict=True)) >= 4  # the last may go to whoever has nothing left


def test_the_first_item_that_fails_is_told_of(pair):
    with pytest.raises(ValueError, match="item 3"):
        pair.map(refuse, None, [1, 2, 3, 4, 5])
    assert pair.map(refuse, None, [0, 1]) == [0, 1]


def test_what_cannot_be_sent_is_done_here():
    with Workers(2) as workers:
        until_a_helper_is_ready(workers)
        assert workers.map(square, 2, [1, 2, 3]) == [1, 4, 9]
        kept = threading.Lock()  # no lock can be pickled
        assert set(workers.map(lambda shared, item: os.getpid(), kept, range(4))) == {HERE}


def test_a_helper_that_dies_leaves_its_item_to_others():
    with Workers(2) as workers:
        until_a_helper_is_ready(workers)
        assert workers.map(die_elsewhere, HERE, range(8)) == list(range(8))
        assert set(workers.map(place, 0.0, range(4))) == {HERE}


def test_helpers_end_with_their_owner():
    with Workers(2) as workers:
        until_a_helper_is_ready(workers)
        (helper,) = set(workers.map(place, 0.1, range(4))) - {HERE}
    with pytest.raises(ProcessLookupError):
        os.kill(helper, 0)


def test_interrupted_in_the_middle_the_next_work_is_whole(pair):
    def interrupt(what):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        pair.map(place, 0.1, range(4), about=["a", "b", "c", "d"], told=interrupt)
    assert pair.map(square, 2, range(5)) == [0, 1, 4, 9, 16]
