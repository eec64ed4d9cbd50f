"""An organised point cloud, and its file format (PLY)."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import CloudError
from ftp_dent_ros.files import written_aside

if TYPE_CHECKING:
    # SciPy takes a second to load on a small computer, and not every node needs it.
    from ftp_dent_ros.pose import Pose

_VERTEX = np.dtype(
    [
        ('x', '<f4'),
        ('y', '<f4'),
        ('z', '<f4'),
        ('intensity', '<f4'),
        ('row', '<u2'),
        ('column', '<u2'),
    ]
)


@dataclass(frozen=True)
class Cloud:
    """Points on the camera's grid, at full resolution or at every n-th pixel.

    Attributes
    ----------
    points : ndarray, shape (rows, columns, 3), float32
        Metres; NaN where there is no measurement.
    intensity : ndarray, shape (rows, columns), float32
        Modulation of the fringes in grey levels: the strength of the signal.
    """

    points: NDArray[np.float32]
    intensity: NDArray[np.float32]

    def __post_init__(self) -> None:
        if self.points.ndim != 3 or self.points.shape[2] != 3:
            raise CloudError(
                f'a cloud has the shape (rows, columns, 3), not {self.points.shape}: '
                'give an organised cloud'
            )
        if self.intensity.shape != self.points.shape[:2]:
            raise CloudError(
                f'intensity has the shape {self.intensity.shape}, the points '
                f'{self.points.shape[:2]}: give one intensity a point'
            )

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Mask of the measured points, shape (rows, columns)."""
        return np.isfinite(self.points[..., 2])

    def transformed(self, pose: Pose) -> Cloud:
        """The same cloud in the parent frame of `pose`."""
        return Cloud(pose.apply(self.points), self.intensity)


def write_ply(path: str | os.PathLike[str], cloud: Cloud, frame_id: str) -> None:
    """Write the valid points as binary PLY; a file under that name is whole or not there.

    The grid's size stands in the header as ``obj_info num_cols`` and ``num_rows``, each
    vertex has its ``row`` and ``column``: readers that know only x, y, z ignore both.

    Raises
    ------
    CloudError
        The file cannot be written.
    """
    row, column = np.nonzero(cloud.valid)
    vertex = np.empty(len(row), _VERTEX)
    for axis, name in enumerate('xyz'):
        vertex[name] = cloud.points[row, column, axis]
    vertex['intensity'] = cloud.intensity[row, column]
    vertex['row'], vertex['column'] = row, column
    rows, columns = cloud.valid.shape
    header = [
        'ply',
        'format binary_little_endian 1.0',
        f'comment ftp_dent_ros, metres, frame {frame_id}',
        f'obj_info num_cols {columns}',
        f'obj_info num_rows {rows}',
        f'element vertex {len(vertex)}',
        *(f'property float {name}' for name in ('x', 'y', 'z', 'intensity')),
        'property ushort row',
        'property ushort column',
        'end_header',
    ]
    try:
        with written_aside(path) as aside, aside.open('wb') as file:
            file.write('\n'.join(header).encode('ascii') + b'\n')
            file.write(vertex.tobytes())
    except OSError as reason:
        raise CloudError(
            f'{path}: cannot be written ({reason.strerror}): check the path and the disk'
        ) from None


def read_ply(path: str | os.PathLike[str]) -> tuple[Cloud, str]:
    """Read a cloud that `write_ply` wrote, with its ``frame_id``.

    Raises
    ------
    CloudError
        The file cannot be read, is cut short, or is a PLY of another layout.
    """
    try:
        data = Path(path).read_bytes()
    except OSError as reason:
        raise CloudError(f'{path}: cannot be read ({reason.strerror}): check the path') from None
    head, end, body = data.partition(b'end_header\n')
    lines = head.decode('ascii', 'replace').splitlines()
    if not end or not lines or lines[0] != 'ply':
        raise CloudError(f'{path}: not a PLY file: give a cloud written by ftp-dent')
    properties = [line.split()[2] for line in lines if line.startswith('property')]
    fields = {tuple(line.split()[:-1]): line.split()[-1] for line in lines if ' ' in line}
    try:
        columns = int(fields['obj_info', 'num_cols'])
        rows = int(fields['obj_info', 'num_rows'])
        count = int(fields['element', 'vertex'])
        if tuple(properties) != _VERTEX.names:
            raise KeyError('property')
        frame_id = fields['comment', 'ftp_dent_ros,', 'metres,', 'frame']
    except (KeyError, ValueError):
        raise CloudError(
            f'{path}: not an organised cloud (it lacks the grid that ftp-dent writes): '
            'give a cloud written by ftp-dent'
        ) from None
    if len(body) != count * _VERTEX.itemsize:
        raise CloudError(f'{path}: cut short or damaged: write it again')
    vertex = np.frombuffer(body, _VERTEX)
    if count and (vertex['row'].max() >= rows or vertex['column'].max() >= columns):
        raise CloudError(f'{path}: a point lies outside its grid: write it again')
    points = np.full((rows, columns, 3), np.nan, np.float32)
    intensity = np.zeros((rows, columns), np.float32)
    at = vertex['row'], vertex['column']
    points[at] = np.stack([vertex[name] for name in 'xyz'], axis=-1)
    intensity[at] = vertex['intensity']
    return Cloud(points, intensity), frame_id
