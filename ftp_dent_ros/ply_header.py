"""The header of a PLY file: how its vertices lie in it, and the grid that they are of."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import BinaryIO

import numpy as np

from ftp_dent_ros.errors import CloudError

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
    told = [line.removeprefix(FRAME) for line in lines if line.startswith(FRAME)]
    frame_id = told[0].strip() if told else ''
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
