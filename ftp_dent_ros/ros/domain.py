"""A ROS domain that nothing else on this machine uses."""

from __future__ import annotations

import fcntl
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ftp_dent_ros.errors import ConfigurationError


@contextmanager
def free_domain() -> Iterator[int]:
    """Put this process and those that it starts on a domain of their own, on this machine only.

    A lock on a file of the domain's number keeps others away who choose theirs in this way.

    Raises
    ------
    ConfigurationError
        All domains are taken.
    """
    locks = Path(tempfile.gettempdir()) / f'ftp_dent_ros_domains_{os.getuid()}'
    locks.mkdir(exist_ok=True)
    # From 102 on the ports that DDS derives from the domain reach the ephemeral ones of Linux.
    for domain in range(1, 102):
        with (locks / str(domain)).open('w') as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                continue
            settings = {
                'ROS_DOMAIN_ID': str(domain),
                'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
            }
            before = {name: os.environ.get(name) for name in settings}
            os.environ.update(settings)
            try:
                yield domain
            finally:
                for name, value in before.items():
                    if value is None:
                        del os.environ[name]
                    else:
                        os.environ[name] = value
            return
    raise ConfigurationError(
        'all ROS domains from 1 to 101 are taken by other runs on this machine: end some of them'
    )
