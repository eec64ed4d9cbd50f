"""Many inputs side by side: on processes, or the machines of a cluster."""

from __future__ import annotations

import os
import signal
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent import futures
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import chain, islice
from multiprocessing import get_context
from typing import TypeVar

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.process import keep_freed, one_for_blas

Item = TypeVar('Item')
Result = TypeVar('Result')

# Of the connection to the scheduler, seconds.
_PATIENCE = 10


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
        `LostWorkerError` where its process died twice, the second time with nothing beside it;
        the others are done.
    """
    waiting = list(items)
    if not waiting:
        return
    lost = []
    with _pool(min(jobs, len(waiting))) as pool:
        running = {pool.submit(work, item): item for item in waiting}
        for future in futures.as_completed(running):
            outcome = _outcome(future)
            if isinstance(outcome, LostWorkerError):
                lost.append(running[future])
            else:
                yield running[future], outcome
    # What ran as a process died is tried once more, alone.
    for item in lost:
        with _pool(1) as pool:
            yield item, _outcome(pool.submit(work, item))


def _outcome(future: futures.Future[Result]) -> Result | Exception:
    try:
        return future.result()
    except BrokenProcessPool:
        return LostWorkerError('its process was killed')
    except Exception as error:
        return error


def in_order(work: Callable[[Item], Result], items: Iterable[Item], jobs: int) -> Iterator[Result]:
    """As `map`, by other processes that work a few items ahead.

    Parameters
    ----------
    work : callable
        As for `side_by_side`; it does not raise.
    items : iterable
        Taken no more than a few ahead of the results.
    jobs : int
    """
    if jobs < 2:
        yield from map(work, items)
        return
    coming = iter(items)
    ahead, results = deque[Item](), deque['futures.Future[Result]']()
    with _pool(jobs) as pool:
        try:
            while True:
                for item in islice(coming, 3 * jobs - len(ahead)):
                    ahead.append(item)
                    results.append(pool.submit(work, item))
                if not ahead:
                    return
                first = results.popleft().result()
                ahead.popleft()
                yield first
        except BrokenProcessPool:
            # One was killed: this process does what is left.
            yield from map(work, chain(ahead, coming))


@contextmanager
def _pool(jobs: int) -> Iterator[futures.ProcessPoolExecutor]:
    """Fresh interpreters, started with one thread each; what has not begun ends with the block."""
    one_for_blas()
    pool = futures.ProcessPoolExecutor(jobs, get_context('spawn'), _begin)
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def _begin() -> None:
    """Make a fresh process ready: Ctrl-C, which the terminal sends it too, ends it silently."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    one_thread()


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0))


def one_thread() -> None:
    """Have OpenCV compute with one thread in this process, as what runs beside it does.

    And the process keep its memory from item to item.
    """
    import cv2

    cv2.setNumThreads(1)
    keep_freed()


def on_cluster(
    work: Callable[[Item], Result], items: Iterable[Item], address: str
) -> Iterator[tuple[Item, Result | Exception]]:
    """Each item with its result, or with what went wrong, in the order in which they end.

    Parameters
    ----------
    work : callable
        Of a module that is installed where the workers are.
    items : iterable
    address : str
        Of the scheduler, as in ``tcp://10.0.0.1:8786``.

    Raises
    ------
    ConfigurationError
        There is no scheduler at the address, or it has no workers.
    """
    # Of the extra `cluster`.
    from distributed import Client, as_completed

    try:
        client = Client(address, timeout=_PATIENCE)
    except (OSError, ValueError, TimeoutError) as reason:
        raise ConfigurationError(
            f'--scheduler {address}: no Dask scheduler answers there ({reason}): '
            'start one with `dask scheduler`'
        ) from None
    with client:
        if not client.nthreads():
            raise ConfigurationError(
                f'--scheduler {address}: the scheduler has no workers: '
                f'start some with `dask worker {address}`'
            )
        running = {client.submit(_alone, work, item, pure=False): item for item in items}
        for future in as_completed(running):
            yield running[future], _outcome(future)
            future.release()


def _alone(work: Callable[[Item], Result], item: Item) -> Result:
    one_thread()
    return work(item)
