"""A list of dents on disk: what each frame added, a line of JSON each, for a restart to read."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
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

    def entries(self) -> Iterator[Entry]:
        """What the file held when it was opened.

        Raises
        ------
        ConfigurationError
            A line is no entry.
        """
        return (self._read(number, line) for number, line in enumerate(self._whole, start=1))

    def _read(self, number: int, line: bytes) -> Entry:
        try:
            return _entry(json.loads(line))
        except (ValueError, KeyError, TypeError):
            raise ConfigurationError(
                f'{self.path}: line {number} is no entry of a list of dents: '
                'name another file, or remove this one'
            ) from None

    def append(self, entry: Entry) -> None:
        """Write an entry; raises OSError if it cannot be."""
        line = json.dumps(_record(entry)).encode() + b'\n'
        with self.path.open('ab') as file:
            file.write(line)
            file.flush()
            os.fsync(file.fileno())

    def clear(self) -> None:
        """Forget all; raises OSError if it cannot be."""
        os.truncate(self.path, 0)


def _record(entry: Entry) -> dict[str, Any]:
    return {
        'frame_id': entry.frame_id,
        'stamp_ns': entry.stamp_ns,
        'position': entry.pose.translation.tolist(),
        'orientation_xyzw': entry.pose.quaternion.tolist(),
        'covariance': np.ravel(entry.covariance).tolist(),
        'dents': [dent_to_plain(dent) for dent in entry.dents],
    }


def _entry(record: dict[str, Any]) -> Entry:
    return Entry(
        frame_id=str(record['frame_id']),
        stamp_ns=int(record['stamp_ns']),
        dents=tuple(dent_from_plain(each) for each in record['dents']),
        pose=Pose.from_quaternion(record['orientation_xyzw'], record['position']),
        covariance=np.array(record['covariance'], float).reshape(6, 6),
    )
