"""One map over episodes for every stage, behind `concurrent.futures.Executor`."""

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from itertools import islice

# Episodes that are begun before they are wanted: a worker, and on a cluster, whose size is not known here.
_AHEAD, _AHEAD_ELSEWHERE = 4, 256


def _prepare_worker() -> None:
    # Ctrl-C reaches the whole process group; the parent alone answers it, and cancels what has not started.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Workers share the cores; a numeric library that starts a thread a core in each of them slows all of them down.
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"


def map_episodes[T, R](
    function: Callable[[T], R], items: Iterable[T], *, jobs: int = 1, executor: Executor | None = None
) -> Iterator[R]:
    """Yield `function(item)` for every item, in the order of the items, as each is done.

    Args:
        function: A picklable function of one item.
        items: One item an episode.
        jobs: Worker processes; 1 runs in this process, with a plain traceback.
        executor: Any `concurrent.futures.Executor`, such as a Dask client's, used in place of local processes.

    Raises:
        Whatever `function` raises. What has not started is cancelled then, and local processes are ended.
    """
    if executor is None and jobs <= 1:
        yield from map(function, items)
    elif executor is None:
        with worker_pool(jobs) as pool:
            yield from _in_order(function, items, pool, _AHEAD * jobs)
    else:
        yield from _in_order(function, items, executor, _AHEAD_ELSEWHERE)


@contextmanager
def worker_pool(jobs: int) -> Iterator[Executor]:
    """Local worker processes, for several maps that need the same heavy imports; an error or Ctrl-C ends them."""
    # Spawned, not forked: numeric libraries' threads do not survive a fork.
    context = multiprocessing.get_context("spawn")
    others = set(multiprocessing.active_children())
    with ProcessPoolExecutor(jobs, mp_context=context, initializer=_prepare_worker) as pool:
        try:
            yield pool
        except BaseException:
            # An error, Ctrl-C, or nobody wants more: what is running would be thrown away, and may take minutes.
            for worker in set(multiprocessing.active_children()) - others:
                worker.terminate()
            raise


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Let Ctrl-C wait: what starts workers is not torn in half by it, and they never see it.

    Workers inherit that it is blocked, so they ignore it even before they can say so. For this process blocking it is
    not enough: another thread may take it, and Python then raises it here all the same.
    """
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "pthread_sigmask"):
        yield  # Only the main thread is ever interrupted; Windows has no signal masks.
        return
    came: list[int] = []
    handler = signal.signal(signal.SIGINT, lambda number, _: came.append(number)) or signal.SIG_DFL
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        signal.signal(signal.SIGINT, handler)
    if came:
        signal.raise_signal(signal.SIGINT)


def _in_order[T, R](function: Callable[[T], R], items: Iterable[T], executor: Executor, ahead: int) -> Iterator[R]:
    """Results in the order of the items, of which only so many are begun before they are wanted.

    Workers that are faster than whoever takes the results would otherwise fill the memory with them.
    """
    waiting: deque[Future[R]] = deque()
    left = iter(items)
    try:
        while True:
            with _interrupts_held():
                waiting.extend(executor.submit(function, item) for item in islice(left, ahead - len(waiting)))
            if not waiting:
                return
            yield waiting.popleft().result()
    finally:
        for future in waiting:
            future.cancel()
