"""The list of dents of a flight: corrected with its poses, kept on disk if a file is named."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.dents.dent import MeasuredDent, dent_from_plain, dent_to_plain
from ftp_dent_ros.dents.dent_list import DentList
from ftp_dent_ros.dents.sightings import ListedDent
from ftp_dent_ros.errors import ConfigurationError, PoseError
from ftp_dent_ros.pose import Pose

# A state of the list is kept before every so many frames: to begin a correction there.
_EVERY = 8
# How lines of its file begin.
_STARTS = b'{"frame_id": ', b'{"corrected": '


class KeptList:
    """A `DentList` in one frame of reference, whose clouds differ by their stamps.

    Parameters
    ----------
    path : path-like, optional
        File that holds it over a restart; what is there is read.

    Attributes
    ----------
    frame_id : str
        Of the list; empty while it is.
    stamp_ns : int
        Of the last one.

    Raises
    ------
    ConfigurationError
        The file cannot be read or written, or is something else.
    """

    def __init__(self, path: str | os.PathLike[str] | None = None) -> None:
        self._path = Path(path) if path else None
        self._forget()
        poses: dict[int, Pose] = {}
        for number, line in enumerate(_lines(self._path) if self._path else (), start=1):
            try:
                record = json.loads(line)
                if 'corrected' in record:
                    poses |= {int(each['stamp_ns']): _pose(each) for each in record['corrected']}
                    continue
                self._take(
                    str(record['frame_id']),
                    int(record['stamp_ns']),
                    [dent_from_plain(each) for each in record['dents']],
                    _pose(record),
                    np.array(record['covariance'], float).reshape(6, 6),
                )
            except PoseError as error:
                raise ConfigurationError(f'{path}: {error}') from None
            except (ValueError, KeyError, TypeError):
                raise ConfigurationError(
                    f'{path}: line {number} is no entry of a list of dents: '
                    'name another file, or remove this one'
                ) from None
        self._replace(poses)

    def add(
        self,
        frame_id: str,
        stamp_ns: int,
        dents: Sequence[MeasuredDent],
        pose: Pose,
        covariance: NDArray[np.float64],
    ) -> None:
        """Add what one cloud shows.

        Parameters
        ----------
        frame_id : str
            Frame of the dents and of the pose.
        stamp_ns : int
            Of the exposure.
        dents : sequence of MeasuredDent
        pose : Pose
            Of the camera.
        covariance : ndarray, shape (6, 6)

        Raises
        ------
        PoseError
            The frame is another one than the list's, or the stamp is one that was added.
        OSError
            It cannot be kept on disk; it is in the list all the same.
        """
        self._take(frame_id, stamp_ns, dents, pose, covariance)
        if self._path:
            record = {'frame_id': frame_id, 'stamp_ns': stamp_ns, **_plain(pose)}
            record['covariance'] = np.ravel(covariance).tolist()
            _append(self._path, record | {'dents': [dent_to_plain(dent) for dent in dents]})

    def correct(self, frame_id: str, poses: Mapping[int, Pose]) -> bool:
        """Put clouds where their cameras are found to have been; whether that changes anything.

        The list is made again from the first cloud on that lies elsewhere. What begins a dent
        keeps its number, and the number of what turns out to be another dent is gone.

        Parameters
        ----------
        frame_id : str
            Frame of the poses.
        poses : mapping of int to Pose
            Of the cameras, by the clouds' stamps; others are left alone.

        Raises
        ------
        PoseError
            The frame is another one than the list's.
        OSError
            It cannot be kept on disk; the list is corrected all the same.
        """
        if self.frame_id and frame_id != self.frame_id:
            raise _other_frame('the path is', frame_id, self.frame_id)
        corrected = self._replace(poses)
        if corrected and self._path:
            entries = [{'stamp_ns': stamp, **_plain(pose)} for stamp, pose in corrected.items()]
            _append(self._path, {'corrected': entries})
        return bool(corrected)

    def clear(self) -> None:
        """Forget all, on disk too; raises OSError if that cannot be."""
        self._forget()
        if self._path:
            os.truncate(self._path, 0)

    @property
    def entries(self) -> tuple[ListedDent, ...]:
        """Every dent and whatever else was found, with its clearance."""
        return self._list.entries

    def snapshot(self) -> DentList:
        """The list as it is, which later changes leave alone; made at once, however long it is."""
        return self._list.copy()

    def _forget(self) -> None:
        self._list = DentList()
        # Its states before some clouds.
        self._before: list[DentList] = []
        self.frame_id, self.stamp_ns = '', 0

    @property
    def clouds(self) -> int:
        """How many clouds the list is made of."""
        return len(self._list.clouds)

    def _replace(self, poses: Mapping[int, Pose]) -> dict[int, Pose]:
        """Place clouds anew; the poses that are used of those given."""
        clouds = self._list.clouds
        moved = [each.placed(poses.get(each.stamp_ns)) for each in clouds]
        # No pose is better, metres: its cloud stays where it is.
        off = [
            bool((np.linalg.norm(new.places - old.places, axis=1) > 1e-3).any())
            for old, new in zip(clouds, moved, strict=True)
        ]
        if not any(off):
            return {}
        there = [new if away else old for old, new, away in zip(clouds, moved, off, strict=True)]
        first = off.index(True) // _EVERY
        self._list = self._before[first].numbered_as(self._list)
        del self._before[first:]
        for each in there[first * _EVERY :]:
            self._add(each.stamp_ns, each.dents, each.pose, each.covariance)
        return {
            each.stamp_ns: poses[each.stamp_ns]
            for each, away in zip(there, off, strict=True)
            if away
        }

    def _add(
        self,
        stamp_ns: int,
        dents: Sequence[MeasuredDent],
        pose: Pose | None,
        covariance: NDArray[np.float64] | None,
    ) -> bool:
        number = len(self._list.clouds) + 1
        before = self._list.copy() if number % _EVERY == 1 else None
        is_new = self._list.add(number, dents, pose, covariance, stamp_ns=stamp_ns)
        if is_new and before is not None:
            self._before.append(before)
        return is_new

    def _take(
        self,
        frame_id: str,
        stamp_ns: int,
        dents: Sequence[MeasuredDent],
        pose: Pose,
        covariance: NDArray[np.float64],
    ) -> None:
        if self.frame_id and frame_id != self.frame_id:
            raise _other_frame('the cloud is put', frame_id, self.frame_id)
        if not self._add(stamp_ns, dents, pose, covariance):
            raise PoseError(
                f'the cloud of {stamp_ns / 1e9:.3f} s is in the list already: publish each '
                'once, with the time of its exposure',
                'already seen',
            )
        self.frame_id, self.stamp_ns = frame_id, stamp_ns


def _other_frame(what: str, frame_id: str, own: str) -> PoseError:
    return PoseError(
        f'{what} in the frame {frame_id!r}, the list is in {own!r}: publish all in one, or take '
        'the list first',
        'wrong frame',
    )


def _lines(path: Path) -> Iterator[bytes]:
    """Records of a file, which is made if it is not there; one that a crash cut short is gone.

    That one goes last, so that an error at another record leaves a file of something else alone.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
        *lines, last = path.read_bytes().split(b'\n')
    except OSError as reason:
        raise ConfigurationError(
            f'{path}: the list cannot be kept there ({reason.strerror}): name another file'
        ) from None
    yield from lines
    begun = last.rstrip(b'\0')  # which a power cut may leave
    if not any(start.startswith(begun[: len(start)]) for start in _STARTS):
        yield last
    elif last:
        # The next entry must not be joined to it.
        os.truncate(path, sum(len(line) + 1 for line in lines))


def _append(path: Path, record: dict[str, Any]) -> None:
    """Write a line, which is on disk then; raises OSError if it cannot be."""
    with path.open('ab') as file:
        file.write(json.dumps(record).encode() + b'\n')
        file.flush()
        os.fsync(file.fileno())


def _plain(pose: Pose) -> dict[str, Any]:
    return {
        'position': pose.translation.tolist(),
        'orientation_xyzw': pose.quaternion.tolist(),
    }


def _pose(record: dict[str, Any]) -> Pose:
    return Pose.from_quaternion(record['orientation_xyzw'], record['position'])
