"""Clouds as files: PLY, with the grid that an organised cloud has.

Source of the format: G. Turk, "The PLY Polygon File Format" (1994). Written is binary, little
endian, float32; read is whatever PLY says the same in: text or binary of either byte order, any
scalar types, further properties, and elements behind the vertices.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.lib.recfunctions import unstructured_to_structured
from numpy.typing import NDArray

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.errors import CloudError, printable
from ftp_dent_ros.files import write_atomically

_FIELDS = ('intensity', 'sigma', 'resolution')
_VERTEX = np.dtype(
    [*((name, '<f4') for name in ('x', 'y', 'z', *_FIELDS)), ('row', '<u2'), ('column', '<u2')]
)
_SKIN = ('skin', 'u1')

_NEEDED = {'x', 'y', 'z', 'intensity', 'row', 'column'}
# The names that PLY's readers and writers use for the same types, as numpy's.
_TYPES = {
    'char': 'i1',
    'uchar': 'u1',
    'short': 'i2',
    'ushort': 'u2',
    'int': 'i4',
    'uint': 'u4',
    'int8': 'i1',
    'uint8': 'u1',
    'int16': 'i2',
    'uint16': 'u2',
    'int32': 'i4',
    'uint32': 'u4',
    'float': 'f4',
    'float32': 'f4',
    'double': 'f8',
    'float64': 'f8',
}
_ORDERS = {'ascii': '', 'binary_little_endian': '<', 'binary_big_endian': '>'}
_END = re.compile(rb'^end_header\r?\n', re.MULTILINE)
_NO_GRID = 'not an organised cloud (it lacks the grid that ftp-dent writes): give one that is'
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
    has_skin = bool(cloud.skin.any())
    vertex = np.empty(len(row), np.dtype([*_VERTEX.descr, *([_SKIN] if has_skin else [])]))
    for axis, name in enumerate('xyz'):
        vertex[name] = cloud.points[row, column, axis]
    for name in _FIELDS:
        vertex[name] = getattr(cloud, name)[row, column]
    vertex['row'], vertex['column'] = row, column
    if has_skin:
        vertex['skin'] = cloud.skin[row, column]
    rows, columns = cloud.valid.shape
    header = [
        'ply',
        'format binary_little_endian 1.0',
        FRAME + printable(frame_id),
        *([RIG + printable(rig_id)] if rig_id else []),
        f'obj_info num_cols {columns}',
        f'obj_info num_rows {rows}',
        f'element vertex {len(vertex)}',
        *(f'property float {name}' for name in ('x', 'y', 'z', *_FIELDS)),
        'property ushort row',
        'property ushort column',
        *(['property uchar skin'] if has_skin else []),
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
    """Read a cloud that `write_ply` wrote, or another program in its layout, with its frame.

    Returns
    -------
    cloud : Cloud
    frame_id : str
        Empty if the file does not say it.

    Raises
    ------
    CloudError
        The file cannot be read, is cut short, has no grid or one that no camera has, or is a
        PLY of a layout that holds no organised cloud; told by the header, before anything large
        is read or made.
    """
    with _reading(path) as file:
        header = read_header(header_lines(file))
        return _cloud(header, _vertices(header, file)), header.frame_id


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


def _vertices(header: Header, file: BinaryIO) -> NDArray[np.void]:
    """What the file holds of each vertex, shape (count,)."""
    size = os.fstat(file.fileno()).st_size - file.tell()
    if header.order:
        needed = header.count * header.vertex.itemsize
        if size < needed or (header.is_last and size > needed):
            raise CloudError('cut short or damaged: write it again')
        return np.frombuffer(file.read(needed), header.vertex)
    # A value of text has a character and a space at least.
    if size < 2 * header.count * len(header.vertex.names or ()):
        raise CloudError('cut short or damaged: write it again')
    try:
        lines = (line for line in islice(file, header.count))
        values = np.loadtxt(lines, ndmin=2, comments=None) if header.count else np.empty((0, 0))
    except ValueError:
        values = np.empty((0, 0))
    if header.count and values.shape != (header.count, len(header.vertex.names or ())):
        raise CloudError('cut short or damaged: write it again')
    return unstructured_to_structured(values.reshape(header.count, -1), header.vertex)


def _cloud(header: Header, vertex: NDArray[np.void]) -> Cloud:
    shape = header.rows, header.columns
    with np.errstate(invalid='ignore', over='ignore'):
        points_of = np.stack([vertex[name] for name in 'xyz'], axis=-1).astype(np.float32)
        at = vertex['row'].astype(np.int64), vertex['column'].astype(np.int64)
    for index, name, limit in zip(at, ('row', 'column'), shape, strict=True):
        if ((index != vertex[name]) | (index < 0) | (index >= limit)).any():
            raise CloudError('a point lies outside its grid: write it again')
    points_of[~np.isfinite(points_of).all(axis=-1)] = np.nan
    points = np.full((*shape, 3), np.nan, np.float32)
    points[at] = points_of
    values_of = {
        name: np.full(shape, 0 if name == 'intensity' else np.nan, np.float32) for name in _FIELDS
    }
    for name in set(_FIELDS) & set(header.vertex.names or ()):
        values_of[name][at] = vertex[name]
    skin = np.zeros(shape, np.uint8)
    if 'skin' in (header.vertex.names or ()):
        skin[at] = np.clip(vertex['skin'], 0, 255)
    return Cloud(points, **values_of, skin=skin)


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


@dataclass(frozen=True)
class Header:
    """What a header says of an organised cloud.

    Attributes
    ----------
    order : str
        Of the bytes, as numpy has it; '' for text.
    vertex : numpy.dtype
        Of one vertex, by its properties.
    count : int
        Vertices.
    rows, columns : int
        Of the grid that they are of.
    frame_id : str
        Empty if it is not said.
    is_last : bool
        Whether nothing follows the vertices.
    """

    order: str
    vertex: np.dtype
    count: int
    rows: int
    columns: int
    frame_id: str
    is_last: bool


def read_header(lines: list[str]) -> Header:
    """Read the lines of a header.

    Raises
    ------
    CloudError
        It is of another format, or of no organised cloud, or its grid is none that a camera has.
    """
    words = [line.split() for line in lines]
    elements = [(n, line) for n, line in enumerate(words) if line[:1] == ['element']]
    order = next((_ORDERS.get(line[1]) for line in words if len(line) > 1), None)
    if (words[1:2] and words[1][:1] != ['format']) or order is None:
        raise CloudError(f'its format is none of {", ".join(_ORDERS)}: convert it')
    if not elements or elements[0][1][1:2] != ['vertex']:
        raise CloudError('its first element is not vertex: convert it')
    first, last = elements[0][0], elements[1][0] if len(elements) > 1 else len(words)
    vertex = _layout([line for line in words[first:last] if line[:1] == ['property']], order)
    said = {tuple(line[:-1]): line[-1] for line in words if len(line) > 1}
    try:
        columns, rows = (int(said['obj_info', f'num_{name}']) for name in ('cols', 'rows'))
        count = int(elements[0][1][2])
    except (KeyError, ValueError, IndexError):
        raise CloudError(_NO_GRID) from None
    if (
        columns < 1
        or rows < 1
        or columns * rows > _MOST_POINTS
        or not 0 <= count <= columns * rows
    ):
        raise CloudError(
            f'{count} points on a grid of {columns}x{rows}, which no camera has: write it again'
        )
    frame_id = _after(FRAME, lines)
    return Header(order, vertex, count, rows, columns, frame_id, len(elements) == 1)


def _layout(properties: list[list[str]], order: str) -> np.dtype:
    """Of one vertex."""
    fields = []
    for line in properties:
        kind = _TYPES.get(line[1]) if len(line) == 3 else None
        if kind is None:
            raise CloudError(
                f'a vertex has the {" ".join(line)!r}, which is no number: convert it'
            )
        fields.append((line[2], order + kind))
    names = [name for name, _ in fields]
    if len(set(names)) < len(names) or not set(names) >= _NEEDED:
        raise CloudError(_NO_GRID)
    return np.dtype(fields)
