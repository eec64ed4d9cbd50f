"""A list of dents on disk: what each frame added, and where cameras were found to have been.

A line of JSON each, for a restart to read.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.inspection.dent import MeasuredDent
from ftp_dent_ros.inspection.plain import dent_from_plain, dent_to_plain
from ftp_dent_ros.pose import Pose


@dataclass(frozen=True, eq=False)
class Entry:
    """What one frame added.

    Attributes
    ----------
    frame_id : str
        Of the list.
    stamp_ns : int
    dents : tuple of MeasuredDent
        In that frame, where the pose puts them.
    pose : Pose
        Of the camera.
    covariance : ndarray, shape (6, 6)
    """

    frame_id: str
    stamp_ns: int
    dents: tuple[MeasuredDent, ...]
    pose: Pose
    covariance: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Correction:
    """Where cameras are found to have been, after all.

    Attributes
    ----------
    poses : mapping of int to Pose
        By the stamps of their frames, in the list's frame.
    """

    poses: Mapping[int, Pose]


class Journal:
    """The entries of a list, in a file.

    An entry is on disk before `append` returns. One that a crash has cut short is left out.

    Parameters
    ----------
    path : path-like
        Made if it is not there.

    Raises
    ------
    ConfigurationError
        The file cannot be read or written, or is something else.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self.path.touch()
            lines = self.path.read_bytes().split(b'\n')
        except OSError as reason:
            raise ConfigurationError(
                f'{self.path}: the list cannot be kept there ({reason.strerror}): '
                'name another file'
            ) from None
        self._whole = lines[:-1]
        if lines[-1]:
            # Cut short: the next entry must not be joined to it.
            os.truncate(self.path, sum(len(line) + 1 for line in self._whole))

    def entries(self) -> Iterator[Entry | Correction]:
        """What the file held when it was opened, in its order.

        Raises
        ------
        ConfigurationError
            A line is no entry.
        """
        return (self._read(number, line) for number, line in enumerate(self._whole, start=1))

    def _read(self, number: int, line: bytes) -> Entry | Correction:
        try:
            record = json.loads(line)
            return _correction(record) if 'corrected' in record else _entry(record)
        except (ValueError, KeyError, TypeError):
            raise ConfigurationError(
                f'{self.path}: line {number} is no entry of a list of dents: '
                'name another file, or remove this one'
            ) from None

    def append(self, item: Entry | Correction) -> None:
        """Write what is new; raises OSError if it cannot be."""
        line = json.dumps(_record(item)).encode() + b'\n'
        with self.path.open('ab') as file:
            file.write(line)
            file.flush()
            os.fsync(file.fileno())

    def clear(self) -> None:
        """Forget all; raises OSError if it cannot be."""
        os.truncate(self.path, 0)


def _record(item: Entry | Correction) -> dict[str, Any]:
    if isinstance(item, Correction):
        corrected = [{'stamp_ns': stamp, **_plain(pose)} for stamp, pose in item.poses.items()]
        return {'corrected': corrected}
    return {
        'frame_id': item.frame_id,
        'stamp_ns': item.stamp_ns,
        **_plain(item.pose),
        'covariance': np.ravel(item.covariance).tolist(),
        'dents': [dent_to_plain(dent) for dent in item.dents],
    }


def _plain(pose: Pose) -> dict[str, Any]:
    return {
        'position': pose.translation.tolist(),
        'orientation_xyzw': pose.quaternion.tolist(),
    }


def _pose(record: dict[str, Any]) -> Pose:
    return Pose.from_quaternion(record['orientation_xyzw'], record['position'])


def _correction(record: dict[str, Any]) -> Correction:
    return Correction({int(each['stamp_ns']): _pose(each) for each in record['corrected']})


def _entry(record: dict[str, Any]) -> Entry:
    return Entry(
        frame_id=str(record['frame_id']),
        stamp_ns=int(record['stamp_ns']),
        dents=tuple(dent_from_plain(each) for each in record['dents']),
        pose=_pose(record),
        covariance=np.array(record['covariance'], float).reshape(6, 6),
    )
