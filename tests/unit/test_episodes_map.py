import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest

from wrenchflow.episodes_map import map_episodes


def slower_at_first(item: int) -> int:
    time.sleep(0.01 * max(0, 4 - item))
    return item * item


def test_the_order_is_that_of_the_items_whoever_does_the_work():
    expected = [item * item for item in range(8)]
    with ThreadPoolExecutor(4) as executor:
        assert list(map_episodes(slower_at_first, range(8), executor=executor)) == expected
    assert list(map_episodes(slower_at_first, range(8), jobs=1)) == expected


def test_worker_processes_give_what_this_process_gives():
    assert list(map_episodes(abs, [-3, 2, -1], jobs=2)) == [3, 2, 1]


def test_one_job_works_in_this_thread_and_not_ahead():
    seen: list[tuple[int, int]] = []
    results = map_episodes(lambda item: seen.append((item, threading.get_ident())), range(3))
    assert seen == []
    next(results)
    assert seen == [(0, threading.get_ident())]


def test_no_items_give_nothing():
    assert list(map_episodes(abs, [])) == []
    with ThreadPoolExecutor(1) as executor:
        assert list(map_episodes(abs, [], executor=executor)) == []


def test_an_error_comes_through_and_cancels_what_has_not_started():
    started: list[int] = []
    release = threading.Event()

    def fail_at_one(item: int) -> int:
        started.append(item)
        if item == 1:
            raise ValueError(f"item {item}")
        if item > 1:
            release.wait(10.0)
        return item

    with ThreadPoolExecutor(1) as executor:
        results = map_episodes(fail_at_one, range(50), executor=executor)
        assert next(results) == 0
        with pytest.raises(ValueError, match="item 1"):
            next(results)
        release.set()
    assert len(started) < 5


def test_whoever_stops_listening_cancels_the_rest():
    started: list[int] = []
    release = threading.Event()

    def wait(item: int) -> int:
        started.append(item)
        if item:
            release.wait(10.0)
        return item

    with ThreadPoolExecutor(1) as executor:
        results = map_episodes(wait, range(50), executor=executor)
        assert isinstance(results, Iterator)
        next(results)
        results.close()  # pyright: ignore[reportAttributeAccessIssue]
        release.set()
    assert len(started) < 5


def test_an_error_or_a_listener_who_leaves_ends_worker_processes_that_are_busy():
    # Sleeping for less than no time is an error; nobody waits for those that sleep an hour.
    with pytest.raises(ValueError, match="non-negative"):
        list(map_episodes(time.sleep, [-1.0, 3600.0, 3600.0], jobs=2))
    assert multiprocessing.active_children() == []
    results = map_episodes(time.sleep, [0.0, 3600.0, 3600.0], jobs=2)
    assert next(results) is None
    results.close()  # pyright: ignore[reportAttributeAccessIssue]
    assert multiprocessing.active_children() == []


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="no signal masks")
def test_ctrl_c_waits_until_the_work_is_handed_out_whichever_thread_it_reaches():
    handed_out: list[int] = []

    class Slow(ThreadPoolExecutor):
        def submit(self, function, /, *arguments):
            if not handed_out:
                os.kill(os.getpid(), signal.SIGINT)  # Any thread of this process may take it; one is resting.
                time.sleep(0.05)
            handed_out.append(1)
            return super().submit(function, *arguments)

    rest = threading.Event()
    threading.Thread(target=rest.wait, daemon=True).start()
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with Slow(1) as executor, pytest.raises(KeyboardInterrupt):
            list(map_episodes(abs, range(5), executor=executor))
    finally:
        signal.signal(signal.SIGINT, before)
        rest.set()
    assert len(handed_out) == 5
