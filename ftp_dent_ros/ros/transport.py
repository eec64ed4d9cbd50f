"""The DDS transport that images and clouds of megabytes need.

Fast DDS's own shared-memory segment holds 0.5 MB; larger messages between processes are lost.
``config/transport.xml`` makes it 128 MB, of which every participant takes the whole at once.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from xml.etree import ElementTree

from ftp_dent_ros import files

# What Fast DDS 2.14 reads; its newer name for it is not known to that version.
VARIABLE = 'FASTRTPS_DEFAULT_PROFILES_FILE'
_SCHEMA = 'http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles'
_MEGABYTE = 1 << 20
_SMALLEST = 4 * _MEGABYTE


@contextmanager
def profile(
    participants: int,
    environment: Mapping[str, str] = os.environ,
    shared_memory: str | os.PathLike[str] = '/dev/shm',
) -> Iterator[dict[str, str]]:
    """Environment variables that select the transport; none if the user has selected one.

    The shipped profile where the shared memory has room for it, else one with segments so small
    that they take up half of the room at most. Below 4 MB Fast DDS is left as it is.

    Parameters
    ----------
    participants : int
        Processes that will take part, on this machine.
    environment : mapping
        Where the user may have set the variable.
    shared_memory : path
        Where Fast DDS keeps its segments.
    """
    if environment.get(VARIABLE):
        yield {}
        return
    shipped = files.find('transport.xml')
    tree = ElementTree.parse(shipped)
    segment, message = (
        next(tree.iter(f'{{{_SCHEMA}}}{name}')) for name in ('segment_size', 'maxMessageSize')
    )
    wanted = int(segment.text or 0)
    size = segment_size(wanted, participants, free_bytes(shared_memory))
    if size < _SMALLEST:
        yield {}
    elif size == wanted:
        yield {VARIABLE: str(shipped)}
    else:
        segment.text = str(size)
        message.text = str(min(int(message.text or 0), size // 2))
        with tempfile.TemporaryDirectory(prefix='ftp_dent_ros.') as folder:
            reduced = Path(folder) / 'transport.xml'
            ElementTree.register_namespace('', _SCHEMA)
            tree.write(reduced, encoding='utf-8', xml_declaration=True)
            yield {VARIABLE: str(reduced)}


def segment_size(wanted: int, participants: int, free: int) -> int:
    """Bytes of a segment: as wanted, halved until all of them fit into half of what is free."""
    size = wanted
    while size and size * participants > free // 2:
        size //= 2
    return size


def free_bytes(folder: str | os.PathLike[str]) -> int:
    """Bytes that may still be written in a file system; 0 if it is not there."""
    try:
        status = os.statvfs(folder)
    except OSError:
        return 0
    return status.f_bavail * status.f_frsize
