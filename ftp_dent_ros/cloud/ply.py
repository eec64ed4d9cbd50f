"""Clouds as files: binary PLY, little endian, with the grid that an organised cloud has.

Source of the format: G. Turk, "The PLY Polygon File Format" (1994).
"""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.cloud import FIELDS, Cloud
from ftp_dent_ros.errors import CloudError, printable
from ftp_dent_ros.files import write_atomically

_FORMAT = 'format binary_little_endian 1.0'
# What is written of a vertex, by PLY's names and numpy's.
_PROPERTIES = [
    *((name, 'float') for name in ('x', 'y', 'z', *FIELDS)),
    ('row', 'ushort'),
    ('column', 'ushort'),
]
_SKIN = ('skin', 'uchar')
_TYPES = {'float': '<f4', 'ushort': '<u2', 'uchar': 'u1'}

_END = re.compile(rb'^end_header\n', re.MULTILINE)
_WHOLE = re.compile('[0-9]{1,18}')
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
        *_lines(properties),
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


def read_ply(path: str | os.PathLike[str]) -> tuple[Cloud, str, str]:
    """Read a cloud that `write_ply` wrote, with its frame and its rig.

    Returns
    -------
    cloud : Cloud
    frame_id, rig_id : str
        Empty if the file does not say it.

    Raises
    ------
    CloudError
        The file cannot be read, is cut short, has no grid or one that no camera has, or is a
        PLY of another layout; the header shows it, before anything large is read or made.
    """
    try:
        with Path(path).open('rb') as file:
            start = file.read(_LONGEST_HEADER)
            end = _END.search(start)
            if not end or not start.startswith(b'ply'):
                raise CloudError('not a PLY file: give a cloud written by ftp-dent')
            lines = start[: end.start()].decode('ascii', 'replace').splitlines()
            vertex, count, shape = _layout(lines)
            if os.fstat(file.fileno()).st_size - end.end() != vertex.itemsize * count:
                raise CloudError('cut short or damaged: write it again')
            file.seek(end.end())
            cloud = _cloud(np.frombuffer(file.read(), vertex), shape)
    except OSError as reason:
        raise CloudError(f'{path}: cannot be read ({reason.strerror}): check the path') from None
    except CloudError as reason:
        raise CloudError(f'{path}: {reason}') from None
    return cloud, _after(FRAME, lines), _after(RIG, lines)


def _lines(properties: list[tuple[str, str]]) -> list[str]:
    return [f'property {kind} {name}' for name, kind in properties]


def _after(start: str, lines: list[str]) -> str:
    """Rest of the first line that begins so; empty if none does."""
    rests = (line.removeprefix(start).strip() for line in lines if line.startswith(start))
    return next(rests, '')


def _layout(lines: list[str]) -> tuple[np.dtype, int, tuple[int, int]]:
    """Type of a vertex, how many there are, and rows and columns of the grid, of a header."""
    if lines[1:2] != [_FORMAT]:
        raise CloudError(f'its format is not "{_FORMAT}": give a cloud written by ftp-dent')
    properties = [*_PROPERTIES, _SKIN] if _lines([_SKIN])[0] in lines else _PROPERTIES
    given = [line for line in lines if line.startswith('property ')]
    names = ('obj_info num_rows ', 'obj_info num_cols ', 'element vertex ')
    numbers = [_after(name, lines) for name in names]
    if given != _lines(properties) or not all(map(_WHOLE.fullmatch, numbers)):
        raise CloudError(
            'not an organised cloud as ftp-dent writes it, with its grid: give one that is'
        )
    rows, columns, count = map(int, numbers)
    # The vertices have to find room on the grid.
    if min(rows, columns) < 1 or not count <= rows * columns <= _MOST_POINTS:
        raise CloudError(
            f'{count} points on a grid of {columns}x{rows}, which no camera has: write it again'
        )
    return np.dtype([(name, _TYPES[kind]) for name, kind in properties]), count, (rows, columns)


def _cloud(vertex: NDArray[np.void], shape: tuple[int, int]) -> Cloud:
    at = vertex['row'].astype(np.intp), vertex['column'].astype(np.intp)
    if any((index >= limit).any() for index, limit in zip(at, shape, strict=True)):
        raise CloudError('a point lies outside its grid: write it again')
    grid = np.zeros(shape, vertex.dtype)
    for name in ('x', 'y', 'z', *FIELDS[1:]):
        grid[name] = np.nan
    grid[at] = vertex
    points = np.stack([grid[name] for name in 'xyz'], axis=-1)
    points[~np.isfinite(points).all(axis=-1)] = np.nan
    names = [*FIELDS, *(['skin'] if 'skin' in (vertex.dtype.names or ()) else [])]
    return Cloud(points, **{name: np.ascontiguousarray(grid[name]) for name in names})
