"""Work on many items side by side, each in a process of this machine."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context
from typing import TypeVar

from ftp_dent_ros.threads import VARIABLES

Item = TypeVar('Item')
Result = TypeVar('Result')


class LostWorkerError(Exception):
    """The process that worked on an item was killed."""


def side_by_side(
    work: Callable[[Item], Result], items: Iterable[Item], jobs: int
) -> Iterator[tuple[Item, Result | Exception]]:
    """Each item with its result, or with what went wrong, in the order in which they end.

    Parameters
    ----------
    work : callable
        Of a module, so that a fresh process can import it.
    items : iterable
    jobs : int
        How many processes.

    Yields
    ------
    (item, result or Exception)
        `LostWorkerError` where its process died twice, the second time with nothing beside it:
        it is told of that item, and the others are done.
    """
    lost: deque[Item] = deque()
    yield from _tried(work, deque(items), jobs, lost.append)
    while lost:
        # What ran as a process died is tried once more, each alone.
        failed: list[Item] = []
        yield from _tried(work, deque([lost.popleft()]), 1, failed.append)
        for item in failed:
            yield item, LostWorkerError('its process was killed')


def _tried(
    work: Callable[[Item], Result],
    waiting: deque[Item],
    jobs: int,
    lose: Callable[[Item], object],
) -> Iterator[tuple[Item, Result | Exception]]:
    """Results; an item that was under way as a process died is handed to `lose`."""
    while waiting:
        with _pool(min(jobs, len(waiting))) as pool:
            running: dict[Future[Result], Item] = {}
            is_broken = False
            while running or (waiting and not is_broken):
                while waiting and len(running) < jobs and not is_broken:
                    item = waiting.popleft()
                    running[_submitted(pool, work, item)] = item
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    item, failure = running.pop(future), future.exception()
                    if isinstance(failure, BrokenProcessPool):
                        is_broken = True
                        lose(item)
                    elif failure is None or isinstance(failure, Exception):
                        yield item, future.result() if failure is None else failure
                    else:
                        raise failure


def _submitted(
    pool: ProcessPoolExecutor, work: Callable[[Item], Result], item: Item
) -> Future[Result]:
    """The item's future, that of a broken pool ended already."""
    try:
        return pool.submit(work, item)
    except BrokenProcessPool as reason:
        future: Future[Result] = Future()
        future.set_exception(reason)
        return future


@contextmanager
def _pool(jobs: int) -> Iterator[ProcessPoolExecutor]:
    """Fresh interpreters, started with one thread each; what has not begun ends with the block."""
    # As many processes as cores, and no two ways to add up.
    before = {name: os.environ.get(name) for name in VARIABLES}
    os.environ.update(dict.fromkeys(VARIABLES, '1'))
    pool = ProcessPoolExecutor(jobs, get_context('spawn'), one_thread)
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)
        for name, value in before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value


def one_thread() -> None:
    """Have OpenCV compute with one thread in this process, as what runs beside it does."""
    import cv2

    cv2.setNumThreads(1)
