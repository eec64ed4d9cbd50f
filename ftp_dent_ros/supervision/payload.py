"""What has to hold before a payload's nodes are started, for ``up`` and ``launch`` alike."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.supervision import transport
from ftp_dent_ros.supervision.domain import exclusive
from ftp_dent_ros.supervision.shared_memory import free_leftovers

_OTHER_PARTICIPANTS = 3  # a recorder and two viewers, for the share of the shared memory
_MEGABYTE = 1e6


@contextmanager
def prepared(
    names: Sequence[str],
    interface: str,
    refuse_second: Callable[[Sequence[str]], None],
    say: Callable[[str], None],
) -> Iterator[dict[str, str]]:
    """Environment variables for a payload that nobody else runs.

    Gives back the shared memory that killed processes have left, and holds the nodes' names on
    this machine until it ends.

    Parameters
    ----------
    names : sequence of str
        Of the nodes, fully qualified, without the leading slash.
    interface : str
        As in `transport.profile`.
    refuse_second : callable
        Raises `ConfigurationError` if one of the names is in use in the graph.
    say : callable
        Takes a line for the user.

    Raises
    ------
    ConfigurationError
        Another ``up`` or ``launch`` has one of the names, or there is no such interface.
    """
    domain = os.environ.get('ROS_DOMAIN_ID', '0')
    with ExitStack() as stack:
        for name in names:
            stack.enter_context(_hold(name, domain))
        freed = free_leftovers()
        if freed.segments:
            say(
                f'gave back {freed.bytes / _MEGABYTE:.0f} MB of shared memory in {freed.segments} '
                'segments, which killed processes had left'
            )
        variables = stack.enter_context(
            transport.profile(len(names) + _OTHER_PARTICIPANTS, interface)
        )
        with transport.environment_of(variables):
            refuse_second(names)
        yield variables


def _hold(name: str, domain: str) -> socket.socket:
    try:
        return exclusive(f'node/{domain}/{name}')
    except OSError:
        raise ConfigurationError(
            f'{name} is run by another payload in the ROS domain {domain} of this machine: end '
            'that one, or take another namespace or ROS_DOMAIN_ID'
        ) from None
