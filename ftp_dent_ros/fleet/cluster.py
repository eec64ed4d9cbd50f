"""Work on many items side by side, on the workers of a Dask cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

from distributed import Client, as_completed

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.fleet.processes import one_thread

Item = TypeVar('Item')
Result = TypeVar('Result')

# Of the connection to the scheduler, seconds.
_PATIENCE = 10


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
            failure = future.exception()
            yield running[future], failure if failure is not None else future.result()
            future.release()


def _alone(work: Callable[[Item], Result], item: Item) -> Result:
    one_thread()
    return work(item)
