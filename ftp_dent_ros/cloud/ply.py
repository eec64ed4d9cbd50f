"""Clouds as files: binary PLY, little endian, with the grid that an organised cloud has.

Source of the format: G. Turk, "The PLY Polygon File Format" (1994).
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.errors import CloudError, printable
from ftp_dent_ros.files import write_atomically

_FORMAT = 'format binary_little_endian 1.0'
# What is written of a vertex, by PLY's names and numpy's.
_FIELDS = ('intensity', 'sigma', 'resolution')
_PROPERTIES = [
    *((name, 'float') for name in ('x', 'y', 'z', *_FIELDS)),
    ('row', 'ushort'),
    ('column', 'ushort'),
]
_SKIN = ('skin', 'uchar')
_TYPES = {'float': '<f4', 'ushort': '<u2', 'uchar': 'u1'}

_END = re.compile(rb'^end_header\n', re.MULTILINE)
_NO_GRID = 'not an organised cloud as ftp-dent writes it, with its grid: give one that is'
_CUT = 'cut short or damaged: write it again'
#: What the comments begin with that name the points' frame, and the rig that measured them.
FRAME = 'comment ftp_dent_ros, metres, frame '
RIG = 'comment rig '
_LONGEST_HEADER = 1 << 16  # bytes
_MOST_POINTS = 1 << 26  # of a grid: four times the camera of 16 megapixels


def write_ply(path: str | os.PathLike[str], cloud: Cloud, frame_id: str, rig_id: str = '') -> None:
    """Write the valid points as binary PLY; a file under that name is whole or not there.

    The grid's size stands in the header as ``obj_info num_cols`` and ``num_rows``, each
    vertex has its ``row`` and ``column``, and its ``skin`` where the cloud has that: readers that
    know only x, y, z ignore them. A comment names the rig (`Rig.id`) that measured the cloud.

    Raises
    ------
    CloudError
        The file cannot be written.
    """
    row, column = np.nonzero(cloud.valid)
    properties = [*_PROPERTIES, *([_SKIN] if cloud.skin.any() else [])]
    vertex = np.empty(len(row), [(name, _TYPES[kind]) for name, kind in properties])
    values = {'row': row, 'column': column}
    values |= dict(zip('xyz', cloud.points[row, column].T, strict=True))
    for name, _ in properties:
        vertex[name] = values[name] if name in values else getattr(cloud, name)[row, column]
    rows, columns = cloud.valid.shape
    header = [
        'ply',
        _FORMAT,
        FRAME + printable(frame_id),
        *([RIG + printable(rig_id)] if rig_id else []),
        f'obj_info num_cols {columns}',
        f'obj_info num_rows {rows}',
        f'element vertex {len(vertex)}',
        *(f'property {kind} {name}' for name, kind in properties),
        'end_header',
    ]
    try:
        with write_atomically(path) as temporary, temporary.open('wb') as file:
            file.write('\n'.join(header).encode('ascii', 'backslashreplace') + b'\n')
            file.write(vertex.tobytes())
    except OSError as reason:
        raise CloudError(
            f'{path}: cannot be written ({reason.strerror}): check the path and the disk'
        ) from None


def read_ply(path: str | os.PathLike[str]) -> tuple[Cloud, str]:
    """Read a cloud that `write_ply` wrote, with its frame.

    Returns
    -------
    cloud : Cloud
    frame_id : str
        Empty if the file does not say it.

    Raises
    ------
    CloudError
        The file cannot be read, is cut short, has no grid or one that no camera has, or is a
        PLY of another layout; told by the header, before anything large is read or made.
    """
    with _reading(path) as file:
        lines = header_lines(file)
        vertex, shape = _layout(lines)
        size = os.fstat(file.fileno()).st_size - file.tell()
        if size != vertex.itemsize * _count(lines, shape):
            raise CloudError(_CUT)
        return _cloud(np.frombuffer(file.read(), vertex), shape), _after(FRAME, lines)


@contextmanager
def _reading(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """The file, opened; what is wrong with it is said with its path."""
    try:
        with Path(path).open('rb') as file:
            yield file
    except OSError as reason:
        raise CloudError(f'{path}: cannot be read ({reason.strerror}): check the path') from None
    except CloudError as reason:
        raise CloudError(f'{path}: {reason}') from None


def rig_id_of(path: str | os.PathLike[str]) -> str:
    """Id of the rig that measured a cloud, as its file says; empty if it does not.

    Raises
    ------
    CloudError
        The file cannot be read, or is no PLY.
    """
    with _reading(path) as file:
        return _after(RIG, header_lines(file))


def _after(start: str, lines: list[str]) -> str:
    """Rest of the first line that begins so; empty if none does."""
    rests = (line.removeprefix(start).strip() for line in lines if line.startswith(start))
    return next(rests, '')


def header_lines(file: BinaryIO) -> list[str]:
    """Lines of the header; the file then stands behind it.

    Raises
    ------
    CloudError
        It is no PLY file.
    """
    start = file.read(_LONGEST_HEADER)
    end = _END.search(start)
    if not end or not start.startswith(b'ply'):
        raise CloudError('not a PLY file: give a cloud written by ftp-dent')
    file.seek(end.end())
    return start[: end.start()].decode('ascii', 'replace').splitlines()


def _layout(lines: list[str]) -> tuple[np.dtype, tuple[int, int]]:
    """Type of a vertex, and rows and columns of the grid, of the lines of a header."""
    if lines[1:2] != [_FORMAT]:
        raise CloudError(f'its format is not "{_FORMAT}": give a cloud written by ftp-dent')
    told = [line.split() for line in lines if line.startswith('property ')]
    properties = [(words[-1], words[1]) for words in told if len(words) == 3]
    if len(told) != len(properties) or properties not in (_PROPERTIES, [*_PROPERTIES, _SKIN]):
        raise CloudError(_NO_GRID)
    rows, columns = (_number(f'obj_info num_{name} ', lines) for name in ('rows', 'cols'))
    return np.dtype([(name, _TYPES[kind]) for name, kind in properties]), (rows, columns)


def _count(lines: list[str], shape: tuple[int, int]) -> int:
    """How many vertices there are, which have to find room on the grid."""
    count, (rows, columns) = _number('element vertex ', lines), shape
    places = rows * columns
    if min(rows, columns) < 1 or places > _MOST_POINTS or count > places:
        raise CloudError(
            f'{count} points on a grid of {columns}x{rows}, which no camera has: write it again'
        )
    return count


def _number(start: str, lines: list[str]) -> int:
    """The whole number that follows the beginning of a line."""
    text = _after(start, lines)
    if not re.fullmatch(r'[0-9]{1,18}', text):
        raise CloudError(_NO_GRID)
    return int(text)


def _cloud(vertex: NDArray[np.void], shape: tuple[int, int]) -> Cloud:
    at = vertex['row'].astype(np.intp), vertex['column'].astype(np.intp)
    if any((index >= limit).any() for index, limit in zip(at, shape, strict=True)):
        raise CloudError('a point lies outside its grid: write it again')
    points_of = np.stack([vertex[name] for name in 'xyz'], axis=-1)
    points_of[~np.isfinite(points_of).all(axis=-1)] = np.nan
    points = np.full((*shape, 3), np.nan, np.float32)
    points[at] = points_of
    values_of = {name: np.full(shape, np.nan, np.float32) for name in _FIELDS}
    values_of['intensity'][:] = 0
    for name in _FIELDS:
        values_of[name][at] = vertex[name]
    skin = np.zeros(shape, np.uint8)
    if 'skin' in (vertex.dtype.names or ()):
        skin[at] = vertex['skin']
    return Cloud(points, **values_of, skin=skin)
